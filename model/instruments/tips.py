"""A tip on the flange that touches a target: what all such instruments have in common, how a target is
fitted; probes that touch flat faces, and balls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import casadi as ca
import numpy as np
from pydantic import Field, model_validator

from ..arrays import Mask, Matrix
from ..errors import BadInput
from ..parsing.reading import shown
from ..parsing.validation import FileModel, NotNegative, NumberPair, Positive, Vector, refusal, without_length
from .frames import across, basis_across, vector_unknowns
from .kind import (
    TIP,
    Assumption,
    Flange,
    Point,
    ProposedHeader,
    Station,
    Target,
    TargetEntry,
    Unknown,
    Words,
    faces_at,
    target_at,
    whole_point,
)

TIP_MM = 0.1  # prior std of a stated tip, each direction
_NO_NORMAL = (0.36, 0.48, 0.8)
_STEEPEST = 0.2  # least cosine between a plane's normal and its stated one that a start believes
_STRAIGHT = 1e-3  # width by length of points that are on a line
_TINY = 1e-18  # mm²: keeps the derivative of a distance of zero finite
_STEPS = 50
_APPROACH = float(np.radians(75.0))  # between stylus and normal, at most


class StatedRange(FileModel):
    """What an instrument can read."""

    range_mm: NumberPair | None = Field(
        default=None, description="shortest and longest reading, millimetres: plans keep within it"
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        if self.range_mm is not None and not self.range_mm[0] < self.range_mm[1]:
            raise refusal(
                "range_mm: the readings are out of order",
                key=("range_mm",),
                found=shown(self.range_mm),
                allowed="[shortest, longest]",
            )
        return self


_ROOM_MM = 40.0  # of a drawn part of a plane, about where it was touched


class StatedTip(FileModel):
    """A tip on the flange, and how well it reads."""

    tip_mm: Vector = Field(description="the tip in the flange frame, millimetres")
    sigma_mm: Positive = Field(description="standard deviation of a reading or touch, millimetres")
    tip_sigma_mm: Positive | None = Field(
        default=None, description="standard deviation of the tip, each direction, millimetres; default: 0.1"
    )


def tip_std(header: StatedTip, *, exact: bool) -> float | None:
    """Prior std of a stated tip, mm; None of an exact one."""
    return TIP_MM if header.tip_sigma_mm is None and not exact else header.tip_sigma_mm


@dataclass(frozen=True, eq=False)
class TipStation(Station):
    """A tip on the flange at `tip` (3,) mm, known to `tip_std`; with None it is exact. `sigma` mm is the std
    of a reading; `tip_stated` where the header says how well the tip is known."""

    residual_size = 1

    tip: Matrix
    tip_std: float | None
    sigma: float
    tip_stated: bool

    @property
    def calibrated(self) -> bool:
        """The tip is always stated, to its tolerance."""
        return True

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        if self.tip_std is None:
            return ()
        unknowns = vector_unknowns(f"{self.label}.tip", self.tip, self.tip_std, tolerated=True)
        return tuple(unknown._replace(assumed=not self.tip_stated) for unknown in unknowns)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        key = f"instruments.{self.label}.tip_sigma_mm"
        return (
            Assumption(
                self.label, f"{self.label}.tip", self.name, "tip", self.tip_std, "mm", self.tip_stated, key
            ),
        )

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        """Of an exact tip its unknowns."""
        return (replace(self, tip_std=TIP_MM) if self.tip_std is None else self), {}

    @property
    def known_to(self) -> float:
        return self.tip_std or 0.0

    @property
    def key(self) -> bytes:
        """Of an exact tip its numbers; those of another are unknowns."""
        tip = self.tip.tobytes() if self.tip_std is None else b"unknown"
        return f"{self.name} ".encode() + tip

    @property
    def std(self) -> float:
        return self.sigma

    @property
    def point(self) -> Matrix:
        return self.tip

    def tip_at(self, unknowns: ca.SX) -> ca.SX:
        """(3, 1) mm in the flange frame."""
        return ca.SX(self.tip) if self.tip_std is None else unknowns[:3]

    def tips(self, poses: Matrix, unknowns: Matrix | None = None) -> Matrix:
        """(N, 3) mm in the base frame, of flange poses (N, 4, 4); of the stated tip without `unknowns`."""
        tip = self.tip if self.tip_std is None or unknowns is None else unknowns[:3]
        return np.asarray(poses[:, :3, :3] @ tip + poses[:, :3, 3])

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return self.tip_at(unknowns), ca.SX.zeros(3)

    def through(self, poses: Matrix, outward: Matrix) -> Mask:
        """(N,) where the way from the flange to the tip would lead through what is touched: it must come from
        within 75 degrees of the unit direction `outward` (3,) or (N, 3), base frame."""
        stylus = -(poses[:, :3, :3] @ self.tip)
        length = np.linalg.norm(stylus, axis=1)
        return np.asarray((stylus * outward).sum(axis=1) < np.cos(_APPROACH) * length)


class StatedBallTip(StatedTip):
    """A tip that is the centre of a ball, or a point."""

    tip_diameter_mm: NotNegative = Field(
        default=0.0, description="diameter of the ball whose centre the tip is, millimetres; 0 for a point"
    )


@dataclass(frozen=True, eq=False)
class BallTipStation(TipStation):
    """A tip that touches with a ball of `radius` mm: the joints are turned until it does."""

    columns: ClassVar[dict[str, int]] = {}
    met = True

    radius: float

    @classmethod
    def of(cls, label: str, entry: StatedBallTip, *, exact: bool) -> Self:
        return cls(
            label=label,
            tip=np.array(entry.tip_mm, dtype=float),
            tip_std=tip_std(entry, exact=exact),
            sigma=entry.sigma_mm,
            tip_stated=entry.tip_sigma_mm is not None,
            radius=entry.tip_diameter_mm / 2,
        )

    @property
    def key(self) -> bytes:
        return super().key + f" {self.radius}".encode()


def distance(point: ca.SX, other: ca.SX) -> ca.SX:
    """Between two points (3, 1), mm; its derivative is 0 where they are one."""
    return ca.sqrt(ca.sumsqr(point - other) + _TINY)


def directions(rng: np.random.Generator, count: int) -> Matrix:
    """(count, 3) unit vectors drawn evenly over the sphere."""
    drawn = rng.normal(size=(count, 3))
    return np.asarray(drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


# Planes


def unit_normal(target: TargetEntry | None) -> Matrix:
    """(3,) the unit normal that a header states of a plane. What reads no plane has one as well, which keeps
    its functions finite."""
    normal = _NO_NORMAL if target is None or target.normal is None else target.normal
    return np.asarray(np.array(normal, dtype=float) / np.linalg.norm(normal))


def plane_coordinates(target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
    """Distance d of a plane along its normal from the base's origin, mm, and its two tilts, rad. A tilt about
    a stated point off the normal moves d, which the prior of d allows for."""
    if target is None or target.normal is None or without_length(target.normal):
        raise BadInput(
            "a plane without a normal cannot be used",
            found="no normal" if target is None or target.normal is None else shown(target.normal),
            allowed="a direction in the base frame, out of the body, such as [0, 0, 1]",
            remedy="state the target's normal; it may be rough",
        )
    normal = unit_normal(target)
    point = np.array(target.guess_mm or (0.0, 0.0, 0.0), dtype=float)
    tilt = float(np.radians(target.sigma_deg))
    lever = float(np.linalg.norm(point - (normal @ point) * normal))
    return (
        Unknown("d", "mm", float(normal @ point), float(np.hypot(target.sigma_mm, lever * tilt))),
        Unknown("tilt1", "deg", 0.0, tilt),
        Unknown("tilt2", "deg", 0.0, tilt),
    )


def plane_at(target: ca.SX, nominal: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Unit normal n (3, 1) and distance d, n · p = d: of d, tilt1, tilt2 (3, 1) about a stated normal n0
    (3, 1). n is along n0 + tan(tilt1) b1 + tan(tilt2) b2."""
    b1, b2 = across(nominal)
    normal = nominal + ca.tan(target[1]) * b1 + ca.tan(target[2]) * b2
    return normal / ca.sqrt(ca.sumsqr(normal)), target[0]


def plane_normal(target: Target) -> Matrix:
    """(3,) the unit normal of a plane of which d, tilt1, tilt2 are known, as `plane_at`."""
    normals, _ = normals_at(target.numbers[None], unit_normal(target.entry))
    return np.asarray(normals[0])


def points_on(target: Target, rng: np.random.Generator, count: int) -> Matrix:
    """(count, 3) points of a face, drawn evenly from the circle about its guess."""
    normal, entry = plane_normal(target), target.entry
    about = np.zeros(3) if entry is None or entry.guess_mm is None else np.array(entry.guess_mm, dtype=float)
    centre = about + (target.numbers[0] - normal @ about) * normal
    radius = (entry.radius_mm if entry is not None else 0.0) * np.sqrt(rng.uniform(size=count))
    angle = rng.uniform(-np.pi, np.pi, size=count)
    b1, b2 = basis_across(normal)
    return np.asarray(centre + radius[:, None] * (np.outer(np.cos(angle), b1) + np.outer(np.sin(angle), b2)))


def normals_at(planes: Matrix, nominal: Matrix) -> tuple[Matrix, Matrix]:
    """In numbers the unit normals (W, 3) of `plane_at`, of planes (W, 3) about one stated normal (3,), and
    their derivatives (W, 3, 3) by d, tilt1, tilt2."""
    basis = np.stack(basis_across(nominal))
    tangents = np.tan(planes[:, 1:])
    normals = nominal + tangents @ basis
    length = np.linalg.norm(normals, axis=1)
    normals /= length[:, None]
    turned = basis.T * (1 + tangents**2)[:, None] / length[:, None, None]
    turned -= normals[:, :, None] * (normals[:, None] @ turned)
    return normals, np.concatenate([np.zeros((len(planes), 3, 1)), turned], axis=2)


def patch(target: Matrix, nominal: Matrix, touched: Matrix) -> Matrix:
    """(5, 3) mm the outline of a part of a plane, of d, tilt1, tilt2 (3,) about a stated normal (3,):
    round the feet of points (N, 3) `touched`."""
    normal = normals_at(target[None], nominal)[0][0]
    b1, b2 = basis_across(normal)
    feet = touched + (target[0] - touched @ normal)[:, None] * normal
    along = np.array([feet @ b1, feet @ b2])
    (low1, low2), (high1, high2) = along.min(axis=1) - _ROOM_MM, along.max(axis=1) + _ROOM_MM
    corners = np.array([[low1, low2], [high1, low2], [high1, high2], [low1, high2], [low1, low2]])
    return np.asarray(corners @ np.array([b1, b2]) + target[0] * normal)


def fitted_plane(points: Matrix, nominal: Matrix, offset: float) -> Matrix:
    """(3,) d, tilt1, tilt2 of the plane nearest to points (N, 3) that are `offset` above it, its normal near
    the stated one (3,); what points on a line leave open of it is as stated."""
    mean = points.mean(axis=0)
    _, sizes, directions = np.linalg.svd(points - mean, full_matrices=len(points) < 3)
    sizes = np.append(sizes, np.zeros(3))[:3]
    normal = directions[2] * (np.sign(directions[2] @ nominal) or 1.0)
    if sizes[1] <= _STRAIGHT * sizes[0] or normal @ nominal < _STEEPEST:
        normal = nominal
        if sizes[0] > 0 and sizes[1] <= _STRAIGHT * sizes[0]:
            level = nominal - (nominal @ directions[0]) * directions[0]
            length = float(np.linalg.norm(level))
            normal = level / length if length > _STEEPEST else nominal
    b1, b2 = basis_across(nominal)
    tangents = np.array([normal @ b1, normal @ b2]) / (normal @ nominal)
    return np.array([normal @ mean - offset, *np.arctan(tangents)])


# Points


def sphere_through(points: Matrix, lengths: Matrix, *, zero_free: bool) -> Matrix:
    """(3,) the centre that has `lengths` (N,) to points (N, 3): by least squares that are linear in centre c,
    |c|² and (with `zero_free`) what all lengths are wrong by, then by Gauss-Newton from both sides of the
    points where they are all but in a plane."""
    mean = points.mean(axis=0)
    near = points - mean
    scale = float(np.abs(near).max()) or 1.0
    columns = [2 * near / scale, -np.ones((len(near), 1))]
    if zero_free:
        columns.append(-2 * lengths[:, None] / scale)
    square = (near**2).sum(axis=1) - lengths**2
    centre = np.linalg.lstsq(np.hstack(columns), square / scale, rcond=1e-9)[0][:3]
    _, _, directions = np.linalg.svd(near, full_matrices=True)
    sideways = directions[2] * float(np.median(np.abs(lengths)))
    starts = (centre, centre + sideways, centre - sideways)
    best = min(
        (_climbed(near, lengths, start, zero_free=zero_free) for start in starts), key=lambda fit: fit[0]
    )
    return np.asarray(best[1] + mean)


def _climbed(points: Matrix, lengths: Matrix, centre: Matrix, *, zero_free: bool) -> tuple[float, Matrix]:
    """Sum of squares (mm²) and centre (3,), by Gauss-Newton."""

    def at(centre: Matrix) -> tuple[float, Matrix, Matrix]:
        rays = centre - points
        ranges = np.sqrt((rays**2).sum(axis=1) + _TINY)
        residuals, jacobian = ranges - lengths, rays / ranges[:, None]
        if zero_free:
            residuals, jacobian = residuals - residuals.mean(), jacobian - jacobian.mean(axis=0)
        return float(residuals @ residuals), residuals, jacobian

    cost, residuals, jacobian = at(centre)
    for _ in range(_STEPS):
        step = np.linalg.lstsq(jacobian, -residuals, rcond=1e-9)[0]
        for _ in range(8):
            tried = at(centre + step)
            if tried[0] < cost:
                break
            step = step / 2
        else:
            break
        gained, centre = cost - tried[0], centre + step
        cost, residuals, jacobian = tried
        if gained < 1e-12 * cost:
            break
    return cost, centre


class StatedPlaneProbe(StatedBallTip):
    """A probe on the flange that touches planes."""

    kind: Literal["plane"] = Field(description="this kind of instrument")


@dataclass(frozen=True, eq=False)
class PlaneProbe(BallTipStation):
    """Its residual is how far the ball of `radius` mm is above the plane, along the normal.

    A reading is the stated unit normal of the plane (3,), out of the body.
    """

    name = "plane"
    also_called = ("face", "flat", "datum", "cube", "datum cube")
    target = "plane"
    target_is = "plane"
    reading_size = 3
    Stated: ClassVar[type[FileModel]] = StatedPlaneProbe
    title = "Touches of flat faces"
    mark = "plane"
    words = Words(
        is_="a tip that touches flat faces",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="touch",
        method="a probe on the flange and flat faces in the cell",
        posture="the probe at the face",
        to_do="Move slowly towards the face until the probe touches it, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
        ),
        act="move slowly until the probe touches the face",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        stylus = {"kind": "plane", "tip_mm": list(TIP), "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
        faces = faces_at(target, ("top", "back", "side"))
        return ProposedHeader({"instruments": {"stylus": stylus}, "targets": faces}, 1, turns=True)

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        return plane_coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        return unit_normal(target)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        normal, d = plane_at(target, reading[:3])
        return ca.dot(normal, flange.in_base(self.tip_at(unknowns))) - self.radius - d

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix:
        return points_on(target, rng, count) + self.radius * plane_normal(target)

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        return {"the probe comes from the inside of the face": self.through(poses, plane_normal(target))}

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        return (patch(target, reading[:3], touched),)

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        return fitted_plane(self.tips(poses, unknowns), np.asarray(readings[0, :3]), self.radius)


class StatedSphereProbe(StatedBallTip):
    """A probe on the flange that touches balls."""

    kind: Literal["sphere"] = Field(description="this kind of instrument")


@dataclass(frozen=True, eq=False)
class SphereProbe(BallTipStation):
    """Its residual is how far the tip's ball of `radius` mm is off the target's ball, along their centres.

    A reading is the radius of the target's ball, mm (1,).
    """

    name = "sphere"
    also_called = ("ball", "master ball", "datum ball")
    target = "ball"
    target_is = "point"
    touches_ball = True
    reading_size = 1
    Stated: ClassVar[type[FileModel]] = StatedSphereProbe
    title = "Touches of balls"
    mark = "sphere"
    words = Words(
        is_="a tip that touches balls",
        part="probe tip",
        motion="shift of the probe tip",
        unit="mm",
        reading="touch",
        method="a probe on the flange and balls in the cell",
        posture="the probe at the ball",
        to_do="Move slowly towards the ball until the probe touches it, and write down the joints.",
        fields=(),
        traced=(
            ("Probe, maker and serial number", ("probe", "probe serial", "probe serial number")),
            ("Probe, calibration certificate", ("probe certificate",)),
            ("Ball, calibration certificate", ("ball certificate",)),
        ),
        act="move slowly until the probe touches the ball",
    )

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        stylus = {"kind": "sphere", "tip_mm": list(TIP), "tip_diameter_mm": 6.0, "sigma_mm": 0.02}
        balls = {
            name: {"kind": "sphere", "diameter_mm": 25.4}
            | target_at(np.add(target, whole_point((0.0, side * reach, 0.0))))
            for name, side in (("ball1", -0.15), ("ball2", 0.15))
        }
        return ProposedHeader({"instruments": {"stylus": stylus}, "targets": balls}, 1, turns=True)

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        if target is None or target.diameter_mm is None:
            raise BadInput(
                "a ball without a diameter cannot be used",
                found="no diameter_mm",
                allowed="a number above 0, millimetres",
                remedy="state the target's diameter_mm",
            )
        return super().coordinates(target)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        """What reads no ball has the radius 0."""
        return np.array([0.0 if target is None else (target.diameter_mm or 0.0) / 2])

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return distance(flange.in_base(self.tip_at(unknowns)), target) - self.radius - reading[0]

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix:
        return np.asarray(target.numbers + self._apart(target) * directions(rng, count))

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        outward = self.tips(poses) - target.numbers
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return {"the probe comes through the ball": self.through(poses, outward)}

    def _apart(self, target: Target) -> float:
        """Of the centres of tip and ball, mm."""
        return self.radius + float(self.reading({}, None, target.entry)[0])

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        """Three great circles."""
        angle = np.linspace(0, 2 * np.pi, 25)
        circle = reading[0] * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
        return tuple(target + np.roll(circle, k, axis=1) for k in range(3))

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix:
        return sphere_through(self.tips(poses, unknowns), readings[:, 0] + self.radius, zero_free=False)
