"""The findings of a run in words, its fit and a held-out run too: each sentence is made here, and nowhere
read back.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..analysis.answer.findings import (
    FileWarning,
    Finding,
    HeldOutMisfit,
    NoPosterior,
    NotConverged,
    OtherBasins,
    Outlying,
    PoorCurvature,
    RobustNotConverged,
    RoundedAngles,
)
from ..analysis.answer.result import LikelihoodSummary, Result
from ..analysis.diagnostics.accuracy import TcpAccuracy
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.diagnostics.outliers import Robust
from ..analysis.misfit import ExactDoubted, LackOfFit
from ..analysis.observability.changes import RepeatsDiffer
from ..analysis.posterior.posterior import Agreement, PosteriorSummary
from ..analysis.prediction import UNKNOWN, PredictedRun
from ..analysis.status import LACK_OF_FIT, NOT_DESCRIBED
from . import numbers
from .misfit_words import change_words, criterion_sentence, repeats_disagree
from .numbers import p_words
from .numbers import significant as rounded
from .observability import reason
from .wording import Namer, be, capital, clipped, counted, ended, label, listed, person, sentence, shown

MOST_NAMED = 10
_USELESS = {
    "nothing known": "no parameter is identifiable",
    "little known": "the data determine less than half of the offsets",
    "misfit": NOT_DESCRIBED,
}


def notes(result: Result) -> tuple[str, ...]:
    """The findings of a result as sentences without a full stop, the gravest first."""
    return tuple(finding_sentence(finding) for finding in result.findings)


def finding_sentence(finding: Finding, name: Namer = str) -> str:
    """One finding, without a full stop at its end; `name` writes names."""
    match finding:
        case NotConverged(reason=why):
            return f"The fit did not converge: {why}. Nothing here may be used as an estimate"
        case OtherBasins(count, undecided):
            sets = "set of offsets fits" if count == 1 else "sets of offsets fit"
            what = "What differs between them is unidentifiable; the rest" if undecided else "The one"
            return (
                f"Other local optima: {count} more {sets} nearly as well. {what} reported has"
                " the highest posterior density; add measurements to separate them"
            )
        case NoPosterior(posterior):
            return f"No posterior is shown: {posterior_message(posterior)}"
        case PoorCurvature(parameters, tested):
            if not tested:
                return (
                    "The posterior was not sampled, and with separate noise factors nothing else tests the"
                    " intervals by the curvature at the mode: sample it before you rely on them"
                )
            return (
                "The posterior was not sampled, although the profile likelihood of"
                f" {listed([name(each) for each in parameters], MOST_NAMED)} differs from the curvature at"
                " the mode: sample it before you rely on these intervals"
            )
        case ExactDoubted():
            mm, deg = numbers.exact(finding.length_mm, "mm"), numbers.exact(finding.angle_deg, "deg")
            exact, typical = numbers.p_value(finding.p_value), numbers.p_value(finding.typical)
            return (
                f"Residuals are larger than the noise of an exact arm explains (p {exact}). With links as"
                f" those of a typical arm, within {mm} and {deg}, they agree with it (p {typical}):"
                " geometry: exact is the most likely cause"
            )
        case HeldOutMisfit(factor=factor, run=str(run)):
            return (
                f"The held-out run {clipped(run)} is predicted with errors ({_sizes(finding)}) that are"
                f" {factor:.1f} times what noise and fit explain: the estimates do not carry over to it as"
                " stated"
            )
        case HeldOutMisfit(targets, factor=factor):
            return (
                f"At the held-out targets ({listed(list(targets))}) the residuals ({_sizes(finding)}) are"
                f" {factor:.1f} times what noise and fit explain: the offsets do not carry over to them as"
                " stated"
            )
        case RobustNotConverged(reason=why):
            return f"The robust fit did not converge ({why}): it is not shown"
        case Outlying(outlying, robust):
            named = _measurements(outlying[:MOST_NAMED])
            if robust:
                return (
                    f"Outlying by the robust fit: {named}. Check before you rely on the estimates of the"
                    " likelihood fit"
                )
            return (
                f"Outlying: {named}; the residual is far larger than the stated noise. Check before you"
                " rely on the rest"
            )
        case RepeatsDiffer(p_value=p_value, again=again):
            return f"{repeats_disagree(again)} ({p_words(p_value)}), as if {change_words(finding)}"
        case RoundedAngles(sentences):
            return "; ".join(sentences)
        case FileWarning(text):
            return text
        case _:
            return criterion_sentence(finding, name)


def _sizes(misfit: HeldOutMisfit) -> str:
    """Lengths, and angles where they are read: each beside what is expected of it."""
    text = f"{misfit.rms_mm:.2f} mm rms"
    if misfit.rms_deg is None or misfit.expected_deg is None or misfit.expected_mm is None:
        return text
    angle, expected = (rounded(value, 2, "deg") for value in (misfit.rms_deg, misfit.expected_deg))
    return f"{text}, {misfit.expected_mm:.2f} mm expected; {angle} rms, {expected} expected"


def _measurements(numbers: Sequence[int]) -> str:
    return f"measurement{'' if len(numbers) == 1 else 's'} {listed([str(n) for n in numbers], MOST_NAMED)}"


def likelihood_message(fit: LikelihoodSummary) -> str | None:
    """What cannot be judged of a fit."""
    if fit.dof == 0:
        return "zero degrees of freedom: the fit cannot be checked against the noise"
    return (
        None
        if fit.noise_known
        else "the noise is estimated from these residuals, so they cannot contradict it"
    )


def posterior_message(posterior: PosteriorSummary) -> str:
    """How the sampling went."""
    if posterior.useless is not None:
        return f"not sampled: {_USELESS[posterior.useless]}"
    if posterior.omitted is not None:
        if posterior.omitted.enough:
            return (
                "not sampled: the curvature at the mode describes it (the profile likelihood has the same"
                " 95 % intervals, to a tenth of their width)"
            )
        return "not sampled, as requested; the curvature at the mode may not describe it"
    if posterior.draws == 0:
        return "not sampled: the fit did not converge"
    rhat = "not finite" if posterior.rhat_max is None else f"{posterior.rhat_max:.3f}"
    if posterior.converged:
        return (
            f"{posterior.ensembles} independent ensembles agree: R-hat {rhat}, at least"
            f" {posterior.ess_min:.0f} effective draws{_confirmed(posterior.agreement)}"
        )
    if posterior.agreement is not None and not posterior.agreement.holds:
        return (
            f"the posterior has not converged: its ensembles agree with each other (R-hat {rhat}, smallest"
            f" effective sample size {posterior.ess_min:.0f}), but {_contradicted(posterior.agreement)}."
            " Record more varied measurements, or hold what the data do not determine"
        )
    drifts = ", and its draws still drift" if posterior.drifts else ""
    return (
        f"the posterior has not converged (R-hat {rhat}, smallest effective sample size"
        f" {posterior.ess_min:.0f}{drifts}). Record more varied measurements, or hold what the data do not"
        " determine"
    )


_METHODS = {"importance": "importance sampling", "profile": "the profile likelihood"}


def _confirmed(agreement: Agreement | None) -> str:
    """Which other method has the same intervals, as what can follow a sentence without its full stop."""
    if agreement is None or agreement.by is None:
        return ""
    method = _METHODS[agreement.by]
    return f". {method[0].upper()}{method[1:]} agrees with them{_pareto(agreement)}"


def _contradicted(agreement: Agreement) -> str:
    """What does not confirm the draws."""
    if agreement.by is None or agreement.name is None:
        return f"no other method confirms them{_pareto(agreement)}"
    return (
        f"not with {_METHODS[agreement.by]}{_pareto(agreement)}: the 95 % interval of"
        f" {label(agreement.name)} is off by {100 * agreement.off:.0f} % of its width"
    )


def _pareto(agreement: Agreement) -> str:
    if agreement.pareto_k is None or agreement.by == "profile":
        return ""
    return f" (Pareto k̂ {numbers.significant(agreement.pareto_k, 2)})"


def hold_out_message(held_out: HoldOut) -> str | None:
    """Why a hold-out has no numbers, or none to judge."""
    if held_out.failure is not None:
        return f"the fit without them did not converge: {held_out.failure}"
    return (
        None if held_out.dof else "zero degrees of freedom: no more numbers than coordinates of their targets"
    )


def predicted_run_message(held_out: PredictedRun) -> str | None:
    """Why a held-out run has no numbers, or not of all of its measurements."""
    if held_out.failure is not None:
        return f"the fit did not converge: {held_out.failure}"
    reasons = []
    if held_out.unknown:
        reasons.append(
            f"{_measurements(held_out.unknown)}: unknown, as the data do not determine the prediction"
            f" (its u is more than {UNKNOWN:g} times the noise)"
        )
    if held_out.taken_up:
        reasons.append(
            f"{_measurements(held_out.taken_up)}: no prediction, as the position of the target is"
            " estimated from no more numbers than it has coordinates"
        )
    return "; ".join(reasons) or None


def robust_message(robust: Robust) -> str:
    """What a robust fit found."""
    named = "no outlier"
    if robust.outliers:
        one = len(robust.outliers) == 1
        named = f"{_measurements(robust.outliers)} {'is an outlier' if one else 'are outliers'}"
    if robust.with_uncertainty:
        return named
    return (
        f"{named}; no uncertainty: a measurement has leverage 1, or there are no more numbers than unknowns"
    )


def tcp_words(accuracy: TcpAccuracy, name: Namer = str, tool: str = "the tool") -> str:
    """What the point is whose accuracy is stated; `tool` is what has it."""
    match accuracy.source:
        case "stated point":
            return "a point stated by the user"
        case "tool":
            return f"the stated point of {tool}" if any(accuracy.point_mm) else "the origin of the flange"
        case "last axis":
            n = accuracy.joints
            return (
                f"the point of the axis of joint {n} nearest to the stated point of {tool}, as"
                f" {name(f'delta{n}')} is not determined"
            )


def accuracy_reason(accuracy: TcpAccuracy, name: Namer = str) -> str | None:
    """Why no accuracy is claimed; None where it is."""
    if not accuracy.converged:
        return "the fit did not converge"
    parts: dict[tuple[str, str], list[str]] = {}
    for parameter, held, cause in zip(accuracy.undetermined, accuracy.held, accuracy.causes, strict=True):
        why = "" if cause is None else f": {reason(cause, name)}"
        parts.setdefault(("held" if held else "unidentifiable", why), []).append(name(parameter))
    reasons = [
        f"the TCP depends on {listed(names)}, which {be(names)} {state}{why}"
        for (state, why), names in parts.items()
    ]
    return "; ".join(reasons) or None


def misfit_factor(result: Result) -> str | None:
    """How many times the stated noise the residuals are; None where they agree with it."""
    for finding in result.findings:
        if isinstance(finding, LackOfFit):
            return numbers.significant(finding.factor, 2)
    return None


def goodness_of_fit(result: Result, noise: str) -> list[str]:
    """The goodness of fit as sentences, the gravest first; against the `stated` or the `fitted` noise."""
    fit = result.likelihood
    sentences = not_converged(fit)
    others = () if result.misfit is None else result.misfit.criteria
    beside = [
        f"{criterion_sentence(criterion, person)}."
        for criterion in others
        if not isinstance(criterion, LackOfFit)
    ]
    if fit.p_value is None or not fit.dof:
        return sentences + beside
    measure = (
        f"χ²\u00a0{numbers.significant(fit.chi2)}, {fit.dof}\u00a0dof, p\u00a0{numbers.p_value(fit.p_value)}"
    )
    if (times := misfit_factor(result)) is not None:
        sentences.append(
            f"Lack of fit: residuals are {times} times the {noise} noise ({measure}). The geometry, the"
            " noise or single measurements are not as stated, and the intervals do not cover that error."
        )
    elif fit.p_small is not None and fit.p_small < LACK_OF_FIT:
        sentences.append(
            f"The residuals are smaller than the {noise} noise allows, even of an arm without any deviation"
            f" ({measure}; of residuals as small p\u00a0{numbers.p_value(fit.p_small)}): it may be"
            " overstated."
        )
    else:
        sentences.append(f"The residuals agree with the {noise} noise ({measure}).")
    return [*sentences, *small_residuals(fit), *beside]


def small_residuals(fit: LikelihoodSummary) -> list[str]:
    """That residuals are smaller than noise and tolerances allow, although an arm without any deviation may
    leave as small ones."""
    if fit.p_value is None or not fit.dof or 1 - fit.p_value >= LACK_OF_FIT:
        return []
    if fit.p_small is not None and fit.p_small < LACK_OF_FIT:
        return []  # the noise alone says so
    p_value = numbers.p_value(1 - fit.p_value)
    return [
        f"The residuals are far smaller than noise and tolerances predict (p\u00a0{p_value}): this"
        " arm deviates less than the tolerances, the noise is overstated, or the measurements are not"
        " independent. U is then larger than it has to be, or not proven."
    ]


def not_converged(fit: LikelihoodSummary) -> list[str]:
    """What a reader must know of a fit that did not converge."""
    if fit.converged:
        return []
    return [
        f"The fit did not converge ({sentence(fit.reason)}): do not use its numbers. "
        "Look at the residuals for a wrong measurement, or state a better guess of target and tool."
    ]


def robust_sentence(result: Result, robust: Robust) -> str:
    """What the robust fit is and found."""
    if not robust.converged:
        return f"The robust fit did not converge ({sentence(robust.reason)}) and is not shown."
    if robust.loss == "huber":
        threshold = numbers.significant(robust.tuning)
        sentences = [
            f"Huber’s loss: the weight of a normalised residual r above {threshold} is {threshold}/r."
        ]
    else:
        nu = numbers.exact(robust.tuning)
        sentences = [
            f"Student’s loss with {nu} degrees of freedom: the larger a residual, the smaller its weight."
        ]
    sentences.append("A measurement of weight 1 counts as in the likelihood fit.")
    sentences.append(_outliers(result, robust))
    if robust.noise_scale is not None:
        sentences.append(f"The noise is {numbers.significant(robust.noise_scale)} times the stated noise.")
    if robust.with_uncertainty:
        sentences.append("Its intervals follow from the residuals as they are, not from the stated noise.")
    else:
        sentences.append(
            "It has no uncertainty: a measurement has leverage 1, or there are no more numbers than unknowns."
        )
    return " ".join(sentences)


def _outliers(result: Result, robust: Robust) -> str:
    if not robust.outliers:
        return "No outlier."
    weights = {shot.shot: weight for shot, weight in zip(result.shots, robust.weights, strict=True)}
    named = [f"{number} (weight {numbers.fixed(weights[number], 2)})" for number in robust.outliers]
    return f"Outlier{'' if len(named) == 1 else 's'}: {listed(named)}."


def hold_out_sentences(result: Result, held_out: HoldOut) -> list[str]:
    """How it went."""
    sentences = []
    misfit = next((finding for finding in result.findings if isinstance(finding, HeldOutMisfit)), None)
    if misfit is not None:
        sentences.append(
            f"The residuals are {numbers.significant(misfit.factor, 2)} times what noise and fit explain: the"
            " offsets do not carry over to these targets as stated."
        )
    elif held_out.p_value is not None:
        sentences.append("The residuals agree with noise and fit: they do not contradict the offsets.")
    if (message := hold_out_message(held_out)) is not None:
        sentences.append(f"No judgement: {sentence(message)}.")
    return sentences


def predicted_run_sentences(run: PredictedRun) -> list[str]:
    """How it was predicted, how well, and what is no prediction."""
    sentences = [_how(run)]
    if run.rms_mm is not None and run.expected_mm is not None and run.u_mm is not None:
        sentences.append(
            f"The errors are {numbers.significant(run.rms_mm, unit='mm')} rms. From noise and fit"
            f" {numbers.significant(run.expected_mm, unit='mm')} are expected, including the standard"
            f" uncertainty of the prediction, {numbers.significant(run.u_mm, unit='mm')}."
        )
        if run.rms_deg is not None and run.expected_deg is not None:
            sentences.append(
                f"Rotations are off by {numbers.significant(run.rms_deg, unit='deg')} rms; expected from"
                f" noise and fit: {numbers.significant(run.expected_deg, unit='deg')}."
            )
        sentences.append(_gain(run.rms_mm, run.rms_before_mm))
    if run.p_value is not None and run.factor is not None:
        p = f"p-value {numbers.p_value(run.p_value)}"
        if run.p_value < LACK_OF_FIT:
            factor = numbers.significant(run.factor, 2)
            sentences.append(
                f"The errors are {factor} times what noise and fit explain ({p}): the estimates do not carry"
                " over to this run as stated."
            )
        else:
            sentences.append(f"The errors agree with noise and fit ({p}).")
    if (message := predicted_run_message(run)) is not None:
        sentences.append(ended(capital(message)))
    return sentences


def _how(run: PredictedRun) -> str:
    text = f"Everything is estimated from the analysed run; {clipped(shown(run.run), 60)} is predicted."
    if run.targets_placed:
        one = len(run.targets_placed) == 1
        names = listed([clipped(name) for name in run.targets_placed])
        text += (
            f" The position{'' if one else 's'} of {names}, which the analysed run lacks,"
            f" {'is' if one else 'are'} estimated from the held-out run itself. The components of the"
            " residuals that this takes up do not count, neither in what is expected nor in the degrees of"
            " freedom."
        )
    return text


def _gain(rms: float, before: float | None) -> str:
    if before is None:
        return "There is no comparison with nominal values: their fit of targets and tool did not converge."
    text = (
        "With nominal joints and links, and targets and free tool fitted to the analysed run, they are"
        f" {numbers.significant(before, unit='mm')}"
    )
    return f"{text}: {numbers.significant(before / rms, 2)} times as much." if rms > 0 else f"{text}."


def predicted_run_alt(run: PredictedRun) -> str:
    """The figure in a sentence."""
    rows = [row for row in run.measurements if row.error_mm is not None]
    worst = max(rows, key=lambda row: row.error_mm or 0.0)
    count, name = counted(len(rows), "measurement"), clipped(shown(run.run), 60)
    largest = numbers.or_words(worst.error_mm, "", "mm")
    return (
        f"Prediction errors of {count} of {name}, nominal against calibrated; the largest with calibration is"
        f" {largest} at measurement {worst.shot}."
    )
