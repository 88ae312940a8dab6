"""Figure: the largest standard uncertainty of each run, by outcome."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ...experiments.batch.rows import BatchRow
from ...words import numbers
from ...words.wording import counted
from ..style.canvas import Picture, new_figure, set_log_scale, style, to_svg
from ..style.palette import light

_BINS = 36
_LEAST_RANGE = 4.0  # of the axis, so that it has ticks
_COLOUR = {"pass": "identified", "weak": "weak", "misfit": "misfit"}


def uncertainty_picture(rows: Sequence[BatchRow]) -> Picture | None:
    """A histogram on a logarithmic scale; None where no run has a number in degrees."""
    found: dict[str, list[float]] = {name: [] for name in _COLOUR}
    for row in rows:
        worst = row.worst
        if worst is not None and worst.unit == "deg" and worst.u is not None and row.outcome in found:
            found[row.outcome].append(worst.u)
    every = np.array([u for own in found.values() for u in own])
    if not len(every):
        return None
    low, high = float(every.min()) / 1.05, float(every.max()) * 1.05
    room = max(1.1, math.sqrt(_LEAST_RANGE * low / high))
    edges = np.geomspace(low, high, _BINS + 1)
    from matplotlib.ticker import MaxNLocator

    with style():
        figure = new_figure(2.2)
        axes = figure.subplots()
        shown = [name for name, own in found.items() if own]
        axes.hist(
            [found[name] for name in shown],
            bins=edges.tolist(),
            stacked=True,
            color=[light(_COLOUR[name]) for name in shown],
            label=shown,
        )
        set_log_scale(axes, "x", low / room, high * room)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.set_xlabel("largest standard uncertainty u of an offset, °")
        axes.set_ylabel("runs")
        axes.legend()
        svg = to_svg(figure, "uncertainty")
    least, middle, most = (
        numbers.significant(float(np.quantile(every, share)), 2, "deg") for share in (0, 0.5, 1)
    )
    return Picture(
        "uncertainty",
        "Largest standard uncertainty of an offset in each run whose offsets are all determined",
        f"Histogram of {counted(len(every), 'run')}: from {least} to {most}, median {middle}. The table of"
        " all runs has each.",
        svg,
    )
