"""The section on accuracy: how far the TCP is off, with nothing entered and with the values; maps of it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...analysis.answer.result import Result
from ...analysis.diagnostics.accuracy import Grid, Map, RegionAccuracy
from ...analysis.diagnostics.values_to_enter import TcpError
from ...analysis.observability.causes import Held
from ...analysis.observability.outlook import NextPosture
from ...words import numbers
from ...words.case import RunCase
from ...words.catalogue import nominal_arm
from ...words.controllers import TCP_OF_NOMINAL_ARM
from ...words.enter import enter_sentence, error_words, floor_sentence
from ...words.finding_words import accuracy_reason, tcp_words
from ...words.outlook_words import region_first, region_words
from ...words.wording import clipped, counted, label, listed, person, sentence
from ..style.blocks import Paragraph, Section, Table, row_of, section_of, table_of
from ..style.canvas import DASHES, WIDTH, Picture, new_figure, style, to_svg
from ..style.theme import light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.path import Path

TITLE = "Accuracy of the TCP"


def workspace_section(result: Result) -> Section:
    """Where no accuracy is claimed, the reason alone."""
    if nominal_arm(RunCase.of_result(result)):
        return section_of(TITLE, Paragraph(TCP_OF_NOMINAL_ARM))
    accuracy = result.accuracy
    workspace, near = accuracy.workspace, accuracy.near_shots
    if workspace is None or near is None:
        why = sentence(accuracy_reason(accuracy, person) or "")
        return section_of(TITLE, Paragraph(f"No accuracy is claimed: {why}. {_where(result)}"))
    return section_of(
        TITLE,
        Paragraph(_summary(result, workspace) if _expected(result) is None else enter_sentence(result) or ""),
        *map(Paragraph, _doubts(result)),
        _table(result, workspace, near),
        *map(Paragraph, filter(None, [floor_sentence(result)])),
        _next_table(result),
        Paragraph(f"{_where(result)} {_postures(result, workspace, near)}"),
    )


def _expected(result: Result) -> tuple[TcpError, TcpError] | None:
    """The TCP's error before and after the values are entered; None where there are none."""
    entered = result.entered
    if entered is None or entered.tcp_before is None or entered.tcp_after is None:
        return None
    return entered.tcp_before, entered.tcp_after


def _summary(result: Result, region: RegionAccuracy) -> str:
    before, after = region.before_mm, region.after95_mm
    median, worst = (numbers.significant(value, 2, "mm") for value in (before.median, before.worst))
    return (
        f"{region_first(result.region)}: with nothing entered the TCP is off by {median} in the median"
        f" posture and by {worst} in the worst. With the values entered 95 % of the error is within"
        f" {_spread(after.median)} in the median posture and {_spread(after.worst)} in the worst."
    )


def _doubts(result: Result) -> list[str]:
    """Why the truth may be worse than the numbers."""
    sentences, weak = [], result.accuracy.weak
    if any(row.cause == Held("free tool") for row in result.parameters):
        sentences.append(
            "The last link, which the free tool takes up, is not measured: it counts by its tolerances."
        )
    if weak:
        names = listed([label(name) for name in weak])
        one = len(weak) == 1
        sentences.append(
            f"{names} {'is' if one else 'are'} only weakly determined and {'enters' if one else 'enter'} with"
            f" {'its' if one else 'their'} large standard uncertainty."
        )
    return sentences


def _where(result: Result) -> str:
    accuracy, kinds = result.accuracy, result.inputs.instruments
    first = next(iter(kinds.items()), None) if len(kinds) > 1 else None
    tool = "the tool" if first is None else f"{clipped(first[0])} ({first[1].name}), the first instrument"
    at = numbers.with_unit(", ".join(numbers.exact(round(v, 6)) for v in accuracy.point_mm), "mm")
    return (
        f"The TCP is {sentence(tcp_words(accuracy, person, tool))} ({at} in the flange frame), in the base"
        " frame that the encoder of joint 1 defines: δ1, and the height of the base along axis 1, are a"
        " choice of frame and do not enter."
    )


def _postures(result: Result, workspace: RegionAccuracy, near: RegionAccuracy) -> str:
    region = result.region
    over = f"{region_first(region)}: {counted(workspace.postures, 'posture')}"
    if region is None or region.positions is None:
        front = "" if region is None or region.joints == "full" else " (joint 1 within 90° of its middle)"
        over += f", evenly spread{front}, without regard to obstacles"
    return (
        f"{over}. Near the measurements: {near.postures} over the ranges of their joints. Links, gravity and"
        " harmonics count as far as the header lets the arm deviate; repeatability and load do not. Another"
        " region is stated in the header (workspace)."
    )


def _table(result: Result, workspace: RegionAccuracy, near: RegionAccuracy) -> Table:
    expected = _expected(result)
    if expected is not None:
        return _table_of_entered(result, expected, workspace, near)
    columns = ["TCP", "median", "worst", "near the measurements, median", "worst"]
    regions = (workspace, near)
    stds = [
        level for region in regions for level in (region.before_std_mm.median, region.before_std_mm.worst)
    ]
    errors = [level for region in regions for level in (region.before_mm.median, region.before_mm.worst)]
    after = [level for region in regions for level in (region.after95_mm.median, region.after95_mm.worst)]
    rms = [level for region in regions for level in (region.after_rms_mm.median, region.after_rms_mm.worst)]
    rows = [
        row_of("error with nothing entered", *map(_rounded, errors, stds)),
        row_of("its standard uncertainty", *map(_spread, stds)),
        row_of("with the values entered, 95 % within", *map(_spread, after)),
        row_of("with the values entered, expected error (rms)", *map(_spread, rms)),
    ]
    return table_of(_of_region(result), columns, rows)


def _of_region(result: Result) -> str:
    """The name of the table."""
    return f"Accuracy before and after, {region_words(result.region)}"


def _table_of_entered(
    result: Result,
    expected: tuple[TcpError, TcpError],
    workspace: RegionAccuracy,
    near: RegionAccuracy,
) -> Table:
    """Median and 95 % are of posture and posterior together: those of the first page. The worst posture is
    that whose 95 % radius is largest."""
    columns = ["TCP error", "median", "95 % below", "worst posture, 95 %", "worst near the measurements"]
    before, after = ([*error_words(error)] for error in expected)
    worst = [_size((each.before95_mm or each.before_mm).worst) for each in (workspace, near)]
    rows = [
        row_of("nothing entered", *before, *worst),
        row_of("values entered", *after, *map(_size, (workspace.after95_mm.worst, near.after95_mm.worst))),
    ]
    entered = result.entered
    if entered is not None and entered.tcp_best is not None:
        rows.append(row_of("values known exactly", *error_words(entered.tcp_best), "", ""))
    whole = result.entered_geometry
    if whole is not None and whole.tcp_after is not None:
        rows.append(row_of("links entered too", *error_words(whole.tcp_after), "", ""))
    return table_of(_of_region(result), columns, rows)


def _size(value: float) -> str:
    return numbers.significant(value, 2, "mm")


def _rounded(value: float, std: float) -> str:
    return numbers.estimate(value, std, "mm") if std > 0 else numbers.significant(value, 2, "mm")


def _spread(value: float) -> str:
    return numbers.spread(value, "mm") if value > 0 else numbers.exact(0, "mm")


NAME = "tool_accuracy"
_TITLE = "TCP error that 95 % stay below, values entered, in the same region."
_LIGHTEST, _DARKEST = 0.1, 1.0  # shares of the one hue
# Inches: beside and below panels, between them, above them with the key, and the tallest panel.
_LEFT, _BELOW, _APART, _HEAD, _TALLEST = 0.62, 0.5, 0.95, 0.95, 3.0
_SEEN_FROM = {"vertical": "from the side", "horizontal": "from above"}
_MOST_CLASSES, _MOST_STEPS = 8, 6
_BY_STEPS = 4.0  # times the smallest value: larger ones have classes by factors


def workspace_picture(result: Result) -> Picture | None:
    """A panel for each plane, the darker the larger the error that 95 % of a place stay below with the values
    entered; where was measured, and where one more measurement helps most. None where no accuracy is claimed.
    """
    accuracy = result.accuracy
    maps = [plane for plane in accuracy.maps if plane.after_p95_mm is not None]
    if not maps or result.misfit is not None or nominal_arm(RunCase.of_result(result)):
        return None
    edges = class_edges([value for plane in maps for value in _numbers(plane.after_p95_mm or ())])
    # One scale of length for both planes. Panels are placed by hand: a fitted layout takes a second.
    sizes = [(len(plane.postures[0]) * plane.cell_mm, len(plane.postures) * plane.cell_mm) for plane in maps]
    room = WIDTH - _LEFT - (len(maps) - 1) * _APART - 0.1
    inch = max(sum(across for across, _ in sizes) / room, max(up for _, up in sizes) / _TALLEST)
    whole = _HEAD + max(up for _, up in sizes) / inch + _BELOW
    with style():
        figure = new_figure(whole, fitted=False)
        left = _LEFT
        for plane, (across, up) in zip(maps, sizes, strict=True):
            box = (left / WIDTH, 1 - (_HEAD + up / inch) / whole, across / inch / WIDTH, up / inch / whole)
            axes = figure.add_axes(box)
            _panel(axes, plane, plane.after_p95_mm or (), edges)
            _base(axes, plane.plane)
            _next_postures(axes, plane, result)
            axes.set_xlabel(f"{plane.axes[0]}, mm", loc="left")
            axes.set_ylabel(f"{plane.axes[1]}, mm")
            axes.set_title(_SEEN_FROM[plane.plane], loc="left")
            left += across / inch + _APART
        _legend(figure, edges, whole, next_postures=bool(_proposed(result)))
        svg = to_svg(figure, NAME)
    return Picture(NAME, _TITLE, _alt(result), svg)


def _proposed(result: Result) -> Sequence[NextPosture]:
    return () if result.outlook is None else result.outlook.next_postures


def _next_postures(axes: Axes, plane: Map, result: Result) -> None:
    """Where the TCP is in the postures by which one more measurement helps most, numbered from 1."""
    for number, posture in enumerate(_proposed(result), start=1):
        at = _in_plane(plane, posture)
        axes.plot(
            *at, "D", markersize=5, zorder=4, color=light("ink"), markeredgecolor=light("ground"), mew=0.8
        )
        words = axes.annotate(str(number), at, (5, 3), textcoords="offset points", fontsize=9, zorder=5)
        words.set_bbox({"facecolor": light("ground"), "edgecolor": "none", "pad": 0.4, "alpha": 0.85})
        words.set_color(light("ink"))


def _in_plane(plane: Map, posture: NextPosture) -> tuple[float, float]:
    x, y, _ = posture.tcp_mm
    return posture.beside_axis_mm if plane.plane == "vertical" else (x, y)


def _numbers(grid: Grid) -> list[float]:
    return [value for row in grid for value in row if value is not None]


def class_edges(values: list[float]) -> list[float]:
    """Round bounds of classes that hold all values: equal steps, or each some times the one before where
    values differ by factors."""
    high = max(values)
    low = max(min(values), high / 1e4)
    if high <= 0:
        return [0.0, 1.0]
    if high < _BY_STEPS * min(values):
        return _equal_steps(low, high)
    edges: list[float] = []
    for factors in ((1, 2, 5), (1, 3), (1,)):
        decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
        steps = [factor * 10.0**decade for decade in decades for factor in factors]
        first = max(i for i, step in enumerate(steps) if step <= low * (1 + 1e-9))
        last = min((i for i, step in enumerate(steps) if step > high), default=len(steps) - 1)
        edges = steps[first : last + 1]
        if len(edges) <= _MOST_CLASSES + 1:
            break
    return [0.0, *edges[1:]] if min(values) < edges[0] else edges


def _equal_steps(low: float, high: float) -> list[float]:
    """The smallest steps of 1, 2 or 5 times a power of ten by which there are not too many classes."""
    power = math.floor(math.log10(high)) - 2
    steps = (factor * 10.0 ** (power + k) for k in range(4) for factor in (1, 2, 5))
    step = next(each for each in steps if high / each - math.floor(low / each) <= _MOST_STEPS)
    first, last = math.floor(low / step + 1e-9), math.floor(high / step) + 1
    return [float(f"{step * k:.6g}") for k in range(first, last + 1)]


def class_of(value: float, edges: list[float]) -> int:
    """Which class a value is in: 0 is from the first edge to the second."""
    return max(sum(value >= edge for edge in edges[:-1]) - 1, 0)


def _share(which: int, classes: int) -> float:
    return _DARKEST if classes == 1 else _LIGHTEST + which / (classes - 1) * (_DARKEST - _LIGHTEST)


def _panel(axes: Axes, plane: Map, grid: Grid, edges: list[float]) -> None:
    from matplotlib.patches import PathPatch

    size, (left, low) = plane.cell_mm, plane.corner_mm
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
        if plane.shots[i][j]
    ]
    x, y = zip(*shots, strict=True)
    axes.plot(
        x, y, "o", markersize=2.8, zorder=3, markerfacecolor=light("ground"), color=light("ink"), mew=0.8
    )
    axes.set_xlim(left, left + columns * size)
    axes.set_ylim(low, low + rows * size)
    axes.grid(visible=False)
    axes.locator_params(axis="x", nbins=2)
    axes.locator_params(axis="y", nbins=4)


def _shape(grid: Grid, which: int, edges: list[float], size: float, left: float, low: float) -> Path | None:
    """The outline of all cells of a class, runs of neighbours in a row put together."""
    from matplotlib.path import Path

    rectangles = []
    for i, row in enumerate(grid):
        inside_of = [value is not None and class_of(value, edges) == which for value in row]
        at = 0
        for inside, run in itertools.groupby(inside_of):
            count = len(list(run))
            if inside:
                x0, x1 = left + at * size, left + (at + count) * size
                y0, y1 = low + i * size, low + (i + 1) * size
                rectangles.append(Path([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], closed=True))
            at += count
    return Path.make_compound_path(*rectangles) if rectangles else None


def _base(axes: Axes, plane: str) -> None:
    """Where the base is: its level next to axis 1, its place seen from above; with its name."""
    ink = light("ink")
    bottom, top = axes.get_ylim()
    if plane == "horizontal":
        axes.plot([0], [0], "+", markersize=8, markeredgewidth=1.2, color=ink, zorder=4)
        # Below the mark: the number of a posture is above its own.
        text = axes.annotate("base", (0, 0), (4, -11), textcoords="offset points", zorder=4)
        text.set_bbox({"facecolor": light("ground"), "edgecolor": "none", "pad": 0.4, "alpha": 0.85})
    elif bottom <= 0 <= top:
        axes.axhline(0, color=ink, linewidth=0.8, linestyle=DASHES)
        text = axes.annotate("base", (1, 0), (3, 0), axes.get_yaxis_transform(), "offset points", va="center")
    else:
        return
    text.set(color=ink, fontsize=8.5)


def _legend(figure: Figure, edges: list[float], whole: float, *, next_postures: bool) -> None:
    """The classes, one scale for all panels, darkest last; below them the marks. `whole` inches high."""
    from matplotlib.legend import Legend
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    classes = len(edges) - 1
    patches = [
        Patch(
            facecolor=light("identified"),
            alpha=_share(which, classes),
            linewidth=0,
            label=f"{numbers.exact(edges[which])} to {numbers.exact(edges[which + 1])}",
        )
        for which in range(classes)
    ]
    style_of: dict[str, Any] = {"linestyle": "none", "color": light("ink")}
    ring = {**style_of, "marker": "o", "markersize": 3.4, "markerfacecolor": light("ground"), "mew": 0.8}
    marks = [Line2D([], [], **ring, label="measurement")]
    if next_postures:
        marks.append(Line2D([], [], **style_of, marker="D", markersize=5, label="next posture"))
    options: dict[str, Any] = {
        "loc": "upper left",
        "alignment": "left",
        "borderpad": 0.0,
        "columnspacing": 0.9,
        "handlelength": 1.1,
        "handleheight": 0.9,
        "handletextpad": 0.4,
    }
    left = _LEFT / WIDTH
    figure.legend(
        handles=patches,
        ncols=classes,
        title="95 % below, mm",
        title_fontsize=9.5,
        bbox_to_anchor=(left, 1.0),
        **options,
    )
    figure.add_artist(
        Legend(
            figure,
            marks,
            [str(mark.get_label()) for mark in marks],
            ncols=2,
            bbox_to_anchor=(left, 1 - 0.44 / whole),
            bbox_transform=figure.transFigure,
            **options,
        )
    )


def _alt(result: Result) -> str:
    region = result.accuracy.workspace
    assert region is not None
    worst = numbers.significant(region.after95_mm.worst, 2, "mm")
    expected = _expected(result)
    below = ""
    if expected is not None:
        below = f" 95 % are below {numbers.significant(expected[1].p95_mm, 2, 'mm')};"
    return (
        f"Maps of the TCP error with the values entered, {region_words(result.region)}, from the side and"
        f" from above.{below} in the worst posture 95 % of the error is within {worst}."
    )


def _next_table(result: Result) -> Table | None:
    """The postures by which one more measurement helps most."""
    proposed, outlook = _proposed(result), result.outlook
    if not proposed or outlook is None or outlook.u_mm is None:
        return None
    joints = range(1, len(proposed[0].joints) + 1)
    heads = ["", "target", *(f"J{k}" for k in joints), "u of the TCP then"]
    rows = [
        row_of(
            str(number),
            clipped(each.target, 24),
            *(numbers.fixed(value, 1) for value in each.joints),
            numbers.spread(each.u_mm, "mm"),
        )
        for number, each in enumerate(proposed, start=1)
    ]
    caption = (
        "Where one more measurement helps the TCP most, each beside those before it: joints as in a plan"
        f" (joints_deg); u predicted, root mean square over the region, now"
        f" {numbers.spread(outlook.u_mm, 'mm')}"
    )
    return table_of(caption, heads, rows, "llr")
