"""Whether two robots are one arm: the same name, joints and nominal geometry."""

from __future__ import annotations

import numpy as np

from ..model.kinematics.robot import Robot

_SAME = 1e-9  # relative: two descriptions of one arm
Difference = tuple[str, object, object]  # what differs, and what either has


def arm_difference(one: Robot, other: Robot) -> Difference | None:
    """The first difference between two robots; None of one arm."""
    if one.name != other.name:
        return "robot", one.name, other.name
    kinds = [", ".join(joint.kind for joint in arm.joints) for arm in (one, other)]
    if kinds[0] != kinds[1]:
        return "robot", f"joints {kinds[0]}", kinds[1]
    fixed = [[*(joint.fixed for joint in arm.joints), arm.flange] for arm in (one, other)]
    for k, (mine, theirs) in enumerate(zip(*fixed, strict=True), start=1):
        if not np.allclose(mine, theirs, rtol=_SAME, atol=_SAME):
            link = "flange" if k > one.n else f"link before joint {k}"
            return "geometry of the robot", f"one {link}", "another"
    mine, theirs = (np.array([joint.axis for joint in arm.joints]) for arm in (one, other))
    if not np.allclose(mine, theirs, rtol=_SAME, atol=_SAME):
        return "geometry of the robot", "one direction of an axis", "another"
    return None
