"""A laser tracker, or another instrument that measures the position of reflectors on the flange."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Annotated, ClassVar, Literal, NamedTuple, Self

import casadi as ca
import numpy as np
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..arrays import Index, Mask, Matrix
from ..errors import BadInput
from ..parsing.reading import shown
from ..parsing.validation import (
    FileModel,
    Name,
    NotNegative,
    Positive,
    Vector,
    refusal,
    tuple_of,
    with_length,
)
from .frames import (
    FREE_MM,
    FramedStation,
    StatedStand,
    StationFrame,
    aligned,
    nearest_rotation,
    rotation,
    rotation_vector,
    spread,
    vector_unknowns,
)
from .kind import (
    ON_FLANGE,
    Assumption,
    Flange,
    Misread,
    Point,
    ProposedHeader,
    Target,
    TargetEntry,
    Unknown,
    Words,
    station_at,
)

_STARTS = 12  # rotations of the frame that a start tries where the linear solution is not enough
_STEPS = 60
_SAME = 1e-4  # of an rms: two rotations that end as near have found one solution


class StatedRangeSigma(FileModel):
    """A standard deviation that grows with the range: sqrt(constant² + (per_m · range)²)."""

    constant: Positive = Field(description="close to the instrument, millimetres")
    per_m: NotNegative = Field(description="what each metre of range adds, millimetres")


def _sigma(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, int | float | list | tuple | dict | StatedRangeSigma):
        raise refusal(
            "this is no standard deviation of a position",
            found=shown(value),
            allowed="a number, a list [x, y, z], or the keys constant and per_m",
        )
    if isinstance(value, list | tuple) and any(isinstance(row, list | tuple) for row in value):
        raise refusal(
            "sigma_mm is a matrix",
            found=shown(value),
            allowed="a number, a list [x, y, z], or the keys constant and per_m",
            remedy="state the standard deviations: the roots of a covariance's diagonal",
        )
    return value


def _sigma_tag(value: object) -> str:
    if isinstance(value, list | tuple):
        return "<each>"
    return "<range>" if isinstance(value, dict | StatedRangeSigma) else "<one>"


StatedPositionSigma = Annotated[
    Annotated[
        Annotated[Positive, Tag("<one>")]
        | Annotated[tuple[Positive, Positive, Positive], tuple_of(3, "[x, y, z]"), Tag("<each>")]
        | Annotated[StatedRangeSigma, Tag("<range>")],
        Discriminator(_sigma_tag),
    ],
    BeforeValidator(_sigma),
]


class StatedReflector(FileModel):
    """Where a reflector is on the flange."""

    guess_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="in the flange frame, millimetres")
    sigma_mm: Positive | None = Field(
        default=None,
        description="standard deviation of that, each direction, millimetres; default: only a guess",
    )
    direction: Annotated[Vector, with_length("the direction of a reflector")] | None = Field(
        default=None,
        description="from where it is seen, in the flange frame, any length; absent: it is turned by hand",
    )
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        default=30.0, description="largest angle between the line of sight and that, degrees"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.sigma_mm is not None and "guess_mm" not in self.model_fields_set:
            raise refusal(
                "sigma_mm is stated of a reflector without a position",
                found=f"sigma_mm: {shown(self.sigma_mm)}",
                remedy="add guess_mm, or remove sigma_mm",
            )
        if self.direction is None and "acceptance_deg" in self.model_fields_set:
            raise refusal(
                "acceptance_deg is stated of a reflector without its direction",
                found=f"acceptance_deg: {self.acceptance_deg:g}",
                remedy="add direction, or remove acceptance_deg",
            )
        return self


class StatedTracker(StatedStand):
    """A tracker in the world, and its reflectors on the flange."""

    kind: Literal["tracker"] = Field(description="this kind of instrument")
    sigma_mm: StatedPositionSigma = Field(
        description="of a coordinate, millimetres: a number, [x, y, z], or constant and per_m"
    )
    reflectors: Annotated[dict[Name, StatedReflector], Field(min_length=1)] = Field(
        description="the reflectors on the flange, by name"
    )


class Reflector(NamedTuple):
    """Where a reflector is on the flange, (3,) and std in mm; `tolerated` if that is knowledge. It is seen
    within the angle `acceptance` (rad) of the unit `direction` (3,), if it has one."""

    point: Matrix
    std: float
    tolerated: bool
    direction: Matrix | None
    acceptance: float

    @classmethod
    def of(cls, entry: StatedReflector) -> Self:
        direction = None if entry.direction is None else np.array(entry.direction, dtype=float)
        return cls(
            np.array(entry.guess_mm, dtype=float),
            entry.sigma_mm or FREE_MM,
            entry.sigma_mm is not None,
            None if direction is None else direction / np.linalg.norm(direction),
            float(np.radians(entry.acceptance_deg)),
        )


@dataclass(frozen=True, eq=False)
class Tracker(FramedStation):
    """Its residual is where a reflector is less where it was read, in the tracker's frame, mm.

    `sigmas` (3,) mm of a coordinate at no range, and `per_m` what each metre of range adds in quadrature. A
    reading is the measured position (3,), the relative std that the measurement states or 0, and the relative
    stds (3,).
    """

    name = "tracker"
    also_called = ("laser tracker", "cmm", "reflector", "smr", "total station", "photogrammetry")
    columns: ClassVar[dict[str, int]] = {"measured_mm": 3}
    entered: ClassVar[dict[str, str]] = {"measured_mm": "position of the reflector x, y, z (mm)"}
    headed: ClassVar[dict[str, tuple[str, ...]]] = {"measured_mm": ("x (mm)", "y (mm)", "z (mm)")}
    residual_size = 3
    reading_size = 7
    Stated: ClassVar[type[FileModel]] = StatedTracker
    title = "Laser tracker"
    minutes = 0.3
    mark = "tracker"
    words = Words(
        is_="an instrument that measures the position of reflectors on the flange",
        part="reflector",
        motion="shift of the reflectors",
        unit="mm",
        reading="position",
        method="a tracker in the cell and reflectors on the flange",
        posture="the line of sight to the reflector",
        to_do="Go to the posture, and let the arm settle. Turn the reflector towards the tracker. Measure its"
        " position, and write down the joints.",
        fields=(),
        traced=(
            ("Tracker, maker and serial number", ("tracker", "tracker serial", "tracker serial number")),
            ("Tracker, calibration certificate", ("tracker certificate",)),
            ("Reflector, maker and serial number", ("reflector", "reflector serial")),
        ),
    )

    sigmas: Matrix
    per_m: float
    reflectors: Mapping[str, Reflector]

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader:
        sigma = {"constant": 0.015, "per_m": 0.006}
        tracker = {"kind": "tracker", "sigma_mm": sigma, "guess_mm": station_at(reach)}
        reflectors = {"R1": {"guess_mm": list(ON_FLANGE)}}
        return ProposedHeader({"instruments": {"tracker": tracker | {"reflectors": reflectors}}}, 3)

    @classmethod
    def of(cls, label: str, header: StatedTracker, *, exact: bool) -> Self:
        sigma = header.sigma_mm
        constant, per_m = (
            (sigma.constant, sigma.per_m) if isinstance(sigma, StatedRangeSigma) else (sigma, 0.0)
        )
        return cls(
            label=label,
            frame=StationFrame.of(header.frame),
            stand=None if header.guess_mm is None else np.array(header.guess_mm, dtype=float),
            sigmas=np.broadcast_to(np.array(constant, dtype=float), 3),
            per_m=per_m,
            reflectors={name: Reflector.of(each) for name, each in header.reflectors.items()},
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        parts = (
            vector_unknowns(f"{self.label}.{name}", each.point, each.std, tolerated=each.tolerated)
            for name, each in self.reflectors.items()
        )
        return (*chain.from_iterable(parts), *self.frame_unknowns)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """Besides the frame the reflectors with a stated sigma: without one a reflector is free."""
        key = f"instruments.{self.label}.reflectors.{{}}.sigma_mm"
        reflectors = (
            Assumption(
                self.label,
                f"{self.label}.{name}",
                self.name,
                name,
                each.std,
                "mm",
                stated=True,
                key=key.format(name),
            )
            for name, each in self.reflectors.items()
            if each.tolerated
        )
        return (*super().taken_as_known, *reflectors)

    @property
    def turns(self) -> bool:
        return not any(each.tolerated for each in self.reflectors.values())

    @property
    def key(self) -> bytes:
        numbers = np.array([*self.sigmas, self.per_m])
        return f"{self.name} {list(self.reflectors)} ".encode() + numbers.tobytes() + self.frame_key

    @property
    def std(self) -> float:
        return float(self.sigmas.max())

    @property
    def variants(self) -> tuple[str, ...]:
        return tuple(self.reflectors)

    def with_variants(self, names: Collection[str]) -> Self:
        read = {name: each for name, each in self.reflectors.items() if name in names}
        return replace(self, reflectors=read)

    @property
    def point(self) -> Matrix:
        return next(iter(self.reflectors.values())).point

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        position = np.array(measured.get("measured_mm", (0.0, 0.0, 0.0)), dtype=float)
        stated_std = 0.0 if sigma is None else sigma / self.std
        ranged = np.sqrt(self.sigmas**2 + (self.per_m * np.linalg.norm(position) / 1000) ** 2) / self.std
        return np.array([*position, stated_std, *(ranged if sigma is None else [stated_std] * 3)])

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        return {"measured_mm": tuple((reading[:3] + shift).tolist())}

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        metres = readings.copy()
        metres[:, :3] *= 1000
        ranges = np.linalg.norm(metres[:, :3], axis=1)[:, None]
        ranged = np.sqrt(self.sigmas**2 + (self.per_m * ranges / 1000) ** 2) / self.std
        metres[:, 4:] = np.where(readings[:, 3:4] > 0, readings[:, 4:], ranged)
        yield Misread(self.label, "metres", metres)
        for axis in self.mirrored_axes(free=True):
            mirrored = readings.copy()
            mirrored[:, axis - 1 if axis else 2] *= -1
            yield Misread(self.label, "mirrored", mirrored, axis)

    def _position(self, flange: Flange, unknowns: ca.SX, variant: str) -> ca.SX:
        """(3, 1) mm of a reflector, in the tracker's frame."""
        at = 3 * self._index(variant)
        turn, origin = self.frame_at(unknowns)
        return turn.T @ (flange.in_base(unknowns[at : at + 3]) - origin)

    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        return self._position(flange, unknowns, variant) - reading[:3]

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        position = self._position(flange, unknowns, variant)
        at_range = self.per_m**2 * ca.sumsqr(position) / 1e6
        ranged = ca.sqrt(ca.SX(self.sigmas**2) + at_range) / self.std
        return ca.vertcat(position, reading[3], ca.if_else(reading[3] > 0, reading[3], ranged))

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        return unknowns[:3], ca.SX.zeros(3)

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        reflector, stand = self.reflectors[self.variants[self._index(variant)]], self.in_sight(target)
        if reflector.direction is None or stand is None:
            return {}
        turn = poses[:, :3, :3]
        way = stand - (turn @ reflector.point + poses[:, :3, 3])
        cosine = ((turn @ reflector.direction) * way).sum(axis=1) / np.linalg.norm(way, axis=1)
        return {"the reflector is turned away from the tracker": cosine < np.cos(reflector.acceptance)}

    def on_flange(self, pose: Matrix, unknowns: Matrix, variant: str) -> Matrix:
        at = 3 * self._index(variant)
        return np.asarray(pose[:3, :3] @ unknowns[at : at + 3] + pose[:3, 3])

    def _index(self, variant: str) -> int:
        """Of a reflector; where there is but one, it needs no name."""
        if not variant and len(self.reflectors) == 1:
            return 0
        if variant not in self.reflectors:
            raise BadInput(
                f"{self.label} has no such reflector",
                found=variant or "no reflector",
                allowed=", ".join(self.reflectors),
                remedy="correct the name in the measurement, or add the reflector to the header",
            )
        return self.variants.index(variant)

    def start_unknowns(
        self, poses: Matrix, readings: Matrix, unknowns: Matrix, variants: Sequence[str]
    ) -> Matrix:
        at = spread(len(poses))
        which = np.array([self._index(variants[i]) for i in at], dtype=int)
        free = np.array([not each.tolerated for each in self.reflectors.values()])
        result = np.array(unknowns, dtype=float)
        points = result[: 3 * len(free)].reshape(-1, 3)  # a view
        sets = _Sets(poses[at, :3, :3], poses[at, :3, 3], readings[at, :3], which, points.copy(), free)
        known = self.frame.rotation
        if not self.frame.free:
            points[:] = sets.points_where(sets.measured @ known.T + self.frame.origin)
        elif len(at):
            turn, origin, points[:] = sets.solved()
            result[-6:] = [*origin, *rotation_vector(turn @ known.T)]
        return result


class _Sets(NamedTuple):
    """Of N measurements: rotations (N, 3, 3) and origins (N, 3) of the flange, what was `measured` (N, 3) in
    the tracker's frame, `which` (N,) reflector; its `points` (r, 3), of which some are `free` (r,)."""

    rotations: Matrix
    origins: Matrix
    measured: Matrix
    which: Index
    points: Matrix
    free: Matrix

    def points_where(self, positions: Matrix) -> Matrix:
        """(r, 3) reflectors with the free ones at the mean of their `positions` (N, 3) in the base frame."""
        result = self.points.copy()
        on_flange = np.einsum("nji,nj->ni", self.rotations, positions - self.origins)
        for i in np.flatnonzero(self.free):
            if (self.which == i).any():
                result[i] = on_flange[self.which == i].mean(axis=0)
        return result

    def positions(self, points: Matrix) -> Matrix:
        """(N, 3) of the reflectors in the base frame."""
        return np.asarray(self.origins + np.einsum("nij,nj->ni", self.rotations, points[self.which]))

    def solved(self) -> tuple[Matrix, Matrix, Matrix]:
        """Rotation and origin of the frame, and the reflectors, of least squares: from the linear solution
        with any matrix for the rotation, and where that is no good from several rotations, until two lead to
        the same."""
        size = float(np.ptp(self.measured, axis=0).max()) or 1.0
        best = None
        for turn in self._turns():
            fit = self._climbed(turn)
            again = best is not None and abs(fit[0] - best[0]) < _SAME * best[0]
            if best is None or fit[0] < best[0]:
                best = fit
            if again or best[0] < 0.01 * size:
                break
        assert best is not None
        return best[1:]

    def _turns(self) -> Iterator[Matrix]:
        yield self._linear()
        yield aligned(self.positions(self.points), self.measured)[0]
        random = np.random.default_rng(0)
        for _ in range(_STARTS):
            yield nearest_rotation(random.normal(size=(3, 3)))

    def _columns(self) -> Matrix:
        """(3 N, 3 f) of the f free reflectors: what a mm of each moves in the base frame."""
        of = np.flatnonzero(self.free)
        on = (self.which[:, None] == of).astype(float)
        moved = np.einsum("nij,nk->nikj", self.rotations, on)
        return np.asarray(moved.reshape(3 * len(on), 3 * len(of)))

    def _linear(self) -> Matrix:
        """(3, 3) from A m + f = R (g + x) + t by least squares in A (any matrix), f and x."""
        measured = self.measured - self.measured.mean(axis=0)
        scale = float(np.abs(measured).max()) or 1.0
        count = len(measured)
        of_matrix = np.einsum("nj,ik->nikj", measured / scale, np.eye(3)).reshape(3 * count, 9)
        system = np.hstack([of_matrix, np.tile(np.eye(3), (count, 1)), -self._columns()])
        solution = np.linalg.lstsq(system, self.positions(self.points).ravel(), rcond=1e-9)[0]
        return nearest_rotation(solution[:9].reshape(3, 3))

    def _climbed(self, turn: Matrix) -> tuple[float, Matrix, Matrix, Matrix]:
        """Root mean square (mm), rotation, origin and reflectors, by Gauss-Newton from a rotation."""
        count, moved = len(self.measured), self._columns()
        linear = np.hstack([np.tile(np.eye(3), (count, 1)), -moved])
        nominal = self.positions(self.points)

        def at(turn: Matrix) -> tuple[float, Matrix, Matrix]:
            """The rms, residuals (3 N,) and solution of the linear unknowns, at a rotation."""
            right = (nominal - self.measured @ turn.T).ravel()
            solution = np.linalg.lstsq(linear, right, rcond=1e-9)[0]
            residuals = linear @ solution - right
            return float(np.sqrt(np.mean(residuals**2) * 3)), residuals, np.asarray(solution)

        rms, residuals, solution = at(turn)
        for _ in range(_STEPS):
            x, y, z = (self.measured @ turn.T).T
            o = np.zeros(count)
            cross = np.array([[o, z, -y], [-z, o, x], [y, -x, o]]).transpose(2, 0, 1).reshape(-1, 3)
            step = np.linalg.lstsq(np.hstack([cross, linear]), -residuals, rcond=1e-9)[0][:3]
            step *= min(1.0, 1.0 / (np.linalg.norm(step) or 1.0))
            for _ in range(8):
                other = rotation(step) @ turn
                tried = at(other)
                if tried[0] < rms:
                    break
                step = step / 2
            else:
                break
            gained = rms - tried[0]
            turn, (rms, residuals, solution) = other, tried
            if gained < 1e-9 * rms:
                break
        points = self.points.copy()
        points[self.free] += solution[3:].reshape(-1, 3)
        return rms, turn, np.asarray(solution[:3]), points
