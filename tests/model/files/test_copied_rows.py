"""A copied row is no measurement, wherever measurements come in."""

import numpy as np
import pytest
from pose_runs import pose_run, postures

import zerobeam as zb
from zerobeam.analysis.solution import solve
from zerobeam.model.files.run import Run, write_run
from zerobeam.model.files.shot import copies
from zerobeam.model.likelihood.problem import Problem

MOVING = (1, 2, 3, 4, 5, 6)


def numbered(shots):
    return [shot.model_copy(update={"shot": i}) for i, shot in enumerate(shots)]


@pytest.fixture(scope="module")
def once():
    return pose_run(postures(8, MOVING), {"delta3": 0.5})


def test_each_row_four_times_is_the_same_answer_and_said(once, tmp_path):
    path = tmp_path / "four.jsonl"
    write_run(path, once.header, numbered(list(once.shots) * 4))
    run = zb.read_run(path)
    assert len(run.shots) == 8
    assert run.lines == tuple(range(2, 10))
    (said,) = run.warnings
    assert said == (
        "24 of 32 measurements are copies, such as measurement 8 (line 10) of measurement 0 (line 2): joints"
        " and readings are identical to the last digit. A copy is no measurement: each is counted once, 8"
        " measurements in all"
    )
    single = solve(Problem.from_run(once), starts=0)
    assert solve(Problem.from_run(run), starts=0).offset_std == single.offset_std


def test_a_run_of_arrays_too(once):
    run = Run.of_shots(once.header, once.robot, numbered([*once.shots, once.shots[2]]), "arrays")
    assert len(run.shots) == 8
    (said,) = run.warnings
    assert said.startswith("measurement 8 is a copy of measurement 2: ")


@pytest.mark.parametrize(
    "change",
    [
        {"joints_deg": (30.0, -90.0, 60.0, -80.0, -70.0, 20.000000001)},
        {"measured_mm": (1.0, 2.0, 3.0)},
        {"time_s": 12.0},
        {"sigma_mm": 0.3},
    ],
)
def test_what_differs_anywhere_is_a_measurement(once, change):
    shots = [*once.shots, once.shots[2].model_copy(update=change)]
    assert copies(shots) == {}


def test_a_comment_makes_no_measurement(once):
    assert copies([*once.shots, once.shots[2].model_copy(update={"comment": "again"})]) == {8: 2}


def test_a_run_of_one_posture_keeps_its_rows_for_the_error_that_names_it(once):
    run = Run.of_shots(once.header, once.robot, numbered([once.shots[0]] * 3), "arrays")
    assert len(run.shots) == 3
    with pytest.raises(zb.BadInput, match="one posture"):
        run.require_analysable()
    assert np.ptp(run.joints, axis=0).max() == 0
