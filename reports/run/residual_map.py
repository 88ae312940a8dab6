"""The residuals as arrows at the measurements: where the arm was, which way and how far it was off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...analysis.answer.result import Result
from ...model.arrays import Matrix
from ...words import numbers
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from .residuals import noise_limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
