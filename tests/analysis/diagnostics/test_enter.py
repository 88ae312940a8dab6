"""Values to enter: the best five offsets for nominal geometry, and the error of the TCP that they leave."""

import dataclasses
from typing import Literal

import numpy as np
import pytest
from cells import LASER, TABLE_2, good_plan, header, plan_of
from scipy import optimize

from zerobeam.analysis.diagnostics.accuracy import accuracy
from zerobeam.analysis.diagnostics.values_to_enter import (
    TcpSpread,
    controller_arm,
    entered,
    held_by_a_robot,
    values_to_enter,
)
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.solution import Solution
from zerobeam.experiments.simulate import Truth, simulated_readings
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import StatedRequirement
from zerobeam.model.files.stated_workspace import StatedWorkspace
from zerobeam.model.likelihood.problem import Problem

TYPICAL = {"geometry": None}


def calibrated(shots: int, arms: int, seed: int = 4) -> list[tuple[Solution, Matrix]]:
    """Runs of arms that deviate as is typical, solved, and their true parameters."""
    postures = good_plan(shots, seed=2).postures
    plan = plan_of(header(LASER, **TYPICAL), postures)
    problem, rng = Problem.from_plan(plan), np.random.default_rng(seed)
    truths = np.array([Truth.drawn(plan, rng).x for _ in range(arms)])
    runs = simulated_readings(problem, truths, rng)
    return [
        (solve_run(problem.moved(joints, spots), plan.header), x)
        for joints, spots, x in zip(runs.joints, runs.spots, truths, strict=True)
    ]


@pytest.fixture(scope="module")
def arms() -> list[tuple[Solution, Matrix]]:
    return calibrated(12, 8)


def true_errors(solution: Solution, x: Matrix, values: dict[str, float]) -> Matrix:
    """(P,) mm of the TCP of the arm x (p,), over the region, with these values entered."""
    spread = TcpSpread(solution)
    return np.linalg.norm(
        spread.placed(x[solution.problem.parameters.arm])
        - spread.placed(controller_arm(solution.problem, values)),
        axis=1,
    )


@pytest.mark.long
def test_no_other_offsets_serve_better(arms: list[tuple[Solution, Matrix]]) -> None:
    """A direct search over the expected squared error of the TCP finds less than 1 % to gain."""
    solution, _ = arms[0]
    spread, values = TcpSpread(solution), values_to_enter(solution)
    names = list(values)

    def cost(offsets: Matrix) -> float:
        arm = controller_arm(solution.problem, dict(zip(names, offsets, strict=True)))
        return float((spread.errors(arm) ** 2).mean())

    best = np.array([values[name] for name in names])
    found = optimize.minimize(cost, best, method="Nelder-Mead", options={"xatol": 1e-5, "maxiter": 300})
    assert cost(best) < 1.01 * found.fun
    assert cost(best + 0.3) > 1.01 * found.fun  # the control: it is a search that can find more


def test_the_region_of_the_fit_is_large_enough(
    arms: list[tuple[Solution, Matrix]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Twice the postures change the expected squared error by less than 0.1 %."""
    solution, _ = arms[0]
    spread = TcpSpread(solution)

    def cost(values: dict[str, float]) -> float:
        return float((spread.errors(controller_arm(solution.problem, values)) ** 2).mean())

    values = values_to_enter(solution)
    monkeypatch.setattr("zerobeam.analysis.diagnostics.values_to_enter.FITTED", 256)
    more = values_to_enter(solution)
    assert values != more
    assert cost(values) == pytest.approx(cost(more), rel=1e-3)


def as_predicted(arms: list[tuple[Solution, Matrix]]) -> tuple[int, int]:
    """How many arms have their true median in its band, and how many are better off than before."""
    held = better = 0
    for solution, x in arms:
        told, whole, _ = entered(solution)
        assert told is not None
        assert told.tcp_after is not None
        assert whole is not None
        after, before = (np.median(true_errors(solution, x, values)) for values in (told.values, {}))
        low, high = told.tcp_after.median_band_mm
        held += low <= after <= high
        better += after < before
    return held, better


def test_the_error_of_the_true_arm_is_as_predicted(arms: list[tuple[Solution, Matrix]]) -> None:
    held, better = as_predicted(arms)
    assert held >= 6  # of 8 with 95 % each fewer have a probability of 6e-3
    assert better >= 7


@pytest.mark.long
@pytest.mark.parametrize("shots", [12, 30])
def test_the_error_of_fifty_arms_is_as_predicted(shots: int) -> None:
    held, better = as_predicted(calibrated(shots, 50))
    assert 45 <= held <= 50
    assert better >= 49  # an arm that happens to be good cannot gain


def test_a_controller_that_takes_links_gains_more(arms: list[tuple[Solution, Matrix]]) -> None:
    for solution, _ in arms:
        told, whole, _ = entered(solution)
        assert told is not None
        assert whole is not None
        assert told.tcp_after is not None
        assert whole.tcp_after is not None
        assert whole.tcp_after.median_mm < told.tcp_after.median_mm
        assert whole.values["delta2"] == pytest.approx(solution["delta2"].estimate)
        assert set(whole.values) >= set(told.values)
    # What is left is the posterior's spread and what bends.
    spread = TcpSpread(solution)
    left = spread.position - spread.placed(held_by_a_robot(solution.problem, solution.fit.x))
    assert 0 < np.abs(left).max() < 1.0


@pytest.mark.long
def test_the_uncertainty_is_that_of_what_serves_the_arm_best(arms: list[tuple[Solution, Matrix]]) -> None:
    """By the values of arms at random from the posterior: the fit repeated for each."""
    solution, _ = arms[0]
    told = entered(solution)[0]
    assert told is not None
    rng, parameters = np.random.default_rng(3), solution.problem.parameters
    root = np.linalg.cholesky(solution.fit.covariance)
    rows = []
    for _ in range(150):
        x = solution.fit.x.copy()
        x[parameters.free] += (root @ rng.normal(size=len(root))) * parameters.prior_std[parameters.free]
        rows.append(
            values_to_enter(dataclasses.replace(solution, fit=dataclasses.replace(solution.fit, x=x)))
        )
    for name, u in told.u.items():
        # The std of 150 draws is right to 6 %.
        assert np.std([row[name] for row in rows]) == pytest.approx(u, rel=0.25)


def test_of_an_exact_arm_they_are_the_estimates() -> None:
    plan = good_plan(7, seed=2)
    truth = Truth.with_values(plan, TABLE_2)
    run = simulated_readings(truth.problem, truth.x[None], np.random.default_rng(1))
    solution = solve_run(truth.problem.moved(run.joints[0], run.spots[0]), plan.header)
    told, whole, conformity = entered(solution, StatedRequirement(tcp_mm=0.01))
    assert told is not None
    assert whole is None
    assert conformity is not None
    for row in solution.offsets:
        if row.name in told.values:
            assert told.values[row.name] == pytest.approx(row.estimate, abs=1e-12)
            assert told.u[row.name] == pytest.approx(row.std, rel=1e-9)
    assert conformity.decision == "does not conform"
    generous = entered(solution, StatedRequirement(tcp_mm=10.0))[2]
    assert generous is not None
    assert (generous.decision, generous.probability) == ("conforms", 1.0)
    middle = entered(solution, StatedRequirement(tcp_mm=conformity.tcp_95_mm))[2]
    assert middle is not None
    assert middle.decision == "undecided"


def test_what_is_left_out_is_in_neither_arm(arms: list[tuple[Solution, Matrix]]) -> None:
    """Its place is not taken by the others."""
    solution, _ = arms[0]
    whole, without = values_to_enter(solution), values_to_enter(solution, ["delta4"])
    assert set(whole) - set(without) == {"delta4"}
    assert all(abs(whole[name] - without[name]) < 0.02 for name in without)


@pytest.mark.parametrize("joints", ["central", "full"])
def test_table_and_maps_are_of_one_region(
    joints: Literal["central", "full"], arms: list[tuple[Solution, Matrix]]
) -> None:
    """What 95 % stay below is less than the worst, and nothing gets worse by entering, in no cell."""
    solution, _ = arms[0]
    problem = dataclasses.replace(solution.problem, workspace=StatedWorkspace(joints=joints))
    solution = dataclasses.replace(solution, fit=dataclasses.replace(solution.fit, problem=problem))
    told = entered(solution)[0]
    answer = accuracy(solution)
    assert told is not None
    assert told.tcp_before is not None
    assert told.tcp_after is not None
    assert answer.workspace is not None
    before, after = answer.workspace.before95_mm, answer.workspace.after95_mm
    assert before is not None
    assert told.tcp_before.p95_mm < before.worst < 1.2 * told.tcp_before.p95_mm
    assert told.tcp_after.p95_mm < after.worst < 2 * told.tcp_after.p95_mm
    assert answer.workspace.before_mm.median == pytest.approx(told.tcp_before.median_mm, rel=0.03)
    expected = np.sqrt(
        (TcpSpread(solution).errors(controller_arm(solution.problem, told.values)) ** 2).mean()
    )
    assert answer.workspace.after_rms_mm.median == pytest.approx(expected, rel=0.1)
    for plane in answer.maps:
        assert plane.before95_mm is not None
        # The map's number and the table's are one: the 95 % of a place, and of all places together.
        places = [
            (b, a, count)
            for rows in zip(plane.before_p95_mm or (), plane.after_p95_mm or (), plane.postures, strict=True)
            for b, a, count in zip(*rows, strict=True)
            if b is not None and a is not None
        ]
        assert all(a < b for b, a, _ in places)
        counts = [count for *_, count in places]
        for p95, at in ((told.tcp_before.p95_mm, 0), (told.tcp_after.p95_mm, 1)):
            of_places = [place[at] for place in places]
            assert min(of_places) < p95 < max(of_places)
            assert np.average(of_places, weights=counts) == pytest.approx(p95, rel=0.15)
        for one, other in zip(plane.before95_mm.worst, plane.after95_mm.worst, strict=True):
            assert all(b is None or (a is not None and a < b) for b, a in zip(one, other, strict=True))


def test_the_floor_is_what_the_best_values_leave(arms: list[tuple[Solution, Matrix]]) -> None:
    """Above 0 where links deviate, below what is reached; of links that are entered there is none."""
    for solution, _ in arms:
        told, whole, _ = entered(solution)
        assert told is not None
        assert whole is not None
        assert told.tcp_best is not None
        assert told.tcp_after is not None
        assert 0.2 < told.tcp_best.median_mm < 1.02 * told.tcp_after.median_mm
        assert whole.tcp_best is None


def test_a_narrow_region_does_not_spoil_the_rest(arms: list[tuple[Solution, Matrix]]) -> None:
    """Three postures with joint 5 near 0, where joints 4 and 6 do the same: the values stay near the
    estimates."""
    solution, _ = arms[0]
    rows = (
        (0.0, 10.0, 0.0, 0.0, 1.0, 0.0),
        (20.0, 20.0, -10.0, 0.0, 0.0, 0.0),
        (-20.0, 15.0, 5.0, 5.0, 0.5, 5.0),
    )
    workspace = StatedWorkspace(positions="cell.csv", units="deg", postures_deg=rows)
    problem = dataclasses.replace(solution.problem, workspace=workspace)
    values = values_to_enter(
        dataclasses.replace(solution, fit=dataclasses.replace(solution.fit, problem=problem))
    )
    usual = values_to_enter(solution)
    assert values != usual
    for name, value in values.items():
        assert value == pytest.approx(usual[name], abs=0.3)


def test_nothing_is_entered_where_the_data_do_not_determine_it() -> None:
    postures = good_plan(7, seed=2).postures.copy()
    postures[:, 0] = 0.1
    plan = plan_of(header(), postures)
    truth = Truth.with_values(plan, {})
    run = simulated_readings(truth.problem, truth.x[None], np.random.default_rng(1))
    solution = solve_run(truth.problem.moved(run.joints[0], run.spots[0]), plan.header)
    assert solution["delta2"].estimate is None
    assert entered(solution, StatedRequirement(tcp_mm=1.0)) == (None, None, None)


def test_values_that_may_make_a_good_robot_worse_say_so(arms: list[tuple[Solution, Matrix]]) -> None:
    told = entered(arms[0][0])[0]
    assert told is not None
    assert told.worse is not None
    assert 0 <= told.worse < 0.2
    assert dataclasses.replace(told, worse=0.051).doubtful
    assert not dataclasses.replace(told, worse=0.05).doubtful
