"""The posterior of the built-in arm once more, in plain numpy: a second opinion for the tests of the fit.

Nothing here comes from the package: Table 1 and eq. 1 to 7 of the paper and the density of section 1 are
written out, with a geometric Jacobian. Complex numbers go through, so that derivatives come by complex steps,
and many vectors at once, stacked along leading axes (`...`).
"""

from collections.abc import Callable

import numpy as np
from plain_model import matrix

# a, alpha, d, theta of Table 1; the point on the beam, which is along the flange's x axis.
TABLE_1 = [
    (150.0, -90.0, 486.5, 0.0),
    (700.0, 0.0, 0.0, -90.0),
    (0.0, 90.0, 0.0, 180.0),
    (0.0, -90.0, 600.0, 0.0),
    (0.0, 90.0, 0.0, 0.0),
    (0.0, 0.0, 0.0, 0.0),
]
POINT = np.array([0.0, 0.0, 65.0])


def frames(theta: np.ndarray) -> list[np.ndarray]:
    """T_0 … T_6 (..., 4, 4) of the standard DH chain (eq. 1) at the true joint positions (..., 6), rad."""
    result = [matrix(np.eye(4), theta.shape[:-1])]
    for (a, alpha_deg, d, zero_deg), turn in zip(TABLE_1, np.moveaxis(theta, -1, 0), strict=True):
        angle, alpha = turn + np.radians(zero_deg), np.radians(alpha_deg)
        c, s, ca, sa = np.cos(angle), np.sin(angle), np.cos(alpha), np.sin(alpha)
        rows = [[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]]
        result.append(result[-1] @ matrix(rows, turn.shape))
    return result


def beam(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A point (3,) and the unit direction (3,) of the beam in the base frame (eq. 7)."""
    last = frames(theta)[-1].real
    return last[:3, :3] @ POINT + last[:3, 3], last[:3, 0]


def misses(
    joints: np.ndarray, spots: np.ndarray, delta: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Misses (..., N, 2) mm and their Jacobians by the joints (..., N, 2, 6): -R'(z_j x (P - o_j)).

    At offsets (..., 6) and a target (..., 3).
    """
    chain, position = frames(joints + delta[..., None, :]), target[..., None, :]
    back, shift = np.swapaxes(chain[-1][..., :3, :3], -1, -2), chain[-1][..., :3, 3]
    residual = (back @ (position - shift)[..., None])[..., 1:, 0] - POINT[1:] - spots
    columns = [np.cross(t[..., :3, 2], position - t[..., :3, 3]) for t in chain[:-1]]
    return residual, -(back @ np.stack(columns, axis=-1))[..., 1:, :]


class PlainPosterior:
    """-log posterior of z = (delta2 … delta6, target x, y, z), each less its prior mean over its prior std.

    Known noise, calibrated laser, one target; delta1 is held at zero.
    """

    def __init__(
        self,
        joints: np.ndarray,
        spots: np.ndarray,
        guess: tuple[float, float, float],
        joint_deg: float,
        spot_mm: float,
    ) -> None:
        self.joints, self.spots = joints, spots
        self.mean = np.array([0.0] * 5 + list(guess))
        self.prior_std = np.array([np.radians(5.0)] * 5 + [10_000.0] * 3)
        self.joint, self.spot = np.radians(joint_deg), spot_mm

    def _parts(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Misses (..., N, 2) and their covariances (..., N, 2, 2)."""
        x = self.mean + z * self.prior_std
        delta = np.concatenate([np.zeros((*z.shape[:-1], 1)), x[..., :5]], axis=-1)
        residual, by_joints = misses(self.joints, self.spots, delta, x[..., 5:])
        return residual, self.joint**2 * by_joints @ np.swapaxes(by_joints, -1, -2) + self.spot**2 * np.eye(2)

    def value(self, z: np.ndarray) -> np.ndarray:
        """(...) up to a constant."""
        residual, s = self._parts(z)
        quad = (residual * np.linalg.solve(s, residual[..., None])[..., 0]).sum(axis=(-2, -1))
        return (quad + (z**2).sum(axis=-1)) / 2

    def gradient(self, z: np.ndarray) -> np.ndarray:
        return by_complex_steps(self.value, z)

    def hessian(self, z: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """By central differences of the gradient, `steps` (f,) along each unknown."""
        rows = [(self.gradient(z + e) - self.gradient(z - e)) / (2 * e.sum()) for e in np.diag(steps)]
        hessian = np.array(rows)
        return (hessian + hessian.T) / 2

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """(..., 2 N + f) whose half sum of squares is the -log posterior; the priors come last."""
        residual, s = self._parts(z)
        l11 = np.sqrt(s[..., 0, 0])
        l21 = s[..., 1, 0] / l11
        l22 = np.sqrt(s[..., 1, 1] - l21**2)
        first = residual[..., 0] / l11
        second = (residual[..., 1] - l21 * first) / l22
        return np.concatenate([first, second, z], axis=-1)

    def residual_jacobian(self, z: np.ndarray) -> np.ndarray:
        return by_complex_steps(self.residuals, z).T


def by_complex_steps(function: Callable[[np.ndarray], np.ndarray], z: np.ndarray) -> np.ndarray:
    """Derivatives of `function` by each z, exact to rounding: (f,) of a value, (f, M) of a vector."""
    return np.imag(function(z + 1e-30j * np.eye(len(z)))) / 1e-30
