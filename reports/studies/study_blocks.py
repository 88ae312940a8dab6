"""Parts of the pages of studies: facts, shares of intervals with the true value, errors, verdicts, tables.

The mark of an estimator (or of a plan) says whether its intervals contain the true value as often as stated;
a control is wrong on purpose, so that it must fail.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol, cast

from ...experiments.studies.answer import NoiseLevel, ObservedParameter, PlanOfStudy, Share, StudyAnswer
from ...model.arrays import NORMAL_95
from ...model.records import keys
from ...words import numbers
from ...words.citation import study_citation
from ...words.wording import capital, clipped, counted, label, sentence, shown
from ..style.blocks import (
    Cell,
    Facts,
    LegendEntry,
    Page,
    Paragraph,
    Row,
    Section,
    Table,
    Verdict,
    row_of,
    section_of,
    table_of,
)

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40
BY_CHANCE = (
    "One binomial interval in twenty does not contain the level even if all is right, and the farthest of"
    " several more often."
)
# Whether a thing agrees, by (control, agrees): the mark (a role of the palette), the words, what it means.
_STANDING: dict[tuple[bool, bool], tuple[str, str, str]] = {
    (False, True): (
        "identified",
        "agrees",
        "the intervals contain the true value as often as stated, within the binomial error",
    ),
    (False, False): (
        "weak",
        "does not agree",
        "the intervals contain the true value more or less often than stated, beyond the binomial error",
    ),
    (True, False): (
        "held",
        "control: fails, as it must",
        "wrong on purpose, and detected: this study can find such a fault",
    ),
    (True, True): (
        "weak",
        "control: passes, but must not",
        "wrong on purpose, and not detected: this study could not find such a fault",
    ),
}

PlainRow = dict[str, object]  # a row of a CSV file by the names of its columns
Cells = Sequence[str | Cell]


class Marked(Protocol):
    """A part with a verdict and parameters: an estimator, its ranks, or a plan."""

    @property
    def name(self) -> str: ...
    @property
    def control(self) -> bool: ...
    @property
    def agrees(self) -> bool: ...
    @property
    def sentence(self) -> str: ...
    @property
    def parameters(self) -> Sequence[Any]: ...


# ── what every study says in the same words ───────────────────────────────────────────────────


def view_of(
    answer: StudyAnswer,
    subtitle: str,
    sections: Iterable[Section],
    tables: str,
    *,
    simulated: bool = True,
    by_the_paper: bool = True,
    details: Iterable[Section] = (),
    settings: Sequence[tuple[str, str]] | None = None,
) -> Page:
    """The whole page: verdict, notes and title are the answer's; without runs nothing was compared. The
    paper is cited for studies of its method. Behind
    the `sections` stands how it was done: the `settings` (default: the answer's), what the `tables` hold;
    `details` come last."""
    word = "Predicted" if not simulated else "Agrees" if answer.agrees else "Does not agree"
    seed, version = answer.settings.seed, answer.versions.get("zerobeam", "")
    facts = [
        ("Study", shown(answer.study)),
        *(settings_facts(answer) if settings is None else settings),
        ("Time", f"{numbers.significant(answer.seconds, 2)}{numbers.NO_BREAK}s"),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer.versions.items())),
        ("To cite", study_citation(answer.study, str(seed), version, by_the_paper=by_the_paper)),
    ]
    files = f"study.json beside this page holds every number unrounded; {tables} as plain tables."
    how = section_of("How it was done", Facts(facts), Paragraph(files))
    return Page(
        sentence(answer.title),
        f"{subtitle}, seed {seed}",
        Verdict("pass" if answer.agrees else "weak", word, sentence(answer.headline)),
        [sentence(note) for note in answer.notes],
        [*sections, how, *details],
    )


def settings_facts(answer: StudyAnswer) -> list[tuple[str, str]]:
    """The settings by their descriptions, as they were stated."""

    def text(value: object) -> str:
        if isinstance(value, bool):
            return "yes" if value else "no"
        if isinstance(value, int | float):
            return numbers.exact(value)
        return ", ".join(map(text, value)) if isinstance(value, tuple) else sentence(str(value))

    settings = answer.settings
    every = keys(cast(Any, type(settings)))
    return [(capital(one.description), text(getattr(settings, one.attribute))) for one in every]


def plan_title(name: str) -> str:
    return f"Plan {clipped(name, LONGEST_NAME)}"


def plan_facts(plan: PlanOfStudy, *more: tuple[str, str]) -> Facts:
    """A plan in words, its arm, measurements and noise, how many truths the arm could not meet, and more."""
    facts = [("Plan", sentence(plan.words)), ("Robot", clipped(plan.robot))]
    return Facts([*facts, ("Measurements", str(plan.shots)), ("Noise", noise_in_words(plan.noise)), *more])


def unmet_fact(failed: int) -> tuple[str, str]:
    """The truths for which the arm cannot hit the target."""
    return "Targets not hit", f"{failed} (others drawn in their place)" if failed else "none"


def plans_in_words(
    plans: Iterable[Any], noise: Callable[[Any], str], robot: Callable[[Any], str] = lambda plan: ""
) -> Section:
    """A section with each plan in a line."""
    facts = [
        (
            clipped(plan.name, LONGEST_NAME),
            f"{sentence(plan.words)} ({counted(plan.shots, 'measurement')}{robot(plan)};"
            f" noise: {noise(plan)})",
        )
        for plan in plans
    ]
    return section_of("Plans", Facts(facts), level=2)


def noise_in_words(noise: NoiseLevel) -> str:
    return f"joint {numbers.exact(noise.joint_deg, 'deg')}, spot {numbers.exact(noise.spot_mm, 'mm')}"


def spread(value: float | None, unit: str = "") -> str:
    """A standard deviation to two significant digits; it may be zero."""
    if value is None:
        return NOT_GIVEN
    return numbers.spread(value, unit) if value > 0 else numbers.exact(0, unit)


def spread_range(low: float | None, high: float | None, unit: str = "") -> str:
    """`low to high` of an interval whose ends lie factors apart: two significant digits each."""
    return NOT_GIVEN if low is None or high is None else f"{spread(low)} to {spread(high, unit)}"


def smallest_to_largest(values: Iterable[float | None], unit: str = "") -> str:
    """The range of those that are determined, and how many are not."""
    every = list(values)
    known = [value for value in every if value is not None]
    if not known:
        return NOT_DETERMINED
    text, lacking = spread_range(min(known), max(known), unit), len(every) - len(known)
    return f"{text}; {lacking} {NOT_DETERMINED}" if lacking else text


# ── verdicts ──────────────────────────────────────────────────────────────────────────────────


def standing(part: Any, *, control: bool = False) -> tuple[str, str]:
    """The mark and the words of an estimator, its ranks, or a share: agrees, fails, or fails as it must."""
    mark, words, _ = _STANDING[control or getattr(part, "control", False), part.agrees]
    return mark, words


def standing_cell(part: Any) -> Cell:
    mark, words = standing(part)
    return Cell(words, mark=mark)


def meanings(parts: Sequence[Marked], others: Sequence[Marked] = ()) -> list[LegendEntry]:
    """Entries of a legend: what each mark that occurs in `parts` and `others` means."""
    present = {(part.control, part.agrees) for part in (*parts, *others)}
    entries = [LegendEntry(*about) for key, about in _STANDING.items() if key in present]
    if any(not row.shares for part in parts for row in part.parameters):
        text = "unidentifiable from the data sets of this plan, so there is no interval to judge"
        entries.append(LegendEntry("unidentifiable", NOT_DETERMINED, text))
    return entries


def verdicts(parts: Iterable[Marked]) -> list[LegendEntry]:
    """Reasons of a legend: each part's name and standing, and its sentence."""
    rows = []
    for part in parts:
        mark, words = standing(part)
        name = clipped(part.name, LONGEST_NAME)
        rows.append(LegendEntry(mark, f"{name}: {words}.", sentence(part.sentence)))
    return rows


def rows_of(part: Marked, words: str, width: int, cells: Callable[[Any, bool], Cells | None]) -> list[Row]:
    """The row that heads a part, with its `words` and standing, and one for each parameter: `width` cells
    behind the name, of the parameter and whether the part is a control; None where it is not determined."""
    mark, verdict = standing(part)
    about = f"{sentence(words)} ({verdict})" if words else verdict
    rows = [row_of(clipped(part.name, LONGEST_NAME), Cell(about, span=width), tone=mark)]
    for parameter in part.parameters:
        name, values = label(parameter.name), cells(parameter, part.control)
        if values is None:
            rows.append(row_of(name, Cell(NOT_DETERMINED, span=width), tone="unidentifiable"))
        else:
            marked = any(isinstance(cell, Cell) and cell.mark for cell in values)
            rows.append(row_of(name, *values, tone="weak" if marked else ""))
    return rows


def parts_table(
    caption: str, columns: Sequence[str], parts: Iterable[Any], cells: Callable[[Any, bool], Cells | None]
) -> Table:
    """The parameters of each part under `columns`, behind their names."""
    rows = [row for part in parts for row in rows_of(part, getattr(part, "words", ""), len(columns), cells)]
    return table_of(caption, ["parameter", *columns], rows)


def overview(
    caption: str,
    columns: Sequence[str],
    groups: Iterable[tuple[str, str, Iterable[Any]]],
    cells: Callable[[Any], Cells],
    aligned: str = "llr",
) -> Table:
    """A row for each part of each group: its name, whether it agrees, and its cells. A group with a title has
    a row with its words above."""
    rows = []
    for title, words, parts in groups:
        if title:
            rows.append(row_of(title, Cell(words, span=len(columns) - 1)))
        for part in parts:
            # The verdict second, so that a phone shows it without scrolling.
            verdict = standing_cell(part)
            rows.append(row_of(clipped(part.name, LONGEST_NAME), verdict, *cells(part), tone=verdict.mark))
    return table_of(caption, columns, rows, aligned)


# ── shares of intervals ───────────────────────────────────────────────────────────────────────

FARTHEST = "Share of intervals that contain the true value, in %: the parameter farthest from"
SHARES = "Share of intervals that contain the true value, in %, with its 95 % binomial interval"


def percent(level: float) -> str:
    """A level of confidence as a heading: 0.95 → 95 %."""
    return f"{numbers.exact(100 * level)}{numbers.NO_BREAK}%"


def share(row: Any) -> str:
    """The share of intervals that held the truth, in per cent and without the sign."""
    return numbers.fixed(100 * row.share, _share_decimals(row.low, row.high, row.of))


def share_interval(low: float, high: float, of: int) -> str:
    """The binomial interval of a share of so many, `low to high` in per cent and without the sign."""
    digits = _share_decimals(low, high, of)
    return f"{numbers.fixed(100 * low, digits)} to {numbers.fixed(100 * high, digits)}"


def share_text(share: float, low: float, high: float, of: int) -> str:
    """A share with its binomial interval, in per cent and without the sign."""
    value = numbers.fixed(100 * share, _share_decimals(low, high, of))
    return f"{value} ({share_interval(low, high, of)})"


def _share_decimals(low: float, high: float, of: int) -> int:
    """By the binomial uncertainty, but no finer than the count itself: 948 of 1000 is 94.8 %."""
    std = 100 * (high - low) / (2 * NORMAL_95)
    return min(numbers.decimals(std), max(0, math.ceil(math.log10(of)) - 2))


def share_cell(entry: Share | None, control: bool) -> Cell:
    """A share with its interval, marked where it should agree and does not."""
    if entry is None:
        return Cell(NOT_GIVEN)
    text = share_text(entry.share, entry.low, entry.high, entry.of)
    return Cell(text, mark="" if control or entry.agrees else "weak")


def worst_at(part: Marked, level: float) -> tuple[ObservedParameter, Share] | None:
    """The parameter whose share at `level` is farthest from it, with its share; None if none has one.

    Measured in binomial standard deviations, since parameters may have different numbers of data sets.
    """
    entries = [(row, one) for row in part.parameters for one in row.shares if one.level == level]
    return max(entries, key=lambda entry: abs(entry[1].share - level) * math.sqrt(entry[1].of), default=None)


def worst_cell(part: Marked, level: float) -> str:
    worst = worst_at(part, level)
    return NOT_DETERMINED if worst is None else f"{label(worst[0].name, 12).split(' ')[0]}: {share(worst[1])}"


# ── errors, rounded by their own uncertainty ──────────────────────────────────────────────────

ERROR_COLUMNS = ("bias", "its standard error", "rmse", "predicted u")


def error_cells(row: ObservedParameter, runs: int) -> list[str | Cell] | None:
    """Cells under ERROR_COLUMNS, None where there are no errors; the rmse of n runs has the relative error
    1/√(2n)."""
    if row.status == "unidentifiable" or not row.bias_mcse or not row.rmse or row.bias is None:
        return None
    about = row.rmse / math.sqrt(2 * runs)
    predicted = row.predicted_std
    return [
        numbers.estimate(row.bias, row.bias_mcse, row.unit),
        numbers.spread(row.bias_mcse, row.unit),
        numbers.estimate(row.rmse, about, row.unit),
        NOT_GIVEN if predicted is None else numbers.estimate(predicted, about, row.unit),
    ]


def share_and_errors(row: Any, control: bool) -> list[str | Cell] | None:
    """The cells of a share and, under ERROR_COLUMNS, of the errors; None where there is no share."""
    if row.coverage is None:
        return None
    errors = error_cells(row, row.coverage.of) or [Cell(NOT_DETERMINED, span=len(ERROR_COLUMNS))]
    return [share_cell(row.coverage, control), *errors]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────

SHARE_COLUMNS = "held of share low high agrees"
ERRORS = "bias bias_mcse rmse predicted_std"


def flat(way: str, columns: str) -> Callable[[StudyAnswer], Iterator[PlainRow]]:
    """Rows of a CSV file: one for each part at the end of the `way` of attributes from the answer.

    A column is an attribute of that part, or `name=path`: the path begins with the number of a part on the
    way, 0 the answer. It is empty where there is nothing, and names are joined. A part that is None has a row
    of its own.
    """
    named = [column.partition("=")[::2] for column in columns.split()]

    def rows(answer: StudyAnswer) -> Iterator[PlainRow]:
        chains: list[tuple[object, ...]] = [(answer,)]
        for step in way.split():
            chains = [(*above, part) for above in chains for part in _parts(getattr(above[-1], step))]
        for chain in chains:
            yield {name: _at(chain, path or f"{len(chain) - 1}.{name}") for name, path in named}

    return rows


def _parts(value: Any) -> list[Any]:
    if isinstance(value, Mapping):
        return list(value.items())
    return list(value) if isinstance(value, tuple | list) else [value]


def _at(chain: tuple[object, ...], path: str) -> object:
    number, *names = path.split(".")
    value: Any = chain[int(number)]
    for name in names:
        if value is not None:
            value = value[int(name)] if name.isdigit() else getattr(value, name, None)
    return " ".join(value) if isinstance(value, tuple) else value


def columns_of(thing: object, *names: str, prefix: str = "") -> PlainRow:
    """Attributes as columns; empty where there is none."""
    return {f"{prefix}{name}": getattr(thing, name, None) for name in names}
