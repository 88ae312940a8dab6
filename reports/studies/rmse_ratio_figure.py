"""Figure: what the midpoint fit (eq. 8) costs against the likelihood fit, the same data for both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ...experiments.studies.coverage import CoveragePlan, CoveredParameter
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label
from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font

if TYPE_CHECKING:
    from matplotlib.axes import Axes


NAME = "accuracy"


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
    rows = {own.name: {row.name: row for row in own.parameters} for own in plan.estimators}
    likelihood, found = rows.get("likelihood", {}), []
    for name, own in rows.get("midpoint", {}).items():
        other = likelihood.get(name)
        if other is not None and own.rmse and other.rmse:
            ratio = own.rmse / other.rmse
            found.append(RmseRatio(own, other, ratio, ratio / math.sqrt(max(1, plan.data_sets))))
    return found


def rmse_ratio_picture(plans: Sequence[tuple[str, Sequence[RmseRatio]]]) -> Picture | None:
    """Left the ratio of the two rmse, right the bias of each fit in units of its own rmse.

    `plans` are names and ratios; None where there are no ratios.
    """
    found = [(name, ratios) for name, ratios in plans if ratios]
    if not found:
        return None
    count = sum(1 + len(ratios) for _, ratios in found)
    with style():
        figure = new_figure(0.19 * count + 0.75)
        left, right = figure.subplots(1, 2, sharey=True, width_ratios=[1.15, 1])
        ticks: list[tuple[int, str]] = []
        y = 0
        for plan, ratios in found:
            left.text(
                0.01,
                y,
                in_font(f"plan {clipped(plan, 30)}"),
                transform=left.get_yaxis_transform(),
                va="center_baseline",
                fontsize=9,
                fontweight="bold",
            )
            for i, own in enumerate(ratios, start=y + 1):
                ticks.append((i, in_font(label(own.midpoint.name, 9))))
                _ratio(left, i, own)
                _bias(right, i - 0.16, own.likelihood, "identified", "o")
                _bias(right, i + 0.16, own.midpoint, "weak", "D")
            y += 1 + len(ratios)
        _finish(left, right, ticks, count)
        svg = to_svg(figure, NAME)
    said = [
        f"plan {clipped(plan, 40)}: "
        + ", ".join(f"{label(own.midpoint.name)} {numbers.estimate(own.ratio, own.std)}" for own in ratios)
        for plan, ratios in found
    ]
    alt = f"The rmse of the midpoint fit as a multiple of the likelihood fit’s: {'; '.join(said)}."
    return Picture(NAME, "The midpoint fit (eq. 8) against the likelihood fit, from the same data", alt, svg)


def _ratio(axes: Axes, y: float, own: RmseRatio) -> None:
    ratio, half = own.ratio, NORMAL_95 * own.std
    axes.plot([max(ratio - half, 0), ratio + half], [y, y], "-", linewidth=1.6, color=light("ink"))
    axes.plot([ratio], [y], "o", markersize=4.2, color=light("ink"))
    axes.annotate(
        numbers.estimate(ratio, own.std),
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


def _finish(left: Axes, right: Axes, ticks: list[tuple[int, str]], count: int) -> None:
    from matplotlib.lines import Line2D

    left.set_ylim(count - 0.3, -0.7)
    left.set_yticks([y for y, _ in ticks], [name for _, name in ticks])
    left.tick_params(axis="y", labelcolor=light("ink"), labelsize=9)
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
