"""The drift of all arms of a history together: how fast each model walks, and which instruments are biased.

The answer of a single arm stays that of its own results: it does not depend on which other arms are asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...analysis.drift.drift import ALARM, SPREAD, Drift
from ...analysis.drift.fleet import ArmRates, ModelRates, model_rates
from ...analysis.drift.instruments import Bias, ComparableInstruments, MeasuredArm, instrument_biases
from ...model.arrays import Matrix
from ..processes import side_by_side
from .arm_drift import ArmDrift, DatedJump, arm_drift
from .store import Event, StoredResult

# Of one arm, as `arm_drift` takes them.
ArmJob = tuple[tuple[str, str], Sequence[StoredResult], Sequence[Event]]

_MANY = 100  # arms: with fewer, processes take longer to start than they save
FEW = 30  # rates of an arm that agree with its model: below, its numbers are coarse

Rate = tuple[float, tuple[float, float]]  # median and 95 % interval


@dataclass(frozen=True)
class ModelWalk:
    """How fast an offset of a model walks: the `median` of its arms and their scatter `between` (standard
    deviation of the natural logarithm); None where no arm determines it.

    `arms` is how many do. `noticed` is the median standard uncertainty of a result: `probability` is that the
    median arm walks farther in a year, and `drifts` whether this is said of the model, with all false alarms
    of the fleet below the stated probability. `biased` are instruments that may be biased in this
    offset and measured arms of the model.
    """

    model: str
    offset: str
    unit: str
    arms: int
    median: Rate | None
    between: Rate | None
    noticed: float
    probability: float | None
    drifts: bool
    biased: tuple[str, ...]


@dataclass(frozen=True)
class ArmWalk:
    """The rate of an offset of an arm by its own results `alone`, and by those of its model too (`shrunken`;
    None where no arm of the model determines it). `borrowed`: its own results say next to nothing of it."""

    offset: str
    unit: str
    alone: Rate
    shrunken: Rate | None
    borrowed: bool


@dataclass(frozen=True)
class ArmWalks:
    """The walks of an arm; `effective` is how many rates agree with its model's (coarse below `FEW`)."""

    serial: str
    model: str
    walks: tuple[ArmWalk, ...]
    effective: float


@dataclass(frozen=True)
class Suspect:
    """A jump of an arm at a change of instrument, and which of the two may be biased."""

    serial: str
    model: str
    jump: DatedJump
    biased: tuple[str, ...]


@dataclass(frozen=True)
class FleetDrift:
    """What all arms say together; `alarm` is the stated probability of a false alarm, of the models' walks
    and of the instruments' biases each. `too_few` counts arms with fewer than two results that count."""

    models: tuple[ModelWalk, ...]
    arms: tuple[ArmWalks, ...]
    biases: tuple[Bias, ...]
    comparable: tuple[ComparableInstruments, ...]
    unstated: int
    suspects: tuple[Suspect, ...]
    too_few: int
    alarm: float


def drift_of_each(
    jobs: Iterable[ArmJob], number: int, tolerance_mm: float, tell: Callable[[str, float], None]
) -> list[ArmDrift]:
    """The drift of each arm of so many (`arm_drift`), in the order given, with the states at the last result
    alone; `tell` hears the share. By as many processes as there are cores, where there are many arms."""
    work = partial(_at_last, tolerance_mm=tolerance_mm)
    return _each(work, jobs, number, number, lambda share: tell("arms", share))


def _at_last(job: ArmJob, tolerance_mm: float) -> ArmDrift:
    return arm_drift(*job, tolerance_mm).at_last()


def _each(
    work: Callable[[Any], Any],
    jobs: Iterable[Any],
    number: int,
    arms: int,
    tell: Callable[[float], None],
) -> list[Any]:
    """The answers to so many jobs about so many arms, in the order of the jobs: the same bytes by one process
    as by several."""
    found: dict[int, Any] = {}
    with closing(side_by_side(work, jobs, None if arms >= _MANY else 1)) as answers:
        for k, answer in answers:
            found[k] = answer
            tell(len(found) / number)
    return [found[k] for k in range(len(found))]


def fleet_drift(
    arms: Sequence[ArmDrift], tell: Callable[[str, float], None] = lambda stage, share: None
) -> FleetDrift:
    """The drift of all these arms together; `tell` hears stages and the share of the whole."""
    counted = [(own, own.drift) for own in arms if own.drift is not None]
    by_model: dict[str, list[tuple[ArmDrift, Drift]]] = {}
    for own, found in counted:
        by_model.setdefault(own.model, []).append((own, found))
    models = sorted(by_model)
    members = [[found for _, found in by_model[model]] for model in models]
    several = len(counted) if len(models) > 1 else 0
    tell("models", 0.0)
    found_rates = _each(model_rates, members, len(members), several, lambda share: tell("models", share / 3))
    rates: dict[str, ModelRates] = dict(zip(models, found_rates, strict=True))
    biases = instrument_biases(
        [MeasuredArm(found, tuple(one.instrument for one in own.used)) for own, found in counted],
        lambda work, jobs: _each(
            work, jobs, len(jobs), len(jobs), lambda share: tell("instruments", (1 + 2 * share) / 3)
        ),
    )
    odd = set(_odd(biases.biases))
    tests = max(sum(len(own.names) for own in rates.values()), 1)
    walks = tuple(
        walk
        for model, own in rates.items()
        for walk in _model_walks(model, by_model[model], own, odd, 1 - ALARM / tests)
    )
    return FleetDrift(
        models=walks,
        arms=tuple(
            _arm_walks(own, found, one, rates[model].names)
            for model, members in by_model.items()
            for (own, found), one in zip(members, rates[model].arms, strict=True)
        ),
        biases=biases.biases,
        comparable=biases.comparable,
        unstated=biases.unstated,
        suspects=tuple(_suspects([own for own, _ in counted], odd)),
        too_few=len(arms) - len(counted),
        alarm=ALARM,
    )


def _model_walks(
    model: str,
    members: Sequence[tuple[ArmDrift, Drift]],
    rates: ModelRates,
    odd: set[tuple[str, str]],
    enough: float,
) -> Iterator[ModelWalk]:
    units = {
        name: unit
        for _, own in members
        for name, unit in zip(own.series.names, own.series.units, strict=True)
    }
    for offset in sorted(units, key=lambda name: (len(name), name)):
        stds, instruments = [], set()
        for own, found in members:
            for one, result in zip(found.series.observations, own.used, strict=True):
                if offset in one.names:
                    stds.append(np.sqrt(one.covariance[one.names.index(offset), one.names.index(offset)]))
                    instruments.add(result.instrument)
        noticed, known = float(np.median(stds)), offset in rates.names
        probability = rates.beyond(offset, noticed) if known else None
        yield ModelWalk(
            model=model,
            offset=offset,
            unit=units[offset],
            arms=sum(offset in own.series.names and own.determines_rate(offset) for _, own in members),
            median=rates.median(offset) if known else None,
            between=rates.between(offset) if known else None,
            noticed=noticed,
            probability=probability,
            drifts=probability is not None and probability >= enough,
            biased=tuple(sorted(own for own in instruments if (own, offset) in odd)),
        )


def _arm_walks(own: ArmDrift, found: Drift, shrunken: ArmRates, known: Sequence[str]) -> ArmWalks:
    def walk(offset: str, unit: str) -> ArmWalk:
        at = found.series.names.index(offset)
        if offset not in known:
            return ArmWalk(offset, unit, found.rate(offset), None, False)
        alone = 1 / _log_variance(found.rates[:, at], found.weights)
        both = 1 / _log_variance(shrunken.rates[:, at], shrunken.weights)
        borrowed = both - alone > alone - 1 / SPREAD**2
        return ArmWalk(offset, unit, found.rate(offset), shrunken.rate(offset), borrowed)

    walks = tuple(map(walk, found.series.names, found.series.units))
    return ArmWalks(own.serial, own.model, walks, shrunken.effective)


def _log_variance(rates: Matrix, weights: Matrix) -> float:
    log_rate = np.log(rates)
    return float(weights @ (log_rate - weights @ log_rate) ** 2)


def _odd(biases: Sequence[Bias]) -> Iterator[tuple[str, str]]:
    """Instrument and offset that may be biased: of two of which only the difference is known, both."""
    for own in biases:
        if own.alarm:
            yield own.instrument, own.offset
            if len(own.against) == 1:
                yield own.against[0], own.offset


def _suspects(arms: Sequence[ArmDrift], odd: set[tuple[str, str]]) -> Iterator[Suspect]:
    for own in arms:
        for jump in own.jumps:
            biased = tuple(name for name in jump.instruments or () if (name, jump.jump.offset) in odd)
            if biased:
                yield Suspect(own.serial, own.model, jump, biased)
