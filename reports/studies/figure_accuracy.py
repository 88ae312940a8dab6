"""Figure: what the midpoint fit (eq. 8) costs against the likelihood fit, the same data for both."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from ..words import numbers
from ..words.wording import clipped, in_font, label
from .study_coverage import ratio_std, rmse_ratios

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Json = dict[str, Any]

NAME = "accuracy"
_NORMAL_95 = 1.959964


def accuracy_picture(plans: list[Json]) -> Picture | None:
    """Left the ratio of the two rmse, right the bias of each fit in units of its own rmse.

    Only parameters that both fits tell; None where there are none.
    """
    found = [(plan, ratios) for plan in plans if (ratios := rmse_ratios(plan))]
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
                in_font(f"plan {clipped(plan['name'], 30)}"),
                transform=left.get_yaxis_transform(),
                va="center_baseline",
                fontsize=9,
                fontweight="bold",
            )
            for i, (midpoint, likelihood, ratio) in enumerate(ratios, start=y + 1):
                ticks.append((i, in_font(label(midpoint["name"], 9))))
                _ratio(left, i, ratio, ratio_std(ratio, plan))
                _bias(right, i - 0.16, likelihood, "identified", "o")
                _bias(right, i + 0.16, midpoint, "weak", "D")
            y += 1 + len(ratios)
        _finish(left, right, ticks, count)
        svg = to_svg(figure, NAME)
    told = [
        f"plan {clipped(plan['name'], 40)}: "
        + ", ".join(f"{label(row['name'])} {numbers.estimate(r, ratio_std(r, plan))}" for row, _, r in ratios)
        for plan, ratios in found
    ]
    alt = f"The rmse of the midpoint fit as a multiple of the likelihood fit’s: {'; '.join(told)}."
    return Picture(NAME, "The midpoint fit (eq. 8) against the likelihood fit, from the same data", alt, svg)


def _ratio(axes: Axes, y: float, ratio: float, std: float) -> None:
    half = _NORMAL_95 * std
    axes.plot([max(ratio - half, 0), ratio + half], [y, y], "-", linewidth=1.6, color=light("ink"))
    axes.plot([ratio], [y], "o", markersize=4.2, color=light("ink"))
    axes.annotate(
        numbers.estimate(ratio, std),
        (ratio + half, y),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=8,
    )


def _bias(axes: Axes, y: float, row: Json, role: str, shape: str) -> None:
    at, half = row["bias"] / row["rmse"], _NORMAL_95 * row["bias_mcse"] / row["rmse"]
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
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.1,
        columnspacing=1.2,
        handlelength=1.3,
    )
