"""The plan of a controller that is started without one: the paper's arm, its Y-Pattern, one PSD before it."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from ...model.files.header import Header
from ...model.files.plan import Plan
from ...model.files.robot_file import load_robot
from ..plans.patterns import pattern

_TARGET_MM = (900.0, 0.0, 0.0)
_HEADER = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": list(_TARGET_MM)}},
}


def own_plan() -> Plan:
    """A plan that stands in no file."""
    header, robot = Header.model_validate(_HEADER), load_robot("irb1600", Path())
    postures = pattern(header, robot, np.array(_TARGET_MM), "y")
    count = len(postures)
    digest = hashlib.sha256(header.model_dump_json().encode()).hexdigest()
    lines = tuple(range(1, count + 1))
    return Plan(header, robot, postures, ("psd",) * count, lines, Path("own plan"), digest, ())
