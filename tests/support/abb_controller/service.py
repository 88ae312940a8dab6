"""The simulated controller as a service: its servers, clock, cable and default plan."""

import hashlib
import socket
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np

from abb_controller.cell_behind import CellBehind
from abb_controller.egm_server import Egm, PacketFaults
from abb_controller.irc5 import CYCLE, Irc5
from abb_controller.rws_server import REQUESTS_A_SECOND, RwsServer
from abb_controller.sensor_server import SensorServer
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.errors import BadInput
from zerobeam.model.files.from_arrays import Laser
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot

LOOPBACK = "127.0.0.1"
DEFAULT_USERS = {"Default User": "robotics"}  # as every IRC5 leaves the factory
_LATE = 0.1  # s: what is missed by more than that is not made up for
_POLL = 0.05  # s: how soon a server notices that it is to end


class SimulatedController:
    """An IRC5 with the cell of a plan behind it, from `with` to its end.

    `port` is that of Robot Web Services, `egm_port` the client's port that EgmRobot goes to (at `client`),
    and `sensor_port` that of the sensors (`sensor_server`); 0 takes any that is free. `bind` is the
    controller's own address. With a `speed_up` of k the arm goes through k of its cycles in one of real
    time; messages and time-outs stay in real time. `irc5` is the state of it, `irc5.cell` the cell with its
    sensors.
    """

    def __init__(
        self,
        plan: Plan,
        cell: CellFile,
        seed: int,
        *,
        port: int = 0,
        egm_port: int = 0,
        sensor_port: int = 0,
        bind: str = LOOPBACK,
        client: str = LOOPBACK,
        users: dict[str, str] | None = None,
        packet_faults: PacketFaults | None = None,
        speed_up: int = 1,
        requests_a_second: int = REQUESTS_A_SECOND,
    ) -> None:
        behind = CellBehind(plan, cell, seed)
        self.egm_port = egm_port or _free_udp_port(client)
        self.speed_up = speed_up
        try:
            with ExitStack() as opened:
                self._egm = Egm(bind, (client, self.egm_port), packet_faults or PacketFaults(), seed)
                opened.callback(self._egm.close)
                self.irc5 = Irc5(behind, self._egm)
                self._rws = RwsServer((bind, port), self.irc5, users or DEFAULT_USERS, requests_a_second)
                opened.callback(self._rws.server_close)
                self._sensors = SensorServer((bind, sensor_port), self.irc5)
                opened.callback(self._sensors.server_close)
                self._opened = opened.pop_all()
        except OSError as error:
            raise BadInput(
                "the controller cannot listen there",
                found=f"{bind}, ports {port} and {sensor_port}: {error.strerror}",
                remedy="take another --port and --sensor-port (0: any that is free)",
            ) from None
        self._over = threading.Event()
        self._plug: threading.Timer | None = None
        self._threads = [threading.Thread(target=self._turn, name="controller-cycle", daemon=True)]
        for server, name in ((self._rws, "controller-rws"), (self._sensors, "controller-sensors")):
            serve = threading.Thread(target=server.serve_forever, args=(_POLL,), name=name, daemon=True)
            self._threads.append(serve)

    @property
    def port(self) -> int:
        return int(self._rws.server_address[1])

    @property
    def sensor_port(self) -> int:
        return int(self._sensors.server_address[1])

    @property
    def url(self) -> str:
        return f"http://{self._rws.server_address[0]!s}:{self.port}"

    def pull_cable(self, seconds: float | None = None) -> None:
        """Nothing comes through for so long (None: for good); what was sent by TCP waits, UDP is lost."""
        self._rws.plugged.clear()
        self._egm.plugged = False
        if seconds is not None:
            self._plug = threading.Timer(seconds, self.put_cable)
            self._plug.start()

    def put_cable(self) -> None:
        self._egm.plugged = True
        self._rws.plugged.set()

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._over.set()
        if self._plug is not None:
            self._plug.cancel()
        self.put_cable()
        for server in (self._rws, self._sensors):
            server.shutdown()
        for thread in self._threads:
            thread.join()
        self._opened.close()

    def _turn(self) -> None:
        begin = due = time.perf_counter()
        while not self._over.is_set():
            self.irc5.turn(time.perf_counter() - begin, self.speed_up)
            due += CYCLE
            late = time.perf_counter() - due
            if late > _LATE:
                due += late
            elif late < 0:
                time.sleep(-late)


def _free_udp_port(host: str) -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


_TARGET_MM = (900.0, 0.0, 0.0)
_HEADER = {
    "robot": "irb1600",
    "tool": Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)).content(),
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": list(_TARGET_MM)}},
}


def own_plan() -> Plan:
    """The plan without a file: the IRB1600, its Y-Pattern and one PSD in front of it."""
    header, robot = Header.model_validate(_HEADER), load_robot("irb1600", Path())
    postures = pattern(header, robot, np.array(_TARGET_MM), "y")
    count = len(postures)
    digest = hashlib.sha256(header.model_dump_json().encode()).hexdigest()
    lines = tuple(range(1, count + 1))
    shots = planned(postures * robot.display, ("psd",) * count)
    return Plan(header, robot, shots, lines, Path("own plan"), digest, ())
