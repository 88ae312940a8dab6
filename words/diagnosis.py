"""What may explain a misfit, in words."""

from __future__ import annotations

from ..analysis.diagnostics.diagnosis import Explanation
from . import numbers
from .numbers import times
from .wording import clipped, listed

_MOST_NAMED = 10
_LESS = 0.9  # of the residuals, above which it is the estimates that a cause explains

CAUSES = {
    "swapped_joints": "joint columns exchanged",
    "sign": "sign of a joint",
    "zero": "zero of a joint",
    "units": "unit of the angles",
    "coupling": "coupled joints",
    "twist": "sign of a twist",
    "placement": "one placement",
    "measurements": "single measurements",
    "moved_target": "moved target",
    "geometry": "link geometry",
}


def explanation_sentence(found: Explanation) -> str:
    """What is changed, and what that leaves: without a full stop."""
    left = f"{times(found.factor)} times the noise instead of {times(found.before)}"
    if found.factor > _LESS * found.before:
        left = (
            f"the estimates are within {numbers.significant(found.farthest, 2)} prior standard deviations"
            f" instead of {times(found.farthest_before)}; residuals {times(found.factor)} times the noise"
        )
    return f"{changed(found)}: {left}"


def changed(found: Explanation) -> str:
    """What is different under this explanation."""
    joints = [f"J{joint}" for joint in found.joints]
    targets = [clipped(name) for name in found.targets]
    match found.cause:
        case "swapped_joints":
            return f"with {listed(joints)} exchanged"
        case "sign":
            return f"with the sign of {joints[0]} reversed"
        case "zero":
            how = "added to" if found.amount > 0 else "subtracted from"
            quarter = found.amount % 90 == 0
            by = numbers.exact(abs(found.amount)) if quarter else numbers.significant(abs(found.amount))
            return f"with {numbers.with_unit(by, 'deg')} {how} {joints[0]}"
        case "units":
            if found.amount > 1:
                return "with the joint angles read as radians"
            return "with the joint angles divided by 57.3 (converted from radians to degrees twice)"
        case "coupling":
            how = "added to" if found.amount > 0 else "subtracted from"
            return f"with {joints[0]} {how} {joints[1]} (coupled joints)"
        case "twist":
            if len(joints) == 1:
                return f"with the sign of the twist from {joints[0]} to the flange reversed in the robot file"
            return f"with the sign of the twist from {joints[0]} to {joints[1]} reversed in the robot file"
        case "placement":
            return f"without the measurements at {listed(targets)}"
        case "measurements":
            noun = "measurement" if len(found.measurements) == 1 else "measurements"
            return f"without {noun} {listed([str(n) for n in found.measurements], _MOST_NAMED)}"
        case "moved_target":
            return (
                f"with {targets[0]} moved between measurements {found.measurements[0]} and"
                f" {found.measurements[1]}"
            )
        case "geometry":
            return "with link geometry estimated"


def diagnosis_said(found: tuple[Explanation, ...]) -> str:
    """How far to trust the explanations of a result; there is at least one."""
    if not found[0].agrees:
        return "None of these alone explains the residuals to the noise: something else is wrong too."
    if len(found) > 1:
        return "The measurements do not decide between these: check each. Nothing was applied."
    return "No other cause that was tried explains the residuals as well. Nothing was applied."
