"""Figure: how far the TCP is off over the workspace, without the offsets and with them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...analysis.answer.result import Result
from ...analysis.diagnostics.accuracy import Accuracy, Grid, Level, LevelMap, Map
from ...words import numbers
from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.palette import light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

NAME = "tool_accuracy"
_LIGHTEST, _DARKEST = 0.1, 1.0  # shares of the one hue
_SIDES: tuple[tuple[Callable[[Map], LevelMap], str], ...] = (
    (lambda own: own.before_mm, "without the offsets: error, mm"),
    (lambda own: own.after95_mm, "with them: 95 % within, mm"),
)
# Inches: beside, below and between panels, above all of them.
_LEFT, _BELOW, _BETWEEN, _RIGHT, _KEY = 0.7, 0.42, 0.38, 0.2, 0.85


def workspace_picture(result: Result) -> Picture | None:
    """A column before and one after the calibration, a row for each plane; the darker the farther off.

    A cell shows the median of the postures whose TCP is there: in nearly every place seen from above
    some posture is as bad as any. The classes of a column are the same in both planes. None where no accuracy
    is claimed.
    """
    accuracy = result.accuracy
    if not accuracy.maps or result.misfit is not None:
        return None
    maps = accuracy.maps
    # One scale of length for both planes. Panels are placed by hand: a fitted layout takes a second.
    width = (WIDTH - _LEFT - _BETWEEN - _RIGHT) / len(_SIDES)
    inch = max(len(own.postures[0]) * own.cell_mm for own in maps) / width
    heights = [len(own.postures) * own.cell_mm / inch for own in maps]
    whole = _KEY + sum(heights) + _BELOW * len(maps) + 0.1 * (len(maps) - 1)
    with style():
        figure = new_figure(whole, fitted=False)
        for column, (of, words) in enumerate(_SIDES):
            edges = _edges([value for own in maps for value in _numbers(of(own).median)])
            left, top = (_LEFT + column * (width + _BETWEEN)) / WIDTH, whole - _KEY
            for own, height in zip(maps, heights, strict=True):
                across = len(own.postures[0]) * own.cell_mm / inch
                axes = figure.add_axes((left, (top - height) / whole, across / WIDTH, height / whole))
                _panel(axes, own, of(own).median, edges)
                if column:
                    axes.set_ylabel("")
                    axes.tick_params(axis="y", labelleft=False)
                top -= height + _BELOW + 0.1
            _legend(figure, left, words, edges)
        svg = to_svg(figure, NAME)
    return Picture(NAME, _title(maps), _alt(accuracy), svg)


def _numbers(grid: Grid) -> list[float]:
    return [value for row in grid for value in row if value is not None]


def _edges(values: list[float]) -> list[float]:
    """Round bounds of four to seven classes that hold all values."""
    from matplotlib.ticker import MaxNLocator

    low, high = min(values), max(values)
    edges = np.asarray(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    return [float(edge) for edge in edges[edges >= 0]]


def class_of(value: float, edges: list[float]) -> int:
    """Which class a value is in: 0 is from the first edge to the second."""
    return max(sum(value >= edge for edge in edges[:-1]) - 1, 0)


def _share(which: int, classes: int) -> float:
    return _DARKEST if classes == 1 else _LIGHTEST + which / (classes - 1) * (_DARKEST - _LIGHTEST)


def _panel(axes: Axes, own: Map, grid: Grid, edges: list[float]) -> None:
    from matplotlib.patches import PathPatch

    size, (left, low) = own.cell_mm, own.corner_mm
    classes = len(edges) - 1
    for which in range(classes):
        # All cells of a class are one shape: no seams between them, and a small file.
        shape = _shape(grid, which, edges, size, left, low)
        if shape is not None:
            share = _share(which, classes)
            axes.add_patch(PathPatch(shape, facecolor=light("identified"), alpha=share, linewidth=0))
    rows, columns = len(grid), len(grid[0])
    shots = [
        (left + (j + 0.5) * size, low + (i + 0.5) * size)
        for i, j in itertools.product(range(rows), range(columns))
        if own.shots[i][j]
    ]
    rim: dict[str, Any] = {
        "markerfacecolor": light("ground"),
        "markeredgecolor": light("ink"),
        "markeredgewidth": 0.9,
    }
    axes.plot(*zip(*shots, strict=True), "o", markersize=3.6, zorder=3, **rim)
    axes.set_xlim(left, left + columns * size)
    axes.set_ylim(low, low + rows * size)
    axes.grid(visible=False)
    axes.set_xlabel(f"{own.axes[0]}, mm")
    axes.set_ylabel(f"{own.axes[1]}, mm")
    axes.locator_params(axis="x", nbins=3)
    axes.locator_params(axis="y", nbins=4)
    _base(axes, own.plane)


def _shape(grid: Grid, which: int, edges: list[float], size: float, left: float, low: float) -> Path | None:
    """The outline of all cells of a class, runs of neighbours in a row put together."""
    from matplotlib.path import Path

    found = []
    for i, row in enumerate(grid):
        own = [value is not None and class_of(value, edges) == which for value in row]
        at = 0
        for inside, run in itertools.groupby(own):
            count = len(list(run))
            if inside:
                x0, x1 = left + at * size, left + (at + count) * size
                y0, y1 = low + i * size, low + (i + 1) * size
                found.append(Path([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], closed=True))
            at += count
    return Path.make_compound_path(*found) if found else None


def _base(axes: Axes, plane: str) -> None:
    """Where the base is: its level next to axis 1, its place seen from above."""
    ink: dict[str, Any] = {"color": light("ink"), "fontsize": 8.5}
    bottom, top = axes.get_ylim()
    ground = {"facecolor": light("ground"), "edgecolor": "none", "pad": 0.4, "alpha": 0.85}
    if plane == "horizontal":
        axes.plot([0], [0], "+", markersize=9, markeredgewidth=1.2, color=light("ink"), zorder=4)
        axes.annotate("base", (0, 0), xytext=(5, 4), textcoords="offset points", bbox=ground, zorder=4, **ink)
    elif bottom <= 0 <= top:
        axes.axhline(0, color=light("ink"), linewidth=0.8, linestyle=(0, (4, 3)))
        beside: dict[str, Any] = {"xycoords": axes.get_yaxis_transform(), "textcoords": "offset points"}
        axes.annotate("base", (1, 0), xytext=(3, 0), va="center", **beside, **ink)


def _legend(figure: Figure, left: float, words: str, edges: list[float]) -> None:
    """The classes of a column above it, darkest last."""
    from matplotlib.patches import Patch

    classes = len(edges) - 1
    handles = [
        Patch(
            facecolor=light("identified"),
            alpha=_share(which, classes),
            linewidth=0,
            label=f"{numbers.exact(edges[which])} to {numbers.exact(edges[which + 1])}",
        )
        for which in range(classes)
    ]
    figure.legend(
        handles=handles,
        title=words,
        title_fontsize=9.5,
        alignment="left",
        loc="upper left",
        bbox_to_anchor=(left, 1.0),
        ncols=2,
        borderpad=0.0,
        columnspacing=1.0,
        handlelength=1.2,
        handleheight=0.9,
        handletextpad=0.5,
        labelspacing=0.25,
    )


def _title(maps: Sequence[Map]) -> str:
    planes = " and ".join("from the side" if own.plane == "vertical" else "from above" for own in maps)
    return f"How far the TCP is off, {planes}: the median posture of each place; rings: the measurements"


def _alt(accuracy: Accuracy) -> str:
    region = accuracy.workspace
    assert region is not None

    def said(level: Level) -> str:
        median, worst = (numbers.significant(value, 2, "mm") for value in (level.median, level.worst))
        return f"{median} in the median posture, {worst} in the worst"

    return (
        "Maps of the workspace, from the side and from above. Without the offsets the TCP is off"
        f" by {said(region.before_mm)}; with them 95 % of the error is within {said(region.after95_mm)}."
    )
