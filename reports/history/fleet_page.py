"""The page of all arms: what to do first, how many are due and when, every arm with the gravest first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime

from ...experiments.history.arm_drift import NOT_SOON
from ...experiments.history.arm_history import STATES, ArmState, State
from ...experiments.history.fleet_drift import Fleet
from ...words import numbers
from ...words.wording import clipped, counted, listed
from ..style.blocks import Bar, Bars, Cell, Columns, Facts, Page, Section, Table, section_of, table_by
from ..style.blocks import Verdict as Headline
from .arm_page import DUE_MEANS, STATE_WORDS
from .history_tables import clearest_jump, date_or, fleet_blocks, verdict_cell, with_labels

MOST_ROWS = 1000  # on the page, and with a page of their own
_MOST_REASONS = 50
_NO_TEXT = "—"


def fleet_page(fleet: Fleet) -> Page:
    """The display strings of all arms."""
    models = sorted({clipped(row.model) for row in fleet.arms})
    facts = [("Arms", f"{len(fleet.arms):,}"), ("Results", f"{sum(row.results for row in fleet.arms):,}")]
    facts.append(("Tolerance at the TCP, offsets alone", numbers.exact(fleet.tolerance_mm, "mm")))
    if fleet.as_of is not None:
        facts.append(("As of", fleet.as_of))
    together = list(fleet_blocks(fleet.drift))
    sections = [
        section_of("What to do", _counts(fleet), due_bars(fleet)),
        *_reasons(fleet),
        section_of("All arms", _every(fleet)),
        *([section_of("Models, joints and instruments", *together)] if together else []),
        section_of("How it is worked out", Facts(list(_about()))),
    ]
    return Page(
        "All arms",
        listed(models) if models else "No arm",
        headline(fleet),
        [],
        sections if fleet.arms else [],
        facts,
    )


def headline(fleet: Fleet) -> Headline:
    """The gravest state that an arm is in, and how many are in each."""
    count = len(fleet.arms)
    if not count:
        return Headline(
            "degenerate", "No arms", "The history has no arm yet: zerobeam history add adds results."
        )
    present = _present(fleet)
    parts = [f"{number:,} {state}" for state, number in present]
    first = STATE_WORDS[present[0][0]]
    arms = "1 arm" if count == 1 else f"{count:,} arms"
    return Headline(first.role, first.word, f"Of {arms}: {', '.join(parts)}.")


def _present(fleet: Fleet) -> list[tuple[State, int]]:
    """The states that an arm is in, the gravest first, with how many are."""
    return [(state, number) for state in STATES if (number := fleet.states[state])]


def _counts(fleet: Fleet) -> Table:
    columns: Columns[tuple[State, int]] = {
        "state": lambda row: row[0],
        "arms": lambda row: f"{row[1]:,}",
        "what to do": lambda row: STATE_WORDS[row[0]].to_do,
    }
    return table_by("Arms by state, the gravest first", _present(fleet), columns, "lrl")


def _reasons(fleet: Fleet) -> Iterator[Section]:
    """Why arms have no due date, or are due already; the reason of most arms first."""
    by_reason: dict[str, list[str]] = {}
    for row in fleet.arms:
        reason = row.next_due.reason
        if reason and reason != NOT_SOON:
            by_reason.setdefault(reason, []).append(clipped(row.serial, 24))
    if not by_reason:
        return
    ordered = sorted(by_reason.items(), key=lambda pair: -len(pair[1]))[:_MOST_REASONS]
    columns: Columns[tuple[str, list[str]]] = {
        "why": lambda row: with_labels(row[0]),
        "arms": lambda row: f"{len(row[1]):,}",
        "which": lambda row: listed(row[1], 4),
    }
    caption = "The reason of most arms first"
    if len(by_reason) > _MOST_REASONS:
        caption += f". {_MOST_REASONS} of {len(by_reason):,}: fleet.csv has all"
    yield section_of("Why due now, or without a date", table_by(caption, ordered, columns, "lrl"))


def _every(fleet: Fleet) -> Table:
    """Every arm. Few arms have jumped: the clearest jump stands beside the state, and has no column."""
    caption = "The gravest first, then by due date; each arm leads to its page"
    if len(fleet.arms) > MOST_ROWS:
        caption += f". The first {MOST_ROWS:,} of {len(fleet.arms):,}: fleet.csv and fleet.json have all"
    one_model = len({row.model for row in fleet.arms}) == 1  # in the subtitle
    columns: Columns[ArmState] = {
        "arm": lambda row: Cell(clipped(row.serial, 20), link=row.page or ""),
        "state": lambda row: Cell(_state(row), mark=STATE_WORDS[row.state].mark),
        "model": lambda row: "" if one_model else clipped(row.model, 20),
        "due": lambda row: date_or(row.due, _NO_TEXT),
        "results": lambda row: (
            f"{row.counted} of {row.results}" if row.counted < row.results else str(row.results)
        ),
        "last": lambda row: date_or(row.last, _NO_TEXT),
        "verdict": lambda row: (
            _NO_TEXT if row.verdict is None else verdict_cell(row.verdict, row.judged, row.simulated)
        ),
    }
    return table_by(caption, fleet.arms[:MOST_ROWS], columns, "lllrrrl")


def _state(row: ArmState) -> str:
    return ": ".join(filter(None, (row.state, _clearest(row))))


def _clearest(row: ArmState) -> str:
    jump = row.clearest_jump
    return clearest_jump(jump, row.undecided, jump is not None and jump.assumed)


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
    if fleet.asked is None:
        return None
    overdue, months, later = due_counts(fleet.arms, fleet.asked)
    named = [(f"{_NAMES[month - 1]} {year}", number, "identified") for year, month, number in months]
    every = [("overdue", overdue, "misfit"), *named, ("later", later, "held")]
    bars = [Bar(name, number, counted(number, "arm"), tone) for name, number, tone in every if number]
    caption = f"Arms by the month in which the next calibration is due, from {fleet.as_of}"
    return Bars(caption, bars) if bars else None
