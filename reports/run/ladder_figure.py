"""Figure: the model ladder, by the residuals at held-out placements and by the evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...analysis.answer.result import Result
from ...analysis.observability.geometry import Rung
from ...words import numbers
from ...words.geometry import RUNGS
from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from .geometry import LADDER

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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
        for k, (own, (values, title, unit)) in enumerate(zip(axes, panels, strict=True)):
            _panel(own, ladder, values, unit, "identified" if result.misfit is None else "unvalidated")
            own.set_xlabel(title)
            own.tick_params(axis="y", labelleft=k == 0)
        axes[0].tick_params(axis="y", labelcolor=light("ink"), labelsize=9.5)
        svg = to_svg(figure, LADDER)
    return Picture(LADDER, "The model ladder: filled dots are kept", _alt(ladder), svg)


def _panel(axes: Axes, ladder: Sequence[Rung], values: Sequence[float | None], unit: str, role: str) -> None:
    axes.set_ylim(len(ladder) - 0.4, -0.6)
    axes.set_yticks(range(len(ladder)), [RUNGS[rung.rung] for rung in ladder])
    bare_y(axes)
    for y, (rung, value) in enumerate(zip(ladder, values, strict=True)):
        if value is None:
            continue
        colour = light(role if rung.kept else "held")
        face = colour if rung.kept else light("ground")
        axes.plot([value], [y], "o", markersize=6, markerfacecolor=face, color=colour)
        text = numbers.significant(value) if unit else numbers.fixed(value, 1)
        axes.annotate(text, (value, y), xytext=(8, 0), textcoords="offset points", va="center", fontsize=9)
    shown = [value for value in values if value is not None]
    low, high = min(shown), max(shown)
    room = (high - low) or abs(high) or 1.0
    axes.set_xlim(0 if unit else low - 0.12 * room, high + 0.4 * room)
    axes.locator_params(axis="x", nbins=4)


def _alt(ladder: Sequence[Rung]) -> str:
    said = []
    for rung in ladder:
        found = numbers.or_words(rung.held_out_rms_mm, "no", "mm")
        kept = "kept" if rung.kept else "not kept"
        said.append(
            f"{RUNGS[rung.rung]}: {found} held-out residual,"
            f" log evidence {numbers.fixed(rung.log_evidence, 1)}, {kept}"
        )
    return f"Model ladder. {'; '.join(said)}."
