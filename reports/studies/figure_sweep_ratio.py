"""Figure of a sweep: the rmse of simulated runs as a multiple of the predicted std, for all cases at once."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..words import numbers
from ..words.wording import in_font
from .figure_sweep_marks import FITS, log_ticks, plain
from .sweep_cases import has_observed, observed, predicted, rmse_interval, unit_of

Json = dict[str, Any]

Rows = np.ndarray[Any, np.dtype[np.float64]]

# What is marked: words, shape, colour's role, filled or not.
_KINDS = (
    ("likelihood, identified", SHAPES["identified"], "ink", True),
    ("likelihood, weak", SHAPES["weak"], "weak", True),
    ("midpoint", FITS["midpoint"][0], "muted", False),
)
_MOST = 1500  # points that a page can bear
_LEAST_RANGE = 2.0  # of the scale, either side of 1


def ratio_picture(answer: Json) -> Picture | None:
    """One is as predicted. None where nothing was observed."""
    if not has_observed(answer, "likelihood"):
        return None
    found = [
        _ratios(answer, "likelihood", "identified"),
        _ratios(answer, "likelihood", "weak"),
        _ratios(answer, "midpoint", None),
    ]
    every = np.concatenate([rows[:_MOST] for rows in found])
    low = min(float(every[:, 2].min()), 1 / _LEAST_RANGE) / 1.1
    high = max(float(every[:, 3].max()), _LEAST_RANGE) * 1.1
    with style():
        figure = new_figure(2.6)
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.axhline(1.0, color=light("identified"), linewidth=1.4, zorder=2.2, label="as predicted")
        for (words, marker, colour, filled), rows in zip(_KINDS, found, strict=True):
            if not len(rows):
                continue
            std, ratio, least, most = rows[:_MOST].T
            axes.vlines(std, least, most, color=light(colour), linewidth=0.7, zorder=2.0)
            dot: dict[str, Any] = {"markerfacecolor": light(colour if filled else "ground")}
            axes.plot(
                std,
                ratio,
                marker,
                markersize=3,
                color=light(colour),
                markeredgewidth=0.9,
                zorder=2.4,
                label=words,
                **dot,
            )
        axes.set_ylim(low, high)
        axes.set_yticks(log_ticks(low, high))
        left, right = float(every[:, 0].min()) / 1.3, float(every[:, 0].max()) * 1.3
        axes.set_xlim(left, right)
        axes.set_xticks(log_ticks(left, right))
        axes.minorticks_off()
        axes.xaxis.set_major_formatter(plain)
        axes.yaxis.set_major_formatter(plain)
        units = dict.fromkeys(
            {"deg": "°"}.get(unit_of(row), unit_of(row))
            for case in answer["cases"]
            for row in case["parameters"]
        )
        axes.set_xlabel(in_font(f"predicted std, {', '.join(units)}"))
        axes.set_ylabel("rmse of runs / predicted std")
        figure.legend(loc="outside upper left", ncols=4, frameon=False, fontsize=8.5, borderaxespad=0.1)
        svg = to_svg(figure, "ratio")
    title = "Rmse of simulated runs as a multiple of the predicted std, for all that is determined"
    if any(len(rows) > _MOST for rows in found):
        title += f"; the first {_MOST} of each kind shown, all in offsets.csv"
    return Picture("ratio", title, _alt(found), svg)


def _ratios(answer: Json, fit: str, status: str | None) -> Rows:
    """Rows (n, 4) of parameters of a status (None: any): predicted std, rmse over it, its 95 % interval."""
    rows = []
    for case in answer["cases"]:
        for row in case["parameters"]:
            std, entry = predicted(row), observed(row, fit)
            if std and entry and status in (None, row["status"]):
                low, high = rmse_interval(entry)
                rows.append((std, entry["rmse"] / std, low / std, high / std))
    return np.array(rows, dtype=float).reshape(-1, 4)


def _alt(found: list[Rows]) -> str:
    said = [
        f"{words}: {len(rows)} from {numbers.significant(float(rows[:, 1].min()))} to"
        f" {numbers.significant(float(rows[:, 1].max()))}, median"
        f" {numbers.significant(float(np.median(rows[:, 1])))}"
        for (words, *_), rows in zip(_KINDS, found, strict=True)
        if len(rows)
    ]
    return f"Rmse of simulated runs divided by the predicted standard deviation. {'; '.join(said)}."
