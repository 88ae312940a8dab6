"""A rig that is watched: where its arm is sent and what its camera sees is told, for a picture of the run."""

from __future__ import annotations

import base64
import time
from collections.abc import Mapping

import numpy as np

from ...model.arrays import Matrix
from ...model.files.shot import Shot
from ..sensors.camera import Camera, Image
from ..sensors.psd import Psd
from .events import ArmSent, PictureTaken, Told
from .rig import Rig
from .steering import Belief

_WIDEST = 320  # px of a picture that is told
_BETWEEN_S = 0.25  # from one picture to the next


class WatchedRig:
    """The same rig. `belief` is what is believed during the measurement under way, to be set before each."""

    def __init__(self, rig: Rig, told: Told) -> None:
        self._rig, self._told = rig, told
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
            self._told(arm_sent(self.belief, self._shot, joints, lit=self._lit))
        self._rig.move(joints)

    def joints(self) -> Matrix:
        return self._rig.joints()

    def currents(self, samples: int) -> Matrix:
        return self._rig.currents(samples)

    def image(self) -> Image:
        seen = self._rig.image()
        if time.monotonic() - self._taken >= _BETWEEN_S:
            self._taken = time.monotonic()
            self._told(picture_taken(self._shot, seen))
        return seen

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
    laser = belief.problem.tool.kind == "laser"
    beam = [origin, origin + max(along, 0.0) * direction] if laser else [origin]
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
