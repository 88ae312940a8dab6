"""What every kind of instrument says of itself: its unknowns, its reading, its words; and what a new
calibration states of one that nobody has set up yet: lengths grow with the arm's reach, nothing is taken as
calibrated that nobody has calibrated.

A kind is a class, an instrument one of its instances with the numbers that a header states. Nothing outside
a kind's own file asks which kind it is: it asks for the facts below.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, Self

import casadi as ca
import numpy as np

from ..arrays import Index, Mask, Matrix
from ..parsing.validation import FileModel

Point = tuple[float, float, float]
Keys = dict[str, object]  # of a header, or a part of it

TARGET_SIGMA_MM = 30.0  # how well a person states where a target is
TARGET_OUT = 0.6  # of the reach: where a target stands in front of the arm
ON_FLANGE: Point = (60.0, 0.0, 60.0)  # off the last axis, so that the last joint moves it
TIP: Point = (60.0, 0.0, 120.0)
ON_THE_FLANGE = ("point_mm", "tip_mm", "direction")  # keys that say how an instrument is mounted there
_STATION_OUT = 2.2  # of the reach: where an instrument stands that looks at the flange
_NORMALS: Mapping[str, tuple[Point, Point]] = {  # of the faces of a block, and where each is on it
    "top": ((0.0, 0.0, 1.0), (0.0, 0.0, 50.0)),
    "back": ((-1.0, 0.0, 0.0), (-50.0, 0.0, 0.0)),
    "side": ((0.0, -1.0, 0.0), (0.0, -50.0, 0.0)),
}


class ProposedHeader(NamedTuple):
    """The keys of a `header` that state the instrument and its targets. One that `turns` with the last joint
    is not calibrated: the sum of both alone is determined. A measurement reads so many `numbers`."""

    header: Keys
    numbers: int
    turns: bool = False


def whole_point(point: Sequence[float] | Matrix) -> Point:
    """A point to the millimetre, as a person states it."""
    x, y, z = (round(float(number)) + 0.0 for number in point)
    return x, y, z


def target_at(point: Sequence[float] | Matrix) -> Keys:
    """What is stated of a target about there, to the micrometre: decimals that a person states are kept."""
    return {"guess_mm": [round(float(number), 3) + 0.0 for number in point], "sigma_mm": TARGET_SIGMA_MM}


def station_at(reach: float) -> list[float]:
    """Where an instrument stands that looks at the flange."""
    return list(whole_point((_STATION_OUT * reach, 0.35 * reach, 0.5 * reach)))


def faces_at(target: Point, names: Sequence[str]) -> dict[str, Keys]:
    """Faces of a block, by name."""
    faces = {}
    for name in names:
        normal, offset = _NORMALS[name]
        faces[name] = {"kind": "plane", "normal": list(normal)} | target_at(np.add(target, offset))
    return faces


TargetKind = Literal["point", "plane", "sphere"]
POINT: TargetKind = "point"
# How a target, or an instrument in the world, is drawn.
Mark = Literal["psd", "tracker", "plane", "sphere", "ballbar", "dial", "pose", "point"]
# What a header states of a target of each kind besides its position, and what a person calls that; empty
# where it has a default.
TARGET_KEYS: dict[TargetKind, dict[str, str]] = {
    "point": {},
    "plane": {"normal": "normal", "sigma_deg": "", "radius_mm": ""},
    "sphere": {"diameter_mm": "diameter"},
}


class TargetEntry(Protocol):
    """What a header states of a target (`model.files.header`)."""

    @property
    def guess_mm(self) -> tuple[float, float, float] | None: ...
    @property
    def sigma_mm(self) -> float: ...
    @property
    def sigma_deg(self) -> float: ...
    @property
    def normal(self) -> tuple[float, float, float] | None: ...
    @property
    def diameter_mm(self) -> float | None: ...
    @property
    def radius_mm(self) -> float: ...


class StatedInstrument(Protocol):
    """What a header states of an instrument, by the model of its kind."""

    @property
    def kind(self) -> str: ...
    @property
    def model_fields_set(self) -> set[str]: ...


class Unknown(NamedTuple):
    """An unknown of an instrument: what it belongs to and which number of that it is, its unit, and its
    prior's mean and std, rad or mm. A `tolerated` prior is knowledge; that of a guess is not.

    The group is `frame` where it says where a station of the world is, else `tool`. `assumed` where nobody
    stated the prior of a tolerated one.
    """

    axis: str
    unit: Literal["deg", "mm"]
    mean: float
    std: float
    of: str = "tool"
    group: Literal["tool", "frame"] = "tool"
    tolerated: bool = False
    assumed: bool = False


class Assumption(NamedTuple):
    """What the program takes as known of an instrument (its `label`, its `kind`).

    The `part` (mounting, tip, frame, mount, or the name of a reflector) deviates by the standard deviation
    `std` in its `unit`, or not at all (None). Its unknowns, if there are any, belong to `of`. `stated` where
    the header says how well it is known, by its `key`.
    """

    label: str
    of: str
    kind: str
    part: str
    std: float | None
    unit: Literal["deg", "mm"]
    stated: bool
    key: str


@dataclass(frozen=True)
class Flange:
    """The flange in the base frame: `rotation` (3, 3) and `translation` (3, 1) mm, as symbols."""

    rotation: ca.SX
    translation: ca.SX

    def in_flange(self, point: ca.SX) -> ca.SX:
        """A point (3, 1) of the base frame, in the flange frame."""
        return self.rotation.T @ (point - self.translation)

    def in_base(self, point: ca.SX) -> ca.SX:
        """A point (3, 1) of the flange frame, in the base frame."""
        return self.translation + self.rotation @ point


@dataclass(frozen=True)
class Words:
    """How a reader is told of a kind.

    `part` is what may lie on the axis of a joint, `motion` what of it a rotation of the last joint is
    equivalent to (in `unit`); `reading` the source of its reading's noise, `method` what a certificate says
    was measured with, `posture` what is drawn at a posture besides the arm, `to_do` what an operator does
    there, `fields` what else is written down, `act` the same as `to_do` in a clause; `traced` the instruments
    that a certificate names: for each entry the keys of a run's provenance.
    """

    is_: str
    part: str
    motion: str
    unit: Literal["deg", "mm"]
    reading: str
    method: str
    posture: str
    to_do: str
    fields: tuple[str, ...]
    traced: tuple[tuple[str, tuple[str, ...]], ...]
    act: str = "measure"


class Measurement(NamedTuple):
    """A measurement for a calculation: the label of its instrument, which of its variants, its target, if it
    has one, and what was `measured` by column (quaternions of length 1; nothing of a planned one); `sigma_mm`
    if it states its own. `posture` is a number that those of one posture share."""

    instrument: str
    variant: str
    target: str | None
    measured: Mapping[str, Sequence[float]]
    sigma_mm: float | None = None
    posture: int = 0


class PartRead(NamedTuple):
    """What of a run reads at a posture: an instrument, its variant, the places of its unknowns among all,
    its own numbers of the reading (w,), and where its components are in a residual."""

    instrument: Instrument
    variant: str
    unknowns: list[int]
    reading: Matrix
    rows: slice


class Misread(NamedTuple):
    """What may be wrong with all readings of the instrument `label`: they are in `metres`, or `mirrored`, in
    a left-handed frame; of poses the `quaternion` has w last, the rotation is the `inverse`, or the whole
    pose is (`inverse_pose`: that of the instrument as the body sees it). `readings` (N, w) are put right;
    `axis` (1, 2, 3) is the one that has the wrong sign, 0 where any may be, as a rotation of a free frame
    makes one of another."""

    label: str
    wrong: Literal["metres", "mirrored", "quaternion", "inverse", "inverse_pose"]
    readings: Matrix
    axis: int = 0


class ReadingNoise(NamedTuple):
    """A noise of the readings of the instrument `label` that has a factor of its own: `name` is what that
    factor is called, and `std` the standard deviation, mm or rad by its `unit` (None: `noise.spot_mm`)."""

    label: str
    name: str
    std: float | None
    unit: Literal["deg", "mm"] = "mm"


class ResidualLayout(NamedTuple):
    """Of each component (d,) of a residual: the number of a reading that is its relative standard deviation
    (-1: it has that of the instrument), the number that is 1 where it was read at all and else 0 (-1:
    always), the index of the instrument that it comes from, and that of its noise among those of all."""

    relative: Index
    active: Index
    source: Index
    noise: Index


class Target(NamedTuple):
    """A target as a plan has it: its three `numbers` (3,) among the unknowns, and what the header says of
    it."""

    numbers: Matrix
    entry: TargetEntry | None


@dataclass(frozen=True, eq=False)
class Instrument(ABC):
    """An instrument as a header states it, under `label`: the name by which measurements call it.

    Of the kind: `name` is the header's `kind`, `also_called` what else people call it; `columns` are the
    readings that a measurement records, by their key, and how many numbers each has; `residual_size` is the
    number d of components of a residual, mm or rad. `target` is what a target is called where nobody names
    it, and `target_is` what stands in the world: a point or a plane with three unknowns, or nothing.

    It either reads wherever the arm stands, or is `met`: then a measurement is taken where its residual is
    zero, and the joints are turned until it is. A `beam` has a direction and a length, and is steered by the
    wrist onto a detector; what is none has all joints to meet its target. `entered` says in words what a
    person reads off for each of the columns, `headed` over which columns of a sheet, one a number, it is
    written. `title` is what a person chooses it by, `minutes` what a measurement takes them, `mark` the shape
    by which its target is drawn, or the instrument itself where it has none. Where a free one `turns` about
    the last axis as that joint does, the last offset is held. One is `grounded` that knows where the base is:
    then the first offset is determined.
    """

    name: ClassVar[str]
    also_called: ClassVar[tuple[str, ...]]
    columns: ClassVar[Mapping[str, int]]
    target: ClassVar[str]
    target_is: ClassVar[Literal["point", "plane", "nothing"]]
    touches_ball: ClassVar[bool] = False
    met: ClassVar[bool]
    beam: ClassVar[bool] = False
    entered: ClassVar[Mapping[str, str]] = {}
    headed: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    title: ClassVar[str] = ""
    minutes: ClassVar[float] = 1.0
    mark: ClassVar[Mark] = "point"
    words: ClassVar[Words]

    label: str

    @classmethod
    def target_kinds(cls) -> tuple[TargetKind, ...]:
        """What a header may state of its targets."""
        if cls.target_is == "nothing":
            return ()
        return ("sphere",) if cls.touches_ball else (cls.target_is,)

    @classmethod
    def proposed(cls, reach: float, target: Point) -> ProposedHeader | None:
        """What a new calibration states of it at an arm of that reach, mm, with a target in the base frame;
        None where there is no default."""
        return None

    @classmethod
    def read_off(cls) -> Mapping[str, int]:
        """The columns that a person enters besides the joints, in their order: none where the arm is led to
        the target."""
        return {} if cls.met else cls.columns

    @classmethod
    def heads(cls) -> tuple[str, ...]:
        """Over each number of `read_off` on a sheet."""
        return tuple(
            head
            for key, size in cls.read_off().items()
            for head in cls.headed.get(key) or (f"{key} {k}" for k in range(1, size + 1))
        )

    @classmethod
    @abstractmethod
    def of(cls, label: str, entry: Any, *, exact: bool) -> Self:
        """As a header states it by `Stated`; with `exact`, what has no stated sigma is as it is stated."""

    @property
    @abstractmethod
    def residual_size(self) -> int: ...

    @property
    @abstractmethod
    def unknowns(self) -> tuple[Unknown, ...]:
        """The k that are estimated: first those of the tool, then those of the frame."""

    @property
    def calibrated(self) -> bool:
        """Whether what the flange carries is known to its tolerances."""
        return all(unknown.tolerated for unknown in self.unknowns if unknown.group == "tool")

    @property
    def taken_as_known(self) -> tuple[Assumption, ...]:
        """What is known of the tool or the frame only because somebody stated it, or because it is
        assumed."""
        return ()

    def freed(self) -> tuple[Instrument, Mapping[str, float]]:
        """The same as an instrument whose mounting, tip or frame may be anything, and the values of the
        unknowns by name that it has besides: what `taken_as_known` does not stand for any more is judged with
        it."""
        return self, {}

    @property
    def exact(self) -> bool:
        """Whether it is as stated, and no part of it is estimated."""
        return not self.unknowns

    @property
    def turns(self) -> bool:
        return False

    @property
    def grounded(self) -> bool:
        return False

    @property
    @abstractmethod
    def key(self) -> bytes:
        """The same for all whose functions are the same."""

    @property
    def known_to(self) -> float:
        """Prior std, in the unit of `words`, of what a rotation of the last joint is equivalent to."""
        stds = [unknown.std for unknown in self.unknowns if unknown.group == "tool"]
        return max(stds, default=0.0)

    def coordinates(self, target: TargetEntry | None) -> tuple[Unknown, Unknown, Unknown]:
        """The three unknowns of a target, of which a header states something or nothing."""
        guess = (0.0, 0.0, 0.0) if target is None or target.guess_mm is None else target.guess_mm
        std = 10_000.0 if target is None else target.sigma_mm
        x, y, z = (Unknown(axis, "mm", mean, std) for axis, mean in zip("xyz", guess, strict=True))
        return x, y, z

    # The reading

    @property
    def std(self) -> float | None:
        """Standard deviation of a reading, mm, where the instrument states it; else it is `noise.spot_mm`."""
        return None

    @property
    def noises(self) -> tuple[ReadingNoise, ...]:
        """The noises of its readings, of which each is stated and may be wrong by itself."""
        return (ReadingNoise(self.label, "spot" if self.std is None else self.label, self.std),)

    @property
    def variants(self) -> tuple[str, ...]:
        """What it may read at a posture, by name: its reflectors. One without a name where there is no
        choice."""
        return ("",)

    def with_variants(self, names: Collection[str]) -> Self:
        """The same with those variants alone: what is never read is no unknown."""
        return self

    @property
    def reading_size(self) -> int:
        """w: how many numbers a reading is to `residual`; 0 where the residual less its shift is all."""
        return 0

    @property
    def varies(self) -> bool:
        """Whether the last d numbers of a reading are the relative standard deviations of its residual."""
        return False

    @cached_property
    def layout(self) -> ResidualLayout:
        d, w = self.residual_size, self.reading_size
        none = np.full(d, -1, dtype=np.int64)
        relative = np.arange(w - d, w, dtype=np.int64) if self.varies else none
        first = np.zeros(d, dtype=np.int64)
        return ResidualLayout(relative, none, first, first)

    @property
    def lengths(self) -> list[list[int]]:
        """The components of a residual that are lengths, mm, part by part; others are angles."""
        return [list(range(min(self.residual_size, 3)))]

    @property
    def each(self) -> tuple[Instrument, ...]:
        """The instruments that it is made of."""
        return (self,)

    def reading(
        self, measured: Mapping[str, Sequence[float]], sigma: float | None, target: TargetEntry | None
    ) -> Matrix:
        """(w,) of what a measurement records by `columns` and a header states of its target; `sigma` (mm) if
        the measurement states its own. Of a planned one nothing is `measured`: zeros take its place."""
        return np.zeros(0)

    def shift(self, measured: Mapping[str, Sequence[float]]) -> Matrix:
        """(d,) what the residual of a measurement is less: a spot that was read beside the centre."""
        return np.zeros(self.residual_size)

    def recorded(self, reading: Matrix, shift: Matrix) -> dict[str, tuple[float, ...]]:
        """What a measurement with this `reading` (w,) and `shift` (d,) records by `columns`."""
        return {}

    def row(self, some: Sequence[Measurement], target: TargetEntry | None) -> tuple[Matrix, Matrix]:
        """Reading (w,) and shift (d,) of what is measured at one posture."""
        (item,) = some
        return self.reading(item.measured, item.sigma_mm, target), self.shift(item.measured)

    def misread(self, readings: Matrix) -> Iterator[Misread]:
        """What may be wrong with all `readings` (N, w)."""
        return iter(())

    @abstractmethod
    def residual(self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str) -> ca.SX:
        """(d, 1) what is predicted less what was read: of a `target` (3, 1), at `unknowns` (k, 1)."""

    def predicted(
        self, flange: Flange, target: ca.SX, unknowns: ca.SX, reading: ca.SX, variant: str
    ) -> ca.SX:
        """(w, 1) the reading that leaves no residual: `reading` with what is measured in its place."""
        return reading

    def read_at(self, reading: Matrix) -> Iterator[PartRead]:
        """The parts that read where the `reading` is (w,)."""
        unknowns = list(range(len(self.unknowns)))
        yield PartRead(self, self.variants[0], unknowns, reading, slice(self.residual_size))

    @property
    def point(self) -> Matrix:
        """(3,) mm in the flange frame: what is measured of it, as stated."""
        return np.zeros(3)

    def ray(self, unknowns: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Point (3, 1) mm and unit direction (3, 1) in the flange frame, the direction 0 where it is no beam:
        what is drawn, and what obstacles must not meet."""
        return ca.SX.zeros(3), ca.SX.zeros(3)

    # What is drawn, in mm in the base frame, of numbers: a flange `pose` (4, 4), coordinates (3,) of a target

    def on_flange(self, pose: Matrix, unknowns: Matrix, variant: str) -> Matrix:
        """(3,) the point on the flange."""
        point, _ = self._ray(unknowns)
        return np.asarray(pose[:3, :3] @ point.full()[:, 0] + pose[:3, 3])

    def direction_at(self, pose: Matrix, unknowns: Matrix) -> Matrix:
        """(3,) unit, of a beam."""
        _, direction = self._ray(unknowns)
        return np.asarray(pose[:3, :3] @ direction.full()[:, 0])

    @cached_property
    def _ray(self) -> ca.Function:
        """`ray` of numbers; made once, since every measurement is drawn."""
        unknowns = ca.SX.sym("unknowns", len(self.unknowns))
        return ca.Function("ray", [unknowns], [ca.densify(part) for part in self.ray(unknowns)])

    def sight(
        self, pose: Matrix, target: Matrix, unknowns: Matrix, reading: Matrix, variant: str
    ) -> Matrix | None:
        """(2, 3) the line from the point on the flange to what it measures; None where there is none to draw,
        or a beam."""
        return None

    def outlines(self, target: Matrix, reading: Matrix, touched: Matrix) -> tuple[Matrix, ...]:
        """Lines (m, 3) that show a target which is no point; `touched` (N, 3) the points on the flange."""
        return ()

    # What is planned, and simulated

    @property
    def stands_at(self) -> Matrix:
        """(f,) the f unknowns of its frame, about where it stands: for what is planned."""
        return np.zeros(sum(unknown.group == "frame" for unknown in self.unknowns))

    def placed(self, rng: np.random.Generator) -> Matrix:
        """(f,) the unknowns of its frame, drawn at random: for a simulation."""
        return self.stands_at

    def goals(self, rng: np.random.Generator, count: int, target: Target) -> Matrix | None:
        """(count, 3) mm in the base frame, to which its `point` is brought to measure a target; None for a
        beam, and where it reads wherever the arm stands."""
        return None

    def prevented(self, poses: Matrix, target: Target, variant: str) -> dict[str, Mask]:
        """(N,) where it cannot measure with the flange at `poses` (N, 4, 4), by the reason in words, a
        clause."""
        return {}

    def in_sight(self, target: Target) -> Matrix | None:
        """(3,) mm in the base frame: the way to it from the `point` must be free of arm and boxes; None where
        there is no such way, or nobody says where it ends."""
        return None

    # Where a fit starts

    def start_target(self, poses: Matrix, readings: Matrix, unknowns: Matrix) -> Matrix | None:
        """(3,) a target from its own measurements, (N, 4, 4) flange in the base frame and (N, w); None where
        `ray` says it: the point nearest to all beams, or the mean of the tips."""
        return None

    def start_unknowns(
        self, poses: Matrix, readings: Matrix, unknowns: Matrix, variants: Sequence[str]
    ) -> Matrix:
        """(k,) `unknowns` with what is only guessed solved for, in closed form, from all its measurements."""
        return unknowns

    def nominal_beam(self) -> tuple[Matrix, Matrix, Matrix]:
        """Point (3,) mm, unit direction (3,) and basis (3, 2) across it of the beam as stated, in the flange
        frame; ValueError for what is no beam."""
        raise ValueError(f"a {self.name} has no beam")


@dataclass(frozen=True, eq=False)
class Station(Instrument):
    """An instrument that a header states under `instruments`, by a model of its kind's own: `Stated`."""

    Stated: ClassVar[type[FileModel]]
