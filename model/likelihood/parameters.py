"""Everything that is unknown, by name: offsets, geometry, targets, free tool parameters, noise factors.

A parameter vector x (p,) has them in blocks: one block a group, in the order of `ORDER`. A new group is an
entry there, one in `ARM` or `IN_RESIDUAL` if shots depend on it, and its items in `Parameters.build`; where
its columns are follows. Nobody else counts columns or takes names to pieces.

Inside, values are rad and mm; `display` turns them into the degrees and millimetres that people read. A
noise factor is its logarithm inside. What a header states between two targets (distances, angles) ties them.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from ..arrays import Matrix
from ..errors import BadInput
from ..files.header import StatedTolerance
from ..instruments.kind import Instrument
from ..kinematics.robot import Robot
from .geometry import Geometry
from .noise import NoiseModel

if TYPE_CHECKING:
    from ..files.header import Header
from typing import TYPE_CHECKING, NamedTuple

from ..files.shot import check_ties
from ..instruments.tips import normals_at, unit_normal

if TYPE_CHECKING:
    from ..files.header import Header


Group = Literal["offset", "geometry", "target", "tool", "frame", "noise"]
Unit = Literal["deg", "mm", "1"]

ORDER: tuple[Group, ...] = ("offset", "geometry", "target", "tool", "frame", "noise")
# The groups that forward kinematics depends on: they are contiguous, in this order, from the first on.
ARM: tuple[Group, ...] = ("offset", "geometry")
# The groups that the residual of one shot depends on: of the targets it is its own alone.
IN_RESIDUAL: tuple[Group, ...] = (*ARM, "target", "tool", "frame")

HeldBy = Literal["base frame", "tool rotation", "first link", "free tool", "header"]
_NOISE_PRIOR = 1.0  # of the logarithm of a noise factor: 95 % between 1/7 and 7 times what is stated
_NOISE_TOLERANCE = 0.25  # a noise factor counts as identified if it is known to about a quarter
_DEGREES = float(np.degrees(1.0))


@dataclass(frozen=True)
class Parameter:
    """One unknown. Prior mean, std and tolerance are in internal units (rad, mm, or the logarithm).

    `of` is what it belongs to (joint1, a target's name, tool, noise) and `axis` which number of that it is
    (offset, x, tilt1, spot). The prior of a `tolerated` one is a tolerance that its maker or owner states:
    knowledge, as a measurement is; of an `assumed` one nobody stated it.
    """

    name: str
    group: Group
    of: str
    axis: str
    unit: Unit
    prior_mean: float
    prior_std: float
    tolerance: float
    held: bool = False
    held_by: HeldBy | None = None
    tolerated: bool = False
    assumed: bool = False

    @property
    def display(self) -> float:
        """Units that people read per internal unit (of a noise factor: near 1)."""
        return _DEGREES if self.unit == "deg" else 1.0

    def shown(self, value: float) -> float:
        """An internal value as people read it: deg, mm, or the factor of which it is the logarithm."""
        return math.exp(value) if self.group == "noise" else value * self.display

    @property
    def shown_prior(self) -> tuple[float, float]:
        """Mean and std of the prior as people read them (of a noise factor: log-normal)."""
        if self.group != "noise":
            return self.prior_mean * self.display, self.prior_std * self.display
        spread = math.exp(self.prior_std**2)
        mean = math.exp(self.prior_mean) * math.sqrt(spread)
        return mean, mean * math.sqrt(spread - 1)

    def shown_std(self, value: float, std: float) -> float:
        """The std, as people read it, of what has the internal `std` at the internal `value`."""
        return self.display * std * (math.exp(value) if self.group == "noise" else 1.0)


@dataclass(frozen=True)
class Parameters:
    """The unknowns in their one order: offsets 1…n, geometry, each target's x, y, z, tool, noise factors.

    Raises ValueError for items in another order.
    """

    items: tuple[Parameter, ...]

    def __post_init__(self) -> None:
        places = [ORDER.index(item.group) for item in self.items]
        if places != sorted(places):
            raise ValueError(f"the order of the groups of parameters is {', '.join(ORDER)}")

    @classmethod
    def build(
        cls,
        robot: Robot,
        tool: Instrument,
        noise: NoiseModel,
        geometry: Geometry,
        header: Header,
        targets: Mapping[str, Instrument],
    ) -> Parameters:
        """Name every unknown of shots at `targets`, each with what measures it; raises BadInput for a held
        name that is none of them."""
        items = [
            *_offsets(robot, header),
            *_of_geometry(geometry, robot, tool, header.tolerance),
            *(item for name, measured in targets.items() for item in _coordinates(name, measured, header)),
            *_of_instrument(tool, header.tolerance),
            *(_noise_factors(noise.factors) if noise.separate else ()),
        ]
        held = _held(header.held, robot, tool, items)
        return cls(
            tuple(
                replace(item, held=True, held_by=held[item.name]) if item.name in held else item
                for item in items
            )
        )

    def with_geometry(self, geometry: Geometry, robot: Robot, tool: Instrument) -> Parameters:
        """These parameters with those of `geometry` in place of their own geometry parameters."""
        rest = self.without("geometry").items
        geometry_items = _of_geometry(geometry, robot, tool, StatedTolerance())
        return Parameters((*rest[: robot.n], *geometry_items, *rest[robot.n :]))

    def with_instrument(self, instrument: Instrument, *, keeping: Collection[str]) -> Parameters:
        """These parameters with all unknowns of `instrument` in place of those of the tool and frames, free
        without a tolerance but for the names in `keeping`."""
        ours = {item.name: item for item in self.items}
        unknowns = []
        for item in _of_instrument(instrument, StatedTolerance()):
            item = ours.get(item.name, item)
            kept = item.name in keeping
            unknowns.append(item if kept else replace(item, tolerated=False, assumed=False))
        first = self.block("tool").start
        rest = [item for item in self.items if item.group not in ("tool", "frame")]
        return Parameters((*rest[:first], *unknowns, *rest[first:]))

    def holding(self, places: NDArray[np.bool_]) -> Parameters:
        """These parameters with those at `places` (p,) held at their prior means."""
        return Parameters(
            tuple(
                replace(item, held=True) if hold else item
                for item, hold in zip(self.items, places.tolist(), strict=True)
            )
        )

    # Blocks

    def block(self, group: Group, which: int | None = None) -> slice:
        """The slice of a group in x, an empty slice where there are none.

        `which` chooses the k-th owner in it, such as `block("target", k)`: an empty slice behind the last.
        """
        if which is None:
            return self._groups[group]
        owners = self._owners[group]
        stop = self._groups[group].stop
        return owners[which] if which < len(owners) else slice(stop, stop)

    @cached_property
    def instrument(self) -> slice:
        """Those of what the flange carries and of the frames of stations."""
        return slice(self.block("tool").start, self.block("frame").stop)

    def carried(self, instrument: Instrument) -> NDArray[np.bool_]:
        """(p,) True for what the flange carries of an instrument."""
        of = {unknown.of for unknown in instrument.unknowns}
        return np.array([item.group == "tool" and item.of in of for item in self.items], dtype=bool)

    def place_of(self, name: str) -> NDArray[np.int64]:
        """Where among the parameters the three numbers are that move a target, or a station with a free
        frame, of that name: -1 for a number that does not, as the tilt of a plane."""
        places = np.full(3, -1, dtype=np.int64)
        of_name = [
            i for i, item in enumerate(self.items) if item.group in ("target", "frame") and item.of == name
        ]
        for axis, i in enumerate(of_name[:3]):
            places[axis] = i if self.items[i].unit == "mm" else -1
        return places

    @cached_property
    def arm(self) -> slice:
        """All that forward kinematics depends on."""
        return slice(self.block(ARM[0]).start, self.block(ARM[-1]).stop)

    def of_shot(self, target: int, *, noise: bool = True) -> NDArray[np.int64]:
        """The parameters that a shot at the k-th target depends on, in the order of its own Jacobian;
        without `noise` those of its residual alone. A shot at a station, which has no target, has the columns
        of the first one: it does not depend on them."""
        groups = [*IN_RESIDUAL, *(("noise",) if noise else ())]
        owner = target if target < len(self._owners["target"]) else 0
        blocks = [self.block("target", owner) if group == "target" else self.block(group) for group in groups]
        return np.concatenate([np.arange(len(self))[block] for block in blocks])

    def in_shot(self, group: Group) -> slice:
        """The columns of a group in a shot's own Jacobian (`of_shot`)."""
        start = 0
        for other in IN_RESIDUAL:
            block = self.block("target", 0) if other == "target" else self.block(other)
            if other == group:
                return slice(start, start + block.stop - block.start)
            start += block.stop - block.start
        raise ValueError(f"the residual of a measurement does not depend on the group {group}")

    @cached_property
    def _groups(self) -> dict[Group, slice]:
        ends = np.cumsum([0, *(int(self.group(group).sum()) for group in ORDER)]).tolist()
        return {group: slice(ends[k], ends[k + 1]) for k, group in enumerate(ORDER)}

    @cached_property
    def _owners(self) -> dict[Group, list[slice]]:
        owners: dict[Group, list[slice]] = {group: [] for group in ORDER}
        start = 0
        for (group, _), items in groupby(self.items, lambda item: (item.group, item.of)):
            count = len(list(items))
            owners[group].append(slice(start, start + count))
            start += count
        return owners

    def targets(self, names: Collection[str]) -> NDArray[np.bool_]:
        """(p,) True for the coordinates of the targets of these names."""
        return np.array([item.group == "target" and item.of in names for item in self.items], dtype=bool)

    def with_values(self, x: Matrix, of: Parameters, values: Matrix) -> Matrix:
        """(p,) `x` with the `values` of those parameters that are among `of` too."""
        result = x.copy()
        result[[self.index(name) for name in of.names]] = values
        return result

    def without(self, group: Group) -> Parameters:
        """The parameters without those of a group."""
        return Parameters(tuple(item for item in self.items if item.group != group))

    # Numbers of all

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(item.name for item in self.items)

    @cached_property
    def free(self) -> NDArray[np.bool_]:
        """(p,) True where the parameter is estimated."""
        return np.array([not item.held for item in self.items])

    @cached_property
    def tolerated(self) -> NDArray[np.bool_]:
        """(p,) True where the prior is a stated tolerance, and the parameter is estimated."""
        return np.array([item.tolerated and not item.held for item in self.items])

    @cached_property
    def untolerated(self) -> NDArray[np.bool_]:
        """(p,) True where a parameter is estimated without a tolerance: measurements must determine it."""
        return np.asarray(self.free & ~self.tolerated)

    @property
    def without_tolerance(self) -> int:
        """How many the measurements must determine."""
        return int(self.untolerated.sum())

    @cached_property
    def among_free(self) -> NDArray[np.int64]:
        """(p,) the index of each free parameter among the free ones."""
        return np.cumsum(self.free) - 1

    @cached_property
    def prior_mean(self) -> Matrix:
        return np.array([item.prior_mean for item in self.items])

    @cached_property
    def prior_std(self) -> Matrix:
        return np.array([item.prior_std for item in self.items])

    @cached_property
    def tolerance(self) -> Matrix:
        return np.array([item.tolerance for item in self.items])

    @cached_property
    def display(self) -> Matrix:
        return np.array([item.display for item in self.items])

    def shown(self, x: Matrix) -> Matrix:
        """Parameter vectors (..., p) as people read them: deg, mm, noise factors."""
        noise = self.group("noise")
        shown = x * self.display
        shown[..., noise] = np.exp(x[..., noise])
        return np.asarray(shown)

    def unscaled(self, std: Matrix) -> Matrix:
        """(p,) stds in internal units from those of the free ones (f,), scaled by priors; nan if held."""
        result = np.full(len(self), np.nan)
        result[self.free] = std * self.prior_std[self.free]
        return result

    def group(self, group: Group) -> NDArray[np.bool_]:
        """(p,) True for the parameters of one group."""
        return np.asarray(self._group_names == group)

    @cached_property
    def _group_names(self) -> NDArray[np.str_]:
        return np.array([item.group for item in self.items])

    def index(self, name: str) -> int:
        """Index of the parameter of that name; ValueError where there is none."""
        return self.names.index(name)

    def __len__(self) -> int:
        return len(self.items)


def _offsets(robot: Robot, header: Header) -> Iterator[Parameter]:
    prior, tolerance = header.prior, header.tolerance
    for i, joint in enumerate(robot.joints, start=1):
        unit: Unit = "mm"
        std, tol = prior.offset_mm, tolerance.length_mm
        if joint.kind == "revolute":
            unit = "deg"
            std, tol = np.radians([prior.offset_deg, tolerance.offset_deg]).tolist()
        yield Parameter(f"delta{i}", "offset", f"joint{i}", "offset", unit, 0.0, std, tol)


def _of_geometry(
    geometry: Geometry, robot: Robot, tool: Instrument, known: StatedTolerance
) -> Iterator[Parameter]:
    """The geometry's; `known` is up to where one counts as identified.

    Gauges are held: what moves all that follows, the targets too; and what the last link does to the tool,
    where a free tool takes it up.
    """
    moving_all = set() if tool.grounded else set(_moving_all(robot))
    for of, axis in geometry.names:
        unit: Unit = "mm" if axis in ("a", "b", "d") else "deg"
        held_by: HeldBy | None = "first link" if (of, axis) in moving_all else None
        if of == f"link{robot.n}" and not tool.calibrated:
            held_by = "free tool"
        yield Parameter(
            f"{of}.{axis}",
            "geometry",
            of,
            axis,
            unit,
            prior_mean=0.0,
            prior_std=geometry.prior_std(of, axis),
            tolerance=known.length_mm if unit == "mm" else float(np.radians(known.offset_deg)),
            held=held_by is not None,
            held_by=held_by,
            tolerated=True,
        )


def _moving_all(robot: Robot) -> Iterator[tuple[str, str]]:
    """The link parameters that move all that follows in the base frame, whatever the positions of the joints.

    A shift along the first axis that is turned about; behind slides, which only have a direction, every shift
    there too, and the rotation about the first of them.
    """
    slides = 0
    while slides < robot.n and robot.joints[slides].kind == "prismatic":
        slides += 1
        yield (f"link{slides}", "a")
    if slides:
        yield ("link1", "theta")
    if slides < robot.n:
        yield (f"link{slides + 1}", "d")


def _coordinates(target: str, measured: Instrument, header: Header) -> Iterator[Parameter]:
    enough = _enough(header.tolerance)
    for axis, unit, mean, std, *_ in measured.coordinates(header.targets.get(target)):
        yield Parameter(f"{target}.{axis}", "target", target, axis, unit, mean, std, enough[unit])


def _of_instrument(tool: Instrument, known: StatedTolerance) -> Iterator[Parameter]:
    """Those of the tool, then those of the frame; `known` is up to where one counts as identified."""
    enough = _enough(known)
    for axis, unit, mean, std, of, group, tolerated, assumed in tool.unknowns:
        yield Parameter(
            f"{of}.{axis}",
            group,
            of,
            axis,
            unit,
            mean,
            std,
            enough[unit],
            tolerated=tolerated,
            assumed=assumed,
        )


def _enough(known: StatedTolerance) -> dict[str, float]:
    """Up to where a tilt (rad) and a length (mm) count as identified."""
    return {"deg": float(np.radians(known.tilt_deg)), "mm": known.length_mm}


def _noise_factors(names: Sequence[str]) -> Iterator[Parameter]:
    for axis in names:
        yield Parameter(f"noise.{axis}", "noise", "noise", axis, "1", 0.0, _NOISE_PRIOR, _NOISE_TOLERANCE)


def _held(
    listed: Sequence[str] | None, robot: Robot, tool: Instrument, items: Sequence[Parameter]
) -> dict[str, HeldBy]:
    """What is held, and by what: the method's own choice unless the header states a list."""
    method: dict[str, HeldBy] = {} if tool.grounded else {"delta1": "base frame"}
    names = [item.name for item in items]
    if tool.turns and not tool.calibrated:
        method[f"delta{robot.n}"] = "tool rotation"
    if listed is None:
        return method
    for name in listed:
        if name not in names:
            raise BadInput(
                "held names a parameter that is not there",
                found=name,
                allowed=", ".join(names),
                remedy="correct the name in `held`, or leave `held` out to hold what the method defines",
            )
    if not any(item.name not in listed for item in items if not item.tolerated):
        raise BadInput(
            "everything is held: there is nothing to estimate",
            found=", ".join(listed),
            remedy="leave out of `held` what is to be estimated",
        )
    return {name: method.get(name, "header") for name in listed}


Vector = tuple[float, float, float]
_NO_LENGTH = 1e-9  # mm, or the sine of an angle: below it a distance or an angle has no direction


class Missed(NamedTuple):
    """By how many of its standard deviations a tie is missed (W,), and the slopes (W, 3) of that by the
    unknowns of its first and of its second target."""

    residual: Matrix
    by_first: Matrix
    by_second: Matrix


@dataclass(frozen=True)
class Distance:
    """A stated distance between two points (by their index), mm."""

    first: int
    second: int
    mm: float
    sigma: float

    def missed(self, first: Matrix, second: Matrix) -> Missed:
        """At positions (W, 3) of both, mm."""
        between = second - first
        length = np.maximum(np.linalg.norm(between, axis=1), _NO_LENGTH)
        along = between / length[:, None] / self.sigma
        return Missed((length - self.mm) / self.sigma, -along, along)


@dataclass(frozen=True)
class Angle:
    """A stated angle between the outward normals of two planes (by their index), rad; `normals` are those
    that the header states, about which the planes tilt."""

    first: int
    second: int
    rad: float
    sigma: float
    normals: tuple[Vector, Vector]

    def missed(self, first: Matrix, second: Matrix) -> Missed:
        """At unknowns (W, 3) of both planes: distance, mm, and tilts, rad."""
        (one, by_one), (two, by_two) = (
            normals_at(plane, np.array(nominal))
            for plane, nominal in zip((first, second), self.normals, strict=True)
        )
        cosine, sine = (one * two).sum(axis=1), np.linalg.norm(np.cross(one, two), axis=1)
        slope = -1 / (np.maximum(sine, _NO_LENGTH) * self.sigma)[:, None]
        return Missed(
            (np.arctan2(sine, cosine) - self.rad) / self.sigma,
            slope * (two[:, None] @ by_one)[:, 0],
            slope * (one[:, None] @ by_two)[:, 0],
        )


Tie = Distance | Angle


def ties(header: Header, targets: Sequence[str]) -> tuple[Tie, ...]:
    """Those of a header between the `targets` of some measurements; BadInput for one to another target."""
    check_ties(header, targets, file=None, line=None)
    between = [
        Distance(
            targets.index(distance.between[0]),
            targets.index(distance.between[1]),
            distance.mm,
            distance.sigma_mm,
        )
        for distance in header.distances
    ]
    return (*between, *(_angle(header, targets, i) for i in range(len(header.angles))))


def _angle(header: Header, targets: Sequence[str], i: int) -> Angle:
    angle = header.angles[i]
    one, two = (unit_normal(header.targets[name]).tolist() for name in angle.between)
    return Angle(
        targets.index(angle.between[0]),
        targets.index(angle.between[1]),
        float(np.radians(angle.deg)),
        float(np.radians(angle.sigma_deg)),
        ((one[0], one[1], one[2]), (two[0], two[1], two[2])),
    )
