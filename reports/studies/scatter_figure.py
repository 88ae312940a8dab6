"""Figure: the scatter of the paper's runs against what one joint noise predicts, logarithmic."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ...experiments.studies.table2_answer import ScatterParameter, Table2Plan
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label
from ..style.canvas import Picture, bare_y, hatched, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .phrases import NOT_DETERMINED, NOT_GIVEN, spread, spread_range

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PAPER, _OURS = -0.2, 0.19  # the positions of the two in a row


def joint_noise(plan: Table2Plan) -> str:
    """The joint noise that explains the scatter, rounded by its own interval."""
    at, low, high = plan.joint_deg, plan.low, plan.high
    if at is None:
        return NOT_GIVEN
    if low is None or high is None or high <= low:
        return numbers.significant(at, 2, "deg")
    return numbers.estimate(at, (high - low) / (2 * NORMAL_95), "deg")


def scatter_picture(plans: Sequence[Table2Plan]) -> Picture | None:
    """Rows are the offsets of each plan: above the paper's std with its interval, below ours.

    None where there is nothing that could be drawn.
    """
    rows = [(plan, row) for plan in plans for row in (None, *plan.parameters)]
    if not any(row is not None and row.paper_std for _, row in rows):
        return None
    with style():
        figure = new_figure(0.3 * len(rows) + 0.85)
        axes = figure.subplots()
        axes.set_xscale("log")
        for y, (plan, row) in enumerate(rows):
            if row is None:
                _heading(axes, y, plan)
            else:
                _paper(axes, y + _PAPER, row)
                _ours(axes, y + _OURS, row)
        _finish(figure, axes, [(y, row) for y, (_, row) in enumerate(rows) if row is not None], len(rows))
        svg = to_svg(figure, "scatter")
    title = (
        "Standard deviation of each offset over three runs: the paper’s, and what the joint noise predicts"
    )
    return Picture("scatter", title, _alt(plans), svg)


def _heading(axes: Axes, y: int, plan: Table2Plan) -> None:
    words = f"plan {clipped(plan.name, 30)}, joint noise {joint_noise(plan)}"
    axes.text(
        0.0,
        y + 0.1,
        in_font(words),
        transform=axes.get_yaxis_transform(),
        va="center_baseline",
        fontsize=9,
        fontweight="bold",
        bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 1},
    )


def _paper(axes: Axes, y: float, row: ScatterParameter) -> None:
    if not row.paper_std:
        return
    ink = light("ink")
    if row.low and row.high:
        axes.plot([row.low, row.high], [y, y], "-", linewidth=1.5, color=ink)
    axes.plot([row.paper_std], [y], "o", markersize=4.2, color=ink)
    axes.annotate(
        spread(row.paper_std, row.unit),
        (row.high or row.paper_std, y),
        xytext=(5, 0),
        textcoords="offset points",
        va="center_baseline",
        fontsize=8,
    )


def _ours(axes: Axes, y: float, row: ScatterParameter) -> None:
    if not row.is_known:
        hatched(axes, y, NOT_DETERMINED, half=0.15, size=8)
        return
    blue, simulated = light("identified"), row.simulated
    if simulated is not None:
        width = simulated.q97_5 - simulated.q2_5
        axes.barh(y, width, 0.26, simulated.q2_5, color=blue, alpha=0.25, linewidth=0)
        axes.plot([simulated.median], [y], "|", markersize=6, markeredgewidth=1.2, color=blue)
    if row.predicted_std:
        axes.plot([row.predicted_std], [y], "D", markersize=4.2, color=blue)
    if row.simulated_std:
        axes.plot([row.simulated_std], [y], "s", markersize=4.6, color=blue, markerfacecolor=light("ground"))


def _finish(figure: Figure, axes: Axes, rows: list[tuple[int, ScatterParameter]], count: int) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    axes.set_ylim(count - 0.4, -0.55)
    axes.set_yticks([y for y, _ in rows], [in_font(label(row.name, 9)) for _, row in rows])
    axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=9)
    bare_y(axes)
    axes.minorticks_off()
    low, high = axes.get_xlim()
    axes.set_xlim(low, high * 2.2)  # room for the numbers
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    units = dict.fromkeys("°" if row.unit == "deg" else str(row.unit) for _, row in rows)
    axes.set_xlabel(f"standard deviation, {', '.join(units)}")
    blue = light("identified")
    dot: dict[str, Any] = {"markersize": 4.2, "linewidth": 0, "color": blue}
    figure.legend(
        handles=[
            Line2D(
                [], [], marker="o", markersize=4.2, linewidth=1.5, color=light("ink"), label="paper, 95 %"
            ),
            Line2D([], [], marker="D", label="predicted", **dot),
            Line2D([], [], marker="s", label="one simulated set", markerfacecolor=light("ground"), **dot),
            Patch(color=blue, alpha=0.25, linewidth=0, label="95 % of the sets, median"),
        ],
        loc="outside upper left",
        ncols=4,
        columnspacing=1.1,
        handlelength=1.3,
        handletextpad=0.5,
    )


def _alt(plans: Sequence[Table2Plan]) -> str:
    parts = []
    for plan in plans:
        offsets = []
        for row in plan.parameters:
            unit = row.unit
            said = f"{label(row.name)} paper {spread(row.paper_std, unit)}"
            said += f" ({spread_range(row.low, row.high, unit)})"
            ours = f"predicted {spread(row.predicted_std, unit)}" if row.is_known else NOT_DETERMINED
            offsets.append(f"{said}, {ours}")
        parts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(offsets)}")
    return f"Standard deviations of the offsets. {'. '.join(parts)}."
