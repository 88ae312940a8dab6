"""The residuals, measurement by measurement, their figure, and as arrows where the arm was."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtri

from ...analysis.answer.result import Result
from ...analysis.diagnostics.outliers import ShotResult
from ...analysis.status import Status
from ...words import numbers
from ...words.wording import clipped, measured_at, places_counted, shown
from ..style.blocks import Cell, FigureBlock, Paragraph, Section, row_of, section_of, table_of
from ..style.canvas import DASHES, Picture, mark_unvalidated, new_figure, style, to_svg
from ..style.theme import in_font, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D
from typing import TYPE_CHECKING, NamedTuple

from ...model.arrays import Matrix
from ..style.theme import SHAPES

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_SHOTS = 60
WORST_SHOTS = 20


def residuals_section(result: Result) -> Section:
    """The section of a report; of many measurements the table has the worst."""
    shots, robust = result.shots, result.robust
    rotations = any(shot.miss_deg for shot in shots)
    columns = [
        "measurement",
        measured_at([shot.target for shot in shots], result.inputs.instruments),
        "residual",
        *(["rotation"] if rotations else []),
        "normalised",
        "leave-one-out",
        "Cook’s distance",
    ]
    weights = robust.weights if robust is not None and robust.converged else None
    outliers = set(robust.outliers) if robust is not None and weights is not None else set()
    chosen, caption = list(range(len(shots))), "Residual of every measurement"
    text = (
        "A residual is what the fit leaves between what was read and what is predicted; normalised, it is"
        " divided by its standard deviation. The leave-one-out residual is that from the fit to the other"
        " measurements; Cook’s distance is how far the estimates move without the measurement."
    )
    if weights is not None:
        columns += ["weight", "outlier"] if outliers else ["weight"]
        text += " The weight is that of the robust fit."
    influential = [(shot.cooks, i) for i, shot in enumerate(shots) if shot.cooks is not None]
    heaviest = max(influential, key=lambda pair: pair[0])[1] if influential else None
    if heaviest is not None and result.misfit is None:  # else the message says which one is suspected
        cooks = numbers.or_words(shots[heaviest].cooks, "not defined")
        text += f" Most influential measurement: {shots[heaviest].shot} (Cook’s distance {cooks})."
    if len(shots) > MOST_SHOTS:
        # An outlier of the robust fit may have pulled the likelihood fit to itself.
        worst = sorted(chosen, key=lambda i: (shots[i].shot not in outliers, -shots[i].whitened))
        chosen = worst[:WORST_SHOTS]
        chosen += [] if heaviest is None or heaviest in chosen else [heaviest]
        caption = f"The {WORST_SHOTS} largest residuals of {len(shots)}"
        caption += ", and the most influential measurement" if len(chosen) > WORST_SHOTS else ""
        text += f" Of {len(shots)} measurements the table shows the {WORST_SHOTS} worst; result.json has all."
    rows = []
    for i in chosen:
        shot = shots[i]
        cells: list[str | Cell] = [
            str(shot.shot),
            clipped(shot.target, 24),
            numbers.significant(shot.length_mm, unit="mm"),
            *([_rotation(shot)] if rotations else []),
            numbers.significant(shot.whitened, 2),
            numbers.or_words(shot.leave_one_out, "not predictable", "mm"),
            numbers.or_words(shot.cooks, "not defined"),
        ]
        if weights is not None:
            cells.append(numbers.fixed(weights[i], 2))
        if outliers:
            cells.append(Cell("yes", mark="weak") if shot.shot in outliers else "no")
        rows.append(row_of(*cells))
    aligned = "rl" + "r" * (len(columns) - 3) + ("l" if outliers else "r")
    return section_of(
        "Residuals",
        Paragraph(text),
        FigureBlock("misses", screen_only=len(shots) <= FEW_SHOTS),  # the table says the same of them
        FigureBlock("residual_map"),
        table_of(caption, columns, rows, aligned),
    )


def _rotation(shot: ShotResult) -> str:
    angle = math.hypot(*shot.miss_deg) if shot.miss_deg else None
    return numbers.or_words(angle, "—", "deg")


# ── the figure ────────────────────────────────────────────────────────────────────────────────

FEW_SHOTS = 60
MOST_DRAWN, LARGEST_DRAWN = 1000, 100
_FEW_TARGETS = 8
_KEY_ROOM = 18.0  # points above a panel, which its key takes


def draw_residuals(axes: Axes, result: Result) -> None:
    """The normalised residuals, as the lower panel of the figure has them, in a reader's own axes."""
    order = _by_target(result)
    drawn = drawn_of(order)
    with style():
        _sigmas(axes, drawn, len(order) <= FEW_SHOTS)
        mark_unvalidated(axes, _statuses(result), above=_KEY_ROOM)
        axes.set(ylim=(0, None), xlim=(-0.7, len(order) - 0.3), xlabel="measurement")
        if len(order) <= FEW_SHOTS:
            axes.set_xticks(range(len(order)), [str(shot.shot) for shot in order])


def _statuses(result: Result) -> list[Status]:
    return [row.status for row in result.parameters]


def _by_target(result: Result) -> list[ShotResult]:
    """The measurements in order of target, in the order of the run."""
    targets = list(dict.fromkeys(shot.target for shot in result.shots))
    return sorted(result.shots, key=lambda shot: targets.index(shot.target))


def residuals_picture(result: Result) -> Picture:
    """Above the residuals in mm, dots with the leave-one-out residual as a ring; below in their own σ.

    Measurements are in order of target, in the order of the run. For more than 60 the stems go and the
    dots shrink; of more than 1000 some are drawn. The line in the lower panel is the 95 % limit that the
    stated noise leads one to expect.
    """
    order = _by_target(result)
    targets = list(dict.fromkeys(shot.target for shot in order))
    few = len(order) <= FEW_SHOTS
    group = measured_at(targets, result.inputs.instruments).replace(" or ", "/")
    drawn = drawn_of(order)
    with style():
        figure = new_figure(3.7)
        above, below = figure.subplots(2, 1, sharex=True)
        _millimetres(above, drawn, few)
        mark_unvalidated(above, _statuses(result), above=_KEY_ROOM)
        _sigmas(below, drawn, few)
        room = _targets(above, below, order)
        if few:
            below.set_xticks(range(len(order)), [str(shot.shot) for shot in order])
            below.tick_params(axis="x", labelsize=9 if len(order) <= 25 else 5.5)
        else:
            below.tick_params(axis="x", labelbottom=False, length=0)
        below.set_xlabel(
            "measurement" if few else f"{len(order)} measurements, {group} by {group}", labelpad=room
        )
        below.set_xlim(-0.7, len(order) - 0.3)
        for axes in (above, below):
            axes.grid(visible=False, axis="x")
            axes.set_ylim(bottom=0)
        svg = to_svg(figure, "misses")
    worst = max(order, key=lambda shot: float(shot.whitened))
    over = sum(shot.whitened > limit for shot, limit in zip(order, noise_limits(order), strict=True))
    title = "Residuals, measurement by measurement"
    if len(drawn) < len(order):
        title += (
            f": {len(drawn)} of {len(order)} are drawn, the {LARGEST_DRAWN} largest and others evenly; all"
            " are in result.json"
        )
    where = places_counted(targets, result.inputs.instruments)
    alt = (
        f"Residuals of {len(order)} measurements at {where}. {over} lie beyond "
        f"the 95 % limit of the noise; the largest is measurement {worst.shot}."
    )
    return Picture("misses", title, alt, svg)


def drawn_of(shots: Sequence[ShotResult]) -> dict[int, ShotResult]:
    """Those of the figure, by their place: all, or of many the largest normalised ones and others evenly."""
    if len(shots) <= MOST_DRAWN:
        return dict(enumerate(shots))
    largest = sorted(range(len(shots)), key=lambda i: -shots[i].whitened)[:LARGEST_DRAWN]
    rest = sorted(set(range(len(shots))).difference(largest))
    even = np.linspace(0, len(rest) - 1, MOST_DRAWN - LARGEST_DRAWN).round().astype(int)
    return {i: shots[i] for i in sorted([*largest, *(rest[k] for k in even)])}


def noise_limits(shots: Sequence[ShotResult]) -> list[float]:
    """Of the normalised residuals, below which noise leaves 95 % of them."""
    by_size = {size: math.sqrt(chdtri(size, 0.05)) for size in {shot.size for shot in shots}}
    return [by_size[shot.size] for shot in shots]


def _millimetres(axes: Axes, drawn: dict[int, ShotResult], few: bool) -> None:
    """The upper panel: the residual as a dot, the leave-one-out residual as a ring."""
    length = [shot.length_mm for shot in drawn.values()]
    left_out = {i: shot.leave_one_out for i, shot in drawn.items() if shot.leave_one_out is not None}
    if few:
        axes.vlines(list(drawn), 0, length, color=light("line"), linewidth=1)
    size, rim = (4.5, 0.8) if few else (1.8, 0.4)
    rings = axes.plot(
        list(left_out), list(left_out.values()), "o", markersize=size, mew=rim, label="leave-one-out"
    )
    rings[0].set(color=light("weak"), markerfacecolor="none")
    at, blue = list(drawn), light("identified")
    dots = axes.plot(at, length, "o", markersize=size, mew=0, color=blue, label="at the fit")
    axes.set_ylabel("residual, mm")
    _key(axes, [*dots, *rings] if left_out else dots, 4.5 / size)


def _sigmas(axes: Axes, drawn: dict[int, ShotResult], few: bool) -> None:
    """The lower panel: the normalised residual, and the limit that noise leaves 95 % below."""
    x = np.array(list(drawn))
    whitened = np.array([shot.whitened for shot in drawn.values()])
    limit = np.array(noise_limits(list(drawn.values())))
    beyond = whitened > limit
    if few:
        axes.vlines(x, 0, whitened, color=light("line"), linewidth=1)
    size = 4.5 if few else 1.8
    axes.plot(x[~beyond], whitened[~beyond], "o", markersize=size, mew=0, color=light("identified"))
    outside = axes.plot(
        x[beyond], whitened[beyond], "^", markersize=size + 0.7, mew=0, color=light("weak"), label="beyond it"
    )
    expected = axes.step(
        np.concatenate([[-0.5], x + 0.5]),
        np.concatenate([limit[:1], limit]),
        color=light("muted"),
        linewidth=0.8,
        linestyle=DASHES,
        label="95 % limit of the noise",
    )
    _key(axes, [*expected, *outside] if beyond.any() else expected, 4.5 / size)
    axes.set_ylabel("normalised residual")


def _key(axes: Axes, handles: list[Line2D], scale: float) -> None:
    """The key above a panel, flush right."""
    axes.legend(
        handles=handles,
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=len(handles),
        handletextpad=0.3,
        handlelength=1.6,
        markerscale=scale,
    )


def _targets(above: Axes, below: Axes, shots: Sequence[ShotResult]) -> float:
    """Several targets: a line between them and their names below, steep where there are many.

    Returns the room (points) that the axis label has to leave for the names.
    """
    runs = [(name, len(list(group))) for name, group in groupby(shots, key=lambda shot: shot.target)]
    if len(runs) == 1:
        return 3.0
    few = len(runs) <= _FEW_TARGETS
    start = 0
    for i, (name, count) in enumerate(runs):
        if i:
            for axes in (above, below):
                axes.axvline(start - 0.5, color=light("line"), linewidth=0.6)
        below.annotate(
            clipped(in_font(shown(name)), 14),
            (start + (count - 1) / 2, 0),
            xycoords=("data", "axes fraction"),
            xytext=(0, -17 if len(shots) <= FEW_SHOTS else -4),
            textcoords="offset points",
            ha="center" if few else "right",
            va="top",
            rotation=0 if few else 60,
            rotation_mode="anchor",
            fontsize=8.5 if few else 6.5,
            color=light("muted"),
        )
        start += count
    return 15.0 if few else 52.0


NAME = "residual_map"
_LONGEST = 0.22  # of the extent of the measurements is the longest arrow, about
_MOST_NUMBERED = 24  # measurements
_MARKS = ("identified", "weak")  # within the limit of the noise, beyond it


class _Arrow(NamedTuple):
    """A measurement: where the laser (or the tip of the probe) was, (3,) mm, its residual as a vector, (3,)
    mm, that as seen along the beam, (2,) mm to the right and up (None without a beam), whether it is beyond
    the noise."""

    shot: int
    at: Matrix
    vector: Matrix
    across: Matrix | None
    beyond: bool


class _PanelArrow(NamedTuple):
    """An arrow in a panel: its beginning (2,) and its length (2,), mm."""

    at: Matrix
    length: Matrix


def residual_map_picture(result: Result) -> Picture | None:
    """From the side and from above, enlarged; where beams meet targets also on the target, as seen along each
    beam. None where nothing has a place."""
    arrows = _arrows(result)
    if not arrows:
        return None
    factor = _factor(arrows)
    radial = [one.at[:2] / max(math.hypot(*one.at[:2]), 1e-9) for one in arrows]
    side = [
        _PanelArrow(np.array([out @ one.at[:2], one.at[2]]), np.array([out @ one.vector[:2], one.vector[2]]))
        for one, out in zip(arrows, radial, strict=True)
    ]
    panels = [
        ("from the side", "distance from axis 1, mm", "height, mm", side, factor),
        ("from above", "x, mm", "y, mm", [_PanelArrow(one.at[:2], one.vector[:2]) for one in arrows], factor),
    ]
    across = [_PanelArrow(np.zeros(2), one.across) for one in arrows if one.across is not None]
    if len(across) == len(arrows):
        panels.append(("on the target", "to the right, mm", "up, mm", across, 1.0))
    with style():
        figure = new_figure(2.6)
        drawn = figure.subplots(1, len(panels))
        for axes, (title, x, y, of_panel, times) in zip(drawn, panels, strict=True):
            _panel(axes, arrows, of_panel, times)
            axes.set_title(title, loc="left", fontsize=9.0)
            axes.set(xlabel=x, ylabel=y)
            axes.set_aspect("equal", adjustable="datalim")
            axes.locator_params(nbins=4)
            axes.tick_params(labelsize=8.0)
            for label in axes.get_xticklabels()[-1:]:
                label.set_horizontalalignment("right")
        if any(one.beyond for one in arrows):
            words = "beyond the 95 % limit of the noise"
            handles = drawn[0].plot([], [], SHAPES["weak"], color=light("weak"), markersize=4, label=words)
            figure.legend(handles=handles, loc="outside upper right")
        svg = to_svg(figure, NAME)
    return Picture(NAME, _title(result, arrows, factor), _alt(arrows), svg)


def _arrows(result: Result) -> list[_Arrow]:
    """The measurements whose place and residual are known."""
    if result.scene is None:
        return []
    limits = zip(result.shots, noise_limits(result.shots), strict=True)
    beyond = {shot.shot: shot.whitened > limit for shot, limit in limits}
    arrows = []
    for shot in result.scene.shots:
        if shot.residual_mm is None:
            continue
        at, vector, across = np.array(shot.links[-1]), np.array(shot.residual_mm), None
        if shot.beam_to is not None:
            across = _across(np.array(shot.beam_to) - at, vector)
        arrows.append(_Arrow(shot.shot, at, vector, across, beyond[shot.shot]))
    return arrows


def _across(beam: Matrix, vector: Matrix) -> Matrix:
    """(2,) to the right and up, of a vector (3,) as seen along a beam (3,); of a vertical beam right is y."""
    right = np.cross(beam, [0.0, 0.0, 1.0])
    if np.linalg.norm(right) < 1e-6 * np.linalg.norm(beam):
        right = np.array([0.0, 1.0, 0.0])
    up = np.cross(right, beam)
    return np.array([vector @ right / np.linalg.norm(right), vector @ up / np.linalg.norm(up)])


def _factor(arrows: Sequence[_Arrow]) -> float:
    """How many times larger than the places the arrows are drawn: 1, 2 or 5 times a power of ten."""
    places = np.array([one.at for one in arrows])
    extent = max(float(np.ptp(places, axis=0).max()), 100.0)
    longest = max(float(np.linalg.norm(one.vector)) for one in arrows)
    most = _LONGEST * extent / max(longest, 1e-9)
    power = 10.0 ** math.floor(math.log10(most))
    return max(times * power for times in (1, 2, 5) if times * power <= most)


def _panel(axes: Axes, arrows: Sequence[_Arrow], drawn: Sequence[_PanelArrow], times: float) -> None:
    """The arrows, numbered where they are few, and one that says how long a round number of mm is."""
    for beyond, role in zip((False, True), _MARKS, strict=True):
        chosen = [each for one, each in zip(arrows, drawn, strict=True) if one.beyond == beyond]
        if not chosen:
            continue
        at, length = (np.array([getattr(each, name) for each in chosen]).T for name in ("at", "length"))
        axes.quiver(
            *at,
            *(length * times),
            color=light(role),
            angles="xy",
            scale_units="xy",
            scale=1.0,
            units="inches",
            width=0.013,
            headwidth=4,
            headlength=5,
            headaxislength=4.5,
        )
        axes.plot(*at, SHAPES[role], color=light(role), markersize=2.5, mew=0)
        axes.plot(*(at + length * times), linewidth=0)  # so that the tips are within the axes
    if len(arrows) <= _MOST_NUMBERED:
        for one, each in zip(arrows, drawn, strict=True):
            tip = (each.at + each.length * times).tolist()
            axes.annotate(
                str(one.shot),
                (tip[0], tip[1]),
                (2, 2),
                textcoords="offset points",
                fontsize=7.0,
                color=light("muted"),
            )


def _title(result: Result, arrows: Sequence[_Arrow], factor: float) -> str:
    every = len(result.shots)
    count = "" if len(arrows) == every else f", {len(arrows)} of {every} measurements"
    size = numbers.exact(100.0 / factor, "mm")
    scale = f"drawn {numbers.exact(factor)} times larger (100 mm of the axes are {size})"
    return f"Residuals at the measurements{count}: arrows from the fit to what was measured, {scale}."


def _alt(arrows: Sequence[_Arrow]) -> str:
    worst = max(arrows, key=lambda one: float(np.linalg.norm(one.vector)))
    beyond = sum(one.beyond for one in arrows)
    size = numbers.significant(float(np.linalg.norm(worst.vector)), 2, "mm")
    to = ", ".join(numbers.significant(float(value), 2) for value in worst.vector)
    return (
        f"Residuals of {len(arrows)} measurements as arrows; {beyond} lie beyond the 95 % limit of the noise."
        f" The largest, {size}, is that of measurement {worst.shot}: {to} mm in x, y and z."
    )
