"""The ABB rig against the simulated controller: what it does, what it refuses, and what it never tells."""

import copy
import pickle
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from abb_controller import irc5
from abb_controller import rws_server as resources
from abb_controller.irc5 import RapidData
from abb_controller.sensor_server import CellSensors
from abb_controller.service import SimulatedController
from cells import good_plan
from controllers import unhurried

from zerobeam.experiments.rigs.abb import egm_client as abb_egm
from zerobeam.experiments.rigs.abb import rws_client as abb_rws
from zerobeam.experiments.rigs.abb.driver import MODULE, AbbRig
from zerobeam.experiments.rigs.abb.egm_client import DEAD_MAN_S, Guidance, duration
from zerobeam.experiments.rigs.abb.rws_client import (
    HOST,
    PASSWORD,
    SERVICE,
    USER,
    Caution,
    ControllerAccess,
    RwsSession,
    Secret,
    Signal,
    find_access,
)
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.plan import Plan

pytest.importorskip("abb_robot_client")

WORD, NAME = "Gr8-Pass:wort/é", "some.body"  # not to be found in anything that is told
SPEED_UP = 3


@pytest.fixture(scope="module")
def plan() -> Plan:
    return good_plan(2)


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Requests without their spacing; the controller's limit is that of `controller`. Time-outs that a busy
    machine does not meet by itself."""
    monkeypatch.setattr(abb_rws, "_SPACING_S", 0.0)
    unhurried(monkeypatch)


@pytest.fixture
def controller(plan: Plan, request: pytest.FixtureRequest) -> Iterator[SimulatedController]:
    options = {"requests_a_second": 10**6, **getattr(request, "param", {})}
    with SimulatedController(
        plan, CellFile(), 3, users={NAME: WORD}, speed_up=SPEED_UP, **options
    ) as controller:
        yield controller


def access(controller: SimulatedController, password: str = WORD) -> ControllerAccess:
    return find_access({PASSWORD: password, USER: NAME}, host="127.0.0.1", port=controller.port)


def rig_of(controller: SimulatedController, plan: Plan, **caution: Any) -> AbbRig:
    stated = {"confirm": lambda text: True, "egm_port": controller.egm_port, **caution}
    return AbbRig(plan, access(controller), CellSensors(controller.irc5), Caution(**stated))


@pytest.fixture
def rig(controller: SimulatedController, plan: Plan) -> Iterator[AbbRig]:
    rig = rig_of(controller, plan)
    yield rig
    rig.stop()


def begun(rig: AbbRig) -> AbbRig:
    rig.begin(0, "psd", None)
    return rig


def guided(rig: AbbRig) -> Matrix:
    """A rig whose arm is guided by EGM; (6,) rad where it stands."""
    begun(rig).move(np.full(6, 0.2))
    joints = np.full(6, 0.21)
    rig.move(joints)
    return joints


def test_far_moves_go_by_rapid_and_near_ones_by_egm(controller: SimulatedController, rig: AbbRig) -> None:
    there = controller.irc5
    begun(rig).move(np.full(6, 0.2))
    np.testing.assert_allclose(there.joints_deg(), np.degrees(0.2), atol=1e-4)
    assert there.data.number("zb_speed") == 25.0
    assert not there.egm.active
    rig.move(np.full(6, 0.22))
    np.testing.assert_allclose(rig.joints(), 0.22, atol=np.radians(0.002))
    assert there.egm.active  # and stays on for the next step
    rig.move(np.full(6, 0.5))
    np.testing.assert_allclose(rig.joints(), 0.5, atol=5e-6)
    assert not there.egm.active
    rig.stop()
    rig.stop()
    assert not there.running


def test_the_first_motion_is_rapids_however_small(controller: SimulatedController, rig: AbbRig) -> None:
    begun(rig).move(rig.joints() + 0.001)
    assert not controller.irc5.egm.active
    assert controller.irc5.data.number("zb_done") == 1


def test_the_laser_is_off_after_a_stop(controller: SimulatedController, rig: AbbRig) -> None:
    begun(rig).laser(True)
    assert controller.irc5.signals["zb_laser"] == 1
    rig.stop()
    assert controller.irc5.signals["zb_laser"] == 0


def test_time_goes_on_where_a_resumed_run_was(
    controller: SimulatedController, plan: Plan, rig: AbbRig, tmp_path: Path
) -> None:
    assert rig.now() == 0.0
    last = type("Last", (), {"time_s": 100.0})()
    rig.begin(3, "psd", last)
    assert 100.0 <= rig.now() < 110.0


def test_the_laser_is_the_output_that_is_stated(
    controller: SimulatedController, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    laser = Signal.parse("EtherNetIP/Board_10/doLaser")
    with pytest.raises(
        RigFault, match=r"\(digital output EtherNetIP/Board_10/doLaser\): the controller does not have it"
    ):
        begun(rig_of(controller, plan, laser=laser)).laser(True)
    monkeypatch.setattr(resources, "_DEVICE", "EtherNetIP/Board_10/")
    there = controller.irc5
    there.signals["doLaser"] = 0
    rig = begun(rig_of(controller, plan, laser=laser))
    rig.laser(True)
    assert there.signals == {"zb_laser": 0, "doLaser": 1}
    rig.stop()
    assert there.signals == {"zb_laser": 0, "doLaser": 0}


@pytest.mark.parametrize(
    "text",
    [
        *("", "zb_laser", "Local/DRV_1", "Local//a", "Local/x/", "Local/DRV_1/a/b", "Local/../a"),
        *("Local/DRV_1/a?b", "Local/DRV 1/a", "Local/DRV_1/1a", "Local/DRV_1/ä", "Local/DRV_1/a\n"),
        "Local/DRV_1/" + "a" * 33,
    ],
)
def test_a_signal_that_is_none_is_bad_input(text: str) -> None:
    with pytest.raises(BadInput, match=r"(?s)not a digital output.*NETWORK/UNIT/NAME"):
        Signal.parse(text)
    assert str(Signal.parse("Local/DRV_1/zb_laser")) == str(Signal()) == "Local/DRV_1/zb_laser"


def test_the_profile_keeps_to_speed_and_acceleration() -> None:
    way, speed = np.array([4.0, -1.0, 0, 0, 0, 0]), np.full(6, 15.0)
    seconds = duration(way, speed)
    part = np.linspace(0, 1, 2001)
    place = 4.0 * part**3 * (10 + part * (6 * part - 15))
    velocity = np.gradient(place, part * seconds)
    acceleration = np.gradient(velocity, part * seconds)
    assert velocity.max() <= 15.0 * 1.001
    assert np.abs(acceleration).max() <= abb_egm._ACCELERATION * 1.01
    assert max(velocity.max() / 15.0, np.abs(acceleration).max() / abb_egm._ACCELERATION) > 0.98
    assert duration(way * 100, speed) == pytest.approx(15 / 8 * 400 / 15)


def test_it_asks_once_before_the_first_motion(controller: SimulatedController, plan: Plan) -> None:
    asked: list[str] = []
    rig = begun(rig_of(controller, plan, confirm=lambda text: not asked.append(text), share=0.1))
    assert not asked
    rig.move(np.full(6, 0.1))
    rig.move(np.full(6, 0.3))
    rig.stop()
    (text,) = asked
    assert "10\u00a0% of its joints' top speeds" in text
    assert controller.irc5.data.number("zb_speed") == 10.0


def test_nothing_moves_without_a_yes(controller: SimulatedController, plan: Plan) -> None:
    rig = begun(rig_of(controller, plan, confirm=lambda text: False))
    before = controller.irc5.joints_deg()
    with pytest.raises(RigFault, match="not confirmed; nothing has moved"):
        rig.move(np.full(6, 0.1))
    assert not controller.irc5.running
    np.testing.assert_array_equal(controller.irc5.joints_deg(), before)


@pytest.mark.parametrize("joint", [0, 4])
def test_soft_limits_are_those_of_the_robot_file(
    controller: SimulatedController, plan: Plan, rig: AbbRig, joint: int
) -> None:
    goal = np.zeros(6)
    goal[joint] = plan.robot.upper[joint] + 1e-6
    with pytest.raises(RigFault, match=rf"joint {joint + 1} beyond the soft limits of irb1600 \(-1"):
        begun(rig).move(goal)
    with pytest.raises(RigFault, match="joint 3 beyond"):
        rig.move(np.array([0, 0, np.nan, 0, 0, 0]))
    assert controller.irc5.data.number("zb_done") == 0


@pytest.mark.parametrize(
    ("mode", "state", "found"),
    [
        ("AUTO", "motoroff", "the motors are off: switch them on"),
        ("AUTO", "emergencystop", "an emergency stop is pressed"),
        ("AUTO", "emergencystopreset", "an emergency stop was released"),
        ("AUTO", "guardstop", "the safety chain is open"),
        ("AUTO", "sysfail", "system failure"),
        ("AUTO", "init", "is starting"),
        ("AUTO", "unheard-of", "in the state unheard-of"),
        # It does not ask for motors that cannot be switched on before the key is turned.
        ("MANR", "motoron", r"not in automatic mode \(MANR\): turn the key"),
        ("MANR", "motoroff", r"not in automatic mode \(MANR\): turn the key"),
        ("MANF", "motoron", r"not in automatic mode \(MANF\): turn the key"),
        ("MANF", "motoroff", r"not in automatic mode \(MANF\): turn the key"),
    ],
)
def test_it_refuses_to_begin_in_a_wrong_mode_or_state(
    controller: SimulatedController, rig: AbbRig, mode: Any, state: Any, found: str
) -> None:
    controller.irc5.mode, controller.irc5.state = mode, state
    with pytest.raises(RigFault, match=found):
        begun(rig)


def test_it_refuses_a_program_that_runs_already(controller: SimulatedController, rig: AbbRig) -> None:
    begun(rig)
    controller.irc5.start("forever", "another")
    with pytest.raises(RigFault, match="running already: stop it on the FlexPendant"):
        rig.move(np.full(6, 0.1))
    assert controller.irc5.running  # it is not ours to stop


def test_other_motion_tasks_are_refused(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MultiMove: the library would deactivate them without a word."""
    told = resources._states_of

    def two(there: irc5.Irc5, asked: resources.RwsRequest) -> tuple[resources.ResourceState, ...]:
        states = told(there, asked)
        if asked.path != "rw/rapid/tasks":
            return states
        other = {**states[0].values, "name": "T_ROB2", "active": "On" if active else "Off"}
        return (*states, replace(states[0], title="T_ROB2", values=other))

    monkeypatch.setattr(resources, "_states_of", two)
    active = True
    with pytest.raises(
        RigFault, match=r"other motion tasks are active \(T_ROB2\), this rig drives the arm of"
    ):
        begun(rig).move(np.full(6, 0.1))
    assert not controller.irc5.running
    active = False
    begun(rig).move(np.full(6, 0.1))
    assert controller.irc5.running


def test_a_module_that_is_not_loaded_is_said(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RapidData, "__contains__", lambda data, name: False)
    with pytest.raises(RigFault, match=f"module {MODULE}: the controller does not have it: is it loaded"):
        begun(rig).move(np.full(6, 0.1))


def test_an_emergency_stop_before_guidance_has_begun(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is told, and not that no EGM comes."""
    begun(rig).move(np.full(6, 0.2))
    monkeypatch.setattr(abb_egm, "_FIRST_S", 0.1)
    command = AbbRig._command

    def late(rig: AbbRig, number: int) -> None:
        controller.irc5.press_emergency_stop()
        command(rig, number)

    monkeypatch.setattr(AbbRig, "_command", late)
    with pytest.raises(RigFault, match="an emergency stop is pressed"):
        rig.move(np.full(6, 0.21))


@pytest.mark.long
def test_the_beat_keeps_a_far_move_going(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(irc5, "PATIENCE", 0.4)
    controller.speed_up = 1
    begun(rig).move(np.array([0.7, 0, 0, 0, 0, 0]))
    assert rig.now() > 0.7  # there were ticks on its way
    np.testing.assert_allclose(rig.joints()[0], 0.7, atol=5e-6)


def test_a_stop_that_cannot_be_told_is_a_fault(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    guided(rig)
    monkeypatch.setattr(abb_rws, "ANSWER_S", 0.2)
    controller.pull_cable()
    with pytest.raises(RigFault, match="The arm may move and the laser may shine: press the emergency stop"):
        rig.stop()
    controller.put_cable()


def test_a_fault_of_guidance_is_seen_between_moves(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    guided(rig)
    monkeypatch.setattr(abb_egm, "DEAD_MAN_S", DEAD_MAN_S)
    time.sleep(0.05)
    controller.pull_cable(0.3)
    time.sleep(0.4)
    with pytest.raises(RigFault, match="no feedback by EGM"):
        rig.currents(1)


def test_an_arm_that_stands_still_on_its_way_is_a_fault(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("zerobeam.experiments.rigs.abb.driver._STALL_S", 0.2)
    controller.irc5.speed_ratio = 0
    with pytest.raises(RigFault, match="speed on the FlexPendant 0 %"):
        begun(rig).move(np.full(6, 0.3))
    assert not controller.irc5.running


def test_egm_of_another_robot_is_noticed(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = Guidance.first
    monkeypatch.setattr(Guidance, "first", lambda guidance: first(guidance) + 1.0)
    with pytest.raises(RigFault, match="is --egm-port that of this robot"):
        guided(rig)


def test_egm_that_does_not_come_is_said(
    controller: SimulatedController, plan: Plan, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(abb_egm, "_FIRST_S", 0.1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        free = other.getsockname()[1]
    with pytest.raises(RigFault, match=r"no EGM came for 0.1 s: does the controller's UdpUc device"):
        guided(rig_of(controller, plan, egm_port=free))


def test_a_port_that_is_taken_is_said(controller: SimulatedController, plan: Plan) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", controller.egm_port))
        with pytest.raises(RigFault, match="cannot listen at UDP port"):
            guided(rig_of(controller, plan))


@pytest.mark.parametrize("controller", [{"requests_a_second": 20}], indirect=True, ids=["as it is"])
def test_it_stays_under_the_rate_limit(
    controller: SimulatedController, rig: AbbRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(abb_rws, "_BUSY_S", ())
    monkeypatch.setattr(abb_rws, "_SPACING_S", 1 / 15)
    for _ in range(22):
        rig.joints()
    monkeypatch.setattr(abb_rws, "_SPACING_S", 0.0)
    with pytest.raises(RigFault, match=r"too busy \(503\)"):
        deque(rig.joints() for _ in range(25))


_HEARD: list[tuple[str, Any]] | None = None


def _hook(event: str, arguments: tuple[Any, ...]) -> None:
    if _HEARD is not None and event in ("socket.connect", "socket.bind", "socket.sendto"):
        _HEARD.append((event, arguments[1]))


sys.addaudithook(_hook)


@pytest.fixture
def heard() -> Iterator[list[tuple[str, Any]]]:
    """The addresses of all sockets that are used meanwhile."""
    global _HEARD
    _HEARD = []
    yield _HEARD
    _HEARD = None


def test_it_talks_to_the_address_given_and_to_no_other(
    controller: SimulatedController,
    plan: Plan,
    heard: list[tuple[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.2:9")
    rig = rig_of(controller, plan)
    guided(rig)
    rig.stop()
    assert {"socket.connect", "socket.bind", "socket.sendto"} == {event for event, _ in heard}
    assert {address[0] for _, address in heard} == {"127.0.0.1"}


@contextmanager
def answering(status: int, name: str, value: str) -> Iterator[RwsSession]:
    """A session with a web server that answers its first request so, with one header."""

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(status)
            self.send_header(name, value)
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Answer) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        yield RwsSession(ControllerAccess("127.0.0.1", server.server_port, NAME, Secret(WORD)))


def test_a_redirection_is_not_followed(heard: list[tuple[str, Any]]) -> None:
    elsewhere = answering(302, "Location", "http://127.0.0.2:9/")
    with elsewhere as session, pytest.raises(RigFault, match="HTTP 302"):
        session.ask("looking", lambda rws: rws.get_operation_mode())
    assert {address[0] for event, address in heard if event == "socket.connect"} == {"127.0.0.1"}


def test_other_addresses_have_no_way_out(heard: list[tuple[str, Any]]) -> None:
    session = RwsSession(ControllerAccess("127.0.0.1", 9, NAME, Secret(WORD)))
    with pytest.raises(RigFault, match="InvalidSchema"):
        session.ask("looking", lambda rws: rws._session.get("http://127.0.0.2:9/"))
    with pytest.raises(RigFault, match="cannot be reached"):
        session.ask("looking", lambda rws: rws.get_operation_mode())
    assert [address for event, address in heard] == [("127.0.0.1", 9)]


def test_a_web_server_that_is_no_controller_is_said() -> None:
    page = answering(200, "Content-Type", "text/html")
    with page as session, pytest.raises(RigFault, match="none of Robot Web Services"):
        session.ask("looking", lambda rws: rws.get_operation_mode())


def test_a_secret_shows_itself_to_nobody() -> None:
    secret = Secret(WORD)
    assert secret.reveal() == WORD
    assert (
        WORD
        not in f"{secret} {secret!r} {secret!s} {[secret]} {ControllerAccess('127.0.0.1', 80, NAME, secret)}"
    )
    for written in (pickle.dumps, copy.deepcopy):
        with pytest.raises(TypeError, match="not written anywhere"):
            written(secret)
    with pytest.raises(TypeError, match="not written anywhere"):
        asdict(ControllerAccess("127.0.0.1", 80, NAME, secret))


def test_what_is_stated_goes_before_the_environment() -> None:
    environment = {HOST: "127.0.0.2", USER: "other", PASSWORD: "first"}
    stated = {"host": "localhost", "port": 8080, "user": NAME, "password": WORD}
    for how, expected in (
        ({}, ("127.0.0.2", 80, "other", "first")),
        (stated, ("127.0.0.1", 8080, NAME, WORD)),
    ):
        found = find_access(environment, **how)
        assert (found.address, found.port, found.user, found.password.reveal()) == expected
    assert found.here == "127.0.0.1"


class _Unreadable(Exception):
    pass


def _keyring(monkeypatch: pytest.MonkeyPatch, kept: dict[tuple[str, str], str] | None) -> None:
    def get_password(service: str, user: str) -> str | None:
        if kept is None:
            raise _Unreadable(WORD)
        return kept.get((service, user))

    keyring, errors = ModuleType("keyring"), ModuleType("keyring.errors")
    keyring.get_password, errors.KeyringError = get_password, _Unreadable  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "keyring", keyring)
    monkeypatch.setitem(sys.modules, "keyring.errors", errors)


def test_the_keyring_is_asked_last(monkeypatch: pytest.MonkeyPatch) -> None:
    _keyring(monkeypatch, {(SERVICE, NAME): WORD})
    assert find_access({HOST: "127.0.0.1"}, user=NAME).password.reveal() == WORD
    assert find_access({HOST: "127.0.0.1", PASSWORD: "set"}, user=NAME).password.reveal() == "set"
    with pytest.raises(BadInput, match="no password for this user"):
        find_access({HOST: "127.0.0.1"}, user="nobody")
    _keyring(monkeypatch, None)
    with pytest.raises(BadInput, match="keyring cannot be read") as refused:
        find_access({HOST: "127.0.0.1"}, user=NAME)
    assert WORD not in str(refused.value)
    monkeypatch.setitem(sys.modules, "keyring", None)
    with pytest.raises(BadInput, match=f"set {PASSWORD}, or keep it with: keyring set {SERVICE}"):
        find_access({HOST: "127.0.0.1"})


@pytest.mark.parametrize(
    ("stated", "found"),
    [
        ({}, "address is not stated"),
        ({"host": "no host at all"}, "no IPv4 address"),
        ({"host": "127.0.0.1", "port": 0}, "--port is a TCP port"),
    ],
)
def test_a_wrong_address_is_bad_input(stated: dict[str, Any], found: str) -> None:
    with pytest.raises(BadInput, match=found):
        find_access({PASSWORD: WORD}, **stated)


@pytest.mark.parametrize(
    ("stated", "found"),
    [({"share": 0.0}, "share"), ({"share": 1.1}, "share"), ({"egm_port": 70000}, "--egm-port")],
)
def test_a_wrong_caution_is_bad_input(stated: dict[str, Any], found: str) -> None:
    with pytest.raises(BadInput, match=found):
        Caution(lambda text: True, **stated)


def test_without_the_extra_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "abb_robot_client", None)
    with pytest.raises(BadInput, match=r'pip install "zerobeam\[abb\]"'):
        RwsSession(ControllerAccess("127.0.0.1", 80, NAME, Secret(WORD)))


def test_a_target_without_a_psd_is_bad_input(controller: SimulatedController, plan: Plan) -> None:
    sensors = CellSensors(controller.irc5)
    sensors.psds = {"another": sensors.psds["psd"]}
    with pytest.raises(BadInput, match="a target of the plan has no PSD"):
        AbbRig(plan, access(controller), sensors, Caution(lambda text: True))


def test_the_module_has_the_data_of_the_hand_shake() -> None:
    text = (Path(sys.modules[AbbRig.__module__].__file__ or "").parent / "rapid/zerobeam.mod").read_text()
    assert text.startswith(f"MODULE {MODULE}\n")
    data = RapidData()
    for name in data.names:
        (line,) = [line.strip() for line in text.splitlines() if f" {name}:=" in line and "PERS" in line]
        kind, value = line.removeprefix("PERS ").rstrip(";").split(f" {name}:=")
        assert kind == data.type_of(name)
        fresh = data.text(name)
        data.written(name, value)
        assert data.text(name) == fresh
    lines = [line.split("!")[0].split() for line in text.splitlines()]
    for word in ("MODULE", "PROC", "TRAP", "WHILE", "TEST"):
        assert sum(f"END{word}" in line for line in lines) == sum(word in line[:2] for line in lines) > 0
