"""How an arm is doing, in one word, and what a list of all arms says of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from ...experiments.history.arm_drift import NOT_SOON, ArmDrift, DatedJump
from ...experiments.history.store import StoredResult
from .drift_text import due_json
from .lists import utc

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
