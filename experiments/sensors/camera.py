"""A camera on the flange: what is known of it, and where it sees a point.

The frame of the camera has z forward, x right and y down. The centre of the first pixel is (0, 0), x right
and y down, as in OpenCV; the distortion is that of Conrady (1919) and Brown (1971), in OpenCV's order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Matrix

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
