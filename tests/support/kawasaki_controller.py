"""A Kawasaki controller as far as the tests need it: it runs AS programs, and saves what they stored.

Written from the manual of AS, without the code that is tested.
"""

import re
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

ROBOT, TARGET = "rs007n", (500.0, 0.0, 100.0)
KIND, READER, SUFFIX = "as", "as", ".as"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program


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


def _pose(text: str) -> Matrix:
    x, y, z, *turns = map(float, text.split())
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("ZYZ", turns, degrees=True).as_matrix()
    result[:3, 3] = x, y, z
    return result
