"""The sheet for the person at the robot: every posture with its picture, joints and fields."""

import io
import re
from pathlib import Path

import numpy as np
import pytest
from cells import good_plan
from command_line import plan_file, zerobeam
from measured_arms import LASER, TIP
from pypdf import PdfReader

import zerobeam as zb
from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.experiments.rigs.manual.hand_ports import InstrumentReadings, entered_readings
from zerobeam.model.files.plan import Plan
from zerobeam.model.instruments.registry import KINDS
from zerobeam.model.likelihood.problem import Problem
from zerobeam.reports.plan.operator_sheet import operator_sheet

POSTURES = [[0, 40, 20, 0, 30, 0], [20, 45, 10, 20, 35, 40]]
AT_TIP = {"tip_mm": TIP, "sigma_mm": 0.02}
FACE = {"top": {"kind": "plane", "normal": [0, 0, 1], "guess_mm": [800, 0, 50], "sigma_mm": 5}}
TRACKER = {"kind": "tracker", "sigma_mm": 0.02, "reflectors": {"R1": {"guess_mm": [60, 0, 60]}}}
INSTRUMENTS: dict[str, tuple[dict[str, object], dict[str, dict[str, object]]]] = {
    "tracker": (TRACKER | {"guess_mm": [3000, 0, 800]}, {}),
    "pose": ({"kind": "pose", "sigma_mm": 0.1, "sigma_deg": 0.03, "mount": {}}, {}),
    "ballbar": (AT_TIP, {"s1": {"guess_mm": [800, 0, 0], "sigma_mm": 5}}),
    "dial": (AT_TIP | {"direction": [0, 0, 1]}, FACE),
    "plane": (AT_TIP | {"tip_diameter_mm": 6}, FACE),
}


def test_a_page_for_each_posture_with_its_joints_and_fields(tmp_path: Path) -> None:
    plan = good_plan(3)
    path, file = plan_file(tmp_path / "plan.yaml", plan), tmp_path / "sheet.pdf"
    answer = zerobeam("export", "plan", "pdf", path, "-o", file)
    assert (answer.status, answer.err) == (0, "")
    pages = [page.extract_text() for page in PdfReader(io.BytesIO(file.read_bytes())).pages]
    assert len(pages) == 4
    for i, text in enumerate(pages[1:]):
        said = re.sub(r"\s+", " ", text).replace("−", "-")
        assert f"Posture {i}, target psd" in said
        for value in plan.postures[i] * plan.robot.display:
            assert f"{value:.3f}°" in said
        assert "recorded" in said
        assert "Beam to the target" in said
    assert "enabling switch" in " ".join(pages[0].split())
    assert "exists already" in zerobeam("export", "plan", "pdf", path, "-o", file).refused()
    assert (
        "--zone is not for pdf"
        in zerobeam("export", "plan", "pdf", path, "-o", tmp_path / "b.pdf", "--zone", "5").refused()
    )


def planned(kind: str) -> Plan:
    entry, targets = INSTRUMENTS[kind]
    return zb.Plan.from_arrays(
        robot="irb1600",
        instruments={"it": {"kind": kind} | entry},
        postures=POSTURES,
        unit="deg",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        targets=next(iter(targets), None),
        target_priors=targets or None,
        geometry="exact",
    )


def pages_of(plan: Plan) -> list[str]:
    aimed = aim_plan(plan)
    pages = PdfReader(io.BytesIO(operator_sheet(aimed, check_plan(plan, aimed)))).pages
    return [re.sub(r"\s+", " ", page.extract_text()).replace("−", "-") for page in pages]


def fields(text: str) -> int:
    return len(re.findall(r"_(?:\s?_){8}", text))


@pytest.mark.parametrize("kind", INSTRUMENTS)
@pytest.mark.one_in(3)
def test_columns_of_each_kind_are_what_a_run_by_hand_takes(kind: str) -> None:
    """Numbers that are written into them from left to right are the readings; touches have no columns."""
    plan = planned(kind)
    first, *pages = pages_of(plan)
    assert len(pages) == len(plan.postures)
    instrument = plan.header.instrument
    heads, reads = instrument.heads(), entered_readings(instrument)
    assert instrument.words.to_do in first
    assert ("--rig manual" in first) == bool(reads)
    for i, text in enumerate(pages):
        assert f"Posture {i}, " in text
        assert plan.called[i] in text
        assert ("Readings" in text) == bool(heads)
        assert re.search(" ".join(map(re.escape, heads)), text)
        assert fields(text) == plan.robot.n + len(heads) + 1
    if reads:
        row = np.linspace(1, 2, len(heads))
        row[3:] /= np.linalg.norm(row[3:]) if len(row) > 3 else 1
        readings = InstrumentReadings(plan, Problem.from_plan(plan)).typed(
            0, " ".join(map(repr, row.tolist()))
        )
        assert np.hstack(list(readings.values())).tolist() == row.tolist()


@pytest.mark.parametrize("kind", KINDS.values(), ids=str)
def test_a_column_has_a_head_for_each_number_that_is_entered(kind: type) -> None:
    assert len(kind.heads()) == sum(read.numbers for read in entered_readings(kind))
    assert not any("_mm" in head or "_quat" in head for head in kind.heads())


def test_what_is_measured_in_one_posture_shares_a_page() -> None:
    """A laser and a tracker: the laser first, which turns the joints."""
    alone = good_plan(3)
    rows = np.degrees(alone.postures).tolist()
    by_laser, by_tracker = {"instrument": "tool"}, {"instrument": "tracker"}
    plan = zb.Plan.from_arrays(
        robot="irb1600",
        tool=zb.Laser(point_mm=LASER["point_mm"], direction=LASER["direction"]),
        instruments={"tracker": TRACKER},
        postures=[rows[0], rows[1], rows[2], rows[2]],
        unit="deg",
        means=[by_laser, by_tracker, by_tracker | {"posture": 0}, by_laser | {"posture": 0}],
        targets=["psd", None, None, "psd"],
        target_priors={"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 20}},
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
        geometry="exact",
    )
    first, laser, tracker, both = pages_of(plan)
    assert "do not move the arm between" in first
    for kind in plan.header.kinds.values():
        assert kind.words.to_do in first
    assert "Posture 0, tool, target psd" in laser
    assert "Readings" not in laser
    assert "Posture 1, tracker, R1" in tracker
    assert "Beam" not in tracker
    assert "Posture 3 and 2, tool, target psd; tracker, R1" in both
    assert ("Beam to the target" in both, "Reflector R1 at" in both, "x (mm) y (mm) z (mm)" in both) == (
        (True,) * 3
    )
