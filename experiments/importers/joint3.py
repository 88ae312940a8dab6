"""FANUC's joint 3: pendant, TP programs and position registers count it from the ground, not from link 2.

J3 of the controller is the angle of link 3 to the horizontal, so that it does not change when J2 alone moves.
The angle between the links, which a robot file or URDF wants, is J3 + J2: the ROS-Industrial FANUC driver
adds J2 to J3 for arms that are coupled so (parameter J23_factor = 1; fanuc_driver, fanuc_utils.h, and issue
17 of fanuc_experimental). The signs of J2 and J3 are FANUC's in both.
"""

from __future__ import annotations

from typing import Literal

from ...model.errors import BadInput
from ...model.robot import Matrix, Robot

J3 = Literal["ground", "link"]
J3_TOLD = "joint 3 is counted from the ground (FANUC): joint 2 is added to it"


def from_ground(joints: Matrix, robot: Robot) -> Matrix:
    """(N, n) degrees with J3 + J2 in place of J3."""
    if robot.n < 3 or any(joint.kind != "revolute" for joint in robot.joints[1:3]):
        raise BadInput(
            "joint 3 cannot be counted from the ground",
            found=f"{robot.name}, whose joints 2 and 3 are not both revolute",
            remedy="state that joint 3 is counted from link 2",
        )
    turned = joints.copy()
    turned[:, 2] += joints[:, 1]
    return turned
