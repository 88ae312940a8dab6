"""A robot file of a person's arm: from Denavit-Hartenberg rows, from the lengths of a data sheet, or from a
URDF."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import get_args
from unicodedata import normalize

import numpy as np

from ..model.errors import BadInput
from ..model.files.robot_file import (
    RobotFile,
    StatedTransform,
    Vendor,
    built_in_robots,
    read_rows,
    stated_rows,
)
from ..model.files.urdf import links_of, read_urdf
from ..model.files.whole_file import refuse_existing, write_whole
from ..model.kinematics.dh import along_z
from ..model.kinematics.robot import Joint
from ..model.parsing.confinement import BUILT_IN
from ..model.parsing.reading import did_you_mean, shown
from ..model.parsing.validation import validate
from .command_options import NewRobotOptions
from .makers.fanuc.backup import read_fanuc_backup
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


def file_of_chain(name: str, vendor: str, chain: UrdfChain) -> RobotFile:
    """The robot file with the kinematics, limits and speeds of the chain.

    Of an arm whose pendant counts joint 3 from the ground, the URDF has the angle between links 2 and 3; the
    pendant's range is then all that the ranges of joints 2 and 3 leave.
    """
    arm = along_z(read_urdf(chain.path, chain.base, chain.tip))
    joints = [_without_row(joint) for joint in arm.joints]
    content: dict[str, object] = {
        "schema": "zerobeam/robot/1",
        "name": name,
        "vendor": vendor,
        "convention": "standard",
        "joints": joints,
        "mounting": {"below_base_mm": chain.below_base},
    }
    first = arm.joints[0].fixed
    upright = np.allclose(first[:3, 2], (0, 0, 1), rtol=0, atol=1e-9)
    above = np.allclose(first[:2, 3], 0, rtol=0, atol=1e-7)
    if not (upright and above):
        content["base"] = StatedTransform().of(first, _DIGITS).model_dump(mode="json")
    if vendor == "fanuc" and len(joints) > 2 and all(joint.kind == "revolute" for joint in arm.joints[1:3]):
        (lower, upper), between = _limits(arm.joints[1]), _limits(arm.joints[2])
        joints[2]["lower_deg"] = round(between[0] - upper, _DIGITS)
        joints[2]["upper_deg"] = round(between[1] - lower, _DIGITS)
        content |= {"pendant": {"joint3": "ground"}, "limits": {"joint3_to_link2_deg": between}}
    with_zeros = validate(RobotFile, content, file=chain.path, line=lambda _: None)
    return _stating(with_zeros.of_robot(arm, _DIGITS), chain.path)


def _without_row(joint: Joint) -> dict[str, object]:
    """What the file says of a joint besides its row, whose numbers are 0."""
    (lower, upper), unit = _limits(joint), joint.unit
    limits = {f"lower_{unit}": lower, f"upper_{unit}": upper}
    if joint.speed is not None:
        limits[f"speed_{unit}_s"] = _shown(joint, joint.speed)
    return {"name": joint.name, "kind": joint.kind, **dict.fromkeys(_ROW[:4], 0.0), **limits}


def _limits(joint: Joint) -> list[float]:
    return [_shown(joint, joint.lower), _shown(joint, joint.upper)]


def _shown(joint: Joint, value: float) -> float:
    return round(value * joint.display, _DIGITS) + 0.0  # no -0.0


# Lengths as data sheets of arms with six axes draw them, with the arm's own words for each.
LENGTHS: Mapping[str, str] = {
    "height": "from the mounting face to axis 2",
    "shoulder": "from axis 1 to axis 2, forward",
    "side": "from the plane of axis 1 to that of the wrist, sideways",
    "upper": "from axis 2 to axis 3",
    "elbow": "from axis 3 to axis 4, across the forearm",
    "forearm": "from axis 3 to axis 5, along the forearm",
    "wrist": "from axis 5 to the flange",
}
_WORDS = ", ".join(f"{name}= {words}" for name, words in LENGTHS.items())
# An arm of each maker: its zeros, signs, base frame and flange are those of the maker's other arms.
LIKE: Mapping[str, str] = {
    "abb": "irb120",
    "fanuc": "lrmate_200id",
    "kawasaki": "rs007n",
    "kuka": "kr6_r900",
    "mitsubishi": "rv4frl",
    "staubli": "tx2_60",
    "yaskawa": "gp7",
}
_VENDORS: tuple[str, ...] = get_args(Vendor)
_ROW = ("a_mm", "alpha_deg", "d_mm", "theta_deg", "lower_deg", "upper_deg", "speed_deg_s")


def typed_vendor(text: str) -> str:
    """A maker as robot files have it, from a name in any case: Stäubli is staubli. BadInput for no maker."""
    plain = normalize("NFKD", text).encode("ascii", "ignore").decode()
    vendor = "-".join(plain.lower().split())
    if vendor not in _VENDORS:
        raise BadInput(
            "there is no such maker",
            found=shown(text),
            allowed=", ".join(_VENDORS),
            remedy=did_you_mean(vendor, _VENDORS),
        )
    return vendor


def typed_lengths(text: str) -> dict[str, float]:
    """`height=330, upper=455, …` as lengths by name. BadInput for another name, or where one is missing."""
    parts = dict(re.findall(r"([A-Za-z]+)\s*[=:]\s*([-+\d.]+)", text))
    lengths = {"shoulder": 0.0, "side": 0.0, "elbow": 0.0}
    for name, value in parts.items():
        if name not in LENGTHS:
            raise BadInput("there is no such length", found=name, allowed=", ".join(LENGTHS))
        lengths[name] = _numbers(value, (1,), name, "a number")[0]
    missing = [name for name in LENGTHS if name not in lengths]
    if missing:
        raise BadInput(
            "lengths of the data sheet are missing",
            found=shown(text) or "none",
            allowed="; ".join(f"{name}: {LENGTHS[name]}" for name in missing),
        )
    return lengths


def stated_arm(
    name: str, options: NewRobotOptions, base: str | None = None, tip: str | None = None
) -> tuple[RobotFile, str]:
    """The robot file, and its first lines of comment; `base` and `tip` are the ends of a URDF's chain.
    BadInput where what is stated makes no robot."""
    vendor = typed_vendor(options.vendor or "")
    if options.urdf is not None:
        if options.row or options.sheet is not None or options.ranges or options.convention != "standard":
            raise BadInput(
                "an arm is stated once", found="--urdf with --row, --sheet, --range or --convention"
            )
        chain = stated_chain(options.urdf, base, tip, options.below)
        return file_of_chain(name, vendor, chain), chain.head
    if base is not None or tip is not None:
        raise BadInput("--base and --tip are links of a URDF", remedy="name the file: --urdf FILE")
    if bool(options.row) == (options.sheet is not None):
        sheet = f"; or --sheet and --range, with {_WORDS}" if vendor in LIKE else ""
        raise BadInput(
            "an arm is stated by its rows or by the lengths of its data sheet",
            found="both" if options.row else "neither",
            allowed=f"--row '{' '.join(_ROW[:6])} [speed]' once for each joint{sheet}",
        )
    if options.sheet is not None:
        content = _of_sheet(vendor, options.sheet, options.ranges or ())
    else:
        content = {
            "convention": options.convention,
            "joints": [_typed_row(row, _ROW) for row in options.row or ()],
            "mounting": {"below_base_mm": options.below},
        }
        if vendor == "fanuc":
            content["pendant"] = {"joint3": "ground"}
    content |= {"schema": "zerobeam/robot/1", "name": name, "vendor": vendor}
    return validate(RobotFile, content, file=None, line=lambda _: None), ""


def _of_sheet(vendor: str, sheet: str, ranges: Sequence[str]) -> dict[str, object]:
    """An arm of the same maker with these lengths in the places of its own, and these ranges."""
    if vendor not in LIKE:
        raise BadInput(
            "the zeros and signs of this maker's arms are not known here",
            found=vendor,
            allowed=", ".join(LIKE),
            remedy="state the Denavit-Hartenberg rows: --row",
        )
    lengths = typed_lengths(sheet)
    like = stated_rows(LIKE[vendor], Path())
    if len(ranges) != len(like.joints):
        raise BadInput("each joint has a range", found=len(ranges), allowed=len(like.joints))
    if lengths["side"] and not like.joints[1].d_mm:
        raise BadInput(
            "arms of this maker have no side offset here",
            found=f"side: {lengths['side']:g}",
            remedy="state the Denavit-Hartenberg rows: --row",
        )
    above = like.joints[0].d_mm  # 0: the base frame is at the height of axis 2
    lengths_of = {
        0: {"a_mm": lengths["shoulder"], "d_mm": _signed(lengths["height"], above) if above else 0.0},
        1: {"a_mm": lengths["upper"], "d_mm": _signed(lengths["side"], like.joints[1].d_mm)},
        2: {"a_mm": _signed(lengths["elbow"], like.joints[2].a_mm)},
        3: {"d_mm": _signed(lengths["forearm"], like.joints[3].d_mm)},
        5: {"d_mm": _signed(lengths["wrist"], like.joints[5].d_mm)},
    }
    rows = [
        joint.model_dump(include={*_ROW[:4]}) | lengths_of.get(i, {}) | _typed_row(text, _ROW[4:])
        for i, (joint, text) in enumerate(zip(like.joints, ranges, strict=True))
    ]
    return {
        **like.model_dump(mode="json", include={"convention", "base", "flange"}, exclude_unset=True),
        "joints": rows,
        "mounting": {"below_base_mm": 0.0 if above else lengths["height"]},
        "pendant": like.pendant.model_dump(mode="json", include={"joint3", "names"}, exclude_none=True),
    }


def _typed_row(text: str, keys: Sequence[str]) -> dict[str, float]:
    """The numbers of a row or a range by their keys, of which the last, the speed, may be missing."""
    what = "row" if keys is _ROW else "range"
    numbers = _numbers(text, (len(keys) - 1, len(keys)), what, f"{' '.join(keys)} (speed optional)")
    return dict(zip(keys, numbers, strict=False))


def _signed(length: float, like: float) -> float:
    return -length if like < 0 and length else length


def _numbers(text: str, counts: Sequence[int], what: str, allowed: str) -> list[float]:
    parts = [part for part in re.split(r"[,;\s]+", text.strip()) if part]
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in counts:
        raise BadInput(f"the {what} is not understood", found=shown(text), allowed=allowed)
    return values


def with_fanuc_backup(file: RobotFile, folder: Path | None) -> RobotFile:
    """The robot file with what the encoder of joint 3 measures by a backup (see `fanuc/backup.py`), and the
    controller's model where it states none. BadInput for an arm of another maker, and where the file says
    otherwise."""
    if folder is None:
        return file
    if file.vendor != "fanuc":
        raise BadInput("--fanuc-backup is for arms of FANUC", found=f"vendor: {file.vendor}")
    backup = read_fanuc_backup(folder, len(file.joints))
    if file.encoder is not None and file.encoder.joint3 != backup.encoder3:
        raise BadInput(
            "the backup and the robot file disagree on what the encoder of joint 3 measures",
            found=f"backup of {backup.model}: {backup.encoder3}; robot file: {file.encoder.joint3}",
            remedy="is it the backup of this arm? If so, write the file of its rows: robot new",
        )
    return _stating(file, model=file.model or backup.model, encoder={"joint3": backup.encoder3})


def _stating(file: RobotFile, path: Path | None = None, **more: object) -> RobotFile:
    """The file with more in it, or as it is, checked; `path` is where its numbers are from."""
    return validate(RobotFile, file.content | more, file=path, line=lambda _: None)


def write_robot(path: Path, file: RobotFile, head: str = "") -> None:
    """The robot file, below the remarks of its `head`; never over another one."""
    refuse_existing(path, or_else="remove it first")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise BadInput("a robot file has another name", found=path.name, allowed="a name that ends in .yaml")
    write_whole(path, head + file.text())


def copy_robot(name: str, path: Path, pulses: str | None, fanuc_backup: Path | None = None) -> None:
    """A robot file of one's own of a built-in robot or another file, with `pulses` for a degree of each joint
    (P1,P2,…) where the pendant shows pulses, and what a FANUC backup says. BadInput where these do not fit
    the robot."""
    if name not in built_in_robots() and not name.lower().endswith((".yaml", ".yml")):
        raise BadInput(
            "only a robot file can be copied",
            found=name,
            allowed="a built-in name (--list) or a file (.yaml)",
        )
    source = BUILT_IN / f"{name}.yaml" if name in built_in_robots() else Path(name)
    file = with_fanuc_backup(read_rows(source), fanuc_backup)
    if pulses is not None:
        n = len(file.joints)
        values = _numbers(pulses, (n,), "pulses", f"{n} numbers")
        pendant = file.pendant.model_dump(mode="json", exclude_unset=True, exclude_none=True)
        file = _stating(file, pendant={**pendant, "unit": "pulse", "pulses_per_deg": values})
    text = source.read_text(encoding="utf-8")
    write_robot(path, file, "".join(re.findall(r"\A(?:#[^\n]*\n)*", text)))
