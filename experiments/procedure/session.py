"""One session of a run, whatever carries it out: which measurement is next, what is recorded, how it ends.

It knows a cell by its ports alone, and nothing of a run but what the journal has on the disk: each
measurement is there before the arm moves on, and a run that is resumed goes on as if it had never been
stopped.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ...analysis.diagnostics.outliers import single_outlier
from ...analysis.estimation.threads import one_blas_thread
from ...analysis.solution import Solution, so_far
from ...interruption import interruptible, obey, uninterrupted
from ...model.errors import RigFault
from ...model.files.header import Header
from ...model.files.plan import Means
from ...model.files.shot import Shot, ShotRules, shot_model
from ...model.likelihood.problem import Problem, by_posture
from .events import GivenUp, MeasurementRecorded, Retried, Stopped, Suspected, Withdrawn
from .order import Order
from .ports import Paused, Ports, Skipped, TakenBack
from .rig import MeasurementRefused, RefusedPosture


class Journal(Protocol):
    """The store of measurements: `RunJournal`, on the disk, or a list of simulated ones."""

    @property
    def shots(self) -> tuple[Shot, ...]:
        """All that are kept, in their order."""
        ...

    def append(self, shot: Shot) -> None:
        """Keep one; it is safe when this returns."""
        ...

    def withdraw(self, number: int) -> None:
        """Take one out."""
        ...


@dataclass(frozen=True, eq=False)
class SessionResult:
    """The result of carrying out a plan. `state` is None where nothing was recorded; `seconds` of the session
    by phase; `missing` are the measurements that were still to come where the run was broken off."""

    shots: tuple[Shot, ...]
    refused: tuple[RefusedPosture, ...]
    state: Solution | None
    seconds: Mapping[str, float]
    missing: tuple[int, ...] = ()


@dataclass(eq=False)
class Session:
    """One session of a run over the ports of a cell."""

    ports: Ports
    journal: Journal
    order: Order
    _refused: dict[int, RefusedPosture] = field(default_factory=dict, init=False)
    _again: int | None = field(default=None, init=False)  # taken back, to be repeated next

    def carry_out(self) -> SessionResult:
        """Make the measurements that are not in the journal yet, until the order is through or the person
        pauses. What moves is stopped however this ends."""
        try:
            with uninterrupted():
                try:
                    with interruptible(), one_blas_thread():
                        return self._carry_out()
                finally:
                    self.ports.stop()  # before anything is said: who is told may be slow to listen
        except (RigFault, KeyboardInterrupt) as stopped:
            self.ports.listener(Stopped(str(stopped) or "interrupted"))
            raise

    def _carry_out(self) -> SessionResult:
        state, missing = self.state(), tuple[int, ...]()
        while (number := self._following(state)) is not None:
            began = sum(self.ports.seconds.values())
            try:
                shots = self._measured(number)
            except TakenBack as taken:
                self._withdraw(taken.number)
                state = self.state()
                continue
            except Paused:
                missing = self._pending(state)
                break
            if shots:
                obey()
                seconds = round(sum(self.ports.seconds.values()) - began, 3) if self.ports.seconds else None
                state = self._record(shots, seconds)
        return SessionResult(
            self.journal.shots,
            tuple(self._refused.values()),
            state or self.state(),
            self.ports.seconds,
            missing,
        )

    def state(self) -> Solution | None:
        """The estimate from the measurements of the journal; None while there are none."""
        return state_of(self.ports.plan.header, self.ports.problem, self.journal.shots)

    # Which measurement

    def _following(self, state: Solution | None) -> int | None:
        if self._again is not None:
            return self._again
        return self.order.following(self.journal.shots, self._refused, state)

    def _pending(self, state: Solution | None) -> tuple[int, ...]:
        """The measurements that would still be asked for, none of them recorded."""
        pending: list[int] = []
        shots, refused = self.journal.shots, self._refused
        while (number := self.order.following(shots, {*refused, *pending}, state)) is not None:
            pending.append(number)
        return tuple(sorted(pending))

    def _measured(self, number: int) -> list[Shot]:
        """What is measured at the posture of `number`, or at another one that was confirmed; nothing where it
        is given up."""
        together = self.ports.together(number)
        recorded = {shot.shot for shot in self.journal.shots}
        others = [other for other in together if other in recorded]
        if others:
            why = f"its posture is recorded without it: redo {others[0]} repeats both"
            self._give_up((number,), Skipped(number, why))
            return []
        number = together[0]
        self.ports.begin(number, self.journal.shots, self._refused)
        for attempt in itertools.count(1):
            try:
                self.ports.move_to(number, attempt)
                number = self.ports.confirm(number)
                shots = self._read(number)
                if not (shots and self.ports.moved(number)):
                    return shots
            except Skipped as skipped:
                self._give_up(self.ports.together(skipped.number), skipped)
                return []
            except MeasurementRefused as refused:
                if attempt == self.ports.attempts:
                    self._give_up((number,), refused)
                    return []
                self.ports.listener(Retried(attempt, number, refused.reason, refused.why))
        raise AssertionError

    def _read(self, number: int) -> list[Shot]:
        """All that is read where the arm was confirmed for measurement `number`, less what is skipped."""
        shots = []
        for each in self.ports.together(number):
            try:
                shots.append(self._shot(each))
            except Skipped as skipped:
                self._give_up((each,), skipped)
        return shots

    def _shot(self, number: int) -> Shot:
        ports, plan = self.ports, self.ports.plan
        reading, posture = ports.reading(number), number % len(plan.postures)
        content = {
            "shot": number,
            "target": plan.targets[posture],
            "joints_deg": tuple(round(float(value), 9) for value in ports.joints()),
            "time_s": ports.now(),
            **Means.of(plan.shots[posture])._asdict(),
            "again": plan.repeated_by(number),
            **reading,
        }
        return shot_model(plan.header).model_validate(content)

    # What becomes of it

    def _record(self, shots: Sequence[Shot], seconds: float | None) -> Solution | None:
        """Keep them, and say what is known then, where that is found out."""
        ports, plan = self.ports, self.ports.plan
        for shot in shots:
            self.journal.append(shot)
        self._again = None
        count = len(self.journal.shots)
        state = self.state() if count % ports.every == 0 or count == len(plan.postures) else None
        for shot in shots:
            called = plan.called[shot.shot % len(plan.postures)]
            ports.listener(recorded_event(shot, called, count, state, seconds))
        if ports.repeats and state is not None and state.converged:
            outlier = single_outlier(state.fit, state.dof)
            if outlier is not None:
                ports.listener(Suspected(outlier.shot, outlier.p_value, outlier.residual_mm))
        return state

    def _give_up(self, numbers: Sequence[int], why: MeasurementRefused) -> None:
        self._again = None
        for number in numbers:
            self._refused[number] = RefusedPosture(number, why.reason, why.why)
            self.ports.listener(GivenUp(number, why.reason, why.why))

    def _withdraw(self, number: int) -> None:
        """Take a measurement and all others of its posture out of the journal: they are next."""
        recorded = {shot.shot for shot in self.journal.shots}
        for each in self.ports.together(number):
            self._refused.pop(each, None)
            if each in recorded:
                self.journal.withdraw(each)
                self.ports.listener(Withdrawn(each))
        self._again = number


def recorded_event(
    shot: Shot, name: str, recorded: int, state: Solution | None, seconds: float | None = None
) -> MeasurementRecorded:
    """The event of a measurement that is on the disk, with what is known after it, if that was found out;
    `name` is that of what was measured."""
    return MeasurementRecorded(
        shot=shot.shot,
        target=name,
        spot_mm=shot.spot_mm,
        time_s=shot.time_s,
        recorded=recorded,
        std={} if state is None else state.offset_std,
        worst_std=None if state is None else state.worst,
        p_value=None if state is None else state.p_value,
        consistent=state is None or state.consistent,
        seconds=seconds,
        expanded={} if state is None else state.offset_expanded,
        tolerance={} if state is None else state.offset_tolerance,
        residuals={} if state is None else state.normalised_residuals,
    )


def state_of(header: Header, problem: Problem, shots: Sequence[Shot]) -> Solution | None:
    """The estimate from measurements for the unknowns of a plan's problem; None without any."""
    return so_far(with_shots(header, problem, shots)) if shots else None


def with_shots(header: Header, problem: Problem, shots: Sequence[Shot]) -> Problem:
    """The unknowns of a plan's problem, with these measurements in place of its postures."""
    measurements = tuple(ShotRules(header, problem.robot).measurements(shots))
    rows, measured = by_posture(measurements)
    joints = np.array([shots[i].joints_deg for i in rows]) / problem.robot.display
    return problem.recorded_at(joints, measured, [shots[i].shot for i in rows], header)
