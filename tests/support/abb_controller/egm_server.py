"""The UDP side: EgmRobot to the client every cycle, EgmSensor back.

Facts from the application manual of Externally Guided Motion (3HAC073319-001) and `egm.proto`: the
controller sends first, to the address of its UdpUc device; joints are degrees; `tm` is ms of the
controller; each side counts its messages. Not public, and chosen here: an EgmSensor whose number is not
above the last one's is dropped, and while the program is stopped within guidance, EgmRobot goes on and says
so. The low-pass filter of EGMActJoint is not simulated, nor are Cartesian poses in EgmRobot (which are
optional).
"""

from __future__ import annotations

import contextlib
import heapq
import itertools
import socket
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from zerobeam.experiments.rigs.abb.egm_client import egm_messages
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput

_LARGEST = 65536
Mci = Literal["MCI_STOPPED", "MCI_RUNNING", "MCI_ERROR"]


class Egm:
    """One channel, between a socket of the controller (`address`) and the client's port. Times are
    seconds."""

    def __init__(self, host: str, client: tuple[str, int], faults: PacketFaults, seed: int) -> None:
        self._messages, self._unreadable = egm_messages("EGM")
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((host, 0))
        self.client = client
        self.plugged = True
        self.mci: Mci = "MCI_STOPPED"
        self._out, self._in = (PacketLine(faults, rng) for rng in np.random.default_rng([seed, 2]).spawn(2))
        self._sent = 0
        self.end()

    @property
    def address(self) -> tuple[str, int]:
        host, port = self._socket.getsockname()
        return str(host), int(port)

    def begin(self, now: float) -> None:
        """EGMActJoint and EGMRunJoint: from now on it sends where the arm is, and receives where to go."""
        self.end()
        self.active, self._heard, self.mci = True, now, "MCI_RUNNING"

    def end(self, mci: Mci = "MCI_STOPPED") -> None:
        self.active, self.mci = False, mci
        self.reference_deg: Matrix | None = None
        self._last = -1
        self._heard = 0.0

    def silence(self, now: float) -> float:
        """Seconds since the last EgmSensor, or since guidance began."""
        return now - self._heard

    def receive(self, now: float) -> None:
        """Take what has come from the client."""
        while True:
            try:
                packet, source = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except ConnectionError:  # nobody listened at the client's port to what was sent before
                continue
            if source == self.client and self.plugged:
                self._in.send(packet, now)
        for packet in self._in.arrived(now):
            self._take(packet, now)

    def tell(
        self,
        now: float,
        joints_deg: Matrix,
        planned_deg: Matrix,
        *,
        motors_on: bool,
        running: bool,
        met: bool,
    ) -> None:
        """Send an EgmRobot, if guidance is under way; `met` where the arm is at the last reference."""
        if self.active:
            message = self._robot(now, joints_deg, planned_deg, motors_on, running)
            message.mciConvergenceMet = met
            self._out.send(message.SerializeToString(), now)
        for packet in self._out.arrived(now):
            if self.plugged:
                with contextlib.suppress(OSError):  # UDP: whether anyone listens is not the sender's concern
                    self._socket.sendto(packet, self.client)

    def close(self) -> None:
        self._socket.close()

    def _take(self, packet: bytes, now: float) -> None:
        sensor = self._messages.EgmSensor()
        try:
            sensor.ParseFromString(packet)
        except self._unreadable:
            return
        if not self.active or sensor.header.seqno <= self._last:
            return
        self._last, self._heard = sensor.header.seqno, now
        joints = np.array(sensor.planned.joints.joints, dtype=float)
        if joints.shape == (6,) and np.isfinite(joints).all():
            self.reference_deg = joints

    def _robot(
        self, now: float, joints_deg: Matrix, planned_deg: Matrix, motors_on: bool, running: bool
    ) -> Any:
        pb = self._messages
        message = pb.EgmRobot()
        header = message.header
        header.seqno, header.tm, header.mtype = self._sent, int(now * 1000) % 2**32, pb.EgmHeader.MSGTYPE_DATA
        self._sent += 1
        for part, joints in ((message.feedBack, joints_deg), (message.planned, planned_deg)):
            part.joints.joints.extend(joints.tolist())
            part.time.sec, part.time.usec = int(now), int(now % 1 * 1e6)
        motor, execution = pb.EgmMotorState, pb.EgmRapidCtrlExecState
        message.motorState.state = motor.MOTORS_ON if motors_on else motor.MOTORS_OFF
        message.rapidExecState.state = execution.RAPID_RUNNING if running else execution.RAPID_STOPPED
        mci = self.mci if running else "MCI_STOPPED"
        message.mciState.state = getattr(pb.EgmMCIState, mci)
        return message


@dataclass(frozen=True)
class PacketFaults:
    """Shares of the packets, each way: `lost`, `duplicated`, `late` by `late_s` seconds, `reordered`
    (behind the packet that was sent next)."""

    lost: float = 0.0
    duplicated: float = 0.0
    late: float = 0.0
    reordered: float = 0.0
    late_s: float = 0.02

    def __post_init__(self) -> None:
        for name in ("lost", "duplicated", "late", "reordered"):
            share = getattr(self, name)
            if not 0 <= share <= 1:
                raise BadInput(f"{name} is a share of the packets", found=share, allowed="0 to 1")


class PacketLine:
    """One direction. What is sent comes out of `arrived` when its time has come; times are seconds."""

    def __init__(self, faults: PacketFaults, rng: np.random.Generator) -> None:
        self._faults, self._rng = faults, rng
        self._under_way: list[tuple[float, int, bytes]] = []
        self._held: list[bytes] = []
        self._count = itertools.count()

    def send(self, packet: bytes, now: float) -> None:
        faults = self._faults
        # Four draws for each packet, whatever becomes of it: one fault does not move the draws of another.
        lost, duplicated, late, reordered = self._rng.random(4)
        behind, self._held = self._held, []
        if lost >= faults.lost:
            copies = 2 if duplicated < faults.duplicated else 1
            if reordered < faults.reordered:
                self._held = [packet] * copies
            else:
                due = now + (faults.late_s if late < faults.late else 0.0)
                self._push([packet] * copies, due)
        self._push(behind, now)

    def arrived(self, now: float) -> list[bytes]:
        """The packets that have come by now, in the order of arrival."""
        packets = []
        while self._under_way and self._under_way[0][0] <= now:
            packets.append(heapq.heappop(self._under_way)[2])
        return packets

    def _push(self, packets: list[bytes], due: float) -> None:
        for packet in packets:
            heapq.heappush(self._under_way, (due, next(self._count), packet))
