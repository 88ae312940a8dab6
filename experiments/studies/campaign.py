"""Many runs of the procedure, each in a simulated cell of its own, side by side in processes.

A run depends on its seed alone: the arm that is drawn, where its PSD is, all noise. So the answer is the
same for any number of processes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...analysis.solution import Solution
from ...model.arrays import ShareDone
from ...model.errors import ZerobeamError
from ...model.files.plan import Plan
from ...model.files.shot import Shot
from ..procedure.events import RunEvent
from ..procedure.order import Adaptive, InTurn, Order
from ..procedure.rig import RefusedPosture
from ..procedure.session import Procedure
from ..processes import side_by_side
from ..rigs.simulated.cell_file import CellFile
from ..rigs.simulated.simulator import SimulatedRig


@dataclass(frozen=True, eq=False)
class Repeated:
    """A plan, and the cell that it is carried out in many times; with a `tolerance` (deg; mm) in the adaptive
    order."""

    plan: Plan
    cell: CellFile
    tolerance: float | None = None


@dataclass(frozen=True, eq=False)
class CellRun:
    """A simulated run.

    `truth` has the true offsets and tool by name, deg and mm; `seconds` of the cell's clock by phase.
    `state` is None where no measurement was recorded or the rig stopped, and `failure` says why. `computing`
    is the time that it took, s: the only thing that differs from one computer to another.
    """

    seed: int
    truth: dict[str, float]
    shots: tuple[Shot, ...]
    refused: tuple[RefusedPosture, ...]
    state: Solution | None
    seconds: dict[str, float]
    failure: str | None
    computing: float


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


def carried(repeated: Repeated, seed: int) -> CellRun:
    """One run, in memory."""
    began = time.perf_counter()
    plan, tolerance = repeated.plan, repeated.tolerance
    order: Order = InTurn(len(plan.postures)) if tolerance is None else Adaptive(plan, tolerance)
    journal = MemoryJournal()
    truth: dict[str, float] = {}
    seconds: dict[str, float] = {}
    refused: tuple[RefusedPosture, ...] = ()
    state: Solution | None = None
    failure: str | None = None
    try:
        rig = SimulatedRig(plan, repeated.cell, seed)
        truth = rig.truth.values()
        procedure = Procedure(plan, rig, journal, order, _silent)
        seconds = procedure.seconds
        session = procedure.carry_out()
        refused, state = session.refused, session.state
        if state is None:
            failure = "; ".join(dict.fromkeys(refusal.found for refusal in refused))
    except ZerobeamError as error:
        failure = str(error)
    spent = time.perf_counter() - began
    return CellRun(seed, truth, journal.shots, refused, state, seconds, failure, spent)


def campaign(
    repeated: Repeated, seeds: Sequence[int], progress: ShareDone, processes: int | None = None
) -> list[CellRun]:
    """A run with each of the seeds, in that order; as many `processes` as there are cores.

    Ctrl-C breaks off the runs that are under way.
    """
    runs: dict[int, CellRun] = {}
    with closing(side_by_side(partial(carried, repeated), seeds, processes)) as answers:
        for job, run in answers:
            runs[job] = run
            progress(len(runs) / len(seeds))
    return [runs[i] for i in range(len(seeds))]


def _silent(event: RunEvent) -> None:
    pass
