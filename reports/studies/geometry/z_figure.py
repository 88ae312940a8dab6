"""Figure: errors in standard uncertainties, for each plan and each way to treat the geometry."""

from __future__ import annotations

from collections.abc import Sequence

from ....experiments.studies.geometry.answer import GeometryEstimator, GeometryPlan
from ....words import numbers
from ....words.wording import clipped, label
from ...style.canvas import Picture, bare_y, hatched, new_figure, style, to_svg
from ...style.palette import light
from ...style.typeface import in_font
from ..phrases import NOT_DETERMINED
from ..shares import standing

_ROW, _TALLEST = 0.16, 7.4  # inches


def z_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """A row for each estimator of each plan, a dot for each offset; logarithmic, with a line at 1.

    None where there is nothing to draw.
    """
    rows = [(plan, own) for plan in plans for own in (None, *plan.estimators)]
    if not any(row.z for _, own in rows if own is not None for row in own.parameters):
        return None
    height = min(_TALLEST, 0.6 + _ROW * len(rows))
    size = min(8.0, 0.86 * 72 * (height - 0.6) / len(rows))
    with style():
        figure = new_figure(height)
        axes = figure.subplots()
        axes.set_xscale("log")
        for y, (plan, own) in enumerate(rows):
            if own is None:
                axes.text(
                    0.0,
                    y + 0.1,
                    in_font(f"Plan {clipped(plan.name, 36)}"),
                    transform=axes.get_yaxis_transform(),
                    va="center_baseline",
                    fontsize=size,
                    fontweight="bold",
                    bbox={"facecolor": light("ground"), "edgecolor": "none", "pad": 0.6},
                )
                continue
            zs = [row.z for row in own.parameters if row.z]
            if not zs:
                hatched(axes, y, NOT_DETERMINED, size=size - 0.5)
                continue
            colour = light(_role(own))
            fill = light("ground") if own.control else colour
            axes.plot([min(zs), max(zs)], [y, y], "-", linewidth=0.8, color=colour)
            axes.plot(zs, [y] * len(zs), "o", markersize=3.2, color=colour, markerfacecolor=fill)
        axes.axvline(1.0, color=light("ink"), linewidth=0.9, zorder=0.6)
        axes.set_ylim(len(rows) - 0.4, -0.7)
        named = [(y, own) for y, (_, own) in enumerate(rows) if own is not None]
        axes.set_yticks([y for y, _ in named], [own.name for _, own in named])
        axes.tick_params(axis="y", labelcolor=light("ink"), labelsize=size)
        bare_y(axes)
        axes.minorticks_off()
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        low, high = axes.get_xlim()
        ticks = [tick for tick in (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if low <= tick <= high]
        axes.set_xticks(ticks)
        axes.set_xlabel("root mean square of the errors, in standard uncertainties")
        svg = to_svg(figure, "z")
    title = "Errors of the offsets in their standard uncertainties, a dot for each offset; line: u is right"
    return Picture("z", title, _alt(plans), svg)


def _role(own: GeometryEstimator) -> str:
    return "identified" if own.agrees else "held" if own.control else "weak"


def _alt(plans: Sequence[GeometryPlan]) -> str:
    parts = []
    for plan in plans:
        said = []
        for own in plan.estimators:
            found = [
                f"{label(row.name)} {numbers.significant(row.z)}"
                if row.z
                else f"{label(row.name)} {NOT_DETERMINED}"
                for row in own.parameters
            ]
            said.append(f"{own.name} ({standing(own)[1]}): {', '.join(found)}")
        parts.append(f"plan {clipped(plan.name, 40)}: {'; '.join(said)}")
    return f"Root mean square of the errors in standard uncertainties. {'. '.join(parts)}."
