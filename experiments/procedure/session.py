"""The procedure of Fig. 5 of the paper: from each initial posture bring the beam to the target and record.

It knows a rig by its interface alone, and nothing of a run but what the journal has on the disk: each
measurement is there before the arm moves on, and a run that is resumed goes on as if it had never been
stopped.
"""

from __future__ import annotations

import base64
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from ...analysis.estimation.fit import fit_likelihood
from ...analysis.estimation.threads import one_blas_thread
from ...analysis.solution import Solution, so_far
from ...interruption import interruptible, obey, uninterrupted
from ...model.arrays import Matrix
from ...model.errors import RigFault
from ...model.files.header import Header
from ...model.files.plan import Plan
from ...model.files.shot import Shot, ShotRules
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem, by_posture
from ...words.numbers import percent
from ..sensors.camera import Camera, Image
from ..sensors.psd import WEAKEST, Psd
from .centring import centre
from .events import (
    ArmSent,
    Attempted,
    GivenUp,
    Listener,
    MeasurementRecorded,
    PhaseBegun,
    PictureTaken,
    Retried,
    SpotSeen,
    Stopped,
)
from .order import Order
from .readings import Spot, read_dark, read_joints, read_spot
from .rig import MeasurementRefused, RefusalReason, RefusedPosture, Rig
from .search import Search
from .steering import Belief, come_to

_WIDEST = 320  # px of a picture that is told
_BETWEEN_S = 0.25  # from one picture to the next


class WatchedRig:
    """A rig whose moves and pictures are reported; `belief` is to be set before each measurement."""

    def __init__(self, rig: Rig, listener: Listener) -> None:
        self._rig, self._listener = rig, listener
        self.psds: Mapping[str, Psd] = rig.psds
        self.camera: Camera | None = rig.camera
        self.steerable = rig.steerable
        self.belief: Belief | None = None
        self._shot, self._lit, self._taken = 0, False, -np.inf

    def now(self) -> float:
        return self._rig.now()

    def wait(self, seconds: float) -> None:
        self._rig.wait(seconds)

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        self._shot, self._lit = shot, False
        self._rig.begin(shot, target, last)

    def move(self, joints: Matrix) -> None:
        if self.belief is not None:
            self._listener(arm_sent(self.belief, self._shot, joints, lit=self._lit))
        self._rig.move(joints)

    def joints(self) -> Matrix:
        return self._rig.joints()

    def currents(self, samples: int) -> Matrix:
        return self._rig.currents(samples)

    def image(self) -> Image:
        image = self._rig.image()
        if time.monotonic() - self._taken >= _BETWEEN_S:
            self._taken = time.monotonic()
            self._listener(picture_taken(self._shot, image))
        return image

    def laser(self, on: bool) -> None:
        self._rig.laser(on)
        self._lit = on

    def stop(self) -> None:
        self._rig.stop()


def arm_sent(belief: Belief, shot: int, joints: Matrix, *, lit: bool) -> ArmSent:
    """The event for an arm at `joints` (n,) rad or mm."""
    (points,) = belief.call("skeleton", joints)
    origin, direction = belief.beam(joints)
    along = float((belief.target - origin) @ direction)
    beam = [origin, origin + max(along, 0.0) * direction] if belief.problem.tool.beam else [origin]
    return ArmSent(
        shot=shot,
        joints_deg=_rounded(joints * belief.problem.robot.display, 6),
        arm=tuple(_rounded(point, 2) for point in points.T),
        beam=tuple(_rounded(point, 2) for point in beam),
        target=_rounded(belief.target, 2),
        lit=lit,
    )


def picture_taken(shot: int, image: Image) -> PictureTaken:
    """The event for a picture (height, width), reduced so that the LEDs remain the brightest."""
    by = -(-image.shape[1] // _WIDEST)
    height, width = (size // by for size in image.shape)
    blocks = image[: height * by, : width * by].reshape(height, by, width, by)
    grey = np.ascontiguousarray(blocks.max(axis=(1, 3)), dtype=np.uint8)
    return PictureTaken(shot, width, height, by, base64.b64encode(grey.tobytes()).decode())


def _rounded(values: Matrix, digits: int) -> tuple[float, ...]:
    return tuple((np.round(values, digits) + 0.0).tolist())


PHASES = ("move", "search", "servo", "settle")
ATTEMPTS = 3
_SETTLE_S = 0.5
_SAMPLES = 100
_DRIFTS = 6.0  # stds by which the spot may move while it is averaged, and so many mm more
_DRIFTS_MM = 0.02
_NEAR = {"mm": 100.0, "deg": np.radians(1.5)}  # std of the nominal values, for aiming
_READ_ALIKE = 6.0  # stds of a joint reading


class Journal(Protocol):
    """The store of measurements: `RunJournal`, on the disk, or a list of simulated ones."""

    @property
    def shots(self) -> tuple[Shot, ...]:
        """All that are kept, in their order."""
        ...

    def append(self, shot: Shot) -> None:
        """Keep one; it is safe when this returns."""
        ...


@dataclass(frozen=True, eq=False)
class ProcedureResult:
    """The result of carrying out a plan. `state` is None where nothing was recorded; `seconds` of the session
    by phase; `missing` are the measurements that were still to come where the run was broken off."""

    shots: tuple[Shot, ...]
    refused: tuple[RefusedPosture, ...]
    state: Solution | None
    seconds: dict[str, float]
    missing: tuple[int, ...] = ()


@dataclass(eq=False)
class Procedure:
    """One session of a run: `told` is called with what happens, as events (docs/files-cell.md)."""

    plan: Plan
    rig: Rig
    journal: Journal
    order: Order
    told: Listener
    scene: bool = False  # whether to tell where the arm is sent and what the camera sees
    seconds: dict[str, float] = field(default_factory=lambda: dict.fromkeys(PHASES, 0.0))

    def __post_init__(self) -> None:
        self._problem = Problem.from_plan(self.plan)
        self._supposed = self._problem.nominal()
        self._near = near_nominal(self._problem, self._supposed)
        self._refused: dict[int, RefusedPosture] = {}
        self._watched = WatchedRig(self.rig, self.told) if self.scene else None
        if self._watched is not None:
            self.rig = self._watched

    def carry_out(self) -> ProcedureResult:
        """Make the measurements that are not in the journal yet. The rig is stopped however this ends."""
        try:
            with uninterrupted():
                try:
                    with interruptible(), one_blas_thread():
                        return self._carry_out()
                finally:
                    self.rig.stop()  # before anything is said: who is told may be slow to listen
        except (RigFault, KeyboardInterrupt) as stopped:
            self.told(Stopped(str(stopped) or "interrupted"))
            raise

    def _carry_out(self) -> ProcedureResult:
        state = self.state()
        while (number := self._following(state)) is not None:
            began = sum(self.seconds.values())
            shot = self._attempts(number)
            if shot is None:
                continue
            obey()
            self.journal.append(shot)
            state = self.state()
            assert state is not None
            seconds = round(sum(self.seconds.values()) - began, 3)
            self.told(recorded_event(shot, shot.met_target, len(self.journal.shots), state, seconds))
        return ProcedureResult(self.journal.shots, tuple(self._refused.values()), state, self.seconds)

    def state(self) -> Solution | None:
        """The estimate from the measurements of the journal; None while there are none."""
        return state_of(self.plan.header, self._problem, self.journal.shots)

    def _following(self, state: Solution | None) -> int | None:
        return self.order.following(self.journal.shots, self._refused, state)

    def _attempts(self, number: int) -> Shot | None:
        """The measurement of a posture, or None where every attempt was refused."""
        # Offsets and targets by the measurements so far; what they carry no information about as nominal.
        belief = Belief(self._problem.select(np.array([self._posture(number)])), self._believed())
        if self._watched is not None:
            self._watched.belief = belief
        last = self.journal.shots[-1] if self.journal.shots else None
        self.rig.begin(number, self.plan.called[self._posture(number)], last)
        for attempt in range(1, ATTEMPTS + 1):
            self.told(Attempted(number, attempt, self._now()))
            try:
                return self._shoot(number, belief)
            except MeasurementRefused as refused:
                if attempt < ATTEMPTS:
                    self.told(Retried(attempt, number, refused.reason, refused.why))
                else:
                    self._refused[number] = RefusedPosture(number, refused.reason, refused.why)
                    self.told(GivenUp(number, refused.reason, refused.why))
        return None

    def _believed(self) -> Matrix:
        """(p,) where measurements are aimed: the mode of the measurements so far, by `near_nominal`."""
        x, shots = self._supposed.copy(), self.journal.shots
        # A replay is read as it was recorded: in the axes of what was nominal then, as it does itself.
        if not shots or not self.rig.steerable:
            return x
        mode = fit_likelihood(with_shots(self.plan.header, self._near, shots), starts=0).x
        parameters = self._problem.parameters
        x = parameters.with_values(x, self._near.parameters, mode)
        measured = {shot.target for shot in shots}
        determined = [item.group != "target" or item.of in measured for item in parameters.items]
        return np.where(determined, x, self._supposed)

    def _posture(self, number: int) -> int:
        """The posture of a measurement; one beyond the plan's repeats one of them."""
        return number % len(self.plan.postures)

    def _shoot(self, number: int, belief: Belief) -> Shot:
        rig, target = self.rig, self.plan.called[self._posture(number)]
        psd, posture = rig.psds[target], self.plan.postures[self._posture(number)]
        with self._phase("move"):
            rig.laser(False)
            joints = belief.onto_target(posture) if rig.steerable else None
            joints = posture if joints is None else joints
            for between in self.plan.via_of(self._posture(number)) if rig.steerable else ():
                obey()
                rig.move(between)
            come_to(rig, belief, joints)
        with self._phase("search"):
            dark = read_dark(rig, psd, _SAMPLES)
            if rig.steerable:
                search = Search(rig, belief, psd, joints, dark)
                search.run()
                belief, joints, frame = search.belief, search.joints, search.frame()
            else:
                rig.laser(True)
                joints = rig.joints()
                frame = psd.frame(belief.beam(joints)[1])
        if rig.steerable:
            with self._phase("servo"):

                def tell(at: Matrix) -> None:
                    off, (x, y) = float(np.linalg.norm(at)), at.tolist()
                    seen_at = (round(x, 4), round(y, 4))
                    self.told(SpotSeen(number, round(off, 4), self._now(), seen_at, psd.size))

                joints = centre(rig, belief, psd, joints, dark, frame, tell).joints
        with self._phase("settle"):
            rig.wait(_SETTLE_S)
            tolerance = _READ_ALIKE * belief.problem.noise.joint
            before = read_joints(rig, joints, tolerance)
            spot = self._steady(read_spot(rig, psd, dark, _SAMPLES))
            read = np.median([before, read_joints(rig, joints, tolerance)], axis=0)
        robot = self._problem.robot
        outside = beyond_limits(robot, read, 0.0)
        if self.plan.header.limits == "error" and outside.any():
            joint = int(np.flatnonzero(outside)[0])
            raise MeasurementRefused(RefusalReason.LIMIT, f"joint {joint + 1} is read beyond its limit")
        # The beam's place is known in the PSD's axes; a run wants the target's place across the beam.
        _, _, across = belief.problem.tool.nominal_beam()
        off = -(belief.turned(joints, frame[:, :2] @ spot.position) @ across)
        return Shot(
            shot=number,
            again=self.plan.repeated_by(number),
            target=target,
            joints_deg=tuple(round(float(v), 9) for v in read * robot.display),
            spot_mm=(round(float(off[0]), 6), round(float(off[1]), 6)),
            time_s=self._now(),
        )

    def _steady(self, spot: Spot) -> Spot:
        if spot.light < WEAKEST:
            raise MeasurementRefused(
                RefusalReason.TOO_WEAK,
                f"{percent(spot.light)} of the laser's light arrives; at least {percent(WEAKEST)} are needed",
            )
        if (np.abs(spot.drift) > _DRIFTS * 2 * spot.std + _DRIFTS_MM).any():
            raise MeasurementRefused(
                RefusalReason.UNSTEADY,
                f"the spot moved by {np.abs(spot.drift).max():.3f} mm while it was averaged",
            )
        return spot

    def _now(self) -> float:
        return round(self.rig.now(), 6)

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        began = self.rig.now()
        self.told(PhaseBegun(name, self._now()))
        try:
            yield
        finally:
            self.seconds[name] += self.rig.now() - began


def near_nominal(problem: Problem, x: Matrix) -> Problem:
    """The problem for aiming: the noise as stated, offsets and targets near the nominal values, x (p,).

    Few measurements can be explained by targets far away or by offsets of many degrees, as wide priors allow;
    the next measurements would then be aimed far off the target.
    """
    items = tuple(
        replace(item, prior_mean=float(mean), prior_std=min(item.prior_std, _NEAR[item.unit]))
        if item.group in ("target", "offset") and not item.held
        else item
        for item, mean in zip(problem.parameters.items, x, strict=True)
    )
    return replace(problem, parameters=Parameters(items)).with_noise_of(x)[0]


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
