"""ROS recordings: sensor_msgs/JointState in ROS 1 bags, ROS 2 bags and mcap files, read without ROS.

By definition of JointState (JointState.msg) positions are radians, metres where the joint slides.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.reading import did_you_mean, require_regular
from ...model.kinematics.robot import Robot
from .bags.opened import JOINT_STATE, opened
from .columns import columns_of_joints
from .dwells import Log, Mark, Stillness
from .imported import Imported, Job, Stated
from .joint_states import joint_names, per_unit

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection


def import_ros(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
    *,
    still: Stillness,
    columns: Sequence[str] | None = None,
    topic: str | None = None,
    marker_topic: str | None = None,
) -> Imported:
    """Measurements from bags: at each dwell, or at those that a message on `marker_topic` marks.

    `columns` are the names of joint 1, 2, … in the messages, by default the robot's own. `topic` is
    required if several have joint states. A marker of text (std_msgs/String) names the target,
    unless `target_names`, one for each file, do. Times are those at which the messages were recorded.
    """
    job = Job.begin(files, stated)
    robot = job.robot
    names = joint_names(robot, columns_of_joints(columns, robot))
    named = bool(target_names) or marker_topic is None or job.plan is not None
    targets: list[str | None] = [*job.targets(target_names)] if named else [None] * len(job.paths)
    found, topics = [], []
    for path, target in zip(job.paths, targets, strict=True):
        log, read = _read(path, robot, names, topic, marker_topic)
        topics.append(read)
        found.append(log.shots(robot, still, target))
    notes = [
        f"joint states on {', '.join(dict.fromkeys(topics))}, in radians by definition of JointState"
        + ("" if all(joint.kind == "revolute" for joint in robot.joints) else "; prismatic joints in metres"),
        f"joints by name, joint 1 first: {', '.join(names)}",
        "every dwell is a measurement"
        if marker_topic is None
        else f"measurements at markers on {marker_topic}",
    ]
    return job.finish(found, out, notes)


class Topic(NamedTuple):
    """A topic of a bag, its number of messages, and the joints in the first of its joint states (empty for
    other messages)."""

    name: str
    type: str
    messages: int
    joints: tuple[str, ...]


def topics_of(path: Path) -> tuple[Topic, ...]:
    """The topics of a bag, by name."""
    with opened(path) as bag:
        found = []
        for name in sorted(bag.reader.topics):
            topic = bag.reader.topics[name]
            first = bag.first(name) if topic.msgtype == JOINT_STATE else None
            joints = () if first is None else tuple(first.name)
            found.append(Topic(name, str(topic.msgtype), topic.msgcount, joints))
        return tuple(found)


def _read(
    path: Path, robot: Robot, names: Sequence[str], topic: str | None, marker_topic: str | None
) -> tuple[Log, str]:
    """The log of a bag, and the topic that it was read from."""
    if not path.exists():
        raise BadInput("there is no such file", file=path, remedy="name a .bag, .mcap, .db3 or folder")
    for file in path.iterdir() if path.is_dir() else (path,):
        require_regular(file)
    with opened(path) as bag:
        reader = bag.reader
        states = [c for c in reader.connections if c.msgtype == JOINT_STATE]
        chosen = _topic(states, topic, reader, path)
        stamps, positions = array("q"), array("d")  # not lists of lists: recordings are long
        seen: dict[str, None] = {}
        for stamp, message in bag.messages([c for c in states if c.topic == chosen]):
            seen.update(dict.fromkeys(message.name))
            row = _positions(message, names, chosen, path)
            if row is not None:
                stamps.append(stamp)
                positions.extend(row)
        if not stamps:
            raise _no_joints(names, list(seen), chosen, path)
        marks = None
        if marker_topic is not None:
            markers = [c for c in reader.connections if c.topic == marker_topic]
            if not markers:
                raise _no_topic(marker_topic, reader, path)
            marks = [
                Mark((stamp - stamps[0]) * 1e-9, None if message is None else str(message.data))
                for stamp, message in bag.messages(markers)
            ]
    times = (np.array(stamps) - stamps[0]) * 1e-9
    return Log(
        path, times, np.array(positions).reshape(-1, len(names)) * per_unit(robot), marks=marks
    ), chosen


def _topic(states: Sequence[Connection], topic: str | None, reader: AnyReader, path: Path) -> str:
    there = sorted({connection.topic for connection in states})
    if topic is not None:
        if topic not in there:
            if topic in reader.topics:
                raise BadInput(
                    "the topic has no joint states",
                    found=f"{topic} of type {reader.topics[topic].msgtype}",
                    allowed=", ".join(there) or JOINT_STATE,
                    file=path,
                )
            raise _no_topic(topic, reader, path)
        return topic
    if not there:
        raise BadInput(
            "the bag has no joint states",
            found=", ".join(sorted(reader.topics)) or "no topics",
            allowed=f"a topic of type {JOINT_STATE}",
            file=path,
        )
    if len(there) > 1:
        raise BadInput(
            "the bag has several topics of joint states",
            found=", ".join(there),
            remedy="state which one is of the arm (--topic)",
            file=path,
        )
    return there[0]


def _no_topic(topic: str, reader: AnyReader, path: Path) -> BadInput:
    there = sorted(reader.topics)
    return BadInput(
        "there is no topic of this name",
        found=topic,
        allowed=", ".join(there),
        remedy=did_you_mean(topic, there),
        file=path,
    )


def _positions(message: Any, names: Sequence[str], topic: str, path: Path) -> list[float] | None:
    """Positions in the order of `names`; None for a message of other joints (a gripper's, say)."""
    there = list(message.name)
    if not set(names) & set(there):
        return None
    if not set(names) <= set(there):
        raise _no_joints(names, there, topic, path)
    position = dict(zip(there, message.position, strict=False))
    values = [float(position.get(name, np.nan)) for name in names]
    if not np.all(np.isfinite(values)):
        raise BadInput(
            f"a message on {topic} lacks a position",
            found=", ".join(f"{name} {value:g}" for name, value in zip(names, values, strict=True)),
            allowed="a finite number for each joint",
            file=path,
        )
    return values


def _no_joints(names: Sequence[str], there: Sequence[str], topic: str, path: Path) -> BadInput:
    missing = next(name for name in names if name not in there)
    return BadInput(
        f"the messages on {topic} have no joint {missing!r}",
        found=", ".join(there) or "no joints",
        allowed=", ".join(names),
        remedy=did_you_mean(missing, there) or "state the names of joint 1, 2, … (--columns)",
        file=path,
    )
