"""What a controller takes of an answer, by the robot's vendor: offsets, corrected programs or a model.

The makers' folders have the formats (`Maker.takes`); tests/experiments/makers/test_makers.py holds the two
together.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

Takes = Literal["offsets", "programs", "model"]

_FILES = {
    "abb": ("export rapid", "offsets.mod"),
    "universal-robots": ("export ur", "joint-zero.txt"),
    "kuka": ("export kuka", "mastering.txt"),
    "fanuc": ("export fanuc", "mastering.txt"),
    "epson": ("export epson", "calib.txt"),
    "yaskawa": ("export yaskawa", "home-position.txt"),
}
_MODEL = ("export robot", "corrected.yaml")
# What takes links too: a file for ROS, a URDF, or a robot file with its Denavit-Hartenberg rows (RoboDK).
_LINKS = {"universal-robots": ("export ur-calibration", "calibration.yaml")}
_URDF = ("export urdf", "corrected.urdf")
# Whose programs `zerobeam positions` reads, by the endings of their files.
POSITIONS = {
    "abb": ".mod, .prg, .sys",
    "denso": ".pcs, .pac",
    "doosan": ".drl",
    "epson": ".pts, .prg",
    "fanuc": ".ls, .va",
    "kawasaki": ".as, .pg",
    "kuka": ".src, .dat",
    "mitsubishi": ".prg, .mb5",
    "staubli": ".dtx, .pgx",
    "universal-robots": ".script",
    "yaskawa": ".jbi",
}
_NO_OFFSETS = ("denso", "doosan", "franka", "kawasaki", "mitsubishi", "nachi", "staubli", "techman")


# What public material says of a controller's own zeros; to enter values by it is not worked out here.
_ZEROS = {
    "staubli": "arm.cfx holds its calibration offsets",
    "kawasaki": "its zeroing values are shown and set on the pendant, and ZZERO of a saved file has them",
    "denso": "it has CALSET, with the RANG values of the arm",
}


TCP_OF_NOMINAL_ARM = (
    "TCP error: not claimed, since the controller computes with the arm's factory calibration, and not with"
    " the nominal arm of this run."
)


def no_offsets_words(vendor: str | None) -> str:
    """That there is no file of offsets for a controller, and what exists."""
    zeros = _ZEROS.get(vendor or "")
    exists = "" if zeros is None else f" ({zeros})"
    return f"how this controller takes offsets is not worked out here{exists}"


def lacks_factory_calibration(vendor: str | None, robot: object) -> bool:
    """Whether a run's robot is a built-in one (in the header a name, no path) where the controller computes
    with a factory calibration of the arm: offsets from the nominal arm would apply that a second time."""
    return vendor == "universal-robots" and isinstance(robot, str) and "." not in robot


def taken_by(vendor: str | None) -> Takes:
    """What there is for the controllers of this vendor; offsets where it is not known who made the robot."""
    if vendor not in _NO_OFFSETS:
        return "offsets"
    return "programs" if vendor in POSITIONS else "model"


def export_command(vendor: str | None) -> tuple[str, str]:
    """What writes an answer for a robot of this vendor, and the file's name."""
    return _FILES.get(vendor or "", _MODEL)


def links_command(vendor: str | None, robot: object) -> tuple[str, str]:
    """What writes the links too, by the vendor and what a header says of the robot, and the file's name."""
    return _LINKS.get(vendor or "", _URDF if isinstance(robot, Mapping) else _MODEL)


def export_sentence(vendor: str | None) -> str:
    """What to write for a controller."""
    taken = taken_by(vendor)
    if vendor == "abb":
        return "Export the values: a RAPID module that corrects programs by them."
    if taken == "offsets":
        return "Export the values for this controller; the file says how to enter them."
    programs = ", or convert its programs (zerobeam positions reach)" if taken == "programs" else ""
    return (
        f"Enter nothing: {no_offsets_words(vendor)}. Export the corrected"
        f" robot model for what computes with one (export robot, export urdf){programs}."
    )
