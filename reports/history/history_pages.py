"""How an arm is doing, in one word, and its page: due date, jumps, offsets over time, every calibration; and
the page of all arms, the gravest first."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime
from typing import NamedTuple

from ...analysis.drift.drift import ALARM, MEDIAN
from ...analysis.status import NOT_DESCRIBED, known
from ...experiments.history.arm_history import FEW, NOT_SOON, STATES, ArmHistory, ArmState, LeftOut, State
from ...experiments.history.fleet_drift import Fleet
from ...experiments.history.stored_result import StoredResult
from ...words import numbers
from ...words.entries import said_word
from ...words.provenance import BAND
from ...words.wording import clipped, counted, label, listed
from ..style.blocks import (
    Bar,
    Bars,
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
from ..style.blocks import Verdict as Headline
from .history_tables import (
    FEW_RATES,
    UNDECIDED,
    change_sentence,
    changes_of_assumed,
    clearest_jump,
    date_or,
    day,
    due_sentence,
    events_table,
    fleet_blocks,
    jumps_blocks,
    offsets_blocks,
    result_table,
    verdict_cell,
    with_labels,
)
from .trend_figure import AT_ONCE


class StateWords(NamedTuple):
    """How a state is shown: the `role` of its headline, its mark in lists, its word, and what to do."""

    role: str
    mark: str
    word: str
    to_do: str


STATE_WORDS: dict[State, StateWords] = {
    "overdue": StateWords("misfit", "misfit", "Calibrate now", "calibrate now"),
    "jump without event": StateWords(
        *("weak", "weak", "Jump without an event"),
        "find out what happened, and log it: zerobeam history event",
    ),
    "jump": StateWords("weak", "weak", "Jump", "look at the arm’s page: an event was logged when it jumped"),
    "misfit": StateWords(
        *("misfit", "unvalidated", "Misfit"),
        "see the report of the last result for what explains it, and measure again",
    ),
    "no due date": StateWords("degenerate", "unidentifiable", "No due date", "see why below"),
    "on schedule": StateWords("pass", "identified", "On schedule", "nothing before the due date"),
}


_MOST_ROWS = 500
_FEW_ROWS = 24  # more are shown on demand
_NO_TEXT = "—"
_CERTIFY = "A signed certificate of one of them: zerobeam history certify, with --run or --date."
DUE_MEANS = (
    "until then the TCP error by the offsets alone stays within the tolerance with a probability of"
    " 95\u00a0%, if the offsets of the last result are applied. The error that links leave comes on top."
    " Jumps are not foreseen"
)


def arm_page(history: ArmHistory) -> Page:
    """The display strings of an arm."""
    arm = history.arm
    return Page(
        f"Arm {clipped(arm.serial, 60)}",
        f"History of {clipped(arm.model, 60)}, serial number {clipped(arm.serial, 60)}",
        arm_headline(history),
        list(_notes(history)),
        list(_sections(history)),
        _facts(history),
        band=BAND if arm.simulated else "",
    )


def arm_headline(history: ArmHistory) -> Headline:
    """What to do, and why."""
    arm, state = history.arm, STATE_WORDS[history.state]
    if not history.results:
        none = "The history has no result of this arm: nothing is known of its offsets."
        return Headline("degenerate", "No results", none)
    if all(one.verdict == "misfit" for one in history.results):
        count = len(history.results)
        every = "The only result is a misfit" if count == 1 else f"All {count} results are misfits"
        return Headline(
            "misfit",
            "Misfit",
            f"{every}: {NOT_DESCRIBED}, so no offset of this arm is known, and"
            " there is no due date. The report of each result says what explains it best.",
        )
    role = "held" if arm.simulated else state.role
    return Headline(role, said_word(state.word, arm.simulated), f"{_why(history)}{due_sentence(arm)}")


def _why(history: ArmHistory) -> str:
    """What is said before the due date."""
    arm, state, jump = history.arm, history.state, history.clearest
    if state == "overdue" and not arm.due_reason and history.asked is not None and arm.due is not None:
        today = arm.due.date() == history.asked.date()
        return f"{'Due' if today else 'Overdue'} on {history.as_of}. "
    if state == "jump without event" and jump is not None:
        request = "no event is logged in between: find out what happened, and log it"
        return f"{change_sentence(jump)}, and {request}. "
    if state == "jump" and jump is not None:
        events = listed([f"{one.what} of {day(one.at)}" for one in jump.events])
        return f"{change_sentence(jump)}; logged in between: {events}. "
    if state == "misfit" and history.last is not None:
        last = day(history.last.measured_at)
        return f"The last result, of {last}, is a misfit and does not count. "
    if arm.drift is None:
        return f"{'One result counts' if arm.used else 'No result counts'}: a drift needs two. "
    if arm.undecided:
        largest = max(arm.undecided, key=lambda one: abs(one.size) / one.least_jump)
        return f"{change_sentence(largest)}: {UNDECIDED}. "
    return ""


def _notes(history: ArmHistory) -> Iterator[str]:
    arm, drift = history.arm, history.arm.drift
    if history.undetermined and arm.used:
        yield f"Determined by no result that counts: {listed([label(name) for name in history.undetermined])}"
    if drift is not None:
        known_now = zip(drift.series.names, drift.series.determined[-1], strict=True)
        if lost := [label(name) for name, is_known in known_now if not is_known]:
            yield f"Not determined since the last mastering: {listed(lost)}"
        if drift.effective < FEW:
            yield FEW_RATES
    mentioned = history.clearest if history.state in ("jump", "jump without event") else None
    others = [
        f"{label(one.offset)}, {day(one.after)} to {day(one.before)}"
        for one in arm.jumps
        if one is not mentioned
    ]
    if others:
        yield f"{'Jumps' if mentioned is None else 'Other jumps'}: {listed(others, 4)}"
    if len(arm.undecided) > (UNDECIDED in arm_headline(history).sentence):  # that of one change is said there
        either = [f"{label(one.offset)}, {day(one.after)} to {day(one.before)}" for one in arm.undecided]
        yield f"Jump or drift ({UNDECIDED}): {listed(either, 4)}"
    if resting := changes_of_assumed(arm):
        yield resting
    if arm.left_out and arm.used:
        left = len(arm.left_out)
        count = f"{left} of {len(history.results)} results {'does' if left == 1 else 'do'}"
        yield f"{count} not count: why is below"


def _facts(history: ArmHistory) -> list[tuple[str, str]]:
    results = history.results
    facts = [("Results", str(len(results)))]
    if results:
        facts.append(("From", day(results[0].measured_at)))
        facts.append(("To", day(results[-1].measured_at)))
    facts.append(("Tolerance at the TCP, offsets alone", numbers.exact(history.arm.tolerance_mm, "mm")))
    if history.as_of is not None:
        facts.append(("As of", history.as_of))
    return facts


def _sections(history: ArmHistory) -> Iterator[Section]:
    arm = history.arm
    if arm.drift is not None:
        yield section_of("Offsets over time", *_trend(history))
        yield section_of("Jumps", *jumps_blocks(arm))
        yield section_of("Offsets now", *offsets_blocks(arm), *_never(history))
    elif len(arm.used) == 1:
        yield section_of("Offsets", result_table(arm.used[0]))
    if history.results:
        yield replace(
            section_of("Calibrations", calibrations(history), Paragraph(_CERTIFY)),
            folded=len(history.results) > _FEW_ROWS,
        )
    events = events_table(history.events)
    if events is not None:
        yield section_of("Events", events)
    if arm.left_out:
        newest = arm.left_out[: -_MOST_ROWS - 1 : -1]
        columns: Columns[LeftOut] = {
            "date": lambda one: day(one.result.measured_at),
            "why": lambda one: one.reason,
        }
        caption = "Results that have no part in the drift, the newest first"
        yield section_of("What does not count", table_by(caption, newest, columns, "l"))
    yield section_of("How it is worked out", Facts(list(_about_arm(history))))


def _trend(history: ArmHistory) -> Iterator[Block]:
    yield Paragraph(
        "Points: what each result determines without prior, with its own 95 % interval; a result has no point"
        " for an offset that it does not determine. Band: the 95 % interval by all results together. Between"
        " results it is that of the random walk, so it is wider there; it breaks where an offset jumps or the"
        " controller gets new zeros, and goes on as a forecast after the last result, if nothing jumps."
    )
    panels = (
        len(history.arm.drift.series.names) + len(history.undetermined)
        if history.arm.drift is not None
        else 0
    )
    yield from map(FigureBlock, figure_names(panels))


def _never(history: ArmHistory) -> Iterator[Block]:
    if history.undetermined:
        names = listed([label(name) for name in history.undetermined])
        yield Paragraph(f"Not determined by any result that counts, so without a number: {names}.")


def calibrations(history: ArmHistory) -> Table:
    """Every result, the newest first."""
    caption = "The newest first. Worst u: largest standard uncertainty; document: SHA-256 of result.json"
    if len(history.results) > _MOST_ROWS:
        caption += f". The last {_MOST_ROWS} of {len(history.results):,}: arm.json has all"
    return table_by(
        caption,
        list(zip(history.results, history.judged, strict=True))[: -_MOST_ROWS - 1 : -1],
        {
            "date": lambda row: day(row[0].measured_at),
            "verdict": lambda row: verdict_cell(row[0].verdict, row[1], row[0].simulated),
            "worst u": lambda row: _worst(row[0]),
            "instrument": lambda row: clipped(row[0].instrument, 24) or _NO_TEXT,
            "operator": lambda row: clipped(row[0].operator, 24) or _NO_TEXT,
            "document": lambda row: row[0].document_sha256[:10],
        },
        "l",
    )


def _worst(result: StoredResult) -> str:
    """The offset that is determined worst; what is not determined has no number."""
    free = [row for row in result.offsets if not row.held]
    lost = [label(row.name) for row in free if row.status == "unidentifiable"]
    if lost:
        return f"{listed(lost, 2)} not determined"
    if result.verdict == "misfit":
        return "unvalidated"
    stds = {row.name: (row.std, row.unit) for row in free if row.std is not None and known(row.status)}
    if not stds:
        return _NO_TEXT
    name, (std, unit) = max(stds.items(), key=lambda item: item[1][0])
    return f"{label(name)} {numbers.spread(std, unit)}"


def _about_arm(history: ArmHistory) -> Iterator[tuple[str, str]]:
    yield (
        "Offsets",
        f"a random walk each, of unknown drift rate (prior median {MEDIAN:g} per root year), with rare jumps",
    )
    yield "Jumps", f"probability of any false alarm of an arm at most {numbers.percent(ALARM)}"
    yield "Due date", DUE_MEANS
    yield "Results that count", f"{len(history.arm.used)} of {len(history.results)}"
    yield "Files", "arm.json has every number unrounded, offsets.csv every offset of every result"


def figure_names(panels: int) -> list[str]:
    """What the figures of so many panels are called."""
    count = -(-panels // AT_ONCE)
    return ["trend"] if count == 1 else [f"trend-{number}" for number in range(1, count + 1)]


MOST_ROWS = 1000  # on the page, and with a page of their own
_MOST_REASONS = 50


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
        section_of("How it is worked out", Facts(list(_about_fleet()))),
    ]
    return Page(
        "All arms",
        listed(models) if models else "No arm",
        fleet_headline(fleet),
        [],
        sections if fleet.arms else [],
        facts,
    )


def fleet_headline(fleet: Fleet) -> Headline:
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


def _about_fleet() -> Iterator[tuple[str, str]]:
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
