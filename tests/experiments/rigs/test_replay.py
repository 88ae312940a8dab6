"""A recorded run drives the procedure again: the same joints and spots, and no run of something else."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import AXIS_LASER, OPEN_LASER, PROBE, good_plan, header, plan_of, run_of, simulated

from zerobeam.experiments.procedure.beam_ports import BeamPorts
from zerobeam.experiments.procedure.rig import Rig
from zerobeam.experiments.procedure.session import InTurn, Session
from zerobeam.experiments.rigs.replay import ReplayRig
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.errors import BadInput, RigFault
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.files.shot import Shot

DIGITS = 2e-6  # mm: six digits are recorded, rounded twice


def carried_out(plan: Plan, rig: Rig, file: Path) -> Run:
    with RunJournal(file, plan.header) as journal:
        Session(BeamPorts(plan, rig, lambda event: None), journal, InTurn(len(plan.postures))).carry_out()
    return read_run(file)


def with_shots(run: Run, *shots: Shot) -> Run:
    return run_of(run.header, shots, run.robot)


@pytest.fixture(scope="module")
def plan() -> Plan:
    return good_plan(4)


@pytest.fixture(scope="module")
def recorded(plan: Plan, tmp_path_factory: pytest.TempPathFactory) -> Run:
    rig = SimulatedRig(plan, CellFile(camera=None), 3)
    return carried_out(plan, rig, tmp_path_factory.mktemp("recorded") / "run.jsonl")


def test_a_replay_gives_joints_spots_and_times_as_they_were(
    plan: Plan, recorded: Run, tmp_path: Path
) -> None:
    again = carried_out(plan, ReplayRig(plan, recorded), tmp_path / "again.jsonl")
    assert [shot.joints_deg for shot in again.shots] == [shot.joints_deg for shot in recorded.shots]
    assert [shot.time_s for shot in again.shots] == [shot.time_s for shot in recorded.shots]
    np.testing.assert_allclose(again.spots, recorded.spots, atol=DIGITS, rtol=0)
    assert np.abs(recorded.spots).min() > 1e-5  # there was something to give back


@pytest.mark.parametrize("tool", [OPEN_LASER, AXIS_LASER], ids=["uncalibrated", "along the last axis"])
@pytest.mark.at_length(r"^along")
def test_spots_far_from_the_centre_come_back_too(tool: dict[str, Any], tmp_path: Path) -> None:
    """Several millimetres, of an arm with offsets: where the PSD's axes lie is as in the recording."""
    plan = good_plan(6, tool=tool)
    _, run = simulated(plan, {"delta2": -2.0, "delta3": 1.5, "delta5": 1.0})
    rng = np.random.default_rng(1)
    far = [
        shot.model_copy(update={"spot_mm": tuple(float(v) for v in rng.uniform(-8, 8, 2).round(6))})
        for shot in run.shots
    ]
    again = carried_out(plan, ReplayRig(plan, with_shots(run, *far)), tmp_path / "again.jsonl")
    np.testing.assert_allclose(again.spots, [shot.spot_mm for shot in far], atol=DIGITS, rtol=0)


def test_a_run_without_spots_is_replayed_as_on_the_centre(plan: Plan, recorded: Run, tmp_path: Path) -> None:
    bare = [shot.model_copy(update={"spot_mm": None}) for shot in recorded.shots]
    again = carried_out(plan, ReplayRig(plan, with_shots(recorded, *bare)), tmp_path / "again.jsonl")
    np.testing.assert_array_equal(again.spots, np.zeros((4, 2)))
    assert [shot.joints_deg for shot in again.shots] == [shot.joints_deg for shot in recorded.shots]


def test_a_shot_that_is_missing_ends_the_replay(plan: Plan, recorded: Run, tmp_path: Path) -> None:
    kept = [shot for shot in recorded.shots if shot.shot != 2]
    with pytest.raises(RigFault, match=r"run\.jsonl has no measurement 2"):
        carried_out(plan, ReplayRig(plan, with_shots(recorded, *kept)), tmp_path / "again.jsonl")
    assert [shot.shot for shot in read_run(tmp_path / "again.jsonl").shots] == [0, 1]


def other_arm(plan: Plan) -> Plan:
    """The same arm but for one link that is a millimetre longer."""
    joints = list(plan.robot.joints)
    longer = joints[3].fixed.copy()
    longer[0, 3] += 1.0
    joints[3] = replace(joints[3], fixed=longer)
    return replace(plan, robot=replace(plan.robot, joints=tuple(joints)))


def test_the_recording_must_be_of_the_plans_arm_and_tool(plan: Plan, recorded: Run) -> None:
    for other in (other_arm(plan), plan_of(header(OPEN_LASER), plan.postures)):
        with pytest.raises(BadInput, match="not of this plan's robot and tool") as caught:
            ReplayRig(other, recorded)
        assert (caught.value.file, caught.value.line) == (str(recorded.path), 1)
    ReplayRig(plan, recorded)


def test_the_recording_must_be_of_the_plans_shots(plan: Plan, recorded: Run) -> None:
    first, *_ = recorded.shots
    turned = list(first.joints_deg)
    turned[1] += 6.0
    for shot, found in (
        (first.model_copy(update={"target": "other"}), "measurement 0 at target other"),
        (first.model_copy(update={"joints_deg": tuple(turned)}), r"measurement 0, whose joint 2 is 6\.0 deg"),
        (first.model_copy(update={"shot": 8}), "measurement 8"),
    ):
        with pytest.raises(BadInput, match=f"not made with this plan\n  found:   {found}") as caught:
            ReplayRig(plan, with_shots(recorded, shot))
        assert caught.value.line == 2


def test_the_joints_of_the_servo_may_stand_elsewhere_than_planned(plan: Plan, recorded: Run) -> None:
    first, *_ = recorded.shots
    turned = list(first.joints_deg)
    turned[4] += 6.0
    ReplayRig(plan, with_shots(recorded, first.model_copy(update={"joints_deg": tuple(turned)})))


def test_a_probe_has_nothing_to_replay() -> None:
    plan = good_plan(4, tool=PROBE)
    with pytest.raises(BadInput, match="a probe's run cannot be replayed"):
        ReplayRig(plan, simulated(plan)[1])


def test_what_a_recording_has_not_is_a_fault(plan: Plan, recorded: Run) -> None:
    rig = ReplayRig(plan, recorded)
    with pytest.raises(RigFault, match="no camera"):
        rig.image()
    rig.begin(0, "psd", None)
    assert not rig.currents(3).any()
    rig.laser(True)
    assert rig.currents(3).sum(axis=1) == pytest.approx([2.0] * 3)
    rig.stop()
    assert not rig.currents(3).any()
