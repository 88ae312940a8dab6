"""What postures of a plan break, and what else a check found, in words."""

from __future__ import annotations

from ..analysis.observability.check import (
    Check,
    Condition,
    OutsideLimits,
    PlanFinding,
    TargetBehind,
    Unreachable,
    Violation,
)
from . import numbers
from .wording import listed

_BROKEN: dict[Condition, str] = {
    "behind": "the target is behind the laser",
    "itself": "the arm hits itself",
    "cell": "the arm hits the floor or a box",
    "beam": "a box is in the beam's way",
    "sight": "a box is in the line of sight",
}


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
        planned = ", before the wrist is rotated onto the target" if violation.planned else ""
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
    return (
        *map(violation_sentence, check.violations),
        *map(plan_sentence, check.findings),
        *check.warnings,
    )


def violation_sentence(violation: Violation) -> str:
    """What a posture breaks, with its number."""
    unseen = ": no measurement is counted there" if violation.unseen else ""
    return f"Posture {violation.posture}: {violation_words(violation)}{unseen}"


def plan_sentence(finding: PlanFinding) -> str:
    """A finding of a check, without a full stop."""
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
                f"Rotated onto the target, joint {joint} of posture {posture} is at {at:.1f} {unit}, outside"
                f" {low:.0f} to {high:.0f}{counting and f' ({counting})'}"
            )
