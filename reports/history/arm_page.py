"""How an arm is doing, in one word, and its page: due date, jumps, offsets over time, every calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from typing import Any, Literal

from ...analysis.drift.drift import ALARM, MEDIAN
from ...analysis.status import known
from ...experiments.history.arm_drift import NOT_SOON, ArmDrift, DatedJump
from ...experiments.history.store import Event, StoredResult
from ...words import numbers
from ...words.verdict import VERDICT_WORDS
from ...words.wording import clipped, label, listed
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
from .drift_text import (
    FEW_RATES,
    UNDECIDED,
    change_sentence,
    due_json,
    due_sentence,
    jumps_blocks,
    offsets_block,
)
from .lists import day, events_table, offset_names, utc

State = Literal["overdue", "jump without event", "jump", "misfit", "no due date", "on schedule"]

# The gravest first; `MARKS` has the status of the palette whose shape and colour each has.
STATES: tuple[State, ...] = (
    "overdue",
    "jump without event",
    "jump",
    "misfit",
    "no due date",
    "on schedule",
)
MARKS: dict[str, str] = {
    "overdue": "misfit",
    "jump without event": "weak",
    "jump": "weak",
    "misfit": "unvalidated",
    "no due date": "unidentifiable",
    "on schedule": "identified",
}


@dataclass(frozen=True)
class ArmState:
    """A row of the list of all arms; `clearest` is the jump with the smallest p-value, one
    without an event before others; `undecided` is how many changes may be a jump or drift."""

    serial: str
    model: str
    results: int
    counted: int
    last: datetime | None
    verdict: str | None
    jumps: int
    clearest: DatedJump | None
    tolerance_mm: float
    due: datetime | None
    due_reason: str
    state: State
    undecided: int = 0

    @property
    def order(self) -> tuple[int, datetime, str, str]:
        """The gravest first; within a state the date that is due first, then by serial number."""
        return STATES.index(self.state), self.due or datetime.max, self.serial, self.model


def arm_state(found: ArmDrift, results: Sequence[StoredResult], as_of: datetime | None) -> ArmState:
    """The row of an arm with its drift and all its results; `as_of` is the day on which it is asked."""
    last = results[-1] if results else None
    return ArmState(
        serial=found.serial,
        model=found.model,
        results=len(results),
        counted=len(found.used),
        last=None if last is None else last.measured_at,
        verdict=None if last is None else last.verdict,
        jumps=len(found.jumps),
        clearest=min(found.jumps, key=lambda own: (bool(own.events), own.jump.p_value), default=None),
        tolerance_mm=found.tolerance_mm,
        due=found.due,
        due_reason=found.due_reason,
        state=_state(found, last, as_of),
        undecided=len(found.undecided),
    )


def _state(found: ArmDrift, last: StoredResult | None, as_of: datetime | None) -> State:
    if found.due is not None and (
        found.due_reason or (as_of is not None and found.due.date() <= as_of.date())
    ):
        return "overdue"
    if any(not own.events for own in found.jumps):
        return "jump without event"
    if found.jumps:
        return "jump"
    if last is not None and last.verdict == "misfit":
        return "misfit"
    known = found.due is not None or found.due_reason == NOT_SOON
    return "on schedule" if known else "no due date"


def state_json(own: ArmState) -> dict[str, Any]:
    """The same for programs."""
    jump = own.clearest
    return {
        "serial": own.serial,
        "model": own.model,
        "state": own.state,
        "results": own.results,
        "counted": own.counted,
        "last": None if own.last is None else utc(own.last),
        "verdict": own.verdict,
        "jumps": own.jumps,
        "clearest_jump": None
        if jump is None
        else {
            "offset": jump.jump.offset,
            "before": utc(jump.before),
            "p_value": jump.jump.p_value,
            "events": len(jump.events),
        },
        "undecided": own.undecided,
        "due": due_json(own),
    }


def state_row(own: ArmState) -> dict[str, object]:
    """A row of fleet.csv."""
    told = state_json(own)
    jump, due = told.pop("clearest_jump") or {}, told.pop("due")
    return {
        **told,
        "clearest_jump": jump.get("offset"),
        "clearest_jump_before": jump.get("before"),
        "clearest_jump_p": jump.get("p_value"),
        "due": due["date"],
        "due_reason": due["reason"],
    }


_MOST_ROWS = 500
_FEW_ROWS = 24  # more are shown on demand
_NO_TEXT = "—"
_CERTIFY = "A signed certificate of one of them: zerobeam history certify, with --run or --date."
DUE_MEANS = (
    "until then the TCP error stays within the tolerance with a probability of 95\u00a0%, if the offsets of"
    " the last result are applied; jumps are not foreseen"
)
VERDICTS: dict[str, str] = {str(key): word for key, word in VERDICT_WORDS.items()}
_MARKS = {
    "misfit": "unvalidated",
    "degenerate": "unidentifiable",
    "weak": "weak",
    "pass": "identified",
}
KEYS: dict[State, str] = {
    "overdue": "misfit",
    "jump without event": "weak",
    "jump": "weak",
    "misfit": "misfit",
    "no due date": "degenerate",
    "on schedule": "pass",
}
WORDS: dict[State, str] = {
    "overdue": "Calibrate now",
    "jump without event": "Jump without an event",
    "jump": "Jump",
    "misfit": "Misfit",
    "no due date": "No due date",
    "on schedule": "On schedule",
}


@dataclass(frozen=True, eq=False)
class ArmHistory:
    """An arm with all that the history has of it; `as_of` is the day of the question, None without a result
    in the history."""

    found: ArmDrift
    results: tuple[StoredResult, ...]
    events: tuple[Event, ...]
    as_of: datetime | None

    @cached_property
    def state(self) -> ArmState:
        """Its row in the list of all arms."""
        return arm_state(self.found, self.results, self.as_of)

    @cached_property
    def never(self) -> tuple[str, ...]:
        """The offsets that some result wanted to know, and that none which counts determines."""
        drift = self.found.drift
        seen = (
            drift.series.names
            if drift is not None
            else [name for own in self.found.used if own.without_prior for name in own.without_prior["names"]]
        )
        return tuple(name for name in offset_names(self.results) if name not in seen)


def arm_page(own: ArmHistory) -> Page:
    """The display strings of an arm."""
    found = own.found
    return Page(
        f"Arm {clipped(found.serial, 60)}",
        f"History of {clipped(found.model, 60)}, serial number {clipped(found.serial, 60)}",
        headline(own),
        list(_notes(own)),
        list(_sections(own)),
        _facts(own),
    )


def headline(own: ArmHistory) -> Headline:
    """What to do, and why."""
    found, state = own.found, own.state.state
    if not own.results:
        none = "The history has no result of this arm: nothing is known of its offsets."
        return Headline("degenerate", "No results", none)
    if all(one.verdict == "misfit" for one in own.results):
        count = len(own.results)
        every = "The only result is a misfit" if count == 1 else f"All {count} results are misfits"
        return Headline(
            "misfit",
            "Misfit",
            f"{every}: the model does not describe the measurements, so no offset of this arm is known, and"
            " there is no due date. The report of each result says what explains it best.",
        )
    return Headline(KEYS[state], WORDS[state], f"{_why(own)}{due_sentence(found)}")


def _why(own: ArmHistory) -> str:
    """What is said before the due date."""
    found, state, jump = own.found, own.state.state, own.state.clearest
    if state == "overdue" and not found.due_reason and own.as_of is not None and found.due is not None:
        today = found.due.date() == own.as_of.date()
        return f"{'Due' if today else 'Overdue'} on {own.as_of:%Y-%m-%d}. "
    if state == "jump without event" and jump is not None:
        asked = "no event is logged in between: find out what happened, and log it"
        return f"{change_sentence(jump)}, and {asked}. "
    if state == "jump" and jump is not None:
        events = listed([f"{one.what} of {day(one.at)}" for one in jump.events])
        return f"{change_sentence(jump)}; logged in between: {events}. "
    if state == "misfit":
        last = day(own.results[-1].measured_at)
        return f"The last result, of {last}, is a misfit and does not count. "
    if found.drift is None:
        return (
            f"{'One result counts' if found.used else 'No result counts'}: two are needed to know a drift. "
        )
    if found.undecided:
        largest = max(found.undecided, key=lambda one: abs(one.change.size) / one.change.least_jump)
        return f"{change_sentence(largest)}: {UNDECIDED}. "
    return ""


def _notes(own: ArmHistory) -> Iterator[str]:
    found, drift = own.found, own.found.drift
    if own.never and found.used:
        yield f"Determined by no result that counts: {listed([label(name) for name in own.never])}"
    if drift is not None:
        known_now = zip(drift.series.names, drift.series.determined[-1], strict=True)
        if lost := [label(name) for name, is_known in known_now if not is_known]:
            yield f"Not determined since the last mastering: {listed(lost)}"
        if drift.effective < FEW_RATES:
            yield "Few walk rates explain these results: intervals and p-values are approximate"
    told = own.state.clearest if own.state.state in ("jump", "jump without event") else None
    others = [
        f"{label(one.jump.offset)}, {day(one.after)} to {day(one.before)}"
        for one in found.jumps
        if one is not told
    ]
    if others:
        yield f"{'Jumps' if told is None else 'Other jumps'}: {listed(others, 4)}"
    if len(found.undecided) > (UNDECIDED in headline(own).sentence):  # that of one change is said there
        either = [
            f"{label(one.change.offset)}, {day(one.after)} to {day(one.before)}" for one in found.undecided
        ]
        yield f"Jump or drift ({UNDECIDED}): {listed(either, 4)}"
    if found.left_out and found.used:
        left = len(found.left_out)
        yield f"{left} of {len(own.results)} results {'does' if left == 1 else 'do'} not count: why is below"


def _facts(own: ArmHistory) -> list[tuple[str, str]]:
    results = own.results
    facts = [("Results", str(len(results)))]
    if results:
        facts.append(("From", day(results[0].measured_at)))
        facts.append(("To", day(results[-1].measured_at)))
    facts.append(("Tolerance at the TCP", numbers.exact(own.found.tolerance_mm, "mm")))
    if own.as_of is not None:
        facts.append(("As of", f"{own.as_of:%Y-%m-%d}"))
    return facts


def _sections(own: ArmHistory) -> Iterator[Section]:
    found = own.found
    if found.drift is not None:
        yield section_of("Offsets over time", *_trend(own))
        yield section_of("Jumps", *jumps_blocks(found))
        yield section_of("Offsets now", offsets_block(found), *_never(own))
    if own.results:
        yield replace(
            section_of("Calibrations", calibrations(own), Paragraph(_CERTIFY)),
            folded=len(own.results) > _FEW_ROWS,
        )
    events = events_table(own.events)
    if events is not None:
        yield section_of("Events", events)
    if found.left_out:
        yield section_of("What does not count", _left_out(own))
    yield section_of("How it is worked out", Facts(list(_about(own))))


def _trend(own: ArmHistory) -> Iterator[Block]:
    yield Paragraph(
        "Points: what each result determines without prior, with its own 95 % interval; a result has no point"
        " for an offset that it does not determine. Band: the 95 % interval by all results together. Between"
        " results it is that of the random walk, so it is wider there; it breaks where an offset jumps or the"
        " controller gets new zeros, and goes on as a forecast after the last result, if nothing jumps."
    )
    panels = len(own.found.drift.series.names) + len(own.never) if own.found.drift is not None else 0
    yield from map(FigureBlock, figure_names(panels))


def _never(own: ArmHistory) -> Iterator[Block]:
    if own.never:
        names = listed([label(name) for name in own.never])
        yield Paragraph(f"Not determined by any result that counts, so without a number: {names}.")


def calibrations(own: ArmHistory) -> Table:
    """Every result, the newest first."""
    columns = [
        ("date", "left"),
        ("verdict", "left"),
        ("worst u", "left"),
        ("instrument", "left"),
        ("operator", "left"),
        ("document", "left"),
    ]
    caption = "The newest first. Worst u: largest standard uncertainty; document: SHA-256 of result.json"
    if len(own.results) > _MOST_ROWS:
        caption += f". The last {_MOST_ROWS} of {len(own.results):,}: arm.json has all"
    rows = [_calibration(one) for one in reversed(own.results[-_MOST_ROWS:])]
    return table_of(caption, columns, rows)


def _calibration(own: StoredResult) -> Row:
    return row_of(
        day(own.measured_at),
        Cell(VERDICTS[own.verdict], mark=_MARKS[own.verdict]),
        _worst(own),
        clipped(own.instrument, 24) or _NO_TEXT,
        clipped(own.operator, 24) or _NO_TEXT,
        own.document_sha256[:10],
    )


def _worst(own: StoredResult) -> str:
    """The offset that is determined worst; what is not determined has no number."""
    wanted = [row for row in own.offsets if not row["held"]]
    lost = [label(row["name"]) for row in wanted if row["status"] == "unidentifiable"]
    if lost:
        return f"{listed(lost, 2)} not determined"
    if own.verdict == "misfit":
        return "unvalidated"
    stated = [row for row in wanted if known(row["status"])]
    if not stated:
        return _NO_TEXT
    worst = max(stated, key=lambda row: float(row["std"]))
    return f"{label(worst['name'])} {numbers.spread(worst['std'], worst['unit'])}"


def _left_out(own: ArmHistory) -> Table:
    newest = list(reversed(own.found.left_out))[:_MOST_ROWS]
    rows = [row_of(day(one.result.measured_at), one.reason) for one in newest]
    columns = [("date", "left"), ("why", "left")]
    return table_of("Results that have no part in the drift, the newest first", columns, rows)


def _about(own: ArmHistory) -> Iterator[tuple[str, str]]:
    yield (
        "Offsets",
        f"a random walk each, of unknown rate (prior median {MEDIAN:g} per root year), with rare jumps",
    )
    yield "Jumps", f"probability of any false alarm of an arm at most {ALARM:.0%}"
    yield "Due date", DUE_MEANS
    yield "Results that count", f"{len(own.found.used)} of {len(own.results)}"
    yield "Files", "arm.json has every number unrounded, offsets.csv every offset of every result"


def figure_names(panels: int) -> list[str]:
    """What the figures of so many panels are called."""
    from .trend_figure import AT_ONCE

    count = -(-panels // AT_ONCE)
    return ["trend"] if count == 1 else [f"trend-{number}" for number in range(1, count + 1)]
