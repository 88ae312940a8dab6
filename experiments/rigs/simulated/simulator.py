"""The simulated cell: an arm with true offsets, a laser, PSDs and a camera as they are read, on a clock of
their own.

What follows a `begin` depends on the seed, the measurement and what was recorded before it alone: a run that
is resumed makes the same measurements as one that was never stopped.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipj, ellipk, erf, ndtr

from ....model.arrays import Matrix
from ....model.errors import RigFault
from ....model.files.plan import Plan
from ....model.files.run import ENOUGH_CALIBRATED
from ....model.files.shot import Shot
from ....model.kinematics.pendant import beyond_limits
from ...sensors.detectors import PAIR_LIGHT, Camera, Image, Psd
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

# The modulus at which sn maps an upright rectangle of the sides 2 K and K' = 2 K, a square, to the upper half
# plane: k = (sqrt 2 - 1)^2, the singular value k_4 (Borwein & Borwein, Pi and the AGM, section 4.6).
_MODULUS = (np.sqrt(2) - 1) ** 2


@dataclass(frozen=True, eq=False)
class SimulatedPsd:
    """A PSD that gives currents, in shares of the laser's full light, in the order x+, x-, y+, y-.

    `beam` mm is the 1/e^2 radius of the Gaussian beam on the face, `ambient` the other light on the whole
    face in shares of the laser's full light, spread evenly. `resolution` mm is the step of the reading at the
    centre at full light. `nonlinearity` (0 to 1/3, of half the size) is how far the reading of a spot at the
    edge falls short because the resistive layers are uneven: u becomes u - nonlinearity u^3, u = 1 at the
    edge. A tetra-lateral PSD's pin-cushion, which follows from its four edges, comes on top.
    """

    psd: Psd
    beam: float
    nonlinearity: float
    ambient: float
    resolution: float

    def currents(self, hit: Matrix | None, share: float, samples: int, rng: np.random.Generator) -> Matrix:
        """(samples, 4) with the laser at `share` of its full light and the beam at `hit` (2,) mm.

        `hit` is in the PSD's frame, None where no beam arrives. The noise of a current does not depend on the
        light, so that of the position grows as 1 / light; a dark current may come out negative.
        """
        psd = self.psd
        mean = np.full(4, self.ambient * PAIR_LIGHT[psd.kind] / 2)
        if hit is not None:
            on_face, spot = caught(hit, self.beam, psd.size)
            u = spot / (psd.size / 2)
            mean += share * on_face * self._division(u - self.nonlinearity * u**3)
        # Two independent currents make the reading: its std is sqrt(2) times reach times theirs.
        currents: Matrix = mean + psd.noise / (np.sqrt(2) * psd.reach) * rng.normal(size=(samples, 4))
        if self.resolution > 0:
            # A spot on its way adds to one current of a pair what it takes from the other.
            step = self.resolution / (2 * psd.reach)
            currents = step * np.round(currents / step)
        return currents.clip(max=psd.saturation)

    def _division(self, u: Matrix) -> Matrix:
        """(4,) how a unit of light at `u` (2,), in half sizes, is divided among the four electrodes.

        A tetra-lateral PSD's is taken at the spot's centroid: a harmonic function's mean over a round beam is
        its value at the beam's centre. Only for a beam across an edge is that an approximation.
        """
        if self.psd.kind == "tetra-lateral":
            return harmonic_measures(u)
        return np.array([1 + u[0], 1 - u[0], 1 + u[1], 1 - u[1]]) / 2


def caught(hit: Matrix, beam: float, size: float) -> tuple[float, Matrix]:
    """The share of a Gaussian beam that falls on a square face, and the centroid (2,) mm of that share.

    `beam` mm is its 1/e^2 radius, `hit` (2,) mm its centre as seen from that of the face. The intensity
    exp(-2 r^2 / beam^2) is a normal density of std beam / 2 in x and in y, which the face of side `size`
    truncates: mass and mean of the truncated normal distribution (Johnson, Kotz & Balakrishnan, Continuous
    Univariate Distributions 1, section 13.10.1). Where no light at all is left: the nearest point.
    """
    std, half = beam / 2, size / 2
    # Mirrored to the side where the tails that are subtracted are small: no digits are lost far off.
    side = np.where(hit > 0, -1.0, 1.0)
    centre = side * hit
    low, high = (-half - centre) / std, (half - centre) / std
    mass = ndtr(-low) - ndtr(-high)
    density = (np.exp(-(low**2) / 2) - np.exp(-(high**2) / 2)) / np.sqrt(2 * np.pi)
    mean = centre + std * np.divide(density, mass, out=np.full(2, -np.inf), where=mass > 0)
    return float(mass.prod()), side * np.clip(mean, -half, half)


def harmonic_measures(u: Matrix) -> Matrix:
    """(..., 4) how a current from `u` (..., 2), in half sizes, divides among the edges of a square sheet.

    The potential in a uniform resistive sheet solves Laplace's equation with its edges grounded, and the
    current to one edge is the harmonic measure of that edge. sn maps the square to the upper half plane and
    its corners to -1/k, -1, 1 and 1/k; there the harmonic measure of an interval is the angle at which it is
    seen, over pi (Nevanlinna, Analytic Functions, I.3 and III.1). Order x+, x-, y+, y-.
    """
    m = _MODULUS**2
    quarter = ellipk(m)
    s, c, d, _ = ellipj(quarter * u[..., 0], m)
    s1, c1, d1, _ = ellipj(quarter * (u[..., 1] + 1), 1 - m)
    # sn(x + iy) = (real + i imaginary) / below (Abramowitz & Stegun 16.21.2), left undivided: the middle of
    # the edge y+ is at infinity. On an edge the imaginary part is 0 but for rounding, which may be negative.
    real, imaginary, below = s * d1, np.abs(c * d * s1 * c1), c1**2 + m * s**2 * s1**2
    corners = np.array([-1 / _MODULUS, -1.0, 1.0, 1 / _MODULUS])
    angles = np.arctan2(imaginary[..., None], real[..., None] - corners * below[..., None]) / np.pi
    left, bottom, right = np.moveaxis(np.diff(angles, axis=-1), -1, 0)
    return np.stack([right, left, 1 - left - bottom - right, bottom], axis=-1)


# A sensor of 10,000 electrons at full scale: the variance of s grey values of light is s / 40.
ELECTRONS = 40.0
# The background is brighter by this share in the lower right corner than in the middle, and as much darker in
# the upper left.
SLOPE = 0.2
# Nothing of a Gaussian is seen beyond so many standard deviations: 4e-6 of its peak.
_REACH = 5.0
_METRE = 1000.0


@dataclass(frozen=True, eq=False)
class PictureScene:
    """Lights before a camera.

    `points` (K, 3) mm in the camera frame, `brightness` (K,) the sum of grey values that each one makes at
    1 m and at an exposure of 1, `size` (K,) mm its radius (one standard deviation of a Gaussian).
    """

    points: Matrix
    brightness: Matrix
    size: Matrix


def render(
    camera: Camera,
    scene: PictureScene,
    *,
    exposure: float,
    ambient: float,
    noise: float,
    psf: float,
    rng: np.random.Generator,
) -> Image:
    """(height, width) grey values of a picture of the scene.

    `exposure` multiplies the light of the scene; `ambient` is the background in the middle of the picture and
    `noise` the standard deviation of the read noise, grey values; `psf` px is the standard deviation of the
    image of a point. Shot noise comes on top (ELECTRONS), light falls with the square of the distance.
    """
    right, down = (
        np.linspace(-SLOPE / 2, SLOPE / 2, n, dtype=np.float32) for n in (camera.width, camera.height)
    )
    light = np.float32(ambient) * (1 + right + down[:, None])
    distance = np.linalg.norm(scene.points, axis=1) / _METRE
    total = exposure * scene.brightness / np.maximum(distance, 1e-3) ** 2
    depth = np.maximum(scene.points[:, 2], 1e-3)[:, None]
    spread = np.hypot(np.array(camera.focal) * scene.size[:, None] / depth, psf)
    for pixel, grey, sigma in zip(camera.project(scene.points), total, spread, strict=True):
        if np.isfinite(pixel).all():
            columns, across = _profile(pixel[0], sigma[0], camera.width)
            rows, along = _profile(pixel[1], sigma[1], camera.height)
            light[rows, columns] += grey * np.outer(along, across)
    deviates = rng.standard_normal(light.shape, dtype=np.float32)
    deviates *= np.sqrt(light / ELECTRONS + noise**2)
    light += deviates
    image: Image = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    return image


def _profile(centre: float, sigma: float, pixels: int) -> tuple[slice, NDArray[np.float32]]:
    """Which of a row of pixels a Gaussian reaches, and the share of it that falls on each of them."""
    first = int(np.clip(np.floor(centre - _REACH * sigma), 0, pixels))
    last = int(np.clip(np.ceil(centre + _REACH * sigma) + 1, first, pixels))
    edges = np.arange(first, last + 1) - 0.5
    below = erf((edges - centre) / (np.sqrt(2) * sigma))
    return slice(first, last), np.diff(below).astype(np.float32) / 2


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
