"""Parts of the simulated controller: the drive, the network of packets, the cell and its sensors."""

import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from abb_controller.cell_behind import CellBehind
from abb_controller.egm_server import PacketFaults, PacketLine
from abb_controller.irc5 import Drive
from abb_controller.sensor_server import CellSensors
from abb_controller.service import own_plan
from cells import header, plan_of, random_robot, varied_postures
from child import ABB_CONTROLLER, DEAF, child
from controllers import FAST, Client, controller, plan
from start_abb_controller import parser, serve

from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.sensors.detectors import RemoteSensors
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault

DT = 0.004
TOP, ACCELERATION = np.array([1.0, 2.0, 3.0]), np.array([5.0, 5.0, 8.0])


def path(drive: Drive, steps: int, held: bool = False) -> Matrix:
    """(steps + 1, n) where it was."""
    places = [drive.at.copy()]
    for _ in range(steps):
        drive.advance(held)
        places.append(drive.at.copy())
    return np.array(places)


def bounds_hold(places: Matrix, top: Matrix) -> bool:
    speed = np.diff(places, axis=0) / DT
    change = np.diff(speed, axis=0, prepend=np.zeros((1, 3))) / DT
    return bool((np.abs(speed) <= top + 1e-9).all() and (np.abs(change) <= ACCELERATION + 1e-6).all())


@pytest.mark.parametrize("goal", [[1.0, -0.5, 0.25], [0.001, 0, 0], [0, 0, 0], [1e-7, 2.0, 0]])
@pytest.mark.parametrize("in_step", [True, False])
def test_the_drive_keeps_its_bounds_and_lands(goal: list[float], in_step: bool) -> None:
    drive, there = Drive(np.zeros(3), TOP, ACCELERATION, DT), np.array(goal)
    if in_step:
        drive.go(there, 1.0)
    else:
        drive.follow(there, 1.5)
    places = path(drive, 800)
    assert drive.arrived
    assert (places[-1] == there).all()
    assert bounds_hold(places, TOP if in_step else np.minimum(TOP, 1.5))
    if in_step:
        # On a line: every place is the same share of the way for all joints.
        shares = places @ there / max(there @ there, 1e-300)
        assert np.abs(places - np.outer(shares, there)).max() < 1e-12


def test_a_drive_takes_the_time_of_a_trapezium() -> None:
    drive = Drive(np.zeros(3), TOP, ACCELERATION, DT)
    drive.go(np.array([1.0, 0, 0]), 0.5)
    places = path(drive, 1000)
    steps = int((places[:, 0] < 1.0).sum())
    assert steps * DT == pytest.approx(1.0 / 0.5 + 0.5 / 5.0, abs=2 * DT)


def test_a_held_drive_brakes_and_goes_on() -> None:
    drive = Drive(np.zeros(3), TOP, ACCELERATION, DT)
    drive.go(np.ones(3), 1.0)
    places = np.vstack([path(drive, 100), path(drive, 200, held=True)[1:]])
    assert drive.standing
    assert not drive.arrived
    assert 0 < drive.at[0] < 1
    places = np.vstack([places, path(drive, 800)[1:]])
    assert drive.arrived
    assert bounds_hold(places, TOP)
    drive.go(np.zeros(3), 1.0)
    path(drive, 100)
    drive.rest()
    path(drive, 500)
    assert drive.standing
    assert 0 < drive.at[0] < 1


def test_the_line_does_what_is_asked_of_it() -> None:
    def sent(faults: PacketFaults, count: int = 2000) -> list[tuple[int, float]]:
        line, came = PacketLine(faults, np.random.default_rng(0)), []
        for i in range(count + 10):
            now = 0.004 * i
            if i < count:
                line.send(str(i).encode(), now)
            came += [(int(packet), now) for packet in line.arrived(now)]
        return came

    assert sent(PacketFaults()) == [(i, 0.004 * i) for i in range(2000)]
    # Binomial, N = 2000: a std is 0.7 % at a share of 10 %; four of them.
    assert abs(len(sent(PacketFaults(lost=0.1))) - 1800) < 54
    assert sent(PacketFaults(lost=1.0)) == []
    twice = [number for number, _ in sent(PacketFaults(duplicated=0.1))]
    assert abs(len(twice) - 2200) < 54
    assert set(twice) == set(range(2000))
    late = [now - 0.004 * i for i, now in sent(PacketFaults(late=0.1))]
    assert sum(delay >= 0.019 for delay in late) == sum(delay > 0 for delay in late)
    assert abs(sum(delay > 0 for delay in late) - 200) < 54
    order = [number for number, _ in sent(PacketFaults(reordered=0.1))]
    assert set(np.diff(order)) <= {-2, -1, 1, 2, 3}
    assert (np.diff(order) < 0).sum() > 100
    assert len(set(order)) >= 1999


def test_a_share_is_a_share() -> None:
    with pytest.raises(BadInput, match="lost"):
        PacketFaults(lost=1.5)


def test_the_cell_behind_is_that_of_the_simulated_rig() -> None:
    behind, rig = CellBehind(plan(), CellFile(), 7), SimulatedRig(plan(), CellFile(), 7)
    assert behind.provenance() == rig.provenance()
    assert behind.provenance() != CellBehind(plan(), CellFile(), 8).provenance()


def test_a_beam_on_the_psd_is_seen_by_its_sensors() -> None:
    cell: dict[str, Any] = {
        "arm": {"offsets_deg": {}, "repeatability_deg": 0},
        "laser": {"wander_mm": 0},
        "psd": {"placed": {"psd": {"normal": "beam", "misturned_deg": [0, 0, 0], "centre_mm": [900, 0, 0]}}},
    }
    with controller(cell=cell, speed_up=FAST) as irc5:
        client, sensors = Client(irc5.url), RemoteSensors("127.0.0.1", irc5.sensor_port)
        psd = sensors.psds["psd"]
        assert psd.size == irc5.irc5.cell.psds["psd"].size
        assert irc5.irc5.cell.camera is not None
        assert (sensors.camera.mount == irc5.irc5.cell.camera.mount).all()
        client.run()
        client.send(np.degrees(plan().postures[0]))
        client.wait(1)

        def light() -> float:
            currents = sensors.currents("psd", 20)
            assert currents.shape == (20, 4)
            return float(np.nanmean(psd.light(currents)))

        dark = light()
        client.set_digital_io("zb_laser", True)
        assert light() - dark == pytest.approx(1.0, abs=0.05)
        near = CellSensors(irc5.irc5).currents("psd", 20)
        assert float(np.nanmean(psd.light(near))) - dark == pytest.approx(1.0, abs=0.05)
        # The control: with the last joint turned by 20 deg there is no beam on it.
        away = np.degrees(plan().postures[0]) + np.array([0, 0, 0, 0, 0, 20.0])
        client.send(away)
        client.wait(2)
        assert abs(light() - dark) < 0.05
        image = sensors.image("psd")
        assert image.shape == (sensors.camera.height, sensors.camera.width)
        with pytest.raises(RigFault, match="no such PSD"):
            sensors.currents("other", 1)
        with pytest.raises(RigFault, match="samples"):
            sensors.currents("psd", 0)
        sensors.close()
        client.close()
    with pytest.raises(RigFault, match=str(irc5.sensor_port)):
        RemoteSensors("127.0.0.1", irc5.sensor_port)


def test_what_the_sensors_look_at_stands_still_and_holds_nothing_up() -> None:
    cell = CellBehind(plan(), CellFile(), 0)
    cell.switch(True)
    cell.drive(plan().postures[0], 1.0)
    still, joints = cell.before("psd"), plan().postures[1]
    cell.drive(joints, 2.0)
    cell.switch(False)
    assert np.abs(cell.counts() - joints).max() < 1e-5
    assert np.abs(still.joints() - plan().postures[0]).max() < 1e-5
    assert still.now() == 1.0
    assert still._on
    still.image()
    assert cell.now() == 2.0


def test_an_arm_of_another_kind_is_refused() -> None:
    robot, own = random_robot("rrrrr", 3), header(target=(300.0, 0.0, 0.0))
    short = plan_of(own, varied_postures(own, robot, (300.0, 0.0, 0.0), 3, 0), robot=robot)
    with pytest.raises(BadInput, match="six revolute joints"):
        CellBehind(short, CellFile(psd={"placed": {"psd": {"normal": "beam"}}}), 0)  # type: ignore[arg-type]


def test_the_own_plan_is_seen_by_its_cell() -> None:
    own = own_plan()
    assert own.postures.shape == (7, 6)
    assert CellBehind(own, CellFile(), 0).psds.keys() == {"psd"}


@pytest.mark.skipif(sys.platform == "win32", reason="there is no SIGINT for another process")
@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.at_length(r"^2")
def test_it_serves_until_it_is_ended(how: signal.Signals) -> None:
    """Even if it was started by one who ignores both."""
    with child([*DEAF, *ABB_CONTROLLER], stderr=subprocess.STDOUT) as process:
        lines = [process.stdout.readline() for _ in range(4)]
        client = Client(lines[0].split()[-1])
        assert client.get_operation_mode() == "AUTO"
        client.close()
        process.send_signal(how)
        rest = process.stdout.read()
        assert process.wait(10) == 0
    assert lines[0].startswith("Robot Web Services: http://127.0.0.1:")
    assert "robotics" not in "".join(lines) + rest
    assert rest == ""


def test_nothing_is_printed_before_the_amplifier_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Found by damaged files: the addresses of a controller that did not stand."""
    file = tmp_path / "psd.yaml"
    file.write_text("schema: zerobeam/psd-calibration/1\n")
    with pytest.raises(BadInput, match=r"psd\.yaml, line 1"):
        serve(parser().parse_args([*ABB_CONTROLLER[2:], "--amplifier", str(file)]))
    assert capsys.readouterr().out == ""
