"""Figures: the offsets of an arm over time, with events, jumps and the due date."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime, timedelta
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from ...analysis.drift.drift import Drift, bands
from ...analysis.status import Status
from ...experiments.history.arm_history import YEAR, ArmDrift
from ...experiments.history.stored_result import Event
from ...model.arrays import NORMAL_95, Matrix
from ...words import numbers
from ...words.wording import WEAK, clipped, counted, label, listed
from ..studies.study_figures import Curve, CurvePanel, Entries, Look, Scale, curves_picture
from ..style.canvas import Picture
from ..style.theme import SHAPES, in_font, light
from .history_tables import day, without_jump

AT_ONCE = 6  # panels of a figure
_PANEL, _HIGHEST = 1.18, 5.2  # inches of a panel, and of all: the page says what to do above them
_WIDEST = 20  # an interval so many times as wide as the median one does not set the scale
_LABEL_ROWS, _LABEL_POINTS = 3, 390.0  # above the first panel; the width of a panel
_LETTER = 4.6  # points, of a label
_LEAST_SPAN = timedelta(days=60)
_NOT_COUNTED = Look(role="unvalidated", shape=SHAPES["unvalidated"], filled=False, stroke="", size=4.5)


def trend_pictures(arm: ArmDrift, events: Sequence[Event], never: Sequence[str]) -> Iterator[Picture]:
    """A panel for each offset, six in a figure: `never` are those that no result determines, which have a
    gap that says so. No figure without a drift."""
    if arm.drift is None:
        return
    names = sorted([*arm.drift.series.names, *never], key=lambda name: (len(name), name))
    parts = [names[at : at + AT_ONCE] for at in range(0, len(names), AT_ONCE)]
    begin, end = _range(arm)
    events = [event for event in events if begin <= event.at <= end]
    for number, part in enumerate(parts, 1):
        yield curves_picture(
            "trend" if len(parts) == 1 else f"trend-{number}",
            "Offsets over time" + (f", {number} of {len(parts)}" if len(parts) > 1 else ""),
            _alt(arm, arm.drift, part),
            [offset_panel(arm, arm.drift, events, name, named=name == part[0]) for name in part],
            _dates(begin, end),
            panel_height=min(_PANEL, _HIGHEST / len(part)),
            across=f"{begin:%Y-%m-%d} to {end:%Y-%m-%d}",
            legend=_legend(arm),
            in_words=False,
        )


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


def _dates(begin: datetime, end: datetime) -> Scale:
    """The axis of time, with few ticks."""
    # Fewer than five at most, and there is a span that no interval of the locator divides into so few.
    locator: Any = AutoDateLocator(minticks=2, maxticks=5)  # type: ignore[no-untyped-call]
    words: Any = ConciseDateFormatter(locator, show_offset=False)  # type: ignore[no-untyped-call]
    ends = _day(begin), _day(end)
    ticks = [float(tick) for tick in locator.tick_values(begin, end) if ends[0] <= tick <= ends[1]]
    return Scale(ends=ends, ticks=ticks, names=words.format_ticks(ticks))


def offset_panel(
    arm: ArmDrift, drift: Drift, events: Sequence[Event], name: str, *, named: bool = False
) -> CurvePanel:
    """The panel of an offset; where it is the first one its lines are `named`."""
    more = partial(_draw_lines, arm=arm, events=events, name=name, named=named)
    begin, end = _range(arm)
    if name not in drift.series.names:
        gap = (_day(begin), _day(end), "no result determines it")
        return CurvePanel([], Scale(ends=(0, 1), ticks=()), up=label(name), gaps=[gap], more=more)
    j = drift.series.names.index(name)
    points, by_all = _points(arm, drift, name), _bands(arm, drift, name, end)
    unit = drift.series.units[j]
    return CurvePanel(
        [*by_all, *points],
        Scale(ends=_ends(points, by_all)),
        up=f"{label(name)}, {'°' if unit == 'deg' else unit}",
        line=0.0,
        gaps=list(_gaps(arm, drift, j)),
        more=more,
    )


def _points(arm: ArmDrift, drift: Drift, name: str) -> list[Curve]:
    """What each result alone says of an offset, by its status there: of one that does not determine it
    nothing."""
    size = 2.0 if len(arm.used) > 60 else 3.8
    by_status: dict[Status, list[tuple[float, float, float]]] = {}
    for result, observation in zip(arm.used, drift.series.observations, strict=True):
        if name in observation.names:
            at = observation.names.index(name)
            half = NORMAL_95 * float(np.sqrt(observation.covariance[at, at] + observation.shared[at, at]))
            status = next(row.status for row in result.offsets if row.name == name)
            point = _day(result.measured_at), float(observation.values[at]), half
            by_status.setdefault(status, []).append(point)
    curves = []
    for status, of in sorted(by_status.items()):
        days, values, halves = np.array(of).T
        look = Look(role=status, shape=SHAPES[status], stroke="", size=size)
        words = WEAK if status == "weak" else "a result alone" if status == "identified" else status
        ends = (values - halves).tolist(), (values + halves).tolist()
        curves.append(Curve(days.tolist(), values.tolist(), words, look, *ends))
    return curves


def _bands(arm: ArmDrift, drift: Drift, name: str, end: datetime) -> list[Curve]:
    """What all results say together, and the forecast."""
    origin, last = _day(arm.used[0].measured_at), _day(arm.used[-1].measured_at)
    assumed = any(row.name == name and row.status == "assumed" for one in arm.used for row in one.offsets)
    curves = []
    for band in bands(drift, name, max((end - arm.used[-1].measured_at) / YEAR, 0.0)):
        at, low, high = origin + band.at * (YEAR / timedelta(days=1)), band.low, band.high
        if len(at) == 1:  # one result alone: as wide as can be seen
            width = max(last - origin, 60.0) / 150
            at, low, high = np.array([at[0] - width, at[0] + width]), np.repeat(low, 2), np.repeat(high, 2)
        role = "muted" if band.forecast else "assumed" if assumed else "identified"
        look, ends = Look(role=role, shape="", stroke=""), (low.tolist(), high.tolist())
        curves.append(Curve(at.tolist(), ends[0], "", look, *ends, band=True))
    return curves


def _gaps(arm: ArmDrift, drift: Drift, j: int) -> Iterator[tuple[float, float, str]]:
    """Where nothing is known of an offset: from new zeros on that no result determines."""
    days = [_day(result.measured_at) for result in arm.used]
    begins = [0, *(t + 1 for t in drift.series.reset)]
    for begin, after in zip(begins, [*begins[1:], None], strict=True):
        if not drift.series.determined[begin, j]:
            end = _day(_range(arm)[1]) if after is None else days[after - 1]
            yield days[begin], max(end, days[begin] + 1), "not determined"


def _ends(points: Sequence[Curve], by_all: Sequence[Curve]) -> tuple[float, float]:
    """By the bands and by what is narrow enough to be compared: an interval that is far wider than most
    results and than most of the bands runs out of the panel."""
    usual = float(np.median(np.concatenate([_half(one) for one in points])))
    most = _WIDEST * max([usual, *(float(np.median(_half(one))) for one in by_all)])
    limits = [(one, _WIDEST * usual) for one in points] + [(one, most) for one in by_all]
    low = [np.asarray(one.low)[_half(one) <= widest] for one, widest in limits]
    high = [np.asarray(one.high)[_half(one) <= widest] for one, widest in limits]
    least, greatest = float(np.concatenate(low).min()), float(np.concatenate(high).max())
    edge = 0.06 * (greatest - least)
    return least - edge, greatest + edge


def _half(one: Curve) -> Matrix:
    return np.asarray(np.subtract(one.high or (), one.low or ()) / 2, float)


def _draw_lines(axes: Axes, *, arm: ArmDrift, events: Sequence[Event], name: str, named: bool) -> None:
    """Jumps, events, the due date, and the results that do not count."""
    for jump in arm.jumps:
        if jump.offset == name:
            axes.axvspan(_day(jump.after), _day(jump.before), color=light("weak"), alpha=0.25, linewidth=0)
    if left := [_day(one.result.measured_at) for one in arm.left_out]:
        below: Any = {"clip_on": False, "transform": axes.get_xaxis_transform(), **_NOT_COUNTED.line}
        axes.plot(left, [0.0] * len(left), **below)
    lines = [
        (event.at, _event_name(event), "muted", "--" if event.what == "mastering" else ":")
        for event in events
    ]
    if arm.due is not None:
        lines.insert(0, (arm.due, f"due {arm.due:%Y-%m-%d}", "misfit", "--"))
    taken: list[list[tuple[float, float]]] = [[] for _ in range(_LABEL_ROWS)]
    begin, end = axes.get_xlim()
    for when, words, role, stroke in lines:
        share = (_day(when) - begin) / (end - begin)
        if share <= 1:
            axes.axvline(_day(when), color=light(role), linewidth=1.1, linestyle=stroke)
        else:
            words = f"{words} →"
        half = len(words) * _LETTER / 2 / _LABEL_POINTS
        middle = min(max(share, half), 1 - half)
        # In the first row where it meets no other; the table of events has those for which there is none.
        free = (
            number
            for number, row in enumerate(taken)
            if all(middle + half < low or high < middle - half for low, high in row)
        )
        if named and (number := next(free, None)) is not None:
            taken[number].append((middle - half, middle + half))
            above: Any = {"xycoords": "axes fraction", "textcoords": "offset points", "fontsize": 8.5}
            at: Any = {"ha": "center", "va": "bottom", "color": light(role)}
            axes.annotate(words, (middle, 1), (0, 3 + 11 * number), **above, **at)


def _event_name(event: Event) -> str:
    return in_font(clipped(event.note, 18)) if event.what == "other" and event.note else event.what


def _legend(arm: ArmDrift) -> Entries:
    """The entries besides the results'."""
    wide: Any = {"shape": "", "width": 6.0, "alpha": 0.25}
    keys = [(Look(**wide), "by all results"), (Look(role="muted", **wide), "forecast")]
    if arm.jumps:
        keys.append((Look(role="weak", **wide), "jump"))
    if arm.left_out:
        keys.append((_NOT_COUNTED, "not counted"))
    return keys


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
