"""The page over all runs of a batch: outcomes, failures, misfits, odd arms, uncertainties, every
run; and the files beside the runs' own folders.
"""

from __future__ import annotations

import io
import math
from collections import Counter
from collections.abc import Iterator, Sequence, Sized
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from ..analysis.diagnostics.outliers import FEWEST_VALUES
from ..experiments.batch import OUTCOMES, OUTLIER_ALARM, Batch, BatchRow, OutlierArm
from ..model.errors import missing_extra
from ..model.files.whole_file import write_whole
from ..model.records import dumps, to_json
from ..words import numbers
from ..words.entries import VERDICT_WORDS, said_word
from ..words.wording import clipped, counted, csv_text, label, person, shown
from .output.html import html
from .studies.study_blocks import flat
from .style.blocks import (
    Block,
    Cell,
    Columns,
    Facts,
    FigureBlock,
    Page,
    Paragraph,
    Section,
    Table,
    section_of,
    table_by,
)
from .style.blocks import Verdict as Headline
from .style.canvas import Picture, new_figure, set_log_scale, style, to_svg
from .style.theme import VERDICT_MARKS, light

_MOST_ROWS = 1000
_MOST_NAMED = 200
_LONGEST_NAME, _LONGEST_MESSAGE = 40, 240
_NO_NUMBER = "—"
_CONTRADICTED = "contradicted"  # a pass by which nothing is to be entered
_SHORT = "short"  # a pass of a robot that does not meet what is required, or may not
_ORDER = (*OUTCOMES[:-1], _CONTRADICTED, _SHORT, OUTCOMES[-1])  # the gravest first
_WORDS: dict[str, str] = {
    "failed": "Failed",
    _CONTRADICTED: "Nothing to enter",
    _SHORT: "Requirement not shown to be met",
}
_WORDS |= {str(key): word for key, word in VERDICT_WORDS.items()}
_MARK: dict[str, str] = {"failed": "", _CONTRADICTED: "weak", _SHORT: "weak", **VERDICT_MARKS}
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
    sentence = f"{passed:,} of {count:,} {runs} {'is a pass' if 1 in (passed, count) else 'are a pass'}"
    if simulated := sum(row.simulated for row in done.rows if row.outcome == "pass"):
        sentence += f" ({simulated:,} simulated)"
    others = [
        f"{number:,} {'with ' if outcome in (_CONTRADICTED, _SHORT) else ''}{_WORDS[outcome].lower()}"
        for outcome, number in _counted(done).items()
        if outcome != "pass"
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
            *_doubted(done, _CONTRADICTED, "Runs of which nothing is to be entered"),
            *_doubted(done, _SHORT, "Robots that do not meet what is required, or may not"),
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


def _shown(row: BatchRow) -> str:
    """The outcome as the page counts it: passes by which nothing is to be entered, and those that do not meet
    what is required, by themselves."""
    return _CONTRADICTED if row.contradicted else _SHORT if row.falls_short else row.outcome


def _counted(done: Batch) -> dict[str, int]:
    """How many runs have each outcome, the gravest first; without those that no run has."""
    numbers_of = Counter(map(_shown, done.rows))
    return {outcome: numbers_of[outcome] for outcome in _ORDER if numbers_of[outcome]}


def _outcomes(done: Batch) -> Table:
    columns: Columns[tuple[str, int]] = {
        "outcome": lambda row: Cell(_WORDS[row[0]], mark=_MARK[row[0]]),
        "runs": lambda row: f"{row[1]:,}",
        "share": lambda row: numbers.percent(row[1] / len(done.rows), 1),
    }
    return table_by("Runs by outcome, the gravest first", list(_counted(done).items()), columns)


def _failures(done: Batch) -> Iterator[Section]:
    columns: Columns[BatchRow] = {
        "file": lambda row: clipped(row.file, 60),
        "message": lambda row: clipped("; ".join(_lines(row.message)), _LONGEST_MESSAGE),
    }
    if rows := [row for row in done.rows if row.outcome == "failed"]:
        caption = _caption("Runs without a result", rows)
        yield section_of("Failures", table_by(caption, rows[:_MOST_NAMED], columns, "l"), brief=True)


def _lines(message: str) -> list[str]:
    return [" ".join(line.split()) for line in message.splitlines()]


def _misfits(done: Batch) -> Iterator[Section]:
    columns: Columns[BatchRow] = {
        "run": _run,
        "criteria": lambda row: ", ".join(_CRITERIA.get(criterion, criterion) for criterion in row.misfit),
        "residuals / noise": _factor,
        "p-value": lambda row: _NO_NUMBER if row.p_value is None else numbers.p_value(row.p_value),
    }
    rows = sorted((row for row in done.rows if row.outcome == "misfit"), key=lambda row: -(row.factor or 0.0))
    if rows:
        about = "The model does not describe these measurements: none of their offsets is validated."
        caption = _caption("Misfits", rows)
        table = table_by(caption, rows[:_MOST_NAMED], columns, "llr", lambda row: "unvalidated")
        yield section_of("Lack of fit", Paragraph(about), table)


def _doubted(done: Batch, outcome: str, about: str) -> Iterator[Section]:
    """Passes that are none to rely on, and why."""
    columns: Columns[BatchRow] = {
        "run": _run,
        "why": lambda row: clipped(row.message, _LONGEST_MESSAGE),
    }
    if rows := [row for row in done.rows if _shown(row) == outcome]:
        caption = _caption(about, rows)
        table = table_by(caption, rows[:_MOST_NAMED], columns, "l", lambda row: "weak")
        yield section_of(_WORDS[outcome], table, brief=True)


def _outliers(done: Batch) -> Iterator[Block]:
    explanation = (
        "Outliers are identified offsets far from those of the other runs of the same robot model"
        " (generalised extreme Studentised deviate test, for normal offsets). The probability of any false"
        f" alarm is {numbers.percent(OUTLIER_ALARM)} over all models and offsets. Those with fewer than"
        f" {FEWEST_VALUES} values are not tested."
    )
    yield Paragraph(explanation if done.outliers else f"None. {explanation}")
    columns: Columns[OutlierArm] = {
        "run": lambda arm: clipped(arm.run, _LONGEST_NAME),
        "robot": lambda arm: clipped(arm.robot, 24),
        "serial": lambda arm: _or_none(arm.serial),
        "offset": lambda arm: person(arm.offset),
        "estimate": lambda arm: numbers.significant(arm.estimate, 3, arm.unit),
        "standard deviations off": lambda arm: numbers.significant(arm.off, 2),
    }
    if done.outliers:
        caption = _caption("Outlying offsets", done.outliers)
        yield table_by(caption, done.outliers[:_MOST_NAMED], columns, "llllr", lambda arm: "weak")


def _largest(done: Batch) -> Table | None:
    known = [row for row in done.rows if row.worst is not None and row.worst.u is not None]
    known.sort(key=lambda row: -((row.worst and row.worst.u) or 0.0))
    columns: Columns[BatchRow] = {"run": _run, "outcome": _outcome, "offset": _worst, "u": _u}
    return table_by(f"The {len(known[:20])} largest", known[:20], columns, "lllr") if known else None


def _every(done: Batch) -> Table:
    rows = sorted(done.rows, key=lambda row: _ORDER.index(_shown(row)))
    caption = "The gravest first; results are in the folders of these names"
    if len(rows) > _MOST_ROWS:
        caption += f". The first {_MOST_ROWS:,} of {len(rows):,}: runs.csv has all"
    columns: Columns[BatchRow] = {
        "run": _run,
        "outcome": _outcome,
        "robot": lambda row: _or_none(row.robot),
        "serial": lambda row: _or_none(row.serial),
        "when": lambda row: _or_none(row.when),
        "measurements": lambda row: _NO_NUMBER if row.measurements is None else str(row.measurements),
        "worst offset": _worst,
        "u": _u,
        "residuals / noise": _factor,
        "posterior": lambda row: row.posterior or _NO_NUMBER,
    }
    return table_by(caption, rows[:_MOST_ROWS], columns, "lllllrlrrl")


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
    return Cell(said_word(_WORDS[_shown(row)], row.simulated), mark=_MARK[_shown(row)])


def _worst(row: BatchRow) -> str:
    undetermined = "undetermined" if row.outcome == "degenerate" else _NO_NUMBER
    return undetermined if row.worst is None else label(row.worst.name)


def _u(row: BatchRow) -> str:
    worst = row.worst
    return _NO_NUMBER if worst is None or worst.u is None else numbers.spread(worst.u, worst.unit)


def _factor(row: BatchRow) -> str:
    return _NO_NUMBER if row.factor is None else numbers.times(row.factor)


def _or_none(text: str | None) -> str:
    return clipped(text, 24) if text else _NO_NUMBER


def _caption(what: str, rows: Sized) -> str:
    count = len(rows)
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


PAGE, ANSWER, RUNS, OFFSETS = "batch.html", "batch.json", "runs.csv", "offsets.csv"
_PARQUET = {RUNS: "runs.parquet", OFFSETS: "offsets.parquet"}
_NUMBERS = {
    **dict.fromkeys(("worst_u", "residuals_over_noise", "p_value", "estimate", "u"), "float64"),
    **{"low95": "float64", "high95": "float64", "measurements": "int64", "simulated": "bool_"},
}  # columns of Parquet; the others are text
FILES = frozenset({PAGE, ANSWER, RUNS, OFFSETS, *_PARQUET.values()})


def write_batch(folder: Path, done: Batch, *, parquet: bool) -> None:
    """Write batch.html, batch.json, runs.csv and offsets.csv, each whole; with `parquet` these as well."""
    picture = uncertainty_picture(done.rows)
    pictures = {} if picture is None else {picture.name: picture}
    write_whole(folder / ANSWER, dumps(to_json(done)), force=True)
    for name, rows in ((RUNS, run_rows), (OFFSETS, _OFFSET_ROWS)):
        write_whole(folder / name, csv_text(rows(done)), force=True)
        if parquet:
            write_whole(folder / _PARQUET[name], _parquet(list(rows(done))), force=True)
        else:
            (folder / _PARQUET[name]).unlink(missing_ok=True)  # of other runs than these
    write_whole(folder / PAGE, html(batch_page(done), pictures, "study"), force=True)


def require_parquet() -> None:
    """BadInput where the library for Parquet is missing."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise missing_extra("a table in Parquet", "parquet", needed="pyarrow") from None


# `runs.csv` has a row for each run, `offsets.csv` one for each offset of each run.
_RUN_ROWS: Any = flat(
    "rows",
    "run=1.name file outcome robot serial when measurements worst_offset=1.worst.name worst_u=1.worst.u"
    " unit=1.worst.unit residuals_over_noise=1.factor p_value misfit odd_offset posterior message sha256"
    " simulated",
)
_OFFSET_ROWS: Any = flat(
    "rows offsets",
    "run=1.name robot=1.robot serial=1.serial when=1.when outcome=1.outcome offset=2.name unit status"
    " estimate u low95=2.interval95.0 high95=2.interval95.1",
)


def run_rows(done: Batch) -> Iterator[dict[str, object]]:
    """`runs.csv`."""
    outlier_of = {outlier.run: outlier.offset for outlier in reversed(done.outliers)}
    return ({**row, "odd_offset": outlier_of.get(str(row["run"]))} for row in _RUN_ROWS(done))


def _parquet(rows: list[dict[str, object]]) -> bytes:
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    names = list(rows[0]) if rows else []
    kinds = pyarrow.schema([(name, getattr(pyarrow, _NUMBERS.get(name, "string"))()) for name in names])
    out = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows, schema=kinds), out)
    return out.getvalue()
