"""Parts of the figures of a study over settings: marks of either fit, gaps in words, scales, legend."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ....experiments.studies.sweeps.grid_answer import CaseParameter, Fit, GridCase, GridStudy
from ....words import numbers
from ....words.wording import clipped
from ...style.palette import light
from ...style.typeface import in_font
from ..study_blocks import NOT_DETERMINED
from .grid_words import NO_PLAN, rmse_interval, shown_unit, tolerance

Drawn = TypeVar("Drawn")

HELD, NOT_ESTIMATED = "held", "not estimated"
UNCERTAINTY = "standard uncertainty"
_LEAST_RANGE = 4.0  # of a logarithmic scale, so that it has ticks


@dataclass(frozen=True)
class Dot:
    """A mark: its shape, the role of its colour, its size in points; a hollow one is filled with the ground's
    colour, so that no line runs through it."""

    shape: str
    role: str
    size: float
    filled: bool

    def draw(self, axes: Axes, xs: Sequence[float], ys: Sequence[float], **options: Any) -> None:
        axes.plot(xs, ys, self.shape, **self._look(), **options)

    def handle(self, label: str) -> Line2D:
        """The entry of a legend."""
        return Line2D([], [], marker=self.shape, linewidth=1.1, label=label, **self._look())

    def _look(self) -> Any:
        face = light(self.role if self.filled else "ground")
        return {"color": light(self.role), "markersize": self.size, "markerfacecolor": face}


# The two fits by shape and by fill, so that they differ in grey too.
FITS: dict[Fit, Dot] = {"likelihood": Dot("o", "ink", 3.4, True), "midpoint": Dot("s", "muted", 3.8, False)}


def draw_fits(axes: Axes, at: float, one: CaseParameter, *, upright: bool) -> None:
    """The RMSE of each fit with its 95 % interval, at `at` on the other axis; nothing where there is none."""
    for fit, dot in FITS.items():
        if errors := one.errors(fit):
            ends, mark = ([at, at], rmse_interval(errors)), ([at], [errors.rmse])
            line = ends if upright else ends[::-1]
            axes.plot(*line, "-", linewidth=1.1, color=light(dot.role), zorder=2.5)
            dot.draw(axes, *(mark if upright else mark[::-1]), markeredgewidth=1.0, zorder=2.6)


def tolerance_line(draw: Callable[..., Drawn], *at: object, **options: object) -> Drawn:
    """The line of a tolerance, drawn by `axhline`, `vlines` or `Line2D`."""
    return draw(*at, linestyle=(0, (4, 2)), linewidth=1.0, color=light("weak"), **options)


def draw_tolerance(
    study: GridStudy, one: CaseParameter, draw: Callable[..., object], **options: object
) -> None:
    """The line of the tolerance, by `axhline` or `vlines`; nothing where the cases differ in it."""
    if (at := tolerance(study, one)) is not None:
        tolerance_line(draw, at, **options)


def gap(case: GridCase, one: CaseParameter | None) -> str:
    """Why nothing is drawn for a parameter of a case, in words; empty where it has a number."""
    if case.reason is not None:
        return NO_PLAN
    if one is None:
        return NOT_ESTIMATED
    return "" if one.has_numbers else HELD if one.status == "held" else NOT_DETERMINED


def hatch(draw: Callable[..., Drawn], *at: object, words: str, **options: object) -> Drawn:
    """The patch of a gap, drawn by `axhspan` or `Patch`; hatched the other way if held or without a plan."""
    look = {
        "facecolor": "none",
        "edgecolor": light("line"),
        "hatch": "/////" if words == NOT_DETERMINED else "\\\\\\",
        "linewidth": 0,
    }
    return draw(*at, **(look | options))


def write_gap(axes: Axes, x: float, y: float, words: str, **options: Any) -> None:
    """The words of a gap, on the figure's ground."""
    axes.text(
        x,
        y,
        words,
        ha="center",
        color=light("unidentifiable" if words.split() == NOT_DETERMINED.split() else "held"),
        bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.7},
        **options,
    )


def gap_handles(gaps: Iterable[str]) -> list[Artist]:
    """Entries of a legend for gaps of these words."""
    return [hatch(Patch, words=words, edgecolor=light("muted"), linewidth=0.4, label=words) for words in gaps]


def log_scale(study: GridStudy, units: Collection[str]) -> tuple[float, float]:
    """Limits of a logarithmic scale that hold every number of these units, and its tolerance."""
    values: list[float] = []
    for one in study.parameters:
        if one.unit in units:
            values += [at for at in (tolerance(study, one), one.std) if at is not None]
            values += [end for fit in FITS if (errors := one.errors(fit)) for end in rmse_interval(errors)]
    low, high = (min(values), max(values)) if values else (0.01, 1.0)
    room = max(1.25, math.sqrt(_LEAST_RANGE * low / high))
    return low / room, high * room


def in_font_within(text: str, width: int) -> str:
    """`text` as the figures can write it, in at most so many letters: escapes count in full."""
    return clipped(in_font(text), width)


def legend_above(figure: Figure, handles: list[Artist] | None, ncols: int) -> None:
    """The legend above a figure; `handles` None: of what has a label."""
    figure.legend(
        **({} if handles is None else {"handles": handles}),
        loc="outside upper left",
        ncols=ncols,
        handlelength=1.6,
        handletextpad=0.5,
    )


def legend(figure: Figure, study: GridStudy, gaps: set[str], **prediction: Any) -> None:
    """The legend of the marks that occur; `prediction` has the properties of that of the prediction."""
    handles: list[Artist] = [Line2D([], [], color=light("identified"), label="predicted u", **prediction)]
    handles += [dot.handle(f"RMSE of the {fit} fit, 95 %") for fit, dot in FITS.items() if study.has(fit)]
    limits = dict.fromkeys(
        numbers.exact(limit, shown_unit(one))
        for one in study.parameters
        if (limit := tolerance(study, one)) is not None
    )
    if limits:
        handles.append(tolerance_line(Line2D, [], [], label=in_font(f"tolerance {', '.join(limits)}")))
    legend_above(figure, handles + gap_handles(sorted(gaps)), 3)
