"""Joints of any arm that ROS 1 or 2 has, by rosbridge: JSON over a websocket, TCP port 9090.

Published in rosbridge's protocol (RobotWebTools/rosbridge_suite, ROSBRIDGE_PROTOCOL.md) and in
sensor_msgs/JointState: `name`, `position` in rad (m if prismatic) and the time in `header.stamp`. A
subscription lasts for one reading, so that no message waits in a queue between two. Joints are found by their
names: those of `joints=a,b,c`, else of the robot file. They are counted as a URDF counts them, joint 3 from
link 2.
"""

from __future__ import annotations

import json
import time

import numpy as np

from ....model.arrays import Matrix
from ....model.kinematics.pendant import Pendant
from . import joint_client
from .joint_client import JointReading, LinkFault, LiveAddress, OtherArm
from .websocket import WebSocket

_TOPIC = "/joint_states"
_M = 1000.0


class RosJoints:
    """The connection to one bridge."""

    identity, resolution, between_links, ticks = "", 0.0, True, 1.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        robot = pendant.robot
        names = address.options.get("joints")
        self._names = [joint.name for joint in robot.joints] if names is None else names.split(",")
        if len(self._names) != robot.n:
            raise OtherArm(f"joints= has {len(self._names)} names, and {robot.name} has {robot.n} joints")
        self._topic = address.options.get("topic", _TOPIC)
        self._display = np.array(
            [joint.display if joint.kind == "revolute" else _M for joint in robot.joints]
        )
        self._number = 0
        self._socket = WebSocket(address.host, address.port)

    def read(self) -> JointReading:
        self._socket.begin()
        self._number += 1
        subscription = {"id": f"zerobeam-{self._number}", "topic": self._topic}
        self._socket.send(json.dumps({"op": "subscribe", **subscription, "queue_length": 1}))
        reading = self._published()
        self._socket.send(json.dumps({"op": "unsubscribe", **subscription}))
        self._socket.drain()
        return reading

    def close(self) -> None:
        self._socket.close()

    def _published(self) -> JointReading:
        """The next message that has the joints: a gripper may publish its own ones between."""
        others: dict[str, None] = {}
        ends = time.monotonic() + joint_client.ANSWER_S
        while time.monotonic() < ends:
            try:
                content = json.loads(self._socket.message())
                if content["op"] == "status" and content.get("level") == "error":
                    raise LinkFault(f"the bridge refuses: {str(content.get('msg'))[:200]}")
                if content["op"] != "publish" or content["topic"] != self._topic:
                    continue
                message = content["msg"]
                names = [str(name) for name in message["name"]]
                stamp = _seconds(message["header"]["stamp"])
                positions = dict(zip(names, map(float, message["position"]), strict=True))
            except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
                raise LinkFault("the bridge sent a message that cannot be read") from None
            if all(name in positions for name in self._names):
                return JointReading(self._displayed(positions), stamp)
            others |= dict.fromkeys(names)
        if others:
            raise OtherArm(
                f"{self._topic} has no joints {', '.join(n for n in self._names if n not in others)}: it has"
                f" {', '.join(others)[:300]}"
            )
        raise LinkFault(f"nothing is published at {self._topic}")

    def _displayed(self, positions: dict[str, float]) -> Matrix:
        return np.asarray(np.array([positions[name] for name in self._names]) * self._display)


def _seconds(stamp: dict[str, int]) -> float:
    """Of ROS 2 (sec, nanosec) or 1 (secs, nsecs)."""
    if "sec" in stamp:
        return stamp["sec"] + 1e-9 * stamp["nanosec"]
    return stamp["secs"] + 1e-9 * stamp["nsecs"]
