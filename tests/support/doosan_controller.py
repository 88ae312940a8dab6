"""A Doosan controller as far as the tests need it: it runs DRL as the Python that it is, and keeps the log.

Written from the manual of DRL, without the code that is tested.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, flange_arm, solved_pose

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

ROBOT, TARGET = "m1013", (600.0, 0.0, 100.0)
KIND, READER, SUFFIX = "drl", "drl", ".drl"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program
DIGITS_MM = 1e-3  # … and of a program of a person
FRAME = 101


class _Positions(list[float]):
    """posj or posx: numbers, or a list of them."""

    def __init__(self, *values: object) -> None:
        (first, *_) = values
        super().__init__(first if isinstance(first, list) else values)


class Joints(_Positions):
    """posj."""


class Pose(_Positions):
    """posx."""


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The log of the pendant after the program has run."""
    log: list[str] = []

    def logged(message: str) -> None:
        assert len(message) <= 256
        log.append(f"2026-11-26 10:00:00  {message}")

    names = {
        "posj": Joints,
        "movej": arm.move,
        "set_velj": lambda speed: None,
        "set_accj": lambda acceleration: None,
        "tp_popup": lambda message: None,
        "wait_manual_guide": arm.centre,
        "wait": lambda seconds: None,
        "get_current_posj": lambda: Joints(arm.joints()),
        "tp_log": logged,
    }
    exec(compile(program.read_text(), program.name, "exec"), names)
    saved = program.with_name("pendant.log")
    saved.write_text("\n".join([*log, ""]))
    return saved


def numbers(pose: Matrix) -> str:
    """x, y, z, A, B, C."""
    with warnings.catch_warnings():  # of two turns about one axis
        warnings.simplefilter("ignore")
        turns = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYZ", degrees=True)
    return ", ".join(f"{value:.6f}" for value in [*pose[:3, 3], *turns])


STATED = ProgramOptions(tools=[f"grip={numbers(TOOL)}"], frames=[f"{FRAME}={numbers(TABLE)}"])


def solution(row: Matrix) -> int | None:
    """sol of the M1013; None of a righty arm."""
    shoulder, elbow = np.radians([row[1], row[1] + row[2]])
    if 620 * np.sin(shoulder) + 559 * np.sin(elbow) <= 0:
        return None
    return 2 * int(np.sin(np.radians(row[2])) > 0) + int(np.sin(np.radians(row[4])) < 0)


def user_program(robot: Robot, rows: Matrix) -> str:
    """As a person has it: joints, poses by joints and poses in a straight line after each other."""
    poses = np.linalg.inv(TABLE) @ flange_arm(robot).fk(rows, "deg") @ TOOL
    lines = ["# job", 'set_tcp("grip")', "set_velj(30)", "set_velx(100, 50)", "def start():"]
    lines += ["    set_digital_output(1, ON)", "    wait(0.5)", "start()"]
    for i, row in enumerate(rows):
        joints = ", ".join(f"{value:.6f}" for value in row)
        if i % 2 == 0:
            lines += [f"j{i} = posj({joints})", f"movej(j{i}, vel=30, acc=60)  # go"]
        elif i % 4 == 1 and solution(row) is not None:
            lines += [f"p{i} = posx({numbers(poses[i])})"]
            lines += [f"movejx(p{i}, v=30, a=60, ref={FRAME}, sol={solution(row)})"]
        else:
            lines += [f"movej([{joints}])", f"set_ref_coord({FRAME})"]
            lines += [f"p{i} = posx([{numbers(poses[i])}])", f"movel(p{i}, [100, 50], [200, 100])"]
            lines += ["set_ref_coord(DR_BASE)"]
    lines += ["if get_digital_input(2) == ON:", "    tp_popup('done')"]
    return "\r\n".join([*lines, ""])


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller of the nominal arm commands at each motion to a j or p."""
    result: list[Matrix] = []
    values: dict[str, list[float]] = {}

    def reached(position: list[float], *_: object, **options: object) -> None:
        named = [name for name, value in values.items() if value is position and name[0] in "jp"]
        if not named:
            return
        row = rows[int(named[0][1:])]
        if isinstance(position, Joints):
            result.append(np.array(position))
            return
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_euler("ZYZ", position[3:], degrees=True).as_matrix()
        pose[:3, 3] = position[:3]
        solved = solved_pose(robot, TABLE @ pose @ np.linalg.inv(TOOL), row)
        assert options.get("sol") in (None, solution(solved))
        result.append(solved)

    nothing = {
        name: lambda *_: None
        for name in ("set_tcp", "set_velj", "set_velx", "set_digital_output", "wait", "set_ref_coord")
    }
    nothing["tp_popup"] = lambda *_: None
    values.update(nothing, posj=Joints, posx=Pose, movej=reached, movejx=reached, movel=reached)
    values.update(get_digital_input=lambda _: 0, ON=1, DR_BASE=0)
    exec(compile(text, "job.drl", "exec"), values)
    return np.array(result)
