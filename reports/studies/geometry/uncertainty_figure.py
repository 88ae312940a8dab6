"""Figure: u of the offsets by the number of measurements, with nominal and with free geometry."""

from __future__ import annotations

from collections.abc import Sequence

from ....experiments.studies.geometry.answer import GeometryPlan
from ....words import numbers
from ...style.canvas import Picture, new_figure, style, to_svg
from ...style.palette import light

_KINDS = (
    ("noise_only", "noise only", "held"),
    ("considered", "nominal, arm has tolerances", "weak"),
    ("freed", "geometry estimated", "identified"),
)


def uncertainty_picture(plans: Sequence[GeometryPlan]) -> Picture | None:
    """Bands from the smallest u of an offset to the largest over the numbers of measurements.

    Of the plans for nominal geometry that have the tolerances of the first; a dashed line is the largest of
    those chosen for free geometry.

    None where fewer than two numbers of measurements can be compared.
    """
    chosen = [plan for plan in plans if plan.chosen_for == "nominal"]
    chosen = [plan for plan in chosen if plan.tolerance == chosen[0].tolerance and _all_known(plan)]
    if len(chosen) < 2:
        return None
    better = [plan for plan in plans if plan.chosen_for == "freed" and plan.tolerance == chosen[0].tolerance]
    better = [plan for plan in better if _all_known(plan)]
    with style():
        figure = new_figure(2.9)
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_yscale("log")
        shots = [plan.shots for plan in chosen]
        for kind, words, role in _KINDS:
            ends = [_ends(plan, kind) for plan in chosen]
            low, high = [end[0] for end in ends], [end[1] for end in ends]
            axes.fill_between(shots, low, high, color=light(role), alpha=0.22, linewidth=0)
            axes.plot(shots, high, "o-", markersize=3.5, linewidth=1.3, color=light(role), label=words)
        if len(better) > 1:
            largest = [_ends(plan, "freed")[1] for plan in better]
            axes.plot(
                [plan.shots for plan in better],
                largest,
                "o--",
                markersize=3.5,
                linewidth=1.2,
                color=light("identified"),
                markerfacecolor=light("ground"),
                label="the same, plan chosen for it",
            )
        axes.set_xticks(shots, [str(count) for count in shots])
        axes.minorticks_off()
        bottom, top = axes.get_ylim()
        steps = [factor * 10.0**power for power in range(-5, 3) for factor in (1, 2, 5)]
        axes.set_yticks([step for step in steps if bottom <= step <= top])
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xlabel("measurements")
        axes.set_ylabel("u of the offsets, °")
        figure.legend(loc="outside upper left", ncols=2)
        svg = to_svg(figure, "uncertainty")
    title = (
        "Predicted u of the offsets by the number of measurements: from the smallest (band) to the largest"
    )
    return Picture("uncertainty", title, _alt(chosen), svg)


def _all_known(plan: GeometryPlan) -> bool:
    return bool(plan.checked) and all(
        getattr(row, kind) is not None and row.unit == "deg" for row in plan.checked for kind, _, _ in _KINDS
    )


def _ends(plan: GeometryPlan, kind: str) -> tuple[float, float]:
    values = [getattr(row, kind) for row in plan.checked]
    return min(values), max(values)


def _alt(plans: Sequence[GeometryPlan]) -> str:
    parts = []
    for plan in plans:
        said = []
        for kind, words, _ in _KINDS:
            low, high = _ends(plan, kind)
            said.append(f"{words} {numbers.spread(low)} to {numbers.spread(high, 'deg')}")
        parts.append(f"{plan.shots} measurements: {', '.join(said)}")
    return f"Smallest to largest u of the offsets. {'; '.join(parts)}."
