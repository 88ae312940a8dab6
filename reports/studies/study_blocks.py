"""What an entry of a study states, and what all studies say alike: verdicts, shares, errors, tables.

The mark of an estimator (or of a plan) says whether its intervals contain the true value as often as stated;
a control is wrong on purpose, so that it must fail.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar, cast

from ...experiments.studies.answer import (
    JudgedPart,
    NoiseLevel,
    ObservedParameter,
    PlanOfStudy,
    Share,
    StudyAnswer,
)
from ...model.arrays import NORMAL_95
from ...model.records import keys
from ...words import numbers
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
from ..style.canvas import Picture

PAPER = (
    "B. Gao, Y. Liu, N. Xi, Y. Shen: Developing an Efficient Calibration System for Joint Offset of"
    " Industrial Robots, Journal of Applied Mathematics 2014, 769343, doi:10.1155/2014/769343"
)


def study_citation(study: str, seed: str | None, version: str, *, by_the_paper: bool) -> str:
    """What to write of a study: program, version, study, seed; the article where its method is studied."""
    of_seed = "" if seed is None else f", seed {seed}"
    text = f"The zerobeam contributors: zerobeam {shown(version)}, study {shown(study)}{of_seed}."
    return f"{text} Method: {PAPER}." if by_the_paper else text


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
Columns = Sequence[tuple[str, Callable[[Any], str | Cell]]]  # head, and what stands there of a row
Answer = TypeVar("Answer", bound=StudyAnswer)


# ── how a study is shown ──────────────────────────────────────────────────────────────────────


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


@dataclass(frozen=True, kw_only=True)
class Study(Generic[Answer]):
    """How an answer of one kind is shown; all of it follows from the answer alone.

    `sections`, then how it was done (`settings`), then `details`; `drawn` figures, None where one has nothing
    to show; `tables`, rows by the name of the CSV file, which `hold` what. Without runs (`simulated`) nothing
    was compared. The paper is cited for studies of its method.
    """

    subtitle: Callable[[Answer], str]
    sections: Callable[[Answer], Iterable[Section]]
    hold: str
    tables: Mapping[str, Callable[[Answer], Iterator[PlainRow]]]
    drawn: Callable[[Answer], Sequence[Picture | None]] = lambda answer: ()
    details: Callable[[Answer], Iterable[Section]] = lambda answer: ()
    settings: Callable[[Answer], Sequence[tuple[str, str]]] = settings_facts
    simulated: Callable[[Answer], bool] = lambda answer: True
    by_the_paper: Callable[[Answer], bool] = lambda answer: True

    def page(self, answer: Answer) -> Page:
        """The whole page: verdict, notes and title are the answer's."""
        word = "Agrees" if answer.agrees else "Does not agree"
        seed, version = answer.settings.seed, answer.versions.get("zerobeam", "")
        by_the_paper = self.by_the_paper(answer)
        facts = [
            ("Study", shown(answer.study)),
            *self.settings(answer),
            ("Time", f"{numbers.significant(answer.seconds, 2)}{numbers.NO_BREAK}s"),
            ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer.versions.items())),
            ("To cite", study_citation(answer.study, str(seed), version, by_the_paper=by_the_paper)),
        ]
        files = f"study.json beside this page holds every number unrounded; {self.hold} as plain tables."
        how = section_of("How it was done", Facts(facts), Paragraph(files))
        return Page(
            sentence(answer.title),
            f"{self.subtitle(answer)}, seed {seed}",
            Verdict(
                "pass" if answer.agrees else "weak",
                word if self.simulated(answer) else "Predicted",
                sentence(answer.headline),
            ),
            [sentence(note) for note in answer.notes],
            [*self.sections(answer), how, *self.details(answer)],
        )

    def pictures(self, answer: Answer) -> dict[str, Picture]:
        """The figures by name."""
        return {picture.name: picture for picture in self.drawn(answer) if picture is not None}


# ── words ─────────────────────────────────────────────────────────────────────────────────────


def name_of(thing: Any) -> str:
    """The name of a plan or an estimator, fit to be shown."""
    return clipped(thing.name, LONGEST_NAME)


def plan_title(plan: Any) -> str:
    return f"Plan {name_of(plan)}"


def plan_facts(plan: PlanOfStudy, *counts: tuple[str, str], more: Iterable[tuple[str, str]] = ()) -> Facts:
    """A plan in words, its arm, measurements and noise; what was simulated, how many truths the arm could not
    meet, and more."""
    facts = [
        ("Plan", sentence(plan.words)),
        ("Robot", clipped(plan.robot)),
        ("Measurements", str(plan.shots)),
    ]
    unmet = f"{plan.failed} (others drawn in their place)" if plan.failed else "none"
    return Facts([*facts, ("Noise", noise_in_words(plan.noise)), *counts, ("Targets not hit", unmet), *more])


def plans_in_words(plans: Iterable[Any], noise: Callable[[Any], str]) -> Section:
    """A section with each plan in a line: its arm where it states one, and its noise."""
    facts = []
    for plan in plans:
        robot = f" of {clipped(plan.robot)}" if hasattr(plan, "robot") else ""
        about = f"{counted(plan.shots, 'measurement')}{robot}; noise: {noise(plan)}"
        facts.append((name_of(plan), f"{sentence(plan.words)} ({about})"))
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


def standing(part: Any, *, control: bool = False) -> Cell:
    """The mark and the words of an estimator, its ranks, or a share: agrees, fails, or fails as it must."""
    mark, words, _ = _STANDING[control or getattr(part, "control", False), part.agrees]
    return Cell(words, mark=mark)


def meanings(parts: Sequence[JudgedPart], others: Sequence[JudgedPart] = ()) -> list[LegendEntry]:
    """Entries of a legend: what each mark that occurs in `parts` and `others` means."""
    present = {(part.control, part.agrees) for part in (*parts, *others)}
    entries = [LegendEntry(*about) for key, about in _STANDING.items() if key in present]
    if any(not row.shares for part in parts for row in part.parameters):
        text = "unidentifiable from the data sets of this plan, so there is no interval to judge"
        entries.append(LegendEntry("unidentifiable", NOT_DETERMINED, text))
    return entries


def verdicts(parts: Iterable[JudgedPart]) -> list[LegendEntry]:
    """Reasons of a legend: each part's name and standing, and its sentence."""
    every = [(part, standing(part)) for part in parts]
    return [
        LegendEntry(at.mark, f"{name_of(part)}: {at.text}.", sentence(part.sentence)) for part, at in every
    ]


# ── tables ────────────────────────────────────────────────────────────────────────────────────


def table(
    caption: str,
    heads: Sequence[str],
    things: Iterable[Any],
    cells: Callable[[Any], Cells],
    aligned: str = "lr",
    tone: Callable[[Any], str] = lambda thing: "",
) -> Table:
    """A row for each thing, by its cells; `tone` is the status that colours it."""
    return table_of(caption, heads, [row_of(*cells(one), tone=tone(one)) for one in things], aligned)


def plans_table(
    caption: str,
    heads: Sequence[str],
    plans: Iterable[Any],
    cells: Callable[[Any], Cells],
    aligned: str = "lr",
) -> Table:
    """A row for each plan: its name, and its cells."""
    return table(caption, ["plan", *heads], plans, lambda plan: [name_of(plan), *cells(plan)], aligned)


def parts_table(
    caption: str,
    columns: Sequence[str],
    parts: Iterable[JudgedPart],
    cells: Callable[[Any, bool], Cells | None],
) -> Table:
    """The parameters of each part under `columns`, behind their names and below a row with the part's words
    and standing: `cells` are of a parameter and whether the part is a control, None where it is not
    determined."""
    rows, width = list[Row](), len(columns)
    for part in parts:
        verdict, words = standing(part), getattr(part, "words", "")
        about = f"{sentence(words)} ({verdict.text})" if words else verdict.text
        rows.append(row_of(name_of(part), Cell(about, span=width), tone=verdict.mark))
        for parameter in part.parameters:
            values = cells(parameter, part.control)
            tone = "weak" if any(isinstance(cell, Cell) and cell.mark for cell in values or ()) else ""
            tone = "unidentifiable" if values is None else tone
            rows.append(
                row_of(label(parameter.name), *(values or [Cell(NOT_DETERMINED, span=width)]), tone=tone)
            )
    return table_of(caption, ["parameter", *columns], rows)


def overview(
    caption: str,
    first: str,
    groups: Iterable[tuple[str, str, Iterable[Any]]],
    columns: Columns,
    aligned: str = "llr",
) -> Table:
    """A row for each part of each group: under `first` its name, then whether it agrees, so that a phone
    shows that without scrolling, and its `columns`. A group with a title has a row with its words above."""
    every: Columns = ((first, name_of), ("intervals", standing), *columns)
    rows = list[Row]()
    for title, words, parts in groups:
        rows += [row_of(title, Cell(words, span=len(every) - 1))] if title else []
        rows += [row_of(*(cell(one) for _, cell in every), tone=standing(one).mark) for one in parts]
    return table_of(caption, [head for head, _ in every], rows, aligned)


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


def farthest(level: float) -> Callable[[JudgedPart], str]:
    """A cell with the parameter whose share at `level` is farthest from it, and its share.

    Measured in binomial standard deviations, since parameters may have different numbers of data sets.
    """

    def cell(part: JudgedPart) -> str:
        entries = [(row, one) for row in part.parameters for one in row.shares if one.level == level]
        if not entries:
            return NOT_DETERMINED
        row, one = max(entries, key=lambda entry: abs(entry[1].share - level) * math.sqrt(entry[1].of))
        return f"{label(row.name, 12).split(' ')[0]}: {share(one)}"

    return cell


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


def flat(
    way: str,
    columns: str,
    last: Callable[..., Iterable[object]] | None = None,
    first: Callable[..., PlainRow] = lambda *chain: {},
) -> Callable[[StudyAnswer], Iterator[PlainRow]]:
    """Rows of a CSV file: one for each part at the end of the `way` of attributes from the answer, or for
    each of the parts that `last` has of all that is on that way; `first` has the first columns of a row.

    A column is an attribute of that part, or `name=path`: the path begins with the number of a part on the
    way, 0 the answer. Behind `1:` columns are attributes of part 1. It is empty where there is nothing, and
    names are joined. A part that is None has a row of its own.
    """
    named, of = list[tuple[str, str]](), ""
    for column in columns.split():
        name, _, path = column.partition("=")
        if name.endswith(":"):
            of = f"{name[:-1]}."
        else:
            named.append((name, path or (of and f"{of}{name}")))

    def rows(answer: StudyAnswer) -> Iterator[PlainRow]:
        chains: list[tuple[object, ...]] = [(answer,)]
        for step in way.split():
            chains = [(*above, part) for above in chains for part in _parts(getattr(above[-1], step))]
        if last is not None:
            chains = [(*above, part) for above in chains for part in last(*above)]
        for chain in chains:
            rest = {name: _at(chain, path or f"{len(chain) - 1}.{name}") for name, path in named}
            yield first(*chain) | rest

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
