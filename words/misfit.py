"""A misfit in words: what speaks against the model, what that means for the answer, what may explain it."""

from __future__ import annotations

from ..analysis.diagnostics.diagnosis import Explanation
from ..analysis.misfit import (
    BeyondPrior,
    Criterion,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    OffPrior,
    PlacementsDisagree,
)
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .numbers import p_words, times
from .wording import Namer, clipped, listed

UNVALIDATED = "no estimate or uncertainty of this run is validated"
_MOST_NAMED = 8
_LEVEL = f"{100 * (1 - 2 * LACK_OF_FIT):.1f} %"
_NOISE = {"all": "estimated noise", "joint": "estimated noise of the joints", "spot": "estimated spot noise"}


def criterion_sentence(criterion: Criterion, name: Namer = str) -> str:
    """One criterion, without a full stop at its end; `name` writes names."""
    match criterion:
        case LackOfFit(with_priors=True):
            return (
                f"Residuals and priors together are larger than noise and priors allow (χ²"
                f" {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}): noise, priors or"
                " geometry are not as stated, or the best fit was not found. Add measurements, so that it"
                " can be checked"
            )
        case LackOfFit():
            rms = "" if criterion.rms_mm is None else f"; {criterion.rms_mm:.2f} mm rms"
            return (
                f"Lack of fit: residuals are {times(criterion.factor)} times the stated noise"
                f" (χ² {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}{rms}): the"
                f" {criterion.geometry} geometry does not describe this arm, a column, sign, zero, unit,"
                " target or measurement is not as stated, or the noise is understated"
            )
        case ImplausibleNoise(of, factor, interval, plausible):
            low, high = (times(end) for end in interval)
            bound = f"{plausible:g} times" if factor > 1 else f"1/{plausible:g} of"
            side = "above" if factor > 1 else "below"
            return (
                f"The {_NOISE[of]} is {times(factor)} times the stated ({_LEVEL} interval {low} to {high}),"
                f" {side} the {bound} that noise.plausible_factor allows: the model does not describe these"
                " measurements, or the stated noise is wrong"
            )
        case BeyondPrior(parameters, limit):
            named, one = (
                listed([_off(parameter, name) for parameter in parameters], _MOST_NAMED),
                len(parameters) == 1,
            )
            return (
                f"{named} {'is' if one else 'are'} beyond {limit:g} prior standard deviations: the model does"
                f" not describe this arm, or {'this prior is' if one else 'these priors are'} too narrow"
            )
        case PlacementsDisagree():
            count = len(criterion.placements)
            return (
                f"The placements disagree: the offsets that each of the {count} would have alone differ by"
                f" {times(criterion.factor)} times what the scatter within them explains (F({criterion.rank},"
                f" {criterion.dof}), {p_words(criterion.p_value)}), most of all at {criterion.most}: the"
                f" {criterion.geometry} geometry does not describe this arm, or a placement is wrong"
            )


def misfit_headline(misfit: Misfit, name: Namer = str) -> str:
    """What is wrong, first of all; the first criterion, and what follows for the answer."""
    first = criterion_sentence(misfit.criteria[0], name).removeprefix("Lack of fit: ")
    more = len(misfit.criteria) - 1
    also = f" {more} more {'criterion says' if more == 1 else 'criteria say'} so." if more else ""
    return f"{first[0].upper()}{first[1:]}.{also} {UNVALIDATED[0].upper()}{UNVALIDATED[1:]}."


def _off(parameter: OffPrior, name: Namer) -> str:
    return (
        name(parameter.name)
        if parameter.stds is None
        else f"{name(parameter.name)} ({parameter.stds:+.1f})".replace("(-", f"({numbers.MINUS}")
    )


_MOST_MEASUREMENTS = 10
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


def explanation_sentence(tried: Explanation) -> str:
    """What is changed, and what that leaves: without a full stop."""
    left = f"{times(tried.factor)} times the noise instead of {times(tried.before)}"
    if tried.factor > _LESS * tried.before:
        left = (
            f"the estimates are within {numbers.significant(tried.farthest, 2)} prior standard deviations"
            f" instead of {times(tried.farthest_before)}; residuals {times(tried.factor)} times the noise"
        )
    return f"{changed(tried)}: {left}"


def changed(explanation: Explanation) -> str:
    """What is different under this explanation."""
    joints = [f"J{joint}" for joint in explanation.joints]
    targets = [clipped(name) for name in explanation.targets]
    match explanation.cause:
        case "swapped_joints":
            return f"with {listed(joints)} exchanged"
        case "sign":
            return f"with the sign of {joints[0]} reversed"
        case "zero":
            how = "added to" if explanation.amount > 0 else "subtracted from"
            quarter = explanation.amount % 90 == 0
            by = (
                numbers.exact(abs(explanation.amount))
                if quarter
                else numbers.significant(abs(explanation.amount))
            )
            return f"with {numbers.with_unit(by, 'deg')} {how} {joints[0]}"
        case "units":
            if explanation.amount > 1:
                return "with the joint angles read as radians"
            return "with the joint angles divided by 57.3 (converted from radians to degrees twice)"
        case "coupling":
            how = "added to" if explanation.amount > 0 else "subtracted from"
            return f"with {joints[0]} {how} {joints[1]} (coupled joints)"
        case "twist":
            if len(joints) == 1:
                return f"with the sign of the twist from {joints[0]} to the flange reversed in the robot file"
            return f"with the sign of the twist from {joints[0]} to {joints[1]} reversed in the robot file"
        case "placement":
            return f"without the measurements at {listed(targets)}"
        case "measurements":
            noun = "measurement" if len(explanation.measurements) == 1 else "measurements"
            return f"without {noun} {listed([str(n) for n in explanation.measurements], _MOST_NAMED)}"
        case "moved_target":
            return (
                f"with {targets[0]} moved between measurements {explanation.measurements[0]} and"
                f" {explanation.measurements[1]}"
            )
        case "geometry":
            return "with link geometry estimated"


def diagnosis_said(explanations: tuple[Explanation, ...]) -> str:
    """How far to trust the explanations of a result; there is at least one."""
    if not explanations[0].agrees:
        return "None of these alone explains the residuals to the noise: something else is wrong too."
    if len(explanations) > 1:
        return "The measurements do not decide between these: check each. Nothing was applied."
    return "No other cause that was tried explains the residuals as well. Nothing was applied."
