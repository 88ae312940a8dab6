"""The page of `compare`: mean and scatter of repeated runs, whether they agree."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from ..analysis.repeatability.compare import (
    COMPARE_SCHEMA,
    FALSE_ALARM,
    Agreement,
    ComparedOffset,
    ComparedRun,
    Comparison,
    OffsetOfRun,
)
from ..analysis.repeatability.consistency import Mean, Scatter
from ..model.arrays import NORMAL_95
from ..words import numbers
from ..words.comparison import headline, notes, time_unit
from ..words.numbers import significant, with_unit
from ..words.sentences import to_json
from ..words.wording import clipped, counted, label, listed, sentence, shown
from .output.whole_folder import FolderContents, Kind, Written, write_answer
from .style.blocks import (
    Block,
    Cell,
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Row,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)
from .style.canvas import Picture, new_figure, style, to_svg
from .style.theme import SHAPES, in_font, light

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VERDICT: dict[Agreement, tuple[str, str]] = {
    "agrees": ("pass", "Agrees"),
    "does not agree": ("weak", "Does not agree"),
    "not tested": ("weak", "Not tested"),
    "misfit": ("misfit", "Misfit"),
}
_NOT_COMPARED = "not compared"
_NOT_GIVEN = "not given"
_NO_NUMBER = {"unidentifiable": "unidentifiable", "prior": _NOT_COMPARED}
_LONGEST_NAME = 40
_HOLM = "p-values adjusted for the number of"


def comparison_page(comparison: Comparison) -> Page:
    """The display strings of a comparison."""
    key, word = _VERDICT[comparison.verdict]
    runs = counted(len(comparison.runs), "run")
    return Page(
        "Repeated runs, compared",
        runs if comparison.kind != "table" else f"{runs} of a table of published offsets",
        Verdict(key, word, sentence(headline(comparison))),
        [sentence(note) for note in notes(comparison)],
        [
            section_of(
                "Mean and scatter of each offset",
                _means(comparison),
                _prediction(comparison),
                Paragraph(_whole(comparison)),
                FigureBlock("runs"),
                brief=True,
            ),
            section_of("Drift", *_drift(comparison), brief=True),
            section_of("Each run", _against(comparison), Paragraph(_on_the_outlier(comparison)), brief=True),
            section_of("Offsets of each run", _runs(comparison), level=2),
            section_of("Settings and inputs", Facts(_about(comparison))),
        ],
    )


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _means(comparison: Comparison) -> Table:
    columns = ["offset", "mean", "95 % interval", "s of a run", "its 95 % interval"]
    by = {row.mean.by for row in comparison.offsets if row.mean is not None}
    source = "the prediction" if by == {"prediction"} else "the scatter of the runs (Student’s t)"
    caption = f"Mean over the runs, its interval from {source}; standard deviation of a run by the scatter"
    return table_of(
        caption, columns, [_means_row(row, comparison.kind == "table") for row in comparison.offsets]
    )


def _means_row(row: ComparedOffset, published: bool) -> Row:
    if row.mean is None or row.scatter is None:
        return row_of(label(row.name), Cell(_NOT_COMPARED, span=4), tone="unidentifiable")
    mean = _mean(row.mean, row.scatter, row.unit, published)
    tone = "unvalidated" if row.unvalidated else "assumed" if row.assumed else ""
    name = replace(_named(row), text=", ".join(filter(None, (label(row.name), tone))))
    return row_of(name, *mean, _range(row.scatter.interval95, row.unit), tone=tone)


def _named(row: ComparedOffset) -> Cell:
    """An offset, and whether it rests on what was assumed."""
    return Cell(label(row.name), mark="assumed" if row.assumed and not row.unvalidated else "")


def _mean(mean: Mean, scatter: Scatter, unit: str, published: bool) -> list[str]:
    """Mean, interval and std: by the mean's uncertainty, or with the std to three digits, as papers print."""
    low, high = mean.interval95
    half = (high - low) / 2
    if half == 0:
        return [numbers.exact(mean.value, unit), _NOT_GIVEN, _spread(scatter.std, unit)]
    spread = half / NORMAL_95
    interval = numbers.interval((low, high), spread, unit)
    if not published:
        return [numbers.estimate(mean.value, spread, unit), interval, _spread(scatter.std, unit)]
    digits = numbers.decimals(scatter.std) + 1
    value, std = (
        numbers.with_unit(numbers.fixed(number, digits), unit) for number in (mean.value, scatter.std)
    )
    return [value, interval, std]


def _prediction(comparison: Comparison) -> Table | None:
    """Observed against predicted scatter, where anything is predicted."""
    columns = ["offset", "observed", "predicted", "observed / predicted", "95 % interval", "p-value"]
    rows = [
        row_of(
            _named(row),
            _spread(row.scatter.std, row.unit),
            _spread(row.predicted_std, row.unit),
            numbers.times(row.test.ratio),
            _factors(row.test.ratio_interval95),
            numbers.p_value(row.test.p_holm),
            tone="weak" if row.name in comparison.differing else "",
        )
        for row in comparison.offsets
        if row.test is not None and row.scatter is not None and row.predicted_std is not None
    ]
    caption = f"Standard deviation over the runs; {_HOLM} offsets (Holm)"
    return table_of(caption, columns, rows) if rows else None


def _whole(comparison: Comparison) -> str:
    whole = comparison.consistency
    if whole is None:
        return (
            "The true standard deviation follows from a few runs to a wide interval only. There is no joint"
            " test of all offsets: that takes run files in which every free offset is identifiable."
        )
    test = f"χ² {numbers.significant(whole.chi2)}, {whole.dof} degrees of freedom"
    if whole.noise_dof is not None:
        test += f", against a noise estimated with {whole.noise_dof} degrees of freedom (F)"
    return (
        f"All offsets together, with their covariances: {test}, p-value {numbers.p_value(whole.p_value)}. The"
        f" runs scatter {numbers.times(whole.ratio)} times as much as predicted"
        f" ({_factors(whole.ratio_interval95)})."
    )


def _drift(comparison: Comparison) -> Iterator[Block]:
    by = "the time of the runs" if comparison.by_time else "the order in which the runs were given"
    yield Paragraph(
        f"Slope of each offset over {by}, its interval from the scatter about the line (Student’s t): it"
        " holds whatever was predicted, and is wide for few runs."
    )
    columns = ["offset", "slope", "95 % interval", "p-value"]
    rows = [_drift_row(row, comparison) for row in comparison.offsets]
    yield table_of(f"Drift; {_HOLM} offsets (Holm)", columns, rows)


def _drift_row(row: ComparedOffset, comparison: Comparison) -> Row:
    drift = row.drift
    if drift is None:
        return row_of(_named(row), Cell("not determined", span=3), tone="unidentifiable")
    low, high = drift.interval95
    time, per = time_unit(comparison)
    low, high = low * per, high * per
    spread = (high - low) / (2 * NORMAL_95)
    unit = f"{'°' if row.unit == 'deg' else f' {row.unit}'}/{time}"
    return row_of(
        _named(row),
        f"{numbers.estimate(drift.slope * per, spread)}{unit}",
        f"{numbers.interval((low, high), spread)}{unit}",
        numbers.p_value(drift.p_holm),
        tone="weak" if row.name in comparison.drifting else "",
    )


def _against(comparison: Comparison) -> Table:
    columns = ["run", "at", "measurements", "p-value against the others"]
    rows = [_against_row(number, run, comparison) for number, run in enumerate(comparison.runs, start=1)]
    return table_of(f"Each run against all others; {_HOLM} runs (Holm)", columns, rows, "lrrl")


def _against_row(number: int, run: ComparedRun, comparison: Comparison) -> Row:
    cell: str | Cell = _NOT_GIVEN if run.odd is None else numbers.p_value(run.odd.p_holm)
    outlier = run.name == comparison.odd_run
    if outlier:
        cell = Cell(f"outlier, {cell}", mark="weak")
    elif run.misfit:
        cell = Cell(f"misfit, {cell}", mark="unvalidated")
    if run.reason is not None:
        cell = Cell("no result", mark="weak")
    time, per = time_unit(comparison)
    at = f"{numbers.significant(run.at / per)} {time}s" if comparison.by_time else str(number)
    count = _NOT_GIVEN if run.shots is None else str(run.shots)
    return row_of(clipped(run.name, _LONGEST_NAME), at, count, cell, tone="weak" if outlier else "")


def _runs(comparison: Comparison) -> Table:
    columns = ["run", *(label(row.name) for row in comparison.offsets)]
    rows = [
        row_of(clipped(run.name, _LONGEST_NAME), *(_estimate(offset) for offset in run.offsets))
        for run in comparison.runs
    ]
    caption = "Offsets of each run without prior, ± predicted standard uncertainty"
    if comparison.kind == "table":
        caption = "Offsets of each run as published"
    return table_of(caption, columns, rows)


def _estimate(offset: OffsetOfRun) -> str | Cell:
    if offset.estimate is None:
        return _NO_NUMBER.get(offset.status, _NOT_GIVEN)
    if offset.std is None:
        return numbers.exact(offset.estimate, offset.unit)
    text = f"{numbers.estimate(offset.estimate, offset.std)} ± {_spread(offset.std, offset.unit)}"
    return Cell(text, mark="assumed" if offset.status == "assumed" else "")


def _on_the_outlier(comparison: Comparison) -> str:
    if comparison.odd_run is not None:
        return f"{clipped(comparison.odd_run, _LONGEST_NAME)} is the outlier."
    if comparison.used < 3:
        return "An outlier cannot be found among fewer than three runs."
    return "No single run is an outlier."


def _about(comparison: Comparison) -> list[tuple[str, str]]:
    hashes = dict.fromkeys(run.sha256[:12] for run in comparison.runs if run.sha256)
    robots = dict.fromkeys(clipped(run.robot) for run in comparison.runs if run.robot)
    return [
        ("Robot", ", ".join(robots) or _NOT_GIVEN),
        ("Held", listed([label(name) for name in comparison.held]) if comparison.held else "none"),
        ("Order", "by provenance.when" if comparison.by_time else "as given"),
        ("Questions", f"{', '.join(comparison.asked)}: each at {FALSE_ALARM:g} over their number"),
        ("Seed", str(comparison.seed)),
        ("SHA-256", ", ".join(hashes)),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in comparison.versions.items())),
        ("Files", "compare.json beside this page holds every number unrounded; offsets.csv as a plain table"),
    ]


def _spread(std: float, unit: str = "") -> str:
    """To two significant digits; runs that are all the same have a scatter of 0."""
    return numbers.spread(std, unit) if std > 0 else numbers.exact(0, unit)


def _range(interval: tuple[float, float], unit: str = "") -> str:
    """`low to high` of an interval whose ends lie factors apart: two significant digits each."""
    return f"{_spread(interval[0])} to {_spread(interval[1], unit)}"


def _factors(interval: tuple[float, float]) -> str:
    """The same of factors."""
    return f"{numbers.times(interval[0])} to {numbers.times(interval[1])}"


_MOST_NUMBERED = 15
_WIDEST = 5  # an interval so many times as wide as the median one does not set the scale


def runs_picture(comparison: Comparison) -> Picture | None:
    """A panel for each offset that is compared, the runs in their order; None where there is none."""
    compared = [i for i, row in enumerate(comparison.offsets) if row.mean is not None]
    if not compared:
        return None
    with style():
        figure = new_figure(0.75 * len(compared) + 0.7)
        panels = figure.subplots(len(compared), 1, sharex=True, squeeze=False)[:, 0]
        within = [_panel(axes, comparison, i) for axes, i in zip(panels, compared, strict=True)]
        panels[-1].set_xlabel(
            f"{time_unit(comparison)[0]}s from the first run" if comparison.by_time else "run"
        )
        if not comparison.by_time and len(comparison.runs) <= _MOST_NUMBERED:
            panels[-1].set_xticks([run.at for run in comparison.runs])
        svg = to_svg(figure, "runs")
    title = "Each run’s offsets less the mean of all runs (band: 95 % interval of the mean"
    title += ")" if all(within) else ", which reaches beyond a panel that it fills)"
    if any(row.predicted_std for row in comparison.offsets):
        title += ", with the predicted 95 % intervals"
    if comparison.odd_run is not None:
        title += "; the diamond is the outlier"
    return Picture("runs", title, _alt(comparison, compared), svg)


def _panel(axes: Axes, comparison: Comparison, i: int) -> bool:
    """One offset, on the scale of its runs; whether the band of the mean is within it: of two runs it is many
    times as wide as they are apart."""
    row, (_, per) = comparison.offsets[i], time_unit(comparison)
    ink, blue = light("ink"), light("identified")
    assert row.mean is not None
    low, high = row.mean.interval95
    axes.axhspan(low - row.mean.value, high - row.mean.value, color=blue, alpha=0.12, linewidth=0)
    axes.axhline(0, color=light("muted"), linewidth=0.8)
    for run in comparison.runs:
        offset = run.offsets[i]
        if offset.estimate is None:
            continue
        outlier = run.name == comparison.odd_run
        colour = light("weak") if outlier else ink
        off = offset.estimate - row.mean.value
        if offset.std is not None:
            half = NORMAL_95 * offset.std
            axes.plot([run.at / per] * 2, [off - half, off + half], "-", linewidth=1.3, color=colour)
        shape = SHAPES["weak" if outlier else "identified"]
        axes.plot([run.at / per], [off], shape, markersize=6 if outlier else 4.2, color=colour)
    axes.grid(visible=False, axis="x")
    axes.locator_params(axis="y", nbins=3)
    axes.margins(x=0.06)
    bottom, top = _scale(comparison, i)
    axes.set_ylim(bottom, top)
    axes.set_ylabel(in_font(f"{label(row.name, 9)}, {'°' if row.unit == 'deg' else row.unit}"), color=ink)
    return bottom <= low - row.mean.value and high - row.mean.value <= top


def _scale(comparison: Comparison, i: int) -> tuple[float, float]:
    """By the runs, and by their intervals that are narrow enough to be compared."""
    mean = comparison.offsets[i].mean
    assert mean is not None
    offs = [
        (offset.estimate - mean.value, NORMAL_95 * (offset.std or 0.0))
        for offset in (run.offsets[i] for run in comparison.runs)
        if offset.estimate is not None
    ]
    most = _WIDEST * median([half for _, half in offs])
    ends = [off + sign * half for off, half in offs for sign in (-1, 0, 1) if sign == 0 or half <= most]
    edge = 0.12 * (max(ends) - min(ends)) or 1e-3 * abs(mean.value) or 1e-3
    return min(ends) - edge, max(ends) + edge


def _alt(comparison: Comparison, compared: list[int]) -> str:
    parts = []
    for i in compared:
        row = comparison.offsets[i]
        assert row.mean is not None
        offs = []
        for run in comparison.runs:
            estimate = run.offsets[i].estimate
            if estimate is not None:
                off = with_unit(significant(estimate - row.mean.value, 2), row.unit)
                offs.append(f"{clipped(run.name, 30)} {off}")
        parts.append(f"{label(row.name)}: {', '.join(offs)}")
    outlier = "" if comparison.odd_run is None else f" The outlier is {clipped(comparison.odd_run, 40)}."
    return f"Offsets less their mean. {'. '.join(parts)}.{outlier}"


_TABLE = "offsets.csv"
COMPARISON = Kind.of_answer("comparison", "compare.json", COMPARE_SCHEMA, _TABLE)


def write_comparison(folder: Path | str, comparison: Comparison) -> Written:
    """Write a comparison (`zerobeam/compare/1`) to `folder`. Raises as `write_answer`."""
    tables = {_TABLE: offset_rows(comparison)}
    page, picture = comparison_page(comparison), runs_picture(comparison)
    return write_answer(folder, COMPARISON, FolderContents(to_json(comparison), page, [picture], tables))


def offset_rows(comparison: Comparison) -> Iterator[dict[str, object]]:
    """`offsets.csv`: one row for each offset and run, with what holds for the offset over all runs."""
    for i, row in enumerate(comparison.offsets):
        low, high = row.mean.interval95 if row.mean else (None, None)
        for run in comparison.runs:
            offset = run.offsets[i]
            yield {
                "offset": row.name,
                "unit": row.unit,
                "run": run.name,
                "at": run.at,
                "status": offset.status,
                "estimate": offset.estimate,
                "std": offset.std,
                "mean": row.mean and row.mean.value,
                "mean_low": low,
                "mean_high": high,
                "observed_std": row.scatter and row.scatter.std,
                "predicted_std": row.predicted_std,
                "ratio": row.test and row.test.ratio,
                "p_holm": row.test and row.test.p_holm,
                "slope": row.drift and row.drift.slope,
                "slope_p_holm": row.drift and row.drift.p_holm,
            }
