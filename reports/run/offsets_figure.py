"""Figure: the offsets with their 95 % intervals, and how wide those are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...analysis.answer.result import Result
from ...analysis.solution import ParameterResult
from ...words import numbers
from ...words.wording import NOT_DETERMINED, label
from ..style.canvas import Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..style.typeface import in_font

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_UNIT = {"deg": "°"}


def offsets_picture(result: Result) -> Picture:
    """Left the estimates, right the half widths of their intervals on a logarithmic scale.

    Prismatic joints (mm) have a panel row of their own. A parameter without an estimate has a
    hatched band and no dot anywhere.
    """
    offsets = [row for row in result.parameters if row.group == "offset"]
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
            _estimates(left, rows, _UNIT.get(unit, unit))
            _widths(right, rows, _UNIT.get(unit, unit))
        svg = to_svg(figure, "offsets")
    return Picture("offsets", "Offsets with their 95 % intervals", _alt(offsets), svg)


def _rows(axes: Axes, rows: Sequence[ParameterResult]) -> None:
    axes.set_ylim(len(rows) - 0.4, -0.6)
    axes.set_yticks(range(len(rows)), [in_font(label(row.name, 16)) for row in rows])
    bare_y(axes)


def _estimates(axes: Axes, rows: Sequence[ParameterResult], unit: str) -> None:
    _rows(axes, rows)
    axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=10)
    for y, row in enumerate(rows):
        colour, shape = light(row.status), SHAPES[row.status]
        if row.estimate is None:
            hatched(axes, y, NOT_DETERMINED)
        elif row.interval95 is None:
            axes.plot([row.estimate], [y], shape, markersize=5.5, markerfacecolor="none", color=colour)
            axes.annotate(
                "held",
                (row.estimate, y),
                xytext=(7, 0),
                textcoords="offset points",
                va="center",
                color=colour,
                fontsize=9,
            )
        else:
            axes.plot(row.interval95, [y, y], "-", linewidth=2, color=colour, solid_capstyle="round")
            axes.plot([row.estimate], [y], shape, markersize=5, color=colour)
    axes.axvline(0, color=light("muted"), linewidth=0.8)
    axes.margins(x=0.08)
    axes.set_xlabel(f"offset, {unit}, with 95 % interval")


def _widths(axes: Axes, rows: Sequence[ParameterResult], unit: str) -> None:
    _rows(axes, rows)
    axes.tick_params(axis="y", labelleft=False)
    axes.set_xscale("log")
    halves = []
    for y, row in enumerate(rows):
        if row.estimate is None:
            hatched(axes, y, "")
        if row.interval95 is None:
            continue
        low, high = row.interval95
        half = (high - low) / 2
        halves.append(half)
        axes.plot([half], [y], SHAPES[row.status], markersize=5, color=light(row.status))
        axes.annotate(
            numbers.spread(half, row.unit),
            (half, y),
            xytext=(7, 0),
            textcoords="offset points",
            va="center",
            fontsize=9,
        )
    if halves:
        # Whole decades, and room for the number next to the last dot.
        lowest = 10.0 ** math.floor(math.log10(min(halves)))
        axes.set_xlim(lowest * 0.8, max(max(halves) * 12, lowest * 13))
    else:
        axes.set_xticks([])
    axes.minorticks_off()
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_xlabel(f"half width of the interval, {unit}")


def _alt(rows: Sequence[ParameterResult]) -> str:
    parts = []
    for row in rows:
        name = label(row.name)
        if row.estimate is None:
            parts.append(f"{name} {NOT_DETERMINED}")
        elif row.interval95 is None or row.std is None:
            parts.append(f"{name} held")
        else:
            interval = numbers.interval(row.interval95, row.std, row.unit)
            parts.append(f"{name} {interval} ({row.status})")
    return f"95 % intervals of the joint offsets: {'; '.join(parts)}."
