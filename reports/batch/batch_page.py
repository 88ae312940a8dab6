"""The page over all runs of a batch: outcomes, failures, misfits, odd arms, uncertainties, every run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.ticker import MaxNLocator

from ...analysis.diagnostics.outliers import FEWEST_VALUES
from ...experiments.batch import OUTCOMES, OUTLIER_ALARM, Batch, BatchOffset, BatchRow
from ...words import numbers
from ...words.entries import VERDICT_WORDS
from ...words.wording import clipped, counted, label, person, shown
from ..style.blocks import (
    Block,
    Cell,
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..style.blocks import Verdict as Headline
from ..style.canvas import Picture, new_figure, set_log_scale, style, to_svg
from ..style.palette import light

_MOST_ROWS = 1000
_MOST_NAMED = 200
_LONGEST_NAME, _LONGEST_MESSAGE = 40, 240
_NO_NUMBER = "—"
_WORDS: dict[str, str] = {"failed": "Failed", **{str(key): word for key, word in VERDICT_WORDS.items()}}
_MARK = {
    "failed": "",
    "misfit": "unvalidated",
    "degenerate": "unidentifiable",
    "weak": "weak",
    "pass": "identified",
}
_CRITERIA = {
    "chi2": "residuals",
    "noise_factor": "noise factor",
    "nominal_geometry": "nominal geometry",
    "prior": "beyond prior",
    "tight_prior": "tolerance too small",
    "placements": "placements disagree",
    "moved_target": "target moved",
    "step": "target slipped",
    "change": "change during the run",
    "repeats": "repeats differ",
}


def batch_page(done: Batch) -> Page:
    """The display strings of a batch."""
    count, passed = len(done.rows), done.counts["pass"]
    robots = sorted({clipped(row.robot) for row in done.rows if row.robot})
    key, word = ("pass", "All pass") if done.passed else ("weak", "Not all pass")
    runs = "run" if count == 1 else "runs"
    sentence = f"{passed:,} of {count:,} {runs} {'is a pass' if passed == 1 else 'are a pass'}"
    others = [
        f"{done.counts[outcome]:,} {_WORDS[outcome].lower()}"
        for outcome in OUTCOMES[:-1]
        if done.counts[outcome]
    ]
    return Page(
        "Batch of runs",
        ", ".join(robots[:8]) + (", …" if len(robots) > 8 else ""),
        Headline(key, word, f"{sentence}{': ' if others else ''}{', '.join(others)}."),
        list(_notes(done)),
        [
            section_of("Outcomes", _outcomes(done), brief=True),
            *_failures(done),
            *_misfits(done),
            section_of("Outlying arms", *_outliers(done)),
            section_of(
                "Uncertainty",
                Paragraph(
                    "Standard uncertainty u of the offset that is determined worst, where all that are"
                    " estimated are determined. Those of a misfit are unvalidated."
                ),
                FigureBlock("uncertainty"),
                _largest(done),
            ),
            section_of("All runs", _every(done)),
            section_of("Settings", Facts(_about(done))),
        ],
    )


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def _notes(done: Batch) -> Iterator[str]:
    poor = sum(row.posterior == "not sampled" for row in done.rows)
    if poor:
        yield (
            f"{counted(poor, 'run')} without posterior, as asked, although the curvature at the mode may not"
            " describe it: each result says for which parameters"
        )


def _outcomes(done: Batch) -> Table:
    columns = ["outcome", "runs", "share"]
    rows = [
        row_of(Cell(_WORDS[outcome], mark=_MARK[outcome]), f"{number:,}", f"{number / len(done.rows):.1%}")
        for outcome, number in done.counts.items()
        if number
    ]
    return table_of("Runs by outcome, the gravest first", columns, rows)


def _failures(done: Batch) -> list[Section]:
    rows = [row for row in done.rows if row.outcome == "failed"]
    if not rows:
        return []
    columns = ["file", "message"]
    lines = [
        row_of(clipped(row.file, 60), clipped("; ".join(_lines(row.message)), _LONGEST_MESSAGE))
        for row in rows[:_MOST_NAMED]
    ]
    return [
        section_of(
            "Failures", table_of(_caption("Runs without a result", rows), columns, lines, "l"), brief=True
        )
    ]


def _lines(message: str) -> list[str]:
    return [" ".join(line.split()) for line in message.splitlines()]


def _misfits(done: Batch) -> list[Section]:
    rows = [row for row in done.rows if row.outcome == "misfit"]
    if not rows:
        return []
    rows = sorted(rows, key=lambda row: -(row.factor or 0.0))
    columns = ["run", "criteria", "residuals / noise", "p-value"]
    lines = [
        row_of(
            _run(row),
            ", ".join(_CRITERIA.get(criterion, criterion) for criterion in row.misfit),
            _NO_NUMBER if row.factor is None else numbers.times(row.factor),
            _NO_NUMBER if row.p_value is None else numbers.p_value(row.p_value),
            tone="unvalidated",
        )
        for row in rows[:_MOST_NAMED]
    ]
    about = Paragraph("The model does not describe these measurements: none of their offsets is validated.")
    return [section_of("Lack of fit", about, table_of(_caption("Misfits", rows), columns, lines, "llr"))]


def _outliers(done: Batch) -> list[Block]:
    explanation = (
        "Outliers are identified offsets far from those of the other runs of the same robot model"
        " (generalised extreme Studentised deviate test, for normal offsets). The probability of any false"
        f" alarm is {OUTLIER_ALARM:.0%} over all models and offsets. Those with fewer than {FEWEST_VALUES}"
        " values are not tested."
    )
    if not done.outliers:
        return [Paragraph(f"None. {explanation}")]
    columns = ["run", "robot", "serial", "offset", "estimate", "standard deviations off"]
    rows = [
        row_of(
            clipped(arm.run, _LONGEST_NAME),
            clipped(arm.robot, 24),
            clipped(arm.serial, 24) if arm.serial else _NO_NUMBER,
            person(arm.offset),
            numbers.significant(arm.estimate, 3, arm.unit),
            numbers.significant(arm.off, 2),
            tone="weak",
        )
        for arm in done.outliers[:_MOST_NAMED]
    ]
    return [
        Paragraph(explanation),
        table_of(_caption("Outlying offsets", done.outliers), columns, rows, "llllr"),
    ]


def _largest(done: Batch) -> Table | None:
    rows = [(row, row.worst) for row in done.rows]
    known = [(row, worst) for row, worst in rows if worst is not None and worst.u is not None]
    if not known:
        return None
    known.sort(key=lambda pair: -(pair[1].u or 0.0))
    columns = ["run", "outcome", "offset", "u"]
    lines = [row_of(_run(row), _outcome(row), label(worst.name), _u(worst)) for row, worst in known[:20]]
    return table_of(f"The {len(lines)} largest", columns, lines, "lllr")


def _every(done: Batch) -> Table:
    rows = sorted(done.rows, key=lambda row: OUTCOMES.index(row.outcome))
    columns = [
        "run",
        "outcome",
        "robot",
        "serial",
        "when",
        "measurements",
        "worst offset",
        "u",
        "residuals / noise",
        "posterior",
    ]
    caption = "The gravest first; results are in the folders of these names"
    if len(rows) > _MOST_ROWS:
        caption += f". The first {_MOST_ROWS:,} of {len(rows):,}: runs.csv has all"
    return table_of(caption, columns, [_row(row) for row in rows[:_MOST_ROWS]], "lllllrlrrl")


def _row(row: BatchRow) -> Row:
    worst = row.worst
    undetermined = "undetermined" if row.outcome == "degenerate" else _NO_NUMBER
    return row_of(
        _run(row),
        _outcome(row),
        clipped(row.robot, 24) if row.robot else _NO_NUMBER,
        clipped(row.serial, 24) if row.serial else _NO_NUMBER,
        clipped(row.when, 24) if row.when else _NO_NUMBER,
        _NO_NUMBER if row.measurements is None else str(row.measurements),
        undetermined if worst is None else label(worst.name),
        _NO_NUMBER if worst is None else _u(worst),
        _NO_NUMBER if row.factor is None else numbers.times(row.factor),
        row.posterior or _NO_NUMBER,
    )


def _about(done: Batch) -> list[tuple[str, str]]:
    sampling = {
        "always": "of every run",
        "where needed": "where the profile likelihood shows that the curvature does not describe it",
        "never": "of none, as asked",
    }
    return [
        ("Posterior sampled", sampling[done.settings.sampling]),
        ("Effective sample size", numbers.exact(done.settings.ess)),
        ("Seed", str(done.settings.seed)),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in done.versions.items())),
        ("Files", "batch.json has every number unrounded; runs.csv and offsets.csv are plain tables"),
    ]


def _run(row: BatchRow) -> str:
    return clipped(row.name, _LONGEST_NAME)


def _outcome(row: BatchRow) -> Cell:
    return Cell(_WORDS[row.outcome], mark=_MARK[row.outcome])


def _u(offset: BatchOffset) -> str:
    return _NO_NUMBER if offset.u is None else numbers.spread(offset.u, offset.unit)


def _caption(what: str, rows: object) -> str:
    count = len(rows)  # type: ignore[arg-type]
    return what if count <= _MOST_NAMED else f"{what}: the first {_MOST_NAMED} of {count:,}, runs.csv has all"


_BINS = 36
_LEAST_RANGE = 4.0  # of the axis, so that it has ticks
_COLOUR = {"pass": "identified", "weak": "weak", "misfit": "misfit"}


def uncertainty_picture(rows: Sequence[BatchRow]) -> Picture | None:
    """A histogram on a logarithmic scale; None where no run has a number in degrees."""
    by_outcome: dict[str, list[float]] = {name: [] for name in _COLOUR}
    for row in rows:
        worst = row.worst
        if worst is not None and worst.unit == "deg" and worst.u is not None and row.outcome in by_outcome:
            by_outcome[row.outcome].append(worst.u)
    every = np.array([u for stds in by_outcome.values() for u in stds])
    if not len(every):
        return None
    low, high = float(every.min()) / 1.05, float(every.max()) * 1.05
    room = max(1.1, math.sqrt(_LEAST_RANGE * low / high))
    edges = np.geomspace(low, high, _BINS + 1)
    with style():
        figure = new_figure(2.2)
        axes = figure.subplots()
        shown = [name for name, stds in by_outcome.items() if stds]
        axes.hist(
            [by_outcome[name] for name in shown],
            bins=edges.tolist(),
            stacked=True,
            color=[light(_COLOUR[name]) for name in shown],
            label=shown,
        )
        set_log_scale(axes, "x", low / room, high * room)
        axes.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        axes.set_xlabel("largest standard uncertainty u of an offset, °")
        axes.set_ylabel("runs")
        axes.legend()
        svg = to_svg(figure, "uncertainty")
    least, middle, most = (
        numbers.significant(float(np.quantile(every, share)), 2, "deg") for share in (0, 0.5, 1)
    )
    return Picture(
        "uncertainty",
        "Largest standard uncertainty of an offset in each run whose offsets are all determined",
        f"Histogram of {counted(len(every), 'run')}: from {least} to {most}, median {middle}. The table of"
        " all runs has each.",
        svg,
    )
