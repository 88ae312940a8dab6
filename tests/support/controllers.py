"""Simulated controllers for the tests, and the client library that talks to them."""

import functools
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from abb_controller import irc5
from abb_controller.service import SimulatedController
from cells import good_plan

from zerobeam.experiments.procedure import beam_ports
from zerobeam.experiments.rigs.abb import egm_client as abb_egm
from zerobeam.experiments.rigs.abb import rws_client as abb_rws
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan

client_rws = pytest.importorskip("abb_robot_client.rws")
client_egm = pytest.importorskip("abb_robot_client.egm")

NAME = "zerobeam_egm/"
FAST = 5  # the arm's cycles in one of real time
UNLIMITED = 10_000  # requests a second: the limit has a test of its own, and the others no time to lose
# s, for time-outs that are not what a test is about: a busy machine may well be late by 0.1 s.
PATIENT = 5.0


@functools.cache
def plan() -> Plan:
    return good_plan(4)


def controller(seed: int = 0, cell: dict[str, Any] | None = None, **options: Any) -> SimulatedController:
    content = {"arm": {"offsets_deg": {"delta2": 1.0}}, **(cell or {})}
    options = {"requests_a_second": UNLIMITED, **options}
    return SimulatedController(plan(), CellFile.model_validate(content), seed, **options)


def unhurried(patch: pytest.MonkeyPatch) -> None:
    """Time-outs that a busy machine does not meet by itself: the dead man's, RAPID's, that of an answer."""
    patch.setattr(abb_egm, "DEAD_MAN_S", PATIENT)
    patch.setattr(irc5, "PATIENCE", PATIENT)
    patch.setattr(abb_rws, "ANSWER_S", PATIENT)


def quick(patch: pytest.MonkeyPatch) -> None:
    """Without waits that a test learns nothing from: no spacing, brisk guidance, no settling."""
    patch.setattr(abb_rws, "_SPACING_S", 0.0)
    patch.setattr(abb_egm, "_ACCELERATION", 500.0)
    patch.setattr(abb_egm, "_STILL_S", 0.03)
    patch.setattr(beam_ports, "_SETTLE_S", 0.0)


class Watched:
    """A controller that is looked at: `lookers` are called after each of its turns, in its own thread, with
    its time in s."""

    def __init__(self, controller: SimulatedController) -> None:
        self.lookers: list[Callable[[float], None]] = []
        self._turn = controller.irc5.turn
        controller.irc5.turn = self._watched  # type: ignore[method-assign]

    def _watched(self, now: float, cycles: int = 1) -> None:
        self._turn(now, cycles)
        for look in tuple(self.lookers):
            look(now)


class Client(client_rws.RWS):  # type: ignore[misc]
    """The library's client, and the hand-shake of the module."""

    def number(self, name: str) -> float:
        return float(self.get_rapid_variable_num(NAME + name))

    def write(self, name: str, value: object) -> None:
        self.set_rapid_variable(NAME + name, str(value))

    def run(self) -> None:
        """Start the program, and wait until it has begun."""
        self.write("zb_command", -1)
        self.resetpp()
        self.start()
        self.until(lambda: self.number("zb_command") == 0)

    def begin(self, command: int) -> None:
        self.write("zb_command", command)
        self.write("zb_start", "TRUE")

    def send(self, joints_deg: Matrix, speed: float = 100.0) -> None:
        """Begin a move."""
        target = client_rws.JointTarget(np.radians(joints_deg), np.radians(np.full(6, 9e9)))
        self.set_rapid_variable_jointtarget(NAME + "zb_target", target)
        self.write("zb_speed", speed)
        self.begin(1)

    def wait(self, done: float) -> None:
        """Until so many commands are done, and keep the beat until then."""

        def over() -> bool:
            if self.number("zb_done") == done:
                return True
            self.write("zb_command", 1)
            return False

        self.until(over)

    @staticmethod
    def until(happened: Any, seconds: float = 10.0) -> None:
        end = time.monotonic() + seconds
        while not happened():
            assert time.monotonic() < end, "it did not happen"
            time.sleep(0.02)


class Guide(client_egm.EGM):  # type: ignore[misc]
    """The library's end of EGM, on loopback alone."""

    def __init__(self, port: int) -> None:
        super().__init__(0)
        self.socket.close()
        self.socket = client_egm.socket.socket(client_egm.socket.AF_INET, client_egm.socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))

    def lead(self, goal_deg: Matrix, seconds: float, answering: bool = True) -> list[tuple[float, Any]]:
        """Answer every message with the goal for so long: (time of arrival, state) of all."""
        end, heard = time.perf_counter() + seconds, []
        while time.perf_counter() < end:
            came, state = self.receive_from_robot(0.02)
            if came:
                heard.append((time.perf_counter(), state))
                if answering:
                    self.send_to_robot(goal_deg)
        return heard
