"""Figure: rank histograms of simulation-based calibration (Talts et al. 2018), a panel a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...experiments.studies.coverage import CoveragePlan, CoverageSettings
from ...experiments.studies.ranks import Calibration, RankedParameter
from ...words import numbers
from ...words.wording import clipped, label
from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .shares import standing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_ACROSS = 5
_PANEL, _HEAD, _GAP, _BOTTOM = 0.62, 0.28, 0.24, 0.42  # inches: a panel, and what surrounds it
_LEFT, _RIGHT = 0.36, 0.06
_BAND = 0.99


def ranks_picture(plan: CoveragePlan, settings: CoverageSettings, name: str) -> Picture | None:
    """Histograms of the ranks of the truth among the draws, with the band that holds 99 % of uniform bins.

    A bin outside it is solid, so that it is visible in grey too. Everything of one estimator has one
    scale. None where the plan has no ranks.
    """
    parts = [(part, [row for row in part.parameters if sum(row.ranks)]) for part in plan.sbc]
    parts = [(part, rows) for part, rows in parts if rows]
    if not parts:
        return None
    lines = [-(-len(rows) // _ACROSS) for _, rows in parts]
    height = _BOTTOM + sum(_HEAD + count * (_PANEL + _GAP) for count in lines)
    with style():
        figure = new_figure(height, fitted=False)
        width = (WIDTH - _LEFT - _RIGHT) / _ACROSS
        top = height
        outside: list[str] = []
        for (part, rows), count in zip(parts, lines, strict=True):
            figure.text(
                0.04 / WIDTH,
                (top - 0.17) / height,
                in_font(f"{clipped(part.name, 40)} ({standing(part)[1]})"),
                fontsize=9,
                fontweight="bold",
            )
            highest = max(*(max(row.ranks) for row in rows), _band(rows[0].ranks)[1]) * 1.1
            beyond = 0
            for i, row in enumerate(rows):
                down, across = divmod(i, _ACROSS)
                bottom = top - _HEAD - _GAP * (down + 1) + 0.06 - _PANEL * (down + 1)
                axes = figure.add_axes(
                    (
                        (_LEFT + across * width) / WIDTH,
                        bottom / height,
                        (width - 0.1) / WIDTH,
                        _PANEL / height,
                    )
                )
                beyond += _histogram(axes, row, highest, first=across == 0)
            outside.append(_in_words(part, rows, beyond))
            top -= _HEAD + count * (_PANEL + _GAP)
        figure.supxlabel(
            f"rank of the truth among {settings.draws} draws, from lowest to highest",
            fontsize=9.5,
            color=light("muted"),
            y=0.08 / height,
        )
        svg = to_svg(figure, name)
    title = (
        f"Plan {clipped(plan.name, 40)}: how many truths have each rank. Uniform ranks have 99 % of the"
        " bins within the grey band (solid: outside it)"
    )
    alt = f"Histograms of ranks in {settings.bins} bins. {' '.join(outside)}"
    return Picture(name, title, alt, svg)


def _band(ranks: Sequence[int]) -> tuple[float, float]:
    """Between which counts a bin of uniform ranks lies with probability 99 % (binomial)."""
    from scipy.stats import binom

    low, high = binom.interval(_BAND, sum(ranks), 1 / len(ranks))
    return float(low), float(high)


def _histogram(axes: Axes, row: RankedParameter, highest: float, *, first: bool) -> int:
    """Draws one panel; how many bins lie outside the band."""
    ranks = np.asarray(row.ranks)
    low, high = _band(row.ranks)
    x = np.arange(len(ranks))
    out = (ranks < low) | (ranks > high)
    axes.axhspan(low, high, facecolor=light("line"), edgecolor="none", alpha=0.65)
    axes.bar(x[~out], ranks[~out], width=0.86, color=light("identified"), alpha=0.4, linewidth=0)
    axes.bar(x[out], ranks[out], width=0.86, color=light("weak"), linewidth=0)
    axes.axhline(ranks.mean(), color=light("ink"), linewidth=0.8)
    axes.set_xlim(-0.7, len(ranks) - 0.3)
    axes.set_ylim(0, highest)
    axes.set_xticks([])
    axes.grid(visible=False)
    axes.set_yticks([float(ranks.mean())])
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
    axes.tick_params(axis="y", labelsize=7.5, length=2, pad=1.5, labelleft=first)
    p_value = "" if row.p_value is None else f"  p {numbers.p_value(row.p_value)}"
    axes.set_title(in_font(label(row.name, 9)) + p_value, fontsize=7.5, pad=3, loc="left")
    return int(out.sum())


def _in_words(part: Calibration, rows: Sequence[RankedParameter], beyond: int) -> str:
    bins = sum(len(row.ranks) for row in rows)
    said = f"{clipped(part.name, 40)} ({standing(part)[1]}): {beyond} of {bins} bins lie outside the band"
    tests = [f"{label(row.name)} {numbers.p_value(row.p_value)}" for row in rows if row.p_value is not None]
    return f"{said}; p-values {', '.join(tests)}." if tests else f"{said}."
