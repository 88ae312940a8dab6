"""The factory calibration of a Universal Robots arm, as a robot file of that arm.

Two public forms are read:

- `calibration.conf`, as the controller keeps it: `delta_theta`, `delta_a`, `delta_d`, `delta_alpha`, six
  numbers each, radians and metres, to be added to the nominal Denavit-Hartenberg rows. Axes 2 to 4 are nearly
  parallel, so that `delta_d` may be many metres; such rows are exact and useless to a person.
- the YAML of the ROS package `ur_calibration`: origin and roll, pitch, yaw of each joint, metres and radians.

Both are chains of axes, and are written as rows near the nominal ones, with `beta_deg` where axes are nearly
parallel.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.reading import did_you_mean, read_text, read_yaml
from ...model.files.robot_file import RobotFile, built_in_robots, load_robot, stated_rows
from ...model.files.urdf import MILLIMETRES
from ...model.kinematics.orientation import roll_pitch_yaw
from ...model.kinematics.robot import DHRow, Robot, dh_chain, shift

DELTAS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
PLACE = ("x", "y", "z", "roll", "pitch", "yaw")
_POSTURES = 400
_LARGEST = 1e6  # m, rad: `delta_d` of nearly parallel axes may be kilometres
_FARTHEST = 50.0  # mm at the flange: a calibrated arm is nearer to its nominal geometry


@dataclass(frozen=True, eq=False)
class CalibratedArm:
    """`stated` is the nominal robot file, `robot` the calibrated arm; `apart_mm` are the root mean square and
    the largest distance between both flanges, over random postures."""

    stated: RobotFile
    robot: Robot
    apart_mm: tuple[float, float]


def read_ur_calibration(path: Path, name: str) -> CalibratedArm:
    """The arm `name` (a built-in UR) with the calibration of the file; BadInput if it is of no such arm."""
    known = [each for each in built_in_robots() if load_robot(each).vendor == "universal-robots"]
    if name not in known:
        raise BadInput(
            "the calibration is of another vendor's robot, or there is no such robot",
            found=name,
            allowed=", ".join(known),
            remedy=did_you_mean(name, known),
        )
    stated, nominal = stated_rows(name, Path()), load_robot(name)
    text, _ = read_text(path)
    chain = _deltas(text, path, stated) if "delta_" in text else _transforms(path)
    robot = _along_axes(_as_chain(nominal, *chain), nominal)
    rms, most = flanges_apart(robot, nominal)
    if most > _FARTHEST:
        raise BadInput(
            f"this is not the calibration of a {stated.model}",
            found=f"its flange would be up to {most:.0f} mm from that of the nominal arm",
            allowed=f"up to {_FARTHEST:.0f} mm",
            remedy=f"state the right --robot: {', '.join(known)}",
            file=path,
        )
    return CalibratedArm(stated, robot, (rms, most))


def flanges_apart(one: Robot, other: Robot) -> tuple[float, float]:
    """mm between the flanges of two arms in the same joints, over random ones: root mean square and
    largest."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, one.n))
    apart = np.linalg.norm((one.fk(joints, "rad") - other.fk(joints, "rad"))[:, :3, 3], axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def ros_chain(nominal: Robot, path: Path) -> Robot:
    """`nominal` with the transforms of a YAML of ROS's ur_calibration; BadInput where it is none."""
    return _as_chain(nominal, *_transforms(path))


def _deltas(text: str, path: Path, stated: RobotFile) -> tuple[list[Matrix], Matrix]:
    found: dict[str, list[float]] = {}
    for key in DELTAS:
        match = re.search(rf"^[ \t]*{key}\s*=\s*\[([^\]]*)\]", text, re.MULTILINE)
        try:
            values = [] if match is None else [float(part) for part in match[1].split(",")]
        except ValueError:
            values = []
        if len(values) != len(stated.joints) or not all(abs(value) <= _LARGEST for value in values):
            raise BadInput(
                f"the calibration has no {key}" if match is None else f"{key} cannot be used",
                found=None if match is None else match[1].strip(),
                allowed=f"{key} = [six numbers], as in the controller's calibration.conf",
                file=path,
            )
        found[key] = values
    rows = [
        DHRow(
            row.a + found["delta_a"][i] * MILLIMETRES,
            row.alpha + found["delta_alpha"][i],
            row.d + found["delta_d"][i] * MILLIMETRES,
            row.theta + found["delta_theta"][i],
        )
        for i, row in enumerate(joint.row for joint in stated.joints)
    ]
    return dh_chain(rows, stated.convention)


def _transforms(path: Path) -> tuple[list[Matrix], Matrix]:
    document = read_yaml(path)
    links: Any = document.data.get("kinematics")
    if not isinstance(links, Mapping):
        raise BadInput(
            "this is no calibration of a UR",
            allowed="calibration.conf of the controller (delta_theta, delta_a, …), or the YAML of ROS's"
            " ur_calibration (kinematics: shoulder: …)",
            file=path,
        )
    chain = []
    for name in LINKS:
        stated = links.get(name)
        values: list[Any] = [None]
        if isinstance(stated, Mapping):
            values = [stated.get(key) for key in PLACE]
        if not all(isinstance(value, int | float) and abs(value) <= _LARGEST for value in values):
            raise BadInput(
                f"the calibration has no {name}, or it is incomplete",
                allowed=f"{name}: {{{', '.join(PLACE)}}}, metres and radians",
                file=path,
                line=document.line(("kinematics",)),
            )
        x, y, z, *turns = values
        place = shift(x * MILLIMETRES, y * MILLIMETRES, z * MILLIMETRES)
        chain.append(place @ roll_pitch_yaw(*turns))
    return chain, np.eye(4)


def _as_chain(nominal: Robot, fixed: list[Matrix], flange: Matrix) -> Robot:
    joints = tuple(replace(own, fixed=each) for own, each in zip(nominal.joints, fixed, strict=True))
    return replace(nominal, joints=joints, flange=flange)


def _along_axes(robot: Robot, nominal: Robot) -> Robot:
    """The same arm, its joints' origins moved along their axes to where they are nearest to the nominal."""
    here, there, before = np.eye(4), np.eye(4), np.eye(4)
    fixed = []
    for own, theirs in zip(robot.joints, nominal.joints, strict=True):
        here, there = here @ own.fixed, there @ theirs.fixed
        along = float(here[:3, 2] @ (there[:3, 3] - here[:3, 3]))
        moved = here @ shift(z=along)
        fixed.append(np.asarray(np.linalg.inv(before) @ moved))
        before = moved
    flange = np.asarray(np.linalg.inv(before) @ here @ robot.flange)
    return _as_chain(robot, fixed, flange)
