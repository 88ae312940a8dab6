"""A position-sensitive detector (PSD) and a camera as in their data sheets, and those that come with a
controller.

Currents are shares of the laser's full light, in the order x+, x-, y+, y-. The PSD's frame: origin at the
centre of the active face, z outward, x and y as it reads.
"""

from __future__ import annotations

import base64
import json
import socket
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from ...model.arrays import Matrix
from ...model.errors import RigFault
from ...model.parsing.reading import shown
from ...model.parsing.validation import refusal, without_length

PsdKind = Literal["duo-lateral", "tetra-lateral"]

# Share of the light on the face that the two currents of one axis have between them, at the centre.
PAIR_LIGHT: dict[PsdKind, float] = {"duo-lateral": 1.0, "tetra-lateral": 0.5}

# Shares of the laser's light that a beam on the centre may have. A second light of a tenth of it, 10 mm off,
# moves the reading by 1 mm; what is weaker is left to the statistics.
WEAKEST, BRIGHTEST = 0.5, 1.1
LIT = 0.02  # share of the laser's light from which on the PSD has the beam on it

# What (I1 - I2) / (I1 + I2) is multiplied by, in half sizes. Tetra-lateral: the current to an edge is the
# harmonic measure of that edge, and near the centre of a square of half size 1 that of x = 1 less that of
# x = -1 grows by 2 sum_m (-1)^m / sinh((2m + 1) pi / 2) = sqrt(2) K(1/sqrt 2) / pi, Gauss's constant 0.8346,
# for a step of 1 (the Fourier series of sn at its quarter period: DLMF 22.11.1, k' = k). Their sum is 1/2.
GAIN: dict[PsdKind, float] = {
    "duo-lateral": 1.0,
    "tetra-lateral": float(0.5 * np.pi / (np.sqrt(2) * scipy.special.ellipk(0.5))),
}

# A beam this close to the base's x axis leaves too little of that axis across it.
_ALONG_X = np.cos(np.radians(20.0))


def face_normal(value: object) -> object:
    if value is None or value == "beam":
        return value
    if not isinstance(value, list | tuple) or len(value) != 3 or without_length(value):
        raise refusal(
            "this is not a normal of a PSD's face",
            found=shown(value),
            allowed="[x, y, z] of any length but zero, or beam",
        )
    return tuple(value)


@dataclass(frozen=True, eq=False)
class Psd:
    """The data sheet and the pose of one PSD.

    `size` mm is the side of its square active face, `rate` its samples a second, `noise` mm the std of one
    sample at full light at the centre, `saturation` the largest current that an electrode can measure.
    `markers` (2, 3) mm are the two LEDs in the PSD's frame. `normal` (3,) is its outward unit normal in the
    base frame; None: its face is turned towards each beam. `turn` rad is how far its x axis is turned about
    the normal from where `frame` has it by default.
    """

    size: float
    kind: PsdKind
    rate: float
    noise: float
    saturation: float
    markers: Matrix
    normal: Matrix | None
    turn: float

    @property
    def reach(self) -> float:
        """mm that the reading moves for 1 more current in one electrode: at the centre, at full light."""
        return GAIN[self.kind] * self.size / 2 / PAIR_LIGHT[self.kind]

    def frame(self, direction: Matrix) -> Matrix:
        """(3, 3) the PSD's axes x, y, z in the base frame, as columns, under a beam along `direction` (3,).

        By default x is the base's x axis made square to z, or its y axis where z is within 20 degrees of x.
        """
        z = -direction if self.normal is None else self.normal
        side = np.array([0.0, 1.0, 0.0] if abs(z[0]) > _ALONG_X else [1.0, 0.0, 0.0])
        x = side - (side @ z) * z
        x /= np.linalg.norm(x)
        x = np.cos(self.turn) * x + np.sin(self.turn) * np.cross(z, x)
        return np.column_stack([x, np.cross(z, x), z])

    def light(self, currents: Matrix) -> Matrix:
        """(...) the light on the face by currents (..., 4), as a share of the laser's full light.

        All of it goes through both layers of a duo-lateral PSD, and through the one of a tetra-lateral one.
        """
        return np.asarray(currents.sum(axis=-1) / (2 * PAIR_LIGHT[self.kind]))

    def position(self, currents: Matrix) -> Matrix:
        """(..., 2) mm where the spot is by currents (..., 4); NaN where a pair of electrodes has no current.

        x = g (L / 2) (I1 - I2) / (I1 + I2), g of `GAIN`: exact for an ideal duo-lateral PSD, to first order
        about the centre for a tetra-lateral one.
        """
        plus, minus = currents[..., 0::2], currents[..., 1::2]
        pair = np.where(plus + minus > 0, plus + minus, np.nan)
        return GAIN[self.kind] * self.size / 2 * (plus - minus) / pair

    def saturated(self, currents: Matrix) -> NDArray[np.bool_]:
        """(...) True where a current of the row (..., 4) is the largest that an electrode can measure."""
        return np.asarray(np.any(currents >= self.saturation * (1 - 1e-9), axis=-1))


# A camera on the flange: what is known of it, and where it sees a point.
#
# The frame of the camera has z forward, x right and y down. The centre of the first pixel is (0, 0), x
# right and y down, as in OpenCV; the distortion is that of Conrady (1919) and Brown (1971), in OpenCV's
# order.

Image = NDArray[np.uint8]

# Newton's iterations double their digits; where the distortion turns back they only gain a factor of two.
_ITERATIONS = 60
_ROUNDING = 1e-13


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole with distortion, and its place on the flange.

    `width` and `height` px, `focal` and `centre` px (x, y), `distortion` (k1, k2, p1, p2, k3), `mount` (4, 4)
    mm the camera's pose in the flange frame.
    """

    width: int
    height: int
    focal: tuple[float, float]
    centre: tuple[float, float]
    distortion: tuple[float, float, float, float, float]
    mount: Matrix

    def from_flange(self, points: Matrix) -> Matrix:
        """(N, 3) mm in the camera frame, from points (N, 3) mm in the flange frame."""
        result: Matrix = (points - self.mount[:3, 3]) @ self.mount[:3, :3]
        return result

    def project(self, points: Matrix) -> Matrix:
        """Pixels (N, 2) of points (N, 3) mm in the camera frame; NaN for a point that has no image.

        That is a point not in front of the camera, or one so far aside that the polynomial of the distortion
        has turned back and would put it into the picture again.
        """
        distorted, _ = self._distorted(self._slopes(points))
        return np.array(self.focal) * distorted + self.centre

    def project_jacobian(self, points: Matrix) -> Matrix:
        """(N, 2, 3) px/mm: the derivative of `project` by the points; NaN for a point that has no image."""
        slopes = self._slopes(points)
        _, by_slope = self._distorted(slopes)
        by_point = np.zeros((len(slopes), 2, 3))  # times the depth
        by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0
        by_point[:, :, 2] = -slopes
        per_depth = np.array(self.focal) / _depth(points)[:, None]
        result: Matrix = per_depth[:, :, None] * (by_slope @ by_point)
        return result

    def rays(self, pixels: Matrix) -> Matrix:
        """Unit directions (N, 3) in the camera frame that `project` to the pixels (N, 2).

        By Newton's iteration to rounding; NaN for a pixel that no point in front of the camera projects to.
        """
        goal = (pixels - np.array(self.centre)) / self.focal
        slopes = goal.copy()
        with np.errstate(all="ignore"):  # a pixel that has no ray runs away, and is found out below
            for _ in range(_ITERATIONS):
                distorted, by_slope = self._distorted(slopes)
                (a, b), (c, d) = by_slope.transpose(1, 2, 0)
                x, y = (goal - distorted).T
                step = np.column_stack([d * x - b * y, a * y - c * x]) / (a * d - b * c)[:, None]
                slopes = self._within(slopes + step)
                if not (np.abs(step) > _ROUNDING * (1 + np.abs(slopes))).any():
                    break
            missed = np.abs(self._distorted(slopes)[0] - goal).max(axis=1, initial=0.0)
        slopes[~(missed <= 10 * _ROUNDING * (1 + np.abs(goal).max(axis=1, initial=0.0)))] = np.nan
        directions = np.column_stack([slopes, np.ones(len(slopes))])
        result: Matrix = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        return result

    @cached_property
    def _limit(self) -> float:
        """The squared slope r² where the distorted r (1 + k1 r² + k2 r⁴ + k3 r⁶) turns back; inf: never."""
        k1, k2, _, _, k3 = self.distortion
        roots = np.roots([7 * k3, 5 * k2, 3 * k1, 1.0])
        turns = roots.real[(np.abs(roots.imag) <= 1e-12 * np.abs(roots)) & (roots.real > 0)]
        return float(turns.min(initial=np.inf))

    def _slopes(self, points: Matrix) -> Matrix:
        """(N, 2) x/z and y/z, NaN for a point that has no image."""
        slopes: Matrix = points[:, :2] / _depth(points)[:, None]
        slopes[(slopes**2).sum(axis=1) > self._limit] = np.nan
        return slopes

    def _within(self, slopes: Matrix) -> Matrix:
        """The slopes (N, 2), drawn back to where the distortion turns if they are beyond it."""
        squared = (slopes**2).sum(axis=1)
        beyond = squared > self._limit
        slopes[beyond] *= np.sqrt(self._limit / squared[beyond])[:, None]
        return slopes

    def _distorted(self, slopes: Matrix) -> tuple[Matrix, Matrix]:
        """(N, 2) distorted slopes and (N, 2, 2) their derivatives: Brown-Conrady."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = slopes.T
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        bend = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3))  # d radial / dx = bend x
        distorted = np.column_stack(
            [
                x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
            ]
        )
        by_slope = np.empty((len(slopes), 2, 2))
        by_slope[:, 0, 0] = radial + bend * x * x + 2 * p1 * y + 6 * p2 * x
        by_slope[:, 1, 1] = radial + bend * y * y + 6 * p1 * y + 2 * p2 * x
        by_slope[:, 0, 1] = by_slope[:, 1, 0] = bend * x * y + 2 * p1 * x + 2 * p2 * y
        return distorted, by_slope


def _depth(points: Matrix) -> Matrix:
    """(N,) how far the points (N, 3) are in front of the camera; NaN where they are not."""
    return np.where(points[:, 2] > 0, points[:, 2], np.nan)


# The sensors that come with a controller: what a rig requires of them, and those of the simulated one.
#
# The latter answer by TCP, one JSON object a line, each answered by one line:
#
#     {"ask": "sheets"} → {"psds": {NAME: {…}}, "camera": {…} or null}
#     {"ask": "currents", "target": NAME, "samples": N} → {"currents": [[x+, x-, y+, y-], …]}, null: lost
#     {"ask": "image", "target": NAME} → {"width": W, "height": H, "grey": base64, row by row}
#
# What cannot be answered is {"error": "…"}. Currents take N / rate seconds before they are answered, an
# image none. The fields of the sheets are those of `Psd` and `Camera` (mm, rad, pixels).

_ANSWER_S = 5.0


class Sensors(Protocol):
    """The sensors next to the controller: PSDs by target, and a camera or none."""

    psds: Mapping[str, Psd]
    camera: Camera | None

    def currents(self, target: str, samples: int) -> Matrix:
        """(samples, 4) of that target's PSD; a sample that did not arrive is a row of NaN."""
        ...

    def image(self, target: str) -> Image:
        """(height, width) grey values 0 to 255, with that target's PSD in view."""
        ...


class RemoteSensors:
    """The sensors of a simulated controller by TCP; RigFault where they do not answer."""

    def __init__(self, host: str, port: int) -> None:
        try:
            self._socket = socket.create_connection((host, port), timeout=_ANSWER_S)
        except OSError as error:
            raise RigFault(f"no sensors at {host}, port {port}: {error.strerror or error}") from None
        self._lines = self._socket.makefile("rwb")
        sheets = self._ask(ask="sheets")
        self.psds: Mapping[str, Psd] = {name: Psd(**_arrays(psd)) for name, psd in sheets["psds"].items()}
        self.camera = None if sheets["camera"] is None else Camera(**_arrays(sheets["camera"]))

    def currents(self, target: str, samples: int) -> Matrix:
        return np.array(self._ask(ask="currents", target=target, samples=samples)["currents"], dtype=float)

    def image(self, target: str) -> Image:
        reply = self._ask(ask="image", target=target)
        grey = np.frombuffer(base64.b64decode(reply["grey"]), dtype=np.uint8)
        return grey.reshape(reply["height"], reply["width"])

    def close(self) -> None:
        self._lines.close()
        self._socket.close()

    def _ask(self, **what: Any) -> dict[str, Any]:
        try:
            self._lines.write(json.dumps(what).encode() + b"\n")
            self._lines.flush()
            reply = json.loads(self._lines.readline())
        except (OSError, ValueError):
            raise RigFault("the sensors do not answer: is the simulated controller still there?") from None
        if "error" in reply:
            raise RigFault(f"the sensors refuse: {reply['error']}")
        return dict(reply)


def _arrays(sheet: dict[str, Any]) -> dict[str, Any]:
    """Vectors and matrices of a data sheet, as they were before they became JSON."""
    return {key: np.array(value) if isinstance(value, list) else value for key, value in sheet.items()}
