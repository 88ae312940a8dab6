"""Runs to export: of the built-in arm, and of arms from URDF files whose names mean harm."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from cells import LASER, good_plan, header, plan_of, simulated, varied_postures

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import Header
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run, read_run, write_run
from zerobeam.model.kinematics.robot import Robot

# Quotes, markup, line ends, the ends of comments and of strings in XML, RAPID, CSV and diffs.
HOSTILE = "=x\"'&<b>--> \n! ENDMODULE\r\n--- ]]> {1};%s\té"
_ESCAPED = (
    HOSTILE.replace("&", "&amp;")
    .replace("<", "&lt;")
    .replace('"', "&quot;")
    .replace("\n", "&#10;")
    .replace("\r", "&#13;")
    .replace("\t", "&#9;")
)

ARM = """<?xml version="1.0" encoding="utf-8"?>
<!-- not here: <joint name="j2"><origin rpy="9 9 9"/></joint> -->
<robot  name='{name}'
        version="1" >
  <link name="base"><visual><origin xyz="1 2 3" rpy="1 2 3"/></visual></link>
  <link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/><link name="l5"/>
  <link name="l6"/><link name="mount"/><link name="tool"/><link name="other"/>
  <joint name="j1" type="revolute">
    <origin xyz="0 0 0.4865"/> <parent link="base"/><child link="l1"/> <axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2.6"/>
  </joint>
  <joint type="revolute" name="j2" note='a > b, rpy="7 7 7"'>
    <parent link="l1"/><child link="l2"/>
    <origin note=' rpy="8 8 8" ' rpy = '0 0.1 0'
            xyz="0.15 0 0"/><!-- keep me -->
    <axis xyz="0 1 0"/><limit lower="-1.5" upper="2" velocity="2.6"/>
  </joint>
  <joint name="j3" type="{third}">
    <parent link="l2"/><child link="l3"/><origin rpy="0.3 -0.2 0.1" xyz="0 0 {reach}"/>
    <axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="2"/>
  </joint>
  <joint name="{joint}" type="continuous">
    <parent link="l3"/><child link="l4"/><origin xyz="0.3 0 0"/>
  </joint>
  <joint name="j5" type="revolute">
    <origin xyz="0.3 0 0" rpy="0.2 1.5707963267948966 0.4"></origin>
    <parent link="l4"/><child link="l5"/><axis xyz="1 0 2"/>
    <limit lower="-2" upper="2" velocity="7"/>
  </joint>
  <joint name="fixed" type="fixed"><parent link="l5"/><child link="mount"/><origin xyz="0 0 0.1"/></joint>
  <joint name="j6" type="revolute">
    <parent link="mount"/><child link="l6"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="8"/>
  </joint>
  <joint name="flange" type="fixed"><parent link="l6"/><child link="tool"/><origin xyz="0 0 0.065"/></joint>
  <joint name="branch" type="fixed"><parent link="l3"/><child link="other"/></joint>
</robot>
"""
TURNING = {"third": "revolute", "axis": "0 1 0", "lower": -2.5, "upper": 2.5, "reach": 0.475}
# A mounting that is stated: what is as good as an assumption is not exported.
STATED = {**LASER, "sigma": {"tilt_deg": 1e-5, "shift_mm": 1e-5}}
SLIDING = {"third": "prismatic", "axis": "0 0 1", "lower": 0, "upper": 0.5, "reach": 0.3}

TRUTH = {"delta2": -2.4, "delta3": 1.4, "delta4": 0.3, "delta5": -0.9, "delta6": 0.6}


def urdf_file(folder: Path, kind: dict[str, Any] = TURNING, name: str = "arm", joint: str = _ESCAPED) -> Path:
    path = folder / "arm.urdf"
    path.write_bytes(ARM.format(name=name, joint=joint, **kind).encode())
    return path


def saved(folder: Path, own: Header, run: Run) -> Run:
    """The run through its file, as the command reads it."""
    path = folder / "run.jsonl"
    write_run(path, own, run.shots)
    return read_run(path)


def urdf_run(folder: Path, kind: dict[str, Any] = TURNING, shots: int = 12) -> Run:
    """Shots of the URDF arm with the true offsets TRUTH."""
    ref = {"urdf": urdf_file(folder, kind).name, "base": "base", "tip": "tool"}
    target = (700.0, 200.0, 300.0)
    own = header(STATED, target=target, robot=ref, noise={"joint_mm": 0.02} if kind is SLIDING else None)
    robot = load_robot(own.robot, folder)
    postures = varied_postures(own, robot, target, shots, 3)
    _, run = simulated(plan_of(own, postures, robot=robot), TRUTH, 1)
    return saved(folder, own, run)


def arm_run(folder: Path, values: dict[str, float] = TRUTH, **changes: Any) -> Run:
    """Shots of the built-in arm."""
    plan = good_plan(10, **{"tool": STATED, **changes})
    return saved(folder, plan.header, simulated(plan, values, 2)[1])


# Six joints of 0.01 degrees at the end of 1.5 m, all at their worst, and the spot's 0.05 mm.
WITHIN_NOISE_MM = float(np.hypot(np.sqrt(6) * np.radians(0.01) * 1500, 0.05))


def poses(robot: Robot, joints: Matrix) -> Matrix:
    """(N, 3, 4) rotation and translation (mm) of the flange at true joint positions (N, n), rad or mm."""
    theta = ca.SX.sym("theta", robot.n)
    function = ca.Function("pose", [theta], [ca.horzcat(*robot.flange_pose(theta))])
    return np.array([np.array(function(row)) for row in joints])


def rms_mm(run: Run, joints: Matrix | None = None, robot: Robot | None = None) -> float:
    """How far the beams of a run go past the one point nearest to them all, with no offset at all.

    `joints` (N, n) rad or mm and `robot` stand in for those of the run. The beam is LASER's: along x, so that
    y and z are its axes across.
    """
    pose = poses(run.robot if robot is None else robot, run.joints if joints is None else joints)
    rotation, translation = pose[:, :, :3], pose[:, :, 3]
    point = np.array(LASER["point_mm"]) + run.spots @ np.eye(3)[1:]
    origin = np.einsum("nij,nj->ni", rotation, point) + translation
    along = rotation[:, :, 0]
    across = np.eye(3) - along[:, :, None] * along[:, None, :]
    nearest = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origin))
    past = np.einsum("nij,nj->ni", across, nearest - origin)
    return float(np.sqrt((past**2).sum(axis=1).mean()))


def corrected(run: Run, offsets: Sequence[float]) -> Matrix:
    """The recorded positions plus offsets (n,), deg or mm: (N, n) rad or mm."""
    return run.joints + np.array(offsets) / run.robot.display


def hostile(run: Run) -> Run:
    """The same run as if file, robot and first joint had a name that means harm."""
    first = replace(run.robot.joints[0], name=HOSTILE)
    robot = replace(run.robot, name=HOSTILE, joints=(first, *run.robot.joints[1:]))
    return replace(run, robot=robot, path=run.path.with_name(HOSTILE.replace("/", "")))
