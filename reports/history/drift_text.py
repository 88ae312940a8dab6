"""The drift of an arm as tables and JSON."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Protocol

import numpy as np

from ...analysis.drift.drift import Jump, Undecided
from ...experiments.history.arm_drift import ArmDrift, DatedChange, DatedJump
from ...words import numbers
from ...words.wording import clipped, counted, label, shown
from ..style.blocks import Block, Cell, Paragraph, Table, row_of, table_of
from .lists import day, event_json, utc

SCHEMA = "zerobeam/drift/1"
FEW_RATES = 30  # rates: below, the numbers are coarse
UNDECIDED = "too few results to distinguish a jump from drift"


def drift_blocks(found: ArmDrift) -> Iterator[Block]:
    """Jumps, the offsets now and how fast they walk, the due date, what does not count."""
    if found.drift is not None:
        yield from jumps_blocks(found)
        yield offsets_block(found)
        if found.drift.effective < FEW_RATES:
            yield Paragraph("Few walk rates explain these results: intervals and p-values are approximate.")
    yield Paragraph(f"{due_sentence(found)} {counted(len(found.used), 'result')} counted.")
    for own in found.left_out:
        yield Paragraph(f"Not counted: the result of {day(own.result.measured_at)}. {own.reason}.")


def due_sentence(found: ArmDrift) -> str:
    """When the next calibration is due, or why there is no date."""
    limit = f"TCP error within {numbers.exact(found.tolerance_mm, 'mm')} (95 %, rms of the workspace)"
    reason = with_labels(found.due_reason)
    if found.due is not None and not found.due_reason:
        return f"Next calibration due: {found.due:%Y-%m-%d}, for a {limit}."
    word = "due now" if found.due is not None else "no due date"
    return f"Next calibration: {word} for a {limit}: {reason}."


def with_labels(text: str) -> str:
    """A sentence with the offsets in it as people write them."""
    return re.sub(r"delta\d+", lambda name: label(name.group()), text)


def arms_drift_table(arms: Sequence[ArmDrift]) -> Block:
    """A row for each arm: its clearest jump, and when it is due."""
    rows = [
        row_of(
            clipped(own.serial, 24),
            clipped(own.model, 20),
            str(len(own.used)),
            _clearest(own),
            "none" if own.due is None else f"{own.due:%Y-%m-%d}",
            tone="weak" if own.jumps or own.undecided else "",
        )
        for own in arms
    ]
    heads = ("arm", "model", "results", "clearest jump", "due")
    columns = [(head, "right" if head == "results" else "left") for head in heads]
    return table_of("Drift of all arms", columns, rows)


def drift_json(found: ArmDrift) -> dict[str, Any]:
    """The same for programs."""
    return {
        "serial": found.serial,
        "model": found.model,
        "used": [own.sha256 for own in found.used],
        "left_out": [{"sha256": own.result.sha256, "reason": own.reason} for own in found.left_out],
        "offsets": list(_offset_rows(found)),
        "jumps": [
            {
                "offset": own.jump.offset,
                "unit": own.jump.unit,
                "after": utc(own.after),
                "before": utc(own.before),
                "p_value": own.jump.p_value,
                "size": own.jump.size,
                "interval95": list(own.jump.interval95),
                "events": [event_json(event) for event in own.events],
                "instruments": _instruments(own),
            }
            for own in found.jumps
        ],
        "undecided": [
            {
                "offset": own.change.offset,
                "unit": own.change.unit,
                "after": utc(own.after),
                "before": utc(own.before),
                "size": own.change.size,
                "interval95": list(own.change.interval95),
                "least_jump": own.change.least_jump,
                "events": [event_json(event) for event in own.events],
                "instruments": _instruments(own),
            }
            for own in found.undecided
        ],
        "effective_rates": None if found.drift is None else found.drift.effective,
        "due": due_json(found),
    }


def _instruments(own: DatedJump | DatedChange) -> list[str | None] | None:
    return None if own.instruments is None else [name or None for name in own.instruments]


class Due(Protocol):
    """What is said of a due date."""

    @property
    def tolerance_mm(self) -> float: ...
    @property
    def due(self) -> datetime | None: ...
    @property
    def due_reason(self) -> str: ...


def due_json(found: Due) -> dict[str, Any]:
    """The due date for programs."""
    return {
        "tolerance_mm": found.tolerance_mm,
        "date": None if found.due is None else f"{found.due:%Y-%m-%d}",
        "reason": found.due_reason or None,
    }


def _offset_rows(found: ArmDrift) -> Iterator[dict[str, Any]]:
    """Of each offset at the last result: estimate, std, interval (None where no result determines it since
    the controller got new zeros), the rate of its walk (None where the results say nothing of it)."""
    if found.drift is None:
        return
    names = found.drift.series.names
    for i, name in enumerate(names):
        along, last = np.eye(len(names))[i], -1
        known = bool(found.drift.series.determined[last, i])
        value, std = found.drift.value(last, along) if known else (None, None)
        median, interval = found.drift.rate(name)
        yield {
            "name": name,
            "unit": found.drift.series.units[i],
            "estimate": value,
            "std": std,
            "interval95": list(found.drift.interval(last, along)) if known else None,
            "rate": {"median": median, "interval95": list(interval)}
            if found.drift.determines_rate(name)
            else None,
        }


def offsets_block(found: ArmDrift) -> Block:
    """Every offset at the last result, and how fast it walks."""
    rows = [
        row_of(
            label(own["name"]),
            _now(own),
            *_walk(own),
        )
        for own in _offset_rows(found)
    ]
    heads = ("offset", "at the last result", "walk", "95 % interval")
    columns = [(head, "left" if head == "offset" else "right") for head in heads]
    return table_of("Offsets by all results, and their random walk per root year", columns, rows)


def _walk(own: dict[str, Any]) -> tuple[str | Cell, str]:
    if own["rate"] is None:
        return Cell("not determined", mark="unidentifiable"), ""
    ends = " to ".join(numbers.significant(end, 2) for end in own["rate"]["interval95"])
    return numbers.significant(own["rate"]["median"], 2, own["unit"]), ends


def _now(own: dict[str, Any]) -> str | Cell:
    if own["std"] is None:
        return Cell("not determined since the mastering", mark="unidentifiable")
    return f"{numbers.estimate(own['estimate'], own['std'])} ± {numbers.spread(own['std'], own['unit'])}"


def jumps_blocks(found: ArmDrift) -> Iterator[Block]:
    """The jumps, the changes that may be one, and what was logged in between."""
    if found.jumps:
        yield _jumps_table(found.jumps)
    if found.undecided:
        yield _undecided_table(found.undecided)
    elif not found.jumps:
        yield Paragraph(without_jump(found))


def without_jump(found: ArmDrift) -> str:
    """What is said of the changes where none of them is a jump or may be one."""
    if found.drift is not None and found.drift.changed:
        return "No jump was found: drift at a rate that other results show explains every change."
    return "No change from one result to the next exceeds their uncertainty."


def _jumps_table(jumps: Sequence[DatedJump]) -> Table:
    rows = [
        row_of(
            Cell(label(own.jump.offset), mark="weak"),
            f"{day(own.after)} to {day(own.before)}",
            _change(own.jump),
            numbers.p_value(own.jump.p_value),
            ", ".join(_happened(own)) or "none logged",
        )
        for own in jumps
    ]
    heads = ("offset", "between", "change", "p-value", "events")
    columns = [(head, "right" if head in ("change", "p-value") else "left") for head in heads]
    return table_of("Jumps; p-values adjusted for the number of tests (Bonferroni)", columns, rows)


def _undecided_table(changes: Sequence[DatedChange]) -> Table:
    rows = [
        row_of(
            Cell(label(own.change.offset), mark="weak"),
            f"{day(own.after)} to {day(own.before)}",
            _change(own.change),
            numbers.significant(own.change.least_jump, 2, own.change.unit),
            ", ".join(_happened(own)) or "none logged",
        )
        for own in changes
    ]
    heads = ("offset", "between", "change", "a jump from", "events")
    columns = [(head, "right" if head in ("change", "a jump from") else "left") for head in heads]
    return table_of(f"Jump or drift: {UNDECIDED}", columns, rows)


def _change(own: Jump | Undecided) -> str:
    low, high = own.interval95
    return numbers.interval(own.interval95, max((high - low) / 4, 1e-12), own.unit)


def change_sentence(own: DatedJump | DatedChange) -> str:
    """Offset, size and dates of a change."""
    change = own.jump if isinstance(own, DatedJump) else own.change
    between = f"between {day(own.after)} and {day(own.before)}"
    return f"{label(change.offset)} changed by {_change(change)} {between}"


def _happened(own: DatedJump | DatedChange) -> Iterator[str]:
    for event in own.events:
        yield f"{event.what} {day(event.at)} {shown(event.note)}".strip()
    if own.instruments is not None:
        before, after = (clipped(name) if name else "not stated" for name in own.instruments)
        changed = "changed" if all(own.instruments) else "may have changed"
        yield f"instrument {changed}, a possible cause: {before} to {after}"


def _clearest(own: ArmDrift) -> str:
    clearest = min(own.jumps, key=lambda jump: jump.jump.p_value, default=None)
    return clearest_jump(clearest, len(own.undecided)) or "none"


def clearest_jump(own: DatedJump | None, undecided: int) -> str:
    """In a list of arms: offset of a jump and the result that shows it, or how many changes may be one."""
    if own is not None:
        return f"{label(own.jump.offset)}, {own.before:%Y-%m-%d}"
    return f"{undecided} undecided" if undecided else ""
