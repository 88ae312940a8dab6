"""Figure: how often the intervals of each estimator hold the truth, one panel for each level."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...experiments.studies.answer import ObservedParameter, Share
from ...words import numbers
from ...words.wording import clipped, label
from ..style.canvas import WIDTH, Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .phrases import NOT_DETERMINED
from .shares import Judged, percent, share, standing, worst_at

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Rows = list[tuple[Judged, ObservedParameter | None]]  # a row without a parameter heads a part

AGREES, OUTSIDE = "o", "D"  # a dot on the line, a diamond off it; a triangle points beyond the panel
_ROW, _TALLEST = 0.15, 7.2  # inches; the tallest leaves room for what is above it on a page
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.6, 0.06, 0.3, 0.48  # inches about the panels
_HALF_WIDTH = 6.0  # of a panel, in binomial standard deviations


def coverage_picture(
    parts: Sequence[Judged], levels: Sequence[float], runs: int, name: str, title: str
) -> Picture:
    """Rows are the parameters of each part, dots their shares of `runs` with binomial intervals.

    Each panel is as wide as six binomial standard deviations either side of its level, so that what
    agrees can be seen to; what lies outside is at the edge as a triangle with its share.
    """
    rows = [(part, row) for part in parts for row in (None, *part.parameters)]
    height = min(_TALLEST, _TOP + _BOTTOM + _ROW * len(rows))
    # Points: letters shrink with the rows where there are many.
    size = min(8.0, 0.86 * 72 * (height - _TOP - _BOTTOM) / len(rows))
    with style():
        figure = new_figure(height, fitted=False)
        panels = figure.subplots(1, len(levels), squeeze=False, sharey=True)[0]
        figure.subplots_adjust(
            left=_LEFT / WIDTH,
            right=1 - _RIGHT / WIDTH,
            top=1 - _TOP / height,
            bottom=_BOTTOM / height,
            wspace=0.13,
        )
        for axes, level in zip(panels, levels, strict=True):
            _panel(axes, rows, level, size, runs)
        _name_rows(panels[0], rows, size)
        figure.supxlabel(
            "share of intervals that hold the truth, %", fontsize=9.5, color=light("muted"), y=0.04 / height
        )
        svg = to_svg(figure, name)
    title += ". Line: as stated; triangle: a share outside the panel, with its number"
    return Picture(name, title, _alt(parts, levels), svg)


def _name_rows(axes: Axes, rows: Rows, size: float) -> None:
    axes.set_ylim(len(rows) - 0.4, -0.6)
    named = [(y, row) for y, (_, row) in enumerate(rows) if row is not None]
    axes.set_yticks([y for y, _ in named], [in_font(label(row.name, 10)) for _, row in named])
    axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=size)
    for y, (estimator, row) in enumerate(rows):
        if row is None:
            axes.text(
                -_LEFT / _panel_width(axes) + 0.04,
                y + 0.08,
                in_font(f"{clipped(estimator.name, 32)} ({standing(estimator)[1]})"),
                transform=axes.get_yaxis_transform(),
                va="center",
                fontsize=size + 0.5,
                fontweight="bold",
            )


def _panel_width(axes: Axes) -> float:
    return float(axes.get_position().width) * WIDTH


def _panel(axes: Axes, rows: Rows, level: float, size: float, data_sets: int) -> None:
    half = _HALF_WIDTH * math.sqrt(level * (1 - level) / data_sets)
    low, high = 100 * max(level - half, 0.0), 100 * min(level + half, 1.0)
    margin = 0.04 * (high - low)
    axes.set_xlim(low - margin, high + margin)
    bare_y(axes)
    axes.grid(visible=False)
    axes.set_title(percent(level), fontsize=9.5, pad=5)
    for y, (estimator, row) in enumerate(rows):
        if row is None:
            _lines(axes, level, _ticks(level, half), y + 0.55, y + 0.4 + len(estimator.parameters))
        elif not row.shares:
            hatched(axes, y, NOT_DETERMINED, size=size - 0.5)
        else:
            for entry in row.shares:
                if entry.level == level:
                    _share(axes, y, entry, estimator.control, (low, high), size)
    axes.set_xticks(_ticks(level, half))
    axes.tick_params(axis="x", labelsize=7.5, length=2)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _lines(axes: Axes, level: float, ticks: list[float], top: float, bottom: float) -> None:
    """The grid and the line of the level, behind one part only, not behind its heading."""
    axes.vlines(ticks, top, bottom, color=light("line"), linewidth=0.5, zorder=0.5)
    axes.vlines([100 * level], top, bottom, color=light("ink"), linewidth=0.9, zorder=0.6)


def _ticks(level: float, half: float) -> list[float]:
    """The level, and one round number either side of it where there is one below 100 %."""
    step = 10.0 ** math.floor(math.log10(90 * half))
    step *= max(factor for factor in (1, 2, 5) if factor * step <= 90 * half)
    return [tick for tick in (100 * level - step, 100 * level, 100 * level + step) if 0 <= tick <= 100]


def _share(axes: Axes, y: int, entry: Share, control: bool, bounds: tuple[float, float], size: float) -> None:
    """One dot with its interval: filled for an estimator, hollow for a control."""
    colour = light("identified" if entry.agrees else "held" if control else "weak")
    fill = light("ground") if control else colour
    at, (low, high) = 100 * entry.share, bounds
    if low <= at <= high:
        ends = [max(low, 100 * entry.low), min(high, 100 * entry.high)]
        axes.plot(ends, [y, y], "-", linewidth=1.3, color=colour, solid_capstyle="butt")
        shape = AGREES if entry.agrees else OUTSIDE
        axes.plot([at], [y], shape, markersize=3.8, color=colour, markerfacecolor=fill)
        return
    below = at < low
    axes.plot(
        [low if below else high],
        [y],
        "<" if below else ">",
        markersize=4.6,
        color=colour,
        markerfacecolor=fill,
        clip_on=False,
    )
    axes.annotate(
        share(entry),
        (low if below else high, y),
        xytext=(5 if below else -5, 0),
        textcoords="offset points",
        ha="left" if below else "right",
        va="center_baseline",
        fontsize=size - 0.5,
        color=colour,
    )


def _alt(parts: Sequence[Judged], levels: Sequence[float]) -> str:
    parts_said = []
    for estimator in parts:
        worst = []
        for level in levels:
            found = worst_at(estimator, level)
            if found is not None:
                row, entry = found
                worst.append(f"{percent(level)}: {label(row.name)} {share(entry)}{numbers.NO_BREAK}%")
        said = ", ".join(worst) if worst else NOT_DETERMINED
        parts_said.append(f"{clipped(estimator.name, 40)} ({standing(estimator)[1]}): {said}")
    return (
        "Share of intervals that hold the truth, of each estimator the parameter farthest from each level. "
        f"{'; '.join(parts_said)}. The table below it has every share."
    )
