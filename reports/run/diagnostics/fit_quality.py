"""How well the model fits, by both costs."""

from __future__ import annotations

from collections.abc import Sequence

from ....analysis.answer.result import DistanceResult, LikelihoodSummary, MidpointSummary, Result
from ....analysis.misfit import LACK_OF_FIT, LackOfFit
from ....analysis.solution import ParameterResult
from ....words import numbers
from ....words.findings import likelihood_message
from ....words.misfit import criterion_sentence
from ....words.wording import NOT_DETERMINED, clipped, label, person, sentence
from ...style.blocks import Cell, Paragraph, Section, Table, row_of, section_of, table_of
from ..parameters import noise_factors, other_tables

_NO_COST = "—"  # not defined for this cost


def fit_section(result: Result) -> Section:
    """The section of a report, with the parameters besides the offsets."""
    likelihood, midpoint = result.likelihood, result.midpoint
    separate = noise_factors(result.parameters)
    sides = [_likelihood_facts(likelihood, separate)]
    if midpoint.available:
        sides.append(_midpoint_facts(midpoint))
    columns = [
        ("quantity", "left"),
        ("beam-residual likelihood", "right"),
        ("midpoint cost (eq. 8)", "right"),
    ]
    rows = [row_of(name, *(side.get(name, _NO_COST) for side in sides)) for name in sides[0]]
    said = _verdict(result, "fitted" if separate else "stated")
    if (message := likelihood_message(likelihood)) is not None:
        said.append(f"{message[0].upper()}{message[1:]}.")
    if not midpoint.available:
        said.append(f"The paper’s midpoint fit (eq. 8) is not available: {sentence(midpoint.reason)}.")
    if midpoint.message:
        said.append(f"Midpoint fit: {sentence(midpoint.message)}.")
    return section_of(
        "Fit quality",
        *map(Paragraph, said),
        table_of("Quality of the fit", columns[: 1 + len(sides)], rows),
        _both_estimates(result.parameters),
        _distances(result.distances),
        *other_tables(result.parameters),
    )


def _likelihood_facts(fit: LikelihoodSummary, separate: bool) -> dict[str, str]:
    no_p = "not defined: the noise was estimated" if not fit.noise_known else "zero degrees of freedom"
    noise = "its factors are estimated" if separate else "taken as stated"
    return {
        "Converged": _converged(fit),
        "Iterations": str(fit.iterations),
        "Residuals before, rms": numbers.significant(fit.rms_before_mm, unit="mm"),
        "Residuals after, rms": numbers.significant(fit.rms_mm, unit="mm"),
        "χ²": numbers.significant(fit.chi2),
        "Degrees of freedom": str(fit.dof),
        "p-value": no_p if fit.p_value is None else numbers.p_value(fit.p_value),
        "Noise, as a multiple of the stated": numbers.or_words(fit.noise_scale, noise),
        "Other local optima found": str(fit.other_basins),
    }


def _midpoint_facts(fit: MidpointSummary) -> dict[str, str]:
    return {
        "Converged": _converged(fit),
        "Iterations": str(fit.iterations),
        "Residuals after, rms": numbers.or_words(fit.rms_mm, _NO_COST, "mm"),
    }


def _converged(fit: LikelihoodSummary | MidpointSummary) -> str:
    return f"{'yes' if fit.converged else 'NO'}: {sentence(fit.reason)}"


def _both_estimates(parameters: Sequence[ParameterResult]) -> Table | None:
    """The offsets by both costs, where both have an estimate."""
    columns = [
        ("name", "left"),
        ("beam-residual likelihood", "right"),
        ("midpoint cost (eq. 8)", "right"),
        ("difference over u", "right"),
    ]
    rows = [
        row_of(
            label(row.name),
            numbers.estimate(row.estimate, row.std, row.unit),
            numbers.estimate(row.midpoint, row.std, row.unit),
            numbers.significant((row.midpoint - row.estimate) / row.std, 2),
        )
        for row in parameters
        if row.group == "offset"
        and row.midpoint is not None
        and row.estimate is not None
        and row.std is not None
    ]
    return table_of("Offsets by both costs", columns, rows) if rows else None


def misfit_factor(result: Result) -> str | None:
    """How many times the stated noise the residuals are; None where they agree with it."""
    for finding in result.findings:
        if isinstance(finding, LackOfFit):
            return numbers.significant(finding.factor, 2)
    return None


def _verdict(result: Result, noise: str) -> list[str]:
    """The goodness of fit in plain words, the gravest first; against the `stated` or the `fitted` noise."""
    fit = result.likelihood
    said = not_converged(fit)
    others = () if result.misfit is None else result.misfit.criteria
    beside = [f"{criterion_sentence(own, person)}." for own in others if not isinstance(own, LackOfFit)]
    if fit.p_value is None or not fit.dof:
        return said + beside
    measure = (
        f"χ²\u00a0{numbers.significant(fit.chi2)}, {fit.dof}\u00a0dof, p\u00a0{numbers.p_value(fit.p_value)}"
    )
    if (times := misfit_factor(result)) is not None:
        said.append(
            f"Lack of fit: residuals are {times} times the {noise} noise ({measure}). The geometry, the"
            " noise or single measurements are not as stated, and the intervals do not cover that error."
        )
    elif fit.p_value > 1 - LACK_OF_FIT:
        said.append(f"The residuals are smaller than the {noise} noise ({measure}): it may be overstated.")
    else:
        said.append(f"The residuals agree with the {noise} noise ({measure}).")
    return said + beside


def not_converged(fit: LikelihoodSummary) -> list[str]:
    """What a reader must know of a fit that did not converge."""
    if fit.converged:
        return []
    return [
        f"The fit did not converge ({sentence(fit.reason)}): do not use its numbers. "
        "Look at the residuals for a wrong measurement, or state a better guess of target and tool."
    ]


def _distances(rows: Sequence[DistanceResult]) -> Table | None:
    columns = [
        ("between", "left"),
        ("stated", "right"),
        ("its u", "right"),
        ("after the fit", "right"),
        ("its u", "right"),
    ]
    shown_rows = []
    for row in rows:
        names = f"{clipped(row.between[0], 24)} and {clipped(row.between[1], 24)}"
        stated = (numbers.exact(row.mm, "mm"), numbers.exact(row.sigma_mm, "mm"))
        if row.estimate is None or row.std is None:
            shown_rows.append(row_of(names, *stated, Cell(NOT_DETERMINED, span=2), tone="unidentifiable"))
        else:
            found = numbers.estimate(row.estimate, row.std, "mm")
            shown_rows.append(row_of(names, *stated, found, numbers.spread(row.std, "mm")))
    return table_of("Distances between targets", columns, shown_rows) if rows else None
