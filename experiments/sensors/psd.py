"""A position-sensitive detector (PSD) as in its data sheet: from four currents to light and position.

Currents are shares of the laser's full light, in the order x+, x-, y+, y-. The PSD's frame: origin at the
centre of the active face, z outward, x and y as it reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy
from numpy.typing import NDArray

from ...model.arrays import Matrix
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
