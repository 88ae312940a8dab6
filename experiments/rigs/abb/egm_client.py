"""Externally Guided Motion: each EgmRobot that comes is answered with where the arm is to be next.

Facts from the application manual (3HAC073319-001) and `egm.proto`: the controller sends first, every 4 ms,
from a port of its own; joints are degrees; numbers rise by one a message.
"""

from __future__ import annotations

import contextlib
import select
import socket
import threading
import time
from typing import Any

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import RigFault, missing_extra

DEAD_MAN_S = 0.1  # without feedback, and no more references are sent
_LOOK_S = 0.05  # at a time, for feedback: how soon the end is noticed
_FIRST_S = 5.0  # until the first EgmRobot
_ARRIVE_S = 5.0  # behind the end of the profile
_LONGEST_STEP_S = 0.012  # of the profile at a time: where packets were lost it waits, and does not jump
_ACCELERATION = 60.0  # deg/s^2
_ARRIVED_DEG = 0.02
_STILL_DEG, _STILL_S = 0.002, 0.1  # feedback of an arm at rest
_LARGEST = 65536


class Guidance:
    """One stretch of guidance, from `with` to its end; (n,) are degrees. The thread ends at its first fault.

    `here` is the one address that the socket is bound to, `controller` the only one that is listened to;
    `speed` (n,) deg/s bounds the references' peak speed. Nothing is sent before the controller has said
    where the arm is; the first reference is just that.
    """

    def __init__(self, here: str, port: int, controller: str, speed: Matrix) -> None:
        self._messages, self._unreadable = egm_messages("the ABB rig")
        self._controller, self._speed = controller, speed
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((here, port))
        except OSError as error:
            self._socket.close()
            raise RigFault(
                f"EGM cannot listen at UDP port {port} ({error.strerror}): end the program that does, or "
                "state --egm-port and the same port in the controller's UdpUc device"
            ) from None
        self._socket.setblocking(False)
        self._changed = threading.Condition()
        self._over, self._fault = False, ""
        self._at: Matrix | None = None
        self._since = 0.0  # when the feedback last changed
        self._still_at = np.zeros(len(speed))
        self._start = self._goal = self._still_at
        self._duration = self._gone = 0.0
        self._number, self._last = 0, -1
        self._thread = threading.Thread(target=self._run, name="egm", daemon=True)
        self._thread.start()

    @property
    def fault(self) -> str:
        """The message of the first fault, "" while there is none."""
        with self._changed:
            return self._fault

    def first(self) -> Matrix:
        """(n,) where the arm is, as soon as the controller says so."""
        with self._changed:
            self._changed.wait_for(lambda: self._at is not None or self._fault, _FIRST_S)
            if self._at is None:
                raise RigFault(
                    self._fault
                    or f"no EGM came for {_FIRST_S:g} s: does the controller's UdpUc device ZEROBEAM name "
                    "this computer's address and --egm-port, and is no firewall in between?"
                )
            return self._at

    def go(self, goal: Matrix) -> None:
        """Lead the arm to the joints (n,) and wait until it is at rest there."""
        with self._changed:
            if not self._fault:
                self._start = self._reference()
                self._goal, self._gone = goal.copy(), 0.0
                self._duration = duration(goal - self._start, self._speed)
                self._since = time.monotonic()
            self._changed.wait_for(self._settled, self._duration * 2 + _ARRIVE_S)
            if self._fault:
                raise RigFault(self._fault)
            if not self._settled():
                assert self._at is not None
                off = np.abs(self._at - goal)
                joint = int(np.argmax(off))
                raise RigFault(
                    f"the arm does not follow the guidance: joint {joint + 1} is {off[joint]:.3f} deg off. "
                    "Look at the event log and at MaxSpeedDeviation in the RAPID module"
                )

    def close(self) -> None:
        """Say nothing more: the arm holds where it is."""
        self._over = True
        if threading.current_thread() is not self._thread:
            self._thread.join()
        self._socket.close()

    def _settled(self) -> bool:
        if self._fault:
            return True
        arrived = self._at is not None and bool(np.abs(self._at - self._goal).max() <= _ARRIVED_DEG)
        return arrived and self._gone >= self._duration and time.monotonic() - self._since >= _STILL_S

    def _reference(self) -> Matrix:
        """(n,) on the line from start to goal, without jerk at its ends (Flash and Hogan 1985)."""
        part = min(1.0, self._gone / self._duration) if self._duration > 0 else 1.0
        return np.asarray(self._start + (self._goal - self._start) * part**3 * (10 + part * (6 * part - 15)))

    def _run(self) -> None:
        answered = time.monotonic()
        deadline = answered + _FIRST_S
        while not self._over:
            left = deadline - time.monotonic()
            # What waits in the socket is feedback even if this thread comes late to it: look before judging.
            ready, _, _ = select.select([self._socket], [], [], min(max(left, 0.0), _LOOK_S))
            message, source = self._newest() if ready else (None, ("", 0))
            if message is None:
                if left > 0:
                    continue
                if self._at is not None:
                    self._fail(
                        f"no feedback by EGM for {DEAD_MAN_S * 1000:.0f} ms: no more references were sent. "
                        "Look at the cable, then go on with --resume"
                    )
                return
            now = time.monotonic()
            deadline = now + DEAD_MAN_S
            if not self._take(message, now, min(now - answered, _LONGEST_STEP_S)):
                return
            answered = now
            self._answer(source)

    def _newest(self) -> tuple[Any, tuple[str, int]]:
        """The newest message of those that wait and whom to answer; None where none is new."""
        newest, source = None, ("", 0)
        while True:
            try:
                packet, sender = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                return newest, source
            except ConnectionError:  # what was sent before found nobody
                continue
            message = self._messages.EgmRobot()
            if sender[0] != self._controller:
                continue
            try:
                message.ParseFromString(packet)
            except self._unreadable:
                continue
            joints = message.feedBack.joints.joints
            if message.header.seqno > self._last and len(joints) == len(self._speed):
                self._last, newest, source = message.header.seqno, message, sender

    def _take(self, message: Any, now: float, seconds: float) -> bool:
        """Feedback, and the profile goes on by so many seconds; False at a fault."""
        motor, rapid = message.motorState, message.rapidExecState
        if message.HasField("motorState") and motor.state != motor.MOTORS_ON:
            return self._fail("the motors went off while the arm was guided; look at the FlexPendant")
        if message.HasField("rapidExecState") and rapid.state != rapid.RAPID_RUNNING:
            return self._fail("RAPID stopped while the arm was guided; look at the event log")
        at = np.array(message.feedBack.joints.joints)
        with self._changed:
            if self._at is None:
                self._start = self._goal = at
            if self._at is None or np.abs(at - self._still_at).max() > _STILL_DEG:
                self._still_at, self._since = at, now
            self._at = at
            self._gone += seconds
            self._changed.notify_all()
        return True

    def _answer(self, source: tuple[str, int]) -> None:
        with self._changed:
            reference = self._reference()
        sensor = self._messages.EgmSensor()
        sensor.header.seqno, self._number = self._number, self._number + 1
        sensor.header.tm = int(time.monotonic() * 1000) % 2**32
        sensor.header.mtype = self._messages.EgmHeader.MSGTYPE_CORRECTION
        sensor.planned.joints.joints.extend(reference.tolist())
        with contextlib.suppress(OSError):  # one that is lost; the next is 4 ms away
            self._socket.sendto(sensor.SerializeToString(), source)

    def _fail(self, why: str) -> bool:
        with self._changed:
            self._fault = why
            self._changed.notify_all()
        return False


def egm_messages(user: str) -> tuple[Any, type[Exception]]:
    """The protobuf messages of `egm.proto`, and the error of what is none; BadInput that names the `user`
    where the extra is not installed."""
    try:
        from abb_robot_client._egm_protobuf import egm_pb2
        from google.protobuf.message import DecodeError
    except ImportError:
        raise missing_extra(user, "abb") from None
    return egm_pb2, DecodeError


def duration(way: Matrix, speed: Matrix) -> float:
    """Seconds for the way (n,) deg so that no joint's peak is above `speed` (n,) deg/s, nor above the
    acceleration: peaks of the quintic profile are 15/8 D / T and 10 / sqrt(3) D / T^2."""
    by_speed = 15 / 8 * np.abs(way) / speed
    by_acceleration = np.sqrt(10 / np.sqrt(3) * np.abs(way) / _ACCELERATION)
    return float(np.maximum(by_speed, by_acceleration).max())
