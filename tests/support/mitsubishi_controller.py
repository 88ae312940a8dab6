"""A Mitsubishi controller as far as the tests need it: it runs MELFA-BASIC, and saves what was taught.

Written from the manual of MELFA-BASIC V, without the code that is tested.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

ROBOT, TARGET = "rv2fr", (350.0, 0.0, 100.0)
KIND, READER, SUFFIX = "melfa", "melfa", ".prg"
STEP_DEG = 6e-3  # the digits of the positions of a plan's program


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


def _pose(text: str) -> Matrix:
    x, y, z, *turns = map(float, text.split(","))
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("xyz", turns, degrees=True).as_matrix()
    result[:3, 3] = x, y, z
    return result
