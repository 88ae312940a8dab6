"""Figures of a study over two axes of numbers: a map of the uncertainty of the least certain offset, and the
RMSE of simulated runs over the predicted standard uncertainty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from ....analysis.status import Status
from ....experiments.studies.sweeps.grid_answer import Fit, GridAxis, GridCase, GridStudy
from ....model.arrays import Matrix
from ....words import numbers
from ....words.wording import clipped, label
from ...style.canvas import WIDTH, Picture, new_figure, set_log_scale, style, to_svg
from ...style.palette import SHAPES, light
from ...style.typeface import in_font
from ..study_blocks import NOT_DETERMINED
from .grid_words import (
    NO_PLAN,
    axis_title,
    by_point,
    point_name,
    rmse_interval,
    standing,
    unit_signs,
    value_text,
)
from .marks import UNCERTAINTY, Dot, gap_handles, hatch, in_font_within, legend_above, write_gap

_MOST_PANELS = 6
_MOST_WRITTEN = 12  # cells across a figure that numbers can be read in
_SMALLEST = 5.5  # points of words in a cell; below, the legend alone says them
_LIGHTEST, _DARKEST = 0.07, 0.5  # shares of the hue: ink on either can be read
_GAPS = {"unidentifiable": NOT_DETERMINED, "held": NO_PLAN}  # words by the mark of a case
# What is marked: fit, status, words, its mark.
_KINDS: tuple[tuple[Fit, Status | None, str, Dot], ...] = (
    ("likelihood", "identified", "likelihood, identified", Dot(SHAPES["identified"], "ink", 3, True)),
    ("likelihood", "weak", "likelihood, weak", Dot(SHAPES["weak"], "weak", 3, True)),
    ("midpoint", None, "midpoint", Dot("s", "muted", 3, False)),
)
_MOST = 1500  # points that a page can bear
_LEAST_RANGE = 2.0  # of the scale, either side of 1


def map_picture(study: GridStudy) -> Picture:
    """The first two axes of numbers across and up; a panel for each place on the others.

    A cell has the predicted uncertainty of the least certain offset, the fuller in colour the larger, and a
    diamond where that exceeds the tolerance; one that does not identify all offsets is hatched, without a
    number.
    """
    across, up = [i for i, axis in enumerate(study.axes) if axis.numeric is not None][:2]
    every_panel = by_point(study, {across, up})
    panels = every_panel[:_MOST_PANELS]
    columns, rows = (_order(study.axes[i]) for i in (across, up))
    wide = 1 if len(panels) == 1 or len(columns) > _MOST_WRITTEN // 2 else 2
    high = math.ceil(len(panels) / wide)
    cell = min(0.32, 4.6 / high / len(rows))
    across_pt = 72 * (WIDTH - 0.8) / wide / len(columns)
    sizes = (min(8.0, 66 * cell, across_pt / 3.4), min(7.5, 40 * cell, across_pt / 5.6))
    written = len(columns) * wide <= _MOST_WRITTEN and cell > 0.15
    stds = [case.worst_std for case in study.cases if case.worst_std is not None]
    bounds = (min(stds), max(stds)) if stds else None
    with style():
        figure = new_figure(1.05 + high * (cell * len(rows) + 0.45))
        every = figure.subplots(high, wide, squeeze=False, sharex=True, sharey=True)
        for k, axes in enumerate(every.flat):
            if k >= len(panels):
                axes.set_visible(False)
                every.flat[k - wide].tick_params(labelbottom=True)
                continue
            panel_point, cases = panels[k]
            for case in cases:
                at = (columns.index(case.at[across]), rows.index(case.at[up]))
                _cell(axes, at, case, bounds, sizes if written else None)
            if panel_point:
                axes.set_title(in_font_within(point_name(panel_point), 80 // wide), fontsize=9, pad=4)
            _finish(axes, study.axes[across], columns, study.axes[up], rows)
        figure.supxlabel(in_font(axis_title(study.axes[across])), fontsize=9.5, color=light("muted"))
        figure.supylabel(in_font(axis_title(study.axes[up])), fontsize=9.5, color=light("muted"))
        _legend(figure, study, bounds)
        svg = to_svg(figure, "map")
    title = f"Predicted {UNCERTAINTY} of the least certain offset, °; the fuller the colour the larger"
    if len(panels) < len(every_panel):
        title += f"; {len(panels)} of {len(every_panel)} maps shown, all cases in cases.csv"
    return Picture("map", title, _map_alt(study), svg)


def _order(axis: GridAxis) -> list[int]:
    """Indices of the values of an axis, by rising value."""
    values = axis.numeric or ()
    return sorted(range(len(values)), key=values.__getitem__)


def _shade(std: float, bounds: tuple[float, float]) -> float:
    """Share of the hue for a std, logarithmic."""
    low, high = map(math.log, bounds)
    part = (math.log(std) - low) / (high - low) if high > low else 0.0
    return _LIGHTEST + part * (_DARKEST - _LIGHTEST)


def _cell(
    axes: Axes,
    at: tuple[int, int],
    case: GridCase,
    bounds: tuple[float, float] | None,
    sizes: tuple[float, float] | None,
) -> None:
    """One cell; `sizes` are those of its number and of words, points, where they can be read."""
    x, y = map(float, at)
    mark, _ = standing(case)

    def patch(**options: Any) -> None:
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **options))

    if case.worst_std is None or bounds is None:
        words = _GAPS.get(mark, NOT_DETERMINED)
        hatch(patch, words=words)
        if sizes is not None and sizes[1] > _SMALLEST:
            lines = words.replace(" ", "\n")
            write_gap(axes, x, y, lines, va="center", linespacing=0.95, fontsize=sizes[1])
        return
    patch(facecolor=light("identified"), alpha=_shade(case.worst_std, bounds), linewidth=0)
    patch(facecolor="none", edgecolor=light("ground"), linewidth=1.0)
    if sizes is not None:
        number = numbers.spread(case.worst_std)
        axes.text(x, y, number, ha="center", va="center_baseline", fontsize=sizes[0])
    if mark == "weak":
        x, y = (x - 0.4, y + 0.32) if sizes is not None else (x, y)
        axes.plot([x], [y], SHAPES["weak"], markersize=3.2, color=light("weak"))


def _finish(axes: Axes, across: GridAxis, columns: list[int], up: GridAxis, rows: list[int]) -> None:
    axes.grid(visible=False)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(-0.5, len(rows) - 0.5)

    def ticks(axis: GridAxis, order: Sequence[int], most: int) -> tuple[list[int], list[str]]:
        at = list(range(0, len(order), math.ceil(len(order) / most)))
        return at, [numbers.exact((axis.numeric or ())[order[i]]) for i in at]

    axes.set_xticks(*ticks(across, columns, 10))
    axes.set_yticks(*ticks(up, rows, 16))
    axes.tick_params(length=0, labelsize=8.5)
    axes.spines[["left", "bottom"]].set_visible(False)


def _legend(figure: Figure, study: GridStudy, bounds: tuple[float, float] | None) -> None:
    """The shades with their numbers, and what the other marks mean."""
    handles: list[Artist] = []
    if bounds is not None:
        low, high = bounds
        handles += [
            Patch(
                facecolor=light("identified"),
                alpha=_shade(std, bounds),
                linewidth=0,
                label=numbers.spread(std, "deg"),
            )
            for std in ((low, math.sqrt(low * high), high) if high > low else (low,))
        ]
    present = {standing(case)[0] for case in study.cases}
    if "weak" in present:
        shape, colour = SHAPES["weak"], light("weak")
        handles.append(Line2D([], [], linewidth=0, label="weak", marker=shape, markersize=4, color=colour))
    legend_above(figure, handles + gap_handles(words for mark, words in _GAPS.items() if mark in present), 6)


def _map_alt(study: GridStudy) -> str:
    """The best and the worst place, and how many have no number."""
    known = [(case.worst_std, case, case.worst) for case in study.cases if case.worst_std is not None]
    texts = []
    for what, pick in (("least", min), ("most", max)) if known else ():
        std, case, one = pick(known, key=lambda entry: entry[0])
        at = ", ".join(
            f"{clipped(axis.label)} {value_text(axis, i)}"
            for axis, i in zip(study.axes, case.at, strict=True)
        )
        name = f" ({label(one.name)})" if one is not None else ""
        texts.append(f"{what} {numbers.spread(std, 'deg')}{name} at {at}")
    for mark, words in _GAPS.items():
        if count := sum(standing(case)[0] == mark for case in study.cases):
            texts.append(f"{words} in {count} of {len(study.cases)} cases")
    return f"Map of the predicted {UNCERTAINTY} of the least certain offset: {'; '.join(texts)}."


def ratio_picture(study: GridStudy) -> Picture | None:
    """All parameters of all cases; 1 is as predicted. None where nothing was observed."""
    if not study.has("likelihood"):
        return None
    ratios = [_ratios(study, fit, status) for fit, status, *_ in _KINDS]
    every = np.concatenate([rows[:_MOST] for rows in ratios])
    with style():
        figure = new_figure(2.6)
        axes = figure.subplots()
        axes.axhline(1.0, color=light("identified"), linewidth=1.4, zorder=2.2, label="as predicted")
        for (_, _, words, dot), rows in zip(_KINDS, ratios, strict=True):
            if len(rows):
                std, ratio, least, most = rows[:_MOST].T
                axes.vlines(std, least, most, color=light(dot.role), linewidth=0.7, zorder=2.0)
                dot.draw(axes, std, ratio, markeredgewidth=0.9, zorder=2.4, label=words)
        low, high = min(every[:, 2].min(), 1 / _LEAST_RANGE), max(every[:, 3].max(), _LEAST_RANGE)
        set_log_scale(axes, "y", low / 1.1, high * 1.1)
        set_log_scale(axes, "x", every[:, 0].min() / 1.3, every[:, 0].max() * 1.3)
        axes.set_xlabel(in_font(f"predicted {UNCERTAINTY} u, {unit_signs(study.parameters)}"))
        axes.set_ylabel("RMSE / predicted u")
        legend_above(figure, None, 4)
        svg = to_svg(figure, "ratio")
    title = f"RMSE of simulated runs over the predicted {UNCERTAINTY}, of all identified parameters"
    if any(len(rows) > _MOST for rows in ratios):
        title += f"; the first {_MOST} of each kind shown, all in offsets.csv"
    return Picture("ratio", title, _ratio_alt(ratios), svg)


def _ratios(study: GridStudy, fit: Fit, status: Status | None) -> Matrix:
    """Rows (n, 4) of parameters of a status (None: any): predicted u, RMSE over it, its 95 % interval."""
    rows = [
        (one.std, errors.rmse / one.std, low / one.std, high / one.std)
        for one in study.parameters
        if one.std and status in (None, one.status) and (errors := one.errors(fit))
        for low, high in [rmse_interval(errors)]
    ]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _ratio_alt(ratios: list[Matrix]) -> str:
    texts = []
    for (_, _, words, _), rows in zip(_KINDS, ratios, strict=True):
        if len(rows):
            low, high, middle = (
                numbers.significant(float(pick(rows[:, 1]))) for pick in (np.min, np.max, np.median)
            )
            texts.append(f"{words}: {len(rows)} from {low} to {high}, median {middle}")
    return f"RMSE of simulated runs divided by the predicted {UNCERTAINTY}. {'; '.join(texts)}."
