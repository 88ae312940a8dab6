"""The ports of a rig with a laser and PSDs: from each posture bring the beam to the target and read it
(Fig. 5 of the paper)."""

from __future__ import annotations

import base64
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from ...analysis.estimation.fit import fit_likelihood
from ...interruption import obey
from ...model.arrays import Matrix
from ...model.files.plan import Plan
from ...model.files.shot import Shot
from ...model.kinematics.orientation import Three
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.parameters import Parameters
from ...model.likelihood.problem import Problem
from ...words.numbers import percent
from ..sensors.detectors import WEAKEST, Camera, Image, Psd
from .events import ArmSent, Attempted, Listener, PhaseBegun, PictureTaken, SpotSeen
from .rig import MeasurementRefused, RefusalReason, Rig, Spot, read_dark, read_joints, read_spot
from .session import Ports, Reading, with_shots
from .steering import Belief, Search, centre, come_to

_WIDEST = 320  # px of a picture that is told
_BETWEEN_S = 0.25  # from one picture to the next
PHASES = ("move", "search", "servo", "settle")
ATTEMPTS = 3
_SETTLE_S = 0.5
_SAMPLES = 100
_DRIFTS = 6.0  # stds by which the spot may move while it is averaged, and so many mm more
_DRIFTS_MM = 0.02
_NEAR = {"mm": 100.0, "deg": np.radians(1.5)}  # std of the nominal values, for aiming
_READ_ALIKE = 6.0  # stds of a joint reading


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
        arm=tuple(map(_point, points.T)),
        beam=tuple(map(_point, beam)),
        target=_point(belief.target),
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


def _point(point: Matrix) -> Three:
    x, y, z = _rounded(point, 2)
    return x, y, z


class BeamPorts(Ports):
    """The ports of a rig. `scene`: whether to tell where the arm is sent and what the camera sees."""

    attempts = ATTEMPTS

    def __init__(self, plan: Plan, rig: Rig, told: Listener, *, scene: bool = False) -> None:
        self.plan, self.listener = plan, told
        self._watched = WatchedRig(rig, told) if scene else None
        self.rig: Rig = self._watched or rig
        self.problem = Problem.from_plan(plan)
        self._supposed = self.problem.nominal()
        self._near = near_nominal(self.problem, self._supposed)
        self.seconds: dict[str, float] = dict.fromkeys(PHASES, 0.0)

    def begin(self, number: int, recorded: Sequence[Shot], refused: Collection[int]) -> None:
        # Offsets and targets by the measurements so far; what they carry no information about as nominal.
        one = self.problem.select(np.array([self._posture(number)]))
        self._belief = Belief(one, self._believed(recorded))
        if self._watched is not None:
            self._watched.belief = self._belief
        self.rig.begin(number, self.plan.called[self._posture(number)], recorded[-1] if recorded else None)

    def move_to(self, number: int, attempt: int) -> None:
        """With the beam onto the target, from the posture."""
        self.listener(Attempted(number, attempt, self.now()))
        rig, belief, row = self.rig, self._belief, self._posture(number)
        psd, posture = rig.psds[self.plan.called[row]], self.plan.postures[row]
        with self._phase("move"):
            rig.laser(False)
            joints = belief.onto_target(posture) if rig.steerable else None
            joints = posture if joints is None else joints
            for between in self.plan.via_of(row) if rig.steerable else ():
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
                    self.listener(SpotSeen(number, round(off, 4), self.now(), seen_at, psd.size))

                joints = centre(rig, belief, psd, joints, dark, frame, tell).joints
        self._on_target = belief, psd, joints, dark, frame

    def confirm(self, number: int) -> int:
        """At rest: the joints are read alike before and after the spot, which does not drift."""
        rig, (belief, psd, joints, dark, frame) = self.rig, self._on_target
        with self._phase("settle"):
            rig.wait(_SETTLE_S)
            tolerance = _READ_ALIKE * belief.problem.noise.joint
            before = read_joints(rig, joints, tolerance)
            spot = _steady(read_spot(rig, psd, dark, _SAMPLES))
            read = np.median([before, read_joints(rig, joints, tolerance)], axis=0)
        outside = beyond_limits(self.problem.robot, read, 0.0)
        if self.plan.header.limits == "error" and outside.any():
            joint = int(np.flatnonzero(outside)[0])
            raise MeasurementRefused(RefusalReason.LIMIT, f"joint {joint + 1} is read beyond its limit")
        # The beam's place is known in the PSD's axes; a run wants the target's place across the beam.
        _, _, across = belief.problem.tool.nominal_beam()
        off = -(belief.turned(joints, frame[:, :2] @ spot.position) @ across)
        self._read = read, (round(float(off[0]), 6), round(float(off[1]), 6))
        return number

    def joints(self) -> Matrix:
        return np.asarray(self._read[0] * self.problem.robot.display)

    def reading(self, number: int) -> Reading:
        return {"spot_mm": self._read[1]}

    def now(self) -> float:
        return round(self.rig.now(), 6)

    def stop(self) -> None:
        self.rig.stop()

    def _posture(self, number: int) -> int:
        """The posture of a measurement; one beyond the plan's repeats one of them."""
        return number % len(self.plan.postures)

    def _believed(self, recorded: Sequence[Shot]) -> Matrix:
        """(p,) where measurements are aimed: the mode of the measurements so far, by `near_nominal`."""
        x = self._supposed.copy()
        # A replay is read as it was recorded: in the axes of what was nominal then, as it does itself.
        if not recorded or not self.rig.steerable:
            return x
        mode = fit_likelihood(with_shots(self.plan.header, self._near, recorded), starts=0).x
        parameters = self.problem.parameters
        x = parameters.with_values(x, self._near.parameters, mode)
        measured = {shot.target for shot in recorded}
        determined = [item.group != "target" or item.of in measured for item in parameters.items]
        return np.where(determined, x, self._supposed)

    @contextmanager
    def _phase(self, name: str) -> Iterator[None]:
        began = self.rig.now()
        self.listener(PhaseBegun(name, self.now()))
        try:
            yield
        finally:
            self.seconds[name] += self.rig.now() - began


def _steady(spot: Spot) -> Spot:
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
