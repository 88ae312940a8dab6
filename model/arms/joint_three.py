"""Joint 3 as some controllers count it: from the ground, and not from link 2."""

from __future__ import annotations

from typing import Literal

from ..errors import BadInput
from ..robot import Matrix, Robot

J3 = Literal["ground", "link"]
COUNTED_FROM_GROUND = ("fanuc",)  # vendors whose pendants and data sheets do so


def require_coupled(robot: Robot) -> None:
    """BadInput for an arm whose joint 3 cannot be counted from the ground."""
    if robot.n < 3 or any(joint.kind != "revolute" for joint in robot.joints[1:3]):
        raise BadInput(
            "joint 3 of this robot is not counted from the ground",
            found=f"{robot.name}, whose joints 2 and 3 are not both revolute",
            remedy="state that joint 3 is counted from link 2",
        )


def from_ground(joints: Matrix, robot: Robot) -> Matrix:
    """(…, n) degrees or rad with J3 + J2 in place of J3: FANUC's joint 3 is the angle of link 3 to the
    horizontal.

    A robot file or URDF wants the angle between the links. The ROS-Industrial FANUC driver adds J2 to J3 for
    arms that are coupled so (J23_factor = 1; fanuc_driver, fanuc_utils.h; issue 17 of fanuc_experimental).
    The signs of J2 and J3 are FANUC's in both.
    """
    require_coupled(robot)
    turned = joints.copy()
    turned[..., 2] += joints[..., 1]
    return turned


def to_ground(joints: Matrix, robot: Robot) -> Matrix:
    """The same backwards: (…, n) with J3 - J2 in place of J3."""
    require_coupled(robot)
    turned = joints.copy()
    turned[..., 2] -= joints[..., 1]
    return turned
