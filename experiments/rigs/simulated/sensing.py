"""The simulated sensors: a PSD's currents by the physics of each kind, a camera's pictures of lights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipj, ellipk, erf, ndtr

from ....model.arrays import Matrix
from ...sensors.camera import Camera, Image
from ...sensors.psd import PAIR_LIGHT, Psd

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
