"""Observability in words: why the data do not determine a parameter or a combination, what to do about it,
and a plan's outlook.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from ..analysis.observability.causes import (
    AsGoodAs,
    BaseFrame,
    Cause,
    CommonMotion,
    Equivalent,
    Held,
    JudgedRow,
    LocalOptima,
    NoiseSplit,
    NotResolvable,
    NotTheModel,
    NullDirection,
    OnAxis,
    OnePosition,
    ParallelAxes,
    Predicted,
    TargetUnseen,
    ToleranceOnly,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    Tried,
    Unconverged,
    Unexplained,
    WithinTolerances,
)
from ..analysis.observability.check import Check
from ..analysis.observability.identifiability import Identifiability
from ..analysis.observability.outlook import COVERAGE
from ..analysis.observability.power import NOTICED, DetectionPower, WrongModel, harm
from ..analysis.status import NOT_DESCRIBED, Status
from ..model.instruments.kind import Assumption
from ..model.instruments.registry import TOOLS, kind_of
from ..model.likelihood.parameters import Group
from . import numbers
from .wording import WEAK, Namer, are, be, capital, clipped, counted, joints, label, listed, shown

_BASE_FRAME = (
    "joint 1 defines the base frame: a rotation of it together with every target changes no measurement"
    " (section 3.3 of the paper)"
)
_BASE_SHIFT = (
    "joint 1 defines the base frame: a shift along its axis together with every target changes no measurement"
)
_CONSTANT = 1e-9  # degrees or mm
_MOST_AT_OPTIMA = 3
_PLAN_MORE = "plan more measurements"
_PLAN_ANEW = "plan other postures (zerobeam plan optimal)"
_SEEN_DEG = 0.001  # of axes that are said to be parallel within an angle
_TOOL_ROTATION = (
    "a rotation of the last joint is equivalent to one of the uncalibrated tool (section 3.1 of the paper)"
)
_SHIFTED: dict[Group, str] = {"target": "the target", "frame": "the frame", "tool": "the tool"}
_UNKNOWN: dict[Group, str] = {
    "offset": "offset",
    "target": "target coordinate",
    "tool": "tool parameter",
    "frame": "frame parameter",
    "noise": "noise factor",
}


def _sigma_of(kind: str) -> str:
    """The key of a header that says how well what the flange carries is known."""
    return "tool.sigma" if kind in TOOLS else "sigma"


def _unit_of_tool(kind: str) -> str:
    return numbers.unit_of(kind_of(kind).words.unit)


def reason_of(row: JudgedRow) -> str | None:
    """Why a parameter is not `identified`."""
    return None if row.cause is None else reason(row.cause)


def reason(cause: Cause, name: Namer = str) -> str:
    """Why, as what can follow a colon; `name` writes names of parameters and targets."""
    match cause:
        case Held(by="base frame", prismatic=slides) | BaseFrame(prismatic=slides):
            return _BASE_SHIFT if slides else _BASE_FRAME
        case Held(by="tool rotation"):
            return _TOOL_ROTATION
        case ToolRotation(tool, joint, known_to):
            words = kind_of(tool).words
            if known_to is None and kind_of(tool).beam:
                return _TOOL_ROTATION
            if known_to is None:
                return f"joint {joint} and a free {words.part} rotate together: only the sum of both moves it"
            return (
                f"a rotation of joint {joint} is equivalent to a {words.motion}, which is known to"
                f" {numbers.exact(known_to, _unit_of_tool(tool))} ({_sigma_of(tool)})"
            )
        case Held(by="first link"):
            return "it moves the arm and every target alike, as the choice of the base frame does"
        case Held(by="free tool"):
            return "the free tool takes up what the last link does"
        case Held():
            return "held by the header"
        case Unconverged():
            return "the fit did not converge"
        case NotTheModel():
            return NOT_DESCRIBED
        case NotResolvable():
            return "not resolvable at this noise level"
        case AsGoodAs():
            return _as_good_as(cause)
        case ToleranceOnly():
            return "prior only: the measurements add nothing to its tolerance"
        case WithinTolerances(share, largest):
            named = [
                f"{name(each.name)} ({numbers.exact(float(f'{each.std:.3g}'), numbers.unit_of(each.unit))})"
                for each in largest
            ]
            return (
                "arm and tool may deviate within their tolerances with nearly the same effect: the tolerances"
                f" set {100 * share:.0f} % of the variance{f', most by {listed(named)}' if named else ''}"
            )
        case TargetUnseen(target, 1):
            return f"the target {name(target)} has one measurement only"
        case TargetUnseen(target, _):
            return f"the target {name(target)} is measured from too few directions to locate it"
        case NoiseSplit():
            return (
                "the scatter of these residuals does not separate the noise of the joints from that of the"
                " instrument"
            )
        case OnAxis(tool, joint):
            return (
                f"the {kind_of(tool).words.part} lies on or near the axis of joint {joint}: a rotation of"
                " that joint hardly moves it"
            )
        case CommonMotion():
            return _common_motion(cause)
        case ParallelAxes(first, second, angle):
            within = f" to within {numbers.significant(angle, 2)}°" if angle > _SEEN_DEG else ""
            return (
                f"the axes of joints {first} and {second} stay parallel{within} in these postures, so that"
                " the measurements do not separate their offsets"
            )
        case ToolAgainstTarget():
            return "the tool rotates too little over the measurements to be separated from the target"
        case TooFewMeasurements():
            return too_few_words(cause)
        case OnePosition():
            return "all measurements are at one position, and a motion that keeps it is free"
        case LocalOptima():
            return _local_optima(cause, name)
        case Equivalent():
            return _equivalent(cause)
        case Unexplained():
            return "no known mechanism"


def remedy(cause: Cause, name: Namer = str, tried: Tried | None = None) -> str:
    """What to do, as an imperative without a full stop; with what it is predicted to give where it was
    `tried`."""
    if tried is None:
        return _untried(cause, name)
    if tried.how == "tolerances":
        return f"{_closer(cause, tried)}; {_promise(tried, name)}"
    return f"{_change(tried)}; {_promise(tried, name)}"


def helps_little(direction: NullDirection) -> bool:
    """Whether the remedy of a direction is another plan, smaller tolerances, or a change that leaves what is
    weak weak."""
    tried = direction.tried
    if tried is None:
        return remedy(direction.cause) == _PLAN_ANEW
    weak = all(each.before is not None for each in tried.predicted) and leaves_weak(direction)
    return tried.how == "tolerances" or weak


def leaves_weak(direction: NullDirection) -> bool:
    """Whether the change that was tried leaves something weakly observable."""
    tried = direction.tried
    return tried is not None and any(each.after > each.tolerance for each in tried.predicted)


def direction_remedy(direction: NullDirection, name: Namer = str) -> str:
    """What to do about a direction."""
    return remedy(direction.cause, name, direction.tried)


def _change(tried: Tried) -> str:
    """A change of the postures."""
    unit = numbers.unit_of(tried.unit or "")
    move = "rotated" if tried.unit == "deg" else "moved"
    if tried.how == "vary":
        half = numbers.exact(tried.amount / 2, unit)
        noun, fixed = "measurements" if tried.measured else "postures", [str(i) for i in tried.unchanged]
        where = f" in all {noun} but {listed(fixed, len(fixed))}" if fixed else ""
        again = "measure again and vary joint" if tried.measured else "vary joint"
        return (
            f"{again} {tried.joint} by {numbers.exact(tried.amount, unit)}{where} ({move} by"
            f" {numbers.MINUS}{half}, {half} and {numbers.exact(0.0, unit)} in turn{_aimed(tried, ', and')})"
        )
    (number,) = tried.postures
    by = f"joint {tried.joint} {move} by {numbers.exact(tried.amount, unit)}{_aimed(tried, ' and')}"
    if tried.how == "replace":
        return f"replace posture {number} by the same with {by}"
    return f"add {'one like measurement' if tried.measured else 'one like posture'} {number} with {by}"


def _aimed(tried: Tried, joined: str) -> str:
    """That the wrist is turned onto the target then, where an instrument has a beam."""
    return f"{joined} aimed anew" if tried.aimed else ""


def _closer(cause: Cause, tried: Tried) -> str:
    """A smaller tolerance, where it can be measured and stated."""
    if isinstance(cause, ToolRotation) and cause.known_to is not None:
        to = numbers.exact(float(f"{cause.known_to / tried.amount:.3g}"), _unit_of_tool(cause.tool))
        return f"calibrate the tool to {to} and state that ({_sigma_of(cause.tool)})"
    times = numbers.exact(tried.amount)
    return f"measure the geometry of arm and tool and state tolerances {times} times smaller"


def _promise(tried: Tried, name: Namer) -> str:
    """What a remedy is predicted to give."""
    text = f"predicted U: {listed([_predicted(each, name) for each in tried.predicted])}"
    if any(each.after > each.tolerance for each in tried.predicted):
        text += f"; then {_PLAN_MORE}"
    return text


def _predicted(row: Predicted, name: Namer) -> str:
    """Expanded uncertainties, k = 2."""
    unit = numbers.unit_of(row.unit)
    before = "not determined" if row.before is None else numbers.spread(COVERAGE * row.before, unit)
    weak = f" (still {WEAK})" if row.after > row.tolerance else ""
    return f"{name(row.name)} {before} → {numbers.spread(COVERAGE * row.after, unit)}{weak}"


def _untried(cause: Cause, name: Namer) -> str:
    """What to do where no change was tried, or none of those that were helps much."""
    match cause:
        case Held(by="base frame") | BaseFrame():
            return f"hold {name('delta1')} (the default): it is a choice of base frame and costs no accuracy"
        case Held(by="header"):
            return "leave it out of held to estimate it"
        case Held(by="first link"):
            return "nothing: it is a choice of base frame and costs no accuracy"
        case Held(by="free tool"):
            return "nothing: it is part of the tool, which is estimated"
        case ToolRotation(joint=joint, known_to=float()):
            return f"hold {name(f'delta{joint}')}"
        case Held() | ToolRotation():
            last = name(f"delta{cause.joint}") if isinstance(cause, ToolRotation) else "the last offset"
            return f"hold {last}, or calibrate the tool separately and state it as calibrated"
        case Unconverged():
            return "look for a wrong measurement, or state a better guess of target and tool"
        case NotTheModel():
            return "find what is wrong first: joint columns, signs, zeros, units, targets, geometry"
        case AsGoodAs():
            return _determining(cause)
        case TargetUnseen(target, _):
            return f"add measurements of {name(target)} from other directions"
        case NoiseSplit():
            return "state one of the two, or add measurements with shorter and longer beams"
        case OnAxis(tool, joint):
            return (
                f"mount the tool so that the {kind_of(tool).words.part} is off the axis of joint {joint}, or"
                f" hold {name(f'delta{joint}')} (held: delta{joint} in the header, of a run its first line)"
            )
        case TooFewMeasurements(needed=needed):
            return f"record at least {needed} measurements in varied postures, better twice as many"
        case OnePosition():
            return "add measurements of a second target, some hundred millimetres away"
        case LocalOptima():
            return "add measurements in postures that differ in every joint, until one optimum is left"
        case _:
            return _PLAN_ANEW


def named_part(kind: str, of: str, part: str) -> str:
    """A part of the instrument with the label `of`, such as "the laser's mounting"."""
    if part not in ("mounting", "tip", "frame", "mount"):
        return f"the reflector {clipped(part)}"
    return f"the {kind}'s {part}" if of == "tool" else f"the {part} of {clipped(of)}"


def part_of(one: Assumption) -> str:
    """What of an instrument is assumed or stated, such as "the laser's mounting"."""
    return named_part(one.kind, one.label, one.part)


def size_of(one: Assumption) -> str:
    """How far it may be from what is stated."""
    return "exact" if one.std is None else numbers.exact(float(f"{one.std:.3g}"), numbers.unit_of(one.unit))


def _as_good_as(cause: AsGoodAs) -> str:
    parts = list(dict.fromkeys(map(part_of, cause.of)))
    sizes = list(dict.fromkeys(size_of(one) for one in cause.of if one.std is not None))
    if cause.by_header:
        parts_of_header = [
            f"the stated {one.part} of {f'the {one.kind}' if one.label == 'tool' else clipped(one.label)}"
            for one in cause.of
        ]
        return f"by {listed(list(dict.fromkeys(parts_of_header)))}: {listed(sizes)}"
    weak = f"; {WEAK} however well that is known" if cause.weak else ""
    if not sizes:
        return f"as good as {listed(parts)}: that it is exactly as stated is assumed, not measured{weak}"
    return f"as good as {listed(parts)}: {listed(sizes)} {be(sizes)} assumed, not stated or measured{weak}"


def _determining(cause: AsGoodAs) -> str:
    """What would make an offset more than assumed."""
    if not cause.weak:
        return stating(cause.of)
    keys = list(dict.fromkeys(one.key for one in cause.of))
    return f"plan other postures; measure and state {listed(keys)}"


def stating(of: Sequence[Assumption]) -> str:
    """What to do about what an offset rests on, as an imperative."""
    parts, keys = (list(dict.fromkeys(each)) for each in (map(part_of, of), (one.key for one in of)))
    text = f"measure {listed(parts)} and state {listed(keys)}"
    if all(one.part == "frame" for one in of):
        return f"{text}, or state it as free and hold the first offset"
    return text


class _WithStatus(Protocol):
    """A parameter of a result, of a check, of a run that is not finished."""

    @property
    def name(self) -> str: ...
    @property
    def status(self) -> Status: ...


def determined(rows: Sequence[_WithStatus], texts: Mapping[Status, str], name: Namer) -> str:
    """What can be said of offsets by their status, in the order of `texts`; then what they rest on."""
    by_status = {status: [row.name for row in rows if row.status == status] for status in texts}
    sentences = [f"{are(names, name)} {texts[status]}." for status, names in by_status.items() if names]
    return " ".join([*sentences, *_resting(rows, name)])


def _resting(rows: Sequence[_WithStatus], name: Namer) -> list[str]:
    """What offsets rest on besides the measurements, a sentence for each reason: what is assumed, then what
    is stated."""
    grouped: dict[tuple[bool, str], list[str]] = {}
    for row in rows:
        cause = getattr(row, "cause", None)
        if isinstance(cause, AsGoodAs) and row.status in ("assumed", "identified"):
            grouped.setdefault((cause.by_header, reason(cause, name)), []).append(row.name)
    return [
        f"{are(names, name)} {'identified ' if by_header else ''}{why}."
        for (by_header, why), names in sorted(grouped.items())
    ]


def assumed_steps(rows: Sequence[_WithStatus], name: Namer) -> list[str]:
    """What to do to determine the offsets that are as good as what is assumed, a sentence for each reason."""
    grouped: dict[str, list[str]] = {}
    for row in rows:
        cause = getattr(row, "cause", None)
        if row.status == "assumed" and isinstance(cause, AsGoodAs):
            grouped.setdefault(_determining(cause), []).append(row.name)
    return [f"To determine {listed(joints(names, name))}: {what}" for what, names in grouped.items()]


def too_few_words(cause: TooFewMeasurements) -> str:
    """What too few measurements give, and what they must determine."""
    measured = counted(cause.measurements, "measurement")
    ties = ((cause.distances, "stated distance"), (cause.angles, "stated angle"))
    measured = listed([measured, *(counted(count, what) for count, what in ties if count)])
    gives = "gives" if cause.measurements + cause.distances + cause.angles == 1 else "give"
    parts = [counted(count, _UNKNOWN[group]) for group, count in cause.unknowns.items()]
    total = sum(cause.unknowns.values())
    unknowns = f"{listed(parts)}, {total} in all," if len(parts) > 1 else parts[0]
    numbers_given = counted(cause.numbers, "number")
    return f"too few measurements: {measured} {gives} {numbers_given}; {unknowns} must be determined"


def _local_optima(cause: LocalOptima, name: Namer) -> str:
    named = []
    for row in cause.parameters[:_MOST_AT_OPTIMA]:
        unit = "" if row.unit == "1" else row.unit
        here, there = (numbers.estimate(value, row.std, unit) for value in row.values)
        named.append(f"{name(row.name)} = {here} or {there}")
    more = len(cause.parameters) - len(named)
    count = "two" if cause.count == 2 else str(cause.count)
    values = ", ".join(named) + (f" and {more} more parameters" if more else "")
    return f"{count} local optima explain the data about equally well: {values}"


def _common_motion(cause: CommonMotion) -> str:
    k, turning = cause.joint, cause.revolute[-1]
    if not all(cause.little):
        about = (
            f"rotation about the axis of joint {k}" if turning else f"translation along the axis of joint {k}"
        )
        return (
            f"a {about} moves {'what is measured' if cause.frame else 'the target'} nearly the same way in"
            f" every measurement, although {_ranges(cause)}"
        )
    constant = max(cause.ranges) <= _CONSTANT
    how = "" if constant else "within the noise " if cause.hidden else ""
    so = (
        f"{how}an offset of joint {k} is {'' if constant or cause.hidden else 'nearly '}equivalent to a"
        f" {'rotation' if turning else 'translation'} of everything after joint {k - 1}, the"
        f" {'frame of the instrument' if cause.frame else 'target'} included"
    )
    is_pattern = cause.revolute == (True, True) and not cause.frame
    x_pattern = " (the X-Pattern of the paper)" if is_pattern else ""
    return f"{_little(cause)} over the measurements, so {so}{x_pattern}"


def _equivalent(cause: Equivalent) -> str:
    what = listed([_SHIFTED[group] for group in cause.shifted]) if cause.shifted else ""
    degree = "within the noise" if cause.hidden else "nearly"
    effect = f"the effect of a displacement of {what}" if what and cause.joints else "no effect"
    if not cause.joints:
        subject = f"a displacement of {what} has"
    elif len(cause.joints) == 1:
        subject = f"an offset of joint {cause.joints[0]} has"
    else:
        subject = f"offsets of joints {listed([str(i) for i in cause.joints])} together have"
    where = f" ({_little(cause)})" if any(cause.little) else ""
    return f"{subject} {degree} {effect} in these postures{where}"


def _ranges(cause: CommonMotion) -> str:
    """How far each joint before one varies: first those that vary much."""
    much = [i for i, little in enumerate(cause.little) if not little]
    few = f" ({_little(cause)})" if any(cause.little) else ""
    return f"{_vary(much, cause)}{few}"


def _little(cause: CommonMotion | Equivalent) -> str:
    """Which joints do not vary, or hardly."""
    hardly = [i for i, little in enumerate(cause.little) if little]
    still = [i for i in hardly if cause.ranges[i] <= _CONSTANT]
    parts = []
    if still:
        joints = listed([str(i + 1) for i in still])
        parts.append(
            f"joint {joints} does not change" if len(still) == 1 else f"joints {joints} do not change"
        )
    if moving := [i for i in hardly if i not in still]:
        parts.append(_vary(moving, cause, "only "))
    return " and ".join(parts)


def _vary(which: Sequence[int], cause: CommonMotion | Equivalent, only: str = "") -> str:
    """How far joints (from 0) vary."""
    sizes = [f"{numbers.significant(cause.ranges[i], 2)}{'°' if cause.revolute[i] else ' mm'}" for i in which]
    first, *rest = (f"joint {i + 1}{{}} by {only}{size}" for i, size in zip(which, sizes, strict=True))
    return listed([first.format(" varies"), *(each.format("") for each in rest)])


_MOST_TERMS = 6


def combination_words(combination: Mapping[str, float]) -> str:
    """A direction as a sum of parameters, weights in prior standard deviations, the largest first."""
    weights = sorted(combination.items(), key=lambda item: -abs(item[1]))
    terms = [
        ("" if i == 0 and weight > 0 else "+ " if weight > 0 else f"{numbers.MINUS} ")
        + ("" if abs(weight) == 1 else f"{numbers.significant(abs(weight), 2)}\u00a0")
        + label(name, 24)
        for i, (name, weight) in enumerate(weights[:_MOST_TERMS])
    ]
    more = len(weights) - _MOST_TERMS
    return " ".join(terms) + (f" and {more} smaller" if more > 0 else "")


def direction_kind(direction: NullDirection) -> str:
    """How badly the data determine a direction."""
    if direction.kind == "exact":
        return "exact null-space direction: no number of such measurements determines it"
    if direction.kind == "optima":
        return "not decided: the way from the best local optimum to another that explains the data as well"
    if direction.data_std is None or direction.data_std >= 1:
        return "not resolvable at this noise level: the prior is more precise than the data"
    share = numbers.significant(direction.data_std, 2)
    return f"{WEAK}: its uncertainty is {share} of the prior"


def rank_facts(facts: Identifiability) -> list[tuple[str, str]]:
    """Rank, condition number and observability indices, as names and texts."""
    rank = f"{facts.rank} of {facts.size} (whitened, scaled by the priors)"
    rank += "; singular, so no condition number" if facts.condition is None else ""
    rows = [("Rank of the Jacobian", rank)]
    if facts.condition is not None:
        rows.append(("Condition number", numbers.significant(facts.condition)))
    indices = {name: value for name, value in facts.observability.items() if value is not None}
    parts = [f"{shown(name)}\u00a0{numbers.significant(value)}" for name, value in indices.items()]
    text = ", ".join(parts)
    missing = [shown(name) for name in facts.observability if name not in indices]
    if missing:
        text += f"{'; ' if text else ''}{listed(missing)} not defined: the matrix is singular"
    return [*rows, ("Observability indices", text)] if text else rows


def over_target_sentence(check: Check) -> str | None:
    """What becomes of a plan if the target is not at its nominal place, by the offsets that it determines."""
    over = check.over_target
    if over is None:
        return None
    where = "the target anywhere within its stated sigma"
    if over.mounts:
        where = (
            "reflectors, mounts and targets where they may be (standard deviations of 50 mm and 30° where"
            " only guessed)"
        )
    hit = f"With {where} ({over.draws} draws), {numbers.percent(over.hit)} of the measurements hit"
    rows = [row for row in check.parameters if row.name in over.worst_std and row.std is not None]
    if not rows:
        return f"{hit}."
    worst = max(rows, key=lambda row: over.worst_std[row.name])
    u = numbers.spread(over.worst_std[worst.name], numbers.unit_of(worst.unit))
    of = "" if len(rows) == len(over.worst_std) else " of the offsets that are determined"
    largest = f"the largest standard uncertainty{of}, priors included, is that of {label(worst.name)}: {u}"
    typical = ". The predicted u of the plan are those at a typical place" if over.mounts else ""
    return f"{hit}, and {largest}{typical}."


def outlook_lines(check: Check) -> list[str]:
    """Which errors a run of a plan that passes detects and what it can hide, and the plan with the target
    elsewhere."""
    lines = list[str]()
    if check.verdict == "pass":
        lines += power_sentences(check.power)
        if (subject_to := condition(check.power)) is not None:
            lines.append(f"A pass of such a run holds {subject_to}.")
    over_target = over_target_sentence(check)
    return lines if over_target is None else [*lines, over_target]


def power_sentences(powers: Sequence[DetectionPower]) -> list[str]:
    """Which wrong models a run detects, and what of the others a pass can hide."""
    sure = (each for each in powers if each.hidden_size is None or each.hidden_size < each.size)
    noticed = [wrong_words(each) for each in sure if each.noticed]
    if not noticed:
        return remaining(powers)
    level = f"{100 * NOTICED:.0f} % or more"
    return [
        f"A run of this plan detects {listed(noticed)} with a probability of {level}.",
        *remaining(powers),
    ]


_OF_THE_RUN: frozenset[WrongModel] = frozenset({"jump", "drift", "moved"})  # that repeated postures show
# What a pass is subject to, by the wrong models with which a run may pass.
_CONDITIONS: tuple[tuple[frozenset[WrongModel], str], ...] = (
    (_OF_THE_RUN, "nothing changed"),
    (frozenset({"reading", "typing", "noise"}), "readings are right"),
)
_OF_GEOMETRY: frozenset[WrongModel] = frozenset({"arm", "tool", "beam"})


def condition(powers: Sequence[DetectionPower]) -> str | None:
    """What a pass is subject to, after "holds": the wrong models with which a run may pass and have wrong
    offsets are absent; and always the backlash of the run, since what is taken up from one side alone is a
    part of the offsets that no residual shows. None where no wrong model was looked at."""
    if not powers:
        return None
    may_be = {each.wrong for each in powers if each.dangerous}
    parts = [text for wrong, text in _CONDITIONS if may_be & wrong]
    of = "for this geometry and backlash" if may_be & _OF_GEOMETRY else "for this backlash"
    return f"{of}, if {listed(parts)}" if parts else of


_MOST_REMAINING = 3
_BY_ANOTHER_RUN = "compare with a second run (zerobeam compare)"


def _again(power: DetectionPower) -> str:
    if power.again >= 1:
        return _BY_ANOTHER_RUN
    return f"repeat {'more' if power.again else 'the first'} postures"


def _twice(power: DetectionPower) -> str:
    return _BY_ANOTHER_RUN if power.again >= 1 else "repeat all postures"


# What reveals wrong models, one remedy for each group; what repeats show by what can still be repeated.
_REVEALS: tuple[tuple[frozenset[WrongModel], str | Callable[[DetectionPower], str]], ...] = (
    (_OF_THE_RUN, _again),
    (frozenset({"reading", "typing"}), _twice),
    (frozenset({"backlash"}), "come to every posture from the same side"),
    (frozenset({"noise"}), "estimate the noise"),
    (frozenset({"arm"}), "measure more postures"),
    (frozenset({"tool", "beam"}), "measure the mounting"),
)


def remaining(powers: Sequence[DetectionPower]) -> list[str]:
    """What a pass does not exclude of what does harm, the most harmful first: what to do where it may be, and
    what it does else."""
    sentences: list[tuple[float, str]] = []
    for wrong, remedy in _REVEALS:
        rows = [each for each in powers if each.dangerous and each.wrong in wrong and harm(each) > 0]
        if rows:
            worst = max(rows, key=harm)
            reveals = remedy if isinstance(remedy, str) else remedy(worst)
            sentences.append((harm(worst), _hidden_words(worst, reveals)))
    return [text for _, text in sorted(sentences, key=lambda one: -one[0])][:_MOST_REMAINING]


def _hidden_words(power: DetectionPower, remedy: str) -> str:
    """What reveals what a pass can hide, and what that does."""
    assert power.hidden_size is not None
    assert power.hidden_offset is not None
    size = float(f"{power.hidden_size:.2g}")
    offset = numbers.significant(power.hidden_offset, 2, "deg")
    at_tcp = power.hidden_tcp_mm
    mm = "" if at_tcp is None else f", TCP {numbers.significant(at_tcp, 2, 'mm')}"
    return f"{capital(remedy)}: {wrong_words(power, size, power.hidden_joint)} can hide: {offset}{mm}."


# Wrong models as nouns; a size without a unit is so many "times".
_WRONG: dict[WrongModel, str] = {
    "tool": "a tool {size} off",
    "beam": "a beam {size} off its direction",
    "arm": "links {size} their tolerances",
    "jump": "a {size} jump of J{joint}’s zero",
    "drift": "a {size} drift of J{joint}’s zero",
    "moved": "a target moved {size}",
    "reading": "one reading {size} off",
    "typing": "one joint value {size} off",
    "backlash": "backlash of {size} either way",
    "noise": "noise {size} the stated",
}


def no_plan_sentence(powers: Sequence[DetectionPower]) -> str | None:
    """The wrong models that no plan detects, of those that do harm."""
    missed = [wrong_words(each) for each in powers if each.harmful]
    return f"No plan with this tool and target detects {listed(missed)}." if missed else None


def power_limit(powers: Sequence[DetectionPower]) -> str:
    """The limit of a plan that determines every offset: what its run may not detect."""
    return f"the power: a run may not detect {listed([_missed_words(each) for each in powers])}"


def _missed_words(power: DetectionPower) -> str:
    return (
        f"{wrong_words(power)} (probability {100 * power.probability:.0f} %, error of an offset up to"
        f" {numbers.significant(power.off_u, 2)} u)"
    )


def wrong_words(power: DetectionPower, size: float | None = None, joint: int | None = None) -> str:
    """The wrong model as a noun, by default of the size and joint that the power is of."""
    amount = numbers.exact(power.size if size is None else size, numbers.unit_of(power.unit))
    return _WRONG[power.wrong].format(size=amount, joint=joint or power.joint)
