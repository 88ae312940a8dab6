"""The calibration file of a Universal Robots arm as ROS's ur_description reads it, with offsets and links.

`kinematics:` has one transform for each joint, from the joint before it, metres and radians; each joint turns
about the z axis behind its transform, and behind wrist_3 there is nothing more. In the rows of Denavit and
Hartenberg its frames are those behind d, as meshes and collision shapes expect them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.header import UrdfRef
from ...model.files.reading import read_yaml
from ...model.files.robot_file import stated_rows
from ...model.files.run import Run
from ...model.files.urdf import MILLIMETRES
from ...model.kinematics.orientation import angles_of
from ...model.kinematics.robot import Robot, shift
from ..importers.ur_calibration import LINKS, PLACE, flanges_apart, ros_chain
from .ascii_line import one_line
from .calibration import Calibration
from .vendors import require_vendor

_ROUNDING = 1e-7  # rad, and mm over a metre
_SAME_ARM = 0.01  # mm at the flange
_OWN_HASH = "zerobeam_corrected"


def ur_calibration_text(run: Run, calibration: Calibration, against: Path | None) -> str:
    """The text of the file. `against` is the arm's present file: its hash is kept, and the run must have been
    analysed with the arm that it describes.

    BadInput for another vendor's arm, and for a link behind the last joint that the file has no place for.
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
    for name, place in zip(LINKS, _places(run, robot), strict=True):
        x, y, z = (place[:3, 3] / MILLIMETRES).tolist()
        values = (x, y, z, *angles_of(place[:3, :3]))
        lines.append(f"  {name}:")
        lines += [f"    {key}: {value + 0.0!r}" for key, value in zip(PLACE, values, strict=True)]
    return "\n".join([*lines, f"  hash: {one_line(hashed)}", ""])


def _places(run: Run, robot: Robot) -> list[Matrix]:
    """(4, 4) of each joint, its origin moved along its axis to where the file has it."""
    ref = run.header.robot
    along = [0.0] * robot.n
    if not isinstance(ref, UrdfRef):
        along = [joint.d_mm for joint in stated_rows(ref, run.path.parent).joints]
    places: list[Matrix] = []
    before = np.eye(4)
    for joint, length in zip(robot.joints, along, strict=True):
        places.append(np.asarray(before @ joint.fixed @ shift(z=length)))
        before = shift(z=-length)
    rest = before @ robot.flange
    # What is about and along the last axis changes places with the joint.
    if np.abs(rest[:2, 3]).max() > _ROUNDING * MILLIMETRES or np.abs(rest[:2, 2]).max() > _ROUNDING:
        raise BadInput(
            "calibration.yaml has no place for what is behind the last joint",
            found="a link or flange that is not along the axis of joint 6",
            allowed="the geometry of links 1 to 5",
            remedy="exclude it by name (--without link6.alpha …), or zerobeam export urdf",
        )
    places[-1] = np.asarray(places[-1] @ rest)
    return places


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
    found = read_yaml(against).data["kinematics"].get("hash")
    return _OWN_HASH if found is None else str(found)
