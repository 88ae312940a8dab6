"""JSON and CSV, read back by the standard readers."""

import csv
import io
import json
from pathlib import Path
from typing import Any

import pytest
from cells import pattern_plan, simulated
from export_runs import (
    HOSTILE,
    SLIDING,
    TRUTH,
    WITHIN_NOISE_MM,
    arm_run,
    corrected,
    hostile,
    rms_mm,
    urdf_run,
)

from zerobeam.experiments.makers.calibration import RobotCalibration, calibration
from zerobeam.experiments.makers.generic.written_tables import csv_text, json_text

COLUMNS = (
    "offset joint kind unit status exported applied applied_u applied_status estimate std low95 high95 reason"
    " run run_sha256 robot zerobeam notes"
)


def rows_of(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text, newline=""), strict=True))


def no_constant(name: str) -> float:
    raise AssertionError(f"JSON has no {name}")


def read(text: str) -> Any:
    return json.loads(text, parse_constant=no_constant)


@pytest.fixture
def poor() -> RobotCalibration:
    run = simulated(pattern_plan("x"), TRUTH, 2)[1]
    return calibration(run, allow_weak=True, without=["delta2"])


@pytest.mark.parametrize("kind", ["turning", "sliding"])
def test_what_is_read_back_hits_the_target(kind: str, tmp_path: Path) -> None:
    """To the last digit, deg or mm as the unit says."""
    run = arm_run(tmp_path) if kind == "turning" else urdf_run(tmp_path, SLIDING)
    answer = calibration(run)
    from_json = [row["applied"] for row in read(json_text(answer))["offsets"]]
    from_csv = [float(row["applied"]) for row in rows_of(csv_text(answer))]
    assert from_json == from_csv == [offset.applied for offset in answer.offsets]
    assert [row["unit"] for row in rows_of(csv_text(answer))] == [joint.unit for joint in run.robot.joints]
    assert rms_mm(run) > 10 * WITHIN_NOISE_MM
    assert rms_mm(run, corrected(run, from_json)) < WITHIN_NOISE_MM
    assert rms_mm(run, corrected(run, [-value for value in from_json])) > 10 * WITHIN_NOISE_MM


def test_what_the_data_cannot_tell_is_nowhere(poor: RobotCalibration) -> None:
    second = read(json_text(poor))["offsets"][1]
    assert second["name"] == "delta2"
    assert second["status"] == "unidentifiable"
    assert [second[key] for key in ("estimate", "std", "interval95")] == [None, None, None]
    assert (second["exported"], second["applied"]) == (False, 0)
    row = rows_of(csv_text(poor))[1]
    assert [row[key] for key in ("estimate", "std", "low95", "high95")] == [""] * 4
    assert (row["exported"], row["applied"]) == ("no", "0.0")
    assert "joint 1 varies" in row["reason"]


def test_statuses_and_provenance(poor: RobotCalibration) -> None:
    told = read(json_text(poor))
    assert told["schema"] == "zerobeam/offsets/1"
    assert told["meaning"] == "true position = recorded position + offset"
    statuses = [row["status"] for row in told["offsets"]]
    assert statuses[:3] == ["held", "unidentifiable", "weak"]
    assert statuses == [row["status"] for row in rows_of(csv_text(poor))]
    assert told["inputs"]["sha256"] == "0" * 64
    assert told["inputs"]["shots"] == 7
    assert {"python", "zerobeam", "numpy"} <= set(told["inputs"]["versions"])
    for row in rows_of(csv_text(poor)):
        assert list(row) == COLUMNS.split()
        assert row["run_sha256"] == "0" * 64


def test_hostile_names_stay_texts(tmp_path: Path) -> None:
    answer = calibration(hostile(arm_run(tmp_path)))
    told = read(json_text(answer))
    assert told["offsets"][0]["joint"] == told["inputs"]["robot"] == HOSTILE
    text = csv_text(answer)
    rows = rows_of(text)
    assert len(rows) == len(text.splitlines()) - 1 == 6
    assert rows[0]["joint"] == "'" + HOSTILE.encode("unicode_escape").decode()
    for row in rows:
        for cell in (row["joint"], row["robot"], row["run"], row["reason"]):
            assert not cell.startswith(("=", "+", "-", "@"))
