"""The residuals over the workspace: where the arm was when they were large."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from ...analysis.answer.result import Result
from ...words import numbers
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from .residuals import noise_limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.lines import Line2D

NAME = "residual_map"
_AREA = 22.0  # square points of a normalised residual of 1
_LARGEST = 8.0  # a larger normalised residual is drawn as this one


class _Residual(NamedTuple):
    """A measurement: where the laser (or the tip of the probe) was, mm, and its normalised residual."""

    x: float
    y: float
    z: float
    normalised: float
    beyond: bool


def residual_map_picture(result: Result) -> Picture | None:
    """From the side and from above, the area of a dot by its normalised residual; None without a scene."""
    placed = _placed(result)
    if not placed:
        return None
    with style():
        figure = new_figure(3.1)
        side, above = figure.subplots(1, 2)
        _panel(side, [(math.hypot(one.x, one.y), one.z) for one in placed], placed)
        side.set(xlabel="distance from axis 1, mm", ylabel="height, mm")
        handles = _panel(above, [(one.x, one.y) for one in placed], placed)
        above.plot([0], [0], "+", markersize=8, markeredgewidth=1.2, color=light("ink"))
        above.set(xlabel="x, mm", ylabel="y, mm")
        for axes in (side, above):
            axes.set_aspect("equal", adjustable="datalim")
            axes.locator_params(nbins=4)
        figure.legend(handles=handles, loc="outside upper right", ncols=len(handles), handletextpad=0.3)
        svg = to_svg(figure, NAME)
    count = "" if len(placed) == len(result.shots) else f", {len(placed)} of {len(result.shots)} measurements"
    title = f"Normalised residuals over the workspace, from the side and from above{count}"
    return Picture(NAME, title, _alt(placed), svg)


def _placed(result: Result) -> list[_Residual]:
    """The measurements whose place is known."""
    if result.scene is None:
        return []
    limits = noise_limits(result.shots)
    by_shot = {shot.shot: (shot.whitened, limit) for shot, limit in zip(result.shots, limits, strict=True)}
    placed = []
    for posture in result.scene.shots:
        normalised, limit = by_shot[posture.shot]
        placed.append(_Residual(*posture.links[-1], normalised, normalised > limit))
    return placed


def _panel(axes: Axes, at: list[tuple[float, float]], placed: list[_Residual]) -> list[Line2D]:
    """The dots, the largest below; what the key shows of them."""
    order = sorted(range(len(placed)), key=lambda i: -placed[i].normalised)
    for i in order:
        one = placed[i]
        axes.plot(
            *at[i],
            SHAPES["weak" if one.beyond else "identified"],
            markersize=_size(one.normalised),
            color=light("weak" if one.beyond else "identified"),
            alpha=0.7,
            mew=0,
        )
    keys: list[tuple[float, str]] = [(1.0, "1 standard deviation"), (3.0, "3")]
    handles = [
        axes.plot([], [], "o", markersize=_size(value), color=light("identified"), mew=0, label=words)[0]
        for value, words in keys
    ]
    if any(one.beyond for one in placed):
        words = "beyond the 95 % limit of the noise"
        handles += axes.plot([], [], SHAPES["weak"], color=light("weak"), markersize=6, mew=0, label=words)
    return handles


def _size(normalised: float) -> float:
    """The width of a dot, points."""
    return math.sqrt(_AREA * max(min(normalised, _LARGEST), 0.15))


def _alt(placed: list[_Residual]) -> str:
    worst = max(placed, key=lambda one: one.normalised)
    beyond = sum(one.beyond for one in placed)
    at = ", ".join(numbers.fixed(value, 0) for value in (worst.x, worst.y, worst.z))
    return (
        f"Places of {len(placed)} measurements with their normalised residuals; {beyond} lie beyond the 95 %"
        f" limit of the noise. The largest, {numbers.significant(worst.normalised, 2)}, is at {at} mm."
    )
