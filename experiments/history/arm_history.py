"""What a history says of its arms, as `history` writes it: results and events, an arm and how it is doing in
one word, a row of the list of all arms (docs/how-to/plant.md)."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from functools import cached_property
from typing import Annotated, Final, Literal, get_args

from ...analysis.answer.answer_message import Grade, Message
from ...analysis.status import Verdict
from ...model.records import if_any, internal, it, key, record, worded
from .arm_drift import NOT_SOON, ArmDrift, DatedJump, Due
from .stored_result import Event, Moment, StoredResult, last_of

State = Literal["overdue", "jump without event", "jump", "misfit", "no due date", "on schedule"]
# The gravest first.
STATES: tuple[State, ...] = get_args(State)
HISTORY_SCHEMA: Final = "zerobeam/history/1"
ARM_SCHEMA: Final = "zerobeam/history-arm/1"
KIND = it("kind and version of the document")


@record(kw_only=True)
class HistoryList:
    """`history list`, `show` and `export`: results, and the events of `show` and `export`."""

    schema: Annotated[Literal["zerobeam/history/1"], KIND] = HISTORY_SCHEMA
    serial: Annotated[str | None, it("of `show`: the arm"), if_any] = None
    model: Annotated[str | None, it("of `show`: name of the robot"), if_any] = None
    results: Annotated[tuple[StoredResult, ...], it("in the order of arm and time")]
    events: Annotated[tuple[Event, ...] | None, it("of `show` and `export`"), if_any] = None


@record
class ClearestJump:
    """The jump of an arm with the smallest p-value, one without an event before others."""

    offset: str
    before: Moment
    p_value: float
    events: Annotated[int, it("how many were logged in between")]
    assumed: Annotated[bool, internal] = False


@record(kw_only=True)
class ArmState:
    """A row of the list of all arms; `undecided` is how many changes may be a jump or drift."""

    serial: str
    model: str
    state: State
    results: int
    counted: Annotated[int, it("results that count")]
    last: Annotated[Moment | None, it("time of the last result")]
    verdict: Verdict | None
    simulated: Annotated[bool, it("whether the last result is")] = False
    judged: Annotated[Message | None, internal]
    jumps: int
    undecided: Annotated[int, it("changes that may be a jump or drift")] = 0
    next_due: Annotated[Due, it("the next calibration", name="due")]
    page: Annotated[str | None, it("file of its page")] = None
    clearest_jump: Annotated[ClearestJump | None, it("null without one")] = None

    @property
    @key("of the last result where it is a pass: `weak` where nothing is to be entered")
    def grade(self) -> Grade | None:
        return None if self.judged is None else self.judged.grade

    @property
    def due(self) -> datetime | None:
        """The day of the next calibration."""
        return self.next_due.when

    @property
    def order(self) -> tuple[int, datetime, str, str]:
        """The gravest first; within a state the date that is due first, then by serial number."""
        return STATES.index(self.state), self.due or datetime.max, self.serial, self.model


@record(eq=False, kw_only=True)
class ArmHistory:
    """`arm.json`: an arm with all that the history has of it, and what each pass is worth (`judged`); `asked`
    is the day of the question, None without a result in the history."""

    schema: Annotated[Literal["zerobeam/history-arm/1"], KIND] = ARM_SCHEMA
    arm: Annotated[ArmDrift, it("as in `arms` of `drift --json`", name="drift")]
    results: Annotated[tuple[StoredResult, ...], it("in the order of time")]
    judged: Annotated[tuple[Message | None, ...], internal]
    events: Annotated[tuple[Event, ...], it("in the order of time")]
    asked: Annotated[datetime | None, internal]
    headline: Annotated[str | None, worded("the next calibration, in a sentence")] = None

    @property
    @key("serial number of the arm")
    def serial(self) -> str:
        return self.arm.serial

    @property
    @key("name of the robot")
    def model(self) -> str:
        return self.arm.model

    @property
    @key("day for which the state is stated")
    def as_of(self) -> str | None:
        return None if self.asked is None else f"{self.asked:%Y-%m-%d}"

    @property
    @key("`overdue`, … as above")
    def state(self) -> State:
        arm, last = self.arm, self.last
        late = self.asked is not None and arm.due is not None and arm.due.date() <= self.asked.date()
        if arm.due is not None and (arm.due_reason or late):
            return "overdue"
        if any(not jump.events for jump in arm.jumps):
            return "jump without event"
        if arm.jumps:
            return "jump"
        if last is not None and last.verdict == "misfit":
            return "misfit"
        return "no due date" if arm.due is None and arm.due_reason != NOT_SOON else "on schedule"

    @cached_property
    @key("offsets that no result determines")
    def undetermined(self) -> tuple[str, ...]:
        """The offsets that some result wanted to know, and that none which counts determines."""
        free = [result.without_prior for result in self.arm.used if result.without_prior]
        determined = {name for of_result in free for name in of_result.names}
        return tuple(name for name in offset_names(self.results) if name not in determined)

    @property
    def clearest(self) -> DatedJump | None:
        """The jump with the smallest p-value, one without an event before others."""
        return min(self.arm.jumps, key=lambda jump: (bool(jump.events), jump.p_value), default=None)

    @property
    def last(self) -> StoredResult | None:
        """The last result: a simulated one where there is no other."""
        return last_of(self.results) if self.results else None

    @property
    def row(self) -> ArmState:
        """Its row in the list of all arms."""
        jump, last = self.clearest, self.last
        return ArmState(
            serial=self.serial,
            model=self.model,
            state=self.state,
            results=len(self.results),
            counted=len(self.arm.used),
            last=None if last is None else last.measured_at,
            verdict=None if last is None else last.verdict,
            simulated=last is not None and last.simulated,
            judged=None if last is None else self.judged[self.results.index(last)],
            jumps=len(self.arm.jumps),
            undecided=len(self.arm.undecided),
            next_due=self.arm.next_due,
            clearest_jump=None
            if jump is None
            else ClearestJump(
                *(jump.offset, jump.before, jump.p_value, len(jump.events)), jump.offset in self.arm.assumed
            ),
        )


def offset_names(results: Sequence[StoredResult]) -> list[str]:
    """The offsets that any of the results estimates, joint 1 first."""
    names = {row.name for result in results for row in result.offsets if not row.held}
    return sorted(names, key=lambda name: (len(name), name))
