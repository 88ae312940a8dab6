"""A Techman controller as far as the tests need it: it runs TMscript, and a person edits what he reads.

Written from the manual of TMscript, without the code that is tested.
"""

import re
from pathlib import Path

from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

ROBOT, TARGET = "tm5_900", (450.0, 0.0, 100.0)
KIND, READER, SUFFIX = "tmscript", "tmscript", ".tms"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program
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
