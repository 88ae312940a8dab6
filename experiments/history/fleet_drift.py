"""The drift of all arms of a history together: how fast each model walks, and which instruments are biased.

The answer of a single arm stays that of its own results: it does not depend on which other arms are asked.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from datetime import datetime
from functools import cached_property, partial
from typing import Annotated, Any, Final, Literal

import numpy as np

from ...analysis.drift.drift import ALARM, SPREAD, Drift
from ...analysis.drift.fleet import ArmRates, ModelRates, model_rates
from ...analysis.drift.instrument_biases import Bias, ComparableInstruments, MeasuredArm, instrument_biases
from ...model.arrays import Matrix
from ...model.records import if_any, inline, internal, it, key, record
from ..processes import side_by_side
from .arm_history import KIND, STATES, ArmDrift, ArmState, DatedJump, Rate, arm_drift
from .stored_result import Event, StoredResult

FLEET_SCHEMA: Final = "zerobeam/history-fleet/1"
# Of one arm, as `arm_drift` takes them.
ArmJob = tuple[tuple[str, str], Sequence[StoredResult], Sequence[Event]]

_MANY = 400  # arms: with fewer, processes take longer to start than they save
_TOGETHER = 16  # arms of a job: to hold threads back takes a tenth of the time of one


@record
class ModelWalk:
    """How fast an offset of a model walks: the `median` of its arms and their scatter `between` (standard
    deviation of the natural logarithm); None where no arm determines it.

    `arms` is how many do; `assumed`: in one of them the offset rests on an assumption. `noticed` is the
    median standard uncertainty of a result: `probability` is that the median arm walks farther in a year, and
    `drifts` whether this is said of the model, with all false alarms of the fleet below the stated
    probability. `biased` are instruments that may be biased in this offset and measured arms of the model.
    """

    model: str
    offset: str
    unit: str
    assumed: Annotated[bool, internal]
    arms: Annotated[int, it("how many determine the drift rate")]
    median: Annotated[Rate | None, it("of the median arm; null where not determined", name="rate")]
    between: Annotated[
        Rate | None, it("standard deviation of the natural logarithm between arms; null where not determined")
    ]
    noticed: Annotated[float, it("median standard uncertainty of a result")]
    probability: Annotated[
        float | None, it("that the median arm drifts farther in a year; null where not determined")
    ]
    drifts: Annotated[bool, it("whether it does, by that probability")]
    biased: Annotated[
        tuple[str, ...], it("instruments that may be biased in this offset and measured arms of the model")
    ]


@record
class ArmWalk:
    """The rate of an offset of an arm by its own results `alone`, and by those of its model too (`shrunken`;
    None where no arm of the model determines it). `borrowed`: its own results say next to nothing of it."""

    offset: Annotated[str, it("its name", name="name")]
    unit: str
    alone: Annotated[Rate, it("by the arm's own results")]
    shrunken: Annotated[Rate | None, it("with those of its model; null where not determined", name="rate")]
    borrowed: Annotated[bool, it("more is known by the other arms")]


@record
class ArmWalks:
    """The walks of an arm; `effective` is how many rates agree with its model's (coarse below `FEW`)."""

    serial: str
    model: str
    walks: Annotated[tuple[ArmWalk, ...], it("each offset", name="offsets")]
    effective: Annotated[
        float, it("effective number of rates that agree with the model", name="effective_rates")
    ]


@record
class InstrumentJump:
    """A jump of an arm at a change of instrument, and which of the two may be biased."""

    serial: str
    model: str
    jump: Annotated[DatedJump, inline(offset="offset", after="after", before="before")]
    biased: Annotated[tuple[str, ...], it("that may be biased", name="instruments")]


@record
class FleetDrift:
    """What all arms say together; `alarm` is the stated probability of a false alarm, of the models' walks
    and of the instruments' biases each. `too_few` counts arms with fewer than two results that count."""

    models: Annotated[tuple[ModelWalk, ...], it("each offset of each model")]
    arms: Annotated[tuple[ArmWalks, ...], it("each arm with its model")]
    biases: Annotated[
        tuple[Bias, ...],
        it(
            "of instruments: `offset`, `unit`, `instrument`, `against` (the mean of these), "
            "`estimate`, `std`, `interval95`, `p_value` (adjusted), `alarm`"
        ),
    ]
    comparable: Annotated[
        tuple[ComparableInstruments, ...],
        it("a list of `offset` and `groups` of instruments: nothing is determined between two groups"),
    ]
    unstated: Annotated[int, it("results that state no instrument")]
    suspects: Annotated[tuple[InstrumentJump, ...], it("jumps at a change of instrument, one biased")]
    too_few: Annotated[int, it("arms with fewer than two results that count")]
    alarm: Annotated[float, it("stated probability of any false alarm, of `models` and of `biases` each")]


def drift_of_each(
    jobs: Sequence[ArmJob], tolerance_mm: float, tell: Callable[[str, float], None]
) -> list[ArmDrift]:
    """The drift of each arm (`arm_drift`), in the order given; `tell` hears the share. By as many processes
    as there are cores, where there are many arms."""
    work = partial(_of_arm, tolerance_mm=tolerance_mm)
    return _each(work, jobs, len(jobs), lambda share: tell("arms", share))


def _of_arm(job: ArmJob, tolerance_mm: float) -> ArmDrift:
    return arm_drift(*job, tolerance_mm)


def _each(
    work: Callable[[Any], Any], jobs: Sequence[Any], arms: int, tell: Callable[[float], None]
) -> list[Any]:
    """The answers to jobs about so many arms, in the order of the jobs: the same bytes by one process as by
    several."""
    number, answered = len(jobs), dict[int, list[Any]]()
    some = _TOGETHER if number == arms else 1
    together = (jobs[k : k + some] for k in range(0, number, some))
    processes = None if arms >= _MANY else 1
    with closing(side_by_side(partial(_all_of, work), together, processes)) as answers:
        for k, of_some in answers:
            answered[k] = of_some
            tell(sum(map(len, answered.values())) / number)
    return [answer for k in range(len(answered)) for answer in answered[k]]


def _all_of(work: Callable[[Any], Any], jobs: Sequence[Any]) -> list[Any]:
    return [work(job) for job in jobs]


def fleet_drift(
    arms: Sequence[ArmDrift], tell: Callable[[str, float], None] = lambda stage, share: None
) -> FleetDrift:
    """The drift of all these arms together; `tell` hears stages and the share of the whole. Simulated arms
    have a part in it where all are."""
    arms = [arm for arm in arms if not arm.simulated] or arms
    counted = [(arm, arm.drift) for arm in arms if arm.drift is not None]
    by_model: dict[str, list[tuple[ArmDrift, Drift]]] = {}
    for arm, drift in counted:
        by_model.setdefault(arm.model, []).append((arm, drift))
    models = sorted(by_model)
    members = [[drift for _, drift in by_model[model]] for model in models]
    several = len(counted) if len(models) > 1 else 0
    tell("models", 0.0)
    rates_of_models = _each(model_rates, members, several, lambda share: tell("models", share / 3))
    rates: dict[str, ModelRates] = dict(zip(models, rates_of_models, strict=True))
    biases = instrument_biases(
        [MeasuredArm(drift, tuple(one.instrument for one in arm.used)) for arm, drift in counted],
        lambda work, jobs: _each(
            work, jobs, len(jobs), lambda share: tell("instruments", (1 + 2 * share) / 3)
        ),
    )
    biased = set(_biased_offsets(biases.biases))
    tests = max(sum(len(rate.names) for rate in rates.values()), 1)
    walks = tuple(
        model_walk
        for model, of_model in rates.items()
        for model_walk in _model_walks(model, by_model[model], of_model, biased, 1 - ALARM / tests)
    )
    return FleetDrift(
        models=walks,
        arms=tuple(
            _arm_walks(arm, drift, one, rates[model].names)
            for model, members in by_model.items()
            for (arm, drift), one in zip(members, rates[model].arms, strict=True)
        ),
        biases=biases.biases,
        comparable=biases.comparable,
        unstated=biases.unstated,
        suspects=tuple(_suspects([arm for arm, _ in counted], biased)),
        too_few=len(arms) - len(counted),
        alarm=ALARM,
    )


def _model_walks(
    model: str,
    members: Sequence[tuple[ArmDrift, Drift]],
    rates: ModelRates,
    biased: set[tuple[str, str]],
    enough: float,
) -> Iterator[ModelWalk]:
    units = {
        name: unit
        for _, arm in members
        for name, unit in zip(arm.series.names, arm.series.units, strict=True)
    }
    for offset in sorted(units, key=lambda name: (len(name), name)):
        stds, instruments = [], set()
        for arm, drift in members:
            for one, result in zip(drift.series.observations, arm.used, strict=True):
                if offset in one.names:
                    stds.append(np.sqrt(one.covariance[one.names.index(offset), one.names.index(offset)]))
                    instruments.add(result.instrument)
        noticed, known = float(np.median(stds)), offset in rates.names
        probability = rates.beyond(offset, noticed) if known else None
        yield ModelWalk(
            model=model,
            offset=offset,
            unit=units[offset],
            assumed=any(offset in arm.assumed for arm, _ in members),
            arms=sum(offset in arm.series.names and arm.determines_rate(offset) for _, arm in members),
            median=Rate(*rates.median(offset), rates.effective) if known else None,
            between=Rate(*rates.between(offset), rates.effective) if known else None,
            noticed=noticed,
            probability=probability,
            drifts=probability is not None and probability >= enough,
            biased=tuple(sorted(instrument for instrument in instruments if (instrument, offset) in biased)),
        )


def _arm_walks(arm: ArmDrift, drift: Drift, shrunken: ArmRates, known: Sequence[str]) -> ArmWalks:
    def arm_walk(offset: str, unit: str) -> ArmWalk:
        at = drift.series.names.index(offset)
        alone_rate = Rate(*drift.rate(offset), drift.effective)
        if offset not in known:
            return ArmWalk(offset, unit, alone_rate, None, False)
        alone = 1 / _log_variance(drift.rates[:, at], drift.weights)
        both = 1 / _log_variance(shrunken.rates[:, at], shrunken.weights)
        borrowed = both - alone > alone - 1 / SPREAD**2
        return ArmWalk(offset, unit, alone_rate, Rate(*shrunken.rate(offset), shrunken.effective), borrowed)

    walks = tuple(map(arm_walk, drift.series.names, drift.series.units))
    return ArmWalks(arm.serial, arm.model, walks, shrunken.effective)


def _log_variance(rates: Matrix, weights: Matrix) -> float:
    log_rate = np.log(rates)
    return float(weights @ (log_rate - weights @ log_rate) ** 2)


def _biased_offsets(biases: Sequence[Bias]) -> Iterator[tuple[str, str]]:
    """Instrument and offset that may be biased: of two of which only the difference is known, both."""
    for bias in biases:
        if bias.alarm:
            yield bias.instrument, bias.offset
            if len(bias.against) == 1:
                yield bias.against[0], bias.offset


def _suspects(arms: Sequence[ArmDrift], biased_offsets: set[tuple[str, str]]) -> Iterator[InstrumentJump]:
    for arm in arms:
        for jump in arm.jumps:
            named = filter(None, jump.instruments or ())
            biased = tuple(name for name in named if (name, jump.offset) in biased_offsets)
            if biased:
                yield InstrumentJump(arm.serial, arm.model, jump, biased)


@record(kw_only=True)
class DriftOfArms:
    """`history drift`: an arm, or all arms and what they say together."""

    schema: Annotated[Literal["zerobeam/drift/1"], KIND] = "zerobeam/drift/1"
    arms: Annotated[tuple[ArmDrift, ...], it("each arm by itself")]
    fleet: Annotated[FleetDrift | None, it("of all arms"), if_any] = None


@record(eq=False, kw_only=True)
class Fleet:
    """`fleet.json`: every arm, the gravest first, and what they say together; `asked` is the day of the
    question, None without any result."""

    schema: Annotated[Literal["zerobeam/history-fleet/1"], KIND] = FLEET_SCHEMA
    tolerance_mm: Annotated[float, it("of the TCP error by the offsets alone, millimetres")]
    drift: Annotated[FleetDrift, it("`fleet` of `drift --json`")]
    arms: Annotated[
        tuple[ArmState, ...],
        it(
            "a list of `serial`, `model`, `state`, `results`, `counted`, `last`, `verdict`, "
            "`simulated`, `grade`, `jumps`, `undecided` (numbers), `clearest_jump` (`offset`, `before`, "
            "`p_value`, `events`), `due` and `page`"
        ),
    ]
    asked: Annotated[datetime | None, internal]

    @property
    @key("day for which the states are stated")
    def as_of(self) -> str | None:
        return None if self.asked is None else f"{self.asked:%Y-%m-%d}"

    @cached_property
    @key("how many arms are in each")
    def states(self) -> dict[str, int]:
        numbers_of = Counter(row.state for row in self.arms)
        return {state: numbers_of[state] for state in STATES}
