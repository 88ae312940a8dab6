"""The posterior: whether it converged, what it says, and its figure, pair by pair."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...analysis.answer.result import Result
from ...analysis.covariance import parameter_among
from ...analysis.posterior.posterior import Draws
from ...analysis.solution import ParameterResult
from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...words import numbers
from ...words.finding_words import posterior_message
from ...words.numbers import unit_of
from ...words.wording import counted, ended, label, sentence, status_words
from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Paragraph,
    Section,
    Table,
    on_screen,
    row_of,
    section_of,
    table_of,
)
from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.theme import in_font, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        on_screen(_table(result)),
        Facts(facts),
    )


def posterior_sentence(result: Result) -> str:
    """How the sampling went."""
    message = sentence(posterior_message(result.posterior))
    return message if result.posterior.converged else f"No posterior is shown: {message}"


def _table(result: Result) -> Table | None:
    if result.posterior.parameters is None:
        return None
    noise = any(row.group == "noise" for row in result.parameters)
    left = {row.name for row in result.parameters if row.tolerated or row.group == "target"}
    columns = ["name", "mean", "u", "2.5 % to 97.5 %", "ESS bulk, tail", "R-hat"]
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
    of = "offsets, tool and noise" if noise else "offsets and tool"
    caption = f"Posterior of {of}; u: standard deviation of the draws"
    return table_of(caption, columns, rows) if rows else None


def _ratio(rhat: float | None) -> str:
    return "not available" if rhat is None else numbers.fixed(rhat, 3)


# ── the figure ────────────────────────────────────────────────────────────────────────────────

MOST_PARAMETERS = 6
_MOST_DRAWS = 40_000
_LEVELS = (0.95, 0.5)
_LEFT, _RIGHT, _BOTTOM, _TOP = 0.68, 0.04, 0.62, 0.04  # inches about the panels
_FLAT = 0.86  # height of a panel by its width
_GAP = 0.12  # between panels, by their size
_NAME_AT = 0.15  # inches: names of the parameters, from the figure's edge


def posterior_picture(
    result: Result, draws: Draws | None, names: Sequence[str] | None = None
) -> Picture | None:
    """Marginals on the diagonal, 50 % and 95 % regions below it, for up to six offsets that the data
    determine, or for the parameters of these `names`.

    None where there is nothing that may be drawn: no draws, a posterior that has not converged, or
    no offset that the data determine. Directions drawn from the prior are never shown.
    """
    chosen, values = _chosen(result, draws, names)
    if not chosen:
        return None
    with style():
        svg = to_svg(_corner(chosen, values), "posterior")
    of = ", ".join(label(row.name) for row in chosen)
    assert draws is not None
    omitted = 0 if names is not None else len(_determined(result, draws)) - len(chosen)
    more = f" {omitted} more are in posterior.nc." if omitted else ""
    return Picture(
        "posterior",
        f"Posterior of {'the offsets' if names is None else of}: each alone, and each pair with its 50 % and"
        " 95 % regions",
        f"Corner plot of {of}.{more} The table beside it has the same means, spreads and quantiles.",
        svg,
    )


def draw_posterior(
    axes: NDArray[np.object_], result: Result, draws: Draws | None, names: Sequence[str] | None = None
) -> None:
    """The same in a reader's own axes (m, m), one for each pair of the m parameters.

    Those above the diagonal are made invisible. BadInput for axes of another shape.
    """
    chosen, values = _chosen(result, draws, names)
    if np.shape(axes) != (len(chosen), len(chosen)):
        raise BadInput(
            "these axes do not suit the posterior of the offsets",
            found=f"an array of shape {np.shape(axes)}",
            allowed=f"({len(chosen)}, {len(chosen)}): {', '.join(label(row.name) for row in chosen)}",
            argument="ax",
        )
    with style():
        for i, row in enumerate(chosen):
            for j, other in enumerate(chosen):
                if j > i:
                    axes[i, j].set_visible(False)
                    continue
                _panel(axes[i, j], values[:, j], other, values[:, i], row)
                axes[i, j].tick_params(labelbottom=i == len(chosen) - 1, labelleft=j == 0)
                if i == len(chosen) - 1:
                    axes[i, j].set_xlabel(_named(other), color=light("ink"))
                if j == 0 and i:
                    axes[i, j].set_ylabel(_named(row), color=light("ink"))


def _determined(result: Result, draws: Draws) -> list[ParameterResult]:
    """The offsets of which there are draws."""
    return [row for row in result.parameters if row.group == "offset" and row.name in draws.names]


def _chosen(
    result: Result, draws: Draws | None, names: Sequence[str] | None
) -> tuple[list[ParameterResult], Matrix]:
    """The offsets of the figure, at most six, or the parameters of the names, and their draws (n, m)."""
    if draws is None or not draws.converged or not result.posterior.converged:
        return [], np.zeros((0, 0))
    if names is not None:
        every = result.parameters
        chosen = [every.named(parameter_among(every.names, name, "names")) for name in names]
        for row in chosen:
            if row.name not in draws.names:
                raise BadInput(
                    "a parameter that the data do not determine has no draws",
                    found=f"{label(row.name)}: {status_words(row.status)}",
                    allowed=", ".join(draws.names),
                    argument="names",
                )
    else:
        determined = _determined(result, draws)
        widest = sorted(determined, key=lambda row: -(row.std or 0.0))[:MOST_PARAMETERS]
        chosen = [row for row in determined if row in widest]
    columns = [draws.names.index(row.name) for row in chosen]
    flat = draws.values.reshape(-1, draws.values.shape[-1])[:, columns]
    return chosen, flat[:: max(1, len(flat) // _MOST_DRAWS)]


def _smooth(heights: Matrix) -> Matrix:
    """Counts smoothed down the columns over some three bins, edges kept (binomial weights)."""
    padded = np.pad(heights, ((2, 2), (0, 0)))
    weights = np.array([1, 4, 6, 4, 1]) / 16
    smooth: Matrix = np.tensordot(
        weights, np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axes=(0, -1)
    )
    return smooth


def _corner(chosen: list[ParameterResult], values: Matrix) -> Figure:
    """A panel for each pair, in fixed places: a fitted layout takes several times as long."""
    count = len(chosen)
    panels = count + _GAP * (count - 1)  # widths of a panel in a row of them
    width = (WIDTH - _LEFT - _RIGHT) / panels
    height = width * _FLAT * (1.0 if count > 2 else count / 3)
    whole = _BOTTOM + _TOP + height * panels
    figure = new_figure(whole, fitted=False)
    grid = figure.add_gridspec(
        count,
        count,
        left=_LEFT / WIDTH,
        right=1 - _RIGHT / WIDTH,
        bottom=_BOTTOM / whole,
        top=1 - _TOP / whole,
        wspace=_GAP,
        hspace=_GAP,
    )
    for i, row in enumerate(chosen):
        for j, other in enumerate(chosen[: i + 1]):
            axes = figure.add_subplot(grid[i, j])
            _panel(axes, values[:, j], other, values[:, i], row)
            axes.tick_params(length=2, labelsize=7.5, labelbottom=i == count - 1, labelleft=j == 0)
            if i == count - 1:
                axes.tick_params(axis="x", labelrotation=40)
                axes.set_xlabel(_named(other), color=light("ink"))
                at = (j + 0.5 + j * _GAP) * width + _LEFT
                axes.xaxis.set_label_coords(at / WIDTH, 1.6 * _NAME_AT / whole, figure.transFigure)
            if j == 0 and i:
                axes.set_ylabel(_named(row), color=light("ink"))
                at = (count - i - 0.5 + (count - 1 - i) * _GAP) * height + _BOTTOM
                axes.yaxis.set_label_coords(_NAME_AT / WIDTH, at / whole, figure.transFigure)
    return figure


def _panel(axes: Axes, x: Matrix, across: ParameterResult, y: Matrix, up: ParameterResult) -> None:
    """One panel: the marginal of a parameter, or a pair of two."""
    axes.grid(visible=False)
    limits, ticks = _scale(x)
    axes.set(xticks=ticks, xlim=limits)
    if across is up:
        _marginal(axes, x, up)
        return
    limits, ticks = _scale(y)
    axes.set(yticks=ticks, ylim=limits)
    _pair(axes, x, y, across, up)


def _scale(values: Matrix) -> tuple[tuple[float, float], list[float]]:
    """Limits that leave out one value in a thousand at each end, and two or so round ticks."""
    from matplotlib.ticker import MaxNLocator

    low, high = np.quantile(values, (0.001, 0.999))
    margin = 0.05 * (high - low) or 1.0
    low, high = float(low - margin), float(high + margin)
    ticks = MaxNLocator(2, min_n_ticks=2).tick_values(low, high)
    return (low, high), [float(tick) for tick in ticks if low <= tick <= high]


def _marginal(axes: Axes, values: Matrix, row: ParameterResult) -> None:
    colour = light(row.status)
    heights, edges = np.histogram(values, bins=40, range=axes.get_xlim())
    smooth = _smooth(heights[:, None])[:, 0]
    middles = (edges[:-1] + edges[1:]) / 2
    axes.fill_between(middles, smooth, color=colour, alpha=0.2, linewidth=0)
    axes.plot(middles, smooth, color=colour, linewidth=1.2)
    assert row.estimate is not None  # draws are of what the data determine
    axes.axvline(row.estimate, color=light("ink"), linewidth=0.8)
    axes.set_ylim(0, 1.08 * smooth.max())
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)


def _pair(axes: Axes, x: Matrix, y: Matrix, across: ParameterResult, up: ParameterResult) -> None:
    heights, xs, ys = np.histogram2d(x, y, bins=32, range=(axes.get_xlim(), axes.get_ylim()))
    heights = _smooth(_smooth(heights).T).T
    ranked = np.sort(heights, axis=None)[::-1]
    mass = np.cumsum(ranked) / ranked.sum()
    levels = [float(ranked[np.searchsorted(mass, level)]) for level in _LEVELS]
    statuses = (across.status, up.status)
    worst = next(
        (status for status in ("unvalidated", "assumed", "weak") if status in statuses), "identified"
    )
    top = float(heights.max()) * 1.01
    if levels[0] < levels[1] < top:
        middles = (xs[:-1] + xs[1:]) / 2, (ys[:-1] + ys[1:]) / 2
        regions = [(light(worst), strength) for strength in (0.16, 0.43)]
        axes.contourf(*middles, heights.T, levels=[*levels, top], colors=regions)
        axes.contour(*middles, heights.T, levels=levels, colors=[light(worst)], linewidths=0.8)
    assert across.estimate is not None
    assert up.estimate is not None
    axes.plot([across.estimate], [up.estimate], "+", markersize=5, color=light("ink"))


def _named(row: ParameterResult) -> str:
    return in_font(f"{label(row.name, 12)}, {numbers.symbol(row.unit)}")
