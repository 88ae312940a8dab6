"""Joints read from stand-ins of controllers: what is at rest is recorded, and nothing else."""

import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from live_controllers import FAULTS, STAND_INS, LiveArm, RosStandIn, UrStandIn, YaskawaStandIn, robot_of

import zerobeam as zb
from zerobeam.experiments.procedure.events import Doubted, PostureRequested, RunEvent
from zerobeam.experiments.recording import Answers, RunRequest, record
from zerobeam.experiments.rigs import at_rest, transport
from zerobeam.experiments.rigs.at_rest import SCHEMES, STILL, JointsAtRest, open_joints, parse_address
from zerobeam.experiments.rigs.joint_clients import JointsRefused
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run
from zerobeam.model.kinematics.pendant import pendant_of
from zerobeam.model.kinematics.robot import Robot

SCHEMES_READ = list(STAND_INS)
MOTION_S = 0.35  # of a motion: the two readings of an early confirmation are within it


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(transport, "ANSWER_S", 0.4)


def planned(arm: Robot, count: int) -> Plan:
    """Postures all far from each other, about a tip in a socket; what they determine does not matter."""
    rng = np.random.default_rng(4)
    middle, half = (arm.lower + arm.upper) / 2, np.minimum((arm.upper - arm.lower) / 3, 1.5)
    postures = middle + half * rng.uniform(-1, 1, (count, arm.n))
    return zb.Plan.from_arrays(
        unit="deg",
        robot=arm,
        geometry="exact",
        tool={"kind": "probe", "calibrated": True, "point_mm": [0, 0, 100]},
        postures=np.degrees(postures).round(4).tolist(),
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        targets="socket",
        target_priors={"socket": {"guess_mm": [500, 0, 300], "sigma_mm": 2000}},
    )


class Operator:
    """Starts the arm's motion to each posture that is asked for, and confirms: at times too early."""

    confirms, follows = True, False

    def __init__(self, arm: LiveArm, plan: Plan, early: float) -> None:
        self._arm, self._plan, self._early = arm, plan, early
        self._pendant = pendant_of(plan.robot)
        self._rng = np.random.default_rng(2)
        self._arrived = True
        self.events: list[RunEvent] = []
        self.too_early = 0

    def hear(self, event: RunEvent) -> None:
        self.events.append(event)
        if isinstance(event, PostureRequested):
            self._arm.go(self.counts(event.shot), MOTION_S)
            self._arrived = False

    def counts(self, posture: int) -> Any:
        """The joints of a posture as the controller counts them."""
        return self._pendant.counted(self._plan.postures[posture] * self._plan.robot.display)

    def following(self) -> str | None:
        if not self._arrived and self._rng.random() < self._early:
            self.too_early += 1
            self._arrived = True  # next time
            return ""
        while self._arm.moves:
            time.sleep(0.01)
        return ""

    def doubts(self) -> list[str]:
        return [event.kind for event in self.events if isinstance(event, Doubted)]


def carried_out(
    folder: Path, scheme: str, count: int, share: float, early: float
) -> tuple[Operator, LiveArm]:
    stand_in = STAND_INS[scheme]
    plan = planned(robot_of(scheme), count)
    arm = LiveArm(np.zeros(plan.robot.n), share)
    operator = Operator(arm, plan, early)
    with stand_in(arm) as server:
        joints = open_joints(server.url, pendant_of(plan.robot))
        request = RunRequest("live", answers=Answers(operator, arm=joints))
        record(plan, folder / "live.jsonl", request, operator.hear)
        joints.close()
    shots = read_run(folder / "live.jsonl").shots
    assert [shot.shot for shot in shots] == list(range(count))
    resolution = server.resolution
    for shot in shots:
        np.testing.assert_allclose(
            shot.joints_deg,
            plan.postures[shot.shot] * plan.robot.display,
            rtol=0,
            atol=resolution + 1e-6,
        )
    return operator, arm


@pytest.mark.long
def test_each_measurement_is_taken_once_and_at_rest(tmp_path: Path) -> None:
    operator, _ = carried_out(tmp_path, "ur", 4, 0.0, 0.5)
    assert operator.too_early
    assert operator.doubts() == ["moving"] * operator.too_early


@pytest.mark.long
@pytest.mark.parametrize("scheme", SCHEMES_READ)
def test_a_hundred_measurements_with_faults(tmp_path: Path, scheme: str) -> None:
    """5 % of the answers are faulty and 5 % of the confirmations too early: no measurement is lost, none is
    double, none is of an arm that moves."""
    operator, arm = carried_out(tmp_path, scheme, 100, 0.05, 0.05)
    assert operator.too_early
    assert len(arm.happened) >= 5
    assert operator.doubts().count("moving") >= operator.too_early


@pytest.fixture(params=SCHEMES_READ)
def stand_in(request: pytest.FixtureRequest) -> Iterator[Any]:
    kind = STAND_INS[request.param]
    n = robot_of(kind.scheme).n
    with kind(LiveArm(10.0 + np.arange(n))) as server:
        yield server


def opened(server: Any, url: str = "") -> JointsAtRest:
    return open_joints(url or server.url, pendant_of(robot_of(server.scheme)))


def test_the_arm_is_read_where_it_rests_and_not_on_its_way(stand_in: Any) -> None:
    joints = opened(stand_in)
    here = stand_in.arm.joints()
    for there in (here + 5.0, here - 3.0):
        stand_in.arm.go(there, MOTION_S)
        with pytest.raises(JointsRefused, match="the arm moves"):
            joints.take()
        time.sleep(max(MOTION_S - 0.25, 0.1))
        np.testing.assert_allclose(
            counts(stand_in, joints.take()), there, rtol=0, atol=stand_in.resolution + 1e-6
        )
    joints.close()


def counts(server: Any, joints: Any) -> Any:
    """The same as the controller counts them."""
    return pendant_of(robot_of(server.scheme)).counted(joints)


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.one_in(3)
def test_a_fault_is_overcome_and_one_that_lasts_is_refused(stand_in: Any, fault: str) -> None:
    joints = opened(stand_in)
    before = joints.take()
    np.testing.assert_allclose(
        counts(stand_in, before), stand_in.arm.joints(), rtol=0, atol=stand_in.resolution + 1e-6
    )
    stand_in.arm.faults, stand_in.arm.share = (fault,), 1.0
    with pytest.raises(JointsRefused) as refused:
        joints.take()
    # Without a clock what is stale is the answer to an earlier request, and that is none.
    assert refused.value.kind == ("stale" if fault == "stale" and stand_in.arm.clock else "connection")
    assert refused.value.why.endswith(("s", "again"))
    stand_in.arm.share = 0.0
    time.sleep(0.5)
    np.testing.assert_array_equal(joints.take(), before)
    joints.close()


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.long)])
def test_damaged_packets_are_refused_or_give_the_same_joints(
    stand_in: Any, monkeypatch: pytest.MonkeyPatch, count: int
) -> None:
    """Of the two readings of a posture one is damaged: what its packet does not show, the other one does."""
    monkeypatch.setattr(transport, "ANSWER_S", 0.08)
    monkeypatch.setattr(at_rest, "PAUSE_S", 0.03)
    joints = opened(stand_in)
    right, refused = joints.take(), 0
    same = np.maximum(STILL, 2 * stand_in.resolution)
    for seed in range(count):
        stand_in.arm.damage(seed, after=seed % 3)
        began = time.monotonic()
        try:
            taken = joints.take()
        except (JointsRefused, RigFault):
            refused += 1
        else:
            assert np.abs(taken - right).max() <= same, (seed, taken)
        assert time.monotonic() - began < 5.0
    assert len(stand_in.arm.happened) > count / 2
    assert refused < count
    np.testing.assert_allclose(joints.take(), right, rtol=0, atol=same)
    joints.close()


def test_an_arm_that_moves_slowly_is_refused(stand_in: Any) -> None:
    """A speed at which two readings are just further apart than what counts as still."""
    joints = opened(stand_in)
    there = stand_in.arm.joints()
    speed = 8 * max(STILL, 2 * stand_in.resolution)  # deg/s: 2 of it within 0.25 s
    stand_in.arm.go(there + speed * np.eye(len(there))[1], 1.0)
    with pytest.raises(JointsRefused, match="the arm moves: joint 2 by") as refused:
        joints.take()
    assert refused.value.kind == "moving"
    joints.close()


def test_the_joints_of_another_arm_are_refused(stand_in: Any) -> None:
    """The controller's six joints and a robot with seven; where the arm has more joints than the plan's."""
    seven = replace(zb.load_robot("panda"), vendor=None, name="mine")
    if stand_in.scheme == "ur":  # always six, by its protocol
        with pytest.raises(RigFault, match="6 joints, and mine has 7"):
            open_joints(stand_in.url, pendant_of(seven))
        return
    more = -1 if stand_in.scheme == "ros" else 1  # by names there may be more, and may not be fewer
    stand_in.arm = LiveArm(10.0 + np.arange(robot_of(stand_in.scheme).n + more))
    with pytest.raises(RigFault, match="joints"):
        opened(stand_in).take()


def test_an_arm_that_is_replaced_during_a_run_ends_it() -> None:
    with UrStandIn(LiveArm(np.zeros(6))) as server:
        joints = opened(server, f"{server.url}?arm={server.serial}&dashboard={server.dashboard.port}")
        joints.take()
        joints.close()
        server.serial = "20219999999"
        with pytest.raises(RigFault, match="was 20215500123 and is 20219999999 now"):
            joints.take()
        with pytest.raises(BadInput, match="another arm"):
            opened(server, f"{server.url}?arm=20215500123&dashboard={server.dashboard.port}")


def test_a_controller_without_the_protocol_is_a_fault() -> None:
    with UrStandIn(LiveArm(np.zeros(6)), version=1) as server, pytest.raises(RigFault, match="version 2"):
        opened(server)
    with pytest.raises(RigFault, match="no connection"):
        opened(server)


@pytest.mark.parametrize(
    "text",
    [
        "urr://host",
        "ur://",
        "ur://host:99999",
        "ur://host/path",
        "ur://u@host",
        "ur://host?serial=1",
        "ur://host?arm",
    ],
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(BadInput):
        parse_address(text)


def test_addresses() -> None:
    for name, scheme in SCHEMES.items():
        address = parse_address(f"{name}://10.0.0.2")
        assert (address.host, address.port, address.options) == ("10.0.0.2", scheme.port, {})
    assert parse_address("ur://[::1]:5?arm=a%20b").options == {"arm": "a b"}


def test_the_robot_of_another_maker_is_refused_before_anything_is_opened() -> None:
    with pytest.raises(BadInput, match="another maker"):
        open_joints("ur://127.0.0.1:1", pendant_of(zb.load_robot("irb1600")))


def test_the_model_of_a_yaskawa_is_compared() -> None:
    pendant = pendant_of(robot_of("yaskawa"))
    with YaskawaStandIn(LiveArm(np.zeros(6))) as server:
        joints = open_joints(f"{server.url}?arm={server.model}", pendant)
        assert joints.identity == server.model
        joints.close()
        with pytest.raises(BadInput, match="another arm"):
            open_joints(f"{server.url}?arm=GP8", pendant)
    with pytest.raises(BadInput, match="pulses for a degree are not stated"):
        open_joints("yaskawa://127.0.0.1:1", pendant_of(zb.load_robot("gp7")))


def test_ros_1_another_topic_and_names_of_the_address() -> None:
    """Names in another order than the joints of the robot file."""
    pendant = pendant_of(robot_of("ros"))
    names = ",".join(f"joint{i}" for i in range(7, 0, -1))
    with RosStandIn(LiveArm(np.arange(7.0)), version=1) as server:
        joints = open_joints(f"{server.url}?topic=/arm/joint_states&joints={names}", pendant)
        np.testing.assert_allclose(joints.take(), np.arange(7.0)[::-1], rtol=0, atol=1e-9)
        joints.close()
        joints = open_joints(f"{server.url}?joints={names.replace('joint7', 'elbow')}", pendant)
        with pytest.raises(RigFault, match="no joints elbow: it has finger, joint7, joint6"):
            joints.take()


def test_joint_3_is_counted_as_the_controller_counts_it() -> None:
    """FANUC's from the ground, ROS's from link 2 whatever the pendant does."""
    for scheme in ("fanuc", "ros"):
        pendant = pendant_of(robot_of(scheme), "ground")
        shown = np.arange(1.0, 1.0 + robot_of(scheme).n)
        with STAND_INS[scheme](LiveArm(shown)) as server:
            joints = open_joints(server.url, pendant)
            expected = pendant.between_links(shown) if scheme == "fanuc" else shown
            np.testing.assert_allclose(joints.take(), expected, rtol=0, atol=1e-9)
            joints.close()


@pytest.mark.parametrize(
    ("scheme", "option"), [("fanuc", "group=x"), ("fanuc", "group=9"), ("ur", "arm=1&dashboard=0")]
)
def test_an_option_that_is_no_number_is_refused(scheme: str, option: str) -> None:
    with pytest.raises(BadInput, match="is not understood"):
        open_joints(f"{scheme}://127.0.0.1:1?{option}", pendant_of(robot_of(scheme)))


HUGE = b'{"Command": "FRC_ReadJointAngles", "ErrorID": 0, "TimeTag": 1e999, "JointAngle": {"J1": %s}}' % (
    b"9" * 400
)


@pytest.mark.parametrize(
    "line", [b"[" * 9000, b"[]", b"\xff", HUGE, b'{"Command": "FRC_ReadJointAngles", "ErrorID": 7}']
)
def test_lines_of_rmi_that_are_no_answers(line: bytes) -> None:
    """Whatever comes is refused as a fault of the connection: nothing of it is taken, and nothing breaks."""
    from live_controllers import FanucStandIn

    class Odd(FanucStandIn):
        def _session(self, connection: socket.socket) -> None:
            while self.sessions.received_line(connection):
                connection.sendall(line + b"\r\n")

    with Odd(LiveArm(np.zeros(6))) as server:
        joints = opened(server)
        with pytest.raises(JointsRefused) as refused:
            joints.take()
        assert refused.value.kind == "connection"
        joints.close()
