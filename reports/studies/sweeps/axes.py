"""Figure of a study over many axes of numbers: the uncertainty of one offset against each of them."""

from __future__ import annotations

import math
from collections import Counter
from functools import partial
from typing import TYPE_CHECKING

from matplotlib.lines import Line2D

from ....experiments.studies.sweeps.grid_answer import CaseParameter, GridStudy, OffsetOverCases
from ....words import numbers
from ....words.wording import clipped, label
from ...style.canvas import Picture, new_figure, plain, set_log_scale, style, to_svg
from ...style.palette import light
from ...style.typeface import in_font
from ..study_blocks import NOT_DETERMINED
from .grid_words import axis_title, shown_unit, tolerance, unit_signs, value_text
from .marks import UNCERTAINTY, draw_tolerance, gap_handles, hatch, legend_above, tolerance_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDE, _MOST_PANELS = 3, 9
_FAINT = 0.45
_HEADROOM = 1.45  # of the scale, for the counts of cases without a number
_DASH = 0.13  # half the length of the dash of a case, of the distance between two values


def axes_picture(study: GridStudy) -> Picture | None:
    """A panel for each axis of numbers: u of the offset that is least certain in most cases, a dash for each
    case, and at each value the median and the smallest. None where no case determines it.

    Above each value stands how many of its cases do not determine the offset: they are part of the median.
    """
    name = _least_certain(study)
    named = [one for case in study.cases for one in case.parameters if one.name == name]
    stds = [one.std for one in named if one.std is not None]
    if name is None or not stds:
        return None
    every = [i for i, axis in enumerate(study.axes) if axis.numeric is not None]
    shown = every[:_MOST_PANELS]
    high = math.ceil(len(shown) / _WIDE)
    limits = [*stds, *(at for at in (tolerance(study, named[0]),) if at is not None)]
    low, top = min(limits) / 1.25, max(limits) * 1.25
    with style():
        figure = new_figure(0.9 + 1.75 * high)
        panels = figure.subplots(high, _WIDE, squeeze=False, sharey=True)
        for k, axes in enumerate(panels.flat):
            if k >= len(shown):
                axes.set_visible(False)
                continue
            set_log_scale(axes, "y", low, top * _HEADROOM)
            _panel(axes, study, shown[k], named[0], top)
        figure.supylabel(
            in_font(f"{label(name)}: {UNCERTAINTY} u, {unit_signs(named[:1])}"),
            fontsize=9.5,
            color=light("muted"),
        )
        handle = partial(Line2D, [], [], color=light("identified"))
        handles = [
            handle(linewidth=0.7, alpha=_FAINT, label="a case"),
            handle(linewidth=1.6, marker="o", markersize=4, label="median"),
            handle(linewidth=1.0, marker="v", markersize=4, label="smallest"),
        ]
        if (at := tolerance(study, named[0])) is not None:
            text = in_font(f"tolerance {numbers.exact(at, shown_unit(named[0]))}")
            handles.append(tolerance_line(Line2D, [], [], label=text))
        gaps = gap_handles([f"{NOT_DETERMINED} (cases)"] if len(stds) < len(named) else [])
        legend_above(figure, [*handles, *gaps], 5)
        svg = to_svg(figure, "axes")
    title = f"Predicted {UNCERTAINTY} u of {label(name)}, the least certain offset in most cases"
    if len(shown) < len(every):
        title += f"; {len(shown)} of {len(every)} axes shown, all in offsets.csv"
    return Picture("axes", title, _alt(study, shown, name), svg)


def _least_certain(study: GridStudy) -> str | None:
    """The offset that is the least certain, or not determined, in most cases."""
    counts: Counter[str] = Counter()
    for case in study.cases:
        unknown = [one.name for one in case.unidentifiable if one.is_angular_offset]
        counts.update([case.worst.name] if case.worst is not None else unknown)
    return counts.most_common(1)[0][0] if counts else None


def _at(study: GridStudy, axis: int, name: str) -> list[tuple[float, int, OffsetOverCases]]:
    """Of each value of an axis, by rising value: the value, its index, and the offset over its cases."""
    rows = []
    for i, value in enumerate(study.axes[axis].numeric or ()):
        rows += [(value, i, one) for one in study.over_cases(axis, i) if one.name == name]
    return sorted(rows, key=lambda row: row[0])


def _panel(axes: Axes, study: GridStudy, axis: int, one: CaseParameter, top: float) -> None:
    rows, blue = _at(study, axis, one.name), light("identified")
    places = {i: k for k, (_, i, _) in enumerate(rows)}
    draw_tolerance(study, one, axes.axhline, zorder=1.5)
    points = [
        (places[case.at[axis]], each.std)
        for case in study.cases
        for each in case.parameters
        if each.name == one.name and each.std is not None
    ]
    for at in range(len(rows)):
        ys = [y for x, y in points if x == at]
        # One line with gaps: a mark for each case would make a large file.
        dashes = [at - _DASH, at + _DASH, math.nan] * len(ys)
        heights = [y for std in ys for y in (std, std, math.nan)]
        axes.plot(dashes, heights, linewidth=0.7, alpha=_FAINT, color=blue, zorder=2)
    medians = [math.nan if over.median is None else over.median for _, _, over in rows]
    least = [math.nan if over.least is None else over.least for _, _, over in rows]
    axes.plot(range(len(rows)), medians, "o-", linewidth=1.6, markersize=4, color=blue, zorder=3)
    axes.plot(range(len(rows)), least, "v-", linewidth=1.0, markersize=4, color=blue, zorder=3)
    if any(over.without for _, _, over in rows):
        hatch(axes.axhspan, top, top * _HEADROOM, words=NOT_DETERMINED, zorder=1)
        for at, (_, _, over) in enumerate(rows):
            axes.text(
                at,
                top * math.sqrt(_HEADROOM),
                str(over.without),
                ha="center",
                va="center_baseline",
                fontsize=8,
                color=light("unidentifiable"),
                bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.7},
            )
    axes.set_xlim(-0.5, len(rows) - 0.5)
    axes.set_xticks(range(len(rows)), [plain(value) for value, _, _ in rows])
    axes.tick_params(labelsize=8)
    axes.set_xlabel(in_font(axis_title(study.axes[axis])))


def _alt(study: GridStudy, shown: list[int], name: str) -> str:
    """The medians at the values of each axis."""
    parts = []
    for axis in shown:
        texts = []
        for _, i, one in _at(study, axis, name):
            unit = clipped(one.unit, 12)
            median = NOT_DETERMINED if one.median is None else numbers.spread(one.median, unit)
            texts.append(f"{median} at {value_text(study.axes[axis], i)}")
        parts.append(f"{clipped(study.axes[axis].label)}: {', '.join(texts)}")
    return f"Median {UNCERTAINTY} u of {label(name)} by each axis. {'; '.join(parts)}."
