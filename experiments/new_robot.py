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

from ..model.arrays import Matrix
from ..model.errors import BadInput
from ..model.files.robot_file import RobotFile, Vendor, built_in_robots, stated_rows
from ..model.files.urdf import links_of, read_urdf
from ..model.files.whole_file import flow, refuse_existing, write_whole, yaml_text
from ..model.kinematics.dh import DHRow, along_z
from ..model.kinematics.orientation import angles_of
from ..model.kinematics.robot import Joint, Robot
from ..model.parsing.confinement import BUILT_IN
from ..model.parsing.reading import did_you_mean, read_yaml, shown
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
        "joints": _named(arm, [_entries(joint, DHRow(0.0, 0.0, 0.0, 0.0)) for joint in arm.joints]),
        **({} if upright and above else {"base": _transform(first)}),
    }
    table = validate(RobotFile, content, file=chain.path, line=lambda _: None).table_of(arm)
    rows = [_entries(joint, row) for joint, row in zip(arm.joints, table.rows, strict=True)]
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


def _entries(joint: Joint, row: DHRow) -> dict[str, float]:
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
        lengths[name] = _numbers(value, range(1, 2), name)[0]
    missing = [name for name in LENGTHS if name not in lengths]
    if missing:
        raise BadInput(
            "lengths of the data sheet are missing",
            found=shown(text) or "none",
            allowed="; ".join(f"{name}: {LENGTHS[name]}" for name in missing),
        )
    return lengths


def content_of(
    name: str, options: NewRobotOptions, base: str | None = None, tip: str | None = None
) -> tuple[dict[str, object], str]:
    """The content of the robot file, and its first lines of comment; `base` and `tip` are the ends of a
    URDF's chain. BadInput where it makes no robot."""
    vendor = typed_vendor(options.vendor or "")
    if options.urdf is not None:
        if options.row or options.sheet is not None or options.ranges or options.convention != "standard":
            raise BadInput(
                "an arm is stated once", found="--urdf with --row, --sheet, --range or --convention"
            )
        chain = stated_chain(options.urdf, base, tip, options.below)
        return content_of_chain(name, vendor, chain), chain.head
    if base is not None or tip is not None:
        raise BadInput("--base and --tip are links of a URDF", remedy="name the file: --urdf FILE")
    if bool(options.row) == (options.sheet is not None):
        sheet = f"; or --sheet and --range, with {_WORDS}" if vendor in LIKE else ""
        raise BadInput(
            "an arm is stated by its rows or by the lengths of its data sheet",
            found="both" if options.row else "neither",
            allowed=f"--row '{' '.join(_ROW[:6])} [speed]' once for each joint{sheet}",
        )
    if options.sheet is None:
        content: dict[str, object] = {
            "schema": "zerobeam/robot/1",
            "name": name,
            "vendor": vendor,
            "convention": options.convention,
            "joints": [_typed_row(row) for row in options.row or ()],
            "mounting": {"below_base_mm": options.below},
        }
        if vendor == "fanuc":
            content["pendant"] = {"joint3": "ground"}
    else:
        content = _of_sheet(name, vendor, options.sheet, options.ranges or ())
    validate(RobotFile, content, file=None, line=lambda _: None)
    return content, ""


def _of_sheet(name: str, vendor: str, sheet: str, ranges: Sequence[str]) -> dict[str, object]:
    """The rows of another arm of the maker with these lengths in the places of its own, and these ranges."""
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
    values: dict[tuple[int, str], float] = {
        (0, "a_mm"): lengths["shoulder"],
        (0, "d_mm"): _signed(lengths["height"], above) if above else 0.0,
        (1, "a_mm"): lengths["upper"],
        (1, "d_mm"): _signed(lengths["side"], like.joints[1].d_mm),
        (2, "a_mm"): _signed(lengths["elbow"], like.joints[2].a_mm),
        (3, "d_mm"): _signed(lengths["forearm"], like.joints[3].d_mm),
        (5, "d_mm"): _signed(lengths["wrist"], like.joints[5].d_mm),
    }
    rows = []
    for i, (joint, text) in enumerate(zip(like.joints, ranges, strict=True)):
        row = {key: values.get((i, key), getattr(joint, key)) for key in _ROW[:4]}
        rows.append(row | dict(zip(_ROW[4:], _numbers(text, range(2, 4), "range"), strict=False)))
    frames = {
        key: {"xyz_mm": list(frame.xyz_mm), "rpy_deg": list(frame.rpy_deg)}
        for key, frame in (("base", like.base), ("flange", like.flange))
    }
    pendant = {
        "joint3": like.pendant.joint3,
        "names": None if like.pendant.names is None else list(like.pendant.names),
    }
    return {
        "schema": "zerobeam/robot/1",
        "name": name,
        "vendor": vendor,
        "convention": like.convention,
        "joints": rows,
        **frames,
        "mounting": {"below_base_mm": 0.0 if above else lengths["height"]},
        "pendant": {key: value for key, value in pendant.items() if value is not None},
    }


def _typed_row(text: str) -> dict[str, float]:
    return dict(zip(_ROW, _numbers(text, range(6, 8), "row"), strict=False))


def _signed(length: float, like: float) -> float:
    return -length if like < 0 and length else length


def _numbers(text: str, counts: range, what: str, allowed: str | None = None) -> list[float]:
    parts = [part for part in re.split(r"[,;\s]+", text.strip()) if part]
    try:
        values = [float(part) for part in parts]
    except ValueError:
        values = []
    if len(values) not in counts:
        if allowed is None and what in ("row", "range"):
            allowed = f"{' '.join(_ROW if what == 'row' else _ROW[4:])} (speed optional)"
        raise BadInput(f"the {what} is not understood", found=shown(text), allowed=allowed or "a number")
    return values


def with_fanuc_backup(content: Mapping[str, object], folder: Path | None) -> Mapping[str, object]:
    """The content of a robot file with what the encoder of joint 3 measures by a backup (see
    `fanuc/backup.py`), and the controller's model where it states none. BadInput for an arm of another maker,
    and where the content says otherwise."""
    if folder is None:
        return content
    if content.get("vendor") != "fanuc":
        raise BadInput("--fanuc-backup is for arms of FANUC", found=f"vendor: {content.get('vendor')}")
    rows = content["joints"]
    assert isinstance(rows, list)
    backup = read_fanuc_backup(folder, len(rows))
    encoder = content.get("encoder") or {}
    assert isinstance(encoder, dict)
    if encoder.get("joint3", backup.encoder3) != backup.encoder3:
        raise BadInput(
            "the backup and the robot file disagree on what the encoder of joint 3 measures",
            found=f"backup of {backup.model}: {backup.encoder3}; robot file: {encoder['joint3']}",
            remedy="is it the backup of this arm? If so, write the file of its rows: robot new",
        )
    model = {} if content.get("model") else {"model": backup.model}
    with_encoder = {**content, **model, "encoder": {"joint3": backup.encoder3}}
    validate(RobotFile, with_encoder, file=None, line=lambda _: None)
    return with_encoder


def write_robot(path: Path, content: Mapping[str, object], head: str = "") -> None:
    """The robot file, below the remarks of its `head`; never over another one."""
    refuse_existing(path, or_else="remove it first")
    if path.suffix.lower() not in (".yaml", ".yml"):
        raise BadInput("a robot file has another name", found=path.name, allowed="a name that ends in .yaml")
    in_lines = {
        key: [flow(row) for row in value] if key == "joints" and isinstance(value, list) else value
        for key, value in content.items()
    }
    text = yaml_text({key: flow(v) if isinstance(v, dict) else v for key, v in in_lines.items()})
    write_whole(path, head + text)


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
    document = read_yaml(source)
    validate(RobotFile, document.data, file=source, line=document.line)
    content = dict(with_fanuc_backup(document.data, fanuc_backup))
    if pulses is not None:
        rows = content["joints"]
        assert isinstance(rows, list)
        values = _numbers(pulses, range(len(rows), len(rows) + 1), "pulses", f"{len(rows)} numbers")
        pendant = content.get("pendant") or {}
        assert isinstance(pendant, dict)
        content["pendant"] = {**pendant, "unit": "pulse", "pulses_per_deg": values}
        validate(RobotFile, content, file=None, line=lambda _: None)
    text = source.read_text(encoding="utf-8")
    write_robot(path, content, "".join(re.findall(r"\A(?:#[^\n]*\n)*", text)))
