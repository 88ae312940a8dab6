"""Placements held out and left out in turn: against the noise, against full fits without them, and where one
is needed."""

from dataclasses import replace

import numpy as np
import pytest
from cells import TABLE_2, good_plan, placed_plan, simulated_problem
from scipy import optimize, stats

from zerobeam.analysis.diagnostics import hold_out as module
from zerobeam.analysis.diagnostics.hold_out import (
    HoldOut,
    chosen,
    delete_group_std,
    fits_without,
    hold_out,
    jackknife,
    leave_one_out,
    placement_result,
)
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.observability.changes import displacement
from zerobeam.analysis.observability.geometry_result import link_columns
from zerobeam.analysis.recordings.recordings import Placement, effective, placements
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.errors import BadInput
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.finding_words import hold_out_message

THREE_PLACES = {"left": (800.0, 300.0, 100.0), "right": (850.0, -350.0, 200.0), "psd": (900.0, 0.0, 0.0)}
LEVEL = 1e-3


def three_placements(shots, **noise):
    """So many shots of each target, by name."""
    return placed_plan(THREE_PLACES, shots, noise=noise)


TWO, THREE = {"psd": 10, "left": 6}, {"psd": 7, "left": 6, "right": 5}


def recorded(shots, stated, count):
    """`count` simulated runs of the known noise, as problems with what is `stated`."""
    truly = three_placements(shots)
    problem = Problem.from_plan(stated)
    for seed in range(count):
        _, run = simulated_problem(truly, TABLE_2, seed)
        yield problem.moved(run.joints, run.spots)


def p_values(shots, stated, count, names=("left",)):
    told = [hold_out(problem, names) for problem in recorded(shots, stated, count)]
    return np.array([held.p_value for held in told])


@pytest.mark.parametrize(
    ("shots", "names"), [(TWO, ["left"]), (THREE, ["left", "right"])], ids=["one", "two"]
)
@pytest.mark.long
def test_the_p_values_are_uniform(shots, names):
    """120 runs by Kolmogorov and Smirnov, at a level of 1e-3: D below 0.176."""
    p = p_values(shots, three_placements(shots), 120, names)
    assert stats.kstest(p, "uniform").pvalue > LEVEL
    # Negative control: as if the noise were 0.75 of what it is.
    dof = 2 * sum(shots[name] for name in names) - 3 * len(names)
    wrong = stats.chi2.sf(stats.chi2.isf(p, dof) / 0.75**2, dof)
    assert stats.kstest(wrong, "uniform").pvalue < LEVEL


@pytest.mark.long
def test_with_an_estimated_scale_they_are_uniform_as_well():
    """Twelve degrees of freedom of the scale are no known noise: F and not chi-squared."""
    p = p_values(TWO, three_placements(TWO, scale="estimated"), 120)
    assert stats.kstest(p, "uniform").pvalue > LEVEL
    # Negative control: chi-squared with the same misses would see far misses where there are none.
    ratio = stats.f.isf(p, 9, 12)
    few = stats.binom.isf(LEVEL, 120, 0.01)
    assert (p < 0.01).sum() <= few < (stats.chi2.sf(9 * ratio, 9) < 0.01).sum()


@pytest.mark.long
def test_what_the_fit_leaves_open_is_in_the_check():
    """Few shots fitted, many held out: without the fit's covariance the misses would be far too long."""
    shots = {"psd": 5, "left": 12}
    p = p_values(shots, three_placements(shots), 60)
    assert stats.kstest(p, "uniform").pvalue > LEVEL


@pytest.fixture(scope="module")
def three():
    return simulated_problem(three_placements(THREE), TABLE_2, seed=3)[1]


def test_the_offsets_carry_over(three):
    held = hold_out(three, ["left"])
    assert (held.targets, held.shots, held.shots_fitted) == (("left",), 6, 12)
    assert held.dof == 2 * 6 - 3
    assert held.p_value == pytest.approx(stats.chi2.sf(held.chi2, 9))
    assert held.rms_mm < held.rms_before_mm / 5
    assert hold_out_message(held) is None


def test_the_rms_is_that_of_the_misses_once_the_target_is_placed(three, monkeypatch):
    """Offsets of a fit of the other shots alone; the target by scipy; the miss by the model."""
    rows = np.flatnonzero(three.target_index == three.targets.index("left"))
    fit = fit_likelihood(three.select(np.setdiff1d(np.arange(three.shots), rows)), starts=0)
    at = three.robot.n + 3 * three.targets.index("left") + np.arange(3)

    def weights_kept(place, factor):
        x = fit.x.copy()
        x[at] = place
        return three.select(rows).whiten(x, factor).residual

    place = np.array(THREE_PLACES["left"])
    for _ in range(20):  # as for any fit with weights that move: refreshed until they settle
        x = fit.x.copy()
        x[at] = place
        factor = three.select(rows).whiten(x).factor
        place = optimize.least_squares(weights_kept, place, args=(factor,), x_scale=1e-2).x
    x[at] = place
    miss, _ = three.select(rows).linearise(x)
    assert hold_out(three, ["left"]).rms_mm == pytest.approx(np.sqrt((miss**2).sum(axis=1).mean()), rel=1e-4)


@pytest.mark.parametrize("patterns", [["wall"], ["LEFT"], ["left", "wall*"], ["lef"]])
def test_a_name_that_is_not_there_is_refused(three, refused, patterns):
    error = refused(hold_out, three, patterns)
    assert error.found == patterns[-1]
    assert error.allowed == "psd, left, right"


def test_nothing_left_to_fit_is_refused(three, refused):
    error = refused(hold_out, three, ["*"])
    assert "nothing left to fit" in error.what
    assert "leave at least one target in" in error.remedy


def test_one_shot_always_hits():
    """Two numbers for three coordinates: nothing to check, and that is said."""
    shots = {"psd": 10, "left": 1}
    _, problem = simulated_problem(three_placements(shots), TABLE_2, seed=3)
    held = hold_out(problem, ["left"])
    assert (held.dof, held.chi2, held.p_value) == (0, None, None)
    assert "zero degrees of freedom" in hold_out_message(held)
    assert held.rms_mm < 1e-6


def test_what_is_held_out_has_no_say_in_the_fit(three, monkeypatch):
    """Other recordings of it: the offsets are the same to the last bit. Of another target: they are not."""
    real, fits = module.fit_likelihood, []

    def watched(*args, **kwargs):
        fits.append(real(*args, **kwargs))
        return fits[-1]

    monkeypatch.setattr(module, "fit_likelihood", watched)
    first = hold_out(three, ["left"])
    for name in ("left", "right"):
        joints = three.joints.copy()
        joints[three.target_index == three.targets.index(name), 4] += np.radians(0.3)
        hold_out(three.moved(joints), ["left"])
    np.testing.assert_array_equal(fits[0].x, fits[1].x)
    np.testing.assert_array_equal(fits[0].covariance, fits[1].covariance)
    assert not np.array_equal(fits[0].x, fits[2].x)
    assert hold_out(three, ["left"]) == first


def test_a_fit_that_did_not_converge_tells_nothing(three, monkeypatch):
    real = module.fit_likelihood
    monkeypatch.setattr(
        module,
        "fit_likelihood",
        lambda *args, **kwargs: replace(real(*args, **kwargs), converged=False, reason="no way up"),
    )
    held = hold_out(three, ["left"])
    assert (held.rms_mm, held.rms_before_mm, held.chi2, held.dof, held.p_value) == (None,) * 5
    assert hold_out_message(held) == "the fit without them did not converge: no way up"


def test_with_separate_noise_factors():
    """The noise must not be blamed for what are offsets: the misses are as short as with known noise."""
    _, run = simulated_problem(three_placements(TWO), TABLE_2, seed=0)
    known = hold_out(Problem.from_plan(three_placements(TWO)).moved(run.joints, run.spots), ["left"])
    open_noise = hold_out(
        Problem.from_plan(three_placements(TWO, scale="separate")).moved(run.joints, run.spots), ["left"]
    )
    assert open_noise.rms_mm == pytest.approx(known.rms_mm, rel=0.1)
    assert open_noise.dof == known.dof


PLACES = {
    "left_a": (800.0, 300.0, 100.0),
    "left_b": (800.0, 350.0, 100.0),
    "right_a": (850.0, -350.0, 200.0),
    "right_b": (850.0, -400.0, 200.0),
    "psd": (900.0, 0.0, 0.0),
}
SHOTS = {"left_a": 5, "left_b": 5, "right_a": 6, "right_b": 4, "psd": 7}


def placed(shots: dict[str, int] = SHOTS, tied: bool = True, **noise: object) -> Problem:
    distances = [
        {"between": [f"{side}_a", f"{side}_b"], "mm": 50.0, "sigma_mm": 0.05}
        for side in ("left", "right")
        if tied and f"{side}_a" in shots
    ]
    return simulated_problem(placed_plan(PLACES, shots, distances=distances, noise=noise), TABLE_2, 3)[1]


@pytest.fixture(scope="module", params=["known", "estimated"])
def solution(request: pytest.FixtureRequest) -> Solution:
    return solve(placed(scale=request.param), starts=0)


def group(name: str, *targets: str) -> Placement:
    return Placement(name, targets or (name,), np.arange(1))


EVERY = [
    group("front", "front_0", "front_1"),
    group("front_rotated", "front_rotated_0", "front_rotated_1"),
    group("mid-high", "mid-high_0", "mid-high_1"),
    group("wall"),
]


@pytest.mark.parametrize(
    ("pattern", "names"),
    [
        ("front", ["front"]),
        ("front_*", ["front"]),  # and not front_rotated, which it matches as well
        ("front_0", ["front"]),
        ("front_rotated_*", ["front_rotated"]),
        ("front_rotated", ["front_rotated"]),
        ("front*", ["front", "front_rotated"]),
        ("front_?", ["front"]),
        ("front_r*", ["front_rotated"]),
        ("*high*", ["mid-high"]),
        ("mid-*", ["mid-high"]),
        ("wall", ["wall"]),
        ("*_1", ["front", "front_rotated", "mid-high"]),
    ],
)
def test_a_pattern_means_whole_placements(pattern: str, names: list[str]) -> None:
    assert [placement.name for placement in chosen(EVERY, pattern)] == names


def test_part_of_a_placement_takes_all_of_it(solution: Solution) -> None:
    held = hold_out(solution.problem, ["left_b"])
    assert (held.placements, held.targets, held.shots) == (("left",), ("left_a", "left_b"), 10)
    # 20 numbers and a distance for 6 coordinates.
    assert held.dof == 2 * 10 + 1 - 6
    with pytest.raises(BadInput, match="nothing left to fit"):
        hold_out(solution.problem, ["*_a", "psd"])


def test_each_row_is_the_hold_out_of_the_placement(solution: Solution) -> None:
    """The hold-out fits from zero offsets, to the last digit."""
    found = leave_one_out(solution, fits_without(solution))
    assert [row.placements for row in found.rows] == [("left",), ("right",), ("psd",)]
    for row in found.rows:
        alone = hold_out(solution.problem, row.placements)
        assert (row.shots, row.shots_fitted, row.dof) == (alone.shots, alone.shots_fitted, alone.dof)
        for name in ("rms_mm", "rms_before_mm", "expected_mm", "chi2"):
            assert getattr(row, name) == pytest.approx(getattr(alone, name), rel=0.02)
    squares = [row.shots * (row.rms_mm or np.nan) ** 2 for row in found.rows]
    assert found.rms_mm == pytest.approx(np.sqrt(sum(squares) / solution.problem.shots))


@pytest.mark.long
def test_the_rms_to_expect_is_that_of_many_runs() -> None:
    """Five measurements for the offsets: what they leave open is most of what is expected of the others."""
    shots = {"psd": 5, "left": 12}
    told = [hold_out(problem, ["left"]) for problem in recorded(shots, three_placements(shots), 60)]
    expected = np.mean([held.expected_mm for held in told if held.expected_mm is not None])
    squares = [held.rms_mm**2 for held in told if held.rms_mm is not None]
    spread = np.std(squares, ddof=1) / np.sqrt(len(squares))
    assert expected**2 == pytest.approx(np.mean(squares), abs=4 * spread)
    assert 4 * spread < 0.6 * expected**2


def test_the_jackknife_by_full_fits_and_by_the_plain_formula(solution: Solution) -> None:
    found = jackknife(solution, fits_without(solution))
    assert (found.placements, found.dof) == (("left", "right", "psd"), 2)
    fits = [
        fit_likelihood(solution.problem.without_targets(p.targets), starts=0)
        for p in placements(solution.problem)
    ]
    assert [row.name for row in found.offsets] == ["delta2", "delta3", "delta4", "delta5", "delta6"]
    for i, row in enumerate(found.offsets, start=1):
        by_fits = np.degrees([fit.x[i] for fit in fits])
        stated = solution[row.name].u
        assert row.estimates == pytest.approx(by_fits, abs=0.1 * stated)
        counts = np.array([10, 10, 7])
        whole = float(np.degrees(solution.fit.x[i]))
        assert row.u == pytest.approx(delete_group_std(whole, by_fits, counts), abs=0.1 * stated)
        assert found.u(row.name) == row.u
        assert row.needs == ()


def test_equal_groups_have_the_plain_jackknife() -> None:
    """Of a mean of groups it is the std of the mean, and of any estimate the textbook's formula."""
    rng = np.random.default_rng(0)
    values = rng.normal(size=6)
    without = (values.sum() - values) / 5
    counts = np.full(6, 9)
    assert delete_group_std(values.mean(), without, counts) == pytest.approx(values.std(ddof=1) / np.sqrt(6))
    # Groups of other sizes: of a mean of measurements, nearly unbiased for its variance (control: the plain
    # formula, which takes them as equal, is not).
    counts = np.array([4, 8, 16, 32])
    ours, plain = [], []
    for _ in range(4000):
        sums = rng.normal(size=4) * np.sqrt(counts)
        left = (sums.sum() - sums) / (counts.sum() - counts)
        ours.append(delete_group_std(sums.sum() / counts.sum(), left, counts) ** 2)
        plain.append(3 / 4 * ((left - left.mean()) ** 2).sum())
    assert np.mean(ours) * counts.sum() == pytest.approx(1, abs=0.12)
    assert abs(np.mean(plain) * counts.sum() - 1) > 0.15


def test_an_offset_that_needs_one_placement_has_no_jackknife() -> None:
    """Two measurements each at two places: 8 numbers for 6 coordinates and 5 offsets without the third."""
    own = solve(placed({"psd": 14, "left_a": 2, "right_a": 2}, tied=False), starts=0)
    assert {own[f"delta{i}"].status for i in range(2, 7)} == {"identified", "assumed"}  # δ6: the mounting
    found = jackknife(own, fits_without(own))
    for row in found.offsets:
        assert row.needs == ("psd",)
        assert [value is None for value in row.estimates] == [True, False, False]
        assert row.u is None
        assert found.u(row.name) is None


def test_two_placements_have_no_jackknife_and_one_nothing() -> None:
    two = solve(placed({name: SHOTS[name] for name in ("left_a", "left_b", "psd")}), starts=0)
    found = placement_result(two, effective(two.fit))
    assert found.names == ("left", "psd")
    assert found.leave_one_out is not None
    assert found.jackknife is None
    one = solve(simulated_problem(good_plan(8), TABLE_2, 1)[1], starts=0)
    alone = placement_result(one, effective(one.fit))
    assert (alone.leave_one_out, alone.jackknife) == (None, None)
    assert alone.steps.rows == ()


def test_without_an_answer_there_is_none(solution: Solution) -> None:
    failed = replace(solution, trusted=False)
    found = placement_result(failed, effective(failed.fit))
    assert (found.leave_one_out, found.jackknife, found.effective.divisor) == (None, None, 1.0)


def test_the_factor_is_of_chi_squared() -> None:
    row = HoldOut(targets=("a",), placements=("a",), shots=5, shots_fitted=9, chi2=28.0, dof=7, p_value=0.01)
    assert row.factor == 2.0
    assert replace(row, chi2=None).factor is None


def test_a_rival_that_explains_the_misses_leaves_no_moved_target() -> None:
    """Synthetic columns: one is the very effect of the displacement."""
    _, problem = simulated_problem(good_plan(14), TABLE_2, 2)
    fit = fit_likelihood(problem, starts=0)
    shift = np.zeros((14, 2))
    by_target = fit.whitened.jacobian[: 14 * 2].reshape(14, 2, -1)[:, :, problem.parameters.group("target")]
    by_target = by_target / problem.parameters.prior_std[problem.parameters.group("target")]
    shift[7:] = by_target[7:] @ np.array([1.0, -0.8, 0.6])
    moved = replace(fit)
    vars(moved)["whitened"] = fit.whitened._replace(residual=fit.whitened.residual + shift.reshape(-1))
    plain = displacement(moved)
    assert plain.significant
    assert plain.before_shot in (7, 8)
    rival = displacement(moved, 3 * shift.reshape(-1, 1))
    assert not rival.significant
    # A rival that is stated to be small, and one of another kind, do not take it.
    small = displacement(moved, 1e-3 * shift.reshape(-1, 1))
    assert small.significant
    other = displacement(moved, np.random.default_rng(0).normal(size=(28, 1)))
    assert other.significant


def test_p_values_under_a_rival_are_on_the_safe_side() -> None:
    """Errors of links drawn from the tolerance: with them marginalised no false alarm, without them many."""
    _, problem = simulated_problem(good_plan(14), TABLE_2, 2)
    fit = fit_likelihood(problem, starts=0)
    columns = link_columns(problem, fit.x)
    rng, runs, plain, rival = np.random.default_rng(3), 200, 0, 0
    for _ in range(runs):
        own = replace(fit)
        residual = rng.normal(size=28) + columns @ rng.normal(size=columns.shape[1])
        vars(own)["whitened"] = fit.whitened._replace(residual=residual)
        one, two = displacement(own), displacement(own, columns)
        plain += one is not None and one.p_value < 0.01
        rival += two is not None and two.p_value < 0.01
    assert rival <= stats.binom.ppf(0.999, runs, 0.01)
    assert plain > stats.binom.ppf(0.999, runs, 0.01)


def test_weight_two_is_the_measurement_twice() -> None:
    problem = placed()
    twice = problem.select(np.append(np.arange(problem.shots), [2, 12]))
    weights = np.ones(problem.shots)
    weights[[2, 12]] = 2.0
    one, two = solve(problem.weighted(weights), starts=0), solve(twice, starts=0)
    np.testing.assert_allclose(one.fit.x, two.fit.x, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(one.fit.covariance, two.fit.covariance, rtol=1e-4, atol=1e-12)
    np.testing.assert_allclose(one.identified.data_std, two.identified.data_std, rtol=1e-4)
    assert one.against_noise == pytest.approx(two.against_noise, rel=1e-6)
    # Control: it is not the fit of each once.
    assert not np.allclose(one.fit.x, solve(problem, starts=0).fit.x, rtol=1e-5, atol=1e-8)
