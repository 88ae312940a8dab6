"""Figure of a study over settings: the RMSE of simulated runs over the predicted standard uncertainty."""

from __future__ import annotations

import numpy as np

from ....analysis.status import Status
from ....experiments.studies.sweeps.grid_answer import Fit, GridStudy
from ....model.arrays import Matrix
from ....words import numbers
from ...style.canvas import Picture, new_figure, set_log_scale, style, to_svg
from ...style.palette import SHAPES, light
from ...style.typeface import in_font
from .grid_words import rmse_interval, unit_signs
from .marks import FITS, UNCERTAINTY, dot_style, legend_above

# What is marked: fit, status, words, shape, colour's role, filled or not.
_KINDS: tuple[tuple[Fit, Status | None, str, str, str, bool], ...] = (
    ("likelihood", "identified", "likelihood, identified", SHAPES["identified"], "ink", True),
    ("likelihood", "weak", "likelihood, weak", SHAPES["weak"], "weak", True),
    ("midpoint", None, "midpoint", FITS["midpoint"][0], "muted", False),
)
_MOST = 1500  # points that a page can bear
_LEAST_RANGE = 2.0  # of the scale, either side of 1


def ratio_picture(study: GridStudy) -> Picture | None:
    """All parameters of all cases; 1 is as predicted. None where nothing was observed."""
    if not study.has("likelihood"):
        return None
    found = [_ratios(study, fit, status) for fit, status, *_ in _KINDS]
    every = np.concatenate([rows[:_MOST] for rows in found])
    with style():
        figure = new_figure(2.6)
        axes = figure.subplots()
        axes.axhline(1.0, color=light("identified"), linewidth=1.4, zorder=2.2, label="as predicted")
        for (_, _, words, marker, colour, filled), rows in zip(_KINDS, found, strict=True):
            if len(rows):
                std, ratio, least, most = rows[:_MOST].T
                axes.vlines(std, least, most, color=light(colour), linewidth=0.7, zorder=2.0)
                dot = dot_style(colour, 3, filled)
                axes.plot(std, ratio, marker, markeredgewidth=0.9, zorder=2.4, label=words, **dot)
        low, high = min(every[:, 2].min(), 1 / _LEAST_RANGE), max(every[:, 3].max(), _LEAST_RANGE)
        set_log_scale(axes, "y", low / 1.1, high * 1.1)
        set_log_scale(axes, "x", every[:, 0].min() / 1.3, every[:, 0].max() * 1.3)
        axes.set_xlabel(in_font(f"predicted {UNCERTAINTY} u, {unit_signs(study.parameters)}"))
        axes.set_ylabel("RMSE / predicted u")
        legend_above(figure, None, 4)
        svg = to_svg(figure, "ratio")
    title = f"RMSE of simulated runs over the predicted {UNCERTAINTY}, of all identified parameters"
    if any(len(rows) > _MOST for rows in found):
        title += f"; the first {_MOST} of each kind shown, all in offsets.csv"
    return Picture("ratio", title, _alt(found), svg)


def _ratios(study: GridStudy, fit: Fit, status: Status | None) -> Matrix:
    """Rows (n, 4) of parameters of a status (None: any): predicted u, RMSE over it, its 95 % interval."""
    rows = [
        (one.std, errors.rmse / one.std, low / one.std, high / one.std)
        for one in study.parameters
        if one.std and status in (None, one.status) and (errors := one.errors(fit))
        for low, high in [rmse_interval(errors)]
    ]
    return np.array(rows, dtype=float).reshape(-1, 4)


def _alt(found: list[Matrix]) -> str:
    said = []
    for (_, _, words, *_), rows in zip(_KINDS, found, strict=True):
        if len(rows):
            low, high, middle = (
                numbers.significant(float(pick(rows[:, 1]))) for pick in (np.min, np.max, np.median)
            )
            said.append(f"{words}: {len(rows)} from {low} to {high}, median {middle}")
    return f"RMSE of simulated runs divided by the predicted {UNCERTAINTY}. {'; '.join(said)}."
