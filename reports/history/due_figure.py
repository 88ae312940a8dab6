"""Figure: how many arms of a plant are due, month by month."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from ...words.wording import counted
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import light
from .arm_state import ArmState

_MONTHS = 24
_NAMES = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def due_counts(rows: Sequence[ArmState], as_of: datetime) -> tuple[int, list[tuple[int, int, int]], int]:
    """How many arms are overdue; year, month and number of those due in each of the next 24 months; how many
    are later, or not within the horizon."""
    overdue = sum(own.state == "overdue" for own in rows)
    months = [(as_of.year * 12 + as_of.month - 1 + ahead) for ahead in range(_MONTHS)]
    found = dict.fromkeys(months, 0)
    later = 0
    for own in rows:
        if own.state == "overdue" or (own.due is None and own.state == "no due date"):
            continue
        month = None if own.due is None else own.due.year * 12 + own.due.month - 1
        if month in found:
            found[month] += 1
        elif month is not None or own.state == "on schedule":
            later += 1
    return overdue, [(month // 12, month % 12 + 1, number) for month, number in found.items()], later


def due_picture(rows: Sequence[ArmState], as_of: datetime) -> Picture | None:
    """A bar for each month; None where no arm has a due date."""
    overdue, months, later = due_counts(rows, as_of)
    numbers = [overdue, *(number for _, _, number in months), later]
    if not any(numbers):
        return None
    from matplotlib.ticker import MaxNLocator

    with style():
        figure = new_figure(2.1)
        axes = figure.subplots()
        places = [-1.8, *range(1, _MONTHS + 1), _MONTHS + 2.8]
        widths = [1.6, *[0.82] * _MONTHS, 1.6]
        colours = [light("misfit"), *[light("identified")] * _MONTHS, light("held")]
        axes.bar(places, numbers, widths, color=colours, linewidth=0)
        for place, number in zip(places, numbers, strict=True):
            if number:
                axes.annotate(
                    f"{number:,}",
                    (place, number),
                    (0, 2),
                    textcoords="offset points",
                    ha="center",
                    fontsize=8,
                )
        named = [k for k, (_, month, _) in enumerate(months) if month % 3 == 1]
        axes.set_xticks(
            [places[0], *(k + 1 for k in named), places[-1]],
            ["overdue", *(f"{_NAMES[months[k][1] - 1]}\n{months[k][0]}" for k in named), "later"],
        )
        axes.grid(visible=False, axis="x")
        axes.tick_params(axis="x", length=0)
        axes.yaxis.set_major_locator(MaxNLocator(5, integer=True))
        axes.set_ylabel("arms")
        axes.margins(y=0.15)
        svg = to_svg(figure, "due")
    each = "; ".join(f"{_NAMES[month - 1]} {year}: {number}" for year, month, number in months if number)
    return Picture(
        "due",
        f"Arms whose next calibration is due, by month from {as_of:%Y-%m-%d}",
        f"Arms by due date. Overdue: {overdue}. {f'{each}. ' if each else ''}Later: {counted(later, 'arm')}.",
        svg,
    )
