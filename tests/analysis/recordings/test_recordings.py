"""Correlation, effective number and steps of recordings: against simulation, planted ones as controls."""

from dataclasses import replace

import numpy as np
import pytest
from cells import TABLE_2, good_plan, irb1600, placed_plan, simulated_problem
from measured_arms import CELLS, recorded
from scipy import stats

from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood
from zerobeam.analysis.observability.geometry_result import link_columns
from zerobeam.analysis.recordings.recordings import (
    SIGNIFICANCE,
    Effective,
    Recording,
    RecordingLag,
    _above_zero,
    correlation,
    covariance,
    drawn,
    effective,
    lags,
    recording_rows,
    recordings,
    rho_of,
    times_errors,
    traces,
    white_times,
)
from zerobeam.analysis.recordings.steps import all_steps, steps
from zerobeam.analysis.solution import Solution, judge
from zerobeam.analysis.status import LACK_OF_FIT
from zerobeam.model.arrays import Matrix
from zerobeam.model.likelihood.constraint import shot_functions
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.problem import Problem

PLACES = {"left": (800.0, 300.0, 100.0), "right": (850.0, -350.0, 200.0), "psd": (900.0, 0.0, 0.0)}
EACH = 20
LEVEL = 1e-3


@pytest.fixture(scope="module")
def solution() -> Solution:
    """A probe in three places, twenty measurements each."""
    tool = {"kind": "probe", "calibrated": True, "point_mm": [40.0, 0, 150]}
    plan = placed_plan(PLACES, dict.fromkeys(PLACES, EACH), tool, first_seed=0)
    _, problem = simulated_problem(plan, TABLE_2, 1)
    return judge(fit_likelihood(problem, starts=0))


def errors(rng: np.random.Generator, rho: float) -> Matrix:
    """(60, 3) of variance 1, correlated within each twenty."""
    e = rng.normal(size=(3, EACH, 3))
    for k in range(1, EACH):
        e[:, k] = rho * e[:, k - 1] + np.sqrt(1 - rho**2) * e[:, k]
    return e.reshape(-1, 3)


@pytest.mark.parametrize("rho", [0.0, 0.3, -0.6, 0.95])
def test_correlated_errors_are_those_of_the_whole_matrix(rho: float) -> None:
    """R has rho^|i - j| between two measurements, for each component that was read; others have no errors."""
    rng = np.random.default_rng(6)
    shots, d = 11, 2
    active = np.ones((shots, d))
    active[3, 1] = active[7, 0] = 0.0
    jacobian = rng.normal(size=(shots * d, 4)) * active.reshape(-1, 1)
    recording = Recording(
        "psd", np.arange(shots), np.zeros((shots, d)), jacobian, np.zeros((shots, d, 3)), active
    )
    apart = np.abs(np.subtract.outer(np.arange(shots), np.arange(shots)))
    whole = np.kron(np.where(apart == 0, 1.0, float(rho) ** apart), np.eye(d)) * np.outer(active, active)
    np.testing.assert_allclose(times_errors(recording, rho), whole @ jacobian, atol=1e-12)


def of_errors(solution: Solution, e: Matrix) -> Solution:
    """The linearised fit to other errors: its residuals are what it cannot explain of them."""
    fit = solution.fit
    columns = fit.whitened.jacobian[:, solution.problem.parameters.free]
    covariance = np.linalg.inv(columns.T @ columns + np.eye(columns.shape[1]))
    whole = e.reshape(-1)
    other: LikelihoodFit = replace(fit)
    vars(other)["whitened"] = fit.whitened._replace(
        residual=whole - columns @ covariance @ (columns.T @ whole)
    )
    return replace(solution, fit=other)


def test_recordings_are_consecutive_measurements_of_one_target(solution: Solution) -> None:
    problem = replace(solution.problem, target_index=np.array([0, 0, 1, 0, 2] + [2] * 55))
    assert [rows.tolist() for rows in recording_rows(problem)] == [[0, 1], [2], [3], list(range(4, 60))]


def lagged(solution: Solution, rho: float, runs: int, seed: int) -> list[list[RecordingLag]]:
    """The sums of simulated recordings; what is expected of them is that of the linearised fit."""
    rng = np.random.default_rng(seed)
    expected = lags(recordings(solution.fit))
    result = []
    for _ in range(runs):
        parts = [own.residual for own in recordings(of_errors(solution, errors(rng, rho)).fit).every]
        result.append(
            [
                own._replace(product=float((r[1:] * r[:-1]).sum()), square=float((r**2).sum()))
                for own, r in zip(expected.values(), parts, strict=True)
            ]
        )
    return result


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
@pytest.mark.one_in(3)
def test_the_correlation_is_unbiased(solution: Solution, rho: float) -> None:
    runs = 200
    found = lagged(solution, rho, runs, 1)
    pooled = np.array([rho_of(own) for own in found])
    # 3.3 standard errors, and a hundredth for the ratio of expectations.
    assert abs(pooled.mean() - rho) < 3.3 * pooled.std() / np.sqrt(runs) + 0.01
    own = np.array([rho_of([row]) for one in found for row in one])
    assert abs(own.mean() - rho) < 3.3 * own.std() / np.sqrt(len(own)) + 0.03
    # Negative control: the plain correlation of the residuals of a fit is too small.
    plain = np.array([sum(row.product for row in one) / sum(row.square for row in one) for one in found])
    assert plain.mean() < rho - 3.3 * plain.std() / np.sqrt(runs)


@pytest.mark.parametrize("rho", [-0.6, 0.0, 0.3])
def test_the_correlation_is_that_of_the_ratio_that_was_found(solution: Solution, rho: float) -> None:
    """By the traces themselves, without the series."""
    own = of_errors(solution, errors(np.random.default_rng(9), rho))
    recorded = recordings(own.fit)

    def apart(rho: float, kept: slice) -> float:
        of = recorded.every[kept]
        squares, products = np.sum([traces(one, rho, recorded.shared(rho)) for one in of], axis=0)
        product = sum((one.residual[1:] * one.residual[:-1]).sum() for one in of)
        return float(products / squares - product / sum((one.residual**2).sum() for one in of))

    every = list(lags(recorded).values())
    for kept in (slice(0, 1), slice(0, 3)):
        found = rho_of(every[kept])
        assert abs(apart(found, kept)) < 5e-5
        # It is determined.
        assert correlation(every[kept])[0] == found


@pytest.mark.long
def test_the_false_alarm_rate_is_as_stated(solution: Solution) -> None:
    runs = 400
    found = lagged(solution, 0.0, runs, 2)
    pooled = np.array([correlation(own)[1] for own in found])
    assert stats.kstest(pooled, "uniform").pvalue > LEVEL
    assert stats.kstest([correlation(own[:1])[1] for own in found], "uniform").pvalue > LEVEL
    assert (pooled < SIGNIFICANCE).sum() <= stats.binom.ppf(1 - LEVEL, runs, SIGNIFICANCE)


def test_the_number_is_smaller_only_where_there_is_a_correlation(solution: Solution) -> None:
    none = effective(of_errors(solution, errors(np.random.default_rng(1), 0.0)).fit)
    assert (none.divisor, none.number) == (1.0, 60.0)
    there = effective(of_errors(solution, errors(np.random.default_rng(1), 0.5)).fit)
    assert there.kappa is not None
    assert 1.5 < there.divisor < there.kappa  # by the mean of 1 / kappa over its posterior
    assert there.number == pytest.approx(60 / there.divisor)
    assert [(row.first_shot, row.last_shot, row.shots) for row in there.recordings] == [
        (0, 19, 20),
        (20, 39, 20),
        (40, 59, 20),
    ]
    assert all(row.rho is not None and row.p_value is not None for row in there.recordings)


def in_one_recording(count: int, runs: int) -> list[Effective]:
    """Runs of a laser that stays at one target, with independent errors."""
    plan = good_plan(count, seed=2, geometry="exact")
    fits = [fit_likelihood(simulated_problem(plan, TABLE_2, seed)[1], starts=0) for seed in range(runs)]
    return [effective(fit, link_columns(fit.problem, fit.x)) for fit in fits]


def test_a_few_measurements_do_not_determine_a_correlation_and_count_as_they_are() -> None:
    """Not a correlation of -0.9 with a p-value of 0.8, the end of a grid."""
    for found in in_one_recording(12, 20):
        assert (found.rho, found.kappa, found.divisor) == (None, None, 1.0)
        assert found.p_value is not None
        assert 0 < found.p_value < 1


@pytest.mark.long
@pytest.mark.parametrize("count", [12, 20])
def test_independent_errors_do_not_lower_the_number(count: int) -> None:
    """A correlation of which there is none reaches odds of 100 in one run of a hundred at most."""
    runs = 400
    acting = sum(found.divisor != 1 for found in in_one_recording(count, runs))
    assert acting <= stats.binom.ppf(1 - LEVEL, runs, 0.01)


def test_the_size_of_the_noise_does_not_matter(solution: Solution) -> None:
    e = errors(np.random.default_rng(3), 0.3)
    one, ten = (effective(of_errors(solution, times * e).fit) for times in (1.0, 10.0))
    assert one.p_value == pytest.approx(ten.p_value, rel=1e-6)
    assert one.rho == pytest.approx(ten.rho, rel=1e-6)


@pytest.mark.parametrize("rho", [0.3, 0.5])
@pytest.mark.one_in(2)
def test_chi_squared_at_the_effective_number_raises_no_false_alarm(solution: Solution, rho: float) -> None:
    """N / kappa - rank degrees of freedom are too few where postures are random, but the sum of correlated
    squares varies less than chi-squared does. The fit is the linearised one."""
    kappa, runs = (1 + rho) / (1 - rho), 4000
    columns = solution.fit.whitened.jacobian[:, solution.problem.parameters.free] / np.sqrt(kappa)
    hat = columns @ np.linalg.inv(columns.T @ columns + np.eye(columns.shape[1])) @ columns.T
    rng = np.random.default_rng(7)
    e = np.array([errors(rng, rho).reshape(-1) for _ in range(runs)]) / np.sqrt(kappa)
    squares = ((e - e @ hat) ** 2).sum(axis=1)
    dof = len(columns) / kappa - solution.identified.facts.rank
    assert dof < squares.mean() < 1.25 * dof
    assert squares.var() < 1.5 * dof  # chi-squared: twice
    alarms = int((stats.chi2.sf(squares, dof) < LACK_OF_FIT).sum())
    assert stats.binomtest(alarms, runs, LACK_OF_FIT, alternative="greater").pvalue > LEVEL
    # Control: errors of 1.5 times the stated size are seen.
    assert (stats.chi2.sf(1.5**2 * squares, dof) < LACK_OF_FIT).mean() > 0.9


@pytest.mark.parametrize("weights", [[1.0, 1.0, -1.0, -1.0], [3.0, 1.0, 0.5, -2.0, -0.1], [0.2] * 9 + [-3.0]])
def test_the_saddle_point_against_simulation(weights: list[float]) -> None:
    rng, count = np.random.default_rng(4), 200_000
    share = (rng.chisquare(1, size=(count, len(weights))) @ np.array(weights) > 0).mean()
    assert _above_zero(np.array(weights)) == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("rho", [0.0, 0.6, -0.9])
@pytest.mark.one_in(3)
def test_what_is_needed_of_a_covariance_without_the_matrix(solution: Solution, rho: float) -> None:
    """Traces, products and draws against the covariance of the errors of all recordings, written out."""
    recorded = recordings(solution.fit)
    count, blocks = EACH * 3, [own.jacobian for own in recorded.every]
    every = np.vstack(blocks)
    one = np.kron(rho ** np.abs(np.subtract.outer(np.arange(EACH), np.arange(EACH))).astype(float), np.eye(3))
    errors = np.kron(np.eye(3), one)
    left = np.eye(len(every)) - every @ every.T
    whole = left @ errors @ left + every @ recorded.prior @ every.T
    shared = recorded.shared(rho)
    for i, own in enumerate(recorded.every):
        mine = slice(count * i, count * (i + 1))
        expected = whole[mine, mine]
        np.testing.assert_allclose(covariance(own, rho, shared), expected, atol=1e-12)
        np.testing.assert_allclose(
            traces(own, rho, shared), [np.trace(expected), np.trace(expected, offset=3)], atol=1e-10
        )
        if rho == 0:
            vector = np.arange(float(count))
            np.testing.assert_allclose(white_times(own, shared, vector), expected @ vector, atol=1e-10)
        many = drawn(own, rho, shared, 20_000, np.random.default_rng(1)).reshape(20_000, count)
        # 5.5 standard errors of 3600 products.
        bound = 5.5 * np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / 20_000)
        assert (np.abs(many.T @ many / 20_000 - expected) < bound).all()


def test_a_long_recording_says_the_same(solution: Solution, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if twenty measurements were too many to write their covariance out: rho is the same, the p-values
    are those of other simulations and of the approximation for long recordings."""
    e = errors(np.random.default_rng(6), 0.3)
    e[26:33] -= recordings(solution.fit).every[1].by_target[6:13] @ np.array([0.7, -0.6, 0.4])
    own = of_errors(solution, e)
    plain, (step,) = effective(own.fit), steps(own.fit).rows
    monkeypatch.setattr("zerobeam.analysis.recordings.recordings.LARGE", 10)
    monkeypatch.setattr("zerobeam.analysis.recordings.steps.LARGE", 10)
    monkeypatch.setattr("zerobeam.analysis.recordings.steps._NUMBERS", 60 * 70)
    long, (again,) = effective(own.fit), steps(own.fit).rows
    assert long.rho == pytest.approx(plain.rho, abs=1e-9)
    assert long.p_value == pytest.approx(plain.p_value, rel=1.0)
    assert (again.first_shot, again.last_shot) == (step.first_shot, step.last_shot) == (26, 32)
    assert again.shift_mm == pytest.approx(step.shift_mm)
    assert again.p_value < 1e-2


@pytest.mark.parametrize("rho", [0.0, 0.4])
@pytest.mark.long
def test_steps_are_not_found_where_there_are_none(solution: Solution, rho: float) -> None:
    """Correlated recordings must not raise the false alarms."""
    rng, runs = np.random.default_rng(5), 40
    found = [all_steps(of_errors(solution, errors(rng, rho)).fit)[0] for _ in range(runs)]
    least = np.array([min(step.p_value for step in own) for own in found])
    for level in (SIGNIFICANCE, 0.05):
        assert (least < level).sum() <= stats.binom.ppf(1 - LEVEL, runs, level)


@pytest.mark.parametrize(("first", "end"), [(26, 33), (20, 27), (34, 40)])
def test_a_planted_step_is_found(solution: Solution, first: int, end: int) -> None:
    """The socket `right` slips by a millimetre for some measurements, and maybe back."""
    e = errors(np.random.default_rng(6), 0.0)
    shift = np.array([0.7, -0.6, 0.4])
    by_target = recordings(solution.fit).every[1].by_target
    e[first:end] -= by_target[first - EACH : end - EACH] @ shift
    (step,) = steps(of_errors(solution, e).fit).rows
    assert step.target == solution.problem.targets[1]
    assert (step.first_shot, step.last_shot) == (first, end - 1)
    assert step.shift_mm == pytest.approx(shift, abs=0.3)
    assert step.size_mm == pytest.approx(1.0, abs=0.3)
    assert step.p_value < 1e-3


def test_a_step_is_the_same_if_the_rest_is_as_well(solution: Solution) -> None:
    """Seeded: the answer of a solution is one answer."""
    one = of_errors(solution, errors(np.random.default_rng(7), 0.0))
    assert all_steps(one.fit) == all_steps(one.fit)


def test_the_columns_of_link_errors_against_an_arm_that_has_them(solution: Solution) -> None:
    """By differences of the nominal model of an arm whose links are moved by one parameter."""
    problem, fit = solution.problem, solution.fit
    columns = link_columns(problem, fit.x)
    geometry = Geometry.of_links(problem.robot, 0.3, 0.1)
    expected = []
    for k, (of, axis) in enumerate(geometry.names):
        item = problem.with_geometry(geometry).parameters.items[problem.robot.n + k]
        if item.held:
            continue
        step = 1e-3 * geometry.prior_std(of, axis)
        values = np.zeros(len(geometry.names))
        values[k] = step
        robot = geometry.applied(problem.robot, values)
        with_it = replace(problem, robot=robot, functions=shot_functions(robot, problem.tool))
        residual, _ = with_it.linearise(fit.x)
        apart = residual - fit.whitened.residual_mm
        expected.append(np.linalg.solve(fit.whitened.factor, apart[:, :, None]).reshape(-1) * 1e3)
    found = columns[: len(expected[0])]
    np.testing.assert_allclose(found, np.array(expected).T, atol=2e-3 * np.abs(columns).max())
    # Control: with the links' order turned over they are others.
    assert np.abs(found[:, ::-1] - np.array(expected).T).max() > 0.1 * np.abs(columns).max()


def test_a_rival_takes_the_correlation_that_it_explains(solution: Solution) -> None:
    """Errors of links alone: correlated without the rival wherever postures are, small with it."""
    fit = solution.fit
    columns = link_columns(solution.problem, fit.x)
    rng = np.random.default_rng(8)
    e = errors(rng, 0.0) + 10 * (columns @ rng.normal(size=columns.shape[1])).reshape(-1, 3)
    found = of_errors(solution, e)

    def size(rival: Matrix | None) -> float:
        return float(sum((own.residual**2).sum() for own in recordings(found.fit, rival).every))

    # Four stds of chi-squared of as many degrees of freedom as there are numbers.
    assert size(10 * columns) < 180 + 4 * np.sqrt(2 * 180) < size(None) / 2


@pytest.mark.long
def test_what_was_not_read_at_a_posture_is_no_evidence_of_a_step() -> None:
    """A tracker that reads one reflector or three in turn: of right models P(p < 0.1 in 4 of 8) is 0.005."""
    cell, robot = CELLS["tracker"], irb1600()
    header = cell.header(geometry="exact", joint_deg=0.005)
    below = 0
    for seed in range(8):
        arm = recorded(cell, 30, np.random.default_rng(seed), exact=True, joint_deg=0.005)
        fit = fit_likelihood(Problem.of_measured(header, robot, arm.joints, arm.measured), starts=0)
        ((step, *others), count) = all_steps(fit)
        assert (count, others) == (1, [])
        assert step.station
        below += step.p_value < 0.1
    assert below < 4
