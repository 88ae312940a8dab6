"""A Doosan controller as far as the tests need it: it runs DRL as the Python that it is, and keeps the log.

Written from the manual of DRL, without the code that is tested.
"""

import warnings
from pathlib import Path

import numpy as np
from program_arm import PendantArm
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

ROBOT, TARGET = "m1013", (600.0, 0.0, 100.0)
KIND, READER, SUFFIX = "drl", "drl", ".drl"
STEP_DEG = 1e-9  # the digits of the positions of a plan's program
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


def solution(row: Matrix) -> int | None:
    """sol of the M1013; None of a righty arm."""
    shoulder, elbow = np.radians([row[1], row[1] + row[2]])
    if 620 * np.sin(shoulder) + 559 * np.sin(elbow) <= 0:
        return None
    return 2 * int(np.sin(np.radians(row[2])) > 0) + int(np.sin(np.radians(row[4])) < 0)
