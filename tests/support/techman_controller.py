"""A Techman controller as far as the tests need it: it runs TMscript, and a person edits what he reads.

Written from the manual of TMscript, without the code that is tested.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, flange_arm, solved_pose
from user_programs import frame as by_fixed_axes

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

ROBOT, TARGET = "tm5_900", (450.0, 0.0, 100.0)
KIND, READER, SUFFIX = "tmscript", "tmscript", ".tms"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program
DIGITS_MM = 1e-3  # … and of a program of a person
_DECLARED = r"float\[\] (\w+) = \{(.*?)\}"
_NO_MOTION = r"(define|main|\{|\}|QueueTag\(\d+\)|WaitQueueTag\(\d+\)|//.*)?"


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The program in which a person has written the joints of each pause."""
    text = program.read_text()
    joints = {name: [float(value) for value in row.split(",")] for name, row in re.findall(_DECLARED, text)}
    last = ""
    for line in text.splitlines():
        if motion := re.fullmatch(r'PTP\("JPP",(\w+),(\d+),(\d+),0,false\)', line):
            last = motion[1]
            assert 1 <= int(motion[2]) <= 100
            arm.move(joints[last])
        elif line == "Pause()":
            arm.centre()
            row = ",".join(f"{value:.6f}" for value in arm.joints())
            text = re.sub(rf"(float\[\] {last} = \{{).*?\}}", rf"\g<1>{row}}}", text)
        else:
            assert re.fullmatch(_DECLARED, line) or re.fullmatch(_NO_MOTION, line)
    saved = program.with_name(f"edited{SUFFIX}")
    saved.write_text(text)
    return saved


def numbers(pose: Matrix) -> str:
    """X, Y, Z, RX, RY, RZ."""
    turns = Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)
    return ",".join(f"{value:.6f}" for value in [*pose[:3, 3], *turns])


STATED = ProgramOptions(frames=[f"Table={numbers(TABLE)}"])


def user_program(robot: Robot, rows: Matrix) -> str:
    """As a person has it: joints and a pose in a straight line after each other."""
    poses = np.linalg.inv(TABLE) @ flange_arm(robot).fk(rows, "deg") @ TOOL
    joints = [",".join(f"{value:.6f}" for value in row) for row in rows]
    lines = ["define", "{", "int count = 0"]
    lines += [f"float[] j{i} = {{{joints[i]}}}" for i in range(0, len(rows), 2)]
    lines += [f"float[] p{i} = {{{numbers(poses[i])}}}" for i in range(1, len(rows), 2)]
    lines += ["}", "main", "{", f"ChangeTCP({numbers(TOOL)})", 'ChangeBase("Table")']
    for i in range(len(rows)):
        if i % 2:
            lines += [f'PTP("JPP",{joints[i]},35,200,0,false)', f'Line("CAP",p{i},100,200,0,false) // go']
        else:
            lines += [f'PTP("JPP",j{i},35,200,0,false)', "Sleep(100)"]
    return "\r\n".join([*lines, 'IO["ControlBox"].DO[0] = 1', "}", ""])


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller of the nominal arm commands at each motion to a j or p."""
    values = {name: [float(value) for value in row.split(",")] for name, row in re.findall(_DECLARED, text)}
    result = []
    for name in re.findall(r'(?:PTP|Line)\("(?:JPP|CAP)",([jp]\d+),', text):
        row = rows[int(name[1:])]
        if name[0] == "j":
            result.append(np.array(values[name]))
        else:
            pose = by_fixed_axes(*values[name])
            result.append(solved_pose(robot, TABLE @ pose @ np.linalg.inv(TOOL), row))
    return np.array(result)
