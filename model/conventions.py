"""How an arm is mounted, how its pendant counts its joints, and what its encoders measure: stated facts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

J3 = Literal["ground", "link"]
PendantUnit = Literal["deg", "rad", "pulse"]


@dataclass(frozen=True)
class Conventions:
    """What a robot file, or the reference to a URDF, states of an arm; None where it states nothing.

    Parameters
    ----------
    below_base
        How far the mounting face is below the origin of the base frame, mm.
    joint3
        What the pendant counts joint 3 from. "ground": it shows the angle between links 2 and 3 less joint 2.
    range3
        Range of joint 3 as the pendant counts it, rad, where that is from the ground.
    order
        Indices of the joints (from 0) in the order in which the pendant shows them.
    names
        What the pendant calls the joints, joint 1 of the robot file first.
    unit, pulses_per_deg
        Of the pendant's values; the pulses are for a degree (mm) of each joint, joint 1 first.
    encoder3
        What the encoder of joint 3 measures.
    """

    below_base: float | None = None
    joint3: J3 | None = None
    range3: tuple[float, float] | None = None
    order: tuple[int, ...] | None = None
    names: tuple[str, ...] | None = None
    unit: PendantUnit = "deg"
    pulses_per_deg: tuple[float, ...] | None = None
    encoder3: J3 | None = None


NOTHING_STATED = Conventions()
