"""Figures of coverage: shares of intervals, ranks of the truth, midpoint fit against likelihood fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from scipy import stats

from ...experiments.studies.answer import ObservedParameter, Share
from ...experiments.studies.coverage import (
    CoveragePlan,
    CoverageSettings,
    CoveredParameter,
    RankCalibration,
    RankedParameter,
)
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label
from ..style.canvas import WIDTH, Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .study_blocks import NOT_DETERMINED, Judged, percent, share, standing, worst_at

Rows = list[tuple[Judged, ObservedParameter | None]]  # a row without a parameter heads a part

AGREES, OUTSIDE = "o", "D"  # a dot on the line, a diamond off it; a triangle points beyond the panel
_ROW, _TALLEST = 0.15, 6.8  # inches; the tallest leaves room for what is above it on a page
_LEFT, _RIGHT, _TOP, _BOTTOM = 0.6, 0.06, 0.3, 0.48  # inches about the panels
_HALF_WIDTH = 6.0  # of a panel, in binomial standard deviations

_ACROSS = 5  # histograms of ranks
_PANEL, _HEAD, _GAP, _BELOW = 0.62, 0.28, 0.24, 0.42  # inches: a histogram, and what surrounds it
_BEFORE = 0.36
_BAND = 0.99


def name_rows(axes: Axes, names: Sequence[tuple[int, str]], size: float) -> None:
    """Write names at the rows of a figure, in letters of `size` points."""
    axes.set_yticks([y for y, _ in names], [in_font(name) for _, name in names])
    axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=size)


def head_rows(
    axes: Axes, y: float, text: str, size: float, *, x: float = 0.0, pad: float | None = None, **options: Any
) -> None:
    """Write the heading of some rows, `x` as a share of the width; with a `pad` on the ground's colour."""
    if pad is not None:
        options["bbox"] = {"facecolor": light("ground"), "edgecolor": "none", "pad": pad}
    axes.text(
        x,
        y,
        in_font(text),
        transform=axes.get_yaxis_transform(),
        va="center_baseline",
        fontsize=size,
        fontweight="bold",
        **options,
    )


# ── shares of intervals, one panel for each level ─────────────────────────────────────────────


def coverage_picture(
    parts: Sequence[Judged], levels: Sequence[float], runs: int, name: str, title: str
) -> Picture:
    """Rows are the parameters of each part, dots their shares of `runs` with binomial intervals.

    Each panel is as wide as six binomial standard deviations either side of its level, so that what
    agrees can be seen to; what lies outside is at the edge as a triangle with its share.
    """
    rows = [(part, row) for part in parts for row in (None, *part.parameters)]
    height = min(_TALLEST, _TOP + _BOTTOM + _ROW * len(rows))
    # Points: letters shrink with the rows where there are many.
    size = min(8.0, 0.86 * 72 * (height - _TOP - _BOTTOM) / len(rows))
    with style():
        figure = new_figure(height, fitted=False)
        panels = figure.subplots(1, len(levels), squeeze=False, sharey=True)[0]
        figure.subplots_adjust(
            left=_LEFT / WIDTH,
            right=1 - _RIGHT / WIDTH,
            top=1 - _TOP / height,
            bottom=_BOTTOM / height,
            wspace=0.13,
        )
        for axes, level in zip(panels, levels, strict=True):
            _panel(axes, rows, level, size, runs)
        _name_rows(panels[0], rows, size)
        figure.supxlabel(
            "share of intervals that hold the truth, %", fontsize=9.5, color=light("muted"), y=0.04 / height
        )
        svg = to_svg(figure, name)
    title += ". Line: as stated; triangle: a share outside the panel, with its number"
    return Picture(name, title, _alt(parts, levels), svg)


def _name_rows(axes: Axes, rows: Rows, size: float) -> None:
    axes.set_ylim(len(rows) - 0.4, -0.6)
    name_rows(axes, [(y, label(row.name, 10)) for y, (_, row) in enumerate(rows) if row is not None], size)
    for y, (estimator, row) in enumerate(rows):
        if row is None:
            axes.text(
                -_LEFT / _panel_width(axes) + 0.04,
                y + 0.08,
                in_font(f"{clipped(estimator.name, 32)} ({standing(estimator)[1]})"),
                transform=axes.get_yaxis_transform(),
                va="center",
                fontsize=size + 0.5,
                fontweight="bold",
            )


def _panel_width(axes: Axes) -> float:
    return float(axes.get_position().width) * WIDTH


def _panel(axes: Axes, rows: Rows, level: float, size: float, data_sets: int) -> None:
    half = _HALF_WIDTH * math.sqrt(level * (1 - level) / data_sets)
    low, high = 100 * max(level - half, 0.0), 100 * min(level + half, 1.0)
    margin = 0.04 * (high - low)
    axes.set_xlim(low - margin, high + margin)
    bare_y(axes)
    axes.grid(visible=False)
    axes.set_title(percent(level), fontsize=9.5, pad=5)
    for y, (estimator, row) in enumerate(rows):
        if row is None:
            _lines(axes, level, _ticks(level, half), y + 0.55, y + 0.4 + len(estimator.parameters))
        elif not row.shares:
            hatched(axes, y, NOT_DETERMINED, size=size - 0.5)
        else:
            for entry in row.shares:
                if entry.level == level:
                    _share(axes, y, entry, estimator.control, (low, high), size)
    axes.set_xticks(_ticks(level, half))
    axes.tick_params(axis="x", labelsize=7.5, length=2)
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")


def _lines(axes: Axes, level: float, ticks: list[float], top: float, bottom: float) -> None:
    """The grid and the line of the level, behind one part only, not behind its heading."""
    axes.vlines(ticks, top, bottom, color=light("line"), linewidth=0.5, zorder=0.5)
    axes.vlines([100 * level], top, bottom, color=light("ink"), linewidth=0.9, zorder=0.6)


def _ticks(level: float, half: float) -> list[float]:
    """The level, and one round number either side of it where there is one below 100 %."""
    step = 10.0 ** math.floor(math.log10(90 * half))
    step *= max(factor for factor in (1, 2, 5) if factor * step <= 90 * half)
    return [tick for tick in (100 * level - step, 100 * level, 100 * level + step) if 0 <= tick <= 100]


def _share(axes: Axes, y: int, entry: Share, control: bool, bounds: tuple[float, float], size: float) -> None:
    """One dot with its interval: filled for an estimator, hollow for a control."""
    colour = light("identified" if entry.agrees else "held" if control else "weak")
    fill = light("ground") if control else colour
    at, (low, high) = 100 * entry.share, bounds
    if low <= at <= high:
        ends = [max(low, 100 * entry.low), min(high, 100 * entry.high)]
        axes.plot(ends, [y, y], "-", linewidth=1.3, color=colour, solid_capstyle="butt")
        shape = AGREES if entry.agrees else OUTSIDE
        axes.plot([at], [y], shape, markersize=3.8, color=colour, markerfacecolor=fill)
        return
    below = at < low
    axes.plot(
        [low if below else high],
        [y],
        "<" if below else ">",
        markersize=4.6,
        color=colour,
        markerfacecolor=fill,
        clip_on=False,
    )
    axes.annotate(
        share(entry),
        (low if below else high, y),
        xytext=(5 if below else -5, 0),
        textcoords="offset points",
        ha="left" if below else "right",
        va="center_baseline",
        fontsize=size - 0.5,
        color=colour,
    )


def _alt(parts: Sequence[Judged], levels: Sequence[float]) -> str:
    texts = []
    for estimator in parts:
        worst = [
            f"{percent(level)}: {label(pair[0].name)} {share(pair[1])}{numbers.NO_BREAK}%"
            for level in levels
            if (pair := worst_at(estimator, level)) is not None
        ]
        text = ", ".join(worst) if worst else NOT_DETERMINED
        texts.append(f"{clipped(estimator.name, 40)} ({standing(estimator)[1]}): {text}")
    return (
        "Share of intervals that hold the truth, of each estimator the parameter farthest from each level. "
        f"{'; '.join(texts)}. The table below it has every share."
    )


# ── rank histograms of simulation-based calibration (Talts et al. 2018), a panel a parameter ──


def ranks_picture(plan: CoveragePlan, settings: CoverageSettings, name: str) -> Picture | None:
    """Histograms of the ranks of the truth among the draws, with the band that holds 99 % of uniform bins.

    A bin outside it is solid, so that it is visible in grey too. Everything of one estimator has one
    scale. None where the plan has no ranks.
    """
    parts = [(part, [row for row in part.parameters if sum(row.ranks)]) for part in plan.sbc]
    parts = [(part, rows) for part, rows in parts if rows]
    if not parts:
        return None
    lines = [-(-len(rows) // _ACROSS) for _, rows in parts]
    height = _BELOW + sum(_HEAD + count * (_PANEL + _GAP) for count in lines)
    with style():
        figure = new_figure(height, fitted=False)
        width = (WIDTH - _BEFORE - _RIGHT) / _ACROSS
        top = height
        outside: list[str] = []
        for (part, rows), count in zip(parts, lines, strict=True):
            figure.text(
                0.04 / WIDTH,
                (top - 0.17) / height,
                in_font(f"{clipped(part.name, 40)} ({standing(part)[1]})"),
                fontsize=9,
                fontweight="bold",
            )
            highest = max(*(max(row.ranks) for row in rows), _band(rows[0].ranks)[1]) * 1.1
            beyond = 0
            for i, row in enumerate(rows):
                down, across = divmod(i, _ACROSS)
                bottom = top - _HEAD - _GAP * (down + 1) + 0.06 - _PANEL * (down + 1)
                axes = figure.add_axes(
                    (
                        (_BEFORE + across * width) / WIDTH,
                        bottom / height,
                        (width - 0.1) / WIDTH,
                        _PANEL / height,
                    )
                )
                beyond += _histogram(axes, row, highest, first=across == 0)
            outside.append(_ranks_in_words(part, rows, beyond))
            top -= _HEAD + count * (_PANEL + _GAP)
        figure.supxlabel(
            f"rank of the truth among {settings.draws} draws, from lowest to highest",
            fontsize=9.5,
            color=light("muted"),
            y=0.08 / height,
        )
        svg = to_svg(figure, name)
    title = (
        f"Plan {clipped(plan.name, 40)}: how many truths have each rank. Uniform ranks have 99 % of the"
        " bins within the grey band (solid: outside it)"
    )
    alt = f"Histograms of ranks in {settings.bins} bins. {' '.join(outside)}"
    return Picture(name, title, alt, svg)


def _band(ranks: Sequence[int]) -> tuple[float, float]:
    """Between which counts a bin of uniform ranks lies with probability 99 % (binomial)."""
    low, high = stats.binom.interval(_BAND, sum(ranks), 1 / len(ranks))
    return float(low), float(high)


def _histogram(axes: Axes, row: RankedParameter, highest: float, *, first: bool) -> int:
    """Draws one panel; how many bins lie outside the band."""
    ranks = np.asarray(row.ranks)
    low, high = _band(row.ranks)
    x = np.arange(len(ranks))
    out = (ranks < low) | (ranks > high)
    axes.axhspan(low, high, facecolor=light("line"), edgecolor="none", alpha=0.65)
    axes.bar(x[~out], ranks[~out], width=0.86, color=light("identified"), alpha=0.4, linewidth=0)
    axes.bar(x[out], ranks[out], width=0.86, color=light("weak"), linewidth=0)
    axes.axhline(ranks.mean(), color=light("ink"), linewidth=0.8)
    axes.set_xlim(-0.7, len(ranks) - 0.3)
    axes.set_ylim(0, highest)
    axes.set_xticks([])
    axes.grid(visible=False)
    axes.set_yticks([float(ranks.mean())])
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0f}")
    axes.tick_params(axis="y", labelsize=7.5, length=2, pad=1.5, labelleft=first)
    p_value = "" if row.p_value is None else f"  p {numbers.p_value(row.p_value)}"
    axes.set_title(in_font(label(row.name, 9)) + p_value, fontsize=7.5, pad=3, loc="left")
    return int(out.sum())


def _ranks_in_words(part: RankCalibration, rows: Sequence[RankedParameter], beyond: int) -> str:
    bins = sum(len(row.ranks) for row in rows)
    text = f"{clipped(part.name, 40)} ({standing(part)[1]}): {beyond} of {bins} bins lie outside the band"
    tests = [f"{label(row.name)} {numbers.p_value(row.p_value)}" for row in rows if row.p_value is not None]
    return f"{text}; p-values {', '.join(tests)}." if tests else f"{text}."


# ── midpoint against likelihood ───────────────────────────────────────────────────────────────


@dataclass(frozen=True)
class RmseRatio:
    """The rmse of the midpoint fit over that of the likelihood fit for one parameter, from the same data."""

    midpoint: CoveredParameter
    likelihood: CoveredParameter
    ratio: float
    std: float


def rmse_ratios(plan: CoveragePlan) -> list[RmseRatio]:
    """Of each parameter that both fits determine; empty if the plan lacks one of the two estimators.

    Each rmse of n data sets has the relative error 1/√(2n); the two share their data and are correlated, so
    that the standard error of the ratio is at most √2 times that.
    """
    rows = {one.name: {row.name: row for row in one.parameters} for one in plan.estimators}
    likelihood, ratios = rows.get("likelihood", {}), []
    for name, midpoint in rows.get("midpoint", {}).items():
        other = likelihood.get(name)
        if other is not None and midpoint.rmse and other.rmse:
            ratio = midpoint.rmse / other.rmse
            ratios.append(RmseRatio(midpoint, other, ratio, ratio / math.sqrt(max(1, plan.data_sets))))
    return ratios


def rmse_ratio_picture(plans: Sequence[tuple[str, Sequence[RmseRatio]]]) -> Picture | None:
    """Left the ratio of the two rmse, right the bias of each fit in units of its own rmse.

    `plans` are names and ratios; None where there are no ratios.
    """
    plans = [(name, ratios) for name, ratios in plans if ratios]
    if not plans:
        return None
    count = sum(1 + len(ratios) for _, ratios in plans)
    with style():
        figure = new_figure(0.19 * count + 0.75)
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1.15, 1])
        names: list[tuple[int, str]] = []
        y = 0
        for plan, ratios in plans:
            head_rows(left, y, f"plan {clipped(plan, 30)}", 9, x=0.01)
            for i, ratio in enumerate(ratios, start=y + 1):
                names.append((i, label(ratio.midpoint.name, 9)))
                _ratio(left, i, ratio)
                _bias(right, i - 0.16, ratio.likelihood, "identified", "o")
                _bias(right, i + 0.16, ratio.midpoint, "weak", "D")
            y += 1 + len(ratios)
        _finish_ratios(left, right, names, count)
        svg = to_svg(figure, "accuracy")
    texts = [
        f"plan {clipped(plan, 40)}: "
        + ", ".join(f"{label(one.midpoint.name)} {numbers.estimate(one.ratio, one.std)}" for one in ratios)
        for plan, ratios in plans
    ]
    alt = f"The rmse of the midpoint fit as a multiple of the likelihood fit’s: {'; '.join(texts)}."
    return Picture(
        "accuracy", "The midpoint fit (eq. 8) against the likelihood fit, from the same data", alt, svg
    )


def _ratio(axes: Axes, y: float, one: RmseRatio) -> None:
    ratio, half = one.ratio, NORMAL_95 * one.std
    axes.plot([max(ratio - half, 0), ratio + half], [y, y], "-", linewidth=1.6, color=light("ink"))
    axes.plot([ratio], [y], "o", markersize=4.2, color=light("ink"))
    axes.annotate(
        numbers.estimate(ratio, one.std),
        (ratio + half, y),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=8,
    )


def _bias(axes: Axes, y: float, row: CoveredParameter, role: str, shape: str) -> None:
    if row.bias is None or row.bias_mcse is None or not row.rmse:
        return
    at, half = row.bias / row.rmse, NORMAL_95 * row.bias_mcse / row.rmse
    axes.plot([at - half, at + half], [y, y], "-", linewidth=1.2, color=light(role))
    axes.plot([at], [y], shape, markersize=3.6, color=light(role))


def _finish_ratios(left: Axes, right: Axes, names: list[tuple[int, str]], count: int) -> None:
    left.set_ylim(count - 0.3, -0.7)
    name_rows(left, names, 9)
    right.tick_params(axis="y", labelleft=False)
    low, high = left.get_xlim()
    left.set_xlim(min(low, 0.95), max(high + 0.2 * (high - low), 1.05))
    left.axvline(1, color=light("muted"), linewidth=0.8)
    right.axvline(0, color=light("muted"), linewidth=0.8)
    widest = max(abs(bound) for bound in right.get_xlim())
    right.set_xlim(-widest, widest)
    for axes in (left, right):
        bare_y(axes)
    left.set_xlabel("rmse, midpoint ÷ likelihood")
    right.set_xlabel("bias ÷ rmse, with 95 % interval")
    keys = [
        Line2D([], [], marker=shape, markersize=3.6, linewidth=1.2, color=light(role), label=words)
        for role, shape, words in (("identified", "o", "likelihood"), ("weak", "D", "midpoint"))
    ]
    right.legend(
        handles=keys,
        loc="lower left",
        bbox_to_anchor=(-0.02, 1.0),
        ncols=2,
        handlelength=1.3,
    )
