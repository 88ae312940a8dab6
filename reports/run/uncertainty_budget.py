"""The section on the uncertainty budget: what each source contributes, combined, expanded and checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from ...analysis.answer.result import Result
from ...analysis.diagnostics.budget import Budget, BudgetRow
from ...model.instruments.kind import Instrument
from ...words import numbers
from ...words.wording import label, listed
from ..style.blocks import (
    Block,
    Cell,
    Legend,
    Paragraph,
    Section,
    Table,
    on_screen,
    row_of,
    section_of,
    table_of,
)
from .parameter_section import reasons

MINOR = 0.01  # share of every variance in a table below which a source is summed with others
MOST_SOURCES = 8
MOST_COLUMNS = 6
_NAME = 20
_SAME = 1.02  # by less no two significant digits differ


def budget_section(result: Result) -> Section | None:
    """None where the fit did not converge: there is no estimate whose uncertainty could be stated."""
    if not result.likelihood.converged:
        return None
    blocks: list[Block | None] = [Paragraph(_lead(result))]
    for what, group in (("offsets", "offset"), ("tool", "tool")):
        names = {row.name for row in result.parameters if row.group == group and not row.tolerated}
        budgets = [budget for budget in result.budget if budget.name in names]
        for first in range(0, len(budgets), MOST_COLUMNS):
            blocks += _tables(result, what, budgets[first : first + MOST_COLUMNS])
    undetermined = [
        row
        for row in result.parameters
        if row.group in ("offset", "tool") and row.status in ("unidentifiable", "held") and not row.tolerated
    ]
    if undetermined:
        blocks += [
            Paragraph("Without a budget, as these data do not determine them or they are held:"),
            Legend([], reasons(undetermined)),
        ]
    blocks += _check(result)
    return section_of("Uncertainty budget", *blocks)


def _lead(result: Result) -> str:
    held = [label(row.name) for row in result.parameters if row.held]
    exact = [] if result.geometry.tolerance is not None else ["the robot’s geometry"]
    if result.inputs.calibrated and not any(row.group == "tool" for row in result.parameters):
        exact.append("the calibrated tool")
    text = (
        "By the GUM (JCGM 100:2008). A contribution is the standard uncertainty that its source alone"
        " gives the estimate, negative if it lowers the variance; in brackets is its share of the variance."
        " Of a joint and of an instrument it is the noise of the reading. Type A was evaluated from this"
        " run’s residuals, type B was stated or assumed. Taken as exact, and so in no budget:"
        f" {listed([*exact, *held] or ['nothing'])}."
    )
    by_dof = max((budget.coverage_factor for budget in result.budget), default=0.0)
    if by_dof > _SAME * result.coverage_factor:
        text += f" By the effective degrees of freedom ν k would be up to {numbers.fixed(by_dof, 2)} (G.4)."
    return text


def source_words(row: BudgetRow, instruments: Mapping[str, type[Instrument]]) -> str:
    """A source in words; `instruments` by their labels."""
    names = [label(name, _NAME) for name in row.of]
    match row.kind:
        case "joint":
            return f"joint {names[0]}"
        case "spot":
            if names:
                rotation = ", rotation" if row.unit == "deg" else ""
                return f"{instruments[row.of[0]].words.reading} of {names[0]}{rotation}"
            return next(iter(instruments.values())).words.reading
        case "prior" | "target":
            return f"prior of {names[0]}"
        case "distance":
            return f"distance {names[0]} to {names[1]}"
        case "angle":
            return f"angle {names[0]} to {names[1]}"
        case "noise factors":
            return "how well the noise is known"
        case _:
            return "curvature of the posterior"


def _tables(result: Result, what: str, budgets: Sequence[Budget]) -> list[Block | None]:
    """Contributions and results, then sensitivities; a source a row, a parameter a column."""
    rows = [budget.rows for budget in budgets]
    largest = [max(abs(column[i].share) for column in rows) for i in range(len(rows[0]))]
    ranked = sorted(range(len(largest)), key=lambda i: -largest[i])
    kept = {i for i in ranked[:MOST_SOURCES] if largest[i] >= MINOR}
    if len(ranked) - len(kept) == 1:
        kept = set(ranked)
    others = [i for i in ranked if i not in kept]
    instruments, k = result.inputs.instruments, result.coverage_factor
    assumed = {row.name for row in result.parameters if row.status == "assumed"}
    heads = [
        f"{label(budget.name)} ({numbers.symbol(budget.unit)}){', assumed' if budget.name in assumed else ''}"
        for budget in budgets
    ]
    shown = []
    for i in sorted(kept):
        source = rows[0][i]
        std = _std(source)
        cells = [
            _contribution(column[i].contribution, column[i].share, b)
            for column, b in zip(rows, budgets, strict=True)
        ]
        shown.append(row_of(source_words(source, instruments), std, *cells))
    note = None
    if others:
        below = max(math.floor(100 * largest[others[0]]) + 1, round(100 * MINOR))
        name = f"{len(others)} others, each <{numbers.NO_BREAK}{below}{numbers.NO_BREAK}%"
        cells = [_together([column[i] for i in others], b) for column, b in zip(rows, budgets, strict=True)]
        shown.append(row_of(name, "", *cells))
        note = Paragraph(f"The others: {listed([source_words(rows[0][i], instruments) for i in others], 6)}.")
    shown += [
        row_of("combined u", "", *(numbers.spread(b.std) for b in budgets)),
        row_of("ν effective", "", *(_dof(b.dof) for b in budgets)),
        row_of(f"expanded U ({numbers.coverage(k)})", "", *(numbers.spread(k * b.std) for b in budgets)),
        row_of("result", "", *(_result(result, b) for b in budgets)),
    ]
    columns = ["source", "its u, type", *heads]
    of = "the offsets" if what == "offsets" else "the tool"
    return [
        table_of(f"Contributions to the uncertainty of {of}", columns, shown),
        note,
        on_screen(_sensitivities(of, instruments, rows, sorted(kept), heads)),
    ]


def _sensitivities(
    of: str,
    instruments: Mapping[str, type[Instrument]],
    rows: Sequence[Sequence[BudgetRow]],
    kept: list[int],
    heads: list[str],
) -> Table | None:
    shown = [
        row_of(
            source_words(rows[0][i], instruments),
            f"per {numbers.symbol(rows[0][i].unit or '')}",
            *(numbers.or_words(column[i].sensitivity, "", digits=2) for column in rows),
        )
        for i in kept
        if rows[0][i].sensitivity is not None
    ]
    columns = ["source", "sensitivity", *heads]
    caption = f"Sensitivities of {of}: contribution per unit of the source’s u, all its readings together"
    return table_of(caption, columns, shown, "llr") if shown else None


def _std(source: BudgetRow) -> str:
    if source.std is None:
        return ""
    type_b = source.dof is None
    std = (numbers.exact if type_b else numbers.spread)(source.std, source.unit or "")
    return f"{std}, {source.type}"


def _contribution(contribution: float, share: float, budget: Budget) -> str:
    """With one digit more than the combined uncertainty has, and its share of the variance."""
    digits = numbers.decimals(budget.std) + 1
    least = 10.0**-digits
    if abs(contribution) < least / 2:
        return f"<{numbers.NO_BREAK}{numbers.fixed(least / 2, digits + 1)}"
    percent = numbers.fixed(100 * share, 0) if abs(share) >= 0.005 else "<1"
    return f"{numbers.fixed(contribution, digits)} ({percent}{numbers.NO_BREAK}%)"


def _together(rows: Sequence[BudgetRow], budget: Budget) -> str:
    """Of several sources: their variances added."""
    variance = sum(math.copysign(row.contribution**2, row.contribution) for row in rows)
    root = math.copysign(math.sqrt(abs(variance)), variance)
    return _contribution(root, sum(row.share for row in rows), budget)


def _dof(dof: float | None) -> str:
    return "∞" if dof is None else str(math.floor(dof)) if dof >= 1 else numbers.significant(dof, 2)


def _result(result: Result, budget: Budget) -> str:
    estimate = result.parameters.named(budget.name).estimate
    assert estimate is not None  # a budget is of what the data determine
    u = result.coverage_factor * budget.std
    return f"{numbers.estimate(estimate, u)} ± {numbers.spread(u)}"


# ── the linear intervals against the posterior ────────────────────────────────────────────────


def _check(result: Result) -> list[Block | None]:
    checked = [(budget, budget.check) for budget in result.budget if budget.check is not None]
    if not result.budget:
        return []
    if not checked:
        return [Paragraph("The intervals were not checked against the posterior: it has not converged.")]
    rows = []
    for budget, check in checked:
        unit = budget.unit
        digits = f"to {check.digits} digit{'s' if check.digits > 1 else ''}"
        too_large = f"Monte Carlo error {numbers.significant(check.too_large, 2)} times too large"
        word, mark = {
            True: (f"yes, {digits}", "identified"),
            False: (f"no, not {digits}", "weak"),
            None: (f"inconclusive: {too_large}", ""),
        }[check.validated]
        ends = (check.d_low, check.d_high, check.tolerance)
        rows.append(
            row_of(
                label(budget.name),
                *(numbers.significant(value, 2, unit) for value in ends),
                numbers.significant(2 * check.ends_std, 2, unit),
                Cell(word, mark=mark),
                tone=mark,
            )
        )
    columns = [
        "name",
        "lower ends apart",
        "upper ends apart",
        "tolerance δ",
        "Monte Carlo error of the ends",
        "validated",
    ]
    about = (
        "The linear 95 % interval, with k of ν, against that of the posterior’s draws (JCGM 101:2008, clause"
        " 8): validated if the ends agree to δ, half a unit in the last of two significant digits of u, or of"
        " one where the draws cannot decide by two."
    )
    if any(check.validated is False for _, check in checked):
        about += " Where the answer is no, use the posterior’s interval."
    if any(check.validated is None for _, check in checked):
        about += (
            " Where it is inconclusive, the ends are so close to δ that"
            f" {result.posterior.draws} draws do not decide."
        )
    table = table_of("Linear intervals against the posterior", columns, rows, "lrrrrl")
    return [Paragraph(about), on_screen(table)]
