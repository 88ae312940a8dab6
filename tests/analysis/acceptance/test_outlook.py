"""The acceptance test as a plan predicts it: its power is that after the run, and too few are named."""

from functools import cache

import numpy as np
import pytest
from exact_runs import demo_runs
from plan_requests import plan_request

from zerobeam.analysis.acceptance import AIM, POWER, AcceptancePrediction, lacking_test
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.prediction import Predictor, of_rows
from zerobeam.experiments.plans.make import MadePlan, make_plan
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.sentences import to_json

PROBE = {
    "robot": "ur5e",
    "tool": {"kind": "probe", "calibrated": False, "point_mm": [30, 0, 120]},
    "held": ["delta1", "delta6"],
    "targets": {"socket": {"guess_mm": [500, 100, 150]}},
}


@cache
def made(shots: int, scale: str = "known") -> MadePlan:
    noise = {"joint_deg": 0.01, "spot_mm": 0.12, "scale": scale}
    header = Header.model_validate({**PROBE, "noise": noise})
    return make_plan(plan_request(header=header, target=None, shots=shots), None, lambda *_: None)


def test_the_predicted_power_is_that_of_the_solved_run() -> None:
    """Of the demo run, at its own mode: another tolerance is where the one says that the test lacks it."""
    run = read_run(demo_runs()[0].path)
    solution = solve_run(Problem.from_run(run), run.header)
    problem, names = solution.problem, [row.name for row in solution.offsets if not row.held]
    after = AcceptancePrediction(
        Predictor.of(solution),
        of_rows(problem, list(range(problem.shots))),
        dict.fromkeys(names, 0.0),
        planned=True,
    )
    for tolerance in (0.01, 0.03):
        every = after.powers(after.shifted({}), dict.fromkeys(names, (tolerance,)))
        powers = {name: one for name, (one,) in every.items()}
        lacking = lacking_test(problem, solution.fit.x, {"deg": tolerance, "mm": 1.0})
        assert lacking is not None
        assert lacking.name == min(powers, key=powers.__getitem__)
        assert lacking.power == pytest.approx(powers[lacking.name], rel=0.02)
    assert lacking_test(problem, solution.fit.x, {"deg": 1.0, "mm": 1.0}) is None


@pytest.mark.long
def test_too_few_measurements_are_named_with_the_number_that_is_enough() -> None:
    few = made(8)
    lacking = few.untested
    assert lacking is not None
    assert lacking.power < POWER < AIM
    assert f"Some {lacking.needed} measurements" in few.sentences[-1]
    assert few.sentences[-1].startswith("A calibration by 8 measurements is predicted to leave no acceptance")
    assert to_json(few)["said"] == few.sentences
    enough = made(lacking.needed)  # the control: of so many nothing is said
    assert enough.untested is None
    assert not any("acceptance" in sentence for sentence in enough.sentences)


@pytest.mark.long
def test_noise_that_is_estimated_needs_degrees_of_freedom() -> None:
    known, estimated = made(8).checked, made(8, scale="estimated").checked
    assert known is not None
    assert estimated is not None
    tolerance = {"deg": 0.1, "mm": 1.0}
    few = [lacking_test(each.aimed.aimed.problem, each.aimed.x, tolerance) for each in (known, estimated)]
    assert few[1] is not None
    assert few[0] is None or few[1].power < few[0].power
    fewer = made(5, scale="estimated").checked
    assert fewer is not None
    lacking = lacking_test(fewer.aimed.aimed.problem, fewer.aimed.x, tolerance)
    assert lacking is not None
    assert lacking.power == 0
    assert lacking.needed is not None


def test_where_no_number_is_enough_none_is_stated() -> None:
    run = read_run(demo_runs()[0].path)
    problem = Problem.from_run(run)
    lacking = lacking_test(problem, problem.nominal(), {"deg": 1e-4, "mm": 1.0})
    assert lacking is not None
    assert lacking.needed is None
    assert np.isfinite(lacking.power)
