"""The fit in words: whether it converged, how residuals compare with the noise, what the robust fit found."""

from __future__ import annotations

from ..analysis.answer.findings import HeldOutMisfit
from ..analysis.answer.result import LikelihoodSummary, Result
from ..analysis.diagnostics.hold_out import HoldOut
from ..analysis.diagnostics.outliers import Robust
from ..analysis.misfit import LackOfFit
from ..analysis.status import LACK_OF_FIT
from . import numbers
from .finding_words import hold_out_message
from .misfit_words import criterion_sentence
from .wording import listed, person, sentence


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
    return sentences + beside


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
