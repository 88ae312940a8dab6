"""Figure: each offset of each run about the mean of all, with what the run predicts of its scatter."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..words.numbers import significant, with_unit
from ..words.wording import clipped, in_font, label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Json = dict[str, Any]

_NORMAL_95 = 1.959964
_MOST_NUMBERED = 15


def compare_picture(answer: Json) -> Picture | None:
    """A panel for each offset that is compared, the runs in their order; None where there is none."""
    told = [i for i, row in enumerate(answer["offsets"]) if row["mean"] is not None]
    if not told:
        return None
    with style():
        figure = new_figure(0.75 * len(told) + 0.7)
        panels = figure.subplots(len(told), 1, sharex=True, squeeze=False)[:, 0]
        for axes, i in zip(panels, told, strict=True):
            _panel(axes, answer, i)
        hours = answer["settings"]["at_unit"] == "h"
        panels[-1].set_xlabel("hours from the first run" if hours else "run")
        if not hours and len(answer["runs"]) <= _MOST_NUMBERED:
            panels[-1].set_xticks([run["at"] for run in answer["runs"]])
        svg = to_svg(figure, "runs")
    title = "Each run’s offsets less the mean of all runs (band: 95 % interval of the mean)"
    if any(row["predicted_std"] for row in answer["offsets"]):
        title += ", with the 95 % intervals that the runs predict"
    if answer["odd_run"] is not None:
        title += "; the diamond is the odd one"
    return Picture("runs", title, _alt(answer, told), svg)


def _panel(axes: Axes, answer: Json, i: int) -> None:
    row, ink, blue = answer["offsets"][i], light("ink"), light("identified")
    low, high = row["mean_interval95"]
    axes.axhspan(low - row["mean"], high - row["mean"], color=blue, alpha=0.12, linewidth=0)
    axes.axhline(0, color=light("muted"), linewidth=0.8)
    for run in answer["runs"]:
        own = run["offsets"][i]
        if own["estimate"] is None:
            continue
        odd = run["name"] == answer["odd_run"]
        colour = light("weak") if odd else ink
        off = own["estimate"] - row["mean"]
        if own["std"] is not None:
            half = _NORMAL_95 * own["std"]
            axes.plot([run["at"]] * 2, [off - half, off + half], "-", linewidth=1.3, color=colour)
        shape = SHAPES["weak" if odd else "identified"]
        axes.plot([run["at"]], [off], shape, markersize=6 if odd else 4.2, color=colour)
    axes.grid(visible=False, axis="x")
    axes.locator_params(axis="y", nbins=3)
    axes.margins(x=0.06, y=0.12)
    axes.set_ylabel(
        in_font(f"{label(row['name'], 9)}, {'°' if row['unit'] == 'deg' else row['unit']}"), color=ink
    )


def _alt(answer: Json, told: list[int]) -> str:
    parts = []
    for i in told:
        row = answer["offsets"][i]
        offs = []
        for run in answer["runs"]:
            own = run["offsets"][i]
            if own["estimate"] is not None:
                off = with_unit(significant(own["estimate"] - row["mean"], 2), row["unit"])
                offs.append(f"{clipped(run['name'], 30)} {off}")
        parts.append(f"{label(row['name'])}: {', '.join(offs)}")
    odd = "" if answer["odd_run"] is None else f" The odd one is {clipped(answer['odd_run'], 40)}."
    return f"Offsets less their mean. {'. '.join(parts)}.{odd}"
