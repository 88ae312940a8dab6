"""A Nachi controller as far as the tests need it: it runs SLIM, and saves positions that were modified.

Written from published programs, without the code that is tested. The arm has the lengths of a built-in one of
another maker: what is tested are the files.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import BUILT_IN
from zerobeam.model.kinematics.robot import Robot

TARGET = (500.0, 0.0, 100.0)
KIND, READER, SUFFIX = "slim", "slim", ".slim"
STEP_DEG = 1e-5  # the digits of the positions of a plan's program
MOVE = r"MOVEX (?:A=\d,)?(?:AC=0,SM=0,)?M1J,[PL],\(([^()]*)\),[RS]=([\d.]+),H=\d+,MS"


def robot_text() -> str:
    text = (BUILT_IN / "rs007n.yaml").read_text().replace("vendor: kawasaki", "vendor: nachi")
    return text.replace("name: rs007n", "name: mine").replace("model: RS007N", "model: mine")


def robot_file(folder: Path) -> str:
    path = folder / "mine.yaml"
    path.write_text(robot_text())
    return str(path)


def carried_out(program: Path, arm: PendantArm) -> Path:
    """The text that is saved after the program has run, and the person has modified at each stop. Remarks
    with ' are those of the text alone."""
    saved: list[str] = []
    for line in program.read_bytes().decode().split("\r\n"):
        if motion := re.fullmatch(MOVE, line):
            assert 1 <= float(motion[2]) <= 100
            arm.move([float(value) for value in motion[1].split(",")])
            saved.append(line)
        elif line == "STOP":
            arm.centre()
            values = ",".join(f"{value:.5f}" for value in arm.joints())
            saved[-1] = re.sub(r"\([^()]*\)", f"({values})", saved[-1])
            saved.append(line)
        elif not line.startswith("'"):
            assert re.fullmatch(r'(REM "[^"]{1,31}"|END)?', line), line
            saved.append(line)
    file = program.with_name("MZ07-01-A.001")
    file.write_bytes("\r\n".join(saved).encode())
    return file


def commanded(text: str, robot: Robot, rows: Matrix) -> Matrix:
    """(N, n) degrees that the controller commands at each motion."""
    moves = re.findall(r"M1J,[PL],\(([^()]*)\)", text)
    return np.array([[float(value) for value in row.split(",")] for row in moves])
