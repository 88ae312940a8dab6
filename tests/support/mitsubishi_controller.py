"""A Mitsubishi controller as far as the tests need it: it runs MELFA-BASIC, and saves what was taught.

Written from the manual of MELFA-BASIC V, without the code that is tested.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, flange_arm, solved_pose

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

ROBOT, TARGET = "rv2fr", (350.0, 0.0, 100.0)
KIND, READER, SUFFIX = "melfa", "melfa", ".prg"
STEP_DEG = 6e-3  # the digits of the positions of a plan's program
DIGITS_MM = 1e-3  # … and of a program of a person


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The file that is saved after the program has run, and the person has taught at each stop."""
    text = program.read_text()
    joints = {
        name: [float(value) for value in values.split(",")]
        for name, values in re.findall(r"^(J\w+)=\((.*)\)$", text, re.MULTILINE)
    }
    here = ""
    for line in text[: text.index("End\n")].splitlines():
        statement = line.split("'")[0].strip()
        if motion := re.fullmatch(r"Mov (J\w+)", statement):
            here = motion[1]
            arm.move(joints[here])
        elif statement == "Hlt":
            arm.centre()
            joints[here] = arm.joints()
        else:
            assert re.fullmatch(r"(JOvrd \d+|Cnt 0)?", statement)
    saved = program.with_name(f"saved{SUFFIX}")
    rows = [f"{name}=({','.join(f'{value:+.4f}' for value in row)})" for name, row in joints.items()]
    code = text[: text.index("End\n")].splitlines()
    numbered = [f"{i} {line}" for i, line in enumerate([*code, "End"], start=1)]
    saved.write_text("\r\n".join([*numbered, *rows, ""]))
    return saved


def _xyzabc(pose: Matrix) -> str:
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join(f"{value:+.6f}" for value in [*pose[:3, 3], *turns])


def _pose(text: str) -> Matrix:
    x, y, z, *turns = map(float, text.split(","))
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
    result[:3, 3] = x, y, z
    return result


STATED = ProgramOptions(frames=[f"ptable={_xyzabc(TABLE)}"])


def _flags(robot: Robot, row: Matrix) -> str:
    """FL1: 4 in front of axis 1, 2 elbow above, 1 without flip; by the side view of the data sheet."""
    q2, q3 = np.radians(row[1]), np.radians(row[1] + row[2])
    ahead = 230 * np.sin(q2) - 50 * np.cos(q3) + 270 * np.sin(q3)
    above = row[2] > np.degrees(np.arctan2(50, 270))  # upper arm and forearm's line to the wrist
    return f"({4 * int(ahead > 0) + 2 * int(above) + int(row[4] > 0)},0)"


def user_program(robot: Robot, rows: Matrix) -> str:
    """As a person has it: joints and a pose after each other."""
    poses = np.linalg.inv(TABLE) @ flange_arm(robot).fk(rows, "deg") @ TOOL
    moves = [
        f"Mvs P{i}" if i % 4 == 3 else f"{'Mov P' if i % 2 else 'Mov J'}{i} ' go" for i in range(len(rows))
    ]
    moves = [f"Mov JNEAR{i}\r\n{move}" if i % 2 else move for i, move in enumerate(moves)]
    lines = ["' job", f"Tool ({_xyzabc(TOOL)})(0,0)", "Base PTABLE", "Ovrd 30", *moves, "M_Out(8)=1", "End"]
    joints = [
        f"J{'NEAR' if i % 2 else ''}{i}=({','.join(f'{value:+.6f}' for value in row)})"
        for i, row in enumerate(rows)
    ]
    places = [
        f"P{i}=({_xyzabc(poses[i])},+0.00,+0.00){_flags(robot, rows[i])}" for i in range(1, len(rows), 2)
    ]
    return "\r\n".join([*lines, *places, *joints, ""])


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller of the nominal arm commands at each motion to a J or P."""
    result = []
    for i, row in enumerate(rows):
        values = re.search(rf"^{'P' if i % 2 else 'J'}{i}=\((.*?)\)", text, re.MULTILINE)[1]
        if i % 2:
            pose = _pose(values.removesuffix(",+0.00,+0.00"))
            result.append(solved_pose(robot, TABLE @ pose @ np.linalg.inv(TOOL), row))
        else:
            result.append(np.array([float(value) for value in values.split(",")]))
    return np.array(result)
