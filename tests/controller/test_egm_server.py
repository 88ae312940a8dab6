"""The simulated IRC5 by EGM, led by the client library that leads real ones."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from abb_controller.egm_server import PacketFaults
from abb_controller.irc5 import GUIDED_SPEED, PATIENCE
from abb_controller.service import SimulatedController
from controllers import Client, Guide, controller

from zerobeam.model.arrays import Matrix

GOAL = np.array([0.5, -0.4, 0.3, 0.2, -0.1, 0.6])
STEP = 2e-4  # deg, an encoder's step


@contextmanager
def guided(**options: object) -> Iterator[tuple[SimulatedController, Client, Guide]]:
    """A controller in guidance at 0 deg, and both clients."""
    with controller(**options) as irc5:
        client, guide = Client(irc5.url), Guide(irc5.egm_port)
        try:
            client.run()
            client.begin(2)
            yield irc5, client, guide
        finally:
            client.close()
            guide.close()


def numbers(heard: list[tuple[float, object]]) -> Matrix:
    return np.array([state.robot_message.header.seqno for _, state in heard])  # type: ignore[attr-defined]


def test_the_joints_are_told_every_four_milliseconds() -> None:
    with guided() as (irc5, _, guide):
        heard = guide.lead(np.zeros(6), 0.8)
        assert (np.diff(numbers(heard)) == 1).all()
        # By the controller's clock; what a busy machine is late by, up to 0.1 s, is made up for.
        sent = np.array([state.robot_message.header.tm for _, state in heard])
        assert np.median(np.diff(sent)) == pytest.approx(4, abs=2)
        assert len(sent) - 1 <= (sent[-1] - sent[0] + 100) / 4
        state = heard[-1][1]
        assert state.motors_on
        assert state.rapid_running
        assert np.abs(state.joint_angles - irc5.irc5.joints_deg()).max() == 0
        assert len(state.joint_angles_planned) == 6
        message = state.robot_message
        assert message.mciState.state == message.mciState.MCI_RUNNING
        assert message.mciConvergenceMet


def test_nothing_is_told_before_guidance_and_after_it() -> None:
    with controller() as irc5:
        guide, client = Guide(irc5.egm_port), Client(irc5.url)
        assert guide.lead(GOAL, 0.1) == []
        client.run()
        client.begin(2)
        assert guide.lead(GOAL, 0.2)
        client.write("zb_command", 0)
        client.until(lambda: not irc5.irc5.egm.active)
        guide.lead(GOAL, 0.05)  # what was under way
        assert guide.lead(GOAL, 0.1) == []
        assert (client.number("zb_done"), client.number("zb_error")) == (1, 0)
        client.close()
        guide.close()


def test_a_correction_is_followed_at_the_guided_speed() -> None:
    with guided() as (irc5, client, guide):
        guide.lead(GOAL, 0.6)
        assert np.abs(irc5.irc5.joints_deg() - GOAL).max() <= STEP
        far = GOAL + np.array([0, 0, 0, 20.0, 0, 0])
        heard = guide.lead(far, 0.5)
        client.write("zb_command", 0)
        client.until(lambda: client.number("zb_done") == 1)
        # By the controller's own clock: 4 ms a message, whatever the machine does.
        told = np.array([state.joint_angles[3] for _, state in heard])
        speed = np.diff(told) / 0.004
        assert speed.max() == pytest.approx(np.degrees(GUIDED_SPEED), abs=2 * STEP / 0.004)
        assert np.abs(np.diff(speed)).max() * 250 < 1.2 * 300 + 4 * STEP * 250**2  # its acceleration, deg/s^2
        stands = irc5.irc5.joints_deg()
        assert 2 < stands[3] - GOAL[3] < 15
        time.sleep(0.05)
        assert (irc5.irc5.joints_deg() == stands).all()


def test_silence_stops_the_arm_and_ends_guidance() -> None:
    with guided() as (irc5, client, guide):
        guide.lead(np.array([0, 0, 0, 60.0, 0, 0]), 0.3)
        heard = guide.lead(GOAL, PATIENCE + 0.4, answering=False)
        # It goes on after the last reference until the time-out, then brakes.
        moved = np.abs(np.diff([state.joint_angles[3] for _, state in heard]))
        assert moved[0] > 0
        assert len(heard) < 1.2 * PATIENCE / 0.004
        assert client.number("zb_error") == 1
        assert client.number("zb_done") == 1
        stands = irc5.irc5.joints_deg()
        assert stands[3] < 35
        time.sleep(0.05)
        assert (irc5.irc5.joints_deg() == stands).all()
        assert client.get_execution_state().ctrlexecstate == "running"


def test_an_emergency_stop_is_told() -> None:
    with guided() as (irc5, _, guide):
        guide.lead(np.array([0, 0, 0, 60.0, 0, 0]), 0.2)
        irc5.irc5.press_emergency_stop()
        heard = guide.lead(np.array([0, 0, 0, 60.0, 0, 0]), 1.0)  # it brakes, on a busy machine too
        state = heard[-1][1]
        message = state.robot_message
        assert not state.motors_on
        assert not state.rapid_running
        assert message.mciState.state == message.mciState.MCI_STOPPED
        assert state.joint_angles[3] == heard[-2][1].joint_angles[3] < 10


def test_a_reference_outside_the_limits_stops_the_program() -> None:
    with guided() as (irc5, client, guide):
        guide.lead(np.array([0, 0, 0, 0, 0, 500.0]), 0.2)
        assert client.get_execution_state().ctrlexecstate == "stopped"
        assert "joint 6" in irc5.irc5.reason
        assert (irc5.irc5.joints_deg() == 0).all()


def test_lost_packets_are_missed_and_the_goal_is_reached() -> None:
    with guided(packet_faults=PacketFaults(lost=0.1)) as (irc5, _, guide):
        heard = guide.lead(GOAL, 1.0)
        missing = 1 - len(heard) / (numbers(heard)[-1] - numbers(heard)[0] + 1)
        # Binomial, 10 % of some 250: its std is 1.9 %; three of them.
        assert 0.04 < missing < 0.16
        assert np.abs(irc5.irc5.joints_deg() - GOAL).max() <= STEP


def test_packets_that_come_twice_late_and_in_another_order_do_no_harm() -> None:
    faults = PacketFaults(duplicated=0.2, late=0.1, reordered=0.2)
    with guided(packet_faults=faults) as (irc5, _, guide):
        heard = guide.lead(GOAL, 0.8)
        steps = np.diff(numbers(heard))
        assert (steps == 0).any()
        assert (steps < 0).any()
        assert np.abs(irc5.irc5.joints_deg() - GOAL).max() <= STEP


def test_an_old_correction_is_dropped() -> None:
    with guided() as (irc5, _, guide):
        guide.lead(GOAL, 0.3)
        before = guide.send_sequence_number
        guide.send_sequence_number = 0
        guide.lead(-GOAL, 0.1)
        assert np.abs(irc5.irc5.joints_deg() - GOAL).max() <= STEP
        guide.send_sequence_number = before
        guide.lead(-GOAL, 0.4)
        assert np.abs(irc5.irc5.joints_deg() + GOAL).max() <= STEP


def test_only_the_client_leads() -> None:
    with guided() as (irc5, _, guide):
        guide.lead(np.zeros(6), 0.1)
        other = Guide(0)
        other.egm_addr, other.send_sequence_number = irc5.irc5.egm.address, 10_000
        other.send_to_robot(GOAL)
        guide.socket.sendto(b"no protobuf", irc5.irc5.egm.address)
        guide.lead(np.zeros(6), 0.1)
        other.close()
        assert (irc5.irc5.joints_deg() == 0).all()
        assert irc5.irc5.egm.active


@pytest.mark.parametrize("seconds", [0.05, 0.5])
def test_a_short_pull_of_the_cable_is_survived(seconds: float) -> None:
    with guided() as (irc5, client, guide):
        heard = guide.lead(GOAL, 0.1)
        irc5.pull_cable(seconds)
        heard += guide.lead(GOAL, seconds + 0.3)
        gap = np.diff([when for when, _ in heard]).max()
        assert gap > 0.8 * seconds
        assert np.diff(numbers(heard)).max() > 0.5 * seconds / 0.004
        assert np.abs(irc5.irc5.joints_deg() - GOAL).max() <= STEP
        assert client.number("zb_error") == 0
