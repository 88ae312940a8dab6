"""Arms that deviate from nominal as real ones do, and what is recorded of them: a simulator of its own.

Plain numpy from Denavit and Hartenberg's matrices, no code of the package: each link's a, alpha, d and a
rotation beta about its y axis, deflection under gravity, first harmonics of the readings, direction and point
of the laser, lost motion. Angles are rad and lengths mm inside; arms are stacked along the first axis,
postures along the second.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

# a, alpha, d, theta of the IRB 1600 (Table 1 of the paper), mm and degrees.
_ROWS = np.array(
    [
        (150, -90, 486.5, 0),
        (700, 0, 0, -90),
        (0, 90, 0, 180),
        (0, -90, 600, 0),
        (0, 90, 0, 0),
        (0, 0, 0, 0),
    ],
    dtype=float,
)
N = len(_ROWS)
_HIT_MM = 1e-4
_WRIST = [3, 4, 5]  # what the servo turns
POINT, DIRECTION = np.array([0.0, 0.0, 65.0]), np.array([1.0, 0.0, 0.0])
_MASSES = np.array([150.0, 60.0, 40.0, 20.0, 8.0, 4.0])  # kg, at the links' ends: not equal ones


@dataclass(frozen=True)
class Sizes:
    """Standard deviations of what an arm deviates by; `lost_deg` is the gap of each joint's lost motion,
    of which a posture shows one half or the other."""

    offset_deg: float = 1.0
    length_mm: float = 0.3
    angle_deg: float = 0.1
    gravity_deg: float = 0.05
    harmonic_deg: float = 0.02
    tilt_deg: float = 0.05
    shift_mm: float = 0.1
    lost_deg: float = 0.01
    joint_noise_deg: float = 0.01
    spot_noise_mm: float = 0.05

    def times(self, factor: float) -> Sizes:
        """Deviations of arm and tool so many times as large; noise and lost motion as they are."""
        grown = ("length_mm", "angle_deg", "gravity_deg", "harmonic_deg", "tilt_deg", "shift_mm")
        return replace(self, **{name: factor * getattr(self, name) for name in grown})


@dataclass(frozen=True, eq=False)
class Arms:
    """A arms at random: `offsets` (A, n), `links` (A, n, 5) of a, alpha, d, beta and (the last alone) b,
    `gravity` (A, n), `harmonics` (A, n, 2), the laser's `tilt` (A, 2) and `shift` (A, 2) along y and z of the
    flange."""

    sizes: Sizes
    offsets: np.ndarray
    links: np.ndarray
    gravity: np.ndarray
    harmonics: np.ndarray
    tilt: np.ndarray
    shift: np.ndarray

    @classmethod
    def at_random(cls, count: int, rng: np.random.Generator, sizes: Sizes = Sizes()) -> Arms:
        angle, length = np.radians(sizes.angle_deg), sizes.length_mm
        links = rng.normal(size=(count, N, 5)) * [length, angle, length, angle, length]
        # A shift along parallel axes (2, 3) is the next link's too; beta is theirs and the flange's.
        links[:, 1, 2] = 0.0
        links[:, [0, 2, 3, 4], 3] = 0.0
        links[:, : N - 1, 4] = 0.0
        offsets = np.radians(sizes.offset_deg) * rng.normal(size=(count, N))
        offsets[:, 0] = 0.0  # the base frame is joint 1's
        return cls(
            sizes,
            offsets,
            links,
            np.radians(sizes.gravity_deg) * rng.normal(size=(count, N)),
            np.radians(sizes.harmonic_deg) * rng.normal(size=(count, N, 2)),
            np.radians(sizes.tilt_deg) * rng.normal(size=(count, 2)),
            sizes.shift_mm * rng.normal(size=(count, 2)),
        )

    def frames(self, theta: np.ndarray) -> list[np.ndarray]:
        """(A, S, 4, 4) of base, links 1 … n at true joint angles (A, S, n)."""
        frames = [np.broadcast_to(np.eye(4), (*theta.shape[:-1], 4, 4))]
        for i, (a, alpha, d, zero) in enumerate(_ROWS):
            by_a, by_alpha, by_d, beta, b = (self.links[:, i, k, None] for k in range(5))
            turned = _rotated("z", np.radians(zero) + theta[..., i])
            turned = turned @ _shifted(a + by_a, b, d + by_d) @ _rotated("x", np.radians(alpha) + by_alpha)
            # beta turns about the y axis before alpha, where the axes are parallel as in the flange.
            frames.append(frames[-1] @ turned @ _rotated("y", beta))
        return frames

    def bent(self, q: np.ndarray) -> np.ndarray:
        """(A, S, n) true joint angles at encoder readings q (A, S, n)."""
        at = q + np.broadcast_to(self.harmonics[:, None, :, 0] * np.cos(q), q.shape)
        at = at + self.harmonics[:, None, :, 1] * np.sin(q)
        return at + self.offsets[:, None] + self.gravity[:, None] * _torques(q) / _LARGEST

    def beams(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(A, S, 3) points and unit directions of the beams in the base frame at encoder readings."""
        flange = self.frames(self.bent(q))[-1]
        along = np.stack([np.ones(len(self.tilt)), *np.tan(self.tilt.T)], axis=1)
        along /= np.linalg.norm(along, axis=1)[:, None]
        point = POINT + np.pad(self.shift, ((0, 0), (1, 0)))
        to_base = flange[..., :3, :3]
        origin = flange[..., :3, 3] + np.einsum("asij,aj->asi", to_base, point)
        return origin, np.einsum("asij,aj->asi", to_base, along)

    def tcp(self, q: np.ndarray, point: np.ndarray) -> np.ndarray:
        """(A, S, 3) mm, a point of the flange in the base frame at encoder readings."""
        flange = self.frames(self.bent(q))[-1]
        return flange[..., :3, 3] + flange[..., :3, :3] @ point

    def recorded(
        self, postures: np.ndarray, target: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Recorded joints (A, S, n) rad of postures (S, n) rad whose wrist is turned until the beam meets the
        target (3,) mm up to the noise of the spot; and (A, S) which postures could be turned so."""
        count = (len(self.offsets), len(postures))
        q = np.broadcast_to(postures, (*count, N)).copy()
        wanted = self.sizes.spot_noise_mm * rng.normal(size=(*count, 3))
        for _ in range(30):
            left = self._off(q, target, wanted)
            if np.linalg.norm(left, axis=-1).max() < _HIT_MM:
                break
            step = 1e-6
            by_wrist = np.stack(
                [(self._off(q + step * np.eye(N)[k], target, wanted) - left) / step for k in _WRIST],
                axis=-1,
            )
            turn = -np.linalg.pinv(by_wrist, rcond=1e-3) @ left[..., None]
            largest = np.abs(turn).max(axis=(-2, -1), keepdims=True)
            q[..., _WRIST] += (turn * np.minimum(1.0, 0.2 / np.maximum(largest, 1e-300)))[..., 0]
        hit = np.linalg.norm(self._off(q, target, wanted), axis=-1) < _HIT_MM
        half = np.radians(self.sizes.lost_deg) / 2
        lost = half * rng.choice([-1.0, 1.0], size=q.shape)
        return q + lost + np.radians(self.sizes.joint_noise_deg) * rng.normal(size=q.shape), hit

    def _off(self, q: np.ndarray, target: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """(A, S, 3) mm from the wanted point beside the target to the beam, across it."""
        origin, direction = self.beams(q)
        short = target + wanted - origin
        return short - (short * direction).sum(axis=-1, keepdims=True) * direction


def _rotated(axis: str, angle: np.ndarray) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    j, k = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    result = np.zeros((*np.shape(angle), 4, 4)) + np.eye(4)
    result[..., j, j], result[..., k, k], result[..., j, k], result[..., k, j] = c, c, -s, s
    return result


def _shifted(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    result = np.zeros((*np.shape(x), 4, 4)) + np.eye(4)
    result[..., 0, 3], result[..., 1, 3], result[..., 2, 3] = x, y, z
    return result


def _nominal(count: int) -> Arms:
    none = np.zeros
    return Arms(
        Sizes(), none((count, N)), none((count, N, 5)), none((count, N)), none((count, N, 2)),
        none((count, 2)), none((count, 2)),
    )  # fmt: skip


def _torques(q: np.ndarray) -> np.ndarray:
    """(A, S, n) torques of the links' weight about the axes of the nominal arm, kg mm."""
    frames = _nominal(len(q)).frames(q)
    ends = np.stack([frame[..., :3, 3] for frame in frames[1:]], axis=-2)
    result = []
    for i in range(N):
        axis, at = frames[i][..., :3, 2], frames[i][..., :3, 3]
        weight = (ends[..., i:, :] - at[..., None, :]) * _MASSES[i:, None]
        moment = np.cross(weight.sum(axis=-2), [0.0, 0.0, -1.0])
        result.append((axis * moment).sum(axis=-1))
    return np.stack(result, axis=-1)


def _largest() -> np.ndarray:
    """(n,) largest torques over the joints' ranges; 1 where there is none (joint 1)."""
    lower, upper = np.array([-180, -90, -245, -200, -115, -400]), np.array([180, 120, 65, 200, 115, 400])
    degrees = np.random.default_rng(0).uniform(lower, upper, (1, 4000, N))
    largest = np.abs(_torques(np.radians(degrees))).max(axis=(0, 1))
    return np.where(largest > 1e-6 * largest.max(), largest, 1.0)


_LARGEST = _largest()
