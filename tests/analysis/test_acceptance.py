"""The acceptance test: its false alarms and its power are those stated, and it never passes without power."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from cells import irb1600
from exact_runs import demo_runs
from measured_arms import CELLS, recorded
from plan_requests import plan_request
from scipy import stats

from zerobeam.analysis.acceptance import (
    AIM,
    FALSE_ALARM,
    POWER,
    AcceptancePrediction,
    _placing,
    accept,
    choose,
    lacking_test,
)
from zerobeam.analysis.diagnostics.values_to_enter import values_to_enter
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.prediction import Predictor, of_rows
from zerobeam.experiments.plans.make import MadePlan, make_plan
from zerobeam.model.files.header import Header, StatedSigma
from zerobeam.model.files.run import read_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.sentences import to_json

TOLERANCE = {"deg": 0.1, "mm": 1.0}
NAMES = tuple(f"delta{j}" for j in range(2, 7))


@cache
def calibrated():
    run = read_run(demo_runs()[0].path)
    # With a mounting that is stated: what is as good as an assumption is not entered.
    tool = run.header.tool.model_copy(update={"sigma": StatedSigma(tilt_deg=0.001, shift_mm=0.01)})
    run = replace(run, header=run.header.model_copy(update={"geometry": "exact", "tool": tool}))
    return run, solve_run(Problem.from_run(run), run.header)


@cache
def entered():
    """The values to enter, deg; those of joint 2 are not quite the estimate, as of an arm that deviates."""
    values = values_to_enter(calibrated()[1])
    return {**values, "delta2": values["delta2"] + 0.03}


def applied():
    """(6,) rad."""
    return np.radians([entered().get(f"delta{j}", 0.0) for j in range(1, 7)])


def prediction(rows=None, error=None, seed=0, errors=1.0):
    """New measurements of an arm whose true offsets differ from the estimates as the posterior says (times
    `errors`), and by `error` (deg, by name) besides; read with the stated noise."""
    run, solution = calibrated()
    problem, rng = solution.problem, np.random.default_rng(seed)
    rows = list(range(problem.shots)) if rows is None else list(rows)
    free = problem.parameters.free
    z = np.linalg.cholesky(solution.fit.covariance) @ rng.normal(size=int(free.sum()))
    left = np.zeros(len(free))
    left[free] = errors * z * problem.parameters.prior_std[free]
    for name, value in (error or {}).items():
        left[problem.parameters.index(name)] += np.radians(value)
    block = problem.parameters.block("offset")
    # True positions are those of the fit; a corrected arm reads more by what was entered.
    corrected = AcceptancePrediction(
        Predictor.of(solution), new_run(problem.joints + applied(), run_targets(run), None), entered()
    )
    x = solution.fit.x + left
    x[block] -= applied()
    place = corrected.problem.parameters.block("target")
    x[place] = solution.fit.x[problem.parameters.block("target")]
    residual, own = corrected.problem.linearise(x)
    factor = corrected.problem.factors(x, own)
    noise = (factor @ rng.normal(size=(*residual.shape, 1)))[..., 0]
    # A spot reading moves the residual one for one: what makes it noise, and nothing else.
    spots = spots_for(corrected.problem, x, noise - residual)
    joints = corrected.problem.joints[rows]
    targets = [run_targets(run)[row] for row in rows]
    new = new_run(joints, targets, spots[rows])
    return AcceptancePrediction(Predictor.of(solution), new, entered()), solution


def new_run(joints, targets, spots):
    """A problem of the same robot and laser."""
    run, _ = calibrated()
    return Problem.build(run.header, run.robot, joints, targets, spots)


def run_targets(run):
    return [shot.target for shot in run.shots]


def spots_for(problem, x, wanted):
    """Spots (N, 2) with which the residuals change by `wanted` (N, 2)."""
    base, _ = problem.linearise(x)
    columns = []
    for axis in range(2):
        moved, _ = replace(problem, spots=problem.spots + np.eye(2)[axis]).linearise(x)
        columns.append(moved - base)
    by = np.stack(columns, axis=2)
    return problem.spots + np.linalg.solve(by, wanted[..., None])[..., 0]


@pytest.mark.long
def test_false_alarms_are_as_rare_as_stated():
    p = [answer(seed=seed).p_value for seed in range(150)]
    share = float(np.mean(np.array(p) < 0.2))
    # 150 of a fifth: four standard deviations of the binomial.
    assert abs(share - 0.2) < 4 * np.sqrt(0.2 * 0.8 / 150)
    assert sum(value < FALSE_ALARM for value in p) <= 8


def answer(**how):
    made, solution = prediction(**how)
    return accept(made, solution, TOLERANCE)


@pytest.mark.parametrize("tests", [40, pytest.param(300, marks=pytest.mark.long)])
@pytest.mark.at_length(r"^40$")
def test_the_power_is_that_of_the_count(tests):
    stated = {own.name: own.power for own in answer(rows=range(5)).offsets}
    noticed = [answer(rows=range(5), error={"delta2": 0.1}, seed=s).verdict == "fail" for s in range(tests)]
    power = stated["delta2"]
    assert abs(np.mean(noticed) - power) < 4 * np.sqrt(power * (1 - power) / tests) + 0.02


def test_a_right_calibration_passes_and_one_that_was_not_entered_is_named():
    assert answer().verdict == "pass"
    estimate = entered()["delta2"]
    found = answer(error={"delta2": estimate})
    assert found.verdict == "fail"
    assert found.mistakes[0].kind == "not entered"
    assert found.mistakes[0].offsets == ("delta2",)
    wrong = answer(error={"delta2": 2 * estimate})
    assert (wrong.mistakes[0].kind, wrong.mistakes[0].offsets) == ("wrong sign", ("delta2",))


@pytest.mark.parametrize(
    ("kind", "names", "error"),
    [
        ("entered twice", NAMES, dict.fromkeys(NAMES, -1.0)),
        ("entered twice", ("delta2",), {"delta2": -1.0}),
        ("joint 2 added", ("delta3",), {"delta3": "-delta2"}),
        ("joint 2 subtracted", ("delta3",), {"delta3": "delta2"}),
    ],
)
def test_each_mistake_is_named_and_no_other(kind, names, error, monkeypatch):
    """Of an arm whose pendant counts joint 3 from the ground; of another one there is no coupling."""
    more = {
        name: times * entered()[name]
        if isinstance(times, float)
        else (-1 if times[0] == "-" else 1) * entered()["delta2"]
        for name, times in error.items()
    }
    made, solution = prediction(error=more)
    conventions = replace(made.problem.robot.conventions, joint3="ground")
    made.problem = replace(made.problem, robot=replace(made.problem.robot, conventions=conventions))
    found = accept(made, solution, TOLERANCE)
    assert found.verdict == "fail"
    assert [(each.kind, each.offsets) for each in found.mistakes] == [(kind, names)]
    plain = answer(error=more).mistakes
    assert [each.kind for each in plain] == ([kind] if kind == "entered twice" else [])


@pytest.mark.parametrize("rows", [(0, 1), (0, 1, 2)])
def test_too_few_postures_never_pass(rows):
    found = answer(rows=rows)
    assert found.verdict == "inconclusive"
    assert found.unnoticed
    assert all(own.power < POWER for own in found.unnoticed)


def test_one_posture_leaves_nothing_to_judge_by():
    found = answer(rows=(0,))
    assert (found.dof, found.p_value, found.verdict) == (0, None, "inconclusive")


def test_the_chosen_postures_are_enough_where_they_can_be():
    run, solution = calibrated()
    plan = choose(solution, entered(), TOLERANCE)
    assert plan.enough
    assert 3 <= len(plan.rows) <= len(run.shots)
    assert plan.narrow == (min(row.power for row in plan.offsets) < AIM)
    tight = choose(solution, entered(), {"deg": 0.001, "mm": 1.0})
    assert not tight.enough
    fixed = [choose(solution, entered(), TOLERANCE, count) for count in range(3, len(run.shots) + 1)]
    weakest = [min(row.power for row in each.offsets) for each in (plan, *fixed)]
    assert weakest[0] >= min(AIM, max(weakest))  # it does not stop below what these postures reach
    offsets = np.degrees(plan.joints - solution.problem.joints[list(plan.rows)])
    np.testing.assert_allclose(offsets[0, 1:], [entered()[name] for name in NAMES], atol=1e-9)


def p_values(kind, count, error_deg=0.0):
    """(count,) of new measurements by instruments of a `kind`, of random arms of which nothing was entered;
    all read `error_deg` more of joint 3 than in the calibration."""
    cell, rng, robot = CELLS[kind], np.random.default_rng(4), calibrated()[0].robot
    header = cell.header(geometry="exact", joint_deg=0.005)
    result = []
    for _ in range(count):
        arm = recorded(cell, 40, rng, exact=True, joint_deg=0.005)
        joints = arm.joints.copy()
        joints[28:, 2] += np.radians(error_deg)
        old, new = (
            Problem.of_measured(header, robot, joints[rows], arm.measured[rows])
            for rows in (slice(28), slice(28, None))
        )
        test = AcceptancePrediction(Predictor.of(solve_run(old, header)), new, {})
        result.append(test.shifted({}).p_value)
    return np.array(result)


@pytest.mark.parametrize("kind", ["tracker", "plane"])
@pytest.mark.long
def test_of_other_instruments_a_right_robot_agrees_and_a_wrong_one_does_not(kind):
    assert (p_values(kind, 2) > 1e-4).all()
    assert (p_values(kind, 2, 1.0) < FALSE_ALARM).all()


@pytest.mark.long
@pytest.mark.parametrize("kind", ["tracker", "pose", "plane", "ballbar", "tracker + plane + ballbar"])
def test_the_false_alarms_of_every_kind_are_as_stated(kind):
    """P-values of right robots are uniform (Kolmogorov and Smirnov's p above 1e-4)."""
    assert stats.kstest(p_values(kind, 60), "uniform").pvalue > 1e-4
    assert stats.kstest(p_values(kind, 20, 1.0), "uniform").pvalue < 1e-4


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


def sockets() -> Problem:
    """A ball bar, ten readings in each of two sockets in turn."""
    cell = CELLS["ballbar"]
    arm = recorded(cell, 20, np.random.default_rng(1), exact=True, joint_deg=0.01)
    return Problem.of_measured(
        cell.header(geometry=None, joint_deg=0.01), irb1600(), arm.joints, arm.measured
    )


def test_lengths_of_a_socket_are_made_up_to_four_or_left_out():
    problem = sockets()
    assert _placing(problem, [0, 2, 4, 6], np.arange(problem.shots)) == [0, 2, 4, 6]
    completed = _placing(problem, [0, 2, 4, 6, 8, 1, 3], np.arange(problem.shots))
    assert completed[:7] == [0, 2, 4, 6, 8, 1, 3]
    assert [row % 2 for row in completed[7:]] == [1, 1]
    few = problem.select(np.array([0, 2, 4, 6, 8, 1, 3]))
    assert _placing(few, [0, 1, 2, 3, 5], np.arange(few.shots)) == [0, 1, 2, 3]
