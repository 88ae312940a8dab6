"""What a run would notice, against how many simulated runs are a misfit."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from cells import LASER, good_plan, header, plan_of
from scipy import stats

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability import power
from zerobeam.analysis.observability.changes import SIGNIFICANT, run_change
from zerobeam.analysis.observability.check import check
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.analysis.observability.power import (
    BACKLASH_DEG,
    JUMP_DEG,
    NOISE_TIMES,
    DetectionPower,
    WrongModel,
    halves,
    powers,
)
from zerobeam.analysis.status import LACK_OF_FIT
from zerobeam.experiments.simulate import simulated_readings
from zerobeam.experiments.studies.data_sets import DataSets, drawn, fitted
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import (
    condition,
    no_plan_sentence,
    power_limit,
    power_sentences,
    remaining,
)

RUNS = 40


def of(plan: Plan) -> tuple[Problem, dict[str, DetectionPower]]:
    problem = Problem.from_plan(plan)
    x = problem.nominal()
    return problem, {each.wrong: each for each in powers(problem, x, identify(problem, x))}


@pytest.fixture(scope="module")
def plan() -> Plan:
    return good_plan(7, seed=2)


def misfits(plan: Plan, spoil: Callable[[Matrix, np.random.Generator], Matrix]) -> int:
    """How many of the simulated runs are a misfit, if joints (N, n) are as they are spoilt."""
    problem, rng = Problem.from_plan(plan), np.random.default_rng(1)
    runs = simulated_readings(problem, np.tile(problem.nominal(), (RUNS, 1)), rng)
    return sum(
        solve_run(problem.moved(spoil(joints.copy(), rng), spots), plan.header).misfit is not None
        for joints, spots in zip(runs.joints, runs.spots, strict=True)
    )


def at_least(found: int, probability: float) -> bool:
    """Whether `found` of the runs are not too few for this probability; one in a thousand is."""
    return found >= stats.binom.ppf(1e-3, RUNS, probability)


@pytest.mark.long
def test_the_power_is_a_lower_bound_of_what_simulations_notice(plan: Plan) -> None:
    problem, told = of(plan)
    joint = told["jump"].joint
    assert joint is not None

    def jump(joints: Matrix, rng: np.random.Generator) -> Matrix:
        joints[len(joints) // 2 :, joint - 1] += np.radians(JUMP_DEG)
        return joints

    def backlash(joints: Matrix, rng: np.random.Generator) -> Matrix:
        return joints + np.radians(BACKLASH_DEG) * rng.choice([-1.0, 1.0], joints.shape)

    def noise(joints: Matrix, rng: np.random.Generator) -> Matrix:
        return joints + rng.normal(size=joints.shape) * problem.noise.joint * np.sqrt(NOISE_TIMES**2 - 1)

    found = {case.__name__: misfits(plan, case) for case in (jump, backlash, noise)}
    for name in ("jump", "backlash"):
        assert at_least(found[name], told[name].probability), (name, found[name], told[name])
    assert at_least(found["noise"], 0.8 * told["noise"].probability)  # of the joints alone
    assert misfits(plan, lambda joints, rng: joints) <= stats.binom.ppf(0.999, RUNS, 0.01)  # the control


def test_more_measurements_notice_more() -> None:
    few, many = (of(good_plan(count, seed=2))[1] for count in (5, 12))
    assert all(many[wrong].probability > few[wrong].probability for wrong in ("jump", "backlash", "noise"))


def test_a_tool_that_may_deviate_is_among_them() -> None:
    plan = good_plan(7, seed=2)
    stated = header({**LASER, "sigma": {}}, geometry={})
    _, told = of(plan_of(stated, plan.postures))
    assert told["tool"].off_u > 0
    assert "tool" not in of(plan)[1]


def test_what_no_pass_contains_is_not_what_a_pass_excludes() -> None:
    """The zero of joint 6 is as good as the beam: assumed, it is in no pass, which a beam 0.3° off
    then cannot make wrong; stated, it is."""
    plan = good_plan(12, seed=2, geometry={})
    assumed, stated = (
        of(plan_of(header({**LASER, "sigma": sigma}, geometry={}), plan.postures))[1]["beam"]
        for sigma in ({}, {"tilt_deg": 0.05})
    )
    assert stated.off_u > 5
    assert assumed.off_u < 1
    assert not assumed.harmful
    assert not assumed.dangerous


def test_where_nothing_is_tested_nothing_is_promised() -> None:
    estimated = good_plan(7, seed=2, noise={"scale": "estimated"})
    assert of(estimated)[1] == {}
    assert check(estimated).power == ()
    assert power_sentences(()) == []


def test_the_sentences() -> None:
    told = (
        DetectionPower("jump", 0.2, "deg", 0.95, 1.5, 2),
        DetectionPower("tool", 1.0, "mm", 0.014, 1.7, None, 0.3, 4.0, 5.0, 0.182, 2.55),
    )
    noticed, hidden = power_sentences(told)
    assert noticed == (
        "A run of this plan detects a 0.2° jump of J2’s zero with a probability of 95 % or more."
    )
    assert hidden == (
        "Measure the mounting: a tool 5\N{NO-BREAK SPACE}mm off can hide: 0.18°, TCP 2.5\N{NO-BREAK SPACE}mm."
    )
    assert power_sentences(told[:1]) == [noticed]


def test_three_cautions_at_most_the_most_harmful_first() -> None:
    harms: tuple[tuple[WrongModel, float], ...] = (
        ("backlash", 0.4), ("reading", 3.0), ("jump", 1.0), ("drift", 2.0), ("noise", 0.5)
    )  # fmt: skip
    rows = [DetectionPower(wrong, 0.2, "deg", 0.1, 5.0, 4, 0.5, 0.4, 0.3, 0.1, mm, 4) for wrong, mm in harms]
    texts = remaining(rows)
    assert [text.partition(": ")[2].partition(" can hide")[0] for text in texts] == [
        "one reading 0.3° off",
        "a 0.3° drift of J4’s zero",  # of what changes during a run the most harmful
        "noise 0.3° the stated",
    ]
    assert texts[1].startswith("Repeat the first postures: ")
    # Said is what can still be repeated.
    for again, reading, changed in (
        (0.3, "Repeat all postures", "Repeat more postures"),
        (1.0, "Compare with a second run", "Compare with a second run"),
    ):
        texts = remaining([replace(row, again=again) for row in rows])
        assert reading in texts[0]
        assert changed in texts[1]
        assert ("Repeat" in "".join(texts)) == (again < 1)
    texts = remaining(rows)
    noise = DetectionPower("noise", 3.0, "1", 0.1, 5.0, None, 0.5, 4.0, 4.0, 0.1, 0.5)
    (text,) = remaining([noise])
    assert text.startswith("Estimate the noise: noise 4\N{NO-BREAK SPACE}times the stated")
    assert remaining([replace(row, risk=0.01) for row in rows]) == []
    # Where the TCP is not determined the errors of the offsets rank them.
    degrees = [replace(row, hidden_tcp_mm=None, hidden_offset=row.hidden_tcp_mm) for row in rows]
    assert [text[:20] for text in remaining(degrees)] == [text[:20] for text in texts]
    assert not any("TCP" in text for text in remaining(degrees))


def test_what_a_pass_can_hide_is_noticed_when_it_is_larger() -> None:
    """By a second way: the power of the same wrong model at that size, and at twice that."""
    problem, told = of(good_plan(12, seed=2, geometry={}))
    identified = identify(problem, problem.nominal())
    jump = told["jump"]
    assert jump.hidden_size is not None
    for times, low, high in ((1.0, 0.5, 0.951), (2.0, 0.951, 1.0)):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(power, "JUMP_DEG", times * jump.hidden_size)
            patch.setattr(power, "revolute", lambda problem, joint=jump.hidden_joint: [joint - 1])
            rows = {row.wrong: row for row in powers(problem, problem.nominal(), identified)}
        assert low < rows["jump"].probability <= high


def share_beyond_chance(data: DataSets, *, changes: bool = False) -> float:
    """The share of simulated runs whose residuals and tolerances are beyond what chance leaves, or with
    `changes` in which a change is significant."""
    problem = data.problem
    at = problem.parameters.among_free[problem.tolerated]
    dof = problem.data_size - identify(problem, problem.nominal()).facts.rank
    fits = fitted(data)
    beyond = 0
    for x, z, *readings in zip(fits.x, fits.z, data.joints, data.spots, strict=True):
        run = problem.moved(*readings)
        squares = float((run.whiten(x).residual ** 2).sum() + (z[at] ** 2).sum())
        beyond += stats.chi2.sf(squares, dof) < LACK_OF_FIT or (changes and run_change(run, x) is not None)
    return beyond / len(data.joints)


def compared(count: int, runs: int) -> None:
    """Arms that deviate within their tolerances: as many runs are noticed as predicted, up to 4 standard
    errors and 4 % for the moments by which the power is approximated."""
    problem, predicted = of(good_plan(count, seed=2, geometry={}))
    parameters, joint = problem.parameters, predicted["jump"].joint
    assert joint is not None
    assert len(problem.tolerated) > 20  # an uncertain arm
    spread = np.where(parameters.tolerated, parameters.prior_std, 0.0)
    spread[parameters.group("target")], spread[parameters.group("offset")] = 5.0, np.radians(1.0)
    rng = np.random.default_rng(count)
    right = drawn(problem, runs, rng, spread)
    jumped, more = right.joints.copy(), np.sqrt(NOISE_TIMES**2 - 1)
    jumped[:, count // 2 :, joint - 1] += np.radians(JUMP_DEG)
    spoilt = {
        "jump": replace(right, joints=jumped),
        "backlash": replace(
            right, joints=right.joints + np.radians(BACKLASH_DEG) * rng.choice([-1.0, 1.0], jumped.shape)
        ),
        "noise": replace(
            right,
            joints=right.joints + more * problem.noise.joint * rng.normal(size=jumped.shape),
            spots=right.spots + more * problem.noise.spot * rng.normal(size=right.spots.shape),
        ),
    }
    assert share_beyond_chance(right) <= stats.binom.ppf(1 - 1e-4, runs, LACK_OF_FIT) / runs
    called = stats.binom.ppf(1 - 1e-4, runs, LACK_OF_FIT + SIGNIFICANT) / runs
    assert share_beyond_chance(right, changes=True) <= called
    for name, data in spoilt.items():
        probability = predicted[name].probability
        error = np.sqrt(probability * (1 - probability) / runs)
        share = share_beyond_chance(data, changes=name == "jump")
        # The better of two tests is a lower bound of both.
        more = 0.15 if name == "jump" else 0.04
        assert -4 * error - 0.04 < share - probability < 4 * error + more, (name, predicted[name])


@pytest.mark.long
def test_what_runs_of_an_uncertain_arm_notice_is_as_predicted() -> None:
    compared(12, 30)


@pytest.mark.long
@pytest.mark.parametrize("count", [7, 12, 16, 30])
def test_what_many_runs_of_an_uncertain_arm_notice_is_as_predicted(count: int) -> None:
    compared(count, 400)


def test_a_jump_between_the_halves_is_noticed_more_than_between_the_halves_as_recorded() -> None:
    plan = good_plan(10, seed=5, geometry={})
    problem, before = of(plan)
    first, second = halves(problem, problem.nominal())
    assert (len(first), len(second)) == (5, 5)
    assert sorted([*first, *second]) == list(range(10))
    _, after = of(plan_of(plan.header, plan.postures[np.concatenate([first, second])]))
    assert after["jump"].risk < 0.1 * before["jump"].risk
    for wrong in ("backlash", "noise"):  # which do not hang on the order
        assert after[wrong].probability == pytest.approx(before[wrong].probability)


def test_what_a_pass_is_subject_to() -> None:
    jump = DetectionPower("jump", 0.2, "deg", 0.05, 15.3, 5, 0.42, 0.1234)
    beam = DetectionPower("beam", 0.3, "deg", 0.001, 5.8, None, 0.99, 0.5)
    harmless, sure = DetectionPower("tool", 1.0, "mm", 0.0, 0.2), DetectionPower("noise", 3.0, "1", 0.9, 2.8)
    assert [each.dangerous for each in (jump, harmless, sure)] == [True, False, False]
    assert condition((jump, harmless, sure, beam)) == "for this geometry and backlash, if nothing changed"
    assert condition((harmless, sure)) == "for this backlash"
    assert condition(()) is None
    assert no_plan_sentence((jump, harmless)) == (
        "No plan with this tool and target detects a 0.2° jump of J5’s zero."
    )
    assert no_plan_sentence((harmless,)) is no_plan_sentence(()) is None
    assert power_limit((jump,)).startswith("the power: a run may not detect a 0.2° jump of J5’s zero")


@pytest.mark.parametrize("count", [6, 7, 8])
def test_noise_so_many_times_the_stated_is_noticed_as_by_the_chi_square_of_it(count: int) -> None:
    """Of an exact arm and a known tool χ² of t times the noise is t² χ²: known without moments. What it adds
    to the stated noise is √(t² - 1) times that, in the offsets too."""
    problem, told = of(good_plan(count))
    dof = problem.measured_size - int(problem.parameters.free.sum())
    exact = stats.chi2.sf(stats.chi2.isf(LACK_OF_FIT, dof) / NOISE_TIMES**2, dof)
    assert told["noise"].probability == pytest.approx(exact, abs=1e-3)
    assert told["noise"].off_u == pytest.approx(np.sqrt(NOISE_TIMES**2 - 1), rel=0.01)
