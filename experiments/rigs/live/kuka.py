"""Joints of KUKA's controllers by a variable proxy on them: KUKAVARPROXY or C3 Bridge, TCP port 7000.

Their protocol, by their public sources (ImtsSrl/KUKAVARPROXY; C3 Bridge Interface Server): a number and a
length (uint16, big-endian), 0 for reading, the length of a variable's name (uint16) and the name; the answer
repeats the number, and behind the value come three bytes, of which the last is 1 where the variable was read.

Read are `$AXIS_ACT`, the axes as a KRL program records them (degrees, mm; the setpoint of the control), and
`$ROB_TIMER`, milliseconds of the controller's clock (KUKA, "System Variables", KSS 8). `arm=` is compared
with `$KR_SERIALNO`, the serial number of the robot.
"""

from __future__ import annotations

import re
import struct

import numpy as np

from ....model.kinematics.pendant import Pendant
from ..transport import LinkFault, Stream
from .joint_client import JointReading, LiveAddress, LiveJoints

_HEADER, _LENGTH = struct.Struct(">HHB"), struct.Struct(">H")
_READ, _STATUS = 0, 3  # function; bytes behind a value
_AXIS = re.compile(r"\bA(\d)\s+([-+]?[\d.]+(?:[eE][-+]?\d+)?)")


class KukaJoints(LiveJoints):
    """The connection to one proxy."""

    ticks = 1000.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._number = 0
        self._stream = Stream(address.host, address.port)
        if "arm" in address.options:
            with self._stream.closed_on_failure():
                self.identity = self._variable("$KR_SERIALNO")

    def _reading(self) -> JointReading:
        text = self._variable("$AXIS_ACT").strip()
        timer = self._variable("$ROB_TIMER")
        try:
            axes = {int(axis): float(value) for axis, value in _AXIS.findall(text)}
            stamp = float(timer)
        except ValueError:
            raise LinkFault("the proxy sent what are no axes, or no time") from None
        if not text.endswith("}") or not axes or set(axes) != set(range(1, len(axes) + 1)):
            raise LinkFault("the proxy sent what are no axes")
        return JointReading(np.array([axes[i] for i in sorted(axes)]), stamp)

    def _variable(self, name: str) -> str:
        self._number = (self._number + 1) % 65536
        body = _LENGTH.pack(len(name)) + name.encode("ascii")
        self._stream.send(_HEADER.pack(self._number, len(body) + 1, _READ) + body)
        number, length, function = _HEADER.unpack(self._stream.exactly(_HEADER.size))
        content = self._stream.exactly(max(length - 1, 0))
        value = content[_LENGTH.size : -_STATUS]
        if (
            (number, function) != (self._number, _READ)
            or len(content) < _LENGTH.size + _STATUS
            or _LENGTH.unpack(content[: _LENGTH.size])[0] != len(value)
        ):
            raise LinkFault("the proxy sent an answer that cannot be read")
        if content[-1] != 1:
            raise LinkFault(f"the proxy cannot read {name}")
        return value.decode("ascii", "replace")
