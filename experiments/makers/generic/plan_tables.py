"""A plan as a table (CSV), and as trajectories for ROS."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ....model.arrays import Matrix
from ....model.files.plan import Plan
from ....model.kinematics.pendant import pendant_of
from ....model.kinematics.robot import Robot
from ....words import spreadsheet
from ....words.wording import again_words
from ..format_options import ProgramMotion
from ..maker import one_line
from ..plan_programs import head_lines, rounded


def csv_table(plan: Plan, motion: ProgramMotion) -> str:
    """Columns `posture`, `target`, of a plan with repeats `again` (the posture that is repeated), then the
    joints by name in the pendant's order; all but these are empty for an intermediate one."""
    robot, pendant = plan.robot, pendant_of(plan.robot, motion.j3)
    names = [f"{one_line(robot.joints[i].name)}_{pendant.units[i]}" for i in pendant.order]
    again = [plan.repeated_by(i) for i in range(len(plan.postures))]
    rows: list[dict[str, object]] = []
    for i, posture in enumerate(plan.postures):
        way = rounded(pendant.shown(np.array([*plan.via_of(i), posture]) * robot.display))
        measured = {"posture": str(i), "target": one_line(plan.called[i])}
        if any(repeated is not None for repeated in again):
            measured["again"] = "" if again[i] is None else str(again[i])
        between = dict.fromkeys(measured, "")
        for row in way[:-1]:
            rows.append({**between, **dict(zip(names, row, strict=True))})
        rows.append({**measured, **dict(zip(names, way[-1], strict=True))})
    return spreadsheet.csv_text(rows)


_SETTLE_S = 1.0  # more than the way alone takes: also from where the wrist was turned to


def ros_trajectories(plan: Plan, motion: ProgramMotion) -> str:
    """The documents.

    Where the arm is before the first one is not known: its time is enough from the farthest position.
    """
    robot = plan.robot
    documents = []
    before: Matrix | None = None
    for i, posture in enumerate(plan.postures):
        rows = [*plan.via_of(i), posture]
        document = _document(robot, before, rows, motion.speed)
        target = f"target {json.dumps(plan.called[i])}{again_words(plan.repeated_by(i))}"
        documents.append(f"# posture {i}, {target}\n{document}")
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
