"""A misfit in words: what speaks against the model, what that means for the answer, what may explain it."""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.diagnostics.diagnosis import Explanation, undecided
from ..analysis.misfit import (
    BeyondPrior,
    Criterion,
    ImplausibleNoise,
    LackOfFit,
    Misfit,
    NominalContradicted,
    OffPrior,
    PlacementsDisagree,
    TightPrior,
)
from ..analysis.observability.changes import ChangeAt, Displacement, RepeatsApart, RunChange
from ..analysis.recordings.steps import RecordingStep
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .misfit_causes import CAUSES, changed
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
        case NominalContradicted():
            return (
                "The nominal geometry does not describe this arm: links within typical tolerances explain"
                f" {times(criterion.factor)} times the remaining scatter (F({criterion.rank},"
                f" {criterion.dof}), {p_words(criterion.p_value)}). With links the residuals are"
                f" {times(criterion.after)} times the stated noise instead of {times(criterion.before)}"
            )
        case TightPrior():
            largest = numbers.significant(criterion.estimate, 2, criterion.unit)
            return (
                f"The stated tolerance of {tolerance_words(criterion, name)} is too small: the estimates"
                f" (up to {largest}, {name(criterion.largest)}) are larger than it allows (χ²"
                f" {criterion.chi2:.0f}, {criterion.dof} dof, {p_words(criterion.p_value)}). It would have to"
                f" be {needed_words(criterion)}"
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
        case RepeatsApart(again=again, size_mm=size):
            apart = f"{repeats_disagree(again)}: they are {numbers.significant(size, 2, 'mm')} apart"
            return (
                f"{apart} ({p_words(criterion.p_value)}). Something changed during the run, or one of the"
                " readings is wrong, or the noise is understated"
            )
        case RunChange(p_value=p_value, elsewhere=elsewhere):
            if not elsewhere:
                return f"It seems that {change_words(criterion)} ({p_words(p_value)})"
            others = [change_words(one) for one in elsewhere[:_MOST_ALTERNATIVES]]
            return (
                f"Something changed during the run ({p_words(p_value)}), and the measurements do not decide"
                f" what: {', or '.join([change_words(criterion), *others])}"
            )


_TOLERANCES = {
    "length": ("the links' lengths", "geometry.tolerance.length_mm"),
    "angle": ("the links' angles", "geometry.tolerance.angle_deg"),
    "gravity": ("deflection under gravity", "geometry.gravity_deg"),
    "harmonics": ("the first harmonics", "geometry.harmonics_deg"),
}


def tolerance_words(prior: TightPrior, name: Namer = str) -> str:
    """What has the tolerance."""
    return _TOLERANCES[prior.of][0] if prior.of in _TOLERANCES else name(prior.of)


def needed_words(prior: TightPrior) -> str:
    """What the tolerance would have to be."""
    factor = f"{times(prior.times)} times as large"
    if prior.needed is None or prior.stated is None:
        return factor
    needed, tolerance = numbers.significant(prior.needed, 2, prior.unit), numbers.exact(prior.stated)
    return f"{needed} instead of {numbers.with_unit(tolerance, prior.unit)} ({factor})"


def larger_tolerance(prior: TightPrior, name: Namer = str) -> str:
    """What to do about it, as a sentence."""
    key = _TOLERANCES[prior.of][1] if prior.of in _TOLERANCES else f"the sigma of {name(prior.of)}"
    value = "" if prior.needed is None else f" {numbers.significant(prior.needed, 2)}"
    colon = ":" if prior.of in _TOLERANCES and value else ""
    if not value:
        value = f" {times(prior.times)} times as large"
    return f"If this arm deviates so much, state {key}{colon}{value} in the header, and analyse again."


def misfit_headline(misfit: Misfit, name: Namer = str) -> str:
    """What is wrong, first of all; the first criterion, and what follows for the answer."""
    first = criterion_sentence(misfit.criteria[0], name).removeprefix("Lack of fit: ")
    more = len(misfit.criteria) - 1
    also = f" {more} more {'criterion agrees' if more == 1 else 'criteria agree'}." if more else ""
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
        f"{_moving(moved.target, moved.station)} seems to have moved{_by(moved)} between measurements"
        f" {moved.after_shot} and {moved.before_shot} (p {p_value}){doubt}"
    )


def _moving(name: str, station: bool) -> str:
    """A target, or an instrument that stands in the world: it moves relative to the arm."""
    return f"Instrument {clipped(name)}, or the arm's base," if station else f"Target {clipped(name)}"


def _by(moved: Displacement) -> str:
    if moved.size_mm is not None and moved.size_std_mm is not None:
        return f" by {moved.size_mm:.1f} ± {moved.size_std_mm:.1f} mm"
    along = [
        f"{shift:.1f} ± {std:.1f} mm along {axis}"
        for axis, shift, std in zip("xyz", moved.shift_mm, moved.std_mm, strict=True)
        if shift is not None and std is not None
    ]
    return f" by {' and '.join(along)}" if along else ""


def change_words(one: ChangeAt) -> str:
    """What changed, when and by how much."""
    what = clipped(str(one.target)) if one.joint is None else f"the zero of J{one.joint}"
    amount = numbers.estimate(one.amount, one.std, numbers.unit_of(one.unit))
    between = f"measurements {one.after_shot} and {one.before_shot}"
    if one.how == "drift":
        return f"{what} drifted by {amount} from measurement {one.after_shot} to {one.before_shot}"
    return f"{what} jumped by {amount} between {between}"


def step_sentence(step: RecordingStep) -> str:
    """Which measurements of a recording are off together, without a full stop."""
    shots = measurements(step.first_shot, step.last_shot)
    size = "" if step.size_mm is None else f" by {numbers.significant(step.size_mm, 2, 'mm')}"
    return (
        f"{_moving(step.target, step.station)} seems to have slipped: {shots} are off"
        f" the rest of its recording{size} ({p_words(step.p_value)}, Holm-adjusted)"
    )


def measurements(first: int, last: int) -> str:
    """Measurements from a number to another, by both."""
    return f"measurement {first}" if first == last else f"measurements {first} to {last}"


def repeats_disagree(again: Sequence[int]) -> str:
    """That what was measured `again` does not agree with the first time."""
    repeat, agree = ("repeats", "does") if len(again) == 1 else ("repeat", "do")
    shots = capital(measurements(again[0], again[-1]))
    return f"{shots} {repeat} earlier ones and {agree} not agree with them"


def _off(parameter: OffPrior, name: Namer) -> str:
    return (
        name(parameter.name)
        if parameter.stds is None
        else f"{name(parameter.name)} ({parameter.stds:+.1f})".replace("(-", f"({numbers.MINUS}")
    )


_LESS = 0.9  # of the residuals, above which it is the estimates that a cause explains


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
    if open_ := undecided(explanations):
        questions = [f"{CAUSES[one.cause]} ({changed(one)})" for one in open_[:_MOST_ALTERNATIVES]]
        ratios = [numbers.significant(open_[0].odds / one.odds, 2) for one in open_[1:_MOST_ALTERNATIVES]]
        text = (
            f"The measurements do not decide what is wrong: {', or '.join(questions)} (evidence"
            f" {' : '.join(['1', *ratios])})."
        )
        return text if best.agrees else f"{text} None of these alone explains the residuals."
    left = f"the residuals are {times(best.factor)} times the noise instead of {times(best.before)}"
    if _explains_estimates(best):
        left = _estimates_within(best)
    text = f"Most likely: {CAUSES[best.cause]}. {capital(changed(best))} {left}."
    if best.links_of_an_exact_arm:
        text += " The arm was taken as exact (geometry: exact)."
    if rivals:
        next_best = f"{changed(rivals[0])} (evidence ratio {evidence_ratio(rivals[0])})"
        also = [changed(rival) for rival in rivals[1:]]
        text += f" Next best: {listed([next_best, *also], _MOST_ALTERNATIVES)}."
    return text if best.agrees else f"{text} That alone does not explain them."


def diagnosis_said(explanations: tuple[Explanation, ...]) -> str:
    """How far to trust the explanations of a result; there is at least one."""
    if not explanations[0].agrees:
        return "None of these alone explains the residuals to the noise: something else is wrong too."
    if undecided(explanations):
        return "The measurements do not decide between the first of these: check each. Nothing was applied."
    if len(explanations) > 1:
        return "The first is at least 20 times as likely as any other. Nothing was applied."
    return "No other cause that was tried is within an evidence ratio of 1:1000. Nothing was applied."


def evidence_ratio(rival: Explanation) -> str:
    """Of a rival to the best explanation: 1:40."""
    return f"1:{numbers.significant(max(1 / rival.odds, 1.0), 2)}"
