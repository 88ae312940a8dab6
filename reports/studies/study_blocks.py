"""Parts of the pages of studies: facts, shares of intervals that hold the truth, errors, verdicts.

The mark of an estimator (or of a plan) says whether its intervals hold the truth as often as stated; a
control is wrong on purpose, so that it must fail.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Protocol, TypeVar

from ...experiments.studies.answer import (
    NoiseLevel,
    ObservedParameter,
    ParameterWithShare,
    Share,
    StudyAnswer,
)
from ...experiments.studies.sweeps.grid_answer import GridStudy
from ...model.arrays import NORMAL_95
from ...model.instruments.registry import kinds_of
from ...words import numbers
from ...words.citation import study_citation
from ...words.wording import clipped, counted, label, sentence, shown
from ..style.blocks import (
    Cell,
    Facts,
    LegendEntry,
    Page,
    Paragraph,
    Row,
    Section,
    Verdict,
    row_of,
    section_of,
)

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40
BY_CHANCE = (
    "One binomial interval in twenty does not contain the level even if all is right, and the farthest of"
    " several more often."
)
# Whether a thing agrees, by (control, agrees): the mark (a role of the palette) and the words for it.
STANDING: dict[tuple[bool, bool], tuple[str, str]] = {
    (False, True): ("identified", "agrees"),
    (False, False): ("weak", "does not agree"),
    (True, False): ("held", "control: fails, as it must"),
    (True, True): ("weak", "control: passes, but must not"),
}
_MEANING = {
    (False, True): "the intervals hold the truth as often as stated, within the binomial error",
    (False, False): "the intervals hold the truth more or less often than stated, beyond the binomial error",
    (True, False): "wrong on purpose, and detected: this study can find such a fault",
    (True, True): "wrong on purpose, and not detected: this study could not find such a fault",
}

PlainRow = dict[str, object]  # a row of a CSV file by the names of its columns


class NamedParameter(Protocol):
    """A parameter."""

    @property
    def name(self) -> str: ...


Parameter = TypeVar("Parameter", bound=NamedParameter, covariant=True)


class Marked(Protocol):
    """A part with a verdict: an estimator, its ranks, or a plan."""

    @property
    def name(self) -> str: ...
    @property
    def control(self) -> bool: ...
    @property
    def agrees(self) -> bool: ...
    @property
    def sentence(self) -> str: ...


class MarkedGroup(Marked, Protocol[Parameter]):
    """The same with its parameters."""

    @property
    def parameters(self) -> Sequence[Parameter]: ...


Judged = MarkedGroup[ObservedParameter]


# ── what every study says in the same words ───────────────────────────────────────────────────


def view_of(answer: StudyAnswer, subtitle: str, sections: list[Section], *, simulated: bool = True) -> Page:
    """The whole page: verdict, notes and title are the answer's; without runs nothing was compared."""
    word = "Predicted" if not simulated else "Agrees" if answer.agrees else "Does not agree"
    return Page(
        sentence(answer.title),
        subtitle,
        Verdict("pass" if answer.agrees else "weak", word, sentence(answer.headline)),
        [sentence(note) for note in answer.notes],
        sections,
    )


def plan_title(name: str) -> str:
    return f"Plan {clipped(name, LONGEST_NAME)}"


def plan_in_words(words: str, shots: int, noise: str, robot: str | None = None) -> str:
    """A plan, its measurements, its robot (if any) and its noise in words."""
    of_robot = f" of {clipped(robot)}" if robot is not None else ""
    return f"{sentence(words)} ({counted(shots, 'measurement')}{of_robot}; noise: {noise})"


def noise_in_words(noise: NoiseLevel) -> str:
    return f"joint {numbers.exact(noise.joint_deg, 'deg')}, spot {numbers.exact(noise.spot_mm, 'mm')}"


def unmet_in_words(failed: int) -> str:
    """The truths for which the arm cannot hit the target."""
    return f"{failed} (others drawn in their place)" if failed else "none"


def how_it_was_done(answer: StudyAnswer, settings: list[tuple[str, str]], tables: str) -> Section:
    """The study's name, its settings, time and versions; `tables` names the CSV files and what they hold."""
    facts = [
        ("Study", shown(answer.study)),
        *settings,
        ("Time", f"{numbers.significant(answer.seconds, 2)}{numbers.NO_BREAK}s"),
        ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer.versions.items())),
        ("To cite", _citation(answer, dict(settings).get("Seed"))),
    ]
    files = f"study.json beside this page holds every number unrounded; {tables} as plain tables."
    return section_of("How it was done", Facts(facts), Paragraph(files))


_OTHER_METHODS = ("drift", "instruments")


def _citation(answer: StudyAnswer, seed: str | None) -> str:
    """Of studies of other methods than a beam on a target without the article."""
    if isinstance(answer, GridStudy):
        by_the_paper = any(kind.beam for kind in kinds_of(answer.settings.as_in_file()).values())
    else:
        by_the_paper = answer.study not in _OTHER_METHODS
    version = answer.versions.get("zerobeam", "")
    return study_citation(answer.study, seed, version, by_the_paper=by_the_paper)


def seconds(value: float | None) -> str:
    """A time to three significant digits."""
    return NOT_GIVEN if value is None else numbers.significant(value, 3, "s")


def spread(value: float | None, unit: str = "") -> str:
    """A standard deviation to two significant digits; it may be zero."""
    return (
        NOT_GIVEN if value is None else numbers.spread(value, unit) if value > 0 else numbers.exact(0, unit)
    )


def spread_range(low: float | None, high: float | None, unit: str = "") -> str:
    """`low to high` of an interval whose ends lie factors apart: two significant digits each."""
    return NOT_GIVEN if low is None or high is None else f"{spread(low)} to {spread(high, unit)}"


# ── verdicts ──────────────────────────────────────────────────────────────────────────────────


def standing(part: Marked) -> tuple[str, str]:
    """The mark and the words of an estimator, or of its ranks: agrees, fails, or fails as it must."""
    return STANDING[part.control, part.agrees]


def standing_cell(part: Marked) -> Cell:
    mark, words = standing(part)
    return Cell(words, mark=mark)


def meanings(parts: Sequence[Judged], others: Sequence[Marked] = ()) -> list[LegendEntry]:
    """Entries of a legend: what each mark that occurs in `parts` and `others` means."""
    present = {(part.control, part.agrees) for part in (*parts, *others)}
    entries = [LegendEntry(*STANDING[key], text) for key, text in _MEANING.items() if key in present]
    if any(not row.shares for part in parts for row in part.parameters):
        text = "unidentifiable from the data sets of this plan, so there is no interval to judge"
        entries.append(LegendEntry("unidentifiable", NOT_DETERMINED, text))
    return entries


def verdicts(parts: Sequence[Marked]) -> list[LegendEntry]:
    """Reasons of a legend: each part's name and standing, and its sentence."""
    rows = []
    for part in parts:
        mark, words = standing(part)
        name = clipped(part.name, LONGEST_NAME)
        rows.append(LegendEntry(mark, f"{name}: {words}.", sentence(part.sentence)))
    return rows


def undetermined(parts: Iterable[Judged]) -> list[str]:
    """Names of the parameters that have no interval, by any part but a control."""
    names = [row.name for part in parts if not part.control for row in part.parameters if not row.shares]
    return [label(name) for name in dict.fromkeys(names)]


def rows_of(
    part: MarkedGroup[Parameter],
    words: str,
    width: int,
    cells: Callable[[Parameter, bool], Sequence[str | Cell] | None],
) -> list[Row]:
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


# ── shares of intervals ───────────────────────────────────────────────────────────────────────


def percent(level: float) -> str:
    """A level of confidence as a heading: 0.95 → 95 %."""
    return f"{numbers.exact(100 * level)}{numbers.NO_BREAK}%"


def share(row: Share) -> str:
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


def worst_at(part: Judged, level: float) -> tuple[ObservedParameter, Share] | None:
    """The parameter whose share at `level` is farthest from it, with its share; None if none has one.

    Measured in binomial standard deviations, since parameters may have different numbers of data sets.
    """
    entries = [
        (abs(entry.share - level) * math.sqrt(entry.of), row, entry)
        for row in part.parameters
        for entry in row.shares
        if entry.level == level
    ]
    if not entries:
        return None
    _, row, entry = max(entries, key=lambda item: item[0])
    return row, entry


def worst_cell(part: Judged, level: float) -> str:
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


def share_and_errors(row: ParameterWithShare, control: bool) -> list[str | Cell] | None:
    """The cells of a share and, under ERROR_COLUMNS, of the errors; None where there is no share."""
    if row.coverage is None:
        return None
    errors = error_cells(row, row.coverage.of) or [Cell(NOT_DETERMINED, span=len(ERROR_COLUMNS))]
    return [share_cell(row.coverage, control), *errors]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────

ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std")
_SHARE = ("held", "of", "share", "low", "high", "agrees")


def columns_of(thing: object, *keys: str, prefix: str = "") -> PlainRow:
    """Attributes as columns; empty where there is none."""
    return {f"{prefix}{key}": getattr(thing, key, None) for key in keys}


def share_columns(entry: Share | None) -> PlainRow:
    return columns_of(entry, *_SHARE)


def parameter_columns(
    part: Marked, row: ParameterWithShare, level: float, *keys: str, **of_part: object
) -> PlainRow:
    """A parameter, its share and errors as columns, behind those `of_part`; `keys` are more attributes."""
    return {
        **of_part,
        "control": part.control,
        "parameter": row.name,
        **columns_of(row, "unit", "status"),
        "level": level,
        **share_columns(row.coverage),
        **columns_of(row, *ERRORS, *keys),
    }
