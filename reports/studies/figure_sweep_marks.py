"""What the figures of a sweep have in common: marks of either fit, gaps in words, scales, legend."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..style.palette import light
from ..words import numbers
from ..words.wording import clipped, in_font
from .study_view import NOT_DETERMINED
from .sweep_cases import NO_PLAN, has_observed, observed, predicted, rmse_interval, tolerance, unit_of

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Json = dict[str, Any]

# The two fits by shape and by fill, so that they can be told in grey: marker, its size, filled or not.
FITS = {"likelihood": ("o", 3.4, True), "midpoint": ("s", 3.8, False)}
HELD, NOT_ESTIMATED = "held", "not estimated"
_LEAST_RANGE = 4.0  # of a logarithmic scale, so that it has ticks


def draw_fit(axes: Axes, at: float, row: Json, fit: str, *, upright: bool) -> None:
    """The rmse of a fit with its 95 % interval, at `at` on the other axis; nothing where there is none."""
    entry = observed(row, fit)
    if entry is None:
        return
    marker, size, filled = FITS[fit]
    ink = light("ink" if filled else "muted")
    low, high = rmse_interval(entry)
    ends, mark = ([at, at], [low, high]), ([at], [entry["rmse"]])
    # Ground under a hollow mark, so that the line of the prediction does not run through it.
    dot: dict[str, Any] = {"markersize": size, "markerfacecolor": ink if filled else light("ground")}
    axes.plot(*(ends if upright else ends[::-1]), "-", linewidth=1.1, color=ink, zorder=2.5)
    axes.plot(*(mark if upright else mark[::-1]), marker, color=ink, markeredgewidth=1.0, zorder=2.6, **dot)


def gap(case: Json, row: Json | None) -> str:
    """Why nothing is drawn for a parameter of a case, in words; empty where it has a number."""
    if case["reason"] is not None:
        return NO_PLAN
    if row is None:
        return NOT_ESTIMATED
    if predicted(row) is not None:
        return ""
    return HELD if row["status"] == "held" else NOT_DETERMINED


def gap_colour(words: str) -> str:
    return light("unidentifiable" if words == NOT_DETERMINED else "held")


def hatch(words: str) -> str:
    """What has no plan, or is held, is hatched the other way, and wider, than what is not determined."""
    return "/////" if words == NOT_DETERMINED else "\\\\\\"


def scale_of(answer: Json, unit: str) -> tuple[float, float]:
    """Limits of a logarithmic scale that hold every number of this unit, and its tolerance."""
    values: list[float] = []
    for case in answer["cases"]:
        for row in case["parameters"]:
            if unit_of(row) == unit:
                values += [at] if (at := tolerance(answer, row)) is not None else []
                values += [std] if (std := predicted(row)) else []
                for fit in FITS:
                    if entry := observed(row, fit):
                        values += rmse_interval(entry)
    low, high = (min(values), max(values)) if values else (0.01, 1.0)
    room = max(1.25, math.sqrt(_LEAST_RANGE * low / high))
    return low / room, high * room


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers between `low` and `high`: 1, 2, 5 of each decade, or decades alone if they are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    factors = (1, 2, 5) if high / low < 60 else (1,)
    return [tick for k in decades for factor in factors if low <= (tick := factor * 10.0**k) <= high]


def in_font_within(text: str, width: int) -> str:
    """`text` as the figures can write it, in at most so many letters: escapes count in full."""
    return clipped(in_font(text), width)


def plain(value: float, _: object = None) -> str:
    """A tick's number as people write it."""
    return numbers.exact(value)


def legend(figure: Figure, answer: Json, predicted_mark: Artist, gaps: set[str], ncols: int) -> None:
    """What the marks that occur mean, above the figure."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Artist] = [predicted_mark]
    for fit, (marker, size, filled) in FITS.items():
        if has_observed(answer, fit):
            ink = light("ink" if filled else "muted")
            fill = ink if filled else light("ground")
            words = f"rmse of the {fit} fit, 95 %"
            handles.append(
                Line2D(
                    [],
                    [],
                    marker=marker,
                    markersize=size,
                    markerfacecolor=fill,
                    color=ink,
                    linewidth=1.1,
                    label=words,
                )
            )
    at = dict.fromkeys(
        numbers.exact(told, unit_of(row))
        for case in answer["cases"]
        for row in case["parameters"]
        if (told := tolerance(answer, row)) is not None
    )
    if at:
        handles.append(tolerance_line(f"tolerance {', '.join(at)}"))
    handles += [
        Patch(facecolor="none", edgecolor=light("muted"), hatch=hatch(words), linewidth=0.4, label=words)
        for words in sorted(gaps)
    ]
    figure.legend(
        handles=handles,
        loc="outside upper left",
        ncols=ncols,
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.6,
        handletextpad=0.5,
    )


def tolerance_line(label: str = "") -> Artist:
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle=(0, (4, 2)), linewidth=1.0, color=light("weak"), label=in_font(label))
