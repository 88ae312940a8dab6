"""How well the model fits by both costs, what may explain a misfit, and second opinions: the robust fit,
held-out targets, the intervals by three methods.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...analysis.answer.result import AngleResult, DistanceResult, LikelihoodSummary, Result
from ...analysis.diagnostics.hold_out import HoldOut
from ...analysis.diagnostics.outliers import Robust
from ...analysis.estimation.midpoint import MidpointFit
from ...analysis.observability.power import LIMIT_U, DetectionPower
from ...analysis.posterior.posterior import Intervals
from ...words import numbers
from ...words.finding_words import goodness_of_fit, hold_out_sentences, likelihood_message, robust_sentence
from ...words.misfit_words import CAUSES, changed, diagnosis_said
from ...words.numbers import times, unit_of
from ...words.observability import wrong_words
from ...words.wording import NOT_DETERMINED, clipped, label, listed, sentence
from ..style.blocks import (
    Cell,
    Facts,
    Paragraph,
    Row,
    Section,
    Table,
    on_screen,
    row_of,
    section_of,
    table_of,
)
from .parameter_section import noise_factors, other_tables

_NO_COST = "—"  # not defined for this cost


def fit_section(result: Result) -> Section:
    """The section of a report, with the parameters besides the offsets."""
    likelihood, midpoint = result.likelihood, result.midpoint
    separate = noise_factors(result.parameters)
    sides = [_likelihood_facts(likelihood, separate)]
    if midpoint.available:
        sides.append(_midpoint_facts(midpoint))
    columns = ["quantity", "residual likelihood", "midpoint cost (eq. 8)"]
    rows = [row_of(name, *(side.get(name, _NO_COST) for side in sides)) for name in sides[0]]
    sentences = goodness_of_fit(result, "fitted" if separate else "stated")
    if (message := likelihood_message(likelihood)) is not None:
        sentences.append(f"{message[0].upper()}{message[1:]}.")
    if not midpoint.available:
        sentences.append(f"The paper’s midpoint fit (eq. 8) is not available: {sentence(midpoint.reason)}.")
    if midpoint.message:
        sentences.append(f"Midpoint fit: {sentence(midpoint.message)}.")
    return section_of(
        "Fit quality",
        *map(Paragraph, sentences),
        table_of("Quality of the fit", columns[: 1 + len(sides)], rows),
        on_screen(_both_estimates(result)) if result.misfit is None else None,
        _power(result.power),
        _distances(result),
        _angles(result),
        *(other_tables(result.parameters, result.coverage_factor) if result.misfit is None else ()),
    )


def _likelihood_facts(fit: LikelihoodSummary, separate: bool) -> dict[str, str]:
    no_p = "not defined: the noise was estimated" if not fit.noise_known else "zero degrees of freedom"
    noise = "its factors are estimated" if separate else "taken as stated"
    return {
        "Converged": _converged(fit),
        "Iterations": str(fit.iterations),
        "Residuals before, rms": numbers.length_and_angle(fit.rms_before_mm, fit.rms_before_deg),
        "Residuals after, rms": numbers.length_and_angle(fit.rms_mm, fit.rms_deg),
        "χ²": numbers.significant(fit.chi2),
        "Degrees of freedom": str(fit.dof),
        "p-value": no_p if fit.p_value is None else numbers.p_value(fit.p_value),
        "Noise, as a multiple of the stated": numbers.or_words(fit.noise_scale, noise),
        "Other local optima found": str(fit.other_basins),
    }


def _midpoint_facts(fit: MidpointFit) -> dict[str, str]:
    return {
        "Converged": _converged(fit),
        "Iterations": str(fit.iterations),
        "Residuals after, rms": numbers.or_words(fit.rms_mm, _NO_COST, "mm"),
    }


def _converged(fit: LikelihoodSummary | MidpointFit) -> str:
    return f"{'yes' if fit.converged else 'NO'}: {sentence(fit.reason)}"


def _both_estimates(result: Result) -> Table | None:
    """The offsets by both costs, where both have an estimate."""
    columns = ["name", "residual likelihood", "midpoint cost (eq. 8)", "difference over U"]
    k = result.coverage_factor
    rows = [
        row_of(
            label(row.name),
            numbers.estimate(row.estimate, k * row.std, row.unit),
            numbers.estimate(row.midpoint, k * row.std, row.unit),
            numbers.significant((row.midpoint - row.estimate) / (k * row.std), 2),
        )
        for row in result.parameters
        if row.group == "offset"
        and row.midpoint is not None
        and row.estimate is not None
        and row.std is not None
    ]
    return table_of("Offsets by both costs", columns, rows) if rows else None


def _power(rows: Sequence[DetectionPower]) -> Table | None:
    """What the test of the residuals would have detected, and what a pass can hide."""
    columns = [
        "what could be wrong",
        "detected in",
        "wrong passes",
        "can hide",
        "offset error",
        "TCP error",
    ]
    shown_rows = [
        row_of(
            sentence(wrong_words(row)),
            f"{100 * row.probability:.0f} %",
            f"{100 * row.risk:.1f} %{_at_worst(row)}",
            numbers.or_words(row.hidden_size, "—", numbers.unit_of(row.unit), 2),
            numbers.or_words(row.hidden_offset, "—", "deg", 2),
            numbers.or_words(row.hidden_tcp_mm, "—", "mm", 2),
        )
        for row in rows
    ]
    caption = (
        "What a run like this detects: in how many runs the residuals show it at this size; wrong passes: how"
        f" many pass with an offset wrong by more than {LIMIT_U:g} u, at the worst of all sizes; the largest"
        " size that a pass can hide, and the errors that it makes"
    )
    return table_of(caption, columns, shown_rows) if rows else None


def _at_worst(row: DetectionPower) -> str:
    """Behind a share of wrong passes: the size at which it is so large."""
    if row.worst_size is None or row.risk < 5e-4:
        return ""
    return f" at {numbers.significant(row.worst_size, 2, numbers.unit_of(row.unit))}"


def _distances(result: Result) -> Table | None:
    rows = [_tie(result, row, row.mm, row.sigma_mm, "mm") for row in result.distances]
    return table_of("Distances between targets", _OF_TIES, rows) if rows else None


def _angles(result: Result) -> Table | None:
    rows = [_tie(result, row, row.deg, row.sigma_deg, "deg") for row in result.angles]
    return table_of("Angles between planes", _OF_TIES, rows) if rows else None


_OF_TIES = ["between", "stated", "its U", "after the fit", "its U"]


def _tie(result: Result, row: DistanceResult | AngleResult, value: float, sigma: float, unit: str) -> Row:
    names, k = f"{clipped(row.between[0], 24)} and {clipped(row.between[1], 24)}", result.coverage_factor
    as_stated = (numbers.exact(value, unit), numbers.exact(k * sigma, unit))
    if row.estimate is None or row.std is None:
        return row_of(names, *as_stated, Cell(NOT_DETERMINED, span=2), tone="unidentifiable")
    estimate = numbers.estimate(row.estimate, k * row.std, unit)
    return row_of(names, *as_stated, estimate, numbers.spread(k * row.std, unit))


def diagnosis_section(result: Result) -> Section | None:
    """The explanations, the best first; None where there is none."""
    if not result.diagnosis:
        return None
    columns = ["cause", "tried", "residuals", "estimates", "added"]
    rows = [
        row_of(
            CAUSES[explanation.cause],
            sentence(changed(explanation)),
            times(explanation.factor),
            times(explanation.farthest),
            f"{round(explanation.freed, 1):g}",
        )
        for explanation in result.diagnosis
    ]
    before = times(result.diagnosis[0].before)
    caption = (
        f"Tried, best first: residuals in multiples of what is expected (as recorded: {before}), largest"
        " estimate in prior standard deviations, parameters estimated in addition"
    )
    text = diagnosis_said(result.diagnosis)
    return section_of("What could be wrong", Paragraph(text), table_of(caption, columns, rows, "llr"))


def robust_section(result: Result) -> Section | None:
    """The robust fit next to the likelihood fit; None where it was not asked for."""
    robust = result.robust
    if robust is None:
        return None
    table = _robust_table(result, robust) if robust.converged and result.misfit is None else None
    return section_of("Robust fit", Paragraph(robust_sentence(result, robust)), table)


def _robust_table(result: Result, robust: Robust) -> Table:
    k, columns = result.coverage_factor, ["name", "likelihood", "robust", "its U", "difference over U"]
    rows = []
    for row in robust.parameters:
        parameter, unit = result.parameters.named(row.name), unit_of(row.unit)
        if parameter.tolerated or parameter.group == "target":
            continue
        name = label(row.name)
        if parameter.estimate is None or parameter.std is None or row.estimate is None:
            rows.append(row_of(name, Cell(NOT_DETERMINED, span=4), tone="unidentifiable"))
            continue
        std, u = k * (row.std or parameter.std), k * parameter.std
        rows.append(
            row_of(
                name,
                numbers.estimate(parameter.estimate, u, unit),
                numbers.estimate(row.estimate, std, unit),
                "none" if row.std is None else numbers.spread(std, unit),
                numbers.significant((row.estimate - parameter.estimate) / u, 2),
            )
        )
    return table_of("Offsets and tool by both fits", columns, rows)


def hold_out_section(result: Result) -> Section | None:
    """How the fit does at targets that it has not seen; None where none was held out."""
    held_out = result.hold_out
    if not isinstance(held_out, HoldOut):
        return None
    names = [clipped(name, 24) for name in held_out.targets]
    missing = "not available"
    rows = [
        ("Placements", listed([clipped(name, 24) for name in held_out.placements])),
        ("Targets", f"{len(names)}: {listed(names)}"),
        ("Measurements there", str(held_out.shots)),
        ("Measurements of the fit", str(held_out.shots_fitted)),
        ("Residuals without offsets, rms", numbers.or_words(held_out.rms_before_mm, missing, "mm")),
        ("Residuals with them, rms", numbers.or_words(held_out.rms_mm, missing, "mm")),
        ("Residuals expected from noise and fit", numbers.or_words(held_out.expected_mm, missing, "mm")),
        ("χ²", numbers.or_words(held_out.chi2, missing)),
        ("Degrees of freedom", missing if held_out.dof is None else str(held_out.dof)),
        ("p-value", missing if held_out.p_value is None else numbers.p_value(held_out.p_value)),
    ]
    about = (
        "Offsets and tool are fitted without these placements, each taken whole. Then only the position of"
        " each target is fitted, to its own measurements; what is left of the residuals shows whether"
        " the offsets hold there."
    )
    return section_of(
        "Held-out targets",
        Paragraph(about),
        *map(Paragraph, hold_out_sentences(result, held_out)),
        Facts(rows),
    )


def intervals_section(result: Result) -> Section | None:
    """The intervals by three methods, where they differ or a parameter is weak; None where there is none
    such."""
    if not _of_people(result):
        return None
    table, text = intervals_table(result)
    agree = not any(row.differ for row in _of_people(result))
    return section_of("Intervals by three methods", Paragraph(text), replace(table, screen_only=agree))


def _of_people(result: Result) -> list[Intervals]:
    """All but those of the geometry, whose section has them; `result.json` has all."""
    return [row for row in result.intervals if not result.parameters.named(row.name).tolerated]


def intervals_table(result: Result) -> tuple[Table, str]:
    """The intervals, and what they say together."""

    def ends(name: str, unit: str, interval: tuple[float, float] | None, missing: str) -> str:
        std = result.parameters.named(name).std
        return missing if interval is None or std is None else numbers.interval(interval, std, unit_of(unit))

    # The fit is at the marginal mode of noise factors, where no profile starts.
    chosen = _of_people(result)
    no_profile = "not defined" if noise_factors(result.parameters) else "no end found"
    no_draws = "not converged" if result.posterior.draws and not result.posterior.converged else "not sampled"
    columns = ["name", "curvature", "profile", "posterior"]
    rows = [
        row_of(
            label(row.name),
            ends(row.name, row.unit, row.linear, ""),
            ends(row.name, row.unit, row.profile, no_profile),
            ends(row.name, row.unit, row.posterior, no_draws),
        )
        for row in chosen
    ]
    methods = ["the curvature at the estimate"]
    methods += ["the profile likelihood"] if any(row.profile for row in chosen) else []
    methods += ["the quantiles of the posterior’s draws"] if any(row.posterior for row in chosen) else []
    text = f"By {listed([*methods[:1], *(f'by {each}' for each in methods[1:])])}."
    if differing := [label(row.name) for row in chosen if row.differ]:
        text += (
            f" They differ by a tenth of their width or more for {listed(differing)}: do not rely on one"
            " alone there, the widest is the safe one."
        )
    elif len(methods) > 1:
        text += " They agree."
    return table_of("95 % intervals by three methods", columns, rows), text
