"""ROS in text: sensor_msgs/JointState as `ros2 topic echo` prints them, each a measurement.

Documents of YAML with lists of `name` and `position`; other keys are not looked at, since a driver may well
print an effort of .nan. By definition of JointState positions are radians, metres where the joint slides.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, located
from ....model.files.text_tables import columns_of_joints, number
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import did_you_mean, read_text, require_regular, shown
from ....model.records import it, record
from ..import_jobs import FileMeasurements, Imported, ImportJob
from .bags import JOINT_STATE, opened
from .dwells import JointLog, Mark, Stillness

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


_KEY = re.compile(r"(?P<key>[A-Za-z_]\w*)\s*:\s*(?P<inline>\[.*\])?\s*$")
_ITEM = re.compile(r"\s*-\s+(?P<value>.+?)\s*$")
_QUOTED = re.compile(r"^(['\"])(.*)\1$")


def import_joint_states(
    job: ImportJob,
    *,
    columns: Sequence[str] | None = None,
) -> Imported:
    """Measurements from texts of joint states, one for each message, in their order.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. BadInput, with file
    and line, for a message without one of the joints, or with a position that is no number.
    """
    names = joint_names(job.robot, columns_of_joints(columns, job.robot))
    parts = []
    for path, target in zip(job.paths, job.targets(), strict=True):
        rows, lines = _rows(path, job.robot, names)
        parts.append(FileMeasurements(path, "message", np.array(rows), [target] * len(rows), lines=lines))
    notes = [
        "joint states as ros2 topic echo prints them, each message a measurement, in radians by definition",
        f"joints by name, joint 1 first: {', '.join(names)}",
    ]
    return job.finish(parts, notes)


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
        with located(path, line):
            rows.append(_row(message, robot, names))
        lines.append(line)
    if not rows:
        raise BadInput("no measurements found: the file has no joint states", file=path)
    return rows, lines


def _row(message: Mapping[str, Sequence[str]], robot: Robot, names: Sequence[str]) -> list[float]:
    """Degrees (mm) of a message."""
    if not {"name", "position"} <= message.keys():
        raise BadInput(
            "a message has no names or no positions",
            found=", ".join(message) or "none of the keys of a JointState",
            allowed="name and position, as ros2 topic echo /joint_states prints them",
        )
    position = dict(zip(message["name"], message["position"], strict=False))
    if not set(names) <= position.keys():
        raise _no_joints("the message has", names, list(position))
    values = []
    for name, unit in zip(names, per_unit(robot).tolist(), strict=True):
        value = number(position[name])
        if value is None or not math.isfinite(value):
            raise BadInput(
                f"the position of joint {name!r} is not a finite number", found=shown(position[name])
            )
        values.append(value * unit)
    return values


def messages(text: str) -> list[tuple[int, dict[str, list[str]]]]:
    """The lists at the top of each document, and the line where the document begins."""
    documents: list[tuple[int, dict[str, list[str]]]] = []
    document: dict[str, list[str]] = {}
    first_line, items = 0, None
    for line, content in enumerate([*text.split("\n"), "---"], start=1):
        if content.startswith("---"):
            if first_line:
                documents.append((first_line, document))
            document, first_line, items = {}, 0, None
            continue
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        first_line = first_line or line
        key, item = _KEY.fullmatch(content), _ITEM.fullmatch(content)
        if key is not None:
            items = document.setdefault(key["key"], [])
            inline = (key["inline"] or "[]")[1:-1]
            items += [_bare(part) for part in inline.split(",") if part.strip()]
        elif item is not None and items is not None:
            items.append(_bare(item["value"]))
        else:
            items = None
    return documents


def _bare(text: str) -> str:
    quoted = _QUOTED.fullmatch(text.strip())
    return text.strip() if quoted is None else quoted[2]


def import_ros(
    job: ImportJob,
    *,
    still: Stillness,
    columns: Sequence[str] | None = None,
    topic: str | None = None,
    marker_topic: str | None = None,
) -> Imported:
    """Measurements from bags: at each dwell, or at those that a message on `marker_topic` marks.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. `topic` is
    required if several have joint states. A marker of text (std_msgs/String) names the target,
    unless the job names one for each file. Times are those at which the messages were recorded.
    """
    robot = job.robot
    names = joint_names(robot, columns_of_joints(columns, robot))
    named = bool(job.names) or marker_topic is None or job.plan is not None
    targets: list[str | None] = [*job.targets()] if named else [None] * len(job.paths)
    parts, topics = [], []
    for path, target in zip(job.paths, targets, strict=True):
        log, read = _read(path, robot, names, topic, marker_topic)
        topics.append(read)
        parts.append(log.shots(robot, still, target))
    notes = [
        f"joint states on {', '.join(dict.fromkeys(topics))}, in radians by definition of JointState"
        + ("" if all(joint.kind == "revolute" for joint in robot.joints) else "; prismatic joints in metres"),
        f"joints by name, joint 1 first: {', '.join(names)}",
        "every dwell is a measurement"
        if marker_topic is None
        else f"measurements at markers on {marker_topic}",
    ]
    return job.finish(parts, notes)


@record
class Topic:
    """A topic of a bag, its number of messages, and the joints in the first of its joint states (empty for
    other messages)."""

    name: str
    type: str
    messages: int
    joints: Annotated[tuple[str, ...], it("in the first of its joint states")]


def topics_of(path: Path) -> tuple[Topic, ...]:
    """The topics of a bag, by name."""
    with opened(path) as bag:
        topics = []
        for name in sorted(bag.reader.topics):
            topic = bag.reader.topics[name]
            first = bag.first(name) if topic.msgtype == JOINT_STATE else None
            joints = () if first is None else tuple(first.name)
            topics.append(Topic(name, str(topic.msgtype), topic.msgcount, joints))
        return tuple(topics)


def _read(
    path: Path, robot: Robot, names: Sequence[str], topic: str | None, marker_topic: str | None
) -> tuple[JointLog, str]:
    """The log of a bag, and the topic that it was read from."""
    if not path.exists():
        raise BadInput("there is no such file", file=path, remedy="name a .bag, .mcap, .db3 or folder")
    for file in path.iterdir() if path.is_dir() else (path,):
        require_regular(file)
    with opened(path) as bag:
        reader = bag.reader
        states = [c for c in reader.connections if c.msgtype == JOINT_STATE]
        chosen = _topic(states, topic, reader)
        stamps, positions = array("q"), array("d")  # not lists of lists: recordings are long
        joint_names_read: dict[str, None] = {}
        for stamp, message in bag.messages([c for c in states if c.topic == chosen]):
            joint_names_read.update(dict.fromkeys(message.name))
            row = _positions(message, names, chosen)
            if row is not None:
                stamps.append(stamp)
                positions.extend(row)
        if not stamps:
            raise _no_joints(f"the messages on {chosen} have", names, list(joint_names_read))
        marks = None
        if marker_topic is not None:
            markers = [c for c in reader.connections if c.topic == marker_topic]
            if not markers:
                raise _no_topic(marker_topic, reader)
            marks = [
                Mark((stamp - stamps[0]) * 1e-9, None if message is None else str(message.data))
                for stamp, message in bag.messages(markers)
            ]
    times = (np.array(stamps) - stamps[0]) * 1e-9
    return JointLog(
        path, times, np.array(positions).reshape(-1, len(names)) * per_unit(robot), marks=marks
    ), chosen


def _topic(states: Sequence[Connection], topic: str | None, reader: AnyReader) -> str:
    there = sorted({connection.topic for connection in states})
    if topic is not None:
        if topic not in there:
            if topic in reader.topics:
                raise BadInput(
                    "the topic has no joint states",
                    found=f"{topic} of type {reader.topics[topic].msgtype}",
                    allowed=", ".join(there) or JOINT_STATE,
                )
            raise _no_topic(topic, reader)
        return topic
    if not there:
        raise BadInput(
            "the bag has no joint states",
            found=", ".join(sorted(reader.topics)) or "no topics",
            allowed=f"a topic of type {JOINT_STATE}",
        )
    if len(there) > 1:
        raise BadInput(
            "the bag has several topics of joint states",
            found=", ".join(there),
            remedy="state which one is of the arm (--topic)",
        )
    return there[0]


def _no_topic(topic: str, reader: AnyReader) -> BadInput:
    there = sorted(reader.topics)
    return BadInput(
        "there is no topic of this name",
        found=topic,
        allowed=", ".join(there),
        remedy=did_you_mean(topic, there),
    )


def _positions(message: Any, names: Sequence[str], topic: str) -> list[float] | None:
    """Positions in the order of `names`; None for a message of other joints (a gripper's, say)."""
    there = list(message.name)
    if not set(names) & set(there):
        return None
    if not set(names) <= set(there):
        raise _no_joints(f"the messages on {topic} have", names, there)
    position = dict(zip(there, message.position, strict=False))
    values = [float(position.get(name, np.nan)) for name in names]
    if not np.all(np.isfinite(values)):
        raise BadInput(
            f"a message on {topic} lacks a position",
            found=", ".join(f"{name} {value:g}" for name, value in zip(names, values, strict=True)),
            allowed="a finite number for each joint",
        )
    return values


def _no_joints(where: str, names: Sequence[str], there: Sequence[str]) -> BadInput:
    missing = next(name for name in names if name not in there)
    return BadInput(
        f"{where} no joint {missing!r}",
        found=", ".join(there) or "no joints",
        allowed=", ".join(names),
        remedy=did_you_mean(missing, there) or "state the names of joint 1, 2, … (--columns)",
    )
