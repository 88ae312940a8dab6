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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, located
from ....model.files.header import UrdfRef
from ....model.files.robot_file import RobotFile, built_in_robots, load_robot, robot_path, stated_rows
from ....model.files.run import Run
from ....model.files.urdf import MILLIMETRES
from ....model.kinematics.dh import DHRow, dh_chain, with_fixed
from ....model.kinematics.orientation import angles_of
from ....model.kinematics.robot import Robot, euler, shift
from ....model.parsing.reading import did_you_mean, read_bytes, read_text, read_yaml
from ..calibration import RobotCalibration
from ..maker import one_line, require_vendor

DELTAS = ("delta_theta", "delta_a", "delta_d", "delta_alpha")
LINKS = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
POSE_KEYS = ("x", "y", "z", "roll", "pitch", "yaw")
_POSTURES = 400
_FACTORY = "with the factory calibration of"  # in the head of a robot file of an individual arm
_LARGEST = 1e6  # m, rad: `delta_d` of nearly parallel axes may be kilometres
_FARTHEST = 50.0  # mm at the flange: a calibrated arm is nearer to its nominal geometry


@dataclass(frozen=True, eq=False)
class CalibratedArm:
    """`nominal_file` is that of the nominal robot, `robot` the calibrated arm; `apart_mm` are the root mean
    square and the largest distance between both flanges, over random postures."""

    nominal_file: RobotFile
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
    file, nominal = stated_rows(name, Path()), load_robot(name)
    text, _ = read_text(path)
    with located(path):
        chain = _deltas(text, file) if "delta_" in text else _transforms(path)
        robot = _along_axes(with_fixed(nominal, chain), nominal)
        rms, most = flanges_apart(robot, nominal)
        if most > _FARTHEST:
            raise BadInput(
                f"this is not the calibration of a {file.model}",
                found=f"its flange would be up to {most:.0f} mm from that of the nominal arm",
                allowed=f"up to {_FARTHEST:.0f} mm",
                remedy=f"state the right --robot: {', '.join(known)}",
            )
    return CalibratedArm(file, robot, (rms, most))


def require_factory_arm(ref: str | UrdfRef, folder: Path) -> None:
    """BadInput unless a robot, as named from the folder, is a file of `import ur-calibration`: a UR's
    controller computes with its factory calibration, which offsets from the nominal arm would apply a second
    time."""
    path = robot_path(ref, folder)
    if path is not None and path.is_file() and _FACTORY.encode() in read_bytes(path):
        return
    name = ref.urdf if isinstance(ref, UrdfRef) else ref
    model = name if name in built_in_robots() else "MODEL"
    raise BadInput(
        "a UR's controller computes with the factory calibration of its arm, and this is another arm: what"
        " the factory has corrected would be left out, or corrected twice",
        found=f"robot: {name}",
        allowed="the robot file that zerobeam import ur-calibration makes, for a run too",
        remedy=f"zerobeam import ur-calibration calibration.conf --robot {model} -o arm.yaml"
        f" (calibration.conf of the controller; {model}: the arm's model); name arm.yaml as robot, or in a"
        " copy of the run",
    )


def flanges_apart(one: Robot, other: Robot) -> tuple[float, float]:
    """mm between the flanges of two arms in the same joints, over random ones: root mean square and
    largest."""
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (_POSTURES, one.n))
    apart = np.linalg.norm((one.fk(joints, "rad") - other.fk(joints, "rad"))[:, :3, 3], axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def ros_chain(nominal: Robot, path: Path) -> Robot:
    """`nominal` with the transforms of a YAML of ROS's ur_calibration; BadInput where it is none."""
    return with_fixed(nominal, _transforms(path))


def _deltas(text: str, file: RobotFile) -> list[Matrix]:
    deltas: dict[str, list[float]] = {}
    for key in DELTAS:
        match = re.search(rf"^[ \t]*{key}\s*=\s*\[([^\]]*)\]", text, re.MULTILINE)
        try:
            values = [] if match is None else [float(part) for part in match[1].split(",")]
        except ValueError:
            values = []
        if len(values) != len(file.joints) or not all(abs(value) <= _LARGEST for value in values):
            raise BadInput(
                f"the calibration has no {key}" if match is None else f"{key} cannot be used",
                found=None if match is None else match[1].strip(),
                allowed=f"{key} = [six numbers], as in the controller's calibration.conf",
            )
        deltas[key] = values
    rows = [
        DHRow(
            row.a + deltas["delta_a"][i] * MILLIMETRES,
            row.alpha + deltas["delta_alpha"][i],
            row.d + deltas["delta_d"][i] * MILLIMETRES,
            row.theta + deltas["delta_theta"][i],
        )
        for i, row in enumerate(joint.row for joint in file.joints)
    ]
    fixed, flange = dh_chain(rows, file.convention)
    return [*fixed, flange]


def _transforms(path: Path) -> list[Matrix]:
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
        link = links.get(name)
        values: list[Any] = [None]
        if isinstance(link, Mapping):
            values = [link.get(key) for key in POSE_KEYS]
        if not all(isinstance(value, int | float) and abs(value) <= _LARGEST for value in values):
            raise BadInput(
                f"the calibration has no {name}, or it is incomplete",
                allowed=f"{name}: {{{', '.join(POSE_KEYS)}}}, metres and radians",
                file=path,
                line=document.line(("kinematics",)),
            )
        x, y, z, *turns = values
        origin = shift(x * MILLIMETRES, y * MILLIMETRES, z * MILLIMETRES)
        chain.append(origin @ euler("xyz", turns))
    return [*chain, np.eye(4)]


def _along_axes(robot: Robot, nominal: Robot) -> Robot:
    """The same arm, its joints' origins moved along their axes to where they are nearest to the nominal."""
    here, there, before = np.eye(4), np.eye(4), np.eye(4)
    fixed = []
    for joint, theirs in zip(robot.joints, nominal.joints, strict=True):
        here, there = here @ joint.fixed, there @ theirs.fixed
        along = float(here[:3, 2] @ (there[:3, 3] - here[:3, 3]))
        moved = here @ shift(z=along)
        fixed.append(np.asarray(np.linalg.inv(before) @ moved))
        before = moved
    flange = np.asarray(np.linalg.inv(before) @ here @ robot.flange)
    return with_fixed(robot, [*fixed, flange])


_ROUNDING = 1e-7  # rad, and mm over a metre
_SAME_ARM = 0.01  # mm at the flange
_OWN_HASH = "zerobeam_corrected"


def ur_calibration_text(run: Run, calibration: RobotCalibration, against: Path | None) -> str:
    """The text of the file. `against` is the arm's present file: its hash is kept, and the run must have been
    analysed with the arm that it describes.

    BadInput for another vendor's arm, and for a flange that is not along the last axis.
    """
    robot = calibration.corrected
    require_vendor(run.robot, "universal-robots", "calibration.yaml")
    if robot.n != len(LINKS) or any(not np.allclose(joint.axis, (0, 0, 1)) for joint in robot.joints):
        raise BadInput(
            "calibration.yaml is for arms of six joints that turn about their z axes",
            found=f"{robot.name}, {robot.n} joints",
            allowed="a built-in UR, or a robot file of one",
        )
    hashed = _OWN_HASH if against is None else _hash(run, against)
    lines = [f"# {line}" for line in calibration.head]
    lines += [
        "# For ROS: kinematics_params_file:=THIS_FILE of ur_robot_driver. The robot's own controller does",
        "# not read it, and keeps its calibration.",
        "kinematics:",
    ]
    for name, transform in zip(LINKS, _joint_transforms(run, calibration), strict=True):
        x, y, z = (transform[:3, 3] / MILLIMETRES).tolist()
        values = (x, y, z, *angles_of(transform[:3, :3]))
        lines.append(f"  {name}:")
        lines += [f"    {key}: {value + 0.0!r}" for key, value in zip(POSE_KEYS, values, strict=True)]
    return "\n".join([*lines, f"  hash: {one_line(hashed)}", ""])


def _joint_transforms(run: Run, calibration: RobotCalibration) -> list[Matrix]:
    """(4, 4) of each joint, its origin moved along its axis to where the file has it."""
    ref, robot = run.header.robot, calibration.corrected
    along = [0.0] * robot.n
    if not isinstance(ref, UrdfRef):
        along = [joint.d_mm for joint in stated_rows(ref, run.path.parent).joints]
    transforms: list[Matrix] = []
    before = np.eye(4)
    for joint, length in zip(robot.joints, along, strict=True):
        transforms.append(np.asarray(before @ joint.fixed @ shift(z=length)))
        before = shift(z=-length)
    rest = before @ robot.flange
    # What is about and along the last axis changes places with the joint.
    if np.abs(rest[:2, 3]).max() > _ROUNDING * MILLIMETRES or np.abs(rest[:2, 2]).max() > _ROUNDING:
        raise BadInput(
            "calibration.yaml has no place for what is behind the last joint",
            found="a link or flange that is not along the axis of joint 6",
            remedy="zerobeam export urdf",
        )
    transforms[-1] = np.asarray(transforms[-1] @ rest)
    return transforms


def _hash(run: Run, against: Path) -> str:
    _, most = flanges_apart(ros_chain(run.robot, against), run.robot)
    if most > _SAME_ARM:
        raise BadInput(
            "the run was analysed with another arm than the one that this calibration describes",
            found=f"flanges up to {most:.3f} mm apart",
            allowed=f"up to {_SAME_ARM} mm",
            remedy="zerobeam import ur-calibration makes a robot file of it: name that as robot of the run",
            file=against,
        )
    present = read_yaml(against).data["kinematics"].get("hash")
    return _OWN_HASH if present is None else str(present)


def calibrated_text(arm: CalibratedArm, source: Path) -> str:
    """The robot file of a calibrated arm: rows near the nominal ones, exact for its chain."""
    rms, most = arm.apart_mm
    head = [
        f"{arm.nominal_file.model} {_FACTORY} {source.name}.",
        f"Its flange is {rms:.2f} mm (rms, up to {most:.2f} mm) from that of the nominal arm.",
    ]
    return arm.nominal_file.of_robot(arm.robot).text([one_line(line) for line in head])
