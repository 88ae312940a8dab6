"""The posterior: whether it converged, what it says, and its figure, pair by pair."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...analysis.posterior.posterior import Draws
from ...analysis.result import Result
from ...analysis.solution import ParameterResult
from ..style.blocks import Cell, Facts, FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from ..words import numbers
from ..words.findings import posterior_message
from ..words.wording import counted, ended, label, sentence
from .parameters import unit_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def posterior_section(result: Result) -> Section:
    """The section of a report."""
    posterior = result.posterior
    facts = [
        ("Draws", str(posterior.draws)),
        ("Ensembles", f"{posterior.ensembles} of {counted(posterior.walkers, 'walker')}"),
        ("Smallest effective sample size", numbers.or_words(posterior.ess_min, "not available")),
        ("Largest rank-normalised R-hat", _ratio(posterior.rhat_max)),
        ("Acceptance", numbers.or_words(posterior.acceptance, "not available", "")),
        ("Time", f"{numbers.significant(posterior.seconds, 2)}\u00a0s"),
    ]
    return section_of(
        "Posterior",
        Paragraph(ended(posterior_sentence(result))),
        FigureBlock("posterior"),
        _table(result),
        Facts(facts),
    )


def posterior_sentence(result: Result) -> str:
    """How the sampling went."""
    said = sentence(posterior_message(result.posterior))
    if result.posterior.converged and result.misfit is not None:
        return f"Of a model that does not describe the measurements, and not validated: {said}"
    return said if result.posterior.converged else f"No posterior is shown: {said}"


def _table(result: Result) -> Table | None:
    if result.posterior.parameters is None:
        return None
    noise = any(row.group == "noise" for row in result.parameters)
    left = {row.name for row in result.parameters if row.group in ("target", "geometry")}
    columns = [
        ("name", "left"),
        ("mean", "right"),
        ("std", "right"),
        ("2.5 % to 97.5 %", "right"),
        ("ESS bulk, tail", "right"),
        ("R-hat", "right"),
    ]
    rows = []
    for row in result.posterior.parameters:
        if row.name in left:
            continue
        if row.source == "prior":
            rows.append(row_of(label(row.name), Cell("prior only", span=5), tone="unidentifiable"))
            continue
        std, unit = row.std, unit_of(row.unit)
        rows.append(
            row_of(
                label(row.name),
                numbers.estimate(row.mean, std, unit),
                numbers.spread(std, unit),
                numbers.interval((row.q2_5, row.q97_5), std, unit),
                f"{row.ess_bulk:.0f}, {row.ess_tail:.0f}",
                _ratio(row.rhat),
            )
        )
    caption = f"Posterior of offsets{', tool and noise' if noise else ' and tool'}"
    return table_of(caption, columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)


# ── the figure ────────────────────────────────────────────────────────────────────────────────

MOST_PARAMETERS = 6
_MOST_DRAWS = 40_000
_LEVELS = (0.95, 0.5)
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.68, 0.04, 0.62, 0.04  # inches about the panels
_FLAT = 0.86  # height of a panel by its width


def posterior_picture(result: Result, draws: Draws | None) -> Picture | None:
    """Marginals on the diagonal, 50 % and 95 % regions below it, for up to six offsets that the data
    determine.

    None where there is nothing that may be drawn: no draws, a posterior that has not converged, or
    no offset that the data determine. Directions drawn from the prior are never shown.
    """
    if draws is None or not draws.converged or not result.posterior.converged:
        return None
    determined = _determined_offsets(result, draws)
    if not determined:
        return None
    chosen = determined[:MOST_PARAMETERS]
    values = _thinned(draws, [draws.names.index(row.name) for row in chosen])
    with style():
        height = _BOTTOM + _TOP + (WIDTH - _LEFT - _RIGHT) * _FLAT * len(chosen) / max(len(chosen), 3)
        figure = new_figure(height, fitted=False)
        grid = figure.add_gridspec(
            len(chosen),
            len(chosen),
            left=_LEFT / WIDTH,
            right=1 - _RIGHT / WIDTH,
            bottom=_BOTTOM / height,
            top=1 - _TOP / height,
            wspace=0.12,
            hspace=0.14,
        )
        for i, row in enumerate(chosen):
            for j, other in enumerate(chosen[: i + 1]):
                axes = figure.add_subplot(grid[i, j])
                if j == i:
                    _marginal(axes, values[:, i], row)
                else:
                    _pair(axes, values[:, j], values[:, i], other, row)
                _finish(axes, i, j, chosen)
        figure.align_labels()
        svg = to_svg(figure, "posterior")
    names = ", ".join(label(row.name) for row in chosen)
    left_out = (
        f" {len(determined) - len(chosen)} more are in posterior.nc." if len(determined) > len(chosen) else ""
    )
    return Picture(
        "posterior",
        "Posterior of the offsets: each alone, and each pair with its 50 % and 95 % regions",
        f"Corner plot of {names}.{left_out} The table beside it has the same means, spreads and quantiles.",
        svg,
    )


def _determined_offsets(result: Result, draws: Draws) -> list[ParameterResult]:
    """Offsets that the data determine, the least certain first."""
    determined = [row for row in result.parameters if row.group == "offset" and row.name in draws.names]
    if len(determined) > MOST_PARAMETERS:
        widest = sorted(determined, key=lambda row: -(row.std or 0.0))[:MOST_PARAMETERS]
        determined = [row for row in determined if row in widest] + [
            row for row in determined if row not in widest
        ]
    return determined


def _thinned(draws: Draws, columns: list[int]) -> NDArray[np.float64]:
    flat = draws.values.reshape(-1, draws.values.shape[-1])[:, columns]
    return flat[:: max(1, len(flat) // _MOST_DRAWS)]


def _limits(values: NDArray[np.float64]) -> tuple[float, float]:
    low, high = np.quantile(values, (0.001, 0.999))
    margin = 0.05 * (high - low)
    return float(low - margin), float(high + margin)


def _smooth(heights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Counts smoothed down the columns over some three bins, edges kept (binomial weights)."""
    padded = np.pad(heights, ((2, 2), (0, 0)))
    weights = np.array([1, 4, 6, 4, 1]) / 16
    smooth: NDArray[np.float64] = np.tensordot(
        weights, np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axes=(0, -1)
    )
    return smooth


def _marginal(axes: Axes, values: NDArray[np.float64], row: ParameterResult) -> None:
    colour = light(row.status)
    heights, edges = np.histogram(values, bins=40, range=_limits(values))
    smooth = _smooth(heights[:, None])[:, 0]
    middles = (edges[:-1] + edges[1:]) / 2
    axes.fill_between(middles, smooth, color=colour, alpha=0.2, linewidth=0)
    axes.plot(middles, smooth, color=colour, linewidth=1.2)
    assert row.estimate is not None  # draws are of what the data determine
    axes.axvline(row.estimate, color=light("ink"), linewidth=0.8)
    axes.set_ylim(0, float(smooth.max()) * 1.08)
    axes.set_xlim(*_limits(values))
    axes.set_yticks([])
    axes.spines.left.set_visible(False)


def _pair(
    axes: Axes,
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    across: ParameterResult,
    up: ParameterResult,
) -> None:
    heights, xs, ys = np.histogram2d(x, y, bins=32, range=(_limits(x), _limits(y)))
    heights = _smooth(_smooth(heights).T).T
    ranked = np.sort(heights, axis=None)[::-1]
    mass = np.cumsum(ranked) / ranked.sum()
    levels = [float(ranked[np.searchsorted(mass, level)]) for level in _LEVELS]
    worst = next(
        (status for status in ("unvalidated", "weak") if status in (across.status, up.status)), "identified"
    )
    middles = (xs[:-1] + xs[1:]) / 2, (ys[:-1] + ys[1:]) / 2
    bounds = [*levels, float(heights.max()) * 1.01]
    if all(low < high for low, high in pairwise(bounds)):
        for level, strength in zip(levels, (0.16, 0.32), strict=True):
            axes.contourf(
                *middles, heights.T, levels=[level, bounds[-1]], colors=[light(worst)], alpha=strength
            )
        axes.contour(*middles, heights.T, levels=levels, colors=[light(worst)], linewidths=0.8)
    assert across.estimate is not None
    assert up.estimate is not None
    axes.plot([across.estimate], [up.estimate], "+", markersize=5, color=light("ink"))
    axes.set_xlim(*_limits(x))
    axes.set_ylim(*_limits(y))


def _finish(axes: Axes, i: int, j: int, chosen: list[ParameterResult]) -> None:
    """Labels on the left and the bottom edge only, two ticks an axis."""
    from matplotlib.ticker import MaxNLocator

    axes.grid(visible=False)
    axes.xaxis.set_major_locator(MaxNLocator(2, min_n_ticks=2))
    if i != j:
        axes.yaxis.set_major_locator(MaxNLocator(2, min_n_ticks=2))
    axes.tick_params(labelsize=7.5, length=2, pad=1.5)
    axes.tick_params(axis="x", labelrotation=40)
    if i == len(chosen) - 1:
        axes.set_xlabel(_named(chosen[j]), color=light("ink"))
    else:
        axes.tick_params(labelbottom=False)
    if j == 0 and i > 0:
        axes.set_ylabel(_named(chosen[i]), color=light("ink"))
    elif i != j:
        axes.tick_params(labelleft=False)


def _named(row: ParameterResult) -> str:
    return in_font(f"{label(row.name, 12)}, {'°' if row.unit == 'deg' else row.unit}")
