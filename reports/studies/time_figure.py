"""Figure: the time of a run in the simulated cell, by phase."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...experiments.procedure.session import PHASES
from ...experiments.studies.cell_answer import CellPlan
from ...words import numbers
from ...words.wording import clipped
from ..style.canvas import Picture, bare_y, new_figure, style, to_svg
from ..style.palette import light
from ..style.typeface import in_font
from .phrases import seconds

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Phases are no statuses: one hue, from dark to faint, and in the order of the legend.
_SHADES = dict(zip(PHASES, (1.0, 0.66, 0.4, 0.2), strict=True))
_BAR = 0.4  # of a row's height


def time_picture(plans: Sequence[CellPlan], limit: float) -> Picture | None:
    """A bar for each plan: the mean time by phase, a whisker to the longest run, and the limit.

    None where no plan has a time.
    """
    plans = [plan for plan in plans if plan.seconds["total"].mean is not None]
    if not plans:
        return None
    with style():
        figure = new_figure(0.85 + 0.46 * len(plans))
        axes = figure.subplots()
        for y, plan in enumerate(plans):
            _bar(axes, y, plan)
        _finish(axes, len(plans), limit, max(plan.seconds["total"].max or 0.0 for plan in plans))
        svg = to_svg(figure, "time")
    title = (
        f"Simulated time of a run by phase, mean; whisker: the longest run; line: the limit of {limit:g} s"
    )
    return Picture("time", title, _alt(plans, limit), svg)


def _bar(axes: Axes, y: int, plan: CellPlan) -> None:
    spent, begin = plan.seconds, 0.0
    for phase in PHASES:
        mean = spent[phase].mean or 0.0
        # On the ground's colour, so that the grid does not show through.
        for colour, alpha in ((light("ground"), 1.0), (light("identified"), _SHADES[phase])):
            axes.barh(y, mean, _BAR, begin, color=colour, alpha=alpha, linewidth=0)
        begin += mean
    longest = spent["total"].max or 0.0
    axes.plot([begin, longest], [y, y], "-", linewidth=1.2, color=light("ink"))
    axes.plot([longest], [y], "|", markersize=7, markeredgewidth=1.2, color=light("ink"))
    axes.annotate(
        in_font(f"{clipped(plan.name, 36)}: {_in_words(plan)}"),
        (0, y - _BAR / 2),
        xytext=(0, 2.5),
        textcoords="offset points",
        fontsize=8.5,
        bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.8},
    )


def _in_words(plan: CellPlan) -> str:
    total = plan.seconds["total"]
    return f"{seconds(total.mean)}, longest {seconds(total.max)}"


def _finish(axes: Axes, count: int, limit: float, longest: float) -> None:
    from matplotlib.patches import Patch

    axes.set_ylim(count - 0.65, -0.72)
    axes.set_yticks([])
    axes.set_xlim(0, 1.03 * max(limit, longest))
    bare_y(axes)
    axes.axvline(limit, color=light("weak"), linewidth=1.2, zorder=0.6)
    axes.set_xlabel("time of a run, s")
    axes.legend(
        handles=[
            Patch(color=light("identified"), alpha=shade, linewidth=0, label=phase)
            for phase, shade in _SHADES.items()
        ],
        loc="lower left",
        bbox_to_anchor=(-0.01, 1.0),
        ncols=len(PHASES),
        columnspacing=1.4,
        handlelength=1.1,
        handleheight=0.9,
    )
    axes.annotate(
        f"{numbers.exact(limit, 's')}",
        (limit, 1),
        xycoords=("data", "axes fraction"),
        xytext=(0, 3),
        textcoords="offset points",
        ha="center",
        fontsize=8.5,
        color=light("weak"),
    )


def _alt(plans: Sequence[CellPlan], limit: float) -> str:
    parts = []
    for plan in plans:
        phases = ", ".join(f"{phase} {seconds(plan.seconds[phase].mean)}" for phase in PHASES)
        parts.append(f"{clipped(plan.name, 40)}: {_in_words(plan)} ({phases})")
    return f"Mean time of a run, against the limit of {numbers.exact(limit, 's')}. {'; '.join(parts)}."
