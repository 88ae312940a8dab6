"""A misfit in words: what speaks against the model, what that means for the answer, what may explain it."""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.diagnostics.diagnosis import Explanation
from ..analysis.displacement import Displacement
from ..analysis.misfit import (
    BeyondPrior,
    Criterion,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    OffPrior,
    PlacementsDisagree,
)
from ..analysis.recordings.steps import RecordingStep
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .numbers import p_words, times
from .wording import Namer, capital, clipped, listed

UNVALIDATED = "no estimate or uncertainty of this run is validated"
_MOST_NAMED = 8
_MOST_ALTERNATIVES = 3
_NEVER = 1e-12  # a p-value below this says nothing more: no noise is so normal
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
        case Displacement():
            return displacement_sentence(criterion)
        case RecordingStep():
            return step_sentence(criterion)


def misfit_headline(misfit: Misfit, name: Namer = str) -> str:
    """What is wrong, first of all; the first criterion, and what follows for the answer."""
    first = criterion_sentence(misfit.criteria[0], name).removeprefix("Lack of fit: ")
    more = len(misfit.criteria) - 1
    also = f" {more} more {'criterion says' if more == 1 else 'criteria say'} so." if more else ""
    return f"{capital(first)}.{also} {capital(UNVALIDATED)}."


def displacement_sentence(moved: Displacement) -> str:
    """Which target moved, when and how far, without a full stop."""
    p_value = f"= {moved.p_value:.0e}" if moved.p_value > _NEVER else f"< {_NEVER:.0e}"
    others = [
        f"{point.target} moved between {point.after_shot} and {point.before_shot}"
        for point in moved.elsewhere[:_MOST_ALTERNATIVES]
    ]
    if moved.alone is not None:
        others.append(f"measurement {moved.alone} alone is wrong")
    doubt = f"; nearly as likely: {', or '.join(others)}" if others else ""
    return (
        f"Target {clipped(moved.at.target)} seems to have moved{_by(moved)} between measurements"
        f" {moved.at.after_shot} and {moved.at.before_shot} (p {p_value}){doubt}"
    )


def _by(moved: Displacement) -> str:
    if moved.size_mm is not None and moved.size_std_mm is not None:
        return f" by {moved.size_mm:.1f} ± {moved.size_std_mm:.1f} mm"
    along = [
        f"{shift:.1f} ± {std:.1f} mm along {axis}"
        for axis, shift, std in zip("xyz", moved.shift_mm, moved.std_mm, strict=True)
        if shift is not None and std is not None
    ]
    return f" by {' and '.join(along)}" if along else ""


def step_sentence(step: RecordingStep) -> str:
    """Which measurements of a recording are off together, without a full stop."""
    shots = measurements(step.first_shot, step.last_shot)
    size = "" if step.size_mm is None else f" by {numbers.significant(step.size_mm, 2, 'mm')}"
    return (
        f"Target {clipped(step.target)} seems to have slipped: {shots} are off"
        f" the rest of its recording{size} ({p_words(step.p_value)}, Holm-adjusted)"
    )


def measurements(first: int, last: int) -> str:
    """Measurements from a number to another, by both."""
    return f"measurement {first}" if first == last else f"measurements {first} to {last}"


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
    if _explains_estimates(tried):
        left = f"{_estimates_within(tried)}; residuals {times(tried.factor)} times the noise"
    return f"{changed(tried)}: {left}"


def _explains_estimates(tried: Explanation) -> bool:
    return tried.factor > _LESS * tried.before


def _estimates_within(tried: Explanation) -> str:
    return (
        f"the estimates are within {numbers.significant(tried.farthest, 2)} prior standard deviations"
        f" instead of {times(tried.farthest_before)}"
    )


def cause_sentence(explanations: Sequence[Explanation]) -> str:
    """The best explanation of a misfit with its rivals, and what it leaves."""
    best, *rivals = explanations
    left = f"the residuals are {times(best.factor)} times the noise instead of {times(best.before)}"
    if _explains_estimates(best):
        left = _estimates_within(best)
    text = f"Most likely: {CAUSES[best.cause]}. {capital(changed(best))} {left}."
    if rivals:
        text += f" As likely: {listed([changed(rival) for rival in rivals], _MOST_ALTERNATIVES)}."
    return text if best.agrees else f"{text} That alone does not explain them."


def mend(explanation: Explanation) -> str:
    """What to do about a cause, as sentences."""
    joints, targets = [f"J{joint}" for joint in explanation.joints], list(map(clipped, explanation.targets))
    match explanation.cause:
        case "swapped_joints":
            return f"Exchange the columns of {listed(joints)} in the recording, and analyse it again."
        case "sign":
            return (
                f"Reverse the sign of {joints[0]} in the recording (zerobeam import csv --reversed), or its"
                " axis in the robot file, and analyse again."
            )
        case "zero":
            return f"Correct the zero of {joints[0]} in the recording or the robot file, and analyse again."
        case "units":
            return "Import the recording again with the right --units, and analyse it again."
        case "coupling":
            return (
                f"State in the robot file what joint {explanation.joints[-1]} is counted from (pendant,"
                " encoder), and analyse again."
            )
        case "twist":
            return "Correct the sign of this twist in the robot file, and analyse again."
        case "placement":
            return (
                f"Remove the measurements at {listed(targets)}, or record them again with the target fixed."
            )
        case "measurements":
            which = listed([str(n) for n in explanation.measurements], _MOST_MEASUREMENTS)
            return f"Remove measurement {which} from the run, or repeat it."
        case "moved_target":
            return (
                f"Give {targets[0]} another name in the measurements from {explanation.measurements[1]} on,"
                " or record the run again."
            )
        case "geometry":
            return "Leave out geometry: exact in the header, so that the links are estimated."
        case _:
            return "Correct this in the recording or the robot file, and analyse again."


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
