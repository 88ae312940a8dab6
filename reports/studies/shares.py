"""How often intervals hold the truth, and the verdict on the estimator that they are of.

The mark of an estimator (or of a plan) says whether its intervals hold the truth as often as stated; a
control is wrong on purpose, so that it must fail.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Protocol

from ...experiments.studies.answer import ObservedParameter, Share
from ...model.arrays import NORMAL_95
from ...words import numbers
from ...words.wording import clipped, label, sentence
from ..style.blocks import Cell, LegendEntry
from .phrases import LONGEST_NAME, NOT_DETERMINED, NOT_GIVEN

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


class Marked(Protocol):
    """What has a verdict: an estimator, its ranks, or a plan."""

    @property
    def name(self) -> str: ...
    @property
    def control(self) -> bool: ...
    @property
    def agrees(self) -> bool: ...
    @property
    def sentence(self) -> str: ...


class Judged(Marked, Protocol):
    """The same with the parameters whose intervals are judged."""

    @property
    def parameters(self) -> Sequence[ObservedParameter]: ...


def standing(part: Marked) -> tuple[str, str]:
    """The mark and the words of an estimator, or of its ranks: agrees, fails, or fails as it must."""
    return STANDING[part.control, part.agrees]


def meanings(parts: Sequence[Judged], others: Sequence[Marked] = ()) -> list[LegendEntry]:
    """Entries of a legend: what each mark that occurs in `parts` and `others` means."""
    present = {(part.control, part.agrees) for part in (*parts, *others)}
    entries = [LegendEntry(*STANDING[key], text) for key, text in _MEANING.items() if key in present]
    if any(not row.shares for part in parts for row in part.parameters):
        text = "unidentifiable from the data sets of this plan, so there is no interval to judge"
        entries.append(LegendEntry("unidentifiable", NOT_DETERMINED, text))
    return entries


def verdicts(parts: Sequence[Marked]) -> list[LegendEntry]:
    """Reasons of a legend: each part's name and standing, and what it says."""
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
    found = [
        (abs(entry.share - level) * math.sqrt(entry.of), row, entry)
        for row in part.parameters
        for entry in row.shares
        if entry.level == level
    ]
    if not found:
        return None
    _, row, entry = max(found, key=lambda item: item[0])
    return row, entry


def worst_cell(part: Judged, level: float) -> str:
    worst = worst_at(part, level)
    return NOT_DETERMINED if worst is None else f"{label(worst[0].name, 12)}: {share(worst[1])}"


# ── errors, rounded by their own uncertainty ──────────────────────────────────────────────────

ERROR_COLUMNS = [
    ("bias", "right"),
    ("its standard error", "right"),
    ("rmse", "right"),
    ("predicted u", "right"),
]


def error_cells(row: ObservedParameter, runs: int) -> list[str | Cell]:
    """Cells under ERROR_COLUMNS; the rmse of n runs has the relative error 1/√(2n)."""
    if row.status == "unidentifiable" or not row.bias_mcse or not row.rmse or row.bias is None:
        return [Cell(NOT_DETERMINED, span=len(ERROR_COLUMNS))]
    about = row.rmse / math.sqrt(2 * runs)
    predicted = row.predicted_std
    return [
        numbers.estimate(row.bias, row.bias_mcse, row.unit),
        numbers.spread(row.bias_mcse, row.unit),
        numbers.estimate(row.rmse, about, row.unit),
        NOT_GIVEN if predicted is None else numbers.estimate(predicted, about, row.unit),
    ]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────

PlainRow = dict[str, object]  # a row of a CSV file by the names of its columns


def share_columns(entry: Share | None) -> PlainRow:
    """The columns of a share; empty where there is none."""
    return {key: getattr(entry, key, None) for key in ("held", "of", "share", "low", "high", "agrees")}
