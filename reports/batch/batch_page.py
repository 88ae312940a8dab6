"""The page over all runs of a batch: outcomes, failures, misfits, odd arms, uncertainties, every run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from rich.console import Console
from rich.text import Text

from ...analysis.repeatability.odd_values import FEWEST, odd_values
from ...experiments.batch import BatchOffset, BatchRow, BatchSettings, Outcome
from ...words import numbers
from ...words.verdict import VERDICT_WORDS
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
from ..style.canvas import Picture, new_figure, style, to_svg
from ..style.console import VERDICT_STYLE, note, print_block
from ..style.log_axis import set_log_scale
from ..style.palette import light

CHANCE = 0.01  # of a false alarm over all arms and offsets
_MOST_ROWS = 1000
_MOST_NAMED = 200
_LONGEST_NAME, _LONGEST_MESSAGE = 40, 240
_NO_NUMBER = "—"
OUTCOMES: tuple[Outcome, ...] = ("failed", "misfit", "degenerate", "weak", "pass")
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
    "prior": "beyond prior",
    "placements": "placements disagree",
}


@dataclass(frozen=True)
class OddArm:
    """An identified offset that is so many standard deviations of the other arms of its model off theirs."""

    run: str
    robot: str
    serial: str | None
    offset: str
    unit: str
    estimate: float
    off: float


@dataclass(frozen=True, eq=False)
class Batch:
    """All runs of a batch, in the order of their files."""

    rows: tuple[BatchRow, ...]
    settings: BatchSettings
    versions: Mapping[str, str]

    @cached_property
    def counts(self) -> dict[Outcome, int]:
        """How many runs have each outcome, the gravest first."""
        found = Counter(row.outcome for row in self.rows)
        return {outcome: found[outcome] for outcome in OUTCOMES}

    @property
    def passed(self) -> bool:
        """Whether every run is a pass."""
        return self.counts["pass"] == len(self.rows)

    @cached_property
    def odd(self) -> tuple[OddArm, ...]:
        """Offsets that do not belong to those of the other arms of a model, the furthest first."""
        groups: dict[tuple[str, str, str], list[tuple[BatchRow, float]]] = {}
        for row in self.rows:
            for own in row.offsets:
                if own.status == "identified" and own.estimate is not None and row.robot is not None:
                    key = (row.robot, own.name, own.unit)
                    groups.setdefault(key, []).append((row, own.estimate))
        tested = {key: group for key, group in groups.items() if len(group) >= FEWEST}
        found = []
        for (robot, name, unit), group in tested.items():
            for place, off in odd_values([value for _, value in group], CHANCE / len(tested)):
                row, value = group[place]
                found.append(OddArm(row.name, robot, row.serial, name, unit, value, off))
        return tuple(sorted(found, key=lambda own: -abs(own.off)))


def batch_page(done: Batch) -> Page:
    """The display strings of a batch."""
    count, passed = len(done.rows), done.counts["pass"]
    robots = sorted({clipped(row.robot) for row in done.rows if row.robot})
    key, word = ("pass", "All pass") if done.passed else ("weak", "Not all pass")
    runs = "run" if count == 1 else "runs"
    said = f"{passed:,} of {count:,} {runs} {'is a pass' if passed == 1 else 'are a pass'}"
    others = [f"{done.counts[own]:,} {_WORDS[own].lower()}" for own in OUTCOMES[:-1] if done.counts[own]]
    return Page(
        "Batch of runs",
        ", ".join(robots[:8]) + (", …" if len(robots) > 8 else ""),
        Headline(key, word, f"{said}{': ' if others else ''}{', '.join(others)}."),
        list(_notes(done)),
        [
            section_of("Outcomes", _outcomes(done)),
            *_failures(done),
            *_misfits(done),
            section_of("Odd arms", *_odd(done)),
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
    columns = [("outcome", "left"), ("runs", "right"), ("share", "right")]
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
    columns = [("file", "left"), ("message", "left")]
    said = [
        row_of(clipped(row.file, 60), clipped("; ".join(_lines(row.message)), _LONGEST_MESSAGE))
        for row in rows[:_MOST_NAMED]
    ]
    return [section_of("Failures", table_of(_caption("Runs without a result", rows), columns, said))]


def _lines(message: str) -> list[str]:
    return [" ".join(line.split()) for line in message.splitlines()]


def _misfits(done: Batch) -> list[Section]:
    rows = [row for row in done.rows if row.outcome == "misfit"]
    if not rows:
        return []
    rows = sorted(rows, key=lambda row: -(row.factor or 0.0))
    columns = [("run", "left"), ("criteria", "left"), ("residuals / noise", "right"), ("p-value", "right")]
    said = [
        row_of(
            _run(row),
            ", ".join(_CRITERIA.get(own, own) for own in row.misfit),
            _NO_NUMBER if row.factor is None else numbers.times(row.factor),
            _NO_NUMBER if row.p_value is None else numbers.p_value(row.p_value),
            tone="unvalidated",
        )
        for row in rows[:_MOST_NAMED]
    ]
    about = Paragraph("The model does not describe these measurements: none of their offsets is validated.")
    return [section_of("Lack of fit", about, table_of(_caption("Misfits", rows), columns, said))]


def _odd(done: Batch) -> list[Block]:
    said = (
        "An identified offset is odd if it is an outlier among those of the runs of the same robot model"
        " (generalised extreme Studentised deviate test, for normal offsets). The chance of any false alarm"
        f" is {CHANCE:.0%} over all models and offsets; those with fewer than {FEWEST} values are not tested."
    )
    if not done.odd:
        return [Paragraph(f"None. {said}")]
    columns = [
        ("run", "left"),
        ("robot", "left"),
        ("serial", "left"),
        ("offset", "left"),
        ("estimate", "right"),
        ("standard deviations off", "right"),
    ]
    rows = [
        row_of(
            clipped(own.run, _LONGEST_NAME),
            clipped(own.robot, 24),
            clipped(own.serial, 24) if own.serial else _NO_NUMBER,
            person(own.offset),
            numbers.significant(own.estimate, 3, own.unit),
            numbers.significant(own.off, 2),
            tone="weak",
        )
        for own in done.odd[:_MOST_NAMED]
    ]
    return [Paragraph(said), table_of(_caption("Odd offsets", done.odd), columns, rows)]


def _largest(done: Batch) -> Table | None:
    rows = [(row, row.worst) for row in done.rows]
    known = [(row, worst) for row, worst in rows if worst is not None and worst.u is not None]
    if not known:
        return None
    known.sort(key=lambda pair: -(pair[1].u or 0.0))
    columns = [("run", "left"), ("outcome", "left"), ("offset", "left"), ("u", "right")]
    said = [row_of(_run(row), _outcome(row), label(worst.name), _u(worst)) for row, worst in known[:20]]
    return table_of(f"The {len(said)} largest", columns, said)


def _every(done: Batch) -> Table:
    rows = sorted(done.rows, key=lambda row: OUTCOMES.index(row.outcome))
    columns = [
        ("run", "left"),
        ("outcome", "left"),
        ("robot", "left"),
        ("serial", "left"),
        ("when", "left"),
        ("measurements", "right"),
        ("worst offset", "left"),
        ("u", "right"),
        ("residuals / noise", "right"),
        ("posterior", "left"),
    ]
    caption = "The gravest first; results are in the folders of these names"
    if len(rows) > _MOST_ROWS:
        caption += f". The first {_MOST_ROWS:,} of {len(rows):,}: runs.csv has all"
    return table_of(caption, columns, [_row(row) for row in rows[:_MOST_ROWS]])


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


def _u(own: BatchOffset) -> str:
    return _NO_NUMBER if own.u is None else numbers.spread(own.u, own.unit)


def _caption(what: str, rows: object) -> str:
    count = len(rows)  # type: ignore[arg-type]
    return what if count <= _MOST_NAMED else f"{what}: the first {_MOST_NAMED} of {count:,}, runs.csv has all"


_BINS = 36
_LEAST_RANGE = 4.0  # of the axis, so that it has ticks
_COLOUR = {"pass": "identified", "weak": "weak", "misfit": "misfit"}


def uncertainty_picture(rows: Sequence[BatchRow]) -> Picture | None:
    """A histogram on a logarithmic scale; None where no run has a number in degrees."""
    found: dict[str, list[float]] = {name: [] for name in _COLOUR}
    for row in rows:
        worst = row.worst
        if worst is not None and worst.unit == "deg" and worst.u is not None and row.outcome in found:
            found[row.outcome].append(worst.u)
    every = np.array([u for own in found.values() for u in own])
    if not len(every):
        return None
    low, high = float(every.min()) / 1.05, float(every.max()) * 1.05
    room = max(1.1, math.sqrt(_LEAST_RANGE * low / high))
    edges = np.geomspace(low, high, _BINS + 1)
    from matplotlib.ticker import MaxNLocator

    with style():
        figure = new_figure(2.2)
        axes = figure.subplots()
        shown = [name for name, own in found.items() if own]
        axes.hist(
            [found[name] for name in shown],
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


_MOST_PRINTED = 20


def print_batch(out: Console, done: Batch) -> None:
    """How many have which outcome, and the failures with the first line of their message."""
    page = batch_page(done)
    out.print(
        Text(f"{page.verdict.word}. ", style=VERDICT_STYLE[page.verdict.key]) + Text(page.verdict.sentence)
    )
    for text in page.notes:
        out.print(note(text))
    for block in page.sections[0].all:
        print_block(out, block)
    failed = [row for row in done.rows if row.outcome == "failed"]
    for row in failed[:_MOST_PRINTED]:
        first = row.message.splitlines()[0]
        out.print(Text(f"{clipped(row.file, 60)}: ", style="bold") + Text(clipped(first, 200)))
    if len(failed) > _MOST_PRINTED:
        out.print(Text(f"… and {len(failed) - _MOST_PRINTED} more failures, in runs.csv"))
