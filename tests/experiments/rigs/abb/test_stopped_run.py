"""A run on a controller that is stopped by Ctrl-C or a request to end: the arm stops on its way, at once."""

import os
import signal
import subprocess
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from abb_controller.sensor_server import CellSensors
from abb_controller.service import SimulatedController
from asked_to_end import lost, without_reminders
from cells import good_plan
from child import ZEROBEAM, child
from command_line import plan_file
from controllers import UNLIMITED, Client, Watched, quick, unhurried

from zerobeam.experiments.procedure.beam_ports import BeamPorts
from zerobeam.experiments.procedure.events import RunEvent, SpotSeen
from zerobeam.experiments.procedure.session import InTurn, Session
from zerobeam.experiments.rigs.abb.driver import AbbRig
from zerobeam.experiments.rigs.abb.rws_client import PASSWORD, Caution, find_access
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.studies.cell import MemoryJournal
from zerobeam.interruption import requested, stoppable
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan

pytest.importorskip("abb_robot_client")

# An interruption that comes while the HTTP library opens a connection leaves its socket to the collector.
pytestmark = [
    pytest.mark.filterwarnings("ignore:unclosed <socket:ResourceWarning"),
    pytest.mark.filterwarnings("ignore:Exception ignored in:pytest.PytestUnraisableExceptionWarning"),
]

CELL = CellFile.model_validate({"camera": None, "psd": {"placed": {"psd": {"centre_mm": [900.0, 0.0, 0.0]}}}})


@pytest.fixture(scope="module")
def plan() -> Plan:
    return good_plan(2)


@pytest.fixture
def there(plan: Plan) -> Iterator[SimulatedController]:
    with SimulatedController(plan, CELL, 3, requests_a_second=UNLIMITED) as controller:
        yield controller


def rig_of(there: SimulatedController, plan: Plan) -> AbbRig:
    access = find_access({PASSWORD: "robotics"}, host="127.0.0.1", port=there.port)
    caution = Caution(lambda text: True, share=1.0, egm_port=there.egm_port)
    return AbbRig(plan, access, CellSensors(there.irc5), caution)


def once(there: SimulatedController, so: Callable[[], bool], what: Callable[[], None]) -> None:
    """It is done once it is so, by the thread of the controller."""
    watched = Watched(there)

    def look(now: float) -> None:
        if so():
            watched.lookers.clear()
            what()

    watched.lookers.append(look)


def at_rest(there: SimulatedController) -> None:
    """The program is stopped, the laser off, and the arm stands where it has braked."""
    assert not there.irc5.running
    assert there.irc5.signals == {"zb_laser": 0}
    Client.until(lambda: there.irc5.standing)


def way_left(there: SimulatedController) -> float:
    """deg: of the last move by RAPID."""
    return float(np.abs(there.irc5.data.joints_deg("zb_target") - there.irc5.joints_deg()).max())


def on_a_far_move(there: SimulatedController, began: Matrix) -> bool:
    return not there.irc5.egm.active and bool(np.abs(there.irc5.joints_deg() - began).max() > 5)


def on_a_servo_step(there: SimulatedController, began: Matrix) -> bool:
    return there.irc5.egm.active and there.irc5.egm.reference_deg is not None and not there.irc5.standing


@pytest.mark.parametrize("while_", [on_a_far_move, on_a_servo_step])
def test_the_arm_stops_on_its_way(
    there: SimulatedController, plan: Plan, monkeypatch: pytest.MonkeyPatch, while_: Callable[..., bool]
) -> None:
    quick(monkeypatch)
    unhurried(monkeypatch)
    began, goals, main = there.irc5.joints_deg(), begun_after(monkeypatch), threading.main_thread().ident
    assert main is not None
    session = Session(BeamPorts(plan, rig_of(there, plan), lambda event: None), MemoryJournal(), InTurn(2))
    once(there, lambda: while_(there, began), lambda: signal.pthread_kill(main, signal.SIGINT))
    with stoppable(), pytest.raises(KeyboardInterrupt):
        session.carry_out()
    at_rest(there)
    assert goals == []
    if while_ is on_a_far_move:
        assert way_left(there) > 1


@pytest.mark.long
def test_a_request_that_is_lost_is_heard_before_the_next_step(
    there: SimulatedController, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    quick(monkeypatch)
    unhurried(monkeypatch)
    goals, steps = begun_after(monkeypatch), []

    def told(event: RunEvent) -> None:
        if isinstance(event, SpotSeen):
            steps.append(event.off_mm)
            if len(steps) == 2:
                lost()

    with without_reminders(), stoppable(), pytest.raises(KeyboardInterrupt):
        Session(BeamPorts(plan, rig_of(there, plan), told), MemoryJournal(), InTurn(2)).carry_out()
    at_rest(there)
    assert (goals, len(steps)) == ([], 2)


def begun_after(patch: pytest.MonkeyPatch) -> list[str]:
    """The motions, by RAPID or guided, that begin after a request."""
    found: list[str] = []
    for name in ("_drive", "_guide"):
        begin = getattr(AbbRig, name)

        def watched(rig: AbbRig, goal: Matrix, begin: Any = begin, name: str = name) -> None:
            if requested():
                found.append(name)
            begin(rig, goal)

        patch.setattr(AbbRig, name, watched)
    return found


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.long)])
@pytest.mark.parametrize("while_", [on_a_far_move, pytest.param(on_a_servo_step, marks=pytest.mark.long)])
def test_the_command_stops_the_arm(
    there: SimulatedController,
    plan: Plan,
    tmp_path: Path,
    how: signal.Signals,
    while_: Callable[..., bool],
) -> None:
    """As a person sees it: another process, and the run can be resumed."""
    file = tmp_path / "run.jsonl"
    ports = {"--port": there.port, "--egm-port": there.egm_port, "--sensor-port": there.sensor_port}
    own = [str(plan_file(tmp_path / "plan.yaml", plan)), "-o", str(file), "--rig", "abb", "--yes"]
    stated = [word for name, port in ports.items() for word in (name, str(port))]
    began = there.irc5.joints_deg()
    environment = {**os.environ, PASSWORD: "robotics"}
    asked = [*ZEROBEAM, "run", *own, "--host", "127.0.0.1", "--speed", "1", *stated]
    with child(asked, stderr=subprocess.PIPE, env=environment) as process:
        once(there, lambda: while_(there, began), lambda: process.send_signal(how))
        out, err = process.communicate(timeout=120)
    assert (process.returncode, out, err.splitlines()[-1:]) == (130, "", ["stopped"])
    assert "--resume" in err
    assert "Traceback" not in err
    at_rest(there)
    if while_ is on_a_far_move:
        assert way_left(there) > 1
    assert file.read_bytes().count(b"\n") == 1  # the header, whole
