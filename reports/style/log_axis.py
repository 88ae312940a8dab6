"""Logarithmic axes of figures: round ticks, written as people write numbers."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ...words import numbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def log_ticks(low: float, high: float) -> list[float]:
    """Round numbers between `low` and `high`: 1, 2, 5 of each decade, or decades alone if they are many."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    factors = (1, 2, 5) if high / low < 60 else (1,)
    return [tick for k in decades for factor in factors if low <= (tick := factor * 10.0**k) <= high]


def set_log_scale(axes: Axes, which: str, low: float, high: float) -> None:
    """A logarithmic scale of `which` (x or y) from `low` to `high` with plain numbers at round ticks."""
    axes.set(**{f"{which}scale": "log", f"{which}lim": (low, high), f"{which}ticks": log_ticks(low, high)})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.minorticks_off()
    axis.set_major_formatter(plain)


def plain(value: float, _: object = None) -> str:
    """A tick's number as people write it."""
    return numbers.exact(value)
