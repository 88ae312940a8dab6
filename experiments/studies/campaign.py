"""Runs of the procedure, each in a simulated cell of its own.

A run depends on its seed alone: the arm that is drawn, where its PSD is, all noise. So the answer is the
same for any number of processes.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...analysis.solution import Solution
from ...model.errors import ZerobeamError
from ...model.files.plan import Plan
from ...model.files.shot import Shot
from ...model.likelihood.problem import Problem
from ..procedure.events import RunEvent
from ..procedure.order import Adaptive, InTurn, Order
from ..procedure.session import Procedure, state_of
from ..rigs.simulated.cell_file import CellFile
from ..rigs.simulated.simulator import SimulatedRig
from .data_sets import with_half_the_noise


@dataclass(frozen=True, eq=False)
class Repeated:
    """A plan, and the cell that it is carried out in many times; with a `tolerance` (deg; mm) in the adaptive
    order. Where it is `halved`, each run is solved once more with half of the noise."""

    plan: Plan
    cell: CellFile
    tolerance: float | None = None
    halved: bool = False


class SeededRun(NamedTuple):
    """One run to be carried out."""

    repeated: Repeated
    seed: int


@dataclass(frozen=True)
class RunEstimates:
    """What a run states: estimate and standard uncertainty of each offset that it determines, deg, and
    whether it contradicts the model."""

    offsets: dict[str, tuple[float, float]]
    contradicted: bool

    @classmethod
    def of_state(cls, state: Solution) -> RunEstimates:
        rows = [(row.name, row.estimate, row.std) for row in state.offsets]
        known = {name: (value, std) for name, value, std in rows if value is not None and std is not None}
        return cls(known, not state.consistent)


@dataclass(frozen=True)
class CellRun:
    """A simulated run.

    `truth` has the true offsets and tool by name, deg and mm; `used` and `refused` count measurements;
    `seconds` of the cell's clock by phase. `estimates` is None where no measurement was recorded or the rig
    stopped, and `failure` says why; `halved` are those with half of the noise. `computing` is the time that
    it took, s: the only thing that differs from one computer to another.
    """

    seed: int
    truth: dict[str, float]
    used: int
    refused: int
    estimates: RunEstimates | None
    seconds: dict[str, float]
    failure: str | None
    computing: float
    halved: RunEstimates | None = None

    @property
    def of_half(self) -> CellRun:
        """The same with the estimates of half of the noise."""
        return replace(self, estimates=self.halved)


class MemoryJournal:
    """The shots of a run that needs no file."""

    def __init__(self) -> None:
        self._shots: list[Shot] = []

    @property
    def shots(self) -> tuple[Shot, ...]:
        return tuple(self._shots)

    def append(self, shot: Shot) -> None:
        self._shots.append(shot)


def seeds_of(seed: int, count: int) -> tuple[int, ...]:
    """One for each run; the first of many are those of fewer."""
    return tuple(int(np.random.SeedSequence([seed, run]).generate_state(1)[0]) for run in range(count))


def carried(run: SeededRun) -> CellRun:
    """One run, in memory."""
    began = time.perf_counter()
    plan, tolerance = run.repeated.plan, run.repeated.tolerance
    order: Order = InTurn(len(plan.postures)) if tolerance is None else Adaptive(plan, tolerance)
    journal, truth, seconds, refused = MemoryJournal(), dict[str, float](), dict[str, float](), 0
    state: Solution | None = None
    failure: str | None = None
    try:
        rig = SimulatedRig(plan, run.repeated.cell, run.seed)
        truth = rig.truth.values()
        procedure = Procedure(plan, rig, journal, order, _silent)
        seconds = procedure.seconds
        session = procedure.carry_out()
        refused, state = len(session.refused), session.state
        if state is None:
            failure = "; ".join(dict.fromkeys(refusal.found for refusal in session.refused))
    except ZerobeamError as error:
        failure = str(error)
    halved = None
    if run.repeated.halved and state is not None:
        half = state_of(plan.header, with_half_the_noise(Problem.from_plan(plan)), journal.shots)
        halved = None if half is None else RunEstimates.of_state(half)
    return CellRun(
        run.seed,
        truth,
        len(journal.shots),
        refused,
        None if state is None else RunEstimates.of_state(state),
        seconds,
        failure,
        time.perf_counter() - began,
        halved,
    )


def _silent(event: RunEvent) -> None:
    pass
