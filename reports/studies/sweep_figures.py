"""Figures of a study over settings, by its axes: rows of marks, lines, a map, or a panel for each axis."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

from scipy.special import chdtri

from ...analysis.status import Status, Verdict
from ...experiments.studies.sweeps.grid_answer import (
    CaseParameter,
    Fit,
    GridAxis,
    GridCase,
    GridStudy,
    RunErrors,
)
from ...experiments.studies.sweeps.study_file import overlap
from ...words import numbers
from ...words.wording import WEAK, clipped, label
from ..style.canvas import WIDTH, Picture, new_figure, plain, style, to_svg
from ..style.theme import SHAPES, in_font, light
from .study_blocks import NOT_DETERMINED
from .study_figures import (
    Curve,
    CurvePanel,
    Entries,
    Look,
    Scale,
    Stretch,
    curves_picture,
    hatch,
    legend_above,
    log_ends,
    write_gap,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NO_PLAN, HELD, NOT_ESTIMATED = "no plan", "held", "not estimated"
UNCERTAINTY = "standard uncertainty"
# Dot (a role of the palette) and words of a case's verdict.
STANDING: dict[Verdict | None, tuple[str, str]] = {
    "pass": ("identified", "pass"),
    "weak": ("weak", WEAK),
    "degenerate": ("unidentifiable", "degenerate"),
    None: ("held", NO_PLAN),
}
# The two fits by shape and by fill, so that they differ in grey too.
FITS: dict[Fit, Look] = {
    "likelihood": Look(role="ink", size=3.4),
    "midpoint": Look(role="muted", shape="s", filled=False, size=3.8),
}
_MOST_MAPPED = 3  # axes of numbers
_LONGEST_VALUE, _LONGEST_UNIT = 24, 12
_MOST_WORDS = 30  # ticks of an axis of words
_MOST_SERIES, _MOST_PARAMETERS, _MOST_PANELS = 4, 15, 9
_LOG_FROM = 5.0  # ratio of the largest value of an axis to the smallest

GridPoint = tuple[tuple[GridAxis, int], ...]  # some of the axes, each with the index of its value


# ── a grid of settings in words ───────────────────────────────────────────────────────────────


def form_of(study: GridStudy) -> Literal["lines", "map", "axes"]:
    """The form of the figure: one axis of numbers at most, lines; two or three, a map; more, a panel for
    each axis."""
    count = sum(axis.numeric is not None for axis in study.axes)
    return "lines" if count <= 1 else "map" if count <= _MOST_MAPPED else "axes"


def figure_names(study: GridStudy) -> list[str]:
    """Names of the figures in their order; a map, and panels of axes, have a second one for the observed
    errors."""
    form = form_of(study)
    return [form, "ratio"] if form in ("map", "axes") and study.has("likelihood") else [form]


def by_point(study: GridStudy, along: Collection[int]) -> list[tuple[GridPoint, list[GridCase]]]:
    """The cases by their place on all axes but those numbered `along`."""
    groups: dict[tuple[int, ...], list[GridCase]] = {}
    for case in study.cases:
        groups.setdefault(tuple(at for i, at in enumerate(case.at) if i not in along), []).append(case)
    others = [axis for i, axis in enumerate(study.axes) if i not in along]
    return [(tuple(zip(others, at, strict=True)), cases) for at, cases in sorted(groups.items())]


def shown_unit(thing: GridAxis | CaseParameter) -> str:
    """The unit, fit to be shown behind a number."""
    return clipped(thing.unit, _LONGEST_UNIT)


def unit_signs(things: Iterable[GridAxis | CaseParameter]) -> str:
    """The units as next to a scale: `°, mm`."""
    return ", ".join(dict.fromkeys("°" if one.unit == "deg" else shown_unit(one) for one in things))


def value_text(axis: GridAxis, index: int) -> str:
    """A value of an axis with its unit, a word as it is."""
    value = axis.values[index]
    shown = isinstance(value, str)
    return clipped(str(value), _LONGEST_VALUE) if shown else numbers.exact(float(value), shown_unit(axis))


def axis_title(axis: GridAxis) -> str:
    """Label and unit of an axis, as next to its scale."""
    unit = unit_signs([axis])
    return f"{clipped(axis.label)}, {unit}" if unit else clipped(axis.label)


def point_name(point: GridPoint) -> str:
    """`measurements 7, Y-Pattern`: words have no label, numbers with their label."""
    return ", ".join(
        value_text(axis, i)
        if axis.numeric is None
        else f"{clipped(axis.label, _LONGEST_VALUE)} {value_text(axis, i)}"
        for axis, i in point
    )


def case_name(study: GridStudy, case: GridCase) -> str:
    """The place of a case on all axes."""
    return point_name(tuple(zip(study.axes, case.at, strict=True)))


def is_varied(study: GridStudy, setting: str) -> bool:
    """Whether an axis changes a setting (dotted name), a part of it, or what it is a part of."""
    return any(overlap(key, setting) for axis in study.axes for put in axis.changes for key in put)


def tolerance(study: GridStudy, one: CaseParameter) -> float | None:
    """The largest u that counts as identified, in the parameter's unit; None where the cases differ in it."""
    if is_varied(study, "tolerance") or one.unit not in ("deg", "mm"):
        return None
    limits = study.settings.tolerance
    angle = limits.tilt_deg if one.group == "tool" else limits.offset_deg
    return angle if one.unit == "deg" else limits.length_mm


def _other_entries(study: GridStudy, every: Iterable[CaseParameter], gaps: Iterable[str]) -> Entries:
    """What the dashed lines and the gaps of a figure are."""
    limits = dict.fromkeys(
        numbers.exact(limit, shown_unit(one)) for one in every if (limit := tolerance(study, one)) is not None
    )
    lines = [("limit", f"tolerance {', '.join(limits)}")] if limits else []
    return [*lines, *((words, words) for words in sorted(set(gaps) - {""}))]


def rmse_interval(errors: RunErrors) -> tuple[float, float]:
    """The 95 % interval of an RMSE of normal errors: chi-squared has as many dof as there are runs."""
    low, high = (math.sqrt(errors.runs / float(chdtri(errors.runs, tail))) for tail in (0.025, 0.975))
    return errors.rmse * low, errors.rmse * high


def gap(case: GridCase, one: CaseParameter | None) -> str:
    """Why nothing is drawn for a parameter of a case, in words; empty where it has a number."""
    if case.reason is not None:
        return NO_PLAN
    if one is None:
        return NOT_ESTIMATED
    return "" if one.has_numbers else HELD if one.status == "held" else NOT_DETERMINED


def sweep_pictures(study: GridStudy) -> list[Picture | None]:
    """Their form follows from the axes."""
    form = form_of(study)
    if form == "lines":
        return [_lines_picture(study)]
    return [_map_picture(study) if form == "map" else axes_picture(study), _ratio_picture(study)]


def _with_tolerance(study: GridStudy, every: Iterable[CaseParameter]) -> tuple[float, float]:
    """Limits of a logarithmic scale that has every number of these parameters, and the tolerance."""
    values: list[float | None] = []
    for one in every:
        values += [tolerance(study, one), one.std]
        values += [end for fit in FITS if (errors := one.errors(fit)) for end in rmse_interval(errors)]
    return log_ends(values)


# ── one axis of numbers, or words alone: a panel for each parameter and series ────────────────


def _lines_picture(study: GridStudy) -> Picture | None:
    """A panel for each parameter along the axis of numbers, or else along the longest of words; where there
    are more axes, for each of their values: a series.

    Where a case does not identify the parameter the line has a gap, a hatched band with the words. None where
    no case identifies any parameter.
    """
    every = {one.name: one for one in study.parameters}
    if not any(one.has_numbers for one in study.parameters):
        return None
    along = max(
        range(len(study.axes)), key=lambda i: (study.axes[i].numeric is not None, len(study.axes[i].values))
    )
    axis, every_series = study.axes[along], by_point(study, {along})
    series, parameters = every_series[:_MOST_SERIES], list(every.values())[:_MOST_PARAMETERS]
    order, words_alone = _order(axis), axis.numeric is None
    values = [float(k if axis.numeric is None else axis.numeric[at]) for k, at in enumerate(order)]
    log = not words_alone and values[0] > 0 and values[-1] >= _LOG_FROM * values[0]
    edges, single = _edges(values, log), len(series) == 1
    wide = (2 if len(parameters) <= 6 else 3) if single else len(series)
    scales = {
        unit: Scale(log=True, ends=_with_tolerance(study, (o for o in study.parameters if o.unit == unit)))
        for unit in {one.unit for one in parameters}
    }
    signs, panels = unit_signs(every.values()), []
    for k, (one, (point, cases)) in enumerate(itertools.product(parameters, series)):
        cases = sorted(cases, key=lambda case: order.index(case.at[along]))
        rows = [next((row for row in case.parameters if row.name == one.name), None) for case in cases]
        words, bands, start = [gap(case, row) for case, row in zip(cases, rows, strict=True)], [], 0
        for word, group in itertools.groupby(words):  # a band for each run of values that have no number
            end = start + len(list(group))
            bands += [(edges[start], edges[end], word)] if word else []
            start = end
        # With more than one unit each parameter says its own.
        unit = f"{', ' if single else chr(10)}{unit_signs([one])}" if "," in signs else ""
        name = label(one.name, 12) + unit
        head = [clipped(point_name((of,)), 72 // wide) for of in (() if single or k >= wide else point)]
        panel = CurvePanel(
            _curves_of(values, rows, "" if words_alone else "-"),
            scales[one.unit],
            title=name if single else "",
            head="\n".join(head),
            up="" if single or k % wide else name,
            limit=tolerance(study, one),
            gaps=bands,
            name=" ".join(filter(None, [point_name(point), label(one.name)])),
        )
        panels.append(panel)
    title = (
        f"Predicted {UNCERTAINTY} u of each parameter by {clipped(axis.label)}, and errors of simulated runs"
    )
    cuts = ((len(series), len(every_series), "series"), (len(parameters), len(every), "parameters"))
    for some, total, what in cuts:
        title += f"; {some} of {total} {what} shown, all in offsets.csv" if some < total else ""
    ticks = _spaced(values, log, wide) if not words_alone else values[:: math.ceil(len(values) / _MOST_WORDS)]
    names = [value_text(axis, order[int(k)]) for k in ticks] if words_alone else []
    scale = Scale(log, (edges[0], edges[-1]), ticks, names)
    return curves_picture(
        "lines",
        title,
        f"Predicted {UNCERTAINTY}, {signs}, by {axis_title(axis)}:",
        panels,
        scale,
        wide=wide,
        panel_height=min(1.25 if single else 1.0, 6.0 / math.ceil(len(panels) / wide)),
        across=axis_title(axis),
        up=f"{UNCERTAINTY} u, {signs}",
        legend=_other_entries(study, parameters, (words for one in panels for *_, words in one.gaps)),
    )


def _curves_of(values: Sequence[float], rows: Sequence[CaseParameter | None], stroke: str) -> list[Curve]:
    """The prediction as a line, the RMSE of each fit as marks with their intervals."""
    predicted = [math.nan if row is None or row.std is None else row.std for row in rows]
    curves = [
        Curve(
            values,
            predicted,
            "predicted u",
            Look(shape="." if stroke else "_", size=5.0 if stroke else 14.0, stroke=stroke, width=1.6),
        )
    ]
    for fit, look in FITS.items():
        some = [
            (x, errors.rmse, *rmse_interval(errors))
            for x, row in zip(values, rows, strict=True)
            if row and (errors := row.errors(fit))
        ]
        if some:
            xs, ys, low, high = (list(column) for column in zip(*some, strict=True))
            words, marks = f"RMSE of the {fit} fit, 95 %", replace(look, stroke="")
            curves.append(Curve(xs, ys, words, marks, low, high, quiet=True))
    return curves


def _spaced(values: Sequence[float], log: bool, wide: int) -> list[float]:
    """The values whose ticks do not touch: from the first on, each some way from the one before."""
    at = [math.log(value) if log else value for value in values]
    room = 0.06 * (max(len(plain(value)) for value in values) + 1) / (4.2 / wide) * (at[-1] - at[0])
    spaced: list[int] = []
    for i in range(len(values)):
        if not spaced or at[i] - at[spaced[-1]] >= room:
            spaced.append(i)
    return [values[i] for i in spaced]


def _edges(values: Sequence[float], log: bool) -> list[float]:
    """Halfway between the values, and some way before the first and after the last."""
    at = [math.log(value) if log else value for value in values]
    inner = [(a + b) / 2 for a, b in itertools.pairwise(at)]
    # The ends by the whole range, and of few values also by their neighbours: a first value has room.
    room = 0.04 * (at[-1] - at[0]) or 0.5
    few = 1 < len(at) < 4
    first = at[0] - max(room, inner[0] - at[0] if few else 0)
    last = at[-1] + max(room, at[-1] - inner[-1] if few else 0)
    return [math.exp(edge) if log else edge for edge in (first, *inner, last)]


# ── many axes of numbers: a panel for each ────────────────────────────────────────────────────

_DASH, _HEADROOM = 0.13, 1.45  # of a case, in distances of values; above the scale, for counts


def axes_picture(study: GridStudy) -> Picture | None:
    """A panel for each axis of numbers: u of the offset that is least certain in most cases, a dash for each
    case, and at each value the median and the smallest. None where no case determines it.

    Above each value stands how many of its cases do not determine the offset: they are part of the median.
    """
    name = _least_certain(study)
    rows = [(case, one) for case in study.cases for one in case.parameters if one.name == name]
    stds = [one.std for _, one in rows if one.std is not None]
    if name is None or not stds:
        return None
    one, every = rows[0][1], [i for i, axis in enumerate(study.axes) if axis.numeric is not None]
    shown, limit = every[:_MOST_PANELS], tolerance(study, one)
    ends = [*stds, *([limit] if limit is not None else [])]
    top, without = max(ends) * 1.25, len(stds) < len(rows)
    scale = Scale(log=True, ends=(min(ends) / 1.25, top * _HEADROOM))
    panels = []
    for i in shown:
        axis = study.axes[i]
        # The offset over the cases at each value of the axis.
        over = [(k, row) for k in _order(axis) for row in study.over_cases(i, k) if row.name == name]
        places = {k: at for at, (k, _) in enumerate(over)}
        points = [(places[case.at[i]], row.std) for case, row in rows if row.std is not None]
        # One line with gaps: a mark for each case would make a large file.
        xs = [x for at, _ in points for x in (at - _DASH, at + _DASH, math.nan)]
        ys = [y for _, std in points for y in (std, std, math.nan)]
        at = range(len(over))
        medians, least = (
            [math.nan if (value := getattr(row, key)) is None else value for _, row in over]
            for key in ("median", "least")
        )
        curves = [
            Curve(xs, ys, "a case", Look(shape="", width=0.7, alpha=0.45), quiet=True),
            Curve(at, medians, "median", Look(width=1.6)),
            Curve(at, least, "smallest", Look(shape="v", width=1.0)),
        ]

        def more(axes: Axes, over: Any = over, axis: GridAxis = axis) -> None:
            axes.set_xticks(range(len(over)), [plain((axis.numeric or ())[k]) for k, _ in over])
            if any(row.without for _, row in over):
                hatch(axes.axhspan, top, top * _HEADROOM, words=NOT_DETERMINED, zorder=1)
                for x, (_, row) in enumerate(over):
                    count = str(row.without)
                    write_gap(axes, x, top * math.sqrt(_HEADROOM), count, va="center_baseline", fontsize=8)

        words = [
            f"{NOT_DETERMINED if row.median is None else numbers.spread(row.median, shown_unit(one))}"
            f" at {value_text(axis, k)}"
            for k, row in over
        ]
        text = f"{clipped(axis.label)}: {', '.join(words)}"
        panels.append(CurvePanel(curves, scale, across=axis_title(axis), limit=limit, more=more, words=text))
    title = f"Predicted {UNCERTAINTY} u of {label(name)}, the least certain offset in most cases"
    if len(shown) < len(every):
        title += f"; {len(shown)} of {len(every)} axes shown, all in offsets.csv"
    return curves_picture(
        "axes",
        title,
        f"Median {UNCERTAINTY} u of {label(name)} by each axis.",
        panels,
        Scale(),
        wide=3,
        panel_height=1.75,
        up=f"{label(name)}: {UNCERTAINTY} u, {unit_signs([one])}",
        legend=_other_entries(study, [one], [f"{NOT_DETERMINED} (cases)"] if without else []),
    )


def _least_certain(study: GridStudy) -> str | None:
    """The offset that is the least certain, or not determined, in most cases."""
    counts: Counter[str] = Counter()
    for case in study.cases:
        unknown = [one.name for one in case.unidentifiable if one.is_angular_offset]
        counts.update([case.worst.name] if case.worst is not None else unknown)
    return counts.most_common(1)[0][0] if counts else None


def _order(axis: GridAxis) -> list[int]:
    """Indices of the values of an axis, by rising value; of words as they are."""
    values = axis.numeric or range(len(axis.values))
    return sorted(range(len(values)), key=values.__getitem__)


# ── two axes of numbers: a map ────────────────────────────────────────────────────────────────

_MOST_MAPS, _MOST_WRITTEN = 6, 12  # maps; cells across a figure that numbers can be read in
_LIGHTEST, _DARKEST = 0.07, 0.5  # shares of the hue: ink on either can be read
_GAPS = {"unidentifiable": NOT_DETERMINED, "held": NO_PLAN}  # words by the mark of a case


def _map_picture(study: GridStudy) -> Picture:
    """The first two axes of numbers across and up; a panel for each place on the others.

    A cell has the predicted uncertainty of the least certain offset, the fuller in colour the larger, and a
    diamond where that exceeds the tolerance; one that does not identify all offsets is hatched, without a
    number.
    """
    across, up = [i for i, axis in enumerate(study.axes) if axis.numeric is not None][:2]
    every_panel = by_point(study, {across, up})
    panels = every_panel[:_MOST_MAPS]
    columns, rows = (_order(study.axes[i]) for i in (across, up))
    wide = 1 if len(panels) == 1 or len(columns) > _MOST_WRITTEN // 2 else 2
    high = math.ceil(len(panels) / wide)
    cell = min(0.32, 4.6 / high / len(rows))
    across_pt = 72 * (WIDTH - 0.8) / wide / len(columns)
    sizes = (min(8.0, 66 * cell, across_pt / 3.4), min(7.5, 40 * cell, across_pt / 5.6))
    written = sizes if len(columns) * wide <= _MOST_WRITTEN and cell > 0.15 else None
    stds = [case.worst_std for case in study.cases if case.worst_std is not None]
    with style():
        figure = new_figure(1.05 + high * (cell * len(rows) + 0.45))
        every = figure.subplots(high, wide, squeeze=False, sharex=True, sharey=True)
        for k, axes in enumerate(every.flat):
            if k >= len(panels):
                axes.set_visible(False)
                every.flat[k - wide].tick_params(labelbottom=True)
                continue
            point, cases = panels[k]
            for case in cases:
                at = (columns.index(case.at[across]), rows.index(case.at[up]))
                _cell(axes, at, case, stds, written)
            if point:
                axes.set_title(in_font(clipped(point_name(point), 80 // wide)), fontsize=9, pad=4)
            for which, axis, order, most in (("x", across, columns, 10), ("y", up, rows, 16)):
                ticks, values = range(0, len(order), math.ceil(len(order) / most)), study.axes[axis].numeric
                names = [numbers.exact((values or ())[order[i]]) for i in ticks]
                axes.set(**{f"{which}lim": (-0.5, len(order) - 0.5), f"{which}ticks": list(ticks)})
                axes.set(**{f"{which}ticklabels": names})
            axes.grid(visible=False)
            axes.tick_params(length=0, labelsize=8.5)
            axes.spines[["left", "bottom"]].set_visible(False)
        for axis, say in ((across, figure.supxlabel), (up, figure.supylabel)):
            say(in_font(axis_title(study.axes[axis])), fontsize=9.5, color=light("muted"))
        legend_above(figure, _map_entries(study, stds), 6)
        svg = to_svg(figure, "map")
    title = f"Predicted {UNCERTAINTY} of the least certain offset, °; the fuller the colour the larger"
    if len(panels) < len(every_panel):
        title += f"; {len(panels)} of {len(every_panel)} maps shown, all cases in cases.csv"
    return Picture("map", title, _map_in_words(study), svg)


def _shade(std: float, stds: Sequence[float]) -> float:
    """Share of the hue for a std among those of the map, logarithmic."""
    low, high = math.log(min(stds)), math.log(max(stds))
    part = (math.log(std) - low) / (high - low) if high > low else 0.0
    return _LIGHTEST + part * (_DARKEST - _LIGHTEST)


def _cell(
    axes: Axes,
    at: tuple[int, int],
    case: GridCase,
    stds: Sequence[float],
    sizes: tuple[float, float] | None,
) -> None:
    """One cell; `sizes` are those of its number and of words, points, where they can be read."""
    from matplotlib.patches import Rectangle

    (x, y), (mark, _) = map(float, at), STANDING[case.verdict]

    def patch(**options: Any) -> None:
        axes.add_patch(Rectangle((x - 0.5, y - 0.5), 1, 1, **options))

    if case.worst_std is None:
        words = _GAPS.get(mark, NOT_DETERMINED)
        hatch(patch, words=words)
        if sizes is not None and sizes[1] > 5.5:  # below, the legend alone says them
            lines = words.replace(" ", "\n")
            write_gap(axes, x, y, lines, va="center", linespacing=0.95, fontsize=sizes[1])
        return
    patch(facecolor=light("identified"), alpha=_shade(case.worst_std, stds), linewidth=0)
    patch(facecolor="none", edgecolor=light("ground"), linewidth=1.0)
    if sizes is not None:
        number = numbers.spread(case.worst_std)
        axes.text(x, y, number, ha="center", va="center_baseline", fontsize=sizes[0])
    if mark == "weak":
        corner = (x - 0.4, y + 0.32) if sizes is not None else (x, y)
        axes.plot(*([one] for one in corner), SHAPES["weak"], markersize=3.2, color=light("weak"))


def _map_entries(study: GridStudy, stds: Sequence[float]) -> Entries:
    """The shades with their numbers, and what the other marks mean."""
    some = sorted({min(stds), math.sqrt(min(stds) * max(stds)), max(stds)}) if stds else []
    present = {STANDING[case.verdict][0] for case in study.cases}
    entries: list[tuple[Look | Stretch | str, str]] = [
        (Stretch(0, 1, _shade(std, stds)), numbers.spread(std, "deg")) for std in some
    ]
    entries += [(Look(role="weak", shape=SHAPES["weak"], stroke=""), WEAK)] if "weak" in present else []
    return [*entries, *((words, words) for mark, words in _GAPS.items() if mark in present)]


def _map_in_words(study: GridStudy) -> str:
    """The best and the worst place, and how many have no number."""
    known = [(case.worst_std, case) for case in study.cases if case.worst_std is not None]
    texts = []
    for what, pick in (("least", min), ("most", max)) if known else ():
        std, case = pick(known, key=lambda entry: entry[0])
        name = f" ({label(case.worst.name)})" if case.worst is not None else ""
        texts.append(f"{what} {numbers.spread(std, 'deg')}{name} at {case_name(study, case)}")
    for mark, words in _GAPS.items():
        if count := sum(STANDING[case.verdict][0] == mark for case in study.cases):
            texts.append(f"{words} in {count} of {len(study.cases)} cases")
    return f"Map of the predicted {UNCERTAINTY} of the least certain offset: {'; '.join(texts)}."


# ── observed errors over the predicted ones ───────────────────────────────────────────────────

_MOST_RATIOS = 1500  # points that a page can bear


def _ratio_picture(study: GridStudy) -> Picture | None:
    """All parameters of all cases; 1 is as predicted. None where nothing was observed."""
    if not study.has("likelihood"):
        return None
    curves, texts, cut, every = [], [], False, [0.5, 2.0]
    kinds: tuple[tuple[Fit, Status | None, str, Look], ...] = (
        ("likelihood", "identified", "likelihood, identified", Look(role="ink", stroke="", size=3)),
        ("likelihood", "weak", f"likelihood, {WEAK}", Look(role="weak", shape="D", stroke="", size=3)),
        ("midpoint", None, "midpoint", replace(FITS["midpoint"], stroke="", size=3)),
    )
    for fit, status, words, look in kinds:
        rows = [
            (one.std, errors.rmse / one.std, *(end / one.std for end in rmse_interval(errors)))
            for one in study.parameters
            if one.std and status in (None, one.status) and (errors := one.errors(fit))
        ]
        if not rows:
            continue
        cut |= len(rows) > _MOST_RATIOS
        std, ratio, low, high = (list(column) for column in zip(*rows[:_MOST_RATIOS], strict=True))
        every += low + high
        curves.append(Curve(std, ratio, words, look, low, high))
        ratios = sorted(row[1] for row in rows)
        least, most, middle = (numbers.significant(ratios[k]) for k in (0, -1, len(ratios) // 2))
        texts.append(f"{words}: {len(rows)} from {least} to {most}, median {middle}")
    title = f"RMSE of simulated runs over the predicted {UNCERTAINTY}, of all identified parameters"
    if cut:
        title += f"; the first {_MOST_RATIOS} of each kind shown, all in offsets.csv"
    panel = CurvePanel(
        curves,
        Scale(log=True, ends=(min(every) / 1.1, max(every) * 1.1)),
        words="; ".join(texts),
        across=f"predicted {UNCERTAINTY} u, {unit_signs(study.parameters)}",
        up="RMSE / predicted u",
        line=1.0,
    )
    return curves_picture(
        "ratio",
        title,
        f"RMSE of simulated runs divided by the predicted {UNCERTAINTY}.",
        [panel],
        Scale(log=True),
    )
