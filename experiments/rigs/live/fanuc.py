"""Joints of FANUC's controllers by the Remote Motion Interface (RMI, option R912), TCP port 16001.

Published in FANUC's operator's manual B-84184EN: a JSON object a line. `FRC_Connect` at port 16001 answers
the port of the session; there `FRC_ReadJointAngles` answers `JointAngle`, J1 to J9 of a group in degrees as
the pendant counts them (joint 3 from the ground), and `TimeTag`, by a clock whose unit is not relied on here.
`FRC_Initialize` is never sent: without it RMI moves nothing. The interface tells no serial number.
"""

from __future__ import annotations

import json
from contextlib import closing, suppress

import numpy as np

from ....model.kinematics.pendant import Pendant
from ..transport import LinkFault, Stream
from .joint_client import JointReading, LiveAddress, LiveJoints, OtherArm

_JOINTS, _GROUPS = 9, 8


class FanucJoints(LiveJoints):
    """A session of the interface."""

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._n, self._group = pendant.robot.n, address.number("group", 1, _GROUPS)
        with closing(Stream(address.host, address.port)) as first:
            port = _answered(first, "Communication", "FRC_Connect").get("PortNumber")
        if not isinstance(port, int) or not 0 < port < 65536:
            raise LinkFault("the controller names no port for the session")
        self._stream = Stream(address.host, port)

    def _reading(self) -> JointReading:
        answer = _answered(self._stream, "Command", "FRC_ReadJointAngles", Group=self._group)
        # Some versions call them JointAngles.
        angles, stamp = answer.get("JointAngle", answer.get("JointAngles")), answer.get("TimeTag")
        if not isinstance(angles, dict):
            raise LinkFault("the controller sent no joints")
        try:
            values = np.array([float(angles.get(f"J{i}", 0.0)) for i in range(1, _JOINTS + 1)])
            complete = all(f"J{i}" in angles for i in range(1, self._n + 1))
            time_tag = float(stamp)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            raise LinkFault("the controller sent what are no joints, or no time") from None
        if not complete or values[self._n :].any():
            raise OtherArm(f"the controller's joints are not the {self._n} of the plan's arm")
        return JointReading(values[: self._n], time_tag)

    def close(self) -> None:
        with suppress(LinkFault):
            self._stream.begin()
            self._stream.send(_packet("Communication", "FRC_Disconnect"))
        super().close()


def _packet(kind: str, name: str, **content: int) -> bytes:
    return json.dumps({kind: name, **content}).encode("ascii") + b"\r\n"


def _answered(stream: Stream, kind: str, name: str, **content: int) -> dict[str, object]:
    """The answer to a packet; what the controller says of itself in between is passed over."""
    stream.send(_packet(kind, name, **content))
    while True:
        try:
            answer = json.loads(stream.line())
        except (ValueError, RecursionError):
            raise LinkFault("the controller sent a line that cannot be read") from None
        if not isinstance(answer, dict):
            raise LinkFault("the controller sent a line that is no packet")
        if answer.get("Communication") == "FRC_Terminate":
            raise LinkFault("the controller has ended the session")
        if answer.get(kind) == name:
            if answer.get("ErrorID") != 0:
                raise LinkFault(f"the controller refuses {name}: ErrorID {answer.get('ErrorID')}")
            return answer
