"""Figure of a sweep over two axes of numbers: a map of the std of the least certain offset."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..words import numbers
from ..words.wording import in_font, label
from .figure_sweep_marks import gap_colour, hatch, in_font_within
from .study_view import NOT_DETERMINED
from .sweep_cases import (
    NO_PLAN,
    axis_title,
    is_numeric,
    place_name,
    predicted,
    standing,
    unit_of,
    value_text,
    worst,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Json = dict[str, Any]

_MOST_PANELS = 6
_MOST_WRITTEN = 12  # cells across a figure that numbers can be read in
_SMALLEST = 5.5  # points of words in a cell; below, the legend alone says them
_LIGHTEST, _DARKEST = 0.07, 0.5  # shares of the hue: ink on either can be read


def map_picture(answer: Json) -> Picture | None:
    """The first two axes of numbers across and up; a panel for each place on the others.

    A cell has the worst predicted std, the fuller in colour the larger, and a diamond where that is beyond
    the tolerance; one that cannot tell some offset is hatched and has no number. None where there is no case.
    """
    if not answer["cases"]:
        return None
    across, up = [i for i, axis in enumerate(answer["axes"]) if is_numeric(axis)][:2]
    every_panel = _panels(answer, across, up)
    panels = every_panel[:_MOST_PANELS]
    columns, rows = (_order(answer["axes"][i]) for i in (across, up))
    wide = 1 if len(panels) == 1 or len(columns) > _MOST_WRITTEN // 2 else 2
    high = math.ceil(len(panels) / wide)
    cell = min(0.32, 4.6 / high / len(rows))
    found = [row["std"] for case in answer["cases"] if (row := worst(case)) is not None]
    bounds = (min(found), max(found)) if found else (1.0, 1.0)
    with style():
        figure = new_figure(1.05 + high * (cell * len(rows) + 0.45))
        every = figure.subplots(high, wide, squeeze=False, sharex=True, sharey=True)
        for axes, (place, cases) in zip(every.flat, panels, strict=False):
            written = len(columns) * wide <= _MOST_WRITTEN and cell > 0.15
            across_pt = 72 * (WIDTH - 0.8) / wide / len(columns)
            size = min(8.0, 66 * cell, across_pt / 3.4)
            word = min(7.5, 40 * cell, across_pt / 5.6)
            for case in cases:
                at = (columns.index(case["at"][across]), rows.index(case["at"][up]))
                _cell(axes, at, case, bounds, (size, word) if written else None)
            if place:
                axes.set_title(in_font_within(place_name(place), 80 // wide), fontsize=9, pad=4)
            _finish(axes, answer["axes"][across], columns, answer["axes"][up], rows)
        for k, axes in enumerate(every.flat):
            if k >= len(panels):
                axes.set_visible(False)
                every.flat[k - wide].tick_params(labelbottom=True)
        figure.supxlabel(in_font(axis_title(answer["axes"][across])), fontsize=9.5, color=light("muted"))
        figure.supylabel(in_font(axis_title(answer["axes"][up])), fontsize=9.5, color=light("muted"))
        _legend(figure, answer, bounds if found else None)
        svg = to_svg(figure, "map")
    unit = {"deg": "°"}.get(_unit(answer), _unit(answer))
    title = f"Predicted std of the least certain offset, {in_font(unit)}; the fuller the colour the worse"
    if len(panels) < len(every_panel):
        title += f"; {len(panels)} of {len(every_panel)} maps shown, all cases in cases.csv"
    return Picture("map", title, _alt(answer), svg)


def _panels(answer: Json, across: int, up: int) -> list[tuple[list[tuple[Json, int]], list[Json]]]:
    """The cases by their place on all other axes."""
    found: dict[tuple[int, ...], list[Json]] = {}
    for case in answer["cases"]:
        found.setdefault(tuple(at for i, at in enumerate(case["at"]) if i not in (across, up)), []).append(
            case
        )
    others = [axis for i, axis in enumerate(answer["axes"]) if i not in (across, up)]
    return [(list(zip(others, at, strict=True)), cases) for at, cases in sorted(found.items())]


def _order(axis: Json) -> list[int]:
    """Indices of the values of an axis, by rising value."""
    return sorted(range(len(axis["values"])), key=lambda i: axis["values"][i])


def _unit(answer: Json) -> str:
    return next((unit_of(row) for case in answer["cases"] if (row := worst(case)) is not None), "deg")


def _shade(std: float, bounds: tuple[float, float]) -> float:
    """Share of the hue for a std, logarithmic."""
    low, high = map(math.log, bounds)
    part = (math.log(std) - low) / (high - low) if high > low else 0.0
    return _LIGHTEST + part * (_DARKEST - _LIGHTEST)


def _cell(
    axes: Axes,
    at: tuple[int, int],
    case: Json,
    bounds: tuple[float, float],
    sizes: tuple[float, float] | None,
) -> None:
    """One cell; `sizes` are those of its number and of words, points, where they can be read."""
    from matplotlib.patches import Rectangle

    x, y = at
    row = worst(case)
    frame: dict[str, Any] = {"edgecolor": light("ground"), "linewidth": 1.0}
    corner = (x - 0.5, y - 0.5)
    if row is None:
        said = NO_PLAN if case["reason"] is not None else NOT_DETERMINED
        axes.add_patch(
            Rectangle(corner, 1, 1, facecolor="none", edgecolor=light("line"), hatch=hatch(said), linewidth=0)
        )
        if sizes is not None and sizes[1] > _SMALLEST:
            axes.text(
                x,
                y,
                said.replace(" ", "\n"),
                ha="center",
                va="center",
                linespacing=0.95,
                fontsize=sizes[1],
                color=gap_colour(said),
                bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.5},
            )
        return
    std = predicted(row) or bounds[0]
    axes.add_patch(
        Rectangle(corner, 1, 1, facecolor=light("identified"), alpha=_shade(std, bounds), linewidth=0)
    )
    axes.add_patch(Rectangle(corner, 1, 1, facecolor="none", **frame))
    weak = standing(case)[0] == "weak"
    if sizes is not None:
        axes.text(x, y, numbers.spread(std), ha="center", va="center_baseline", fontsize=sizes[0])
    if weak:
        place = (x - 0.4, y + 0.32) if sizes is not None else (x, y)
        axes.plot([place[0]], [place[1]], SHAPES["weak"], markersize=3.2, color=light("weak"))


def _finish(axes: Axes, across: Json, columns: list[int], up: Json, rows: list[int]) -> None:
    axes.grid(visible=False)
    axes.set_xlim(-0.5, len(columns) - 0.5)
    axes.set_ylim(-0.5, len(rows) - 0.5)
    for set_ticks, axis, order, most in (
        (axes.set_xticks, across, columns, 10),
        (axes.set_yticks, up, rows, 16),
    ):
        step = math.ceil(len(order) / most)
        at = range(0, len(order), step)
        set_ticks(list(at), [numbers.exact(axis["values"][order[i]]) for i in at])
    axes.tick_params(length=0, labelsize=8.5)
    axes.spines[["left", "bottom"]].set_visible(False)


def _legend(figure: Any, answer: Json, bounds: tuple[float, float] | None) -> None:
    """The shades with their numbers, and what the other marks mean."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = []
    if bounds is not None:
        steps = (
            (bounds[0], math.sqrt(bounds[0] * bounds[1]), bounds[1]) if bounds[1] > bounds[0] else bounds[:1]
        )
        handles = [
            Patch(
                facecolor=light("identified"),
                alpha=_shade(std, bounds),
                linewidth=0,
                label=in_font(numbers.spread(std, _unit(answer))),
            )
            for std in steps
        ]
    present = {standing(case)[0] for case in answer["cases"]}
    if "weak" in present:
        handles.append(
            Line2D(
                [], [], marker=SHAPES["weak"], markersize=4, linewidth=0, color=light("weak"), label="weak"
            )
        )
    for mark, words in (("unidentifiable", NOT_DETERMINED), ("held", NO_PLAN)):
        if mark in present:
            handles.append(
                Patch(
                    facecolor="none", edgecolor=light("muted"), hatch=hatch(words), linewidth=0.4, label=words
                )
            )
    figure.legend(
        handles=handles,
        loc="outside upper left",
        ncols=6,
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.4,
        handletextpad=0.5,
    )


def _alt(answer: Json) -> str:
    """The best and the worst place, and how many have no number."""
    told = [(row["std"], case, row) for case in answer["cases"] if (row := worst(case)) is not None]
    said = []
    if told:
        for what, (std, case, row) in (
            ("least", min(told, key=lambda one: one[0])),
            ("most", max(told, key=lambda one: one[0])),
        ):
            at = ", ".join(
                f"{axis_title(axis).partition(',')[0]} {value_text(axis, i)}"
                for axis, i in zip(answer["axes"], case["at"], strict=True)
            )
            said.append(f"{what} {numbers.spread(std, unit_of(row))} ({label(row['name'])}) at {at}")
    for mark, words in (("unidentifiable", NOT_DETERMINED), ("held", NO_PLAN)):
        count = sum(standing(case)[0] == mark for case in answer["cases"])
        if count:
            said.append(f"{words} in {count} of {len(answer['cases'])} cases")
    return f"Map of the predicted standard deviation of the least certain offset: {'; '.join(said)}."
