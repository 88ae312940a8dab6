"""What a history says of its arms, as `history` writes it: results and events, an arm's drift and how it is
doing in one word, a row of the list of all arms (docs/how-to/plant.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from functools import cached_property
from typing import Annotated, Final, Literal, TypeVar, get_args

import numpy as np

from ...analysis.answer.answer_message import Grade, Message
from ...analysis.drift.drift import HORIZON_YEARS, Drift, Jump, OffsetChange, Undecided, drift, due_after
from ...analysis.drift.instrument_biases import change_at
from ...analysis.drift.smoother import Observation, series_of
from ...analysis.row import ParameterRow
from ...analysis.status import NOT_DESCRIBED, Verdict, has_numbers
from ...analysis.tcp_region import NO_EFFECT
from ...model.records import if_any, inline, internal, it, key, or_null, record, worded
from ...words.provenance import NOTHING_MEASURED
from .stored_result import Event, Moment, StoredResult, last_of

YEAR = timedelta(days=365.25)
NOT_SOON = f"not within {HORIZON_YEARS:g} years"
_AT_ONCE = (
    "another result states the same time, so that their order is not known; zerobeam history add FILE --when"
    " TIME --replace states the time of day"
)
FEW = 30  # rates: below, numbers that are integrals over them are coarse


@record
class LeftOut:
    """A result that does not count, and why."""

    result: Annotated[StoredResult, inline(sha256="sha256")]
    reason: str


@record(kw_only=True)
class DatedChange(OffsetChange):
    """A change between two results, and the events that were logged in between.

    `instruments` are those before and after (of the nearest results that determine the offset) where they
    differ: a bias looks like a jump.
    """

    after: Annotated[Moment, it("time of the result before the change")]
    before: Annotated[Moment, it("time of the result after the change")]
    events: Annotated[tuple[Event, ...], it("logged in between")]
    instruments: Annotated[
        tuple[str | None, str | None] | None,
        it("before and after, null where not stated; null where it did not change"),
    ]


@record(kw_only=True)
class DatedJump(Jump, DatedChange):
    """A jump between two results."""


@record(kw_only=True)
class DatedUndecided(Undecided, DatedChange):
    """A change between two results that may be a jump or drift."""


Dated = TypeVar("Dated", DatedJump, DatedUndecided)


@record
class Rate:
    """How fast an offset walks, per root year, by so many rates (`effective`)."""

    median: Annotated[float, it("of the posterior")]
    interval95: Annotated[tuple[float, float], it("95 % interval")]
    effective: Annotated[float, internal]


@record(repr=False)
class DriftingOffset(ParameterRow):
    """An offset at the last result, by all results: unidentifiable where none determines it since the last
    `mastering`, assumed where one of those that do rests on an assumption for it."""

    rate: Annotated[Rate | None, it("drift rate per root year; null where the results do not determine it")]


@record
class Due:
    """When the next calibration is due."""

    tolerance_mm: Annotated[float, it("of the TCP error by the offsets alone, millimetres")]
    when: Annotated[datetime | None, internal]
    reason: Annotated[str, it("null where there is nothing to say"), or_null]

    @property
    @key("null where there is none")
    def date(self) -> str | None:
        return None if self.when is None else f"{self.when:%Y-%m-%d}"


@record(eq=False)
class ArmDrift:
    """What an arm's results say of its drift. `drift` is None with fewer than two results that count.

    `due` is None where no date can be given; `due_reason` says why, or why it is due already, "" where
    nothing is to be said.
    """

    serial: Annotated[str, it("of the arm")]
    model: Annotated[str, it("name of the robot")]
    used: Annotated[tuple[StoredResult, ...], internal]
    left_out: Annotated[tuple[LeftOut, ...], it("runs that do not count: `sha256` and `reason`")]
    drift: Annotated[Drift | None, internal]
    jumps: Annotated[tuple[DatedJump, ...], it("significant changes from one result to the next")]
    undecided: Annotated[
        tuple[DatedUndecided, ...],
        it("changes that may be a jump or drift: the same keys, `least_jump` instead of `p_value`"),
    ]
    tolerance_mm: Annotated[float, internal]
    due: Annotated[datetime | None, internal]
    due_reason: Annotated[str, internal]

    @property
    @key("SHA-256 of the runs that count", name="used")
    def sums(self) -> tuple[str, ...]:
        return tuple(result.sha256 for result in self.used)

    @property
    def simulated(self) -> bool:
        """Whether no robot was measured."""
        return any(result.simulated for result in self.used)

    @property
    @key("at the last result; empty with fewer than two results")
    def offsets(self) -> tuple[DriftingOffset, ...]:
        return () if self.drift is None else tuple(map(self._now, self.drift.series.names))

    @property
    @key(
        "effective number of rates that the integrals are of; below 30 they are coarse; null with "
        "fewer than two results"
    )
    def effective_rates(self) -> float | None:
        return None if self.drift is None else self.drift.effective

    @property
    @key("the next calibration", name="due")
    def next_due(self) -> Due:
        return Due(self.tolerance_mm, self.due, self.due_reason)

    @cached_property
    def assumed(self) -> frozenset[str]:
        """The offsets for which a result since the last mastering rests on an assumption."""
        begin = 0 if self.drift is None else max((t + 1 for t in self.drift.series.reset), default=0)
        rows = (row for result in self.used[begin:] for row in result.offsets)
        return frozenset(row.name for row in rows if row.status == "assumed")

    def _now(self, name: str) -> DriftingOffset:
        """An offset at the last result."""
        assert self.drift is not None
        drift, series = self.drift, self.drift.series
        i = series.names.index(name)
        along, known = np.eye(len(series.names))[i], bool(series.determined[-1, i])
        value, std = drift.value(-1, along) if known else (None, None)
        return DriftingOffset(
            name,
            series.units[i],
            ("assumed" if name in self.assumed else "identified") if known else "unidentifiable",
            value,
            std,
            drift.interval(-1, along) if known else None,
            Rate(*drift.rate(name), drift.effective) if drift.determines_rate(name) else None,
        )

    def without_states(self) -> ArmDrift:
        """As of `Drift`."""
        return replace(self, drift=None if self.drift is None else self.drift.without_states())


def arm_drift(
    arm: tuple[str, str], results: Sequence[StoredResult], events: Sequence[Event], tolerance_mm: float
) -> ArmDrift:
    """The drift of an arm (serial number, model) by its results and events.

    What may have changed the arm since the last result that counts (collision, motor, mastering) makes the
    next calibration due when it happened. Results that state one time do not count: their order is not known.
    Simulated ones count where no other is there.
    """
    measured = any(not result.simulated for result in results)
    reasons = [
        f"simulated, and other results are not: {NOTHING_MEASURED}"
        if measured and result.simulated
        else _why_not(result)
        for result in results
    ]
    # Of measurements that two results are of, one counts: the one without those that were left out.
    again = {result.made_of for result, reason in zip(results, reasons, strict=True) if reason is None}
    reasons = [
        reason or ("its run counts without some measurements" if result.sha256 in again else None)
        for result, reason in zip(results, reasons, strict=True)
    ]
    used = [result for result, reason in zip(results, reasons, strict=True) if reason is None]
    at_once = Counter(result.measured_at for result in used)
    last = used[-1].measured_at if used else None
    used = [result for result in used if at_once[result.measured_at] == 1]
    left_out = [
        LeftOut(result, reason or _AT_ONCE)
        for result, reason in zip(results, reasons, strict=True)
        if reason is not None or at_once[result.measured_at] > 1
    ]
    model, due, reason = None, None, "fewer than two results count"
    jumps: tuple[DatedJump, ...] = ()
    undecided: tuple[DatedUndecided, ...] = ()
    if len(used) >= 2:
        units = {row.name: row.unit for result in used for row in result.offsets}
        at = [result.measured_at for result in used]
        reset = [t for t in range(len(at) - 1) if _between(events, at[t], at[t + 1], "mastering")]
        model = drift(series_of([_observation(result, used[0].measured_at) for result in used], units, reset))
        instruments = [result.instrument for result in used]

        def dated(kind: type[Dated], change: Jump | Undecided) -> Dated:
            assert model is not None
            after, before = at[change.place], at[change.place + 1]
            changed = change_at(model.series, instruments, change.place, change.offset)
            return kind(
                **vars(change),
                after=after,
                before=before,
                events=_between(events, after, before),
                instruments=None if changed is None else (changed[0] or None, changed[1] or None),
            )

        jumps = tuple(dated(DatedJump, change) for change in model.jumps)
        undecided = tuple(dated(DatedUndecided, change) for change in model.undecided)
        due, reason = _due(model, used[-1], tolerance_mm)
    if last is not None and at_once[last] > 1:
        due, reason = None, "which result is the last is not known: several state its time"
    if last is not None and (since := _since(events, last)):
        due, reason = since[0].at, f"{since[0].what} on {since[0].at:%Y-%m-%d}, after the last result"
    return ArmDrift(*arm, tuple(used), tuple(left_out), model, jumps, undecided, tolerance_mm, due, reason)


def _why_not(result: StoredResult) -> str | None:
    if result.verdict == "misfit":
        return f"misfit: {NOT_DESCRIBED}"
    if result.without_prior is None and not any(has_numbers(row.status) for row in result.offsets):
        return "it determines no offset"
    if result.without_prior is None:
        return "it has no covariance of the offsets without prior: add it again, made by this version"
    dof = result.without_prior.dof
    if dof is not None and dof <= 2:
        return "its noise is estimated with two degrees of freedom or fewer"
    return None


def _observation(result: StoredResult, first: datetime) -> Observation:
    free = result.without_prior
    assert free is not None
    dof = free.dof
    # An estimated noise: the variance of Student's t.
    factor = 1.0 if dof is None else dof / (dof - 2)
    by_geometry = np.array(free.by_geometry, float).reshape(len(free.names), -1)
    return Observation(
        at=(result.measured_at - first) / YEAR,
        names=tuple(free.names),
        values=np.array(free.values, float),
        covariance=factor * np.array(free.covariance, float),
        shared=by_geometry @ by_geometry.T,
    )


def _between(
    events: Sequence[Event], after: datetime, before: datetime, what: str | None = None
) -> tuple[Event, ...]:
    return tuple(event for event in events if after <= event.at <= before and what in (None, event.what))


def _since(events: Sequence[Event], last: datetime) -> tuple[Event, ...]:
    """What may have changed the offsets after the last result."""
    return tuple(event for event in events if event.at > last and event.what != "other")


def _due(drift: Drift, last: StoredResult, tolerance_mm: float) -> tuple[datetime | None, str]:
    if last.sensitivity_mm2 is None:
        return None, "the last result claims no accuracy at the TCP"
    names, matrix = [row.name for row in last.offsets], np.array(last.sensitivity_mm2, float)
    unknown = [name for i, name in enumerate(names) if matrix[i, i] > 0 and name not in drift.series.names]
    if unknown:
        return None, f"the TCP depends on offsets that no result determines: {', '.join(unknown)}"
    assumed = [
        row.name
        for i, row in enumerate(last.offsets)
        if row.status == "assumed" and matrix[i, i] > NO_EFFECT**2
    ]
    if assumed:
        return None, f"the TCP depends on offsets that are assumed: {', '.join(assumed)}"
    lost = [
        name
        for name, is_known in zip(drift.series.names, drift.series.determined[-1], strict=True)
        if not is_known
    ]
    if lost:
        return None, f"no result since the last mastering determines {', '.join(lost)}"
    at = [names.index(name) for name in drift.series.names if name in names]
    if len(at) < len(drift.series.names):
        return None, "the last result has other offsets than the results before"
    years = due_after(drift, matrix[np.ix_(at, at)], tolerance_mm)
    if years is None:
        return None, NOT_SOON
    if years == 0:
        return last.measured_at, "the uncertainty at the last result exceeds the tolerance already"
    try:
        return last.measured_at + years * YEAR, ""
    except OverflowError:  # behind the last day of the calendar
        return None, NOT_SOON


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
