"""Of a measurement that is wrong: which joint's value, and what was meant."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import run_of
from command_line import zerobeam
from mistyped_row import HEADER, MISTYPED
from pose_runs import CAMERA, pose_header, pose_run, postures

from zerobeam.analysis.diagnostics.diagnosis import Explanation, Misreading, diagnose, meant
from zerobeam.analysis.solution import solve
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import mend

ON_AXIS = {"guess_mm": [0, 0, 100], "sigma_mm": 0.01}


def mistyped(joint: int, right: float, typed: float, *, row: int = 4, count: int = 14) -> Run:
    """Poses of a camera, in which one value of one row was typed wrongly."""
    joints = postures(count, range(1, 7), 3)
    joints[row, joint - 1] = right
    run = pose_run(joints, {"delta2": 0.1}, seed=3)
    shots = list(run.shots)
    values = list(shots[row].joints_deg)
    values[joint - 1] = typed
    shots[row] = shots[row].model_copy(update={"joints_deg": tuple(values)})
    return replace(run, shots=tuple(shots))


def first(run: Run) -> Explanation:
    return diagnose(solve(Problem.from_run(run), starts=0))[0]


def test_the_joint_and_the_digit_are_named() -> None:
    found = first(mistyped(3, 57.53, 51.53))
    assert (found.cause, found.measurements) == ("measurements", (4,))
    (one,) = found.readings
    assert (one.joint, one.unit, one.recorded, one.meant) == (3, "deg", 51.53, "57.53")
    assert abs(one.fitted - 57.53) < 4 * one.u < 0.2
    assert "it is most likely that of J3 (57.498° ± 0.041° instead of 51.53; " in mend(found)
    assert "57.53 mistyped as 51.53?" in mend(found)


@pytest.mark.long
def test_the_joint_is_named_where_the_others_scatter_more_than_stated_too() -> None:
    """No value explains more than leaving the measurement out; it is as uncertain as the scatter makes it."""
    run = mistyped(3, 57.53, 51.53, count=30)
    content = run.header.model_dump(mode="json", exclude_unset=True)
    content["noise"]["joint_deg"] *= 0.7
    content["instruments"]["cam"] |= {key: 0.7 * CAMERA[key] for key in ("sigma_mm", "sigma_deg")}
    found, understated = first(run), first(replace(run, header=Header.model_validate(content)))
    assert (found.agrees, understated.agrees) == (True, False)
    assert understated.factor == pytest.approx(found.factor / 0.7, rel=0.02)
    (one,), (other,) = found.readings, understated.readings
    assert (other.joint, other.meant) == (3, "57.53")
    assert other.u == pytest.approx(one.u, rel=0.02)


@pytest.mark.parametrize(
    ("recorded", "fitted", "u", "expected"),
    [
        (18.53, 15.9, 0.01, None),  # no single slip
        (18.53, 15.83, 0.02, "15.83"),  # 8 and 5 exchanged over the point
        (18.53, 81.54, 0.02, "81.53"),
        (18.53, -18.52, 0.02, "-18.53"),
        (-18.53, 18.52, 0.02, "18.53"),
        (18.53, 10.53, 0.02, "10.53"),
        (18.53, 18.935, 0.005, "18.93"),
        (18.53, 18.93, 0.1, None),  # a digit worth 0.1 is as likely by chance
        (18.53, 18.53, 0.01, None),
        (18.531234, 28.531234, 0.01, None),  # calculated, not typed
    ],
)
def test_what_was_meant(recorded: float, fitted: float, u: float, expected: str | None) -> None:
    assert meant(Misreading(1, "deg", recorded, fitted, u)) == expected


@pytest.mark.long
def test_joints_that_have_the_same_effect_are_all_listed(tmp_path: Path) -> None:
    """Two numbers of a laser do not decide between joints 2, 3 and 5: none is named alone."""
    (tmp_path / "rows.csv").write_text(MISTYPED, encoding="utf-8")
    (tmp_path / "header.yaml").write_text(HEADER, encoding="utf-8")
    run = tmp_path / "run.jsonl"
    made = zerobeam(
        "import", "csv", tmp_path / "rows.csv", "--units", "deg", "--target", "psd",
        "--header", tmp_path / "header.yaml", "-o", run,
    )  # fmt: skip
    assert made.status == 0, made.err
    answer = zerobeam("analyse", run, "--ess", 100, "--json")
    best = answer.json["diagnosis"][0]
    assert (best["cause"], best["measurements"]) == ("measurements", [4])
    rows: dict[int, dict[str, Any]] = {row["joint"]: row for row in best["readings"]}
    assert set(rows) == {2, 3, 5}
    assert abs(rows[3]["fitted"] - (-143.834 - 0.9)) < 3 * rows[3]["u"]
    assert all(row["meant"] is None for row in rows.values())
    printed = " ".join(zerobeam("analyse", run, "--ess", 100).out.split())
    assert "measurement 4 (row 5 of rows.csv)" in printed
    assert "it may be that of J" in printed
    assert "the measurements do not decide which" in printed
    assert "mistyped as" not in printed
    assert "--drop 4" in printed


def test_what_no_one_value_explains_has_no_joint() -> None:
    """The pose itself was read wrongly: no joint makes it right."""
    run = mistyped(3, 57.53, 57.53)
    shots: list[Shot] = list(run.shots)
    x, y, z = shots[4].readings["measured_mm"]
    shots[4] = shots[4].model_copy(update={"measured_mm": (x + 20.0, y, z)})
    found = first(replace(run, shots=tuple(shots)))
    assert (found.cause, found.readings) == ("measurements", ())
    assert "If one joint value" not in mend(found)


@pytest.mark.long
def test_a_joint_without_effect_is_not_named() -> None:
    """A reflector on the axis of joint 6: no value of that joint explains anything."""
    own = pose_header(
        instruments={
            "trk": {
                "kind": "tracker",
                "frame": "free",
                "sigma_mm": 0.05,
                "guess_mm": [1500, 500, 600],
                "reflectors": {"R": ON_AXIS},
            }
        }
    )
    robot, count = load_robot("ur5e", Path(".")), 14
    joints, nowhere = postures(count, range(1, 7), 3), (None,) * count
    plan = Plan(own, robot, planned(joints, nowhere), nowhere, Path("p"), "0" * 64, ())
    truth = Truth.with_values(plan, {"trk.x": 1500.0, "trk.y": 500.0, "trk.z": 600.0})
    run = run_of(own, simulated_shots(truth, np.random.default_rng(3)), robot)
    shots = list(run.shots)
    values = list(shots[4].joints_deg)
    values[2] += 6.0
    shots[4] = shots[4].model_copy(update={"joints_deg": tuple(values)})
    found = first(replace(run, shots=tuple(shots)))
    assert (found.cause, found.measurements) == ("measurements", (4,))
    assert 6 not in {one.joint for one in found.readings}
    assert found.readings[0].joint == 3
