"""The geometry of an answer in words: what u is if the arm deviates from nominal, tolerances, the ladder; and
the motion that no reading notices."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, Protocol, TypeVar

from ..analysis.diagnostics.null_motion import NewPosture, NullSpaceMotion
from ..analysis.observability.causes import Cause, NotResolvable, NullDirection
from ..analysis.observability.check import Check
from ..analysis.observability.geometry_result import Confounded, GeometryResult, Rung, RungName, Tolerance
from ..analysis.status import Status
from . import numbers
from .observability import direction_remedy
from .wording import Namer, clipped, counted, label, listed, person, sentence

IF_IT_DEVIATES = "u, incl. tolerances"
SET_BY_TOLERANCES = "set by tolerances"
RUNGS: dict[RungName, str] = {
    "offsets": "nominal geometry",
    "geometry": "+ link geometry",
    "gravity": "+ gravity",
    "harmonics": "+ first harmonics",
}
_MOSTLY = 0.5  # a share of the variance, or a correlation, from which it is worth a sentence
_UNKNOWN = "unknown"  # where the curvature at the mode does not say


class OffsetRow(Protocol):
    """An offset of a result, of a check, of a run that has ended."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def std(self) -> float | None: ...
    @property
    def status(self) -> Status: ...
    @property
    def tolerance_share(self) -> float | None: ...


Row = TypeVar("Row", bound=OffsetRow)


class _Tolerated(Protocol):
    """A parameter of a result, of a check."""

    @property
    def group(self) -> str: ...
    @property
    def std(self) -> float | None: ...
    @property
    def held(self) -> bool: ...
    @property
    def tolerated(self) -> bool: ...


class _Grouped(Protocol):
    @property
    def group(self) -> str: ...


def geometry_title(tolerated: Iterable[_Grouped]) -> str:
    """The title of what is said of the parameters with tolerances."""
    return "Geometry and tool" if any(row.group == "tool" for row in tolerated) else "Geometry"


def determined_sentence(rows: Iterable[_Tolerated], *, planned: bool = False) -> str | None:
    """How many of the parameters with tolerances the measurements determine; None where there are none."""
    free = [row for row in rows if row.tolerated and not row.held]
    if not free:
        return None
    count, be = sum(row.std is not None for row in free), "will be" if planned else "are"
    if not count:
        return f"{geometry_title(free)}: all {len(free)} parameters {be} known by their tolerances only."
    return (
        f"{geometry_title(free)}: {count} of {len(free)} parameters {be} determined, the others prior only."
    )


def tolerances_words(geometry: GeometryResult) -> str:
    """The tolerances of the links: 0.3 mm and 0.1°; of lists the smallest and the largest."""
    of = geometry.considered_tolerance
    return f"{tolerance_words(of.length_mm, 'mm')} and {tolerance_words(of.angle_deg, 'deg')}"


def tolerance_words(tolerance: Tolerance, unit: str) -> str:
    """One tolerance; of a list the smallest and the largest."""
    if isinstance(tolerance, int | float):
        return numbers.exact(float(tolerance), unit)
    low, high = min(tolerance), max(tolerance)
    if low == high:
        return numbers.exact(low, unit)
    return f"{numbers.exact(low, unit)} to {numbers.exact(high, unit)}"


def with_own_u(offsets: Iterable[Row]) -> list[Row]:
    """The offsets of which a sentence says how large u is: not those whose u is assumed."""
    return [row for row in offsets if row.std is not None and row.status != "assumed"]


def worth_sentence(geometry: GeometryResult, offsets: Sequence[OffsetRow], k: float = 1.0) -> str | None:
    """What u of the `offsets` (`with_own_u`) is, and what it would be with the geometry taken otherwise; None
    where none has a u. With a coverage factor `k` of expanded uncertainties U."""
    known = with_own_u(offsets)
    std, units = {row.name: row.std for row in known}, {row.name: row.unit for row in known}
    considered = _range(geometry.consider, units, k)
    if not std or considered is None:
        return None
    present, u = _range(std, units, k), "u" if k == 1 else "U"
    if geometry.tolerance is None:
        return (
            f"Leave out geometry: exact to estimate the links: if they deviate by"
            f" {tolerances_words(geometry)}, {u} is {considered}, not {present}."
        )
    half, twice = _range(geometry.at_half, units, k), _range(geometry.at_twice, units, k)
    otherwise = (
        f"With half the tolerances it would be {half or _UNKNOWN}, with twice {twice or _UNKNOWN}; with"
    )
    factors = ""
    if geometry.factors is not None:  # the data say how large the tolerances are, whatever is stated
        otherwise, factors = "With", ", multiplied by the factors that the data give them"
    return (
        f"With the geometry estimated within its tolerances ({tolerances_words(geometry)}{factors}) {u} is"
        f" {present}. {otherwise} nominal geometry, if the arm deviates from it by these tolerances,"
        f" {considered}."
    )


def _range(uncertainties: Mapping[str, float | None], units: Mapping[str, str], k: float) -> str | None:
    """The smallest to the largest, by unit, each `k` times; None where one of those with a unit is not
    known."""
    if any(u is None and name in units for name, u in uncertainties.items()):
        return None
    ranges = []
    for unit in dict.fromkeys(units[name] for name in uncertainties if name in units):
        of_unit = [k * u for name, u in uncertainties.items() if u is not None and units.get(name) == unit]
        if not of_unit:
            continue
        low, high = (numbers.spread(end, unit) for end in (min(of_unit), max(of_unit)))
        ranges.append(low if low == high else f"{low} to {high}")
    return " and ".join(ranges) or None


def confounded_sentence(
    geometry: GeometryResult, offset: str, share: float | None, name: Namer = str
) -> str | None:
    """Why an offset is known no better: the tolerances, and what it is confounded with; None where most of
    its variance is of the noise."""
    if share is None or share < _MOSTLY:
        return None
    text = (
        f"{numbers.percent(share)} of the variance of {name(offset)} comes from how far the links may deviate"
    )
    rivals = [row for row in geometry.confounded if row.offset == offset and abs(row.correlation) >= _MOSTLY]
    if not rivals:
        return f"{text}; the estimate is not correlated with any one of them alone."
    named = [f"{name(row.parameter)} ({correlation(row)})" for row in rivals]
    return (
        f"{text}: in these postures the estimate is correlated with {listed(named)}. Other postures can"
        " separate them, the same ones again cannot."
    )


def by_tolerances(cause: Cause, share: float | None) -> str | None:
    """Why a parameter is weak where it is not the noise but the tolerances; None where it is not so."""
    if not isinstance(cause, NotResolvable) or share is None or share < _MOSTLY:
        return None
    return "most of its variance is set by the tolerances of the geometry"


def correlation(row: Confounded) -> str:
    return numbers.fixed(row.correlation, 2)


def factors_sentence(geometry: GeometryResult) -> str | None:
    """By what the data multiply the tolerances; u is that of a factor of lognormal distribution."""
    if geometry.factors is None:
        return None
    factors = geometry.factors
    known_u = [u for u in factors.log_u if u is not None]
    parts = [
        f"{kind} by {numbers.significant(factor, 2)} (relative u {numbers.percent(u)})"
        for (kind, factor), u in zip(factors.by_kind().items(), known_u, strict=True)
    ]
    return (
        f"The data multiply the tolerances of {listed(parts)}; the intervals include what these factors leave"
        " open."
    )


def rung_reason(ladder: Sequence[Rung], i: int) -> str:
    """Why rung `i` is kept, or not, and what the measurements say of it, next to the rung below."""
    rung = ladder[i]
    if not rung.kept:
        return "for comparison"
    below = ladder[i - 1]
    changes = ["evidence rises" if rung.log_evidence > below.log_evidence else "evidence falls"]
    if rung.held_out_rms_mm is not None and below.held_out_rms_mm is not None:
        better = rung.held_out_rms_mm < below.held_out_rms_mm
        changes.insert(0, "predicts better" if better else "predicts no better")
    return f"with its prior; {', '.join(changes)}"


def check_lines(check: Check) -> list[str]:
    """What a check says of the geometry, a line each."""
    offsets = [row for row in check.parameters if row.group == "offset"]
    worth = worth_sentence(check.geometry, offsets)
    lines = [] if worth is None else [worth]
    worst = max(with_own_u(offsets), key=lambda row: row.std or 0.0, default=None)
    if worst is not None:
        why = confounded_sentence(check.geometry, worst.name, worst.tolerance_share, person)
        lines += [] if why is None else [why]
    determined = determined_sentence(check.parameters, planned=True)
    return lines if determined is None else [*lines, determined]


_EXACT_MM = 1e-6
_MOST_NAMED = 3  # of what moves along


class MotionWords(NamedTuple):
    """The `lead` before the picture; the titles of its panels, of `one_end`, the `other_end`, the
    `new_posture` and the `motion`; the `caption` and the `alt` text; the `end`: what ends the motion."""

    lead: str
    one_end: str
    other_end: str
    new_posture: str
    motion: str
    caption: str
    alt: str
    end: str


def motion_words(motion: NullSpaceMotion, direction: NullDirection, measured: int) -> MotionWords:
    """Of a motion along a `direction`, of so many `measured` postures."""
    name, joint = label(motion.offset), f"J{motion.offset.removeprefix('delta')}"
    unit = numbers.unit_of(motion.unit)
    amount = numbers.exact(float(f"{motion.amount:.2g}"), unit)
    less, more = f"{numbers.MINUS}{amount}", f"+{amount}"
    along = _along(motion)
    verb = "move" if set(motion.moved) <= set(motion.targets) else "change"
    moves = f"{listed(along)} {verb}{'s' if len(along) == 1 else ''} with it" if along else ""
    larger = ""
    if motion.drawn > 1:
        larger = f" The motion is drawn {numbers.significant(motion.drawn, 2)} times larger."
    return MotionWords(
        lead=(
            f"Both ends fit the readings equally: at the same joints {name} may be {amount} less or"
            f" {amount} more, and {moves or 'nothing else changes'}. {_meets(motion)}"
        ),
        one_end=f"{joint} {less}",
        other_end=f"{joint} {more}",
        new_posture="A posture that ends it",
        motion=f"{joint} from {less} to {more}",
        caption=(
            "Null-space motion: both ends fit the readings equally; no position here is an estimate."
            f" {len(motion.shots)} of {counted(measured, motion.like)} are drawn. {_drawn(motion)}{larger}"
        ),
        alt=(
            f"The arm at both ends of the null-space motion, {joint} {less} and {joint} {more}"
            f"{f'; {moves}' if moves else ''}. {_meets(motion)}"
        ),
        end=" ".join(_ends(motion, new) for new in motion.new)
        or f"To end it: {sentence(direction_remedy(direction, person))}.",
    )


def _drawn(motion: NullSpaceMotion) -> str:
    """What is grey, and what is dashed."""
    first, last = motion.frames[0], motion.frames[-1]
    moved = [
        clipped(name)
        for name, one, other in zip(motion.targets, first.targets, last.targets, strict=True)
        if one != other
    ]
    if first.postures[0].links == last.postures[0].links:
        joint = int(motion.offset.removeprefix("delta")) + 1
        what = "the flange" if motion.marked == "flange" else f"the axis of joint {joint}"
        return f"Dashed: the path of a mark on {what}, the only part that moves."
    way = f"; dashed: the path of {listed(moved[:_MOST_NAMED])}" if moved else ""
    return f"In grey: the first of them at the ends{way}."


def _along(motion: NullSpaceMotion) -> list[str]:
    names = ["the tool" if each == "tool" else label(each) for each in motion.moved]
    if len(names) > _MOST_NAMED:
        names = [*names[: _MOST_NAMED - 1], f"{len(names) - _MOST_NAMED + 1} more unknowns"]
    return names


def _beams(motion: NullSpaceMotion) -> bool:
    return motion.frames[0].postures[0].beam_to is not None


def _meets(motion: NullSpaceMotion) -> str:
    what = "Every beam still meets its target" if _beams(motion) else "Every reading stays the same"
    if motion.off_mm <= _EXACT_MM:
        return f"{what}."
    return f"{what} to within {numbers.significant(motion.off_mm, 2, 'mm')}, less than the noise."


def _ends(motion: NullSpaceMotion, new: NewPosture) -> str:
    joints = [
        f"J{k} {numbers.with_unit(numbers.fixed(value, 1), unit)}"
        for k, (value, unit) in enumerate(zip(new.joints, new.units, strict=True), start=1)
    ]
    off = numbers.significant(new.off_mm, 2, "mm")
    misses = (
        f"the beam would miss by up to {off} (dotted)"
        if _beams(motion)
        else f"the reading would differ by up to {off}"
    )
    return (
        f"A posture that ends it: {', '.join(joints)} (like {motion.like} {new.like}). There {misses} at the"
        " ends of the motion, so that this reading decides."
    )
