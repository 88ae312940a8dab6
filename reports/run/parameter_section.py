"""The parameters of an answer: a table of them, what their status means and why; the figure of the offsets; a
rehearsal's true values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.status import NOT_DESCRIBED, UNVALIDATED, Status
from ...model.errors import BadInput
from ...model.likelihood.parameters import Group
from ...words import numbers
from ...words.geometry_words import (
    IF_IT_DEVIATES,
    SET_BY_TOLERANCES,
    OffsetRow,
    by_tolerances,
    worth_sentence,
)
from ...words.numbers import unit_of
from ...words.observability import reason
from ...words.provenance import true_values
from ...words.trust import tolerances_of, without_estimate
from ...words.wording import NOT_DETERMINED, label, listed, person, sentence, status_words
from ..style.blocks import (
    Cell,
    Column,
    FigureBlock,
    Legend,
    LegendEntry,
    Paragraph,
    Row,
    Section,
    Table,
    on_screen,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture, bare_y, beside, hatched, mark_unvalidated, new_figure, style, to_svg
from ..style.theme import SHAPES, in_font, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...analysis.answer.result import Result
    from ...analysis.observability.check import CheckedParameter
    from ...analysis.solution import ParameterResult

    JudgedParameter = ParameterResult | CheckedParameter  # by measurements, or by a plan

OFFSETS = "Joint offsets of the arm: true position = recorded position + offset"
NO_NUMBER = "—"
UNVALIDATED_OFFSETS = f"Joint offsets, {UNVALIDATED}; not to be applied"


def noise_factors(parameters: Sequence[JudgedParameter]) -> bool:
    """Whether joints and spot have factors of their own, that are estimated."""
    return any(row.group == "noise" and not row.held for row in parameters)


def offsets_section(result: Result) -> Section:
    """The offsets: the first thing that a reader sees. What has a tolerance has a section of its own."""
    others = [row for row in result.parameters if not row.tolerated]
    worth = offsets_worth(result)
    return section_of(
        "Offsets",
        offsets_table(result),
        None if worth is None or result.geometry.tolerance is None else Paragraph(worth),
        Legend(legend((row.status for row in others), result.inputs.header), reasons(others)),
        FigureBlock("offsets", screen_only=True),
    )


def offsets_worth(result: Result) -> str | None:
    """What U is worth if the geometry is not as it was taken. A misfit has found it wrong already: None."""
    if result.misfit is not None:
        return None
    offsets = [row for row in result.parameters if row.group == "offset"]
    return worth_sentence(result.geometry, offsets, result.coverage_factor)


def offsets_table(result: Result) -> Table:
    """The offsets with their uncertainties; of a misfit without what those would be worth."""
    offsets = [row for row in result.parameters if row.group == "offset"]
    geometry = None if offsets_worth(result) is None else result.geometry
    return offsets_table_of(offsets, result.coverage_factor, geometry)


def offsets_table_of(
    offsets: Sequence[ParameterResult], k: float, geometry: GeometryResult | None = None
) -> Table:
    """Offsets with U = `k` u; with the `geometry` also what these are worth."""
    caption = UNVALIDATED_OFFSETS if any(row.status == "unvalidated" for row in offsets) else OFFSETS
    table = parameter_table(caption, offsets, k, f"U ({numbers.coverage(k)})")
    if geometry is None:
        return table
    worth, of = worth_column(geometry, k)
    rows = [
        Row((*shown.cells, Cell(of(row))), shown.tone) for row, shown in zip(offsets, table.rows, strict=True)
    ]
    return Table(table.caption, (*table.columns, Column(worth, "right")), rows)


def worth_column(geometry: GeometryResult, k: float = 1.0) -> tuple[str, Callable[[OffsetRow], str]]:
    """The head of the column beside u (or U, with its coverage factor `k`), and what it says of an offset."""

    def share(row: OffsetRow) -> str:
        return NO_NUMBER if row.tolerance_share is None else numbers.percent(row.tolerance_share)

    def considered(row: OffsetRow) -> str:
        value = None if row.std is None else geometry.consider.get(row.name)
        return NO_NUMBER if value is None else numbers.spread(k * value, unit_of(row.unit))

    if geometry.tolerance is not None:
        return SET_BY_TOLERANCES, share
    return IF_IT_DEVIATES if k == 1 else IF_IT_DEVIATES.replace("u", "U", 1), considered


def other_tables(parameters: Sequence[ParameterResult], k: float) -> list[Table]:
    """Of what was estimated besides the offsets, without what has a tolerance."""
    captions: tuple[tuple[str, Group], ...] = (
        ("Targets in the base frame", "target"),
        ("Tool in the flange frame", "tool"),
        ("Frame of the instrument in the base frame", "frame"),
        ("Noise, as a multiple of the stated", "noise"),
    )
    groups = [
        (caption, [row for row in parameters if row.group == group and not row.tolerated])
        for caption, group in captions
    ]
    return [parameter_table(caption, rows, k) for caption, rows in groups if rows]


def parameter_table(caption: str, rows: Sequence[ParameterResult], k: float, head: str = "U") -> Table:
    """Parameters with their expanded uncertainties, U = `k` u; what is unvalidated has none. The interval of
    a noise factor, which is not symmetric, is given in place of U."""
    noise = any(row.group == "noise" for row in rows)
    columns = ["name", "estimate", "95 % interval" if noise else head, "status"]
    shown = [_parameter_row(row, k) for row in rows]
    if any(row.status == "unvalidated" for row in rows):
        del columns[2]
        shown = [_without_u(row) for row in shown]
    return table_of(caption, columns, shown, "lrrl" if len(columns) == 4 else "lrl")


def _without_u(row: Row) -> Row:
    """A row without its third column, in which the second cell of some spans it."""
    first, second, *_, last = row.cells
    return Row((first, replace(second, span=1), last), row.tone)


def _parameter_row(row: ParameterResult, k: float) -> Row:
    """One parameter. Without an estimate there is no number in its row that could be taken for one."""
    status, unit = row.status, unit_of(row.unit)
    name, word = label(row.name), Cell(status_words(status), mark=status)
    if row.held and row.estimate is not None:
        return row_of(name, Cell(f"held at {numbers.exact(row.estimate, unit)}", span=2), word, tone=status)
    if row.estimate is None or row.std is None:
        return row_of(name, Cell(without_estimate(row), span=2), word, tone=status)
    u = k * row.std
    expanded = numbers.spread(u, unit)
    if row.group == "noise" and row.interval95 is not None:
        expanded = numbers.interval(row.interval95, u, unit)
    return row_of(name, numbers.estimate(row.estimate, u, unit), expanded, word, tone=status)


def legend(statuses: Iterable[Status], header: Mapping[str, object]) -> list[LegendEntry]:
    """What each status that occurs means, in words."""
    tolerances = [numbers.exact(limit, unit) for unit, limit in tolerances_of(header).items()]
    within = " or ".join(tolerances) or "the tolerance"
    meaning: dict[Status, str] = {
        "identified": f"the measurements determine it, standard uncertainty u within {within}",
        "weak": f"the measurements determine it, u beyond {within}",
        "assumed": (
            "the measurements determine it only with what is assumed of tool or instruments, and neither"
            " stated nor measured: no part of a pass, and not entered"
        ),
        "unvalidated": (
            f"the data determine a number, but {NOT_DESCRIBED}: neither estimate"
            " nor uncertainty can be relied on"
        ),
        "unidentifiable": "the data add nothing to its prior; it has no estimate",
        "held": "not estimated; the reason is stated below",
    }
    present = set(statuses)
    return [LegendEntry(key, status_words(key), text) for key, text in meaning.items() if key in present]


def reasons(parameters: Sequence[JudgedParameter]) -> list[LegendEntry]:
    """Why parameters are held, weak or without an answer, or what they rest on; one reason once."""
    grouped: dict[tuple[Status, str], list[str]] = {}
    for row in parameters:
        if row.cause is not None:
            why = by_tolerances(row.cause, row.tolerance_share) or reason(row.cause, person)
            grouped.setdefault((row.status, why), []).append(label(row.name))
    return [
        LegendEntry(status, f"{listed(names)}:", sentence(text)) for (status, text), names in grouped.items()
    ]


def draw_offsets(axes: Axes, result: Result) -> None:
    """The estimates with their expanded uncertainties in a reader's own axes.

    BadInput where the offsets have two units: one axis cannot have both.
    """
    offsets = [row for row in result.parameters if row.group == "offset"]
    units = list(dict.fromkeys(row.unit for row in offsets))
    if len(units) > 1:
        raise BadInput(
            "the offsets have several units, and one axis cannot have them all",
            found=", ".join(units),
            allowed="the figure without `ax`, which has a panel for each unit",
            argument="ax",
        )
    with style():
        _estimates(axes, offsets, numbers.symbol(units[0]), result.coverage_factor)


def offsets_picture(result: Result) -> Picture:
    """Left the estimates, right their expanded uncertainties on a logarithmic scale.

    Prismatic joints (mm) have a panel row of their own. A parameter without an estimate has a
    hatched band and no dot anywhere.
    """
    offsets, k = [row for row in result.parameters if row.group == "offset"], result.coverage_factor
    units = list(dict.fromkeys(row.unit for row in offsets))
    groups = [[row for row in offsets if row.unit == unit] for unit in units]
    with style():
        figure = new_figure(0.5 * len(units) + 0.27 * len(offsets) + 0.1)
        panels = figure.subplots(
            len(units),
            2,
            squeeze=False,
            height_ratios=[len(group) + 1.5 for group in groups],
            width_ratios=[1.55, 1],
        )
        for (left, right), rows, unit in zip(panels, groups, units, strict=True):
            _estimates(left, rows, numbers.symbol(unit), k)
            _widths(right, rows, numbers.symbol(unit), k)
        svg = to_svg(figure, "offsets")
    title = f"Offsets with their expanded uncertainties U ({numbers.coverage(k)})"
    if result.misfit is not None:
        title = UNVALIDATED_OFFSETS
    return Picture("offsets", title, _alt(offsets, k), svg)


def _rows(axes: Axes, rows: Sequence[ParameterResult]) -> None:
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [in_font(label(row.name, 16)) for row in rows])
    bare_y(axes)


def _estimates(axes: Axes, rows: Sequence[ParameterResult], unit: str, k: float) -> None:
    _rows(axes, rows)
    axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=10)
    for y, row in enumerate(rows):
        colour, shape = light(row.status), SHAPES[row.status]
        if row.estimate is None:
            hatched(axes, y, NOT_DETERMINED)
        elif row.std is None or row.status == "unvalidated":
            axes.plot([row.estimate], [y], shape, markersize=5.5, markerfacecolor="none", color=colour)
            beside(axes, row.estimate, y, row.status, color=colour)
        else:
            ends = [row.estimate - k * row.std, row.estimate + k * row.std]
            axes.plot(ends, [y, y], "-", linewidth=2, color=colour, solid_capstyle="round")
            axes.plot([row.estimate], [y], shape, markersize=5, color=colour)
    axes.axvline(0, color=light("muted"), linewidth=0.8)
    axes.margins(x=0.08)
    unvalidated = any(row.status == "unvalidated" for row in rows)
    axes.set_xlabel(f"estimate, {unit}" if unvalidated else f"offset ± U, {unit}")
    mark_unvalidated(axes, [row.status for row in rows])


def _widths(axes: Axes, rows: Sequence[ParameterResult], unit: str, k: float) -> None:
    _rows(axes, rows)
    axes.tick_params(axis="y", labelleft=False)
    axes.set_xscale("log")
    halves = []
    for y, row in enumerate(rows):
        if row.estimate is None:
            hatched(axes, y, "")
        if row.status == "unvalidated":
            hatched(axes, y, "no U")
        if row.std is None or row.status == "unvalidated":
            continue
        half = k * row.std
        halves.append(half)
        axes.plot([half], [y], SHAPES[row.status], markersize=5, color=light(row.status))
        beside(axes, half, y, numbers.spread(half, row.unit))
    if halves:
        # Whole decades, and room for the number next to the last dot.
        lowest = 10.0 ** math.floor(math.log10(min(halves)))
        axes.set_xlim(lowest * 0.8, max(max(halves) * 12, lowest * 13))
    else:
        axes.set_xticks([])
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel(f"U, {unit}")


def _alt(rows: Sequence[ParameterResult], k: float) -> str:
    parts = []
    for row in rows:
        name = label(row.name)
        if row.estimate is None:
            parts.append(f"{name} {NOT_DETERMINED}")
        elif row.std is None:
            parts.append(f"{name} held")
        elif row.status == "unvalidated":
            parts.append(f"{name} {numbers.estimate(row.estimate, k * row.std, row.unit)}")
        else:
            u = k * row.std
            value = f"{numbers.estimate(row.estimate, u, row.unit)} ± {numbers.spread(u, row.unit)}"
            parts.append(f"{name} {value} ({status_words(row.status)})")
    unvalidated = any(row.status == "unvalidated" for row in rows)
    return f"{UNVALIDATED_OFFSETS if unvalidated else 'Joint offsets ± U'}: {'; '.join(parts)}."


class Estimated(Protocol):
    """A parameter with what is known of it."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def estimate(self) -> float | None: ...
    @property
    def std(self) -> float | None: ...


def rehearsal_section(result: Result) -> Section | None:
    """Of a simulated run; None of any other."""
    k, true = result.coverage_factor, true_values(result.inputs.provenance)
    table = truth_table(true, result.parameters, k) if result.misfit is None else None
    if table is None:
        return None
    about = Paragraph(
        "The run is simulated, so the true values are known. About 19 of 20 errors should be below U."
        f" {errors_sentence(true, result.parameters, k)}"
    )
    return section_of("Rehearsal: estimates and true values", about, on_screen(table))


def errors_sentence(true: Mapping[str, float], rows: Iterable[Estimated], k: float) -> str:
    """Which estimates are off by more than U, or that none is."""
    larger = []
    for row in rows:
        if row.name not in true or row.estimate is None or row.std is None:
            continue
        error, expanded = abs(row.estimate - true[row.name]), k * row.std
        if error > expanded:
            unit = unit_of(row.unit)
            off = numbers.with_unit(numbers.fixed(error, numbers.decimals(expanded)), unit)
            larger.append(f"{label(row.name)} is off by {off} (U {numbers.spread(expanded, unit)})")
    return f"Larger than U: {listed(larger)}." if larger else "No error is larger than U."


def truth_table(true: Mapping[str, float], rows: Iterable[Estimated], k: float) -> Table | None:
    """The estimates beside their true values; None where there is none. What has no estimate has no row."""
    known = [
        _row(row.name, row.unit, true[row.name], row.estimate, k * row.std)
        for row in rows
        if row.name in true and row.estimate is not None and row.std is not None
    ]
    if not known:
        return None
    return table_of(
        "True values of the simulated arm", ["name", "true value", "estimate", "error", "error over U"], known
    )


def _row(name: str, unit: str, true: float, estimate: float, expanded: float) -> Row:
    shown, digits = unit_of(unit), numbers.decimals(expanded)
    return row_of(
        label(name),
        numbers.with_unit(numbers.fixed(true, digits), shown),
        numbers.estimate(estimate, expanded, shown),
        numbers.with_unit(numbers.fixed(estimate - true, digits), shown),
        numbers.fixed((estimate - true) / expanded, 1),
    )
