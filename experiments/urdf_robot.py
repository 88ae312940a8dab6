"""A robot file of the chain of a URDF: rows of the same arm, to be held against the pendant and edited."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.robot_file import RobotFile
from ..model.files.urdf import links_of, read_urdf
from ..model.kinematics.orientation import angles_of
from ..model.kinematics.robot import DHRow, Joint, Robot
from ..model.parsing.reading import did_you_mean, shown
from ..model.parsing.validation import validate
from .makers.generic.robot_rows import corrected_table
from .makers.maker import one_line
from .new_robot import answer_to, typed_number

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


def asked_chain(
    path: Path, base: str | None, tip: str | None, below: float, ask: Callable[[str], str]
) -> UrdfChain:
    """The chain in a URDF file of a person who states not all of it (None, 0): the rest is asked for."""
    links = links_of(path)

    def typed_base(text: str) -> str:
        if text not in links:
            remedy = did_you_mean(text, links)
            raise BadInput(
                "the link is not in the file", found=shown(text), allowed=", ".join(links), remedy=remedy
            )
        return text

    def typed_tip(text: str) -> str:
        read_urdf(path, first, text)
        return text

    first = base or answer_to(ask, f"First link of the chain ({', '.join(links)})", typed_base)
    last = tip or answer_to(ask, f"Its last link, the flange ({', '.join(links)})", typed_tip)
    if not below:
        question = f"How far the mounting face is below {first}, mm"
        below = answer_to(ask, question, lambda text: typed_number(text, "number"))
    return UrdfChain(path, first, last, below)


def content_of_chain(name: str, vendor: str, chain: UrdfChain) -> dict[str, object]:
    """The content of a robot file with the kinematics, limits and speeds of the chain.

    Of an arm whose pendant counts joint 3 from the ground, the URDF has the angle between links 2 and 3; the
    pendant's range is then all that the ranges of joints 2 and 3 leave.
    """
    arm = _about_z(read_urdf(chain.path, chain.base, chain.tip))
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
    table = corrected_table(validate(RobotFile, content, file=chain.path, line=lambda _: None), arm)
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


def _about_z(robot: Robot) -> Robot:
    """The same arm with each joint in a frame whose z axis is the joint's."""
    joints, back = [], np.eye(4)
    for joint in robot.joints:
        turn = _to_axis(joint.axis)
        joints.append(replace(joint, fixed=back @ joint.fixed @ turn, axis=np.array([0.0, 0.0, 1.0])))
        back = turn.T
    return replace(robot, joints=tuple(joints), flange=back @ robot.flange)


def _to_axis(axis: Matrix) -> Matrix:
    """(4, 4) of a frame whose z axis is the unit vector `axis` (3,)."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = other - axis * float(axis @ other)
    x /= np.linalg.norm(x)
    frame = np.eye(4)
    frame[:3, :3] = np.column_stack((x, np.cross(axis, x), axis))
    return frame


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
