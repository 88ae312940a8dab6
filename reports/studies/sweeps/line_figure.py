"""Figure of a study along one axis of numbers: the prediction as a line, observed errors as marks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ....experiments.studies.sweeps.grid_answer import CaseParameter, GridAxis, GridCase, GridStudy
from ....words import numbers
from ....words.wording import clipped, label
from ...style.canvas import Picture, new_figure, plain, set_log_scale, style, to_svg
from ...style.palette import light
from ...style.typeface import in_font
from .grid_words import GridPoint, axis_title, by_point, point_name, shown_unit, unit_signs, value_text
from .marks import (
    UNCERTAINTY,
    draw_fits,
    draw_tolerance,
    gap,
    hatch,
    in_font_within,
    legend,
    log_scale,
    write_gap,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_SERIES, _MOST_PARAMETERS = 4, 15
_TALLEST = 6.8  # inches of all panels, so that a page holds them
_ACROSS, _LETTER = 4.2, 0.06  # inches: all panels, and a letter of 8 points
_LOG_FROM = 5.0  # ratio of the largest value of the axis to the smallest


@dataclass(frozen=True)
class _SeriesPoint:
    """A value of the axis as number and text, the case there, and the parameter, if the case has it."""

    x: float
    text: str
    case: GridCase
    one: CaseParameter | None

    @property
    def gap(self) -> str:
        return gap(self.case, self.one)


def lines_picture(study: GridStudy) -> Picture | None:
    """A panel for each parameter and, where there are more axes, for each of their values: a series.

    Where a case does not identify the parameter the line has a gap, a hatched band with the words. None where
    no case identifies any parameter.
    """
    every = {one.name: one for one in study.parameters}
    if not any(one.has_numbers for one in study.parameters):
        return None
    (along,) = (i for i, axis in enumerate(study.axes) if axis.numeric is not None)
    axis, every_series = study.axes[along], by_point(study, {along})
    series, parameters = every_series[:_MOST_SERIES], list(every.values())[:_MOST_PARAMETERS]
    panels_shown = [
        (series_point, one, _points(axis, along, cases, one.name))
        for one in parameters
        for series_point, cases in series
    ]
    single, signs = len(series) == 1, unit_signs(every.values())
    wide = (2 if len(parameters) <= 6 else 3) if single else len(series)
    high = math.ceil(len(panels_shown) / wide)
    gaps: set[str] = set()
    with style():
        figure = new_figure(1.0 + min(1.25 if single else 1.0, _TALLEST / high) * high)
        panels = figure.subplots(high, wide, squeeze=False, sharex=True)
        for k, axes in enumerate(panels.flat):
            if k >= len(panels_shown):
                axes.set_visible(False)
                panels.flat[k - wide].tick_params(labelbottom=True)
                continue
            series_point, one, points = panels_shown[k]
            _scales(axes, study, axis, one.unit, _ACROSS / wide)
            gaps |= _panel(axes, study, points, _ACROSS / wide)
            # With more than one unit each parameter says its own.
            unit = in_font(unit_signs([one])) if "," in signs else ""
            axes.tick_params(labelleft=k % wide == 0 or (single and bool(unit)))
            _titles(axes, one, series_point, unit, wide, None if single else k)
        figure.supxlabel(in_font(axis_title(axis)), fontsize=9.5, color=light("muted"))
        figure.supylabel(in_font(f"{UNCERTAINTY} u, {signs}"), fontsize=9.5, color=light("muted"))
        legend(figure, study, gaps, marker=".", linewidth=1.6)
        svg = to_svg(figure, "lines")
    title = (
        f"Predicted {UNCERTAINTY} u of each parameter by {clipped(axis.label)}, and errors of simulated runs"
    )
    cuts = ((len(series), len(every_series), "series"), (len(parameters), len(every), "parameters"))
    for shown, total, what in cuts:
        if shown < total:
            title += f"; {shown} of {total} {what} shown, all in offsets.csv"
    return Picture("lines", title, _alt(axis, panels_shown), svg)


def _points(axis: GridAxis, along: int, cases: list[GridCase], name: str) -> list[_SeriesPoint]:
    """By rising value of the axis."""
    points = []
    for case in cases:
        i = case.at[along]
        one = next((one for one in case.parameters if one.name == name), None)
        points.append(_SeriesPoint((axis.numeric or ())[i], value_text(axis, i), case, one))
    return sorted(points, key=lambda point: point.x)


def _titles(
    axes: Axes, one: CaseParameter, series_point: GridPoint, unit: str, wide: int, k: int | None
) -> None:
    """The parameter above a panel; in a grid of panels (number `k`) at its left, and the series above."""
    if k is None:
        words = in_font_within(label(one.name), 16) + (f", {unit}" if unit else "")
        axes.set_title(words, loc="left", fontsize=9, fontweight="bold", pad=2)
        return
    if k < wide:
        heads = [in_font_within(point_name((part,)), 72 // wide) for part in series_point]
        axes.set_title("\n".join(heads), fontsize=9, pad=4)
    if k % wide == 0:
        words = in_font_within(label(one.name), 12) + (f"\n{unit}" if unit else "")
        axes.set_ylabel(words, color=light("ink"), fontweight="bold", fontsize=8.5)


def _panel(axes: Axes, study: GridStudy, points: list[_SeriesPoint], width: float) -> set[str]:
    """Draw one panel, so many inches wide; the words of its gaps."""
    estimated = [(point.x, point.one) for point in points if point.one is not None]
    if estimated:
        draw_tolerance(study, estimated[0][1], axes.axhline, zorder=1.5)
    heights = [math.nan if point.one is None or point.one.std is None else point.one.std for point in points]
    xs = [point.x for point in points]
    axes.plot(xs, heights, ".-", color=light("identified"), linewidth=1.6, markersize=4, zorder=2)
    for x, one in estimated:
        draw_fits(axes, x, one, upright=True)
    return _bands(axes, points, width)


def _scales(axes: Axes, study: GridStudy, axis: GridAxis, unit: str, width: float) -> None:
    """Scales that all panels of this unit share, whether or not this one has a number."""
    set_log_scale(axes, "y", *log_scale(study, {unit}))
    values = sorted(axis.numeric or ())
    log = values[0] > 0 and values[-1] >= _LOG_FROM * values[0]
    if log:
        axes.set_xscale("log")
        axes.xaxis.minorticks_off()
    edges = _edges(values, log)
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xticks(_spaced(values, log, width))
    axes.xaxis.set_major_formatter(plain)
    axes.tick_params(labelsize=8)


def _spaced(values: Sequence[float], log: bool, width: float) -> list[float]:
    """The values whose ticks do not touch: from the first on, each some way from the one before."""
    at = [math.log(value) if log else value for value in values]
    room = _LETTER * (max(len(plain(value)) for value in values) + 1) / width * (at[-1] - at[0])
    spaced: list[int] = []
    for i in range(len(values)):
        if not spaced or at[i] - at[spaced[-1]] >= room:
            spaced.append(i)
    return [values[i] for i in spaced]


def _edges(values: Sequence[float], log: bool) -> list[float]:
    """Halfway between the values, and some way before the first and after the last."""
    at = [math.log(value) if log else value for value in values]
    inner = [(a + b) / 2 for a, b in itertools.pairwise(at)]
    # The ends by the whole range, and of few values also by their neighbours: a first value has room.
    room = 0.04 * (at[-1] - at[0]) or 0.5
    few = 1 < len(at) < 4
    first = at[0] - max(room, inner[0] - at[0] if few else 0)
    last = at[-1] + max(room, at[-1] - inner[-1] if few else 0)
    return [math.exp(edge) if log else edge for edge in (first, *inner, last)]


def _bands(axes: Axes, points: list[_SeriesPoint], width: float) -> set[str]:
    """A hatched band with its words for each run of values that have no number."""
    log = axes.get_xscale() == "log"
    edges = _edges([point.x for point in points], log)
    left, right = map(math.log, axes.get_xlim()) if log else axes.get_xlim()
    start = 0
    for words, group in itertools.groupby(point.gap for point in points):
        end = start + len(list(group))
        low, high = edges[start], edges[end]
        start = end
        if words:
            hatch(axes.axvspan, low, high, words=words, zorder=1)
            share = (math.log(high / low) if log else high - low) / (right - left)
            write_gap(
                axes,
                math.sqrt(low * high) if log else (low + high) / 2,
                0.5,
                words,
                transform=axes.get_xaxis_transform(),
                rotation=0 if share * width > _LETTER * (len(words) + 1) else 90,
                va="center",
                fontsize=8,
                zorder=3,
            )
    return {point.gap for point in points} - {""}


def _alt(axis: GridAxis, panels_shown: Sequence[tuple[GridPoint, CaseParameter, list[_SeriesPoint]]]) -> str:
    """Of each series and parameter the first and the last prediction, and where there is none."""
    parts: dict[str, list[str]] = {}
    for series_point, one, points in panels_shown:
        known = [(point.text, point.one.std) for point in points if point.one and point.one.std]
        texts = [
            f"{numbers.spread(std, shown_unit(one))} at {text}" for text, std in known[:1] + known[1:][-1:]
        ]
        for words in dict.fromkeys(point.gap for point in points if point.gap):
            texts.append(f"{words} at {', '.join(point.text for point in points if point.gap == words)}")
        parts.setdefault(point_name(series_point), []).append(f"{label(one.name)} {', '.join(texts)}")
    series = [f"{name}: {'; '.join(texts)}" if name else "; ".join(texts) for name, texts in parts.items()]
    return f"Predicted {UNCERTAINTY} by {clipped(axis.label)}. {'. '.join(series)}."
