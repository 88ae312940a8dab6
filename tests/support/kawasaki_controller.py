"""A Kawasaki controller as far as the tests need it: it runs AS programs, and saves what they stored.

Written from the manual of AS, without the code that is tested.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, flange_arm, solved_pose

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

ROBOT, TARGET = "rs007n", (500.0, 0.0, 100.0)
KIND, READER, SUFFIX = "as", "as", ".as"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program
DIGITS_MM = 1e-3  # … and of a program of a person


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The file that is saved after the program has run."""
    text = program.read_text()
    joints = {
        name: [float(value) for value in values.split()]
        for name, values in re.findall(r"^(#\w+) ([-\d. ]+)$", text, re.MULTILINE)
    }
    for line in text[: text.index(".END")].splitlines():
        statement = line.split(";")[0].strip()
        if motion := re.fullmatch(r"JMOVE (#\w+)", statement):
            arm.move(joints[motion[1]])
        elif stored := re.fullmatch(r"HERE (#\w+)", statement):
            joints[stored[1]] = arm.joints()
        elif copied := re.fullmatch(r"POINT (#\w+) = (#\w+)", statement):
            joints[copied[1]] = joints[copied[2]]
        elif statement == "PAUSE":
            arm.centre()
        else:
            assert re.fullmatch(
                r"(\.PROGRAM \w+\(\)|SPEED \d+ ALWAYS|ACCURACY \d+ ALWAYS|BREAK|TYPE \".*\")?", statement
            )
    saved = program.with_name(f"saved{SUFFIX}")
    rows = [f"{name}  {' '.join(f'{value:.6f}' for value in row)}" for name, row in joints.items()]
    saved.write_text("\n".join([text[: text.index(".JOINTS")] + ".JOINTS", *rows, ".END", ""]))
    return saved


def _oat(pose: Matrix) -> str:
    with warnings.catch_warnings():  # of two turns about one axis
        warnings.simplefilter("ignore")
        turns = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYZ", degrees=True)
    return " ".join(f"{value:.6f}" for value in [*pose[:3, 3], *turns])


def _pose(text: str) -> Matrix:
    x, y, z, *turns = map(float, text.split())
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("ZYZ", turns, degrees=True).as_matrix()
    result[:3, 3] = x, y, z
    return result


STATED = ProgramOptions(frames=[f"table={_oat(TABLE).replace(' ', ',')}"])


def user_program(robot: Robot, rows: Matrix) -> str:
    """As a person has it: joints and a pose after each other."""
    poses = np.linalg.inv(TABLE) @ flange_arm(robot).fk(rows, "deg") @ TOOL
    moves = [f"  {'LMOVE p' if i % 2 else 'JMOVE #j'}{i} ; go" for i in range(len(rows))]
    return "\r\n".join(
        [
            ".PROGRAM job()",
            f"  TOOL TRANS({_oat(TOOL).replace(' ', ',')})",
            "  BASE table",
            "  SPEED 30 ALWAYS",
            *(f"  JMOVE #near{i}\r\n{move}" if i % 2 else move for i, move in enumerate(moves)),
            "  SIGNAL 3",
            ".END",
            ".TRANS",
            *(f"p{i}  {_oat(poses[i])}" for i in range(1, len(rows), 2)),
            ".END",
            ".JOINTS",
            *(
                f"#{'near' if i % 2 else 'j'}{i}  {' '.join(f'{value:.6f}' for value in row)}"
                for i, row in enumerate(rows)
            ),
            ".END",
            "",
        ]
    )


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller of the nominal arm commands at each motion to a #j or p."""
    result = []
    for i, row in enumerate(rows):
        name = f"p{i}" if i % 2 else f"#j{i}"
        values = re.search(rf"^{name} +(.*?)\r?$", text, re.MULTILINE)[1]
        if i % 2:
            result.append(solved_pose(robot, TABLE @ _pose(values) @ np.linalg.inv(TOOL), row))
        else:
            result.append(np.array([float(value) for value in values.split()]))
    return np.array(result)
