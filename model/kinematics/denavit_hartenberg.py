"""Denavit-Hartenberg rows, standard and modified, as the chain of fixed transforms of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ..arrays import Matrix
from .robot import rotation_about, shift


@dataclass(frozen=True)
class DHRow:
    """One Denavit-Hartenberg row: a, d in mm, alpha, theta in rad (theta is the joint's zero position).

    `beta` is the further rotation about y, rad, of two axes that are nearly parallel (Hayati and Mirmirani).
    """

    a: float
    alpha: float
    d: float
    theta: float
    beta: float = 0.0


def dh_chain(
    rows: Sequence[DHRow], convention: Literal["standard", "modified"]
) -> tuple[list[Matrix], Matrix]:
    """Fixed transforms before each joint and the one after the last, all joints moving about or along z.

    standard (eq. 1 of the paper): Rz(theta + q) Tz(d) Tx(a) Rx(alpha) Ry(beta).
    modified (Craig):              Rx(alpha) Tx(a) Ry(beta) Rz(theta + q) Tz(d).
    """
    fixed: list[Matrix] = []
    pending = np.eye(4)
    for row in rows:
        turn = rotation_about("z", row.theta) @ shift(z=row.d)
        link = shift(x=row.a) @ rotation_about("x", row.alpha) @ rotation_about("y", row.beta)
        if convention == "standard":
            fixed.append(pending)
            pending = turn @ link
        else:
            fixed.append(pending @ link)
            pending = turn
    return fixed, pending
