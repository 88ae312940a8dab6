"""Figure of a sweep along one axis of numbers: the predicted std as a line, what was observed as marks."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, Any

from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import light
from ..words import numbers
from ..words.wording import clipped, in_font, label
from .figure_sweep_marks import (
    FITS,
    draw_fit,
    gap,
    gap_colour,
    hatch,
    in_font_within,
    legend,
    log_ticks,
    plain,
    scale_of,
)
from .sweep_cases import axis_title, is_numeric, place_name, predicted, tolerance, unit_of, value_text

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Json = dict[str, Any]
# A value of the axis, the case there, and the parameter in it: None where it has no such parameter.
Points = list[tuple[float, Json, Json | None]]

_MOST_SERIES, _MOST_OFFSETS = 4, 15
_TALLEST = 6.8  # inches of all panels, so that a page holds them
_ACROSS, _LETTER = 4.2, 0.06  # inches: all panels, and a letter of 8 points
_LOG_FROM = 5.0  # ratio of the largest value of the axis to the smallest


def lines_picture(answer: Json) -> Picture | None:
    """A panel for each parameter and, where there are more axes, for each of their values: a series.

    Where a case cannot tell the parameter the line has a gap, a hatched band with the words. None where
    there is no parameter that any case tells.
    """
    (along,) = (i for i, axis in enumerate(answer["axes"]) if is_numeric(axis))
    every_series = _series(answer, along)
    unit_by_name = _units(answer)
    names = list(unit_by_name)
    series, offsets = every_series[:_MOST_SERIES], names[:_MOST_OFFSETS]
    if not offsets:
        return None
    single = len(series) == 1
    wide = (2 if len(offsets) <= 6 else 3) if single else len(series)
    high = math.ceil(len(offsets) / wide) if single else len(offsets)
    gaps: set[str] = set()
    with style():
        from matplotlib.lines import Line2D

        figure = new_figure(1.0 + min(1.25 if single else 1.0, _TALLEST / high) * high)
        panels = figure.subplots(high, wide, squeeze=False, sharex=True)
        axis = answer["axes"][along]
        units = dict.fromkeys({"deg": "°"}.get(unit, unit) for unit in unit_by_name.values())
        wanted = [(place, cases, name) for name in offsets for place, cases in series]
        for k, axes in enumerate(panels.flat):
            if k >= len(wanted):
                axes.set_visible(False)
                panels.flat[k - wide].tick_params(labelbottom=True)
                continue
            place, cases, name = wanted[k]
            points = _points(axis, along, cases, name)
            _scales(axes, answer, axis, unit_by_name[name], _ACROSS / wide)
            gaps |= _panel(axes, answer, points, _ACROSS / wide)
            first = k % wide == 0
            axes.tick_params(labelleft=first or (single and len(units) > 1))
            # With more than one unit each offset says its own.
            own = {"deg": "°"}.get(unit_by_name[name], unit_by_name[name]) if len(units) > 1 else ""
            if single:
                words = in_font_within(label(name), 16) + (f", {in_font(own)}" if own else "")
                axes.set_title(words, loc="left", fontsize=9, fontweight="bold", pad=2)
            else:
                if k < wide:
                    heads = [in_font_within(place_name([part]), 72 // wide) for part in place]
                    axes.set_title("\n".join(heads), fontsize=9, pad=4)
                if first:
                    words = in_font_within(label(name), 12) + (f"\n{in_font(own)}" if own else "")
                    axes.set_ylabel(words, color=light("ink"), fontweight="bold", fontsize=8.5)
        figure.supxlabel(in_font(axis_title(axis)), fontsize=9.5, color=light("muted"))
        figure.supylabel(
            in_font(f"standard deviation, {', '.join(units)}"), fontsize=9.5, color=light("muted")
        )
        line = Line2D([], [], marker=".", color=light("identified"), linewidth=1.6, label="predicted std")
        legend(figure, answer, line, gaps, 3)
        svg = to_svg(figure, "lines")
    title = f"Predicted std of each offset by {clipped(axis['label'])}, and what simulated runs show"
    for shown, total, what in ((series, every_series, "series"), (offsets, names, "offsets")):
        if len(shown) < len(total):
            title += f"; {len(shown)} of {len(total)} {what} shown, all in offsets.csv"
    return Picture("lines", title, _alt(axis, along, series, offsets), svg)


def _series(answer: Json, along: int) -> list[tuple[list[tuple[Json, int]], list[Json]]]:
    """The cases by their place on all axes but one."""
    found: dict[tuple[int, ...], list[Json]] = {}
    for case in answer["cases"]:
        found.setdefault(tuple(at for i, at in enumerate(case["at"]) if i != along), []).append(case)
    others = [axis for i, axis in enumerate(answer["axes"]) if i != along]
    return [(list(zip(others, at, strict=True)), cases) for at, cases in sorted(found.items())]


def _units(answer: Json) -> dict[str, str]:
    """The unit of each parameter, in the order in which they come; empty where no case tells any."""
    rows = [row for case in answer["cases"] for row in case["parameters"]]
    told = any(predicted(row) is not None for row in rows)
    return {row["name"]: unit_of(row) for row in rows} if told else {}


def _points(axis: Json, along: int, cases: list[Json], name: str) -> Points:
    """By rising value of the axis."""
    points: Points = []
    for case in cases:
        row = next((row for row in case["parameters"] if row["name"] == name), None)
        points.append((axis["values"][case["at"][along]], case, row))
    return sorted(points, key=lambda point: point[0])


def _panel(axes: Axes, answer: Json, points: Points, width: float) -> set[str]:
    """Draw one panel, so many inches wide; the words of its gaps."""
    known = next((row for *_, row in points if row is not None), None)
    if known is not None and (at := tolerance(answer, known)) is not None:
        axes.axhline(at, linestyle=(0, (4, 2)), linewidth=1.0, color=light("weak"), zorder=1.5)
    told = [predicted(row) if row is not None else None for *_, row in points]
    heights = [math.nan if std is None else std for std in told]
    xs = [x for x, *_ in points]
    axes.plot(xs, heights, ".-", color=light("identified"), linewidth=1.6, markersize=4, zorder=2)
    for x, _, row in points:
        if row is not None:
            for fit in FITS:
                draw_fit(axes, x, row, fit, upright=True)
    return _bands(axes, points, width)


def _scales(axes: Axes, answer: Json, axis: Json, unit: str, width: float) -> None:
    """Scales that all panels of this unit share, whether or not this one has a number."""
    low, high = scale_of(answer, unit)
    axes.set_yscale("log")
    axes.set_ylim(low, high)
    axes.set_yticks(log_ticks(low, high))
    axes.minorticks_off()
    axes.yaxis.set_major_formatter(plain)
    values = sorted(axis["values"])
    if values[0] > 0 and values[-1] >= _LOG_FROM * values[0]:
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(_no_ticks())
    edges = _edges(values, axes.get_xscale() == "log")
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xticks(_spaced(axes, values, width))
    axes.xaxis.set_major_formatter(plain)
    axes.tick_params(labelsize=8)


def _no_ticks() -> Any:
    from matplotlib.ticker import NullLocator

    return NullLocator()


def _spaced(axes: Axes, values: list[float], width: float) -> list[float]:
    """The values whose ticks do not touch: from the first on, each some way from the one before."""
    log = axes.get_xscale() == "log"
    at = [math.log(value) if log else float(value) for value in values]
    room = _LETTER * (max(len(plain(value)) for value in values) + 1) / width
    found: list[int] = []
    for i in range(len(values)):
        if not found or at[i] - at[found[-1]] >= room * (at[-1] - at[0]):
            found.append(i)
    return [values[i] for i in found]


def _edges(values: list[float], log: bool) -> list[float]:
    """Halfway between the values, and some way beyond the first and the last."""
    at = [math.log(value) if log else float(value) for value in values]
    if len(at) == 1:
        edges = [at[0] - 0.5, at[0] + 0.5]
    else:
        inner = [(a + b) / 2 for a, b in itertools.pairwise(at)]
        # The ends by the whole range as well, so that a first value has room.
        room = 0.04 * (at[-1] - at[0])
        edges = [
            at[0] - max(room, inner[0] - at[0]) if len(at) < 4 else at[0] - room,
            *inner,
            at[-1] + max(room, at[-1] - inner[-1]) if len(at) < 4 else at[-1] + room,
        ]
    return [math.exp(edge) if log else edge for edge in edges]


def _bands(axes: Axes, points: Points, width: float) -> set[str]:
    """A hatched band with its words for each run of values that have no number."""
    log = axes.get_xscale() == "log"
    edges = _edges([x for x, *_ in points], log)
    words = [gap(case, row) for _, case, row in points]
    for i, said in enumerate(words):
        if not said or (i and words[i - 1] == said):
            continue
        end = next((k for k in range(i, len(words)) if words[k] != said), len(words))
        low, high = edges[i], edges[end]
        axes.axvspan(
            low, high, facecolor="none", edgecolor=light("line"), hatch=hatch(said), linewidth=0, zorder=1
        )
        middle = math.sqrt(low * high) if log else (low + high) / 2
        left, right = sorted(
            axes.transAxes.inverted().transform(axes.transData.transform([(low, 1), (high, 1)]))[:, 0]
        )
        axes.text(
            middle,
            0.5,
            said,
            transform=axes.get_xaxis_transform(),
            rotation=0 if (right - left) * width > _LETTER * (len(said) + 1) else 90,
            ha="center",
            va="center",
            fontsize=8,
            color=gap_colour(said),
            bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.8},
            zorder=3,
        )
    return {said for said in words if said}


def _alt(axis: Json, along: int, series: Any, offsets: list[str]) -> str:
    """Of each series and parameter the first and the last predicted std, and where there is none."""
    parts = []
    for place, cases in series:
        named = f"{place_name(place)}: " if place else ""
        offset_parts = []
        for name in offsets:
            points = _points(axis, along, cases, name)
            stds = [(case, row, std) for _, case, row in points if row and (std := predicted(row))]
            said = [
                f"{numbers.spread(std, unit_of(row))} at {value_text(axis, case['at'][along])}"
                for case, row, std in stds[:1] + stds[1:][-1:]
            ]
            missing: dict[str, list[str]] = {}
            for _, each, known in points:
                if words := gap(each, known):
                    missing.setdefault(words, []).append(value_text(axis, each["at"][along]))
            said += [f"{words} at {', '.join(values)}" for words, values in missing.items()]
            offset_parts.append(f"{label(name)} {', '.join(said)}")
        parts.append(named + "; ".join(offset_parts))
    return f"Predicted standard deviation by {clipped(axis['label'])}. {'. '.join(parts)}."
