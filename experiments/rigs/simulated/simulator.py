"""The simulated cell: an arm with true offsets, a laser, PSDs and a camera, on a clock of their own.

What follows a `begin` depends on the seed, the measurement and what was recorded before it alone: a run that
is resumed makes the same measurements as one that was never stopped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import RigFault
from ....model.files.plan import Plan
from ....model.files.run import ENOUGH_CALIBRATED
from ....model.files.shot import Shot
from ....model.kinematics.pendant import beyond_limits
from ...sensors.camera import Camera, Image
from ...sensors.psd import Psd
from .assembly import assemble, turned
from .cell_file import (
    CameraBlack,
    CellFile,
    EncoderGlitch,
    Faults,
    LedOccluded,
    PsdDropout,
    Reflection,
    RobotStop,
)
from .sensing import PictureScene, SimulatedPsd, caught, render

_LED_MM = 2.5
_SWITCHING = 0.05  # s
_IN_SIGHT = np.radians(35.0)  # between the nominal beam and the way to the PSD: as far as is looked around


class SimulatedRig:
    """A cell (`CellFile`) made for a plan; BadInput where the two do not fit.

    `resumed` says that a run goes on: what stopped it does not happen again. `arm` has the true offsets and
    tool by name (deg, mm) of an arm that is known, in place of a random one.
    """

    steerable = True

    def __init__(
        self,
        plan: Plan,
        cell: CellFile,
        seed: int,
        *,
        resumed: bool = False,
        arm: Mapping[str, float] | None = None,
    ) -> None:
        self._cell, self._seed, self._robot = cell, seed, plan.robot
        self._rng = np.random.default_rng(seed)
        # A known arm was measured before, perhaps with this seed: its readings now are others.
        self._draws = () if arm is None else (1,)
        self._parts = assemble(plan, cell, self._rng, arm)
        self._functions, self._arm = self._parts.functions, self._parts.arm
        self.psds: Mapping[str, Psd] = self._parts.psds
        self.camera, self.truth = self._parts.camera, self._parts.truth
        self._faults = Faults(cell.faults, resumed=resumed)
        self._time, self._on = 0.0, False
        self._wander, self._face = np.zeros(2), np.eye(3)
        self._target = next(iter(self.psds))
        self._devices = {name: self._device(psd) for name, psd in self.psds.items()}
        self._require_sight(plan)

    # What a person may know of it afterwards

    def provenance(self) -> dict[str, str | int | float]:
        """For the run's header: that it is simulated, and the truth."""
        return {"origin": "simulated", "seed": self._seed, **self._parts.provenance()}

    # The rig

    def now(self) -> float:
        return self._time

    def wait(self, seconds: float) -> None:
        self._time += seconds

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        self._faults.begin(shot, None if last is None else last.shot)
        self._faults.called()
        self._target, self._on = target, False
        self._rng = np.random.default_rng([self._seed, shot, *self._draws])
        self._wander = self._rng.normal(size=2) * self._parts.wander
        self._time = 0.0 if last is None or last.time_s is None else last.time_s
        robot = self._robot
        home = np.clip(np.zeros(robot.n), robot.lower, robot.upper)
        self._arm.begin(self._rng, home if last is None else np.array(last.joints_deg) / robot.display)
        self._turn_face()

    def move(self, joints: Matrix) -> None:
        self._faults.called()
        robot = self._robot
        outside = beyond_limits(robot, joints, 0.0)
        if outside.any():
            joint = int(np.flatnonzero(outside)[0])
            raise RigFault(f"the controller refuses the move: joint {joint + 1} would leave its limits")
        if self._faults.met(RobotStop) is not None:
            raise RigFault("the robot has stopped by itself on its way")
        self._time += self._cell.arm.latency_s + self._arm.move(joints)
        if not self._on:
            self._turn_face()

    def joints(self) -> Matrix:
        self._faults.called()
        read = self._arm.read()
        glitch = self._faults.met(EncoderGlitch)
        if glitch is not None:
            read = read.copy()
            read[glitch.joint - 1] += glitch.deg / self._robot.display[glitch.joint - 1]
        return read

    def currents(self, samples: int) -> Matrix:
        self._faults.called()
        psd = self.psds[self._target]
        self._time += samples / psd.rate
        hit, light = self._light()
        reflection = self._reflection()
        if reflection is not None:
            at, other = reflection
            direct = 0.0
            if hit is not None:
                share, hit = caught(hit, self._cell.laser.radius_mm, psd.size)
                direct = share * light
            # Two lights on the face read as one at their centre.
            hit = at if hit is None else (direct * hit + other * at) / max(direct + other, 1e-300)
            light = direct + other
        currents = self._devices[self._target].currents(hit, light, samples, self._rng)
        currents[self._rng.random(samples) < self._cell.psd.lost] = np.nan
        if self._faults.met(PsdDropout) is not None:
            currents[:] = np.nan
        return currents

    def image(self) -> Image:
        self._faults.called()
        settings = self._cell.camera
        if self.camera is None or settings is None:
            raise RigFault("the cell has no camera")
        self._time += settings.image_s
        if self._faults.met(CameraBlack) is not None:
            return np.zeros((settings.height_px, settings.width_px), dtype=np.uint8)
        mount = self.camera.mount.copy()
        mount[:3, :3] = mount[:3, :3] @ turned(settings.misturned_deg)
        true = replace(self.camera, mount=mount)
        return render(
            true,
            self._scene(true),
            exposure=settings.exposure,
            ambient=settings.ambient_grey,
            noise=settings.noise_grey,
            psf=settings.psf_px,
            rng=self._rng,
        )

    def laser(self, on: bool) -> None:
        self._faults.called()
        self._time += _SWITCHING
        self._on = on

    def stop(self) -> None:
        self._on = False

    # The physics

    def _device(self, psd: Psd) -> SimulatedPsd:
        settings = self._cell.psd
        beam = self._cell.laser.radius_mm
        return SimulatedPsd(psd, beam, settings.nonlinearity, settings.ambient, settings.resolution_mm)

    def _require_sight(self, plan: Plan) -> None:
        """BadInput for a cell in which so few postures have a PSD before them, and its face, that nothing can
        come of it; a single one that has not is refused when it comes."""
        offsets, off_axis, front = self._parts.arm.offsets, [], []
        origins, directions = self._functions.kernel("beam")(plan.postures, offsets, self._parts.tool)
        for origin, direction, target in zip(origins, directions, plan.called, strict=True):
            way = self._parts.centres[target] - origin
            normal = self.psds[target].normal
            off_axis.append(np.arccos(np.clip(direction @ way / np.linalg.norm(way), -1.0, 1.0)))
            front.append(normal is None or bool(normal @ way < 0))
        in_sight = np.array(off_axis) <= _IN_SIGHT
        seeing, count = int((in_sight & front).sum()), len(plan.postures)
        if seeing >= min(ENOUGH_CALIBRATED, count):
            return
        target, off = plan.called[int(np.argmin(off_axis))], np.degrees(np.median(off_axis))
        raise self._cell.refuse(
            ("psd",),
            f"the PSD is out of view in {count - seeing} of the plan's {count} postures",
            found=f"the face of {target} is turned away from all beams"
            if in_sight.sum() > seeing
            else f"{target} is {off:.0f} deg off the beams (median)",
            allowed=f"within {np.degrees(_IN_SIGHT):.0f} deg of a beam, on the front of its face",
            remedy="correct psd.placed in the cell file, or the targets of the plan",
        )

    def _beam_tool(self) -> Matrix:
        """(4,) tilts and shifts of the beam at this moment."""
        drift = np.radians(self._cell.laser.drift_deg_min) * self._time / 60
        return np.asarray(self._parts.tool + np.concatenate([drift, self._wander]))

    def _centre(self) -> Matrix:
        return np.asarray(self._parts.centres[self._target] + self._faults.bumped())

    def _turn_face(self) -> None:
        """Orientation of the PSD's face: fixed, or turned towards the laser about its centre."""
        link = self._arm.link()
        _, direction = self._functions.kernel("beam")(link, np.zeros_like(link), self._beam_tool())
        misturned = turned(self._cell.placed(self._target).misturned_deg)
        self._face = self.psds[self._target].frame(direction[0]) @ misturned

    def _light(self) -> tuple[Matrix | None, float]:
        """Where the beam hits the PSD's plane, in its frame (2,) mm (None: from behind, or not at all), and
        the laser's light."""
        if not self._on:
            return None, 0.0
        link, centre, normal = self._arm.link(), self._centre(), self._face[:, 2]
        still = np.zeros_like(link)
        tool = self._beam_tool()
        _, direction = self._functions.kernel("beam")(link, still, tool)
        if direction[0] @ normal >= 0:
            return None, 0.0
        point, length, _ = self._functions.kernel("hit")(link, still, tool, centre, normal)
        if length[0] <= 0:
            return None, 0.0
        return ((point[0] - centre) @ self._face)[:2], self._cell.laser.light

    def _reflection(self) -> tuple[Matrix, float] | None:
        """Where a reflection of the laser lights the face, in its frame (2,) mm, and its light, if any."""
        reflection = self._faults.met(Reflection) if self._on else None
        if reflection is None:
            return None
        return np.array(reflection.at_mm), reflection.light * self._cell.laser.light

    def _scene(self, camera: Camera) -> PictureScene:
        """The lights before the camera: the LEDs, and the spots of the laser on the PSD's front."""
        settings = self._cell.camera
        assert settings is not None
        hidden = self._faults.met(LedOccluded)
        places = [
            marker
            for led, marker in enumerate(self.psds[self._target].markers, start=1)
            if hidden is None or led != hidden.led
        ]
        brightness, size = [settings.led_light] * len(places), [_LED_MM] * len(places)
        hit, light = self._light()
        spots = []
        if hit is not None and np.abs(hit).max() <= self._cell.psd.surround_mm / 2:
            spots.append((hit, light))
        reflection = self._reflection()
        if reflection is not None:
            spots.append(reflection)
        for at, share in spots:
            places.append(np.append(at, 0.0))
            brightness.append(settings.spot_light * share)
            size.append(self._cell.laser.radius_mm / 2)
        link = self._arm.link()
        still = np.zeros_like(link)
        (eye,) = self._functions.kernel("place")(link, still, camera.mount[:3, 3])
        if not places or (eye[0] - self._centre()) @ self._face[:, 2] <= 0:  # seen from behind
            return PictureScene(np.empty((0, 3)), np.empty(0), np.empty(0))
        there = self._centre() + np.array(places) @ self._face.T
        (in_flange,) = self._functions.kernel("seen")(np.tile(link, (len(there), 1)), still, there)
        return PictureScene(camera.from_flange(in_flange), np.array(brightness), np.array(size))
