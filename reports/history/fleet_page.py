"""The page of all arms: what to do first, how many are due and when, every arm with the gravest first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property

from ...experiments.history.arm_drift import NOT_SOON
from ...experiments.history.documents import STATES, ArmState, State
from ...experiments.history.fleet_drift import FleetDrift
from ...words import numbers
from ...words.wording import clipped, counted, listed
from ..style.blocks import Bar, Bars, Cell, Facts, Page, Row, Section, Table, row_of, section_of, table_of
from ..style.blocks import Verdict as Headline
from .arm_page import DUE_MEANS, KEYS, MARKS, WORDS
from .history_tables import clearest_jump, fleet_blocks, verdict_cell, with_labels

MOST_ROWS = 1000  # on the page, and with a page of their own
_MOST_REASONS = 50
_NO_TEXT = "—"
_TO_DO: dict[State, str] = {
    "overdue": "calibrate now",
    "jump without event": "find out what happened, and log it: zerobeam history event",
    "jump": "look at the arm’s page: an event was logged when it jumped",
    "misfit": "see the report of the last result for what explains it, and measure again",
    "no due date": "see why below",
    "on schedule": "nothing before the due date",
}


@dataclass(frozen=True, eq=False)
class Fleet:
    """All arms of a history, the gravest first; `pages` has the file of an arm's page by serial number and
    model, `as_of` is None without any result. `drift` is what they say together."""

    rows: tuple[ArmState, ...]
    pages: Mapping[tuple[str, str], str]
    tolerance_mm: float
    as_of: datetime | None
    drift: FleetDrift

    @cached_property
    def counts(self) -> dict[State, int]:
        """How many arms are in each state, the gravest first."""
        numbers_of = Counter(row.state for row in self.rows)
        return {state: numbers_of[state] for state in STATES}


def fleet_page(fleet: Fleet) -> Page:
    """The display strings of all arms."""
    models = sorted({clipped(row.model) for row in fleet.rows})
    facts = [("Arms", f"{len(fleet.rows):,}"), ("Results", f"{sum(row.results for row in fleet.rows):,}")]
    facts.append(("Tolerance at the TCP", numbers.exact(fleet.tolerance_mm, "mm")))
    if fleet.as_of is not None:
        facts.append(("As of", f"{fleet.as_of:%Y-%m-%d}"))
    sections = [
        section_of("What to do", _counts(fleet), due_bars(fleet)),
        *_reasons(fleet),
        section_of("All arms", _every(fleet)),
        *_together(fleet),
        section_of("How it is worked out", Facts(list(_about()))),
    ]
    return Page(
        "All arms",
        listed(models) if models else "No arm",
        headline(fleet),
        [],
        sections if fleet.rows else [],
        facts,
    )


def headline(fleet: Fleet) -> Headline:
    """The gravest state that an arm is in, and how many are in each."""
    count = len(fleet.rows)
    if not count:
        return Headline(
            "degenerate", "No arms", "The history has no arm yet: zerobeam history add adds results."
        )
    gravest = next(state for state, number in fleet.counts.items() if number)
    parts = [f"{number:,} {state}" for state, number in fleet.counts.items() if number]
    arms = "1 arm" if count == 1 else f"{count:,} arms"
    return Headline(KEYS[gravest], WORDS[gravest], f"Of {arms}: {', '.join(parts)}.")


def _counts(fleet: Fleet) -> Table:
    columns = ["state", "arms", "what to do"]
    rows = [row_of(state, f"{number:,}", _TO_DO[state]) for state, number in fleet.counts.items() if number]
    return table_of("Arms by state, the gravest first", columns, rows, "lrl")


def _reasons(fleet: Fleet) -> Iterator[Section]:
    """Why arms have no due date, or are due already; the reason of most arms first."""
    by_reason: dict[str, list[str]] = {}
    for row in fleet.rows:
        reason = row.next_due.reason
        if reason and reason != NOT_SOON:
            by_reason.setdefault(reason, []).append(clipped(row.serial, 24))
    if not by_reason:
        return
    columns = ["why", "arms", "which"]
    ordered = sorted(by_reason.items(), key=lambda pair: -len(pair[1]))[:_MOST_REASONS]
    rows = [row_of(with_labels(why), f"{len(arms):,}", listed(arms, 4)) for why, arms in ordered]
    caption = "The reason of most arms first"
    if len(by_reason) > _MOST_REASONS:
        caption += f". {_MOST_REASONS} of {len(by_reason):,}: fleet.csv has all"
    yield section_of("Why due now, or without a date", table_of(caption, columns, rows, "lrl"))


def _together(fleet: Fleet) -> Iterator[Section]:
    blocks = list(fleet_blocks(fleet.drift))
    if blocks:
        yield section_of("Models, joints and instruments", *blocks)


def _every(fleet: Fleet) -> Table:
    columns = ["arm", "state", "model", "due", "clearest jump", "results", "last", "verdict"]
    caption = "The gravest first, then by due date; each arm leads to its page"
    if len(fleet.rows) > MOST_ROWS:
        caption += f". The first {MOST_ROWS:,} of {len(fleet.rows):,}: fleet.csv and fleet.json have all"
    return table_of(caption, columns, [_row(fleet, row) for row in fleet.rows[:MOST_ROWS]], "lllrrrrl")


def _row(fleet: Fleet, row: ArmState) -> Row:
    return row_of(
        Cell(clipped(row.serial, 20), link=fleet.pages.get((row.serial, row.model), "")),
        Cell(row.state, mark=MARKS[row.state]),
        clipped(row.model, 20),
        _NO_TEXT if row.due is None else f"{row.due:%Y-%m-%d}",
        clearest_jump(row.clearest, row.undecided) or _NO_TEXT,
        f"{row.counted} of {row.results}" if row.counted < row.results else str(row.results),
        _NO_TEXT if row.last is None else f"{row.last:%Y-%m-%d}",
        _NO_TEXT if row.verdict is None else verdict_cell(row.verdict, row.judged),
    )


def _about() -> Iterator[tuple[str, str]]:
    yield "Due date", DUE_MEANS
    yield (
        "Overdue",
        "due on the day of this page or before; or what may have changed the arm was logged since",
    )
    yield "Results", "those that count of all, where a misfit or an older result does not"
    yield "Files", "arms/ has a page of each arm; fleet.json and fleet.csv have a row for every arm"


_MONTHS = 24
_NAMES = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")


def due_counts(rows: Sequence[ArmState], as_of: datetime) -> tuple[int, list[tuple[int, int, int]], int]:
    """How many arms are overdue; year, month and number of those due in each of the next 24 months; how many
    are later, or not within the horizon."""
    overdue = sum(row.state == "overdue" for row in rows)
    months = [(as_of.year * 12 + as_of.month - 1 + ahead) for ahead in range(_MONTHS)]
    due_in = dict.fromkeys(months, 0)
    later = 0
    for row in rows:
        if row.state == "overdue" or (row.due is None and row.state == "no due date"):
            continue
        month = None if row.due is None else row.due.year * 12 + row.due.month - 1
        if month in due_in:
            due_in[month] += 1
        elif month is not None or row.state == "on schedule":
            later += 1
    return overdue, [(month // 12, month % 12 + 1, number) for month, number in due_in.items()], later


def due_bars(fleet: Fleet) -> Bars | None:
    """A bar for each month that an arm is due in; None where no arm has a due date."""
    if fleet.as_of is None:
        return None
    overdue, months, later = due_counts(fleet.rows, fleet.as_of)
    named = [(f"{_NAMES[month - 1]} {year}", number, "identified") for year, month, number in months]
    every = [("overdue", overdue, "misfit"), *named, ("later", later, "held")]
    bars = [Bar(name, number, counted(number, "arm"), tone) for name, number, tone in every if number]
    caption = f"Arms by the month in which the next calibration is due, from {fleet.as_of:%Y-%m-%d}"
    return Bars(caption, bars) if bars else None
