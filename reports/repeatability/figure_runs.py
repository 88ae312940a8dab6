"""Figure: each offset of each run about the mean of all, with what the run predicts of its scatter."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...analysis.repeatability.compare import Comparison
from ...model.arrays import NORMAL_95
from ...words.numbers import significant, with_unit
from ...words.wording import clipped, label
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..style.typeface import in_font

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_NUMBERED = 15


def runs_picture(found: Comparison) -> Picture | None:
    """A panel for each offset that is compared, the runs in their order; None where there is none."""
    compared = [i for i, row in enumerate(found.offsets) if row.mean is not None]
    if not compared:
        return None
    with style():
        figure = new_figure(0.75 * len(compared) + 0.7)
        panels = figure.subplots(len(compared), 1, sharex=True, squeeze=False)[:, 0]
        for axes, i in zip(panels, compared, strict=True):
            _panel(axes, found, i)
        hours = found.by_time
        panels[-1].set_xlabel("hours from the first run" if hours else "run")
        if not hours and len(found.runs) <= _MOST_NUMBERED:
            panels[-1].set_xticks([run.at for run in found.runs])
        svg = to_svg(figure, "runs")
    title = "Each run’s offsets less the mean of all runs (band: 95 % interval of the mean)"
    if any(row.predicted_std for row in found.offsets):
        title += ", with the predicted 95 % intervals"
    if found.odd_run is not None:
        title += "; the diamond is the outlier"
    return Picture("runs", title, _alt(found, compared), svg)


def _panel(axes: Axes, found: Comparison, i: int) -> None:
    row, ink, blue = found.offsets[i], light("ink"), light("identified")
    assert row.mean is not None
    low, high = row.mean.interval95
    axes.axhspan(low - row.mean.value, high - row.mean.value, color=blue, alpha=0.12, linewidth=0)
    axes.axhline(0, color=light("muted"), linewidth=0.8)
    for run in found.runs:
        own = run.offsets[i]
        if own.estimate is None:
            continue
        outlier = run.name == found.odd_run
        colour = light("weak") if outlier else ink
        off = own.estimate - row.mean.value
        if own.std is not None:
            half = NORMAL_95 * own.std
            axes.plot([run.at] * 2, [off - half, off + half], "-", linewidth=1.3, color=colour)
        shape = SHAPES["weak" if outlier else "identified"]
        axes.plot([run.at], [off], shape, markersize=6 if outlier else 4.2, color=colour)
    axes.grid(visible=False, axis="x")
    axes.locator_params(axis="y", nbins=3)
    axes.margins(x=0.06, y=0.12)
    axes.set_ylabel(in_font(f"{label(row.name, 9)}, {'°' if row.unit == 'deg' else row.unit}"), color=ink)


def _alt(found: Comparison, compared: list[int]) -> str:
    parts = []
    for i in compared:
        row = found.offsets[i]
        assert row.mean is not None
        offs = []
        for run in found.runs:
            own = run.offsets[i].estimate
            if own is not None:
                off = with_unit(significant(own - row.mean.value, 2), row.unit)
                offs.append(f"{clipped(run.name, 30)} {off}")
        parts.append(f"{label(row.name)}: {', '.join(offs)}")
    outlier = "" if found.odd_run is None else f" The outlier is {clipped(found.odd_run, 40)}."
    return f"Offsets less their mean. {'. '.join(parts)}.{outlier}"
