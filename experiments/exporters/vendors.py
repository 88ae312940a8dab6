"""Who makes a robot, by its file or its name: programs and offsets are for controllers of one vendor."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ...model.errors import BadInput
from ...model.files.robot_file import Vendor
from ...model.kinematics.robot import Robot

NAMES: Mapping[Vendor, str] = {
    "abb": "ABB",
    "fanuc": "FANUC",
    "kuka": "KUKA",
    "universal-robots": "Universal Robots",
}
# Of a robot whose file does not state it: the name in small letters, words apart by one blank.
_WORDS: Mapping[Vendor, str] = {
    "abb": r"abb|irb ?\d*\w*|yumi|gofa|swifti",
    "fanuc": r"fanuc|lr ?mate\w*|crx\w*|arcmate|m ?\d+i[a-d]?\w*|r ?\d+i[a-d]?\w*",
    "kuka": r"kuka|kr ?\d+\w*|lbr|iiwa ?\d*",
    "universal-robots": r"ur ?\d+ ?e?|universal robots?",
    "other": r"panda|franka|fr3|kinova|gen ?[23]|jaco|motoman|yaskawa|gp ?\d+\w*|staubli|tx2?|tx2? ?\d+\w*"
    r"|x ?arm ?\d*|ufactory|denso|epson|doosan|techman|kawasaki|nachi|comau|mitsubishi|meca ?500",
}


def vendor_of(robot: Robot) -> str | None:
    """The vendor that the robot's file states, else by its name; None where neither says one."""
    if robot.vendor is not None:
        return robot.vendor
    name = " ".join(re.findall(r"[a-z0-9]+", robot.name.lower()))
    found = [vendor for vendor, words in _WORDS.items() if re.search(rf"(?:^| )(?:{words})(?: |$)", name)]
    return found[0] if len(found) == 1 else None


def require_vendor(robot: Robot, vendor: Vendor, what: str) -> str | None:
    """BadInput where `robot` is known to be of another vendor than `what` is for; where its vendor is not
    known, a sentence that says what to check."""
    own, name = vendor_of(robot), NAMES[vendor]
    if own == vendor:
        return None
    if own is None:
        return f"{what} is for robots of {name}; nothing says who made {robot.name!r}: check that"
    raise BadInput(
        f"{what} is for robots of {name}",
        found=f"{robot.name}, of {'another vendor' if own == 'other' else own}",
        allowed=f"a robot of {name}",
        remedy="choose the format of this robot's controller; csv is for every robot",
    )
