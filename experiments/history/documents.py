"""The JSON of a history: results and events, the drift of arms, the states of all (docs/how-to/plant.md)."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field, PlainSerializer

from ...analysis.answer.message import Grade, May
from ...analysis.drift.drift import Jump, Undecided
from ...analysis.drift.instruments import Bias, ComparableInstruments
from ...analysis.status import Verdict
from ...model.files.json_document import JsonDocument, is_none
from ...words.judgement import Judgement
from .arm_drift import ArmDrift, DatedChange
from .content import Event, StoredCovariance, StoredOffset, StoredResult, What
from .fleet_drift import ArmWalks, FleetDrift, InstrumentJump, ModelWalk, Rate

HISTORY_SCHEMA: Literal["zerobeam/history/1"] = "zerobeam/history/1"
DRIFT_SCHEMA: Literal["zerobeam/drift/1"] = "zerobeam/drift/1"
ARM_SCHEMA: Literal["zerobeam/history-arm/1"] = "zerobeam/history-arm/1"
FLEET_SCHEMA: Literal["zerobeam/history-fleet/1"] = "zerobeam/history-fleet/1"


def utc(when: datetime) -> str:
    """A time of the history, which is UTC without a zone, as ISO 8601 with the zone."""
    return when.replace(tzinfo=UTC).isoformat()


Moment = Annotated[
    datetime,
    AfterValidator(lambda when: when.astimezone(UTC).replace(tzinfo=None) if when.tzinfo else when),
    PlainSerializer(utc),
]
Ends = tuple[float, float]


class HistoryResult(JsonDocument):
    """A result in the history."""

    sha256: str = Field(description="SHA-256 of the run")
    serial: str = Field(description="serial number of the arm")
    model: str = Field(description="name of the robot")
    measured_at: Moment = Field(description="when the run was measured, UTC")
    instrument: str | None = Field(description="null where the run does not state it")
    operator: str | None = Field(description="null where the run does not state it")
    run: str = Field(description="name of the run file")
    shots: int = Field(description="number of measurements")
    verdict: Verdict = Field(description="of the result")
    grade: Grade | None = Field(
        default=None,
        description="how the result is coloured (`message.grade`): a pass that nothing is to be entered by"
        " is `weak`, one of a simulated run `held`",
        exclude_if=is_none,
    )
    may: May | None = Field(
        default=None,
        description="`message.may` of the result: `enter`, `certify`, `export`",
        exclude_if=is_none,
    )
    zerobeam: str = Field(description="the version that made the result")
    document_sha256: str = Field(description="SHA-256 of the whole result.json")
    offsets: list[StoredOffset] = Field(description="rows as in the result; null what is not determined")
    without_prior: StoredCovariance | None = Field(description="as in the result")

    @classmethod
    def of(cls, result: StoredResult, judged: Judgement | None = None) -> HistoryResult:
        """The document of a result, and what it is worth where that was read."""
        return cls.filled(
            result,
            grade=None if judged is None else judged.grade,
            may=None if judged is None else judged.may,
            instrument=result.instrument or None,
            operator=result.operator or None,
            zerobeam=result.made_by,
        )


class HistoryEvent(JsonDocument):
    """What happened to an arm."""

    serial: str = Field(description="serial number of the arm")
    model: str = Field(description="name of the robot")
    at: Moment = Field(description="when, UTC")
    what: What = Field(description="what happened")
    note: str | None = Field(description="null where there is none")

    @classmethod
    def of(cls, event: Event) -> HistoryEvent:
        """The document of an event."""
        return cls.filled(event, note=event.note or None)


class HistoryDocument(JsonDocument):
    """`history list`, `show` and `export`: results, and the events of `show` and `export`."""

    schema_: Literal["zerobeam/history/1"] = Field(default=HISTORY_SCHEMA, alias="schema")
    serial: str | None = Field(default=None, description="of `show`: the arm", exclude_if=is_none)
    model: str | None = Field(default=None, description="of `show`: name of the robot", exclude_if=is_none)
    results: list[HistoryResult] = Field(description="in the order of arm and time")
    events: list[HistoryEvent] | None = Field(
        default=None, description="of `show` and `export`", exclude_if=is_none
    )


class RateRow(JsonDocument):
    """How fast an offset walks, per root year."""

    median: float = Field(description="of the posterior")
    interval95: Ends = Field(description="95 % interval")

    @classmethod
    def of(cls, rate: Rate | None) -> RateRow | None:
        """The document of a rate."""
        return None if rate is None else cls(median=rate[0], interval95=rate[1])


class DriftingOffset(JsonDocument):
    """An offset at the last result, by all results."""

    name: str
    unit: str
    estimate: float | None = Field(
        description="null where no result determines it since the last `mastering`, as the two below"
    )
    std: float | None = Field(description="standard uncertainty")
    interval95: Ends | None = Field(description="95 % interval")
    rate: RateRow | None = Field(
        description="drift rate per root year; null where the results do not determine it"
    )


class DriftChange(JsonDocument):
    """A change between two results that may be a jump or drift."""

    offset: str
    unit: str
    after: Moment = Field(description="time of the result before the change")
    before: Moment = Field(description="time of the result after the change")
    p_value: float | None = Field(default=None, description="of a jump, adjusted", exclude_if=is_none)
    size: float = Field(description="of the change")
    interval95: Ends = Field(description="95 % interval of the size")
    least_jump: float | None = Field(
        default=None,
        description="of what may be drift: the size from which such a change would be a jump",
        exclude_if=is_none,
    )
    events: list[HistoryEvent] = Field(description="logged in between")
    instruments: list[str | None] | None = Field(
        description="before and after, null where not stated; null where it did not change"
    )

    @classmethod
    def of(cls, dated: DatedChange[Jump] | DatedChange[Undecided]) -> DriftChange:
        """The document of a change."""
        change = dated.change
        names = dated.instruments
        return cls.filled(
            change,
            after=dated.after,
            before=dated.before,
            events=[HistoryEvent.of(event) for event in dated.events],
            instruments=None if names is None else [name or None for name in names],
        )


class LeftOutRow(JsonDocument):
    """A result that does not count."""

    sha256: str
    reason: str


class DueRow(JsonDocument):
    """When the next calibration is due."""

    tolerance_mm: float = Field(description="of the TCP error, millimetres")
    date: str | None = Field(description="null where there is none")
    reason: str | None = Field(description="null where there is nothing to say")

    @classmethod
    def of(cls, tolerance_mm: float, due: datetime | None, reason: str) -> DueRow:
        """The document of a due date."""
        return cls(
            tolerance_mm=tolerance_mm, date=None if due is None else f"{due:%Y-%m-%d}", reason=reason or None
        )


class ArmDriftRow(JsonDocument):
    """The drift of an arm."""

    serial: str = Field(description="of the arm")
    model: str = Field(description="name of the robot")
    used: list[str] = Field(description="SHA-256 of the runs that count")
    left_out: list[LeftOutRow] = Field(description="runs that do not count: `sha256` and `reason`")
    offsets: list[DriftingOffset] = Field(description="at the last result; empty with fewer than two results")
    jumps: list[DriftChange] = Field(description="significant changes from one result to the next")
    undecided: list[DriftChange] = Field(
        description="changes that may be a jump or drift: the same keys, `least_jump` instead of `p_value`"
    )
    effective_rates: float | None = Field(
        description=(
            "effective number of rates that the integrals are of; below 30 they are coarse; null with fewer "
            "than two results"
        )
    )
    due: DueRow = Field(description="the next calibration")

    @classmethod
    def of(cls, arm: ArmDrift) -> ArmDriftRow:
        """The document of an arm's drift."""
        return cls.filled(
            arm,
            used=[result.sha256 for result in arm.used],
            left_out=[LeftOutRow(sha256=left.result.sha256, reason=left.reason) for left in arm.left_out],
            offsets=offsets_now(arm),
            jumps=[DriftChange.of(jump) for jump in arm.jumps],
            undecided=[DriftChange.of(change) for change in arm.undecided],
            effective_rates=None if arm.drift is None else arm.drift.effective,
            due=DueRow.of(arm.tolerance_mm, arm.due, arm.due_reason),
        )


def offsets_now(arm: ArmDrift) -> list[DriftingOffset]:
    """Each offset at the last result."""
    if arm.drift is None:
        return []
    series, rows = arm.drift.series, []
    for i, name in enumerate(series.names):
        along, last = np.eye(len(series.names))[i], -1
        known = bool(series.determined[last, i])
        value, std = arm.drift.value(last, along) if known else (None, None)
        rows.append(
            DriftingOffset(
                name=name,
                unit=series.units[i],
                estimate=value,
                std=std,
                interval95=arm.drift.interval(last, along) if known else None,
                rate=RateRow.of(arm.drift.rate(name)) if arm.drift.determines_rate(name) else None,
            )
        )
    return rows


class ModelRow(JsonDocument):
    """The drift rate of an offset of a model."""

    model: str
    offset: str
    unit: str
    arms: int = Field(description="how many determine the drift rate")
    rate: RateRow | None = Field(description="of the median arm; null where not determined")
    between: RateRow | None = Field(
        description="standard deviation of the natural logarithm between arms; null where not determined"
    )
    noticed: float = Field(description="median standard uncertainty of a result")
    probability: float | None = Field(
        description="that the median arm drifts farther in a year; null where not determined"
    )
    drifts: bool = Field(description="whether it does, by that probability")
    biased: list[str] = Field(
        description="instruments that may be biased in this offset and measured arms of the model"
    )

    @classmethod
    def of(cls, drift: ModelWalk) -> ModelRow:
        """The document of a model's drift rate."""
        return cls.filled(drift, rate=RateRow.of(drift.median), between=RateRow.of(drift.between))


class WalkRow(JsonDocument):
    """The drift rate of an offset of an arm."""

    name: str
    unit: str
    alone: RateRow | None = Field(description="by the arm's own results")
    rate: RateRow | None = Field(description="with those of its model; null where not determined")
    borrowed: bool = Field(description="more is known by the other arms")


class ArmWalksRow(JsonDocument):
    """The drift rates of an arm."""

    serial: str
    model: str
    effective_rates: float = Field(description="effective number of rates that agree with the model")
    offsets: list[WalkRow]

    @classmethod
    def of(cls, arm: ArmWalks) -> ArmWalksRow:
        """The document of an arm's walks."""
        rows = [
            WalkRow.filled(row, name=row.offset, alone=RateRow.of(row.alone), rate=RateRow.of(row.shrunken))
            for row in arm.walks
        ]
        return cls.filled(arm, effective_rates=arm.effective, offsets=rows)


class InstrumentJumpRow(JsonDocument):
    """A jump at a change of instrument where one is biased."""

    serial: str
    model: str
    offset: str
    after: Moment
    before: Moment
    instruments: list[str] = Field(description="that may be biased")

    @classmethod
    def of(cls, jump: InstrumentJump) -> InstrumentJumpRow:
        """The document of such a jump."""
        dated = jump.jump
        return cls.filled(
            jump,
            offset=dated.change.offset,
            after=dated.after,
            before=dated.before,
            instruments=jump.biased,
        )


class FleetDriftRow(JsonDocument):
    """What all arms say together."""

    alarm: float = Field(
        description="stated probability of any false alarm, of `models` and of `biases` each"
    )
    models: list[ModelRow] = Field(description="each offset of each model")
    arms: list[ArmWalksRow] = Field(description="each arm with its model")
    biases: list[Bias] = Field(
        description=(
            "of instruments: `offset`, `unit`, `instrument`, `against` (the mean of these), `estimate`, "
            "`std`, `interval95`, `p_value` (adjusted), `alarm`"
        )
    )
    comparable: list[ComparableInstruments] = Field(
        description="a list of `offset` and `groups` of instruments: nothing is determined between two groups"
    )
    unstated: int = Field(description="results that state no instrument")
    suspects: list[InstrumentJumpRow] = Field(description="jumps at a change of instrument, one biased")
    too_few: int = Field(description="arms with fewer than two results that count")

    @classmethod
    def of(cls, fleet: FleetDrift) -> FleetDriftRow:
        """The document of all arms' drift."""
        return cls.filled(
            fleet,
            models=[ModelRow.of(drift) for drift in fleet.models],
            arms=[ArmWalksRow.of(arm) for arm in fleet.arms],
            suspects=[InstrumentJumpRow.of(suspect) for suspect in fleet.suspects],
        )


class DriftDocument(JsonDocument):
    """`history drift`: an arm, or all arms and what they say together."""

    schema_: Literal["zerobeam/drift/1"] = Field(default=DRIFT_SCHEMA, alias="schema")
    arms: list[ArmDriftRow] = Field(description="each arm by itself")
    fleet: FleetDriftRow | None = Field(default=None, description="of all arms", exclude_if=is_none)

    @classmethod
    def of(cls, arms: Sequence[ArmDrift], fleet: FleetDrift | None) -> DriftDocument:
        """The document of the drift of these arms."""
        rows = [ArmDriftRow.of(arm) for arm in arms]
        return cls(arms=rows, fleet=None if fleet is None else FleetDriftRow.of(fleet))


class ArmDocument(JsonDocument):
    """`arm.json`: state, drift, results and events of an arm."""

    schema_: Literal["zerobeam/history-arm/1"] = Field(default=ARM_SCHEMA, alias="schema")
    serial: str
    model: str
    as_of: str | None = Field(description="day for which the state is stated")
    headline: str = Field(description="the next calibration, in a sentence")
    state: str = Field(description="`overdue`, … as above")
    undetermined: list[str] = Field(description="offsets that no result determines")
    drift: ArmDriftRow = Field(description="as in `arms` of `drift --json`")
    results: list[HistoryResult] = Field(description="as of `show --json`")
    events: list[HistoryEvent] = Field(description="as of `show --json`")


class ClearestJump(JsonDocument):
    """The jump of an arm with the smallest p-value, one without an event before others."""

    offset: str
    before: Moment
    p_value: float
    events: int = Field(description="how many were logged in between")


class FleetArm(JsonDocument):
    """An arm in the list of all arms."""

    serial: str
    model: str
    state: str
    results: int
    counted: int = Field(description="results that count")
    last: Moment | None = Field(description="time of the last result")
    verdict: Verdict | None
    grade: Grade | None = Field(
        default=None,
        description="of the last result where it is a pass: `weak` where nothing is to be entered",
    )
    jumps: int
    clearest_jump: ClearestJump | None
    undecided: int = Field(description="changes that may be a jump or drift")
    due: DueRow
    page: str | None = Field(default=None, description="file of its page")


class FleetDocument(JsonDocument):
    """`fleet.json`: every arm, the gravest first."""

    schema_: Literal["zerobeam/history-fleet/1"] = Field(default=FLEET_SCHEMA, alias="schema")
    as_of: str | None = Field(description="day for which the states are stated")
    tolerance_mm: float = Field(description="of the TCP error, millimetres")
    states: dict[str, int] = Field(description="how many arms are in each")
    drift: FleetDriftRow = Field(description="`fleet` of `drift --json`")
    arms: list[FleetArm] = Field(
        description=(
            "a list of `serial`, `model`, `state`, `results`, `counted`, `last`, `verdict`, `grade`, "
            "`jumps`, `undecided` (numbers), `clearest_jump` (`offset`, `before`, `p_value`, `events`), "
            "`due` and `page`"
        )
    )
