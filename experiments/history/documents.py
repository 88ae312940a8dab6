"""What `history` writes: results and events, the drift of arms, the states of all (docs/how-to/plant.md)."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Final, Literal, get_args

from ...analysis.answer.answer_message import Grade, Message
from ...analysis.status import Verdict
from ...model.records import if_any, internal, it, key, record
from .arm_drift import ArmDrift, DatedJump, Due
from .fleet_drift import FleetDrift
from .stored_result import Event, Moment, StoredResult

State = Literal["overdue", "jump without event", "jump", "misfit", "no due date", "on schedule"]
# The gravest first.
STATES: tuple[State, ...] = get_args(State)
HISTORY_SCHEMA: Final = "zerobeam/history/1"
ARM_SCHEMA: Final = "zerobeam/history-arm/1"
FLEET_SCHEMA: Final = "zerobeam/history-fleet/1"
_KIND = it("kind and version of the document")


@record(kw_only=True)
class HistoryList:
    """`history list`, `show` and `export`: results, and the events of `show` and `export`."""

    schema: Annotated[Literal["zerobeam/history/1"], _KIND] = HISTORY_SCHEMA
    serial: Annotated[str | None, it("of `show`: the arm"), if_any] = None
    model: Annotated[str | None, it("of `show`: name of the robot"), if_any] = None
    results: Annotated[tuple[StoredResult, ...], it("in the order of arm and time")]
    events: Annotated[tuple[Event, ...] | None, it("of `show` and `export`"), if_any] = None


@record(kw_only=True)
class DriftOfArms:
    """`history drift`: an arm, or all arms and what they say together."""

    schema: Annotated[Literal["zerobeam/drift/1"], _KIND] = "zerobeam/drift/1"
    arms: Annotated[tuple[ArmDrift, ...], it("each arm by itself")]
    fleet: Annotated[FleetDrift | None, it("of all arms"), if_any] = None


@record(kw_only=True)
class ArmDocument(HistoryList):
    """`arm.json`: state, drift, results and events of an arm."""

    schema: Annotated[Literal["zerobeam/history-arm/1"], _KIND] = ARM_SCHEMA  # type: ignore[assignment]
    as_of: Annotated[str | None, it("day for which the state is stated")]
    headline: Annotated[str, it("the next calibration, in a sentence")]
    state: Annotated[str, it("`overdue`, … as above")]
    undetermined: Annotated[tuple[str, ...], it("offsets that no result determines")]
    drift: Annotated[ArmDrift, it("as in `arms` of `drift --json`")]


@record
class ClearestJump:
    """The jump of an arm with the smallest p-value, one without an event before others."""

    offset: str
    before: Moment
    p_value: float
    events: Annotated[int, it("how many were logged in between")]


@record(kw_only=True)
class ArmState:
    """A row of the list of all arms; `clearest` is the jump with the smallest p-value, one without an event
    before others; `undecided` is how many changes may be a jump or drift."""

    serial: str
    model: str
    state: State
    results: int
    counted: Annotated[int, it("results that count")]
    last: Annotated[Moment | None, it("time of the last result")]
    verdict: Verdict | None
    judged: Annotated[Message | None, internal]
    jumps: int
    clearest: Annotated[DatedJump | None, internal]
    undecided: Annotated[int, it("changes that may be a jump or drift")] = 0
    next_due: Annotated[Due, it("the next calibration", name="due")]
    page: Annotated[str | None, it("file of its page")] = None

    @property
    @key("of the last result where it is a pass: `weak` where nothing is to be entered")
    def grade(self) -> Grade | None:
        return None if self.judged is None else self.judged.grade

    @property
    @key("null without one")
    def clearest_jump(self) -> ClearestJump | None:
        jump = self.clearest
        if jump is None or jump.p_value is None:
            return None
        return ClearestJump(jump.offset, jump.before, jump.p_value, len(jump.events))

    @property
    def due(self) -> datetime | None:
        """The day of the next calibration."""
        return self.next_due.when

    @property
    def order(self) -> tuple[int, datetime, str, str]:
        """The gravest first; within a state the date that is due first, then by serial number."""
        return STATES.index(self.state), self.due or datetime.max, self.serial, self.model


@record(kw_only=True)
class FleetDocument:
    """`fleet.json`: every arm, the gravest first."""

    schema: Annotated[Literal["zerobeam/history-fleet/1"], _KIND] = FLEET_SCHEMA
    as_of: Annotated[str | None, it("day for which the states are stated")]
    tolerance_mm: Annotated[float, it("of the TCP error, millimetres")]
    states: Annotated[dict[str, int], it("how many arms are in each")]
    drift: Annotated[FleetDrift, it("`fleet` of `drift --json`")]
    arms: Annotated[
        tuple[ArmState, ...],
        it(
            "a list of `serial`, `model`, `state`, `results`, `counted`, `last`, `verdict`, `grade`, "
            "`jumps`, `undecided` (numbers), `clearest_jump` (`offset`, `before`, `p_value`, "
            "`events`), `due` and `page`"
        ),
    ]
