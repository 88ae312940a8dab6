"""The section on the arm's geometry: what the tolerances do to the offsets, the links, the model ladder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...analysis.observability.geometry_result import Rung
from ...words import numbers
from ...words.geometry_words import (
    RUNGS,
    SET_BY_TOLERANCES,
    confounded_sentence,
    correlation,
    determined_sentence,
    factors_sentence,
    geometry_title,
    rung_reason,
)
from ...words.numbers import unit_of
from ...words.wording import label, listed, person
from ..style.blocks import (
    FigureBlock,
    Legend,
    Paragraph,
    Section,
    Table,
    on_screen,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import Picture, bare_y, beside, new_figure, style, to_svg
from ..style.theme import light
from .parameter_section import NO_NUMBER, reasons

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from ...analysis.answer.result import Result
    from ...analysis.solution import ParameterResult

LADDER = "ladder"
_MOST_SAID = 2  # sentences on what an offset is confounded with; the table has all


def geometry_section(result: Result) -> Section | None:
    """None where nothing has a tolerance, or where there is no answer."""
    rows = [row for row in result.parameters if row.tolerated]
    if not rows or not result.likelihood.converged:
        return None
    held = [row for row in rows if row.held]
    sentences = [
        *confounded_lines(result)[:_MOST_SAID],
        factors_sentence(result.geometry),
    ]
    return section_of(
        geometry_title(rows),
        *(Paragraph(text) for text in sentences if text),
        _offsets(result),
        on_screen(_links(rows, result.coverage_factor)),
        on_screen(prior_only(rows)),
        Legend([], reasons(held)) if held else None,
        on_screen(ladder_table(result)),
        FigureBlock(LADDER, screen_only=True),  # the table says the same
    )


def confounded_lines(result: Result) -> list[str]:
    """Of each offset of which the tolerances set most of the variance, why."""
    offsets = [
        row
        for row in result.parameters
        if row.group == "offset" and row.status != "assumed" and row.std is not None
    ]
    sentences = (
        confounded_sentence(result.geometry, row.name, row.tolerance_share, person)
        for row in sorted(offsets, key=lambda row: -(row.std or 0.0))
    )
    return [text for text in sentences if text]


def _offsets(result: Result) -> Table | None:
    """What the tolerances do to each offset."""
    geometry, k = result.geometry, result.coverage_factor
    if not any(value is not None for value in geometry.at_half.values()):
        return None
    columns = ["name", "U", SET_BY_TOLERANCES, "at half", "at twice", "nominal", "most correlated with"]
    rows = []
    for row in result.parameters:
        if row.group != "offset" or row.std is None or row.tolerance_share is None:
            continue
        rivals = [rival for rival in geometry.confounded if rival.offset == row.name]
        most = max(rivals, key=lambda rival: abs(rival.correlation), default=None)
        others = (geometry.at_half, geometry.at_twice, geometry.consider)
        rows.append(
            row_of(
                label(row.name),
                numbers.spread(k * row.std, row.unit),
                numbers.percent(row.tolerance_share),
                *(
                    NO_NUMBER if (u := values.get(row.name)) is None else numbers.spread(k * u, row.unit)
                    for values in others
                ),
                "" if most is None else f"{label(most.parameter)} ({correlation(most)})",
            )
        )
    caption = (
        "U of the offsets, at half and at twice the tolerances, and with nominal geometry if the arm deviates"
    )
    return table_of(caption, columns, rows, "lrrrrrl")


def _links(rows: Sequence[ParameterResult], k: float) -> Table | None:
    """The parameters that the measurements determine, as deviations from nominal."""
    columns = ["name", "estimate", "U", "tolerance", "reduced by"]
    shown = [
        row_of(
            label(row.name),
            numbers.estimate(row.estimate, k * row.std, unit_of(row.unit)),
            numbers.spread(k * row.std, unit_of(row.unit)),
            numbers.significant(row.prior_std, 2, unit_of(row.unit)),
            numbers.percent(max(1 - row.std / row.prior_std, 0.0)),
        )
        for row in rows
        if row.estimate is not None and row.std is not None
    ]
    caption = "Deviations from nominal that the measurements determine"
    return table_of(caption, columns, shown) if shown else None


def prior_only(rows: Sequence[ParameterResult]) -> Table | None:
    """The parameters of which the measurements say no more than the tolerances: by tolerance, without an
    estimate."""
    by_tolerance: dict[tuple[str, str], list[ParameterResult]] = {}
    for row in rows:
        if row.estimate is None:
            u = numbers.exact(float(f"{row.prior_std:.2g}"), unit_of(row.unit))
            by_tolerance.setdefault((_kind(row), u), []).append(row)
    if not by_tolerance:
        return None
    caption = "Prior only, without an estimate: these measurements add nothing to the tolerances"
    columns = ["what", "tolerance", "parameters"]
    shown = [row_of(kind, u, _by_body(same)) for (kind, u), same in by_tolerance.items()]
    return table_of(caption, columns, shown, "lrl")


def _by_body(rows: Sequence[ParameterResult]) -> str:
    """The parameters, those of one link or joint together: link 1 (a), link 3 (a, d)."""
    axes: dict[str, list[str]] = {}
    for row in rows:
        body, _, axis = label(row.name).partition(", ")
        axes.setdefault(body.removeprefix("tool."), []).append(axis)
    together = [
        body if names in ([""], ["gravity"]) else f"{body} ({', '.join(names)})"
        for body, names in axes.items()
    ]
    return listed(together, 99)


def _kind(row: ParameterResult) -> str:
    """What a parameter with a tolerance is."""
    _, _, axis = row.name.partition(".")
    if row.group == "tool":
        return "tool, angle" if row.unit == "deg" else "tool, position"
    if axis == "gravity":
        return "deflection by gravity"
    if axis in ("cos", "sin"):
        return "first harmonic"
    return "length of a link" if row.unit == "mm" else "angle of a link"


def ladder_table(result: Result) -> Table | None:
    """The models that were tried, from nominal geometry on."""
    ladder = result.geometry.ladder
    if not ladder:
        return None
    columns = ["model", "parameters", "held-out, rms", "log evidence", "kept"]
    rows = [
        row_of(
            RUNGS[rung.rung],
            str(rung.parameters),
            numbers.or_words(rung.held_out_rms_mm, NO_NUMBER, "mm"),
            numbers.fixed(rung.log_evidence, 1),
            f"{'yes' if rung.kept else 'no'}: {rung_reason(ladder, i)}",
        )
        for i, rung in enumerate(ladder)
    ]
    return table_of("Model ladder: residuals at held-out placements, and evidence", columns, rows, "lrrrl")


def geometry_lines(result: Result) -> list[str]:
    """What the terminal says of the geometry, a line each."""
    geometry = result.geometry
    if geometry.tolerance is None or result.misfit is not None or not result.likelihood.converged:
        return []
    lines = []
    if geometry.factors is not None:
        lines.append(factors_sentence(geometry) or "")
    if (determined := determined_sentence(result.parameters)) is not None:
        lines.append(determined)
    return lines


def ladder_picture(result: Result) -> Picture | None:
    """A dot for each model, filled where it is kept; None without a ladder."""
    ladder = result.geometry.ladder
    if not ladder or not result.likelihood.converged:
        return None
    predicted = [rung.held_out_rms_mm for rung in ladder]
    panels: list[tuple[Sequence[float | None], str, str]] = [
        ([rung.log_evidence for rung in ladder], "log evidence", "")
    ]
    if any(value is not None for value in predicted):
        panels.insert(0, (predicted, "held-out residual, mm rms", "mm"))
    with style():
        figure = new_figure(0.27 * len(ladder) + 0.75)
        axes = figure.subplots(1, len(panels), squeeze=False)[0]
        for k, (panel, (values, title, unit)) in enumerate(zip(axes, panels, strict=True)):
            _panel(panel, ladder, values, unit)
            panel.set_xlabel(title)
            panel.tick_params(axis="y", labelleft=k == 0)
        axes[0].tick_params(axis="y", labelcolor=light("ink"), labelsize=9.5)
        svg = to_svg(figure, LADDER)
    return Picture(LADDER, "The model ladder: filled dots are kept", _alt(ladder), svg)


def _panel(axes: Axes, ladder: Sequence[Rung], values: Sequence[float | None], unit: str) -> None:
    axes.set_ylim(len(ladder) - 0.4, -0.6)
    axes.set_yticks(range(len(ladder)), [RUNGS[rung.rung] for rung in ladder])
    bare_y(axes)
    for y, (rung, value) in enumerate(zip(ladder, values, strict=True)):
        if value is None:
            continue
        colour = light("identified" if rung.kept else "held")
        face = colour if rung.kept else light("ground")
        axes.plot([value], [y], "o", markersize=6, markerfacecolor=face, color=colour)
        text = numbers.significant(value) if unit else numbers.fixed(value, 1)
        beside(axes, value, y, text, gap=8)
    shown = [value for value in values if value is not None]
    low, high = min(shown), max(shown)
    room = (high - low) or abs(high) or 1.0
    axes.set_xlim(0 if unit else low - 0.12 * room, high + 0.4 * room)
    axes.locator_params(axis="x", nbins=4)


def _alt(ladder: Sequence[Rung]) -> str:
    parts = []
    for rung in ladder:
        residual = numbers.or_words(rung.held_out_rms_mm, "no", "mm")
        kept = "kept" if rung.kept else "not kept"
        parts.append(
            f"{RUNGS[rung.rung]}: {residual} held-out residual,"
            f" log evidence {numbers.fixed(rung.log_evidence, 1)}, {kept}"
        )
    return f"Model ladder. {'; '.join(parts)}."
