"""Verdicts and what a check says of a plan, in words: each sentence is made here, and nowhere read back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ..analysis.observability.causes import AsGoodAs, NullDirection, worst_direction
from ..analysis.observability.check import (
    Check,
    Condition,
    OutsideLimits,
    PlanFinding,
    PlanVerdict,
    TargetBehind,
    Unreachable,
    Violation,
)
from ..analysis.status import Status, Verdict
from . import numbers
from .observability import reason, stating
from .wording import Namer, be, counted, listed

VERDICT_WORDS: dict[PlanVerdict, str] = {
    "pass": "Pass",
    "weak": "Weak",
    "degenerate": "Degenerate",
    "misfit": "Misfit",
    "violated": "Constraints violated",
}
_BROKEN: dict[Condition, str] = {
    "behind": "the target is behind the laser",
    "itself": "the arm hits itself",
    "cell": "the arm hits the floor or a box",
    "beam": "a box is in the beam's way",
    "sight": "a box is in the line of sight",
}


class _WithStatus(Protocol):
    """A parameter of a result, of a check, of a run that is not finished."""

    @property
    def name(self) -> str: ...
    @property
    def group(self) -> str: ...
    @property
    def status(self) -> Status: ...


def resting(rows: Sequence[_WithStatus], name: Namer = str) -> list[str]:
    """What offsets rest on besides the measurements, a sentence for each reason: what is assumed, then what
    is stated."""
    grouped: dict[tuple[bool, str], list[str]] = {}
    for row in rows:
        cause = getattr(row, "cause", None)
        if isinstance(cause, AsGoodAs) and row.status in ("assumed", "identified"):
            grouped.setdefault((cause.by_header, reason(cause, name)), []).append(row.name)
    return [
        f"{_are(names, name)} {'identified ' if by_header else ''}{why}."
        for (by_header, why), names in sorted(grouped.items())
    ]


def assumed_steps(rows: Sequence[_WithStatus], name: Namer = str) -> list[str]:
    """What to do to determine the offsets that are as good as what is assumed, a sentence for each reason."""
    grouped: dict[str, list[str]] = {}
    for row in rows:
        cause = getattr(row, "cause", None)
        if row.status == "assumed" and isinstance(cause, AsGoodAs):
            grouped.setdefault(stating(cause.of), []).append(name(row.name))
    return [f"To determine {listed(names)}: {what}" for what, names in grouped.items()]


def verdict_sentence(
    parameters: Sequence[_WithStatus], null_space: Sequence[NullDirection], name: Namer = str
) -> str:
    """What can be said of the offsets, the gravest first."""

    def offsets(status: Status) -> list[str]:
        return [row.name for row in parameters if row.group == "offset" and row.status == status]

    unknown, weak, identified = offsets("unidentifiable"), offsets("weak"), offsets("identified")
    unvalidated, rows = offsets("unvalidated"), [row for row in parameters if row.group == "offset"]
    sentences = []
    if unknown:
        reasons = dict.fromkeys(
            reason(worst_direction(null_space, parameter).cause, name) for parameter in unknown
        )
        sentences.append(
            f"{_are(unknown, name)} unidentifiable from these measurements: {'; '.join(reasons)}."
        )
    if weak:
        sentences.append(f"{_are(weak, name)} only weakly observable in these measurements.")
    if identified:
        sentences.append(f"{_are(identified, name)} identified.")
    sentences += resting(rows, name)
    if unvalidated:
        sentences.append(f"{_are(unvalidated, name)} unvalidated.")
    return " ".join(sentences) or "No offset is estimated: all are held."


def _are(names: list[str], name: Namer) -> str:
    return f"{listed([name(each) for each in names])} {be(names)}"


def tone_of(verdict: PlanVerdict) -> Verdict:
    """The verdict of a run whose colour and mark a verdict on a plan has."""
    return "misfit" if verdict == "violated" else verdict


def check_headline(check: Check, name: Namer = str) -> str:
    """What a plan will determine, in one or two sentences; `name` writes names. Broken constraints first."""
    determined = verdict_sentence(check.parameters, check.identifiability.null_space, name)
    if not check.violations:
        return determined
    broken = len({each.posture for each in check.violations})
    first = check.violations[0]
    unseen = all(any(each.unseen for each in posture.violations) for posture in check.postures)
    return (
        f"{broken} of {counted(len(check.postures), 'posture')} {'break' if broken > 1 else 'breaks'} the"
        f" constraints of the plan, first posture {first.posture}: {violation_words(first)}."
        f" {'No posture gives a measurement; if each did: ' if unseen else ''}{determined}"
    )


def violation_words(violation: Violation) -> str:
    """What a posture breaks of its plan's constraints, without the posture's number."""
    at_value, lowest, highest = violation.at, violation.lowest, violation.highest
    where = "" if violation.via is None else f"intermediate posture {violation.via}: "
    if violation.why is not None:
        return f"{where}{violation.why}"
    if violation.condition == "arm" and at_value is not None and lowest is not None:
        link = f"link {violation.joint}" if violation.joint else "the base"
        apart, radius = (numbers.exact(round(value), "mm") for value in (at_value, lowest))
        assumed = ", assumed: state it by `bodies` of the robot file" if violation.assumed else ""
        return (
            f"{where}{link} of the arm is in the way: the line to the target passes {apart} from its axis"
            f" (radius {radius}{assumed})"
        )
    if at_value is None or lowest is None or highest is None:
        planned = ", before the wrist is turned onto the target" if violation.planned else ""
        return f"{where}{_BROKEN[violation.condition]}{planned}"
    unit = violation.unit or ""
    at, low, high = (numbers.exact(round(value, 2), unit) for value in (at_value, lowest, highest))
    match violation.condition:
        case "facing":
            side = "from behind, " if at_value > 90 else ""
            return f"the beam meets the target's face {side}at {at} to its normal (at most {high} allowed)"
        case "beam_mm" if at_value <= 0:
            return _BROKEN["behind"]
        case "beam_mm":
            return f"the beam is {at} long ({low} to {high} allowed)"
        case _:
            return f"joint {violation.joint} is at {at}; with the margin its limits are {low} to {high}"


def check_notes(check: Check) -> tuple[str, ...]:
    """Broken constraints and findings of a plan and the warnings of its file, as sentences without a full
    stop."""
    broken = (
        f"Posture {each.posture}: {violation_words(each)}"
        + (": no measurement is counted there" if each.unseen else "")
        for each in check.violations
    )
    return (*broken, *(_plan_sentence(finding) for finding in check.findings), *check.warnings)


def _plan_sentence(finding: PlanFinding) -> str:
    match finding:
        case Unreachable(postures):
            return (
                f"From posture {listed([str(i) for i in postures], 99)} the target cannot be hit: no"
                " measurement is counted there"
            )
        case TargetBehind(_, every=True):
            return "Every target is behind the laser: is the sign of tool.direction right?"
        case TargetBehind(postures, _):
            return (
                f"In posture {listed([str(i) for i in postures], 99)} the target is behind the laser: no"
                " measurement is counted there"
            )
        case OutsideLimits(posture, joint, at, unit, (low, high), counting):
            return (
                f"Turned onto the target, joint {joint} of posture {posture} is at {at:.1f} {unit}, outside"
                f" {low:.0f} to {high:.0f}{counting and f' ({counting})'}"
            )
