"""How often intervals hold the truth, and what that says of who made them.

The mark of an estimator (or of a plan) says whether its intervals hold what they promise; a control is
wrong on purpose, so that to fail is what is asked of it. Such a part is {name, control, agrees,
parameters}, a parameter has `status` and `coverage`, a list of {level, held, of, share, low, high, agrees}.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from ..style.blocks import Cell, LegendEntry, Reason
from ..words import numbers
from ..words.wording import clipped, label, sentence
from .study_view import LONGEST_NAME, NOT_DETERMINED, NOT_GIVEN

Json = dict[str, Any]

BY_CHANCE = (
    "One binomial interval in twenty misses the level by chance, and the farthest of several more often."
)
# Whether a thing agrees, by (control, agrees): the mark (a role of the palette) and the words for it.
STANDING: dict[tuple[bool, bool], tuple[str, str]] = {
    (False, True): ("identified", "agrees"),
    (False, False): ("weak", "does not agree"),
    (True, False): ("held", "control: fails, as it must"),
    (True, True): ("weak", "control: passes, but must not"),
}
_MEANING = {
    (False, True): "the intervals hold the truth as often as they promise, within the binomial error",
    (False, False): "they hold it more or less often, beyond the binomial error",
    (True, False): "wrong on purpose, and seen to be wrong: this study can find such a fault",
    (True, True): "wrong on purpose, and not seen to be: this study could not find such a fault",
}
_NORMAL_95 = 1.959964  # half width of a 95 % interval in standard deviations


def standing(part: Json) -> tuple[str, str]:
    """The mark and the words of an estimator, or of its ranks: agrees, fails, or fails as it must."""
    return STANDING[part["control"], part["agrees"]]


def meanings(parts: list[Json]) -> list[LegendEntry]:
    """Entries of a legend: what each mark that occurs means."""
    present = {(part["control"], part["agrees"]) for part in parts}
    entries = [LegendEntry(*STANDING[key], text) for key, text in _MEANING.items() if key in present]
    if any(
        not determined(row, part["control"])
        for part in parts
        for row in part["parameters"]
        if "coverage" in row
    ):
        text = "a data set of this plan cannot tell the parameter, so there is no interval to judge"
        entries.append(LegendEntry("unidentifiable", NOT_DETERMINED, text))
    return entries


def verdicts(parts: list[Json]) -> list[Reason]:
    """Reasons of a legend: each part's name and standing, and what it says."""
    rows = []
    for part in parts:
        mark, words = standing(part)
        name = clipped(part["name"], LONGEST_NAME)
        rows.append(Reason(f"{name}: {words}.", mark, sentence(part["sentence"])))
    return rows


def determined(row: Json, control: bool) -> bool:
    """Whether a parameter has shares to print.

    One that a data set cannot tell has none, whatever the answer holds, unless a control claims to
    know it: that the truth is not in its intervals is what the control is there to show.
    """
    solved_any = bool(row["coverage"]) and all(entry["of"] for entry in row["coverage"])
    return solved_any and (control or row["status"] != "unidentifiable")


def undetermined(parts: Iterable[Json]) -> list[str]:
    """Names of the parameters that a data set cannot tell, by any part but a control."""
    names = [
        row["name"]
        for part in parts
        if not part["control"]
        for row in part["parameters"]
        if not determined(row, control=False)
    ]
    return [label(name) for name in dict.fromkeys(names)]


def percent(level: float) -> str:
    """A level of confidence as a heading: 0.95 → 95 %."""
    return f"{numbers.exact(100 * level)}{numbers.NO_BREAK}%"


def share(row: Json) -> str:
    """The share of intervals that held the truth, in per cent and without the sign."""
    return numbers.fixed(100 * row["share"], _share_decimals(row))


def share_interval(row: Json) -> str:
    """The binomial interval of such a share, `low to high` in per cent and without the sign."""
    digits = _share_decimals(row)
    return f"{numbers.fixed(100 * row['low'], digits)} to {numbers.fixed(100 * row['high'], digits)}"


def _share_decimals(row: Json) -> int:
    """By the binomial uncertainty, but no finer than the count itself: 948 of 1000 is 94.8 %."""
    std = 100 * (row["high"] - row["low"]) / (2 * _NORMAL_95)
    return min(numbers.decimals(std), max(0, math.ceil(math.log10(row["of"])) - 2))


def share_cell(entry: Json | None, control: bool) -> Cell:
    """A share with its interval, marked where it should agree and does not."""
    if entry is None:
        return Cell(NOT_GIVEN)
    return Cell(
        f"{share(entry)} ({share_interval(entry)})", mark="" if control or entry["agrees"] else "weak"
    )


def worst_at(part: Json, level: float) -> tuple[Json, Json] | None:
    """The parameter whose share at `level` is farthest from it, with its share; None if none has one.

    Measured in binomial standard deviations, since parameters may have different numbers of data sets.
    """
    found = [
        (abs(entry["share"] - level) * math.sqrt(entry["of"]), row, entry)
        for row in part["parameters"]
        if determined(row, part["control"])
        for entry in row["coverage"]
        if entry["level"] == level
    ]
    if not found:
        return None
    _, row, entry = max(found, key=lambda item: item[0])
    return row, entry


def worst_cell(part: Json, level: float) -> str:
    worst = worst_at(part, level)
    return NOT_DETERMINED if worst is None else f"{label(worst[0]['name'], 12)}: {share(worst[1])}"


# ── errors, rounded by their own uncertainty ──────────────────────────────────────────────────

ERROR_COLUMNS = [
    ("bias", "right"),
    ("its standard error", "right"),
    ("rmse", "right"),
    ("predicted std", "right"),
]


def has_errors(row: Json) -> bool:
    """Whether bias and rmse of a parameter mean anything."""
    return (
        row["status"] != "unidentifiable"
        and row["bias"] is not None
        and bool(row["bias_mcse"] and row["rmse"])
    )


def error_cells(row: Json, data_sets: int) -> list[str | Cell]:
    """Cells under ERROR_COLUMNS; the rmse of n data sets has the relative error 1/√(2n)."""
    if not has_errors(row):
        return [Cell(NOT_DETERMINED, span=len(ERROR_COLUMNS))]
    unit, mcse, rmse = row["unit"], row["bias_mcse"], row["rmse"]
    about = rmse / math.sqrt(2 * data_sets)
    predicted = row["predicted_std"]
    return [
        numbers.estimate(row["bias"], mcse, unit),
        numbers.spread(mcse, unit),
        numbers.estimate(rmse, about, unit),
        NOT_GIVEN if predicted is None else numbers.estimate(predicted, about, unit),
    ]
