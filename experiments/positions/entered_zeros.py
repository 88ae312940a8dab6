"""By how much more each joint reads at the same place, once zeros were entered."""

from __future__ import annotations

import re

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.kinematics.robot import Robot

MOST_DEG = 5.0  # more is another posture, or another unit


def typed_zeros(text: str, robot: Robot) -> Matrix:
    """(n,) degrees (mm) of `J2=-0.265,J3=…`; joints that are not named are 0.

    BadInput for a joint that is not there, or named twice, and for no zero at all.
    """
    values: dict[int, float] = {}
    for part in re.split(r"[,;\s]+", text.strip()):
        match = re.fullmatch(r"[JA]?(\d+)=([-+]?(?:\d+\.?\d*|\.\d+))", part, re.IGNORECASE)
        number = int(match[1]) if match else 0
        if match is None or not 1 <= number <= robot.n or number in values:
            raise BadInput(
                "--entered is not understood",
                found=part,
                allowed=f"J1=… to J{robot.n}=…, each once, in degrees (mm), as J2=-0.265,J3=0.112",
            )
        values[number] = float(match[2])
    entered = np.array([values.get(i, 0.0) for i in range(1, robot.n + 1)])
    return require_zeros(entered)


def require_zeros(entered: Matrix) -> Matrix:
    """BadInput where the change is none, or no change of zeros."""
    if not entered.any():
        raise BadInput("no zero was changed, so that no position has to be", found="0 for all joints")
    if np.abs(entered).max() > MOST_DEG:
        raise BadInput(
            "these are no changes of zeros",
            found=f"{np.abs(entered).max():g} deg (mm)",
            allowed=f"up to {MOST_DEG:g} deg (mm): after more, the arm has to be taught again",
            remedy="state by how much more each joint reads at the same place, in degrees (mm)",
        )
    return entered
