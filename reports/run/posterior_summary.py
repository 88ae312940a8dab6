"""The posterior: whether it converged, what it says, and its figure, pair by pair."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...analysis.answer.result import Result
from ...analysis.posterior.posterior import Draws
from ...analysis.solution import ParameterResult
from ...model.arrays import Matrix
from ...words import numbers
from ...words.findings import posterior_message
from ...words.wording import counted, ended, label, sentence
from ..style.blocks import Cell, Facts, FigureBlock, Paragraph, Section, Table, row_of, section_of, table_of
from ..style.canvas import WIDTH, Picture, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .parameters import unit_of

if TYPE_CHECKING:
    from matplotlib.artist import Artist
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
_GAP = 0.12  # between panels, by their size
_TICK = 2 / 72  # inches: length of a tick
_NAME_AT = 0.1  # inches: names of the parameters, from the figure's edge


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
        svg = to_svg(_corner(chosen, values), "posterior")
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


def _thinned(draws: Draws, columns: list[int]) -> Matrix:
    flat = draws.values.reshape(-1, draws.values.shape[-1])[:, columns]
    return flat[:: max(1, len(flat) // _MOST_DRAWS)]


def _smooth(heights: Matrix) -> Matrix:
    """Counts smoothed down the columns over some three bins, edges kept (binomial weights)."""
    padded = np.pad(heights, ((2, 2), (0, 0)))
    weights = np.array([1, 4, 6, 4, 1]) / 16
    smooth: Matrix = np.tensordot(
        weights, np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axes=(0, -1)
    )
    return smooth


def _corner(chosen: list[ParameterResult], values: Matrix) -> Figure:
    """All panels, drawn in inches: matplotlib's axes for each take several times as long."""
    count = len(chosen)
    width = (WIDTH - _LEFT - _RIGHT) / (count + _GAP * (count - 1))
    height = width * _FLAT * (1.0 if count > 2 else count / 3)
    whole = _BOTTOM + _TOP + height * (count + _GAP * (count - 1))
    figure = new_figure(whole, fitted=False)
    limits = [_limits(values[:, j]) for j in range(count)]
    for i, row in enumerate(chosen):
        for j, other in enumerate(chosen[: i + 1]):
            left = _LEFT + j * (1 + _GAP) * width
            bottom = _BOTTOM + (count - 1 - i) * (1 + _GAP) * height
            panel = _Panel(figure, left, bottom, width, height, limits[j], limits[i])
            if j == i:
                _marginal(panel, values[:, i], row)
            else:
                _pair(panel, values[:, j], values[:, i], other, row)
            panel.finish(
                None if i < count - 1 else _named(other),
                None if j or i == j else _named(row),
                marginal=i == j,
            )
    return figure


class _Panel(NamedTuple):
    """A rectangle of a figure, inches, and the limits of what is drawn in it."""

    figure: Figure
    left: float
    bottom: float
    width: float
    height: float
    across: tuple[float, float]
    up: tuple[float, float]

    def x(self, values: ArrayLike) -> Matrix:
        low, high = self.across
        return self.left + (np.asarray(values) - low) / (high - low) * self.width

    def y(self, values: ArrayLike) -> Matrix:
        low, high = self.up
        return self.bottom + (np.asarray(values) - low) / (high - low) * self.height

    def add(self, artist: Artist) -> None:
        """What has its places in inches."""
        artist.set_transform(self.figure.dpi_scale_trans)
        self.figure.add_artist(artist)

    def line(self, x: ArrayLike, y: ArrayLike, **look: Any) -> None:
        from matplotlib.lines import Line2D

        self.add(Line2D(np.asarray(x), np.asarray(y), **look))

    def text(self, x: float, y: float, words: str, **look: Any) -> None:
        self.figure.text(x, y, words, transform=self.figure.dpi_scale_trans, **look)

    def finish(self, across: str | None, up: str | None, *, marginal: bool) -> None:
        """Edges with ticks; their numbers and the names on the left and the bottom edge of the figure."""
        from matplotlib.collections import LineCollection

        x, y = self.left, self.bottom
        number: dict[str, Any] = {"fontsize": 7.5, "color": light("muted")}
        lines = [[(x, y), (x + self.width, y)]]
        for at, said in _ticks(*self.across):
            tick = float(self.x(at))
            lines.append([(tick, y), (tick, y - _TICK)])
            if across is not None:
                self.text(tick, y - 1.9 * _TICK, said, rotation=40, ha="center", va="top", **number)
        if not marginal:
            lines.append([(x, y), (x, y + self.height)])
            for at, said in _ticks(*self.up):
                tick = float(self.y(at))
                lines.append([(x, tick), (x - _TICK, tick)])
                if up is not None:
                    self.text(x - 1.9 * _TICK, tick, said, ha="right", va="center", **number)
        self.add(LineCollection(lines, colors=light("line"), linewidths=0.8))
        name: dict[str, Any] = {"fontsize": 9.5, "color": light("ink"), "ha": "center"}
        if across is not None:
            self.text(x + self.width / 2, _NAME_AT, across, va="bottom", **name)
        if up is not None:
            self.text(_NAME_AT, y + self.height / 2, up, va="center", rotation=90, **name)


def _limits(values: Matrix) -> tuple[float, float]:
    low, high = np.quantile(values, (0.001, 0.999))
    margin = 0.05 * (high - low) or 1.0
    return float(low - margin), float(high + margin)


def _ticks(low: float, high: float) -> list[tuple[float, str]]:
    """Two or so round values between the limits, as they are written."""
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    at = [tick for tick in MaxNLocator(2, min_n_ticks=2).tick_values(low, high) if low <= tick <= high]
    written: Any = ScalarFormatter(useOffset=False)
    written.set_scientific(False)
    written.create_dummy_axis()
    written.axis.set_view_interval(low, high)
    return list(zip(at, written.format_ticks(at), strict=True))


def _marginal(panel: _Panel, values: Matrix, row: ParameterResult) -> None:
    from matplotlib.patches import Polygon

    colour = light(row.status)
    heights, edges = np.histogram(values, bins=40, range=panel.across)
    smooth = _smooth(heights[:, None])[:, 0]
    x = panel.x((edges[:-1] + edges[1:]) / 2)
    y = panel.bottom + smooth / (smooth.max() * 1.08) * panel.height
    outline = np.column_stack([[x[0], *x, x[-1]], [panel.bottom, *y, panel.bottom]])
    panel.add(Polygon(outline, facecolor=colour, alpha=0.2, linewidth=0))
    panel.line(x, y, color=colour, linewidth=1.2)
    assert row.estimate is not None  # draws are of what the data determine
    if panel.across[0] <= row.estimate <= panel.across[1]:
        at = panel.x([row.estimate, row.estimate])
        panel.line(at, [panel.bottom, panel.bottom + panel.height], color=light("ink"), linewidth=0.8)


def _pair(panel: _Panel, x: Matrix, y: Matrix, across: ParameterResult, up: ParameterResult) -> None:
    from contourpy import FillType, contour_generator
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    heights, xs, ys = np.histogram2d(x, y, bins=32, range=(panel.across, panel.up))
    heights = _smooth(_smooth(heights).T).T
    ranked = np.sort(heights, axis=None)[::-1]
    mass = np.cumsum(ranked) / ranked.sum()
    levels = [float(ranked[np.searchsorted(mass, level)]) for level in _LEVELS]
    worst = next(
        (status for status in ("unvalidated", "weak") if status in (across.status, up.status)), "identified"
    )
    bounds = [*levels, float(heights.max()) * 1.01]
    if all(low < high for low, high in pairwise(bounds)):
        contours: Any = contour_generator(  # typed as the union of all that it can be asked for
            panel.x((xs[:-1] + xs[1:]) / 2),
            panel.y((ys[:-1] + ys[1:]) / 2),
            heights.T,
            fill_type=FillType.OuterCode,
        )
        for level, strength in zip(levels, (0.16, 0.32), strict=True):
            for points, codes in zip(*contours.filled(level, bounds[-1]), strict=True):
                region = Path(points, codes)
                panel.add(PathPatch(region, facecolor=light(worst), alpha=strength, linewidth=0))
            for line in contours.lines(level):
                panel.line(*line.T, color=light(worst), linewidth=0.8)
    assert across.estimate is not None
    assert up.estimate is not None
    if panel.across[0] <= across.estimate <= panel.across[1] and panel.up[0] <= up.estimate <= panel.up[1]:
        at = panel.x([across.estimate]), panel.y([up.estimate])
        panel.line(*at, marker="+", markersize=5, color=light("ink"))


def _named(row: ParameterResult) -> str:
    return in_font(f"{label(row.name, 12)}, {'°' if row.unit == 'deg' else row.unit}")
