"""A plan as a table (CSV) and as trajectories for ROS; offsets as CSV and JSON."""

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
from ....model.records import to_json
from ....words import wording
from ....words.wording import again_words
from ...command_options import ProgramMotion
from ..calibration import ONCE, JointOffset, RobotCalibration
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
    return wording.csv_text(rows)


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


def csv_text(calibration: RobotCalibration) -> str:
    """One row a joint, every row with its provenance. A field is empty where the data cannot determine it."""
    return wording.csv_text(_row(offset, calibration) for offset in calibration.offsets)


def _row(offset: JointOffset, calibration: RobotCalibration) -> dict[str, object]:
    low, high = offset.row.interval95 or (None, None)
    made = calibration.inputs
    return {
        "offset": offset.name,
        "joint": one_line(offset.joint),
        "kind": offset.kind,
        "unit": offset.row.unit,
        "status": offset.status,
        "exported": "yes" if offset.exported else "no",
        "applied": offset.applied,
        "applied_u": offset.applied_u,
        "applied_status": offset.applied_status,
        "estimate": offset.row.estimate,
        "std": offset.row.std,
        "low95": low,
        "high95": high,
        "reason": one_line(offset.reason or ""),
        "run": one_line(made.run),
        "run_sha256": made.sha256,
        "robot": one_line(made.robot),
        "zerobeam": made.versions["zerobeam"],
        "notes": one_line("; ".join([ONCE, *calibration.warnings])),
    }


def json_text(calibration: RobotCalibration) -> str:
    """Text of the JSON file: ASCII, so that a name cannot break it."""
    return json.dumps(to_json(calibration), indent=1, allow_nan=False) + "\n"
