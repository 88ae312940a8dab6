"""Joints of Yaskawa's controllers (FS100, DX200, YRC1000) by the High-Speed Ethernet Server, UDP port 10040.

Published in Yaskawa's "Options Instructions for High-Speed Ethernet Server Function" (160766-1CD for the
FS100, 178942-1CD for the YRC1000). A request has 32 bytes, little-endian; the answer repeats its number, so
that an answer to an earlier request is not taken for it. Command 0x75, instance 1 is the position of robot 1
in pulses: five words about the pose, the first of them 0, and eight axes. Answers have no time: the stamp is
when the request was sent, and an answer cannot be older than that.

Pulses become degrees by `pulses_per_deg` of the robot file, in the order of the pendant. `arm=` is compared
with the model of robot 1, of which command 0x89 (instance 11) tells; the server tells no serial number.
"""

from __future__ import annotations

import struct
import time

import numpy as np

from ....model.kinematics.pendant import Pendant
from ..transport import LinkFault, Stream
from .joint_client import JointReading, LiveAddress, LiveJoints, OtherArm

_HEADER = struct.Struct("<4sHHBBBBI8s")
_REQUEST, _ANSWER = struct.Struct("<HHBBH"), struct.Struct("<BBBBHH")
_POSITION, _SYSTEM = (0x75, 1), (0x89, 11)  # command, instance
_READ_ALL = 0x01
_WORDS = struct.Struct("<13i")
_AXES = 5  # words before them
_MODEL = slice(24, 40)  # letters, behind 24 of the software's version


class YaskawaJoints(LiveJoints):
    """The connection to one controller."""

    ticks = 1.0

    def __init__(self, address: LiveAddress, pendant: Pendant) -> None:
        self._pulses = pendant.per_degree("pulse")
        self._order, self._number = pendant.order, 0
        self.resolution = 1.0 / np.abs(self._pulses)
        self._stream = Stream(address.host, address.port, datagrams=True)
        if "arm" in address.options:
            with self._stream.closed_on_failure():
                self.identity = self._model()

    def _reading(self) -> JointReading:
        stamp = time.monotonic()
        content = self._answered(*_POSITION)
        if len(content) != _WORDS.size:
            raise LinkFault("the controller sent a position of another length")
        kind, *words = _WORDS.unpack(content)
        if kind != 0:
            raise LinkFault("the controller sent a position that is not in pulses")
        axes = np.array(words[_AXES - 1 :], dtype=float)
        n = len(self._order)
        if axes[n:].any():
            raise OtherArm(f"the controller moves {int(np.flatnonzero(axes)[-1]) + 1} joints, and not {n}")
        joints = np.empty(n)
        joints[self._order] = axes[:n]
        return JointReading(joints / self._pulses, stamp)

    def _model(self) -> str:
        return self._answered(*_SYSTEM)[_MODEL].split(b"\0")[0].decode("ascii", "replace").strip()

    def _answered(self, command: int, instance: int) -> bytes:
        """The content of the answer to a request without content."""
        self._number = (self._number + 1) % 256
        header = _HEADER.pack(b"YERC", 32, 0, 3, 1, 0, self._number, 0, b"99999999")
        self._stream.send(header + _REQUEST.pack(command, instance, 0, _READ_ALL, 0))
        while (content := self._answer(self._stream.datagram())) is None:
            pass  # of an earlier request
        return content

    def _answer(self, packet: bytes) -> bytes | None:
        """The content of a packet; None if it answers another request."""
        if len(packet) < 32:
            raise LinkFault("the controller sent a packet that is too short")
        word, size, length, _, _, answers, number, _, _ = _HEADER.unpack(packet[:24])
        service, status, _, _, added, _ = _ANSWER.unpack(packet[24:32])
        if (word, size, answers) != (b"YERC", 32, 1) or length != len(packet) - 32:
            raise LinkFault("the controller sent a packet that cannot be read")
        if number != self._number:
            return None
        if service != _READ_ALL + 0x80 or status != 0:
            raise LinkFault(f"the controller refuses the request: status {status:#x}, {added:#x}")
        return packet[32:]
