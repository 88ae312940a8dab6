"""Values to enter: the best five offsets for nominal geometry, and the error of the TCP that they leave."""

from __future__ import annotations

import numpy as np
import pytest
from cells import LASER, TABLE_2, good_plan, header, plan_of
from scipy import optimize

from zerobeam.analysis.diagnostics.enter import _Region, entered
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.solution import Solution
from zerobeam.experiments.simulate import Truth, simulated_readings
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import StatedRequirement
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem

ARMS = 12


@pytest.fixture(scope="module")
def plan() -> Plan:
    return plan_of(header({**LASER, "sigma": {}}, geometry={}), good_plan(12, seed=2).postures)


@pytest.fixture(scope="module")
def arms(plan: Plan) -> list[tuple[Solution, Matrix]]:
    """Runs of arms that deviate as is typical, solved, and their true parameters."""
    problem, rng = Problem.from_plan(plan), np.random.default_rng(4)
    truths = np.array([Truth.drawn(plan, rng).x for _ in range(ARMS)])
    runs = simulated_readings(problem, truths, rng)
    return [
        (solve_run(problem.moved(joints, spots), plan.header), x)
        for joints, spots, x in zip(runs.joints, runs.spots, truths, strict=True)
    ]


def in_order(solution: Solution, values: dict[str, float]) -> Matrix:
    """(n,) rad, 0 of those that are not entered."""
    return np.radians([values.get(f"delta{i + 1}", 0.0) for i in range(solution.problem.robot.n)])


def test_no_five_offsets_serve_better(arms: list[tuple[Solution, Matrix]]) -> None:
    """A direct search over the expected squared error finds less than 1 % to gain."""
    solution, _ = arms[0]
    region = _Region(solution)
    told, _ = entered(solution)
    assert told is not None

    def cost(offsets: Matrix) -> float:
        return float((region.errors(np.append(0.0, offsets)) ** 2).mean())

    best = in_order(solution, told.values)[1:]
    found = optimize.minimize(cost, best, method="Nelder-Mead", options={"xatol": 1e-7, "maxiter": 400})
    assert cost(best) < 1.01 * found.fun
    assert cost(best + np.radians(0.3)) > 1.01 * found.fun  # the control: it is a search that can find more


def test_the_error_of_the_true_arm_is_as_told(arms: list[tuple[Solution, Matrix]]) -> None:
    held = 0
    for solution, x in arms:
        told, _ = entered(solution)
        assert told is not None
        region = _Region(solution)
        arm = x[solution.problem.parameters.arm].copy()
        arm[0] = 0.0
        (true,) = solution.problem.functions.kernel("place")(region.joints, arm, region.points)
        off = {
            name: np.median(np.linalg.norm(true - region.nominal(offsets)[0], axis=1))
            for name, offsets in (
                ("after", in_order(solution, told.values)),
                ("before", np.zeros(solution.problem.robot.n)),
            )
        }
        assert told.tcp_after.median_mm < told.tcp_before.median_mm
        low, high = told.tcp_after.median_band_mm
        held += low <= off["after"] <= high
    assert held >= ARMS - 3


def test_of_an_exact_arm_they_are_the_estimates() -> None:
    plan = good_plan(7, seed=2)
    truth = Truth.with_values(plan, TABLE_2)
    run = simulated_readings(truth.problem, truth.x[None], np.random.default_rng(1))
    solution = solve_run(truth.problem.moved(run.joints[0], run.spots[0]), plan.header)
    told, conformity = entered(solution, StatedRequirement(tcp_mm=0.01))
    assert told is not None
    assert conformity is not None
    for row in solution.offsets:
        if row.name in told.values:
            assert told.values[row.name] == pytest.approx(row.estimate, abs=1e-9)
    assert conformity.decision == "does not conform"
    generous = entered(solution, StatedRequirement(tcp_mm=10.0))[1]
    assert generous is not None
    assert (generous.decision, generous.probability) == ("conforms", 1.0)
    middle = entered(solution, StatedRequirement(tcp_mm=conformity.tcp_95_mm))[1]
    assert middle is not None
    assert middle.decision == "undecided"


def test_nothing_is_entered_where_the_data_do_not_determine_it() -> None:
    postures = good_plan(7, seed=2).postures.copy()
    postures[:, 0] = 0.1
    plan = plan_of(header(), postures)
    truth = Truth.with_values(plan, {})
    run = simulated_readings(truth.problem, truth.x[None], np.random.default_rng(1))
    solution = solve_run(truth.problem.moved(run.joints[0], run.spots[0]), plan.header)
    assert solution["delta2"].estimate is None
    assert entered(solution, StatedRequirement(tcp_mm=1.0)) == (None, None)
