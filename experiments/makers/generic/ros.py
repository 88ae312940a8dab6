"""ROS: sensor_msgs/JointState in bags and in text, as `ros2 topic echo` prints them.

In text each message is a measurement: documents of YAML with lists of `name` and `position`; other keys are
not looked at, since a driver may well print an effort of .nan. By definition of JointState positions are
radians, metres where the joint slides.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, located
from ....model.files.joint_columns import JointColumns
from ....model.files.text_tables import number
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import did_you_mean, read_text, require_regular, unknown_name
from ....model.records import it, record
from ..import_jobs import FileMeasurements, Imported, ImportJob
from .bags import JOINT_STATE, opened
from .dwells import JointLog, Mark
from .layouts import Stillness

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


_NO_TOPIC = "there is no topic of this name"
_KEY = re.compile(r"(?P<key>[A-Za-z_]\w*)\s*:\s*(?P<inline>\[.*\])?\s*$")
_ITEM = re.compile(r"\s*-\s+(?P<value>.+?)\s*$")
_QUOTED = re.compile(r"^(['\"])(.*)\1$")


def import_joint_states(job: ImportJob, *, columns: Sequence[str] | None = None) -> Imported:
    """Measurements from texts of joint states, one for each message, in their order.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. BadInput, with file
    and line, for a message without one of the joints, or with a position that is no number.
    """
    joints = _joints_by_name(job.robot, columns)

    def read(path: Path, target: str | None) -> FileMeasurements:
        rows, lines = _rows(path, joints)
        return FileMeasurements(path, "message", joints.joints(rows), {"target": [target] * len(rows)}, lines)

    note = "joint states as ros2 topic echo prints them, each message a measurement, in radians by definition"
    return job.measured(read, [note, _by_name(joints)])


def _joints_by_name(robot: Robot, columns: Sequence[str] | None) -> JointColumns:
    """The names of joint 1, 2, … in messages, whose positions are radians or metres."""
    names = columns or [joint.name for joint in robot.joints]
    return JointColumns.of_options(robot, names, "rad", lengths="m", j3="link", noun="name")


def _by_name(joints: JointColumns) -> str:
    return f"joints by name, joint 1 first: {', '.join(joints.names or ())}"


def _rows(path: Path, joints: JointColumns) -> tuple[Matrix, list[int]]:
    """(N, n) positions of each message, and the line where it begins."""
    rows, lines = [], []
    for line, message in messages(read_text(path)[0]):
        with located(path, line):
            if not {"name", "position"} <= message.keys():
                raise BadInput(
                    "a message has no names or no positions",
                    found=", ".join(message) or "none of the keys of a JointState",
                    allowed="name and position, as ros2 topic echo /joint_states prints them",
                )
            rows.append(_positions("the message has", joints, message["name"], message["position"]))
        lines.append(line)
    if not rows:
        raise BadInput("no measurements found: the file has no joint states")
    return np.array(rows), lines


def _positions(
    where: str, joints: JointColumns, names: Sequence[str], positions: Sequence[str | float]
) -> list[float]:
    """Positions of a message in the order of the joints."""
    position = dict(zip(names, positions, strict=False))
    values = []
    for name in joints.names or ():
        if name not in position:
            raise _no_joints(where, joints, list(position))
        text = position[name]
        value = number(text) if isinstance(text, str) else float(text)
        if value is None or not math.isfinite(value):
            raise BadInput(
                f"the position of joint {name!r} is not a finite number",
                found=f"{name} {text}",
                allowed="a finite number for each joint",
            )
        values.append(value)
    return values


def _no_joints(where: str, joints: JointColumns, there: Sequence[str]) -> BadInput:
    names = joints.names or ()
    missing = next(name for name in names if name not in there)
    return BadInput(
        f"{where} no joint {missing!r}",
        found=", ".join(there) or "no joints",
        allowed=", ".join(names),
        remedy=did_you_mean(missing, there) or "state the names of joint 1, 2, … (--columns)",
    )


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
    joints = _joints_by_name(job.robot, columns)
    slides = any(joint.kind == "prismatic" for joint in job.robot.joints)

    def read(path: Path, target: str | None) -> FileMeasurements:
        log, chosen = _read(path, joints, topic, marker_topic)
        how = f"  joint states on {chosen}, in radians by definition of JointState"
        how += "; prismatic joints in metres" if slides else ""
        return log.measurements(job.robot, still, target, [how])

    by = "every dwell is a measurement"
    if marker_topic is not None:
        by = f"measurements at markers on {marker_topic}"
    named = bool(job.names) or marker_topic is None or job.plan is not None
    return job.measured(read, [_by_name(joints), by], named=named)


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
    path: Path, joints: JointColumns, topic: str | None, marker_topic: str | None
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
        where = f"the messages on {chosen} have"
        names = set(joints.names or ())
        stamps, positions = array("q"), array("d")  # not lists of lists: recordings are long
        joint_names_read: dict[str, None] = {}
        for stamp, message in bag.messages([c for c in states if c.topic == chosen]):
            joint_names_read.update(dict.fromkeys(message.name))
            if names & set(message.name):  # else it is of other joints (a gripper's, say)
                stamps.append(stamp)
                positions.extend(_positions(where, joints, message.name, message.position))
        if not stamps:
            raise _no_joints(where, joints, list(joint_names_read))
        marks = None
        if marker_topic is not None:
            markers = [c for c in reader.connections if c.topic == marker_topic]
            if not markers:
                raise unknown_name(_NO_TOPIC, marker_topic, sorted(reader.topics))
            marks = [
                Mark((stamp - stamps[0]) * 1e-9, None if message is None else str(message.data))
                for stamp, message in bag.messages(markers)
            ]
    times = (np.array(stamps) - stamps[0]) * 1e-9
    rows = joints.joints(np.array(positions).reshape(len(stamps), -1))
    return JointLog(path, times, rows, marks=marks), chosen


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
            raise unknown_name(_NO_TOPIC, topic, sorted(reader.topics))
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
