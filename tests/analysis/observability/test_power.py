"""What a run would notice, against how many simulated runs are a misfit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from cells import LASER, good_plan, header, plan_of
from scipy import stats

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.check import check
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.analysis.observability.power import BACKLASH_DEG, JUMP_DEG, NOISE_TIMES, DetectionPower, powers
from zerobeam.experiments.simulate import simulated_readings
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import power_sentences

RUNS = 40


def of(plan: Plan) -> tuple[Problem, dict[str, DetectionPower]]:
    problem = Problem.from_plan(plan)
    x = problem.nominal()
    return problem, {each.wrong: each for each in powers(problem, x, identify(problem, x).facts.rank)}


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


def test_where_nothing_is_tested_nothing_is_promised() -> None:
    estimated = good_plan(7, seed=2, noise={"scale": "estimated"})
    assert of(estimated)[1] == {}
    assert check(estimated).power == ()
    assert power_sentences(()) == []


def test_the_sentences() -> None:
    told = (DetectionPower("jump", 0.2, "deg", 0.95, 1.5, 2), DetectionPower("tool", 1.0, "mm", 0.014, 0.67))
    noticed, missed = power_sentences(told)
    assert noticed == (
        "A run of this plan detects a jump of 0.2° in the zero of joint 2 with a probability of 80 % or more."
    )
    assert missed == (
        "A run of this plan may not detect a tool 1\N{NO-BREAK SPACE}mm off"
        " (probability 1 %, error of an offset up to 0.67 u)."
    )
