"""A robot file of the chain of a URDF: rows of the same arm, to be held against the pendant and edited."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.robot_file import RobotFile
from ..model.files.urdf import links_of, read_urdf
from ..model.kinematics.dh import DHRow, along_z
from ..model.kinematics.orientation import angles_of
from ..model.kinematics.robot import Joint, Robot
from ..model.parsing.reading import shown
from ..model.parsing.validation import validate
from .makers.maker import one_line

_DIGITS = 7  # of mm and degrees: 1.570796327 rad are 90 degrees, and poses stay the same to 0.00001 mm


@dataclass(frozen=True)
class UrdfChain:
    """The links of an arm in a URDF file, and how far its mounting face is below the first of them, mm."""

    path: Path
    base: str
    tip: str
    below_base: float = 0.0

    @property
    def head(self) -> str:
        """Lines of comment for the robot file."""
        lines = (
            f"The chain {self.base} to {self.tip} of {self.path.name} in rows. Zeros, signs, base and flange",
            "are those of the URDF: hold them against the pendant (zerobeam robot, --joints and --pose).",
        )
        return "".join(f"# {one_line(line)}\n" for line in lines)


def stated_chain(path: Path, base: str | None, tip: str | None, below_base: float) -> UrdfChain:
    """The chain of a URDF file between two links; BadInput where one is not stated."""
    if base is None or tip is None:
        raise BadInput(
            "a URDF's chain has two ends",
            found=shown(base or tip) if base or tip else "none",
            allowed=", ".join(links_of(path)),
            remedy="state --base, the first link, and --tip, the flange",
        )
    return UrdfChain(path, base, tip, below_base)


def content_of_chain(name: str, vendor: str, chain: UrdfChain) -> dict[str, object]:
    """The content of a robot file with the kinematics, limits and speeds of the chain.

    Of an arm whose pendant counts joint 3 from the ground, the URDF has the angle between links 2 and 3; the
    pendant's range is then all that the ranges of joints 2 and 3 leave.
    """
    arm = along_z(read_urdf(chain.path, chain.base, chain.tip))
    first = arm.joints[0].fixed
    upright = np.allclose(first[:3, 2], (0, 0, 1), rtol=0, atol=1e-9)
    above = np.allclose(first[:2, 3], 0, rtol=0, atol=1e-7)
    content: dict[str, object] = {
        "schema": "zerobeam/robot/1",
        "name": name,
        "vendor": vendor,
        "convention": "standard",
        "joints": _named(arm, [_numbers(joint, DHRow(0.0, 0.0, 0.0, 0.0)) for joint in arm.joints]),
        **({} if upright and above else {"base": _transform(first)}),
    }
    table = validate(RobotFile, content, file=chain.path, line=lambda _: None).table_of(arm)
    rows = [_numbers(joint, row) for joint, row in zip(arm.joints, table.rows, strict=True)]
    if not np.allclose(table.flange, np.eye(4), rtol=0, atol=1e-7):
        content["flange"] = _transform(table.flange)
    content["mounting"] = {"below_base_mm": chain.below_base}
    if vendor == "fanuc" and len(rows) > 2 and all(joint.kind == "revolute" for joint in arm.joints[1:3]):
        between = [rows[2]["lower_deg"], rows[2]["upper_deg"]]
        second = [rows[1]["lower_deg"], rows[1]["upper_deg"]]
        rows[2] |= {
            "lower_deg": _rounded(between[0] - second[1]),
            "upper_deg": _rounded(between[1] - second[0]),
        }
        content |= {"pendant": {"joint3": "ground"}, "limits": {"joint3_to_link2_deg": between}}
    content["joints"] = _named(arm, rows)
    validate(RobotFile, content, file=chain.path, line=lambda _: None)
    return content


def _named(arm: Robot, rows: Sequence[Mapping[str, float]]) -> list[dict[str, object]]:
    return [
        {"name": joint.name, "kind": joint.kind, **row} for joint, row in zip(arm.joints, rows, strict=True)
    ]


def _numbers(joint: Joint, row: DHRow) -> dict[str, float]:
    alpha, theta, beta = np.degrees([row.alpha, row.theta, row.beta])
    numbers = {"a_mm": row.a, "alpha_deg": alpha, "d_mm": row.d, "theta_deg": theta, "beta_deg": beta}
    unit = joint.unit
    numbers |= {f"lower_{unit}": joint.lower * joint.display, f"upper_{unit}": joint.upper * joint.display}
    if joint.speed is not None:
        numbers[f"speed_{unit}_s"] = joint.speed * joint.display
    rounded = {key: _rounded(value) for key, value in numbers.items()}
    if not rounded["beta_deg"]:
        del rounded["beta_deg"]
    return rounded


def _transform(matrix: Matrix) -> dict[str, list[float]]:
    angles = np.degrees(angles_of(matrix[:3, :3]))
    return {
        "xyz_mm": [_rounded(value) for value in matrix[:3, 3]],
        "rpy_deg": [_rounded(value) for value in angles],
    }


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0  # no -0.0
