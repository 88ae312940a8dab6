"""What a tracker and a pose have in common: a frame of their own in the world, free or known; and rotations,
as symbols and as numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal, NamedTuple, Self

import casadi as ca
import numpy as np
from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag, model_validator

from ..arrays import Matrix
from ..errors import BadInput
from ..parsing.reading import shown
from ..parsing.validation import FileModel, Positive, Vector, refusal, tuple_of
from .kind import Assumption, Station, Target, Unknown

# Below these squares a power series takes the place of a quotient that is 0/0 at zero. Its first term left
# out is below 1e-16.
_SMALL_ANGLE = 1e-2
_SMALL_SINE = 1e-3
_LENGTH = 0.01  # how far the length of a quaternion may be from 1: its digits are few
_ALLOWED = "[w, x, y, z] of length 1, such as [1, 0, 0, 0]"


def _of_length_1(value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    if not abs(np.linalg.norm(value) - 1) <= _LENGTH:
        raise refusal(
            "a quaternion is not of length 1",
            found=f"{shown(value)}, of length {np.linalg.norm(value):.4g}",
            allowed=_ALLOWED,
            remedy="correct the quaternion; w comes first",
        )
    return value


Quaternion = Annotated[
    tuple[float, float, float, float], AfterValidator(_of_length_1), tuple_of(4, "[w, x, y, z]")
]


def unit_quaternion(quaternion: Sequence[float]) -> Matrix:
    """(4,) of length 1; BadInput for what is far from that."""
    result = np.array(quaternion, dtype=float)
    length = float(np.linalg.norm(result))
    if result.shape != (4,) or not abs(length - 1) <= _LENGTH:
        raise BadInput(
            "a quaternion is not of length 1",
            found=f"{shown(list(quaternion))}, of length {length:.4g}",
            allowed=_ALLOWED,
            remedy="correct the quaternion; w comes first",
        )
    return np.asarray(result / length)


# Symbols


def turned(vector: ca.SX) -> ca.SX:
    """(3, 3) of a rotation vector (3, 1) (Rodrigues)."""
    square = ca.sumsqr(vector)
    small = square < _SMALL_ANGLE
    # The branch not taken must not divide by zero either: its derivative is multiplied by 0, and is NaN else.
    angle = ca.sqrt(ca.if_else(small, 1.0, square))
    sine = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine = (1 - square / 12 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90)))) / 2
    a = ca.if_else(small, sine, ca.sin(angle) / angle)
    b = ca.if_else(small, cosine, 2 * (ca.sin(angle / 2) / angle) ** 2)
    cross = ca.skew(vector)
    return ca.SX.eye(3) + a * cross + b * (cross @ cross)


def matrix_of(q: ca.SX) -> ca.SX:
    """(3, 3) of a unit quaternion (4, 1)."""
    w, vector = q[0], q[1:]
    cross = ca.skew(vector)
    return ca.SX.eye(3) + 2 * w * cross + 2 * (cross @ cross)


def quaternion_of(m: ca.SX) -> ca.SX:
    """(4, 1) of a rotation matrix (3, 3), w ≥ 0: from its largest component (Shepperd), so never 0/0."""
    columns = [
        ca.vertcat(1 + m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]),
        ca.vertcat(m[2, 1] - m[1, 2], 1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]),
        ca.vertcat(m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 1 - m[0, 0] + m[1, 1] - m[2, 2], m[1, 2] + m[2, 1]),
        ca.vertcat(m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 1 - m[0, 0] - m[1, 1] + m[2, 2]),
    ]
    result, largest = columns[0], columns[0][0]
    for i in (1, 2, 3):
        larger = columns[i][i] > largest
        result = ca.if_else(larger, columns[i], result)
        largest = ca.fmax(largest, columns[i][i])
    return result / ca.sqrt(ca.sumsqr(result)) * ca.if_else(result[0] < 0, -1, 1)


def vector_of(m: ca.SX) -> ca.SX:
    """(3, 1) rotation vector of a rotation matrix (3, 3), up to 180°."""
    q = quaternion_of(m)
    square = ca.sumsqr(q[1:])
    small = square < _SMALL_SINE
    sine = ca.sqrt(ca.if_else(small, 1.0, square))
    series = 2 * (1 + square * (1 / 6 + square * (3 / 40 + square * (15 / 336 + square * 105 / 3456))))
    return ca.if_else(small, series, 2 * ca.atan2(sine, q[0]) / sine) * q[1:]


def across(n: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Unit b1, b2 (3, 1) across a unit vector (3, 1), the three right-handed (Duff et al. 2017)."""
    sign = ca.if_else(n[2] < 0, -1, 1)
    a = -1 / (sign + n[2])
    b = n[0] * n[1] * a
    b1 = ca.vertcat(1 + sign * n[0] ** 2 * a, sign * b, -sign * n[0])
    return b1, ca.vertcat(b, sign + n[1] ** 2 * a, -n[1])


# Numbers


def _function(of: object, rows: int, columns: int = 1) -> ca.Function:
    symbol = ca.SX.sym("x", rows, columns)
    result = of(symbol)  # type: ignore[operator]
    return ca.Function("f", [symbol], list(result) if isinstance(result, tuple) else [result])


_TURNED = _function(turned, 3)
_MATRIX = _function(matrix_of, 4)
_QUATERNION = _function(quaternion_of, 3, 3)
_VECTOR = _function(vector_of, 3, 3)
_ACROSS = _function(across, 3)


def rotation(vector: Matrix) -> Matrix:
    """(3, 3) of a rotation vector (3,)."""
    return np.asarray(_TURNED(vector).full())


def rotation_vector(turn: Matrix) -> Matrix:
    """(3,) of a rotation matrix (3, 3)."""
    return np.asarray(_VECTOR(turn).full()[:, 0])


def rotation_of_quaternion(q: Sequence[float] | Matrix) -> Matrix:
    """(3, 3) of a unit quaternion (4,)."""
    return np.asarray(_MATRIX(np.asarray(q, dtype=float)).full())


def quaternion(turn: Matrix) -> Matrix:
    """(4,) of a rotation matrix (3, 3), w ≥ 0."""
    return np.asarray(_QUATERNION(turn).full()[:, 0])


def basis_across(n: Matrix) -> tuple[Matrix, Matrix]:
    """`across`, of numbers: (3,) each."""
    b1, b2 = _ACROSS(n)
    return np.asarray(b1.full()[:, 0]), np.asarray(b2.full()[:, 0])


def nearest_rotation(matrix: Matrix) -> Matrix:
    """(3, 3) the rotation nearest to any matrix, by its singular vectors."""
    u, _, v = np.linalg.svd(matrix)
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v)


def aligned(points: Matrix, others: Matrix) -> tuple[Matrix, Matrix]:
    """R (3, 3) and t (3,) that bring `others` (N, 3) nearest to `points` (N, 3): R o + t = p (Kabsch)."""
    mean, other_mean = points.mean(axis=0), others.mean(axis=0)
    turn = nearest_rotation((points - mean).T @ (others - other_mean))
    return turn, mean - turn @ other_mean


FREE_MM, FREE_RAD = 500.0, float(np.pi)  # prior stds of what the flange carries where nothing is stated
_FRAME_MM = 10_000.0
_MOST = 200  # measurements that a start is solved from
_STANDS_MM = (3000.0, 0.0, 500.0)  # where an instrument stands of which nobody says
_PLACED_MM, _LEVEL = 100.0, float(np.radians(0.5))  # stds of where one stands, and of its level, by chance
_UNITS: tuple[Literal["deg", "mm"], ...] = ("deg", "mm")


class StatedKnownFrame(FileModel):
    """Where an instrument's frame is in the base frame."""

    xyz_mm: Vector = Field(description="origin of the instrument's frame in the base frame, millimetres")
    quat: Quaternion = Field(description="its orientation: a unit quaternion [w, x, y, z]")
    sigma_mm: Positive | None = Field(
        default=None,
        description="standard deviation of each coordinate of its origin, millimetres; with sigma_deg;"
        " without both it is taken as exact",
    )
    sigma_deg: Positive | None = Field(
        default=None, description="standard deviation of its rotation about each axis, degrees"
    )

    @model_validator(mode="after")
    def _both_or_none(self) -> Self:
        if (self.sigma_mm is None) != (self.sigma_deg is None):
            absent = "sigma_mm" if self.sigma_mm is None else "sigma_deg"
            raise refusal(
                f"{absent} is missing: how well a frame is known is said of its origin and of its rotation",
                allowed="both, or neither of a frame that is taken as exact",
                remedy=f"add {absent}",
            )
        return self


def _frame(value: object) -> object:
    parts = value if isinstance(value, dict | list | tuple) else ()
    if "free" in parts and len(parts) > 1:
        raise refusal(
            "an instrument's frame is both free and known",
            found=shown(value),
            allowed="free, or the keys xyz_mm and quat",
            remedy="state frame: free to have it estimated, or where it is without the word free",
        )
    if value != "free" and not isinstance(value, dict | StatedKnownFrame):
        raise refusal(
            "this says nothing of the instrument's frame",
            found=shown(value),
            allowed="free, or the keys xyz_mm and quat",
            remedy="state frame: free where nobody has measured it",
        )
    return value


StatedFrame = Annotated[
    Annotated[
        Annotated[Literal["free"], Tag("<free>")] | Annotated[StatedKnownFrame, Tag("<known>")],
        Discriminator(lambda value: "<free>" if value == "free" else "<known>"),
    ],
    BeforeValidator(_frame),
]


class StationFrame(NamedTuple):
    """A frame in the base frame: `rotation` (3, 3) and `origin` (3,) mm, and the prior stds of both, mm and
    rad, which are `stated`; or nothing but a wide prior (`free`), or nothing at all (`exact`)."""

    rotation: Matrix
    origin: Matrix
    std_mm: float
    std_rad: float
    known: Literal["exact", "stated", "free"]

    @classmethod
    def of(cls, frame: Literal["free"] | StatedKnownFrame) -> StationFrame:
        if not isinstance(frame, StatedKnownFrame):
            return cls(np.eye(3), np.zeros(3), _FRAME_MM, FREE_RAD, "free")
        rotation = rotation_of_quaternion(unit_quaternion(frame.quat))
        origin = np.array(frame.xyz_mm, dtype=float)
        if frame.sigma_mm is None or frame.sigma_deg is None:
            return cls(rotation, origin, 0.0, 0.0, "exact")
        return cls(rotation, origin, frame.sigma_mm, float(np.radians(frame.sigma_deg)), "stated")

    @property
    def free(self) -> bool:
        return self.known == "free"

    @property
    def exact(self) -> bool:
        return self.known == "exact"


def vector_unknowns(of: str, mean: Matrix, std: float, *, tolerated: bool) -> tuple[Unknown, ...]:
    """x, y, z of what the flange carries, mm."""
    axes = zip("xyz", mean.tolist(), strict=True)
    return tuple(Unknown(axis, "mm", value, std, of, tolerated=tolerated) for axis, value in axes)


class StatedStand(FileModel):
    """Where an instrument with a frame of its own stands."""

    frame: StatedFrame = Field(default="free", description="free, or where its frame is in the base frame")
    guess_mm: Vector | None = Field(
        default=None,
        description="approximate position of an instrument with a free frame, base frame, millimetres: for"
        " plans, which keep the line of sight free",
    )

    @model_validator(mode="after")
    def _free_or_known(self) -> Self:
        if self.guess_mm is not None and self.frame != "free":
            raise refusal(
                "guess_mm is stated of an instrument whose frame is known",
                key=("guess_mm",),
                found=f"guess_mm: {shown(self.guess_mm)}",
                remedy="remove it, or state frame: free",
            )
        return self


@dataclass(frozen=True, eq=False)
class FramedStation(Station):
    """It reads positions in its own `frame`, wherever the arm stands; `stand` (3,) mm about where the origin
    of a free one is, or None."""

    target = "target"
    target_is = "nothing"
    met = False

    frame: StationFrame
    stand: Matrix | None

    @property
    def grounded(self) -> bool:
        return not self.frame.free

    @property
    def varies(self) -> bool:
        return True

    @property
    def frame_unknowns(self) -> tuple[Unknown, ...]:
        """Origin, and rotation vector from the orientation of `frame`, both in the base frame."""
        frame = self.frame
        if frame.exact:
            return ()
        tolerated = not frame.free
        lengths = (
            Unknown(axis, "mm", mean, frame.std_mm, self.label, "frame", tolerated=tolerated)
            for axis, mean in zip("xyz", frame.origin.tolist(), strict=True)
        )
        angles = (
            Unknown(axis, "deg", 0.0, frame.std_rad, self.label, "frame", tolerated=tolerated)
            for axis in ("rx", "ry", "rz")
        )
        return (*lengths, *angles)

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """Where its frame is: of an exact one nobody states how well that is known."""
        frame = self.frame
        if frame.free:
            return ()
        stds = {"deg": float(np.degrees(frame.std_rad)), "mm": frame.std_mm}
        key = f"instruments.{self.label}.frame"
        return tuple(
            Assumption(
                label=self.label,
                of=self.label,
                kind=self.name,
                part="frame",
                std=None if frame.exact else stds[unit],
                unit=unit,
                stated=not frame.exact,
                key=f"{key}.sigma_{unit}",
            )
            for unit in _UNITS
        )

    def freed(self) -> tuple[Self, Mapping[str, float]]:
        """With a free frame in place of an exact one, which is where it was known to be."""
        if not self.frame.exact:
            return self, {}
        frame = self.frame._replace(std_mm=_FRAME_MM, std_rad=FREE_RAD, known="free")
        free = replace(self, frame=frame)
        return free, {f"{unknown.of}.{unknown.axis}": unknown.mean for unknown in free.frame_unknowns}

    def frame_at(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Rotation (3, 3) and origin (3, 1) mm of the instrument's frame in the base frame."""
        rotation, origin = ca.SX(self.frame.rotation), ca.SX(self.frame.origin)
        if self.frame.exact:
            return rotation, origin
        last = unknowns[len(self.unknowns) - 6 :]
        return ca.mtimes(turned(last[3:]), rotation), last[:3]

    def sight(self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str) -> Matrix:
        """To where the instrument is."""
        origin = self.frame.origin if self.frame.exact else unknowns[-6:-3]
        return np.array([self.on_flange(pose, unknowns, variant), origin])

    @property
    def stands_at(self) -> Matrix:
        """Where its frame is stated to be; of a free one upright, and turned as the base frame."""
        if self.frame.exact:
            return np.zeros(0)
        stand = _STANDS_MM if self.stand is None else self.stand
        return np.array([*(stand if self.frame.free else self.frame.origin), 0.0, 0.0, 0.0])

    def in_sight(self, target: Target) -> Matrix | None:
        return self.stand if self.frame.free else self.frame.origin

    def placed(self, rng: np.random.Generator) -> Matrix:
        """Within what is stated; of a free one turned anyhow about the vertical."""
        frame = self.frame
        if frame.exact:
            return np.zeros(0)
        if not frame.free:
            return np.concatenate(
                [frame.origin + frame.std_mm * rng.normal(size=3), frame.std_rad * rng.normal(size=3)]
            )
        origin = self.stands_at[:3] + _PLACED_MM * rng.normal(size=3)
        upright = rotation(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
        turn = rotation(_LEVEL * rng.normal(size=3)) @ upright
        return np.concatenate([origin, rotation_vector(turn @ frame.rotation.T)])

    def mirrored_axes(self, *, free: bool) -> tuple[int, ...]:
        """Which axes (1, 2, 3) may have the wrong sign; (0,) where a `free` frame makes them one."""
        return (0,) if free and self.frame.free else (1, 2, 3)

    @property
    def frame_key(self) -> bytes:
        """Of an exact frame the origin is in the functions, too."""
        rotation = self.frame.rotation.tobytes()
        return rotation + self.frame.origin.tobytes() if self.frame.exact else b"free" + rotation


def spread(count: int) -> Matrix:
    """Indices of at most 200 of the measurements, evenly spread: enough for a start."""
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).astype(int))
