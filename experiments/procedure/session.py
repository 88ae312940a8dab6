"""One session of a run, over the ports of whatever carries it out: which measurement is next, what is
recorded, how it ends.

It knows a cell by its ports alone, and nothing of a run but what the journal has on the disk: each
measurement is there before the arm moves on, and a run that is resumed goes on as if it had never been
stopped.
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Protocol

import numpy as np

from ...analysis.design.continuous_design import Candidates
from ...analysis.design.exact_design import design
from ...analysis.diagnostics.outliers import single_outlier
from ...analysis.diagnostics.values_to_enter import judged
from ...analysis.observability.aim import aim, servo_joints
from ...analysis.solution import Solution, so_far
from ...analysis.status import known
from ...interruption import interruptible, obey, uninterrupted
from ...model.arrays import NORMAL_95, Matrix
from ...model.errors import BadInput, RigFault
from ...model.files.header import Header
from ...model.files.plan import Means, Plan, first_in_turn
from ...model.files.run import ENOUGH_CALIBRATED, ENOUGH_UNCALIBRATED
from ...model.files.shot import Shot, ShotRules, shot_model
from ...model.kernel import one_blas_thread
from ...model.likelihood.problem import Problem, by_posture
from ...words import numbers
from .events import GivenUp, Listener, MeasurementRecorded, Retried, Stopped, Suspected, Withdrawn
from .rig import MeasurementRefused, RefusalReason, RefusedPosture

_STARTS = 8
_LOWERED = 0.98  # of its std: what all postures that are left lower by less they do not lower
_USUAL_S = 60.0  # of a measurement, where the times are not recorded


class Order(Protocol):
    """Decides which posture comes next."""

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The number of the next measurement, that of its posture in the plan; None: it is enough.

        Decided from what is recorded, and from which postures were refused, alone.
        """
        ...


TWICE = 2  # beside the first time, where `--once-more` asks for it


class InTurn:
    """All postures of a plan of `count`, one after another."""

    def __init__(self, count: int) -> None:
        self._count = count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        done = {shot.shot for shot in recorded}.union(refused)
        return next((number for number in range(self._count) if number not in done), None)


class WithRepeats:
    """The postures of `order`, and in the end some of the recorded ones again, the first of each target in
    turn: what changed during the run shows in the difference. The number of such a measurement is that of
    the posture plus `count`, the plan's: `repeat` of them."""

    def __init__(self, order: Order, count: int, repeat: int) -> None:
        self._order, self._count, self._repeat = order, count, repeat

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}.union(refused)
        first = [shot for shot in recorded if shot.shot < self._count and shot.again is None]
        again = first_in_turn([shot.met_target for shot in first], self._repeat)
        numbers = [first[row].shot + self._count for row in again]
        return next((number for number in numbers if number not in done), None)


class OnceMore:
    """What `order` asks for, and in the end each posture once more that was measured again, once or by the
    order. The number of such a measurement is that of the posture and a multiple of `count`, the plan's."""

    def __init__(self, order: Order, count: int) -> None:
        self._order, self._count = order, count

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        number = self._order.following(recorded, refused, state)
        if number is not None:
            return number
        done = {shot.shot for shot in recorded}
        again = [shot.again for shot in recorded if shot.again is not None]
        for posture in dict.fromkeys(again):
            if again.count(posture) < TWICE:
                number = next(n for n in itertools.count(posture + self._count, self._count) if n not in done)
                if number not in refused:
                    return number
        return None


@dataclass(eq=False)
class Adaptive:
    """The plan's postures are the candidates, each measured once at most; those that repeat others are none.

    As many as the method needs at least come first, chosen together (A-optimal); then always the one that
    lowers the largest predicted std of the offsets most, of those that postures lower, until that is within
    `tolerance` (deg; mm), the robot meets what the header requires of the TCP, or the next measurement lowers
    the U of no offset by `gain` (deg; mm) an hour. Where the measurements contradict the model (lack of fit,
    a target that has moved) no std can be relied on: then nothing is saved and all postures are measured;
    `reason` says why it ended.
    """

    plan: Plan
    tolerance: float
    gain: float | None = None
    reason: str | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        if not self.tolerance > 0:
            raise BadInput("the tolerance is not above 0", found=self.tolerance)
        self._problem = Problem.from_plan(self.plan)
        parameters = self._problem.parameters
        self._offsets = parameters.group("offset")[parameters.free]
        if not self._offsets.any():
            raise BadInput("there is nothing to adapt to: every offset is held", remedy="free some in `held`")
        enough = ENOUGH_CALIBRATED if self._problem.tool.calibrated else ENOUGH_UNCALIBRATED
        self._new = [shot.shot for shot in self.plan.shots if shot.again is None]
        candidates = Candidates(self._roots(self._problem.nominal())[self._new], self._offsets)
        together = design(candidates, (min(enough, len(self._new)),), "A", seed=0, starts=_STARTS)
        self._first: list[int] = [self._new[row] for row in together.rows]

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The next posture; None where the tolerance is reached or no posture is left."""
        made = [shot.shot for shot in recorded if shot.shot < self._problem.shots]
        done = {*made, *refused}
        left = [number for number in self._new if number not in done]
        if not left:
            self.reason = self.reason or "all postures of the plan are measured"
            return None
        first = next((number for number in self._first if number in left), None)
        if first is not None:
            return first
        if state is None:
            return left[0]
        if not state.consistent:
            self.reason = "the measurements contradict the model: none is saved"
            return left[0]
        # Without a number to spare nothing could contradict it.
        if state.worst is not None and state.dof > 0 and self._wide(state) <= self.tolerance:
            self.reason = (
                f"the largest standard uncertainty is {self._worded(state.worst)}, within"
                f" {self._worded(self.tolerance)}"
            )
            return None
        required = self.plan.header.required
        if required is not None and state.dof > 0:
            conformity = judged(state, required)
            if conformity is not None and conformity.decision == "conforms":
                self.reason = f"the TCP is within {required.tcp_mm:g} mm as required"
                return None
        parameters, fit = self._problem.parameters, state.fit
        x = parameters.with_values(self._problem.nominal(), fit.problem.parameters, fit.x)
        best, gain = self._best(left, made, x)
        hours = _seconds_each(recorded) / 3600
        if self.gain is not None and state.worst is not None and state.dof > 0 and gain / hours < self.gain:
            self.reason = (
                f"the next measurement lowers U by {self._worded(gain / hours)} an hour at the most, less"
                f" than {self._worded(self.gain)}"
            )
            return None
        return best

    def _worded(self, uncertainty: float) -> str:
        """With the unit of the offsets, if they have one."""
        units = {item.unit for item in self._problem.parameters.items if item.group == "offset"}
        return numbers.significant(uncertainty, 2, units.pop() if len(units) == 1 else "")

    def _wide(self, state: Solution) -> float:
        """The largest std of an offset that is more than assumed; where the noise is estimated from few
        numbers, possibly too small, each widened as Student's t widens its interval."""
        offsets = state.problem.parameters.group("offset")
        offsets &= np.array([known(status) for status in state.status])
        half = (state.quantiles * state.std * state.problem.parameters.display)[offsets]
        return float(np.nanmax(half)) / NORMAL_95

    def _best(self, left: list[int], made: list[int], x: Matrix) -> tuple[int, float]:
        """Of the postures `left` the one after which the largest std is the smallest, of the offsets that
        these postures lower; and by how much it lowers the U (k = 2) of an offset, at the most."""
        roots = self._roots(x)
        candidates = Candidates(roots, self._offsets)
        so_far = candidates.information(np.array(made, dtype=np.int64))
        each = roots[left].transpose(0, 2, 1) @ roots[left]
        parameters = self._problem.parameters
        unit = (parameters.prior_std * parameters.display)[parameters.free][self._offsets]
        whole = np.array([so_far, so_far + each.sum(axis=0), *(so_far + each)])
        now, with_all, *after = unit * np.sqrt(
            np.diagonal(np.linalg.inv(whole), axis1=1, axis2=2)[:, self._offsets]
        )
        lowered = with_all < _LOWERED * now
        if not lowered.any():
            lowered[:] = True
        best = int(np.argmin(np.array(after)[:, lowered].max(axis=1)))
        return left[best], float(2 * (now - after[best]).max())

    def _roots(self, x: Matrix) -> Matrix:
        """(N, d, f) whitened Jacobians of all postures, turned onto their targets at x (p,)."""
        aimed = aim(self._problem, x, servo_joints(self._problem)).problem
        return aimed.roots(aimed.whiten(x))


def _seconds_each(recorded: Sequence[Shot]) -> float:
    """How long a measurement takes, by those so far."""
    times = [shot.time_s for shot in recorded if shot.time_s is not None]
    return max(float(np.median(np.diff(times))), 1.0) if len(times) > 2 else _USUAL_S


# The four ports of a session: *move to*, *confirm*, *joints* and *reading*; what ends a measurement early.
#
#     BeamPorts (any rig)   drives and servoes   at rest, alike, steady   read             the spot
#     HandPorts, typed      asks a person        a line, a growing file   in that line     typed, or sent
#     HandPorts, live       asks a person        Enter, or the PSD        read at rest     typed, or sent
#     Rehearsal (no beam)   nothing moves        at once                  simulated        simulated
#
# The session decides which measurement is next, how often it is tried, what is recorded, given up, taken
# back and repeated, and when the run ends. Ports keep nothing from one measurement to the next but their
# clock.

# What a measurement records beside its joints, by key of the run file.
Reading = Mapping[str, float | tuple[float, ...] | str | None]


class Skipped(MeasurementRefused):
    """A person gives measurement `number` up; before the posture is confirmed, all that are made there."""

    def __init__(self, number: int, why: str) -> None:
        super().__init__(RefusalReason.SKIPPED, why)
        self.number = number


class TakenBack(Exception):
    """A person wants the recorded measurement `number` repeated, with all that were made at its posture."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class Paused(Exception):
    """No more lines come, or the person wants to go on later."""


class Ports(ABC):
    """What carries out the measurements of `plan`; `listener` is called with what happens, as events.

    A measurement is given up after so many `attempts` that were refused. Where `repeats`, who measures hears
    which measurement contradicts the others. What is known so far is found out after every so many (`every`).
    `seconds` of this session are by phase, empty where nobody measures them; `problem` is the plan's. Every
    method may raise RigFault, which ends the run. What is not overridden has nothing to do; each set of ports
    has to say how it stops.
    """

    plan: Plan
    problem: Problem
    listener: Listener
    attempts = 1
    repeats = False
    every = 1
    seconds: Mapping[str, float] = MappingProxyType({})

    def together(self, number: int) -> tuple[int, ...]:
        """The measurements that are made at the posture of `number`, in their order."""
        return (number,)

    def begin(self, number: int, recorded: Sequence[Shot], refused: Collection[int]) -> None:  # noqa: B027
        """Measurement `number` is coming: what is recorded and refused so far is all that it depends on."""

    def move_to(self, number: int, attempt: int) -> None:  # noqa: B027
        """Bring the arm to the posture, or ask for that; MeasurementRefused where that cannot be."""

    def confirm(self, number: int) -> int:
        """Return once the arm is where the measurement is to be made: its number, or that of another one in
        whose posture the arm is. MeasurementRefused, Skipped, TakenBack or Paused where it is not."""
        return number

    @abstractmethod
    def joints(self) -> Matrix:
        """(n,) deg (mm) the joints that were confirmed."""

    @abstractmethod
    def reading(self, number: int) -> Reading:
        """What is read there; as `confirm` where it is not."""

    def moved(self, number: int) -> bool:
        """Whether the arm has moved since it was confirmed, which is said: then it is asked for again."""
        return False

    def now(self) -> float | None:
        """Seconds since the start of the run; None where no clock runs."""
        return None

    @abstractmethod
    def stop(self) -> None:
        """Stop the motion, switch the laser off; safe at any moment, more than once."""


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
