"""The simulated IRC5 by Robot Web Services, asked by the client library that drives real ones."""

import json
import re
import time
from collections.abc import Callable, Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from abb_controller.irc5 import PATIENCE
from abb_controller.rws_server import REQUESTS_A_SECOND
from abb_controller.service import SimulatedController
from controllers import FAST, NAME, Client, client_rws, controller, plan

from zerobeam.model.errors import BadInput

requests = pytest.importorskip("requests")


@pytest.fixture
def irc5() -> Iterator[SimulatedController]:
    with controller(speed_up=FAST) as simulated:
        yield simulated


@pytest.fixture
def client(irc5: SimulatedController) -> Iterator[Client]:
    own = Client(irc5.url)
    yield own
    own.close()


def code(call: Callable[[], Any]) -> int:
    with pytest.raises(client_rws.ABBException) as caught:
        call()
    return int(caught.value.code)


def test_it_says_how_it_is(client: Client) -> None:
    assert client.get_controller_state() == "motoron"
    assert client.get_operation_mode() == "AUTO"
    assert client.get_speedratio() == 100
    assert client.get_execution_state() == ("stopped", "forever")
    assert client.get_tasks()["T_ROB1"].motiontask
    (identity,) = client._do_get("ctrl/identity")["_embedded"]["_state"]
    assert identity["ctrl-type"] == "Virtual Controller"


def test_a_wrong_password_is_unauthorised(irc5: SimulatedController) -> None:
    wrong = Client(irc5.url, password="not this")
    with pytest.raises(Exception, match="401"):
        wrong.get_controller_state()
    assert not wrong._session.cookies
    wrong._session.close()
    answer = requests.get(irc5.url + "/rw/panel/opmode")
    assert answer.status_code == 401
    assert 'realm="validusers@robapi.abb"' in answer.headers["WWW-Authenticate"]
    assert "opmode" not in answer.text


def test_an_overheard_authorisation_is_good_once(irc5: SimulatedController) -> None:
    with requests.Session() as session:
        auth = requests.auth.HTTPDigestAuth("Default User", "robotics")
        first = session.get(irc5.url + "/rw/panel/opmode", auth=auth)
    assert first.status_code == 200
    again = {"Authorization": first.request.headers["Authorization"]}
    assert requests.get(irc5.url + "/rw/panel/opmode", headers=again).status_code == 401


def test_cookies_make_one_session(client: Client, irc5: SimulatedController) -> None:
    client.get_controller_state()
    names = {cookie.name: cookie.value for cookie in client._session.cookies}
    assert set(names) == {"-http-session-", "ABBCX"}
    client.get_controller_state()
    assert {cookie.name: cookie.value for cookie in client._session.cookies} == names
    # They are enough, without any password, until the session is left.
    with requests.Session() as bare:
        bare.cookies.update(names)
        assert bare.get(irc5.url + "/rw/panel/opmode").status_code == 200
        client.logout()
        assert bare.get(irc5.url + "/rw/panel/opmode").status_code == 401


def test_more_than_twenty_requests_a_second_are_turned_away() -> None:
    with controller(requests_a_second=REQUESTS_A_SECOND) as limited:
        hasty = Client(limited.url)
        for _ in range(19):  # and the one that was asked for the password
            hasty.get_controller_state()
        with pytest.raises(Exception, match="Internal Server Error"):  # the library's words for 503
            hasty.get_controller_state()
        assert hasty._session.get(limited.url + "/rw/panel/opmode").status_code == 503
        time.sleep(1.0)
        assert hasty.get_controller_state() == "motoron"
        hasty.close()
    assert REQUESTS_A_SECOND == 20


def test_there_are_seventy_sessions(irc5: SimulatedController) -> None:
    def opmode() -> int:
        auth = requests.auth.HTTPDigestAuth("Default User", "robotics")
        return int(requests.get(irc5.url + "/rw/panel/opmode", auth=auth).status_code)

    first = Client(irc5.url)
    first.get_controller_state()
    assert [opmode() for _ in range(69)] == [200] * 69
    assert opmode() == 503
    first.close()
    assert opmode() == 200


def test_json_and_xhtml_say_the_same(client: Client, irc5: SimulatedController) -> None:
    client.get_controller_state()
    url = irc5.url + "/rw/motionsystem/mechunits/ROB_1/jointtarget"
    as_json, as_xml = client._session.get(url + "?json=1"), client._session.get(url)
    assert as_json.headers["Content-Type"] == "application/json"
    assert as_xml.headers["Content-Type"] == "application/xhtml+xml"
    (state,) = as_json.json()["_embedded"]["_state"]
    space = "{http://www.w3.org/1999/xhtml}"
    (item,) = ElementTree.fromstring(as_xml.text).iter(space + "li")
    spans = {span.get("class"): span.text for span in item.iter(space + "span")}
    assert {**spans, "_type": item.get("class"), "_title": item.get("title")} == state
    assert state["_type"] == "ms-jointtarget"
    missing = client._session.get(irc5.url + "/rw/rapid/symbol/data/RAPID/T_ROB1/x/y")
    assert missing.status_code == 400
    assert '<span class="code">-1073414146</span>' in missing.text


def test_joints_go_there_and_back(client: Client) -> None:
    goal = np.degrees(plan().postures[0])
    client.run()
    client.send(goal)
    client.wait(1)
    assert client.number("zb_error") == 0
    read = client.get_jointtarget().robax
    # The target is written in four decimals, the encoder's step is 0.0002 deg.
    assert np.abs(read - goal).max() < 2e-4
    assert np.abs(read).max() > 10
    client.send(np.zeros(6))
    client.wait(2)
    assert np.abs(client.get_jointtarget().robax).max() < 2e-4


def test_data_are_written_and_read_in_their_types(client: Client) -> None:
    client.write("zb_speed", 12.5)
    assert client.number("zb_speed") == 12.5
    client.write("zb_start", "TRUE")
    assert client.get_rapid_variable(NAME + "zb_start") == "TRUE"
    joints = np.array([1.25, -2.5, 3.0, -100.125, 5.0, 359.5])
    target = client_rws.JointTarget(np.radians(joints), np.radians(np.full(6, 9e9)))
    client.set_rapid_variable_jointtarget(NAME + "zb_target", target)
    assert "[9E+09,9E+09" in client.get_rapid_variable(NAME + "zb_target")
    assert np.allclose(np.degrees(client.get_rapid_variable_jointtarget(NAME + "zb_target").robax), joints)
    assert client.get_rapid_variable("ZEROBEAM_EGM/ZB_speed") == "12.5"


@pytest.mark.parametrize(
    ("name", "value"),
    [("zb_speed", "fast"), ("zb_speed", "nan"), ("zb_start", "1"), ("zb_target", "[[1,2],[3,4]]")],
)
def test_a_value_of_another_type_is_refused(client: Client, name: str, value: str) -> None:
    before = client.get_rapid_variable(NAME + name)
    assert code(lambda: client.write(name, value)) == -1073445879
    assert client.get_rapid_variable(NAME + name) == before


def test_what_there_is_not_is_refused(client: Client) -> None:
    assert code(lambda: client.number("zb_other")) == -1073414146
    assert code(lambda: client.get_rapid_variable("other/zb_speed")) == -1073414146
    assert code(lambda: client.get_digital_io("other")) == -1073445866
    assert code(lambda: client._do_get("rw/nothing")) == -1073414146


def test_execution_starts_and_stops(client: Client, irc5: SimulatedController) -> None:
    client.start(cycle="once")
    assert client.get_execution_state() == ("running", "once")
    client.stop()
    client.run()
    assert code(client.start) == -1073442809
    assert code(client.resetpp) == -1073442809
    client.send(np.full(6, 30.0), speed=5)
    client.until(lambda: np.abs(irc5.irc5.joints_deg()).max() > 1)
    client.stop()
    client.until(lambda: irc5.irc5.standing)
    stands = irc5.irc5.joints_deg()
    assert 1 < np.abs(stands).max() < 29
    time.sleep(0.1)
    assert (irc5.irc5.joints_deg() == stands).all()
    # The path is regained by a new start, and forgotten by a reset of the program pointer.
    client.start()
    client.until(lambda: np.abs(irc5.irc5.joints_deg() - stands).max() > 1)
    client.stop()
    client.resetpp()
    client.start()
    client.until(lambda: irc5.irc5.standing)
    stands = irc5.irc5.joints_deg()
    time.sleep(0.1)
    assert (irc5.irc5.joints_deg() == stands).all()
    assert np.abs(stands).max() < 29


def test_it_does_not_start_in_manual_mode(client: Client, irc5: SimulatedController) -> None:
    irc5.irc5.turn_key("MANR")
    assert client.get_operation_mode() == "MANR"
    assert client.get_controller_state() == "motoroff"
    assert code(client.start) == -1073445860
    assert code(lambda: client.set_controller_state("motoron")) == -1073445860
    assert code(lambda: client.write("zb_speed", 20)) == -1073445881
    assert code(lambda: client.set_digital_io("zb_laser", True)) == -1073445881
    assert client.number("zb_speed") == 10
    assert client.get_execution_state().ctrlexecstate == "stopped"


def test_manual_mode_lets_write_whom_the_pendant_has_granted_it(
    client: Client, irc5: SimulatedController
) -> None:
    def status() -> str:
        return str(client._do_get("users/rmmp/poll")["_embedded"]["_state"][0]["status"])

    irc5.irc5.turn_key("MANR")
    assert status() == "NO SUCH REQUEST"
    client._do_post("users/rmmp", {"privilege": "modify"})
    assert status() == "PENDING"
    assert code(lambda: client.write("zb_speed", 20)) == -1073445881
    irc5.irc5.grant_remote()
    assert status() == "GRANTED"
    client.write("zb_speed", 20)
    assert client.number("zb_speed") == 20
    assert code(client.start) == -1073445860


def test_it_does_not_start_with_the_motors_off(client: Client) -> None:
    client.set_controller_state("motoroff")
    assert client.get_controller_state() == "motoroff"
    assert code(client.start) == -1073442809
    client.set_controller_state("motoron")
    client.start()
    assert client.get_execution_state().ctrlexecstate == "running"


def test_an_emergency_stop_ends_a_move_on_its_way(client: Client, irc5: SimulatedController) -> None:
    client.run()
    client.send(np.full(6, 30.0), speed=5)
    client.until(lambda: np.abs(irc5.irc5.joints_deg()).max() > 1)
    irc5.irc5.press_emergency_stop()
    client.until(lambda: irc5.irc5.standing)
    assert np.abs(irc5.irc5.joints_deg()).max() < 29
    assert client.get_controller_state() == "emergencystop"
    assert client.get_execution_state().ctrlexecstate == "stopped"
    assert code(client.start) == -1073442809
    assert code(lambda: client.set_controller_state("motoron")) == -1073445881
    irc5.irc5.release_emergency_stop()
    assert client.get_controller_state() == "emergencystopreset"
    assert code(client.start) == -1073442809
    client.set_controller_state("motoron")
    client.start()
    client.write("zb_speed", 100)
    client.wait(1)
    assert np.abs(client.get_jointtarget().robax - 30).max() < 2e-4


def test_a_client_that_falls_silent_ends_a_move(client: Client, irc5: SimulatedController) -> None:
    client.run()
    began = time.monotonic()
    client.send(np.full(6, 60.0), speed=1)
    client.until(lambda: not irc5.irc5.running)  # and no beat meanwhile
    assert PATIENCE < time.monotonic() - began < 3 * PATIENCE
    client.until(lambda: irc5.irc5.standing)
    assert (client.number("zb_done"), client.number("zb_error")) == (0, 1)
    assert 0 < np.abs(irc5.irc5.joints_deg()).max() < 59
    assert client.get_execution_state().ctrlexecstate == "stopped"
    client.run()
    client.send(np.zeros(6))
    client.wait(1)


def test_a_target_outside_the_limits_stops_the_program(client: Client, irc5: SimulatedController) -> None:
    client.run()
    client.send(np.array([0, 130.0, 0, 0, 0, 0]))
    client.until(lambda: not irc5.irc5.running)
    assert client.get_execution_state().ctrlexecstate == "stopped"
    assert client.number("zb_done") == 0
    assert (client.get_jointtarget().robax == 0).all()
    assert "joint 2" in irc5.irc5.reason


def test_the_speed_ratio_slows_a_move(client: Client, irc5: SimulatedController) -> None:
    def seconds(ratio: int, goal: float, done: int) -> float:
        client.set_speedratio(ratio)
        client.send(np.full(6, goal), speed=20)
        before = irc5.irc5.seconds
        client.until(lambda: irc5.irc5.data.number("zb_done") == done)
        return irc5.irc5.seconds - before

    client.run()
    whole, half = seconds(100, 20.0, 1), seconds(50, 0.0, 2)
    # 20 deg at 20 % of the slowest joint's 150 deg/s: 2/3 s, and acceleration; the hand-shake takes a little.
    assert whole == pytest.approx(20 / 30 + 30 / 300, abs=0.25)
    assert half - whole == pytest.approx(20 / 30, abs=0.25)
    assert code(lambda: client.set_speedratio(101)) == -1073445879


def test_one_client_is_master_at_a_time(client: Client, irc5: SimulatedController) -> None:
    other = Client(irc5.url)
    request, release = "rw/mastership/rapid?action=request", "rw/mastership/rapid?action=release"
    other._do_post(request)
    (state,) = client._do_get("rw/mastership/rapid")["_embedded"]["_state"]
    assert (state["mastership"], state["mastershipheldbyme"]) == ("remote", "FALSE")
    assert code(lambda: client._do_post(request)) == -1073445862
    assert code(lambda: client.write("zb_speed", 20)) == -1073445862
    assert code(client.resetpp) == -1073445862
    assert code(lambda: client._do_post(release)) == -1073445880
    # All domains or none.
    assert code(lambda: client._do_post("rw/mastership?action=request")) == -1073445862
    states = client._do_get("rw/mastership")["_embedded"]["_state"]
    assert [s["mastership"] for s in states] == ["nomaster", "nomaster", "remote"]
    other.write("zb_speed", 30)
    other.close()  # who leaves holds nothing any more
    client._do_post(request)
    client.write("zb_speed", 20)
    assert client.number("zb_speed") == 20
    client._do_post(release)


def test_the_laser_is_an_output(client: Client, irc5: SimulatedController) -> None:
    cell = irc5.irc5.cell
    assert client.get_digital_io("zb_laser") == 0
    assert not cell._on
    client.set_digital_io("zb_laser", True)
    assert client.get_digital_io("zb_laser") == 1
    assert cell._on


def test_a_pulled_cable_delays_an_answer(client: Client, irc5: SimulatedController) -> None:
    client.get_controller_state()
    irc5.pull_cable(0.3)
    began = time.monotonic()
    assert client.get_controller_state() == "motoron"
    assert time.monotonic() - began >= 0.25
    irc5.pull_cable()
    with pytest.raises(requests.exceptions.Timeout):
        client._session.get(irc5.url + "/rw/panel/opmode", timeout=0.2)
    irc5.put_cable()


def test_it_listens_on_loopback_and_says_where_it_cannot(
    irc5: SimulatedController, refused: Callable[..., BadInput]
) -> None:
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+", irc5.url)
    assert irc5.irc5.egm.address[0] == "127.0.0.1"
    error = refused(controller, port=irc5.port)
    assert str(irc5.port) in str(error)
    assert "--port" in str(error)


def test_faults_of_shots_are_refused(refused: Callable[..., BadInput]) -> None:
    error = refused(controller, cell={"faults": [{"kind": "psd-dropout", "shot": 1}]})
    assert "psd-dropout" in str(error)


def test_no_password_is_in_an_answer(client: Client, irc5: SimulatedController) -> None:
    client.get_controller_state()
    for path in ("rw/panel/ctrlstate", "rw/rapid/tasks", "rw/mastership", "rw/nothing", "users/rmmp/poll"):
        answer = client._session.get(f"{irc5.url}/{path}?json=1")
        assert "robotics" not in answer.text + json.dumps(dict(answer.headers))
