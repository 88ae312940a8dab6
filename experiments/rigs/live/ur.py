"""Joints of Universal Robots by RTDE, the Real-Time Data Exchange, TCP port 30004.

Published in Universal Robots' guide (docs.universal-robots.com/tutorials/communication-protocol-tutorials/
rtde-guide.html): packages of a size (uint16, with the header), a type (a letter) and content, all big-endian.
Version 2 of the protocol is asked for (V), two outputs are set up (O): `timestamp`, seconds since the
controller started, and `actual_q`, six angles in rad. Data (U) flow from a start (S) to a pause (P), so that
none waits in a buffer between two readings; text messages (M) may come at any time. The clients on PyPI are
a C++ library that can move the arm, and unmaintained copies of the maker's example: neither is worth it here.

The serial number is asked for where `arm=` states it: `get serial number` of the dashboard server, port 29999
(PolyScope 3.12, 5.6; PolyScope X has none).
"""

from __future__ import annotations

import struct
from contextlib import closing

import numpy as np

from ....model.kinematics.pendant import Pendant
from ..transport import LinkFault, Stream
from .joint_client import JointReading, LiveAddress, LiveJoints, OtherArm

_VERSION, _SETUP, _START, _PAUSE, _DATA = b"V", b"O", b"S", b"P", b"U"
_HEADER = struct.Struct(">HB")
_SETTINGS, _READING = struct.Struct(">d"), struct.Struct(">B7d")
_RATE_HZ = 125.0
_OUTPUTS, _TYPES = b"timestamp,actual_q", b"DOUBLE,VECTOR6D"
_JOINTS = 6
_DASHBOARD = 29999


class UrJoints(LiveJoints):
    """The connection to one controller, paused between readings."""

    ticks = 1.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        if pendant.robot.n != _JOINTS:
            raise OtherArm(
                f"an arm of Universal Robots has 6 joints, and {pendant.robot.name} has {pendant.robot.n}"
            )
        self.identity = _serial(address) if "arm" in address.options else ""
        self._stream = Stream(address.host, address.port)
        with self._stream.closed_on_failure():
            if self._answered(_VERSION, struct.pack(">H", 2)) != b"\x01":
                raise LinkFault("the controller has no version 2 of RTDE")
            self._recipe, types = self._set_up()
            if types != _TYPES:
                raise LinkFault(f"the controller does not send {_OUTPUTS.decode()}: {types!r}")

    def _reading(self) -> JointReading:
        if self._answered(_START) != b"\x01":
            raise LinkFault("the controller does not start its data")
        content = self._next(_DATA)
        if len(content) != _READING.size:
            raise LinkFault("the controller sent data of another length")
        recipe, stamp, *joints = _READING.unpack(content)
        if recipe != self._recipe:
            raise LinkFault("the controller sent data that were not set up")
        self._answered(_PAUSE)
        return JointReading(np.degrees(joints), stamp)

    def _set_up(self) -> tuple[int, bytes]:
        content = self._answered(_SETUP, _SETTINGS.pack(_RATE_HZ) + _OUTPUTS)
        if not content:
            raise LinkFault("the controller sent an empty answer")
        return content[0], content[1:]

    def _answered(self, kind: bytes, content: bytes = b"") -> bytes:
        self._stream.send(_HEADER.pack(_HEADER.size + len(content), kind[0]) + content)
        return self._next(kind)

    def _next(self, kind: bytes) -> bytes:
        """The content of the next package of a kind; others are passed over."""
        while True:
            size, letter = _HEADER.unpack(self._stream.exactly(_HEADER.size))
            if size < _HEADER.size:
                raise LinkFault("the controller sent a package that is too short")
            content = self._stream.exactly(size - _HEADER.size)
            if letter == kind[0]:
                return content


def _serial(address: LiveAddress) -> str:
    with closing(Stream(address.host, address.number("dashboard", _DASHBOARD, 65535))) as dashboard:
        dashboard.line()  # its greeting
        dashboard.send(b"get serial number\n")
        return dashboard.line().decode("ascii", "replace").strip()
