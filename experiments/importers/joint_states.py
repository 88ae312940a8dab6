"""ROS in text: sensor_msgs/JointState as `ros2 topic echo` prints them, each a measurement.

Documents of YAML with lists of `name` and `position`; other keys are not looked at, since a driver may well
print an effort of .nan. By definition of JointState positions are radians, metres where the joint slides.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.reading import did_you_mean, read_text, shown
from ...model.kinematics.robot import Robot
from .columns import columns_of_joints
from .imported import Found, Imported, Job, Stated
from .table import number

_KEY = re.compile(r"(?P<key>[A-Za-z_]\w*)\s*:\s*(?P<inline>\[.*\])?\s*$")
_ITEM = re.compile(r"\s*-\s+(?P<value>.+?)\s*$")
_QUOTED = re.compile(r"^(['\"])(.*)\1$")


def import_joint_states(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
    *,
    columns: Sequence[str] | None = None,
) -> Imported:
    """Measurements from texts of joint states, one for each message, in their order.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. BadInput, with file
    and line, for a message without one of the joints, or with a position that is no number.
    """
    job = Job.begin(files, stated)
    names = joint_names(job.robot, columns_of_joints(columns, job.robot))
    found = []
    for path, target in zip(job.paths, job.targets(target_names), strict=True):
        rows, lines = _rows(path, job.robot, names)
        found.append(Found(path, "message", np.array(rows), [target] * len(rows), lines=lines))
    notes = [
        "joint states as ros2 topic echo prints them, each message a measurement, in radians by definition",
        f"joints by name, joint 1 first: {', '.join(names)}",
    ]
    return job.finish(found, out, notes)


def joint_names(robot: Robot, columns: Sequence[str] | None) -> list[str]:
    """The names of joint 1, 2, … in messages; BadInput unless there is one for each."""
    names = [joint.name for joint in robot.joints] if columns is None else list(columns)
    if len(names) != robot.n or len(set(names)) != robot.n:
        raise BadInput(
            "one name is required for each joint",
            found=", ".join(names),
            allowed=f"{robot.n} different names ({robot.name} has {robot.n} joints)",
        )
    return names


def per_unit(robot: Robot) -> Matrix:
    """(n,) degrees in a radian, or mm in a metre, of each joint."""
    return np.array([joint.display if joint.kind == "revolute" else 1000.0 for joint in robot.joints])


def _rows(path: Path, robot: Robot, names: Sequence[str]) -> tuple[list[list[float]], list[int]]:
    """Degrees (mm) of each message, and the line where it begins."""
    rows, lines = [], []
    text, _ = read_text(path)
    for line, message in messages(text):
        if not {"name", "position"} <= message.keys():
            raise BadInput(
                "a message has no names or no positions",
                found=", ".join(message) or "none of the keys of a JointState",
                allowed="name and position, as ros2 topic echo /joint_states prints them",
                file=path,
                line=line,
            )
        position = dict(zip(message["name"], message["position"], strict=False))
        values = []
        for name, unit in zip(names, per_unit(robot).tolist(), strict=True):
            if name not in position:
                raise BadInput(
                    f"the message has no joint {name!r}",
                    found=", ".join(message["name"]) or "no joints",
                    allowed=", ".join(names),
                    remedy=did_you_mean(name, message["name"])
                    or "state the names of joint 1, 2, … (--columns)",
                    file=path,
                    line=line,
                )
            value = number(position[name])
            if value is None or not math.isfinite(value):
                raise BadInput(
                    f"the position of joint {name!r} is not a finite number",
                    found=shown(position[name]),
                    file=path,
                    line=line,
                )
            values.append(value * unit)
        rows.append(values)
        lines.append(line)
    if not rows:
        raise BadInput("no measurements found: the file has no joint states", file=path)
    return rows, lines


def messages(text: str) -> list[tuple[int, dict[str, list[str]]]]:
    """The lists at the top of each document, and the line where the document begins."""
    found: list[tuple[int, dict[str, list[str]]]] = []
    document: dict[str, list[str]] = {}
    begun, items = 0, None
    for line, content in enumerate([*text.split("\n"), "---"], start=1):
        if content.startswith("---"):
            if begun:
                found.append((begun, document))
            document, begun, items = {}, 0, None
            continue
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        begun = begun or line
        key, item = _KEY.fullmatch(content), _ITEM.fullmatch(content)
        if key is not None:
            items = document.setdefault(key["key"], [])
            inline = (key["inline"] or "[]")[1:-1]
            items += [_bare(part) for part in inline.split(",") if part.strip()]
        elif item is not None and items is not None:
            items.append(_bare(item["value"]))
        else:
            items = None
    return found


def _bare(text: str) -> str:
    quoted = _QUOTED.fullmatch(text.strip())
    return text.strip() if quoted is None else quoted[2]
