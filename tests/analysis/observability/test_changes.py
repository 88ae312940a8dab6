"""A zero or a target that changes during a run: found where it was put, and not where nothing changed."""

from pathlib import Path

import numpy as np
import pytest
from cells import good_plan, run_of

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.misfit import LackOfFit
from zerobeam.analysis.observability.changes import (
    RunChange,
    change_limit,
    run_change,
    run_change_with_links,
)
from zerobeam.analysis.solution import Solution
from zerobeam.experiments.simulate import Truth, simulated_readings, simulated_shots
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import read_run
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import criterion_sentence


@pytest.fixture(scope="module")
def plan() -> Plan:
    return good_plan(12, seed=2, geometry={})


def solved(plan: Plan, joints_added: Matrix, seed: int = 1) -> Solution:
    problem = Problem.from_plan(plan)
    run = simulated_readings(problem, problem.nominal()[None], np.random.default_rng(seed))
    return solve_run(problem.moved(run.joints[0] - joints_added, run.spots[0]), plan.header)


def course(plan: Plan, joint: int, degrees: float, share: Matrix) -> Matrix:
    """(N, n) by which the true position of a joint is more than recorded and its offset."""
    result = np.zeros((len(plan.postures), 6))
    result[:, joint - 1] = np.radians(degrees) * share
    return result


def test_a_jump_is_found_with_its_joint_its_place_and_its_size(plan: Plan) -> None:
    late = (np.arange(12) >= 5) * 1.0
    found = run_change(*_at(solved(plan, course(plan, 3, 0.6, late))))
    assert found is not None
    assert (found.how, found.joint, found.after_shot, found.before_shot) == ("jump", 3, 4, 5)
    assert found.amount == pytest.approx(0.6, abs=4 * found.std)
    assert "the zero of J3 jumped by 0.59" in criterion_sentence(found)


@pytest.mark.parametrize("timed", [True, False])
def test_measurements_follow_each_other_as_they_were_recorded(plan: Plan, timed: bool) -> None:
    """An adaptive run measures its postures in an order of its own: the zero jumps after the fifth, whatever
    the numbers. Without times the numbers are all that there is."""
    late = (np.arange(12) >= 5) * 1.0
    problem = solved(plan, course(plan, 3, 0.6, late)).problem
    numbers = [3, 8, 0, 11, 5, 1, 9, 2, 7, 10, 4, 6]
    shots = [
        Shot(
            shot=number,
            target="psd",
            joints_deg=tuple(np.degrees(row).tolist()),
            spot_mm=tuple(spot.tolist()),
            time_s=60.0 * i if timed else None,
        )
        for i, (number, row, spot) in enumerate(zip(numbers, problem.joints, problem.spots, strict=True))
    ]
    found = run_change(*_at(solve_run(Problem.from_run(run_of(plan.header, shots)), plan.header)))
    right = found is not None and (found.joint, found.after_shot, found.before_shot) == (3, 5, 1)
    assert right == timed


def test_a_steady_drift_is_found(plan: Plan) -> None:
    found = run_change(*_at(solved(plan, course(plan, 5, 1.0, np.linspace(0, 1, 12)))))
    assert found is not None
    drifts = [one for one in (found, *found.elsewhere) if one.how == "drift" and one.joint == 5]
    assert drifts
    assert drifts[0].amount == pytest.approx(1.0, abs=4 * drifts[0].std)


def test_where_nothing_changed_nothing_is_found(plan: Plan) -> None:
    assert all(run_change(*_at(solved(plan, np.zeros((12, 6)), seed))) is None for seed in range(8))


def test_it_is_a_misfit_where_the_squares_of_all_residuals_do_not_show_it(plan: Plan) -> None:
    late = (np.arange(12) >= 6) * 1.0
    sizes = [0.05, 0.16, 0.18, 0.2, 0.6]
    kinds = [
        [one.kind for one in solution.misfit.criteria] if solution.misfit else []
        for solution in (solved(plan, course(plan, 2, size, late)) for size in sizes)
    ]
    assert kinds[0] == []
    assert any(RunChange.kind in each and LackOfFit.kind not in each for each in kinds)
    assert LackOfFit.kind in kinds[-1]
    assert RunChange.kind not in kinds[-1]  # it has been said already


def test_an_estimated_noise_and_few_measurements_are_not_tested() -> None:
    estimated = good_plan(12, seed=2, noise={"scale": "estimated"})
    assert run_change(*_at(solved(estimated, course(estimated, 2, 2.0, np.arange(12) >= 6)))) is None
    assert change_limit(Problem.from_plan(good_plan(3, seed=2))) == float("inf")


def _at(solution: Solution) -> tuple[Problem, Matrix]:
    return solution.problem, solution.fit.x


def test_the_first_rehearsal_of_the_app_is_no_misfit() -> None:
    """A run without any change, of which the zero of J3 was said to have jumped by 0.09 deg (p 0.0002)."""
    run = read_run(Path(__file__).parents[2] / "support" / "rehearsal_seed_0.jsonl")
    solution = solve_run(Problem.from_run(run), run.header)
    assert solution.misfit is None
    assert solution.verdict == "pass"


def test_links_of_an_exact_arm_are_no_change() -> None:
    """An ordinary arm that is taken as exact: what links explain is the first suspect, not a belt."""
    named = []
    for seed in range(4):
        plan = good_plan(8, seed=seed, geometry={})
        truth = Truth.drawn(plan, np.random.default_rng(seed))
        shots = simulated_shots(truth, np.random.default_rng(seed))
        exact = good_plan(8, seed=seed, geometry="exact")
        run = run_of(exact.header, shots)
        solution = solve_run(Problem.from_run(run), run.header)
        if solution.misfit is not None:
            named += [one.kind for one in solution.misfit.criteria]
    assert named
    assert RunChange.kind not in named


@pytest.mark.parametrize("joint", [3])
def test_a_jump_of_an_exact_arm_is_still_found(joint: int) -> None:
    """Negative control: links within tolerances do not explain a jump of 1 deg."""
    plan = good_plan(14, seed=2, geometry="exact")
    solution = solved(plan, course(plan, joint, 1.0, (np.arange(14) >= 6) * 1.0))
    found = run_change_with_links(*_at(solution))
    assert found is not None
    assert solution.misfit is not None
