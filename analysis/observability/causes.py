"""Why a parameter is held, or the data do not determine it: causes as data, and the null-space direction that
a status is due to. Their sentences and remedies are made in `words`."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Annotated, Literal

from pydantic import Field

from ...model.instruments.kind import Assumption
from ...model.likelihood.parameters import Group, HeldBy, Parameter
from ...model.records import internal, it, record, worded
from ..row import StatusRow
from ..status import Status

MOST = 0.5  # of a variance that tolerances set: they are its reason


@dataclass(frozen=True)
class Held:
    """Not estimated: `by` the method's choice (base frame, tool rotation), or by the header. `prismatic`: the
    joint that defines the base frame is."""

    by: HeldBy
    prismatic: bool = False


@dataclass(frozen=True)
class Unconverged:
    """The fit did not converge, so nothing is known."""


@dataclass(frozen=True)
class NotTheModel:
    """The model does not describe the measurements (a misfit), so the number is not validated."""


@dataclass(frozen=True)
class NotResolvable:
    """No direction stands out: the noise is too large for the tolerance."""


@dataclass(frozen=True)
class ToleranceOnly:
    """A parameter of geometry or tool of which the measurements say no more than its tolerance."""


@dataclass(frozen=True)
class NamedTolerance:
    """What a parameter of geometry or tool is known to: `std` in its `unit`."""

    name: str
    std: float
    unit: str


@dataclass(frozen=True)
class WithinTolerances:
    """What the arm and tool may deviate within their tolerances has the same effect: `share` (0 to 1) of the
    variance is set by them, most by `largest`."""

    share: float
    largest: tuple[NamedTolerance, ...] = ()


@dataclass(frozen=True)
class AsGoodAs:
    """The data determine an offset only with what is known `of` an instrument besides: its mounting, its tip,
    its frame. That is `stated`, or assumed. `weak`: it would be weak were that known exactly."""

    of: tuple[Assumption, ...]
    weak: bool = False

    @property
    def by_header(self) -> bool:
        return all(one.stated for one in self.of)


@dataclass(frozen=True)
class TargetUnseen:
    """The target is measured in `measurements` postures that do not fix its position."""

    target: str
    measurements: int


@dataclass(frozen=True)
class BaseFrame:
    """Joint 1 defines the base frame (section 3.3 of the paper, of a joint that is not `prismatic`)."""

    prismatic: bool = False


@dataclass(frozen=True)
class NoiseSplit:
    """The scatter does not separate the noise of the joints from that of the spot."""


@dataclass(frozen=True)
class OnAxis:
    """The beam or tip lies on the axis of `joint`."""

    tool: str
    joint: int


@dataclass(frozen=True)
class ToolRotation:
    """The last joint and the tool rotate together (section 3.1 of the paper): a free one, or one that is
    `known_to` a sigma (degrees of a laser's direction, mm of a probe's tip)."""

    tool: str
    joint: int
    known_to: float | None = None


@dataclass(frozen=True, kw_only=True)
class JointsBefore:
    """The joints before one: whether each is `revolute`, the `ranges` over which they are moved (degrees;
    mm), and of each whether that is hardly anything (`little`). `hidden`: what is left of a difference is
    below the noise."""

    revolute: tuple[bool, ...]
    ranges: tuple[float, ...]
    little: tuple[bool, ...]
    hidden: bool = False


@dataclass(frozen=True)
class CommonMotion(JointsBefore):
    """An offset of `joint` moves everything after it alike, as the joints before it hardly change.

    `revolute` has `joint` too. `frame`: not a target moves along, but the frame of an instrument.
    """

    joint: int
    frame: bool = False


@dataclass(frozen=True)
class ParallelAxes:
    """The axes of the joints `first` and `second` stay parallel, to within `angle_deg`, in these postures: in
    others they are not."""

    first: int
    second: int
    angle_deg: float


@dataclass(frozen=True)
class ToolAgainstTarget:
    """The tool hardly rotates over the measurements, so that it cannot be separated from the target."""


@dataclass(frozen=True)
class TooFewMeasurements:
    """`measurements` and stated `distances` and `angles` give `numbers`, fewer than the unknowns that they
    must determine: so many of each group. `needed` measurements at the least."""

    measurements: int
    distances: int
    numbers: int
    unknowns: dict[Group, int]
    needed: int
    angles: int = 0


@dataclass(frozen=True)
class OnePosition:
    """All measurements of a probe are at one position, and a motion that keeps that position is free."""


@dataclass(frozen=True)
class AtOptima:
    """What two local optima say of one parameter, in its unit: `values` at the best optimum and at the other,
    `std` the smaller of theirs."""

    name: str
    unit: str
    values: tuple[float, float]
    std: float


@dataclass(frozen=True)
class LocalOptima:
    """`count` local optima explain the data about equally well. One differs from the best in `parameters`,
    those that differ most first."""

    count: int
    parameters: tuple[AtOptima, ...]


@dataclass(frozen=True)
class Equivalent(JointsBefore):
    """Offsets of the `joints` (from 1) together have nearly the effect of a displacement of what `shifted`
    says (groups of other parameters that have a part; empty: nearly no effect), as the joints before the
    last of them move."""

    joints: tuple[int, ...]
    shifted: tuple[Group, ...]


@dataclass(frozen=True)
class Unexplained:
    """No known mechanism: noise factors alone."""


Cause = (
    Held
    | Unconverged
    | NotTheModel
    | NotResolvable
    | AsGoodAs
    | ToleranceOnly
    | WithinTolerances
    | TargetUnseen
    | BaseFrame
    | NoiseSplit
    | OnAxis
    | ToolRotation
    | CommonMotion
    | ParallelAxes
    | ToolAgainstTarget
    | TooFewMeasurements
    | OnePosition
    | LocalOptima
    | Equivalent
    | Unexplained
)


@record(repr=False, kw_only=True)
class JudgedRow(StatusRow):
    """A parameter with what was known of it beforehand. `cause` says why it has no number, or what its number
    rests on; `tolerated`: its prior is a tolerance, of the arm or of a calibrated tool."""

    status: Annotated[Status, it("what the data determine, or will")]
    group: Annotated[Group, it("`offset`, `geometry`, `target`, `tool` or `noise`")]
    data_std: Annotated[
        float | None,
        it(
            "standard uncertainty without prior; null if held, infinite (an exact gauge), or undetermined"
            " between local optima"
        ),
    ]
    prior_std: Annotated[float, it("standard deviation of the prior")]
    cause: Annotated[Cause | None, internal]
    tolerance_share: Annotated[
        Annotated[float, Field(ge=0, lt=1)] | None,
        it(
            "of an offset: share of its variance that the tolerances of the geometry set; null for "
            "nominal geometry"
        ),
    ] = None
    tolerated: Annotated[bool, internal] = False
    reason: Annotated[str | None, worded("why it is not `identified`, else null")] = None


How = Literal["replace", "add", "vary", "tolerances"]


@dataclass(frozen=True)
class Predicted:
    """The standard uncertainty of a parameter, in its `unit`, priors included: `before` a remedy (None where
    the data do not determine it), and as predicted `after` it. Up to the `tolerance` it is identified."""

    name: str
    unit: str
    before: float | None
    after: float
    tolerance: float


@dataclass(frozen=True)
class Tried:
    """A remedy that was tried, with what is `predicted` of the parameters concerned, the worst first.

    `how`: "replace" or "add" a posture, that of the number in `postures` with `joint` (from 1) rotated by
    `amount` (`unit`: deg or mm) and aimed anew; "vary": these `postures`, all but those
    that stay `unchanged`, with `joint` rotated by −1/2, 1/2 and 0 times the `amount` in turn, and aimed anew;
    "tolerances" that are an `amount` of times smaller. `measured`: the postures are those of measurements.
    `aimed`: there is a beam to be aimed.
    """

    how: How
    amount: float
    predicted: tuple[Predicted, ...]
    joint: int | None = None
    unit: str | None = None
    postures: tuple[int, ...] = ()
    unchanged: tuple[int, ...] = ()
    measured: bool = False
    aimed: bool = True


@record
class NullDirection:
    """A combination of parameters that the data do not determine. What has a tolerance has no part in it: it
    is known up to that, whatever the data say. `slight` have a part in it that is too small for the
    combination, and no bound all the same. Of the kind `optima` `data_std` is the length of the way."""

    combination: Annotated[
        dict[str, float],
        it(
            "weights in prior standard deviations, the largest 1, of offsets, targets, a free tool and noise "
            "factors; parameters with a tolerance take part in those of kind `optima` alone"
        ),
    ]
    kind: Annotated[
        Literal["exact", "noise", "optima"],
        it("`optima`: the way to another local optimum that explains the data about as well"),
    ]
    cause: Annotated[Cause, internal]
    data_std: Annotated[
        float | None, it("of the unit combination, in prior standard deviations; null if exact")
    ] = None
    slight: Annotated[tuple[str, ...], internal] = ()
    tried: Annotated[
        Tried | None,
        it(
            "the remedy in numbers, null where none was tried or none helps: `how` (`replace` or "
            "`add`: the posture of the number in `postures`, with `joint`, from 1, rotated by "
            "`amount` in `unit` (deg or mm) and aimed again, in its place or as one more; `vary`: "
            "these `postures`, all but those that stay `unchanged`, with `joint` rotated by −1/2, 1/2"
            " and 0 times the `amount` in turn, and aimed again; `tolerances`: an `amount` of times "
            "smaller), whether these are postures of what was `measured`, whether there is a beam to "
            "be `aimed`, and `predicted`, by "
            "parameter: its `name`, `unit`, standard uncertainty `before` (null where it is not "
            "determined) and `after` the remedy, priors included, and the `tolerance` up to which it "
            "is identified"
        ),
    ] = None
    reason: Annotated[str | None, worded("the cause, in words")] = field(default=None, kw_only=True)
    remedy: Annotated[str | None, worded("what would determine it, in words")] = field(
        default=None, kw_only=True
    )


def worst_direction(null_space: Sequence[NullDirection], name: str) -> NullDirection:
    """The direction that a weak or unidentifiable parameter owes its status to.

    A parameter is part of the way to another optimum only if it would be determined without that optimum.
    """
    taking_part = [
        direction for direction in null_space if name in direction.combination or name in direction.slight
    ]
    taking_part = [direction for direction in taking_part if direction.kind == "optima"] or taking_part
    if not taking_part:
        return NullDirection({name: 1.0}, "noise", NotResolvable())
    return max(taking_part, key=lambda direction: _share(direction, name))


def _share(direction: NullDirection, name: str) -> float:
    """Std that the direction gives to one of its parameters, in prior stds (infinite for a gauge)."""
    if direction.data_std is None or name in direction.slight:
        return math.inf
    weights = direction.combination
    return abs(weights[name]) * direction.data_std / math.hypot(*weights.values())


def cause_for(
    null_space: Sequence[NullDirection],
    item: Parameter,
    status: Status,
    tolerance_share: float | None = None,
    rests_on: Mapping[str, tuple[Assumption, ...]] = MappingProxyType({}),
    still_weak: Container[str] = (),
) -> Cause | None:
    """Why a parameter has no number, or a poor one, or what its number `rests_on` (and whether it is
    `still_weak` all the same); None for one that the measurements identify alone.

    `tolerance_share` (0 to 1) is the part of its variance that the tolerances set.
    """
    if item.held_by is not None:
        return Held(item.held_by, prismatic=item.held_by == "base frame" and item.unit == "mm")
    if item.tolerated and status == "unidentifiable":
        return ToleranceOnly()
    if status == "unvalidated":
        return NotTheModel()
    if status in ("identified", "assumed"):
        if item.name not in rests_on:
            return None
        return AsGoodAs(rests_on[item.name], item.name in still_weak)
    cause = worst_direction(null_space, item.name).cause
    if isinstance(cause, NotResolvable) and tolerance_share is not None and tolerance_share >= MOST:
        return WithinTolerances(tolerance_share)
    return cause
