"""Pictures of a simulated camera: a few lights before a dark background, as grey values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from ....model.arrays import Matrix
from ...sensors.camera import Camera, Image

# A sensor of 10,000 electrons at full scale: the variance of s grey values of light is s / 40.
ELECTRONS = 40.0
# The background is brighter by this share in the lower right corner than in the middle, and as much darker in
# the upper left.
SLOPE = 0.2
# Nothing of a Gaussian is seen beyond so many standard deviations: 4e-6 of its peak.
_REACH = 5.0
_METRE = 1000.0


@dataclass(frozen=True, eq=False)
class Scene:
    """Lights before a camera.

    `points` (K, 3) mm in the camera frame, `brightness` (K,) the sum of grey values that each one makes at
    1 m and at an exposure of 1, `size` (K,) mm its radius (one standard deviation of a Gaussian).
    """

    points: Matrix
    brightness: Matrix
    size: Matrix


def render(
    camera: Camera,
    scene: Scene,
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
