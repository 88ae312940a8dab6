from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from cells import TABLE_2, good_plan, header, irb1600, plan_of, run_of, simulated, varied_postures
from scipy import stats

from zerobeam.analysis.estimation.fit import LikelihoodFit, fit_likelihood
from zerobeam.analysis.observability.changes import Displacement, displacement, displacements, left_over
from zerobeam.analysis.observability.geometry_result import link_columns
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.geometry import NOMINAL
from zerobeam.model.likelihood.parameters import Parameters
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.misfit_words import displacement_sentence

CHANCE = 1e-3


def bumped(plan: Plan, shift: Sequence[float], after: int, seed: int = 0) -> tuple[Problem, Problem]:
    """A run in which the target is moved by `shift` (3,) mm after so many shots, as recorded, and as it would
    be with another target name from there on."""
    place = plan.header.targets["psd"]
    both = plan.header.model_copy(update={"targets": {"psd": place, "moved": place}})
    count = len(plan.postures)
    two = plan_of(both, plan.postures, ["psd"] * after + ["moved"] * (count - after))
    stands = {f"moved.{a}": v + s for a, v, s in zip("xyz", place.guess_mm, shift, strict=True)}
    _, run = simulated(two, {**TABLE_2, **stands}, seed)
    one = [shot.model_copy(update={"target": "psd"}) for shot in run.shots]
    return Problem.from_run(run_of(plan.header, one)), Problem.from_run(run)


def found_in(problem: Problem) -> Displacement:
    found = displacement(fit_likelihood(problem, starts=0))
    return found


def at(found: Displacement) -> tuple[str, int, int]:
    return found.target, found.after_shot, found.before_shot


def with_residual(fit: LikelihoodFit, residual: Matrix) -> LikelihoodFit:
    """The linearised fit with other whitened misses than its own."""
    other = replace(fit)
    vars(other)["whitened"] = fit.whitened._replace(residual=residual)
    return other


def linear(plan: Plan, scale: str = "known") -> LikelihoodFit:
    own = plan.header.model_copy(update={"noise": plan.header.noise.model_copy(update={"scale": scale})})
    _, run = simulated(plan_of(own, plan.postures, plan.targets), TABLE_2)
    return fit_likelihood(Problem.from_run(run), starts=0)


@pytest.mark.parametrize("scale", ["known", "estimated"])
@pytest.mark.one_in(2)
def test_p_values_of_runs_without_a_displacement(scale: str) -> None:
    """Those of one change point are uniform; Bonferroni's over all of them err on the safe side."""
    fit = linear(good_plan(10), scale)
    rng, runs = np.random.default_rng(6), 600
    single, whole = [], []
    for _ in range(runs):
        own = with_residual(fit, rng.normal(size=20))
        left = left_over(own)
        _, tried, floor = displacements(own, left)
        single.append(left.p_value(left.explained(tried, floor), 4))
        found = displacement(own)
        whole.append(found.p_value)
    assert stats.kstest(single, "uniform").pvalue > 1e-3
    assert (np.array(whole) < 0.05).sum() <= stats.binom.ppf(0.999, runs, 0.05)
    # Nine tests together: were they not counted, more would be called than the level allows.
    assert (np.array(whole) / 9 < 0.05).sum() > stats.binom.ppf(0.999, runs, 0.05)


def test_only_change_points_that_can_be_tested_are_counted() -> None:
    """With three degrees of freedom and an estimated scale a shift in three directions cannot be tested."""
    plan = good_plan(7, noise={"scale": "estimated"})
    both = plan.header.model_copy(update={"targets": dict.fromkeys("ab", plan.header.targets["psd"])})
    _, run = simulated(plan_of(both, plan.postures, ["a"] * 5 + ["b"] * 2), TABLE_2)
    fit = fit_likelihood(Problem.from_run(run), starts=0)
    left = left_over(fit)
    points, *information = displacements(fit, left)
    moved = left.explained(*information)
    tested = int((moved.rank > 0).sum())
    assert 0 < tested < len(points)
    shifted = with_residual(fit, fit.whitened.residual * 1e-3 + np.linspace(-1, 1, 14) ** 3)
    for one in (fit, shifted):
        left = left_over(one)
        moved = left.explained(*displacements(one, left)[1:])
        best = int(np.argmax(moved.score))
        found = displacement(one)
        assert found.p_value == pytest.approx(min(1.0, tested * left.p_value(moved, best)))


def test_against_a_fit_with_another_target_name() -> None:
    """The drop of the sum of squares and the shift are those of the fit that knows where the run is cut."""
    one, two = bumped(good_plan(12, joint_deg=0.005), (0.6, -0.6, 0.5), 5)
    fit, other = fit_likelihood(one, starts=0), fit_likelihood(two, starts=0)
    found = displacement(fit)
    assert at(found) == ("psd", 4, 5)
    assert found.elsewhere == ()
    drop = (fit.whitened.residual**2).sum() - (other.whitened.residual**2).sum()
    assert stats.chi2.isf(found.p_value / 11, 3) == pytest.approx(drop, rel=0.02)
    places = two.split(other.x).targets
    np.testing.assert_allclose(np.array(found.shift_mm), places[1] - places[0], atol=0.02)
    index = [two.parameters.index(f"{t}.{a}") for a in "xyz" for t in ("moved", "psd")]
    own = other.covariance[np.ix_(two.parameters.among_free[index], two.parameters.among_free[index])]
    own = own * np.outer(two.parameters.prior_std[index], two.parameters.prior_std[index])
    change = np.kron(np.eye(3), [1.0, -1.0])
    np.testing.assert_allclose(np.array(found.std_mm), np.sqrt(np.diag(change @ own @ change.T)), rtol=0.02)


@pytest.mark.parametrize("size", [1.0, 10.0])
def test_size_and_change_point(size: float) -> None:
    plan = good_plan(12, joint_deg=0.002)
    rng = np.random.default_rng(3)
    for seed in range(6):
        shift = rng.normal(size=3)
        shift *= size / np.linalg.norm(shift)
        after = int(rng.integers(3, 9))
        found = found_in(bumped(plan, shift, after, seed)[0])
        assert found.significant
        assert at(found) == ("psd", after - 1, after)
        # 4 stds, and the second order: offsets of a degree turn the shift by less than 3 %.
        assert abs(found.size_mm - size) < 4 * found.size_std_mm + 0.03 * size


def with_one_off(problem: Problem, shot: int, miss: Sequence[float]) -> Problem:
    """The joints of one shot read wrong, by the smallest turns that put the beam off by `miss` (2,) mm."""
    x = fit_likelihood(problem, starts=0).x
    _, jacobian = problem.linearise(x)
    joints = problem.joints.copy()
    joints[shot] += np.linalg.lstsq(jacobian[shot, :, : problem.robot.n], np.array(miss), rcond=None)[0]
    return problem.moved(joints)


def test_one_shot_that_is_off_is_no_displacement() -> None:
    """Too far off for chance, and a move of the rest would explain some of it, but that shot does better."""
    problem = bumped(good_plan(12, joint_deg=0.002), (0, 0, 0), 6)[0]
    tempting = 0
    for off in range(2, 10):
        found = found_in(with_one_off(problem, off, (0.8, 0.6)))
        assert not found.significant
        tempting += found.p_value < CHANCE
        if found.p_value < CHANCE:
            assert found.better_alone
            assert found.alone == off
    assert tempting >= 3


def test_the_last_shot_that_is_off_could_be_either() -> None:
    problem = bumped(good_plan(12, joint_deg=0.002), (0, 0, 0), 6)[0]
    found = found_in(with_one_off(problem, 11, (0.8, 0.6)))
    assert found.significant
    assert at(found) == ("psd", 10, 11)
    assert found.alone == 11
    assert "measurement 11 alone is wrong" in displacement_sentence(found)


def test_what_the_shots_cannot_tell_has_no_size() -> None:
    """One shot after the change says nothing along its beam; four say all of it."""
    plan = good_plan(12, joint_deg=0.002)
    one = found_in(bumped(plan, (1.5, 1.5, 1.5), 11)[0])
    assert one.significant
    assert at(one) == ("psd", 10, 11)
    assert one.size_mm is None
    assert one.size_std_mm is None
    assert None in one.shift_mm
    assert [v is None for v in one.shift_mm] == [v is None for v in one.std_mm]
    four = found_in(bumped(plan, (1.5, 1.5, 1.5), 8)[0])
    assert None not in four.shift_mm
    # Along the beam alone nothing is to be seen at all.
    problem = bumped(plan, (0, 0, 0), 11)[0]
    x = fit_likelihood(problem, starts=0).x
    along = problem.beams(x)[1][-1]
    unseen = found_in(bumped(plan, tuple(1.5 * along), 11)[0])
    assert not unseen.significant


def test_nothing_to_test() -> None:
    fit = linear(good_plan(3))
    assert displacement(fit) is None
    # Nor does rounding pass for information where the noise is next to none.
    exact = replace(fit)
    vars(exact)["whitened"] = fit.whitened._replace(jacobian=1e9 * fit.whitened.jacobian)
    assert displacement(exact) is None
    names = [f"t{i}" for i in range(7)]
    own = header(targets={name: {"guess_mm": [900, 0, 0], "sigma_mm": 1} for name in names})
    _, run = simulated(plan_of(own, good_plan(7).postures, names), TABLE_2)
    assert displacement(fit_likelihood(Problem.from_run(run), starts=0)) is None


def test_the_target_that_moved_is_named() -> None:
    """Two targets in turn, one of which is moved; the shots' order is that of their numbers."""
    places = {"psd": [900.0, 0.0, 0.0], "other": [700.0, 300.0, 100.0], "moved": [701.0, 300.5, 99.0]}
    own = header(targets={name: {"guess_mm": place} for name, place in places.items()}, joint_deg=0.002)
    arm = irb1600()
    first = varied_postures(own, arm, places["psd"], 6, 5)
    single = header(target=places["other"])
    second = varied_postures(single, arm, places["other"], 6, 6)
    postures = np.stack([first, second], axis=1).reshape(12, -1)
    names = ["psd", "other"] * 3 + ["psd", "moved"] * 3
    _, run = simulated(plan_of(own, postures, names), TABLE_2)
    shots = [s.model_copy(update={"target": s.target.replace("moved", "other")}) for s in run.shots]
    kept = own.model_copy(update={"targets": {k: v for k, v in own.targets.items() if k != "moved"}})
    found = found_in(Problem.from_run(run_of(kept, shots)))
    assert found.significant
    assert at(found) == ("other", 5, 7)
    assert at(found_in(Problem.from_run(run_of(kept, shots[::-1])))) == at(found)


def test_an_estimated_scale_needs_no_right_noise() -> None:
    """The F ratio is the same whatever noise is stated; with too little stated as known nothing is called."""
    shift = (0.6, -0.6, 0.5)
    p_values, beside_links = [], []
    for factor in (1.0, 0.1):
        true = bumped(good_plan(12, joint_deg=0.002, spot_mm=0.05), shift, 5)[0]
        noise = true.noise.times(factor)
        estimated = replace(true, noise=replace(noise, estimated=True))
        p_values.append(found_in(estimated).p_value)
        fit = fit_likelihood(estimated, starts=0)
        rival = displacement(fit, link_columns(estimated, fit.x))
        assert rival is not None
        beside_links.append(rival.p_value)
        stated = found_in(replace(true, noise=noise))
        assert stated.p_value < CHANCE
        assert stated.significant == (factor == 1.0)
    assert p_values[0] < CHANCE
    assert p_values[1] == pytest.approx(p_values[0], rel=0.05)
    assert beside_links[1] == pytest.approx(beside_links[0], rel=0.05)


def test_a_wrong_guess_is_no_displacement() -> None:
    """Only the shots speak: where the target is thought to stand, wrong by ten stds, changes nothing."""
    right = bumped(good_plan(8, joint_deg=0.002), (1.0, -1.0, 1.0), 4)[0]
    target = right.parameters.group("target")
    items = [
        replace(item, prior_mean=item.prior_mean + 3.0, prior_std=0.3) if own else item
        for item, own in zip(right.parameters.items, target, strict=True)
    ]
    wrong = replace(right, parameters=Parameters(tuple(items)))
    fits = [fit_likelihood(problem, starts=0) for problem in (right, wrong)]
    assert np.abs(fits[1].x - fits[0].x)[target].max() > 0.3
    one, other = (displacement(fit) for fit in fits)
    assert at(other) == at(one)
    assert other.p_value == pytest.approx(one.p_value, rel=0.5)
    np.testing.assert_allclose(np.array(other.shift_mm), np.array(one.shift_mm), atol=0.02)


def test_the_sentence() -> None:
    found = found_in(bumped(good_plan(12, joint_deg=0.002), (0.6, -0.6, 0.5), 5)[0])
    assert displacement_sentence(replace(found, p_value=2e-5, elsewhere=())) == (
        f"Target psd seems to have moved by {found.size_mm:.1f} ± {found.size_std_mm:.1f} mm between"
        " measurements 4 and 5 (p = 2e-05)"
    )
    part = replace(found, size_mm=None, shift_mm=(None, -0.61, None), std_mm=(None, 0.2, None))
    assert "moved by -0.6 ± 0.2 mm along y between" in displacement_sentence(part)
    none = replace(found, size_mm=None, shift_mm=(None,) * 3, std_mm=(None,) * 3, p_value=0.0)
    assert "moved between measurements 4 and 5 (p < 1e-12)" in displacement_sentence(none)


def test_links_are_a_rival_beside_a_tool_with_tolerances():
    """Nominal geometry, a tool within its tolerances: its rows are none of the links'."""
    plan = good_plan(10, geometry=None)
    _, run = simulated(plan, TABLE_2, 3)
    problem = Problem.from_run(run).with_geometry(NOMINAL)
    assert len(problem.tolerated) == 4
    fit = fit_likelihood(problem, starts=0)
    found = displacement(fit, link_columns(problem, fit.x))
    assert found is not None
    assert not found.significant
