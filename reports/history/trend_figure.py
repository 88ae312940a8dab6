"""Figures: the offsets of an arm over time, with events, jumps and the due date."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ...analysis.drift.drift import Drift
from ...analysis.drift.forecast import Band, bands
from ...experiments.history.arm_drift import YEAR, ArmDrift
from ...experiments.history.stored_result import Event
from ...model.arrays import NORMAL_95, Matrix
from ...words import numbers
from ...words.wording import WEAK, clipped, counted, label, listed
from ..style.canvas import Picture, hatched, new_figure, style, to_svg
from ..style.palette import SHAPES, light
from ..style.typeface import in_font
from .history_tables import day, without_jump

AT_ONCE = 6  # panels of a figure
_PANEL, _STRIP = 1.18, 0.36  # inches
_HIGHEST = 5.2  # inches of all panels: the page says what to do above them
_WIDEST = 20  # an interval so many times as wide as the median one does not set the scale
_LABEL_ROWS = 3
_LETTER = 4.6  # points, of a label
_LEAST_SPAN = timedelta(days=60)


class _TrendPoint(NamedTuple):
    """Estimate and half width of the 95 % interval at a time (days), and the status of the offset there."""

    at: float
    value: float
    half: float
    status: str


def trend_pictures(arm: ArmDrift, events: Sequence[Event], never: Sequence[str]) -> Iterator[Picture]:
    """A panel for each offset, six in a figure: `never` are those that no result determines, which have a
    strip that says so. No figure without a drift."""
    if arm.drift is None:
        return
    names = sorted([*arm.drift.series.names, *never], key=lambda name: (len(name), name))
    parts = [names[at : at + AT_ONCE] for at in range(0, len(names), AT_ONCE)]
    for number, part in enumerate(parts, 1):
        name = "trend" if len(parts) == 1 else f"trend-{number}"
        with style():
            svg = to_svg(_drawn(arm, arm.drift, events, part), name)
        title = "Offsets over time" + (f", {number} of {len(parts)}" if len(parts) > 1 else "")
        yield Picture(name, title, _alt(arm, arm.drift, part), svg)


def _drawn(arm: ArmDrift, drift: Drift, events: Sequence[Event], names: Sequence[str]) -> Figure:
    known = [name in drift.series.names for name in names]
    panel = min(_PANEL, _HIGHEST / len(names))
    heights = [panel if flag else _STRIP for flag in known]
    figure = new_figure(sum(heights) + 1.0)
    panels = figure.subplots(
        len(names), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    begin, end = _range(arm)
    events = [event for event in events if begin <= event.at <= end]
    for axes, name, is_known in zip(panels, names, known, strict=True):
        if is_known:
            _panel(axes, arm, drift, name, (end - arm.used[-1].measured_at) / YEAR)
        else:
            axes.set_ylim(-0.5, 0.5)
            axes.set_yticks([])
            hatched(axes, 0, in_font(f"{label(name)}: no result determines it"), half=0.5)
        for event in events:
            line = "--" if event.what == "mastering" else ":"
            axes.axvline(_day(event.at), color=light("muted"), linewidth=1, linestyle=line)
        if arm.due is not None:
            axes.axvline(_day(arm.due), color=light("misfit"), linewidth=1.2, linestyle="--")
    panels[0].set_xlim(_day(begin), _day(end))
    locator = AutoDateLocator(minticks=3, maxticks=7)  # type: ignore[no-untyped-call]
    panels[-1].xaxis.set_major_locator(locator)
    dates = ConciseDateFormatter(locator, show_offset=False)  # type: ignore[no-untyped-call]
    panels[-1].xaxis.set_major_formatter(dates)
    panels[-1].set_xlabel("date")
    _name_lines(panels[0], arm, events, begin, end)
    _legend(figure, arm)
    return figure


def _range(arm: ArmDrift) -> tuple[datetime, datetime]:
    """What the axis of time shows: all results, a quarter of their span at least for the forecast, and the
    due date unless it is farther than they reach."""
    times = [result.measured_at for result in (*arm.used, *(left.result for left in arm.left_out))]
    first, last = min(times), max(times)
    span = max(last - first, _LEAST_SPAN)
    if arm.due is None:
        end = _moved(last, span / 2)
    else:
        end = min(max(_moved(arm.due, span / 8), _moved(last, span / 4)), _moved(last, span))
    edge = (end - first) / 30
    return _moved(first, -edge), _moved(end, edge)


def _moved(when: datetime, by: timedelta) -> datetime:
    """Within the calendar."""
    try:
        return when + by
    except OverflowError:
        return when


def _day(when: datetime) -> float:
    """As matplotlib counts days."""
    return (when - datetime(1970, 1, 1)) / timedelta(days=1)


def _panel(axes: Axes, arm: ArmDrift, drift: Drift, name: str, ahead_years: float) -> None:
    j = drift.series.names.index(name)
    origin = _day(arm.used[0].measured_at)
    days = np.array([_day(result.measured_at) for result in arm.used])
    drawn = list(bands(drift, name, max(ahead_years, 0.0)))
    points = _points_of(arm, drift, name)
    role = "assumed" if any(point.status == "assumed" for point in points) else "identified"
    for band in drawn:
        _shade(axes, band, origin, days, role)
    crowded = len(arm.used) > 60
    for status in sorted({point.status for point in points}):
        at, values, halves = np.array([point[:3] for point in points if point.status == status]).T
        colour = light(status)
        axes.vlines(at, values - halves, values + halves, color=colour, linewidth=0.7 if crowded else 1.2)
        axes.plot(at, values, SHAPES[status], color=colour, markersize=2 if crowded else 3.8)
    for jump in arm.jumps:
        if jump.offset == name:
            axes.axvspan(_day(jump.after), _day(jump.before), color=light("weak"), alpha=0.25, linewidth=0)
    begins = [0, *(t + 1 for t in drift.series.reset)]
    for begin, end in zip(begins, [*(begin - 1 for begin in begins[1:]), len(days) - 1], strict=True):
        if not drift.series.determined[begin, j]:
            right = days[end] if end < len(days) - 1 else days[end] + 1e5
            axes.axvspan(
                days[begin], right, facecolor="none", edgecolor=light("line"), hatch="/////", linewidth=0
            )
    for left in arm.left_out:
        axes.plot(
            _day(left.result.measured_at),
            0.0,
            SHAPES["unvalidated"],
            color=light("unvalidated"),
            markersize=4.5,
            fillstyle="none",
            clip_on=False,
            transform=axes.get_xaxis_transform(),
        )
    _scale(axes, points, drawn)
    axes.set_ylabel(
        in_font(f"{label(name)}, {'°' if drift.series.units[j] == 'deg' else drift.series.units[j]}"),
        color=light("muted"),
    )
    axes.locator_params(axis="y", nbins=5)
    axes.axhline(0, color=light("line"), linewidth=0.8, zorder=0.5)


def _points_of(arm: ArmDrift, drift: Drift, name: str) -> list[_TrendPoint]:
    """What each result alone says of an offset: of one that does not determine it nothing."""
    points = []
    for result, observation in zip(arm.used, drift.series.observations, strict=True):
        if name not in observation.names:
            continue
        at = observation.names.index(name)
        half = NORMAL_95 * float(np.sqrt(observation.covariance[at, at] + observation.shared[at, at]))
        status = next(row.status for row in result.offsets if row.name == name)
        points.append(_TrendPoint(_day(result.measured_at), float(observation.values[at]), half, status))
    return points


def _shade(axes: Axes, band: Band, origin: float, days: Matrix, role: str) -> None:
    at = origin + band.at * (YEAR / timedelta(days=1))
    low, high = band.low, band.high
    if len(at) == 1:  # one result alone: as wide as can be seen
        width = max(float(days[-1] - days[0]), 60.0) / 150
        at, low, high = np.array([at[0] - width, at[0] + width]), np.repeat(low, 2), np.repeat(high, 2)
    axes.fill_between(at, low, high, color=light(role), alpha=0.13 if band.forecast else 0.28, linewidth=0)


def _scale(axes: Axes, points: Sequence[_TrendPoint], drawn: Sequence[Band]) -> None:
    """By the bands and by what is narrow enough to be compared: an interval that is far wider than most
    results and than most of the bands runs out of the panel."""
    usual = float(np.median([point.half for point in points]))
    values, halves = np.array(
        [(point.value, point.half) for point in points if point.half <= _WIDEST * usual]
    ).T
    low, high = [values - halves], [values + halves]
    widths = [(band.high - band.low) / 2 for band in drawn]
    most = _WIDEST * max([usual, *(float(np.median(half)) for half in widths)])
    for band, half in zip(drawn, widths, strict=True):
        narrow = half <= most
        low.append(band.low[narrow])
        high.append(band.high[narrow])
    least, greatest = float(np.concatenate(low).min()), float(np.concatenate(high).max())
    edge = 0.06 * (greatest - least)
    axes.set_ylim(least - edge, greatest + edge)


def _name_lines(axes: Axes, arm: ArmDrift, events: Sequence[Event], begin: datetime, end: datetime) -> None:
    """Labels above the first panel, in rows where they would meet; the table of events has the others."""
    wide = 390 / ((end - begin) / YEAR)  # points a year
    named = [(event.at, _event_name(event), "muted") for event in events]
    if arm.due is not None and arm.due <= end:
        named.insert(0, (arm.due, f"due {arm.due:%Y-%m-%d}", "misfit"))
    taken: list[list[tuple[float, float]]] = [[] for _ in range(_LABEL_ROWS)]
    for when, text, role in named:
        middle = (when - begin) / YEAR * wide
        half = len(text) * _LETTER / 2
        middle = min(max(middle, half), 390 - half)
        for number, row in enumerate(taken):
            if all(middle + half < low or high < middle - half for low, high in row):
                row.append((middle - half, middle + half))
                axes.annotate(
                    text,
                    (middle / 390, 1),
                    (0, 3 + 11 * number),
                    xycoords="axes fraction",
                    textcoords="offset points",
                    ha="center",
                    va="bottom",
                    fontsize=8.5,
                    color=light(role),
                )
                break
    if arm.due is not None and arm.due > end:
        axes.annotate(
            in_font(f"due {arm.due:%Y-%m-%d} →"),
            (1, 1),
            (0, 3),
            xycoords="axes fraction",
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=8.5,
            color=light("misfit"),
        )


def _event_name(event: Event) -> str:
    return in_font(clipped(event.note, 18)) if event.what == "other" and event.note else event.what


def _legend(figure: Figure, arm: ArmDrift) -> None:
    blue = light("identified")
    keys = [
        Line2D([], [], color=blue, marker="o", markersize=3.8, linewidth=1.2, label="a result alone"),
        Patch(color=blue, alpha=0.28, linewidth=0, label="by all results"),
        Patch(color=blue, alpha=0.13, linewidth=0, label="forecast"),
    ]
    if any(row.status == "weak" for result in arm.used for row in result.offsets):
        keys.insert(
            1,
            Line2D(
                [],
                [],
                color=light("weak"),
                marker=SHAPES["weak"],
                markersize=3.8,
                linewidth=1.2,
                label=WEAK,
            ),
        )
    if arm.jumps:
        keys.append(Patch(color=light("weak"), alpha=0.25, linewidth=0, label="jump"))
    if arm.left_out:
        keys.append(
            Line2D(
                [],
                [],
                color=light("unvalidated"),
                marker=SHAPES["unvalidated"],
                fillstyle="none",
                markersize=4.5,
                linewidth=0,
                label="not counted",
            )
        )
    figure.legend(
        handles=keys, loc="outside lower center", ncols=3 if len(keys) > 5 else len(keys), handlelength=1.4
    )


def _alt(arm: ArmDrift, drift: Drift, names: Sequence[str]) -> str:
    parts = []
    for name in names:
        if name not in drift.series.names:
            parts.append(f"{label(name)} is determined by no result")
            continue
        j = drift.series.names.index(name)
        observed = np.flatnonzero(drift.series.observed[:, j])
        ends = []
        for t in (int(observed[0]), int(observed[-1])):
            value, std = drift.value(t, np.eye(len(drift.series.names))[j])
            unit = drift.series.units[j]
            number = f"{numbers.estimate(value, std, unit)} ± {numbers.spread(std, unit)}"
            ends.append(f"{number} ({day(arm.used[t].measured_at)})")
        parts.append(
            f"{label(name)} in {counted(len(observed), 'result')}: {' to '.join(dict.fromkeys(ends))}"
        )
    jumps = [f"{label(jump.offset)} before {day(jump.before)}" for jump in arm.jumps]
    undecided = [f"{label(change.offset)} before {day(change.before)}" for change in arm.undecided]
    either = f"Jump or drift: {listed(undecided)}." if undecided else without_jump(arm)
    changed = f"Jumps: {listed(jumps)}." if jumps else either
    return f"Offsets over time, ± standard uncertainty. {'; '.join(parts)}. {changed}"
