"""Observability in words: why the data do not determine a parameter or a combination, what to do about it,
and a plan's outlook.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..analysis.observability.causes import (
    AsGoodAs,
    BaseFrame,
    Cause,
    CommonMotion,
    Held,
    LocalOptima,
    NoiseSplit,
    NotResolvable,
    NotTheModel,
    NullDirection,
    OnAxis,
    OnePosition,
    ParallelAxes,
    TargetUnseen,
    ToleranceOnly,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    Unconverged,
    Unexplained,
    WithinTolerances,
)
from ..analysis.observability.check import Check
from ..analysis.observability.identifiability import Identifiability
from ..analysis.observability.outlook import Advice, OverTarget
from ..analysis.observability.power import LIMIT_U, NOTICED, DetectionPower, WrongModel
from ..model.instruments.kind import Assumption
from ..model.instruments.registry import TOOLS, kind_of
from ..model.likelihood.parameters import Group
from . import numbers
from .wording import Namer, be, clipped, counted, label, listed, shown

_BASE_FRAME = (
    "joint 1 defines the base frame: a rotation of it together with every target changes no measurement"
    " (section 3.3)"
)
_MOST_AT_OPTIMA = 3
_SEEN_DEG = 0.001  # of axes that are said to be parallel within an angle
_TOOL_ROTATION = "a rotation of the last joint is equivalent to one of the uncalibrated tool (section 3.1)"
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


def reason(cause: Cause, name: Namer = str) -> str:
    """Why, as what can follow a colon; `name` writes names of parameters and targets."""
    match cause:
        case Held(by="base frame") | BaseFrame():
            return _BASE_FRAME
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
                f" {numbers.exact(known_to, numbers.unit_of(words.unit))} ({_sigma_of(tool)})"
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
            return "the model does not describe the measurements"
        case NotResolvable():
            return "not resolvable at this noise level"
        case AsGoodAs():
            return _as_good_as(cause)
        case ToleranceOnly():
            return "prior only: the measurements say no more of it than its tolerance"
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
                f"the axes of joints {first} and {second} stay parallel{within}, so that the measurements do"
                " not separate their offsets"
            )
        case ToolAgainstTarget():
            return "the tool rotates too little over the measurements to be separated from the target"
        case TooFewMeasurements():
            return f"too few measurements: {_counts(cause)}"
        case OnePosition():
            return "all measurements are at one position, and a motion that keeps it is free"
        case LocalOptima():
            return _local_optima(cause, name)
        case Unexplained():
            return "no known mechanism"


def remedy(cause: Cause, name: Namer = str) -> str:
    """What to do, as an imperative without a full stop."""
    match cause:
        case Held(by="base frame") | BaseFrame():
            return f"hold {name('delta1')} (the default): it is a choice of base frame and costs no accuracy"
        case Held(by="header"):
            return "leave it out of held to estimate it"
        case Held(by="first link"):
            return "nothing: it is a choice of base frame and costs no accuracy"
        case Held(by="free tool"):
            return "nothing: it is part of the tool, which is estimated"
        case ToolRotation(tool, joint, float()):
            return (
                f"calibrate the tool better and state its {_sigma_of(tool)}, or hold {name(f'delta{joint}')}"
            )
        case Held() | ToolRotation():
            last = name(f"delta{cause.joint}") if isinstance(cause, ToolRotation) else "the last offset"
            return f"hold {last}, or calibrate the tool separately and state it as calibrated"
        case Unconverged():
            return "look for a wrong measurement, or state a better guess of target and tool"
        case NotTheModel():
            return "find what is wrong first: joint columns, signs, zeros, units, targets, geometry"
        case NotResolvable():
            return "add measurements, or measure with less noise"
        case AsGoodAs(of):
            return stating(of)
        case ToleranceOnly():
            return "add measurements in postures that differ in the joints around it"
        case WithinTolerances():
            return (
                "add measurements in postures that differ in every joint, or state smaller tolerances where"
                " geometry or tool were measured"
            )
        case TargetUnseen(target, _):
            return f"add measurements of {name(target)} from other directions"
        case NoiseSplit():
            return "state one of the two, or add measurements with shorter and longer beams"
        case OnAxis(tool, joint):
            return (
                f"mount the tool so that the {kind_of(tool).words.part} is off the axis of joint {joint}, or"
                f" hold {name(f'delta{joint}')}"
            )
        case CommonMotion():
            return _vary(cause)
        case ParallelAxes(_, second, _):
            return (
                f"add measurements that differ in the joints up to {second}: vary joint {second} by 30°"
                " or more"
            )
        case ToolAgainstTarget():
            return "add measurements with the wrist at very different angles"
        case TooFewMeasurements(needed=needed):
            return f"record at least {needed} measurements in varied postures, better twice as many"
        case OnePosition():
            return "add measurements of a second target, some hundred millimetres away"
        case LocalOptima():
            return "add measurements in postures that differ in every joint, until one optimum is left"
        case Unexplained():
            return "add measurements in postures that differ in every joint, then check again"


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
    if cause.stated:
        stated = [
            f"the stated {one.part} of {f'the {one.kind}' if one.label == 'tool' else clipped(one.label)}"
            for one in cause.of
        ]
        return f"by {listed(list(dict.fromkeys(stated)))}: {listed(sizes)}"
    if not sizes:
        return f"as good as {listed(parts)}: that it is exactly as stated is assumed, not measured"
    return f"as good as {listed(parts)}: {listed(sizes)} {be(sizes)} assumed, not stated or measured"


def stating(of: Sequence[Assumption]) -> str:
    """What to do about what an offset rests on, as an imperative."""
    parts, keys = (list(dict.fromkeys(each)) for each in (map(part_of, of), (one.key for one in of)))
    if all(one.part == "frame" for one in of):
        return f"measure {listed(parts)}, or state it as free and hold the first offset"
    return f"measure {listed(parts)} and state {listed(keys)}"


def _counts(cause: TooFewMeasurements) -> str:
    """What measurements give and what they must determine."""
    measured = counted(cause.measurements, "measurement")
    ties = ((cause.distances, "stated distance"), (cause.angles, "stated angle"))
    measured = listed([measured, *(counted(count, what) for count, what in ties if count)])
    gives = "gives" if cause.measurements + cause.distances + cause.angles == 1 else "give"
    parts = [counted(count, _UNKNOWN[group]) for group, count in cause.unknowns.items()]
    total = sum(cause.unknowns.values())
    unknowns = f"{listed(parts)}, {total} in all," if len(parts) > 1 else parts[0]
    return f"{measured} {gives} {counted(cause.numbers, 'number')}; {unknowns} must be determined"


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


def _before(cause: CommonMotion) -> str:
    last = cause.joint - 1
    return "joint 1" if last == 1 else "joints 1 and 2" if last == 2 else f"joints 1 to {last}"


def _common_motion(cause: CommonMotion) -> str:
    k = cause.joint
    turning = cause.revolute[-1]
    before, one = _before(cause), k == 2
    motion = "rotation" if turning else "translation"
    so = (
        f"an offset of joint {k} is equivalent to a {motion} of everything after joint {k - 1}, the target"
        " included"
    )
    x_pattern = " (the X-Pattern of section 3.2)" if one and cause.revolute == (True, True) else ""
    if cause.constant:
        return f"{before} {'does' if one else 'do'} not change over the measurements, so {so}{x_pattern}"
    parts = []
    if cause.range_deg is not None:
        parts.append(f"{numbers.significant(cause.range_deg, 2)}°")
    if cause.range_mm is not None:
        parts.append(f"{numbers.significant(cause.range_mm, 2)} mm")
    ranges = " and ".join(parts)
    verb = "varies" if one else "vary"
    if cause.nearly_constant:
        return (
            f"{before} {verb} by no more than {ranges} over the measurements, so within the noise"
            f" {so}{x_pattern}"
        )
    about = f"rotation about the axis of joint {k}" if turning else f"translation along the axis of joint {k}"
    return (
        f"a {about} moves the target nearly the same way in every measurement, although {before} {verb} by"
        f" up to {ranges}"
    )


def _vary(cause: CommonMotion) -> str:
    if cause.constant or cause.nearly_constant:
        amount = "30° or more" if all(cause.revolute[:-1]) else "a third of the range or more"
        return f"vary {_before(cause)} by {amount} between measurements"
    return f"add measurements with the axis of joint {cause.joint} at very different places or angles"


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
        return "not resolvable at this noise level: the data say less than the prior"
    share = numbers.significant(direction.data_std, 2)
    return f"weakly observable: its uncertainty is {share} of the prior"


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


def advice_sentence(advice: Advice) -> str:
    """The change of a plan that helps most."""
    what = "as one more measurement" if advice.add else "in its place"
    return (
        f"The single change that helps most: posture {advice.posture} with joint {advice.joint} rotated"
        f" by {numbers.exact(advice.change_deg, advice.unit)}, {what}: the largest standard"
        f" uncertainty, priors included, falls from {numbers.spread(advice.worst_std_before, advice.unit)}"
        f" to {numbers.spread(advice.worst_std_after, advice.unit)}."
    )


def over_target_sentence(over: OverTarget, units: Mapping[str, str]) -> str:
    """What becomes of a plan if the target is not at its nominal place; `units` by parameter."""
    name, worst = max(over.worst_std.items(), key=lambda item: item[1])
    return (
        f"With the target anywhere within its stated sigma ({over.draws} draws), {over.hit:.0%} of the"
        f" measurements hit, and the largest standard uncertainty, priors included, is that of {label(name)}:"
        f" {numbers.spread(worst, units[name])}."
    )


def outlook_lines(check: Check) -> list[str]:
    """Which errors a run of the plan detects, the change of the plan that helps most, and the plan with the
    target elsewhere."""
    lines = power_sentences(check.power)
    if check.verdict == "pass" and (subject_to := condition(check.power)) is not None:
        lines.append(f"A pass of such a run holds if {subject_to}.")
    lines += [] if check.advice is None else [advice_sentence(check.advice)]
    if check.over_target is not None:
        units = {row.name: numbers.unit_of(row.unit) for row in check.parameters}
        lines.append(over_target_sentence(check.over_target, units))
    return lines


def power_sentences(powers: Sequence[DetectionPower]) -> list[str]:
    """Which wrong models a run detects, and the errors of the offsets by those that it may not detect and
    that do harm."""
    noticed = [wrong_words(each) for each in powers if each.noticed]
    missed = [_missed_words(each) for each in powers if each.harmful]
    level = f"{100 * NOTICED:.0f} % or more"
    sentences = (
        [f"A run of this plan detects {listed(noticed)} with a probability of {level}."] if noticed else []
    )
    return [*sentences, *([f"A run of this plan may not detect {listed(missed)}."] if missed else [])]


_MOST_MISSED = 6
_OF_THE_RUN: frozenset[WrongModel] = frozenset({"jump", "drift", "moved"})  # that repeated postures show
# What a pass is subject to, by the wrong models with which a run may pass.
_CONDITIONS: tuple[tuple[frozenset[WrongModel], str], ...] = (
    (_OF_THE_RUN, "nothing changed during the run"),
    (frozenset({"reading", "backlash", "noise"}), "the readings are right to their stated noise"),
    (frozenset({"arm", "tool", "beam"}), "the arm and the tool are within their tolerances"),
)


def condition(powers: Sequence[DetectionPower]) -> str | None:
    """What a pass is subject to, after "if": the wrong models with which a run may pass and have wrong
    offsets are absent. None where there is none."""
    may_be = {each.wrong for each in powers if each.dangerous}
    parts = [text for wrong, text in _CONDITIONS if may_be & wrong]
    return listed(parts) if parts else None


def unnoticed_sentence(powers: Sequence[DetectionPower]) -> str | None:
    """The wrong models with which a run may pass and have wrong offsets, each at its worst size."""
    missed = [
        f"{wrong_words(replace(each, size=float(f'{each.worst_size:.2g}')))} ({100 * each.risk:.0f} %)"
        for each in powers
        if each.dangerous and each.worst_size is not None
    ]
    if not missed:
        return None
    text = (
        "A pass does not exclude the following (in brackets: the share of such runs that pass with an offset"
        f" wrong by more than {LIMIT_U:g} standard uncertainties): {listed(missed, _MOST_MISSED)}."
    )
    if any(each.dangerous and each.wrong in _OF_THE_RUN for each in powers):
        text += " The first postures, measured again at the end of a run, show what changed during it."
    return text


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


def wrong_words(power: DetectionPower) -> str:
    """The wrong model as a noun."""
    size = numbers.exact(power.size, numbers.unit_of(power.unit))
    match power.wrong:
        case "tool":
            return f"a tool {size} off"
        case "beam":
            return f"a beam {size} off its direction"
        case "arm":
            return f"an arm {numbers.exact(power.size)} times its tolerances off"
        case "drift":
            return f"a drift of {size} in the zero of joint {power.joint}"
        case "reading":
            return f"one reading {size} off"
        case "moved":
            return f"a target moved by {size}"
        case "jump":
            return f"a jump of {size} in the zero of joint {power.joint}"
        case "backlash":
            return f"backlash of {size}"
        case "noise":
            return f"a noise {numbers.exact(power.size)} times the stated noise"
