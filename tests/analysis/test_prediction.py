"""Another run as a fit predicts it: known truth, wrong truth, what is not determined, and what is refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cells import LASER, OPEN_LASER, TABLE_2, good_plan, placed_plan, simulated
from recordings import PANDA_1, recorded
from scipy import stats

from zerobeam.analysis.analyse import Analysis, analyse
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.prediction import PredictedRun, predict_run, require_predictable
from zerobeam.analysis.solution import Solution
from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import StatedGeometry, StatedNoise
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.run import Run, read_run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import notes, predicted_run_message, predicted_run_sentences
from zerobeam.words.message import message

LEVEL = 1e-3
PSD, NEW = (900.0, 0.0, 0.0), (850.0, -350.0, 200.0)
COUNTS = {"psd": 6, "new": 5}


def another(counts: dict[str, int] = COUNTS, tool: dict[str, Any] = LASER, **changes: Any) -> Plan:
    places = {"psd": PSD, "new": NEW}
    return placed_plan({name: places[name] for name in counts}, counts, tool, first_seed=50, **changes)


def other_run(plan: Plan, values: dict[str, float], seed: int) -> Run:
    return replace(simulated(plan, values, 1000 + seed)[1], sha256="1" * 64)


def solved(plan: Plan, seed: int = 0) -> tuple[Run, Solution]:
    run = simulated(plan, TABLE_2, seed)[1]
    return run, solve_run(Problem.from_run(run), run.header)


@pytest.fixture(scope="module")
def fitted() -> tuple[Run, Solution]:
    return solved(good_plan(12))


@pytest.fixture(scope="module")
def predicted_one(fitted: tuple[Run, Solution]) -> PredictedRun:
    return predict_run(fitted[1], other_run(another(), TABLE_2, 0))


COUNTED = [30, pytest.param(200, marks=pytest.mark.long)]


@pytest.mark.parametrize("count", COUNTED)
@pytest.mark.parametrize("noise", ["known", "estimated", pytest.param("separate", marks=pytest.mark.long)])
@pytest.mark.parametrize("tool", [LASER, OPEN_LASER], ids=["calibrated", "open"])
@pytest.mark.long
def test_the_p_values_are_uniform(count: int, noise: str, tool: dict[str, Any]) -> None:
    """A common target, and one that only the other run has. Kolmogorov and Smirnov at a level of 1e-3.

    With separate factors the fit's estimate of them is taken as known, as everywhere: many measurements.
    """
    shots = 60 if noise == "separate" else 12
    mine, theirs = (
        good_plan(shots, tool=tool, noise={"scale": noise}),
        another(tool=tool, noise={"scale": noise}),
    )
    p = []
    for seed in range(count):
        held_out = predict_run(solved(mine, seed)[1], other_run(theirs, TABLE_2, seed))
        assert held_out.dof == 2 * (6 + 5) - 3
        p.append(held_out.p_value)
    assert stats.kstest(np.array(p, dtype=float), "uniform").pvalue > LEVEL


@pytest.mark.long
def test_without_the_uncertainty_of_the_fit_they_would_not_be() -> None:
    """Negative control: few measurements fitted, errors held against their noise alone."""
    theirs, p = another({"psd": 12}), []
    for seed in range(30):
        held_out = predict_run(solved(good_plan(6), seed)[1], other_run(theirs, TABLE_2, seed))
        u = np.array([row.u_mm for row in held_out.measurements])
        expected = np.array([row.expected_mm for row in held_out.measurements], dtype=float)
        errors = np.array([row.error_mm for row in held_out.measurements], dtype=float)
        p.append(stats.chi2.sf(2 * (errors**2 / (expected**2 - u**2)).sum(), 24))
    assert stats.kstest(p, "uniform").pvalue < LEVEL


@pytest.mark.long
def test_the_errors_are_as_long_as_is_expected() -> None:
    """Mean squares over 40 runs of 22 numbers, correlated by the fit: their standard error is below 10 %."""
    squares = []
    for seed in range(40):
        held_out = predict_run(solved(good_plan(12), seed)[1], other_run(another(), TABLE_2, seed))
        assert held_out.rms_mm is not None
        assert held_out.expected_mm is not None
        squares.append((held_out.rms_mm**2, held_out.expected_mm**2))
    measured, expected = np.mean(squares, axis=0)
    spread = np.std([one / two for one, two in squares]) / np.sqrt(len(squares))
    assert measured / expected == pytest.approx(1, abs=4 * spread)
    assert spread < 0.1


def test_the_numbers_are_those_of_the_rows(predicted_one: PredictedRun) -> None:
    errors = np.array([row.error_mm for row in predicted_one.measurements], dtype=float)
    before = np.array([row.before_mm for row in predicted_one.measurements], dtype=float)
    assert predicted_one.rms_mm == pytest.approx(np.sqrt((errors**2).mean()))
    assert predicted_one.median_mm == pytest.approx(np.median(errors))
    assert predicted_one.max_mm == errors.max()
    assert predicted_one.rms_before_mm == pytest.approx(np.sqrt((before**2).mean()))
    assert predicted_one.median_before_mm == pytest.approx(np.median(before))
    assert predicted_one.max_before_mm == before.max()
    assert predicted_one.rms_mm < predicted_one.rms_before_mm / 10
    assert (predicted_one.targets_placed, predicted_one.shots, predicted_one.shots_fitted) == (
        ("new",),
        11,
        12,
    )


def test_a_common_target_is_predicted_at_its_estimate(fitted: tuple[Run, Solution]) -> None:
    """By the model itself: the residuals of the other run at the mode of the fit."""
    run, solution = fitted
    other = other_run(another({"psd": 6}), TABLE_2, 0)
    held_out = predict_run(solution, other)
    residual = Problem.from_run(replace(other, header=run.header)).linearise(solution.fit.x)[0]
    errors = [row.error_mm for row in held_out.measurements]
    assert errors == pytest.approx(np.linalg.norm(residual, axis=1).tolist())
    assert held_out.dof == 12


def test_another_zero_in_the_other_run_is_noticed(fitted: tuple[Run, Solution]) -> None:
    wrong = {**TABLE_2, "delta3": TABLE_2["delta3"] + 0.3}
    held_out = predict_run(fitted[1], other_run(another(), wrong, 0))
    assert held_out.p_value is not None
    assert held_out.p_value < 1e-6
    assert "do not carry over" in " ".join(predicted_run_sentences(held_out))


def test_a_wrong_link_in_the_other_run_is_noticed(fitted: tuple[Run, Solution]) -> None:
    """Its forearm is 5 mm longer, which its file does not say."""
    plan = another()
    joints = list(plan.robot.joints)
    fixed = joints[2].fixed.copy()
    fixed[:3, 3] *= 1 + 5.0 / np.linalg.norm(fixed[:3, 3])
    joints[2] = replace(joints[2], fixed=fixed)
    longer = replace(plan.robot, joints=tuple(joints))
    other = replace(other_run(replace(plan, robot=longer), TABLE_2, 0), robot=plan.robot)
    held_out = predict_run(fitted[1], other)
    assert held_out.p_value is not None
    assert held_out.p_value < 1e-6


def test_what_the_data_do_not_determine_has_no_number() -> None:
    """In the fitted run joint 4 never moves, nor does any behind it; in the other run all do."""
    plan = good_plan(12)
    postures = np.degrees(plan.postures[:2])[[0, 1] * 6]
    run, solution = solved(replace(plan, shots=planned(postures, plan.targets)))
    assert run.joints.shape == (12, 6)
    held_out = predict_run(solution, other_run(another({"psd": 6}), TABLE_2, 0))
    assert held_out.unknown
    for row in held_out.measurements:
        assert (row.error_mm is None) == (row.shot in held_out.unknown)
        assert row.u_mm > 0
    assert "unknown" in (predicted_run_message(held_out) or "")
    if len(held_out.unknown) == held_out.shots:
        assert (held_out.rms_mm, held_out.max_mm, held_out.p_value) == (None, None, None)


def test_a_target_takes_up_what_places_it(fitted: tuple[Run, Solution]) -> None:
    """One measurement of a new target by a beam: two numbers and three coordinates."""
    plan = another({"psd": 6, "new": 2})
    one = replace(plan, shots=plan.shots[:7], lines=plan.lines[:7])
    held_out = predict_run(fitted[1], other_run(one, TABLE_2, 0))
    assert held_out.taken_up == (6,)
    assert held_out.measurements[6].error_mm is None
    assert held_out.dof == 12
    assert "no prediction" in (predicted_run_message(held_out) or "")


def test_fewer_measurements_than_unknowns_are_predicted() -> None:
    """Of a header that insists on gravity, a run to fit would be refused; it is predicted all the same."""
    geometry = {"gravity": True}
    _, solution = solved(good_plan(60, geometry=geometry))
    enough = other_run(another({"psd": 10}, geometry=geometry), TABLE_2, 0)
    few = replace(enough, shots=enough.shots[:3], lines=enough.lines[:3])
    with pytest.raises(BadInput, match="gravity"):
        Problem.from_run(few)
    held_out = predict_run(solution, few)
    assert held_out.dof == 6
    assert held_out.rms_mm is not None


def test_a_fit_that_did_not_converge_predicts_nothing(fitted: tuple[Run, Solution]) -> None:
    _, solution = fitted
    lost = replace(solution, fit=replace(solution.fit, converged=False, reason="no way up"))
    held_out = predict_run(lost, other_run(another(), TABLE_2, 0))
    assert (held_out.rms_mm, held_out.measurements) == (None, ())
    assert predicted_run_message(held_out) == "the fit did not converge: no way up"


def changed_header(run: Run, **changes: Any) -> Run:
    return replace(run, header=run.header.model_copy(update=changes))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda run: replace(run, shots=()), "no measurements"),
        (lambda run: replace(run, sha256="0" * 64), "is the run itself"),
        (lambda run: replace(run, robot=replace(run.robot, name="twin")), "another robot"),
        (lambda run: replace(run, robot=replace(run.robot, flange=np.eye(4) * 2)), "geometry of the robot"),
        (
            lambda run: changed_header(run, tool=run.header.tool.model_copy(update={"calibrated": False})),
            "another tool.calibrated",
        ),
        (
            lambda run: changed_header(run, noise=StatedNoise(joint_deg=0.02, spot_mm=0.05)),
            "another noise.joint_deg",
        ),
        (lambda run: changed_header(run, held=("delta1", "delta2")), "another held"),
        (lambda run: changed_header(run, provenance={"Serial": "B"}), "A in run.jsonl, B in run.jsonl"),
        (lambda run: changed_header(run, geometry=StatedGeometry()), "another geometry"),
    ],
)
def test_another_run_is_refused_with_what_differs(
    fitted: tuple[Run, Solution], change: Callable[[Run], Run], words: str
) -> None:
    other = other_run(another(), TABLE_2, 0)
    run = changed_header(fitted[0], provenance={"robot_serial": "A"})
    require_predictable(run, other)
    with pytest.raises(BadInput) as caught:
        require_predictable(run, change(other))
    assert words in str(caught.value)


@pytest.fixture(scope="module")
def wrong_run(fitted: tuple[Run, Solution]) -> Analysis:
    other = other_run(another(), {**TABLE_2, "delta3": TABLE_2["delta3"] + 0.3}, 0)
    return analyse(fitted[0], sampling="never", held_out=other)


def test_a_pass_is_in_doubt_where_another_run_contradicts_it(wrong_run: Analysis) -> None:
    result = wrong_run.result
    assert result.verdict == "pass"
    assert any("The held-out run run.jsonl is predicted with errors" in note for note in notes(result))
    action = message(result).action.text
    assert action == "Enter nothing yet: look for what differs in the held-out run."


@pytest.mark.long
def test_halves_of_a_real_arm_predict_each_other(shared_data: Any) -> None:
    """Every other placement of a recording predicts the rest: with links estimated better than nominal."""
    whole = read_run(recorded(shared_data, PANDA_1)[1])
    places = list(dict.fromkeys(name.rsplit("_", 1)[0] for name in whole.target_names))
    halves = []
    for k in range(2):
        chosen = set(places[k::2])
        shots = [shot for shot in whole.shots if shot.target.rsplit("_", 1)[0] in chosen]
        header = whole.header.model_copy(
            update={
                "geometry": StatedGeometry(),
                "noise": StatedNoise(joint_deg=0.01, spot_mm=0.1, scale="estimated"),
                "distances": tuple(
                    row for row in whole.header.distances if row.between[0].rsplit("_", 1)[0] in chosen
                ),
            }
        )
        halves.append(Run.of_shots(header, whole.robot, shots, f"half-{k}"))
    require_predictable(*halves)
    solution = solve_run(Problem.from_run(halves[0]), halves[0].header)
    held_out = predict_run(solution, halves[1])
    assert held_out.rms_mm is not None
    assert held_out.rms_before_mm is not None
    assert set(held_out.targets_placed) == set(halves[1].target_names)
    assert held_out.rms_mm < held_out.rms_before_mm / 1.5
