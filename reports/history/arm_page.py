"""How an arm is doing, in one word, and its page: due date, jumps, offsets over time, every calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

from ...analysis.drift.drift import ALARM, MEDIAN
from ...analysis.status import NOT_DESCRIBED, known
from ...experiments.history.arm_drift import FEW, LeftOut
from ...experiments.history.arm_history import ArmHistory, State
from ...experiments.history.stored_result import StoredResult
from ...words import numbers
from ...words.entries import said_word
from ...words.provenance import BAND
from ...words.wording import clipped, label, listed
from ..style.blocks import (
    Block,
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
    day,
    due_sentence,
    events_table,
    jumps_blocks,
    offsets_blocks,
    result_table,
    verdict_cell,
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
    " 95\u00a0%, if the offsets of the last result are applied. What links leave comes on top. Jumps are not"
    " foreseen"
)


def arm_page(history: ArmHistory) -> Page:
    """The display strings of an arm."""
    arm = history.arm
    return Page(
        f"Arm {clipped(arm.serial, 60)}",
        f"History of {clipped(arm.model, 60)}, serial number {clipped(arm.serial, 60)}",
        headline(history),
        list(_notes(history)),
        list(_sections(history)),
        _facts(history),
        band=BAND if arm.simulated else "",
    )


def headline(history: ArmHistory) -> Headline:
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
    if len(arm.undecided) > (UNDECIDED in headline(history).sentence):  # that of one change is said there
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
    yield section_of("How it is worked out", Facts(list(_about(history))))


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


def _about(history: ArmHistory) -> Iterator[tuple[str, str]]:
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
