"""A plan for ROS: trajectory_msgs/JointTrajectory in YAML, one document for each posture, in rad and m.

Joint 3 is counted from link 2, as a URDF has it: a driver of ROS converts it where the controller counts from
the ground (fanuc_driver, J23_factor).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....model.arrays import Matrix
from ....model.files.plan import Plan
from ....model.kinematics.robot import Robot
from .steps import Motion, head_lines

_SETTLE_S = 1.0  # more than the way alone takes: also from where the wrist was turned to


def ros_trajectories(plan: Plan, motion: Motion, name: str) -> str:
    """The documents; `name` of the file is not used.

    Where the arm is before the first one is not known: its time is enough from the farthest position.
    """
    motion.refuse("ros", "zone", "j3", "register", "listener", "tool")
    robot = plan.robot
    documents = []
    before: Matrix | None = None
    for i, posture in enumerate(plan.postures):
        rows = [*plan.via_of(i), posture]
        document = _document(robot, before, rows, motion.speed)
        documents.append(f"# posture {i}, target {json.dumps(plan.targets[i])}\n{document}")
        before = posture
    head = [
        *head_lines(plan, replace(motion, j3="link"), None),
        "Joint 3 is counted from link 2, as in a URDF; the driver converts it for controllers that do not.",
        "One trajectory_msgs/msg/JointTrajectory for each posture. Centre the beam, then append the joints:",
        "ros2 topic echo --once /joint_states >> recorded.yaml, which zerobeam import ros reads.",
    ]
    return "".join(f"# {line}\n" for line in head) + "---\n" + "---\n".join(documents)


def _document(robot: Robot, before: Matrix | None, rows: Sequence[Matrix], speed: float) -> str:
    time = 0.0
    lines = [f"joint_names: {json.dumps([joint.name for joint in robot.joints])}", "points:"]
    for row in rows:
        way = np.maximum(row - robot.lower, robot.upper - row) if before is None else np.abs(row - before)
        time += float((way * robot.display).max()) / speed + _SETTLE_S
        whole = math.floor(time)
        since = {"sec": whole, "nanosec": math.floor((time - whole) * 1e9)}
        lines += [
            f"  - positions: {json.dumps([_si(robot, i, value) for i, value in enumerate(row.tolist())])}",
            f"    time_from_start: {json.dumps(since)}",
        ]
        before = row
    return "\n".join(lines) + "\n"


def _si(robot: Robot, joint: int, value: float) -> float:
    return value if robot.joints[joint].kind == "revolute" else value / 1000
