"""Remedies that are tried before they are said: each is carried out, in a plan and in simulation, and gives the
standard uncertainty that was promised."""

from __future__ import annotations

import numpy as np
import pytest
from cells import (
    PROBE,
    TABLE_2,
    good_plan,
    header,
    irb1600,
    pattern_plan,
    placed_plan,
    plan_of,
    run_of,
    simulated,
)

from zerobeam.analysis.observability.causes import (
    NullDirection,
    Tried,
)
from zerobeam.analysis.observability.check import Check, carried_out, check
from zerobeam.analysis.observability.remedies import carried_out as changed_shots
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import Run
from zerobeam.model.likelihood.problem import Problem

ORDER = np.random.default_rng(0).permutation(7)
RANGES = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
WITHIN = 0.1  # of the promised u


def nearly_x(range_deg: float, geometry: str | None = None) -> Plan:
    """The X-Pattern with joint 1 varied by so much, and aimed."""
    plan = pattern_plan("x", geometry=geometry)
    postures = plan.postures.copy()
    postures[:, 0] += np.radians(np.linspace(-0.5, 0.5, 7) * range_deg)[ORDER]
    return plan_of(plan.header, check(plan_of(plan.header, postures)).aimed.aimed.problem.joints)


def recorded_y() -> Plan:
    """Postures of a run of the paper's Y-Pattern, as it was recorded."""
    rows = [
        [-45.468, 43.722, -34.995, 16.286, 29.325, 18.696],
        [-33.763, 27.130, -5.844, 17.902, 4.665, 14.711],
        [-18.138, 17.319, 10.309, 14.266, -16.513, 11.071],
        [0.136, 14.098, 15.981, 3.929, -29.023, 3.467],
        [18.239, 17.488, 10.765, -8.438, -22.428, -5.594],
        [33.651, 27.130, -5.229, -14.962, -1.955, -11.237],
        [45.333, 43.495, -34.246, -17.742, 23.689, -13.731],
    ]
    own = header(target=None, geometry=None)
    problem = Problem.build(own, irb1600(), np.radians(rows), ["psd"] * 7)
    guess = problem.nominal()[problem.parameters.block("target", 0)].round(1).tolist()
    return plan_of(header(target=guess, geometry=None), np.radians(rows))


PLANS = {
    "x": lambda: nearly_x(0.0),
    **{f"nearly x, {size:g}°": lambda size=size: nearly_x(size) for size in RANGES},
    "y": lambda: pattern_plan("y", geometry=None),
    "y, exact arm": lambda: pattern_plan("y"),
    "y, recorded": recorded_y,
    "x, exact arm": lambda: nearly_x(0.0, "exact"),
    "nearly x, 10°, exact arm": lambda: nearly_x(10.0, "exact"),
    "probe": lambda: still_probe((1,)),
    "joint 3 does not change": lambda: still(2),
}
LONG = r"^(?!x$|nearly x, 10°$|y$|probe$)"


def still(*joints: int) -> Plan:
    """Varied postures with some joints (from 0) that do not change."""
    plan = good_plan(12, geometry=None)
    postures = plan.postures.copy()
    postures[:, joints] = postures[0, joints]
    aimed = check(plan_of(plan.header, postures)).aimed.aimed
    return plan_of(plan.header, aimed.problem.joints[aimed.hit & aimed.ahead])


def still_probe(joints: tuple[int, ...]) -> Plan:
    """A probe whose tip meets two balls with joint 1 as it is, as far as the others reach them."""
    places = {"a": (700.0, 200.0, 500.0), "b": (900.0, -200.0, 700.0)}
    return placed_plan(places, {"a": 4, "b": 4}, PROBE, geometry=None)


def tried_of(null_space: tuple[NullDirection, ...]) -> list[Tried]:
    return [each.tried for each in null_space if each.tried is not None and each.tried.joint is not None]


def changed_plan(plan: Plan, answer: Check, tried: Tried) -> Plan:
    joints, like = carried_out(answer, tried)
    postures, targets = answer.aimed.aimed.problem.joints.copy(), list(plan.targets)
    if tried.how == "add":
        return plan_of(plan.header, np.vstack([postures, joints]), [*targets, *(targets[i] for i in like)])
    postures[list(like)] = joints
    return plan_of(plan.header, postures, targets)


@pytest.mark.at_length(LONG)
@pytest.mark.parametrize("case", PLANS)
def test_a_plan_with_its_remedy_gives_what_was_promised(case: str) -> None:
    plan = PLANS[case]()
    before = check(plan)
    remedies = tried_of(before.identifiability.null_space)
    assert before.verdict != "pass"
    assert remedies
    for tried in remedies:
        after = check(changed_plan(plan, before, tried))
        for row in tried.predicted:
            now, then = before.parameters.named(row.name), after.parameters.named(row.name)
            assert now.std == (None if row.before is None else pytest.approx(row.before, rel=1e-6))
            assert now.status in ("weak", "unidentifiable")
            assert then.std == pytest.approx(row.after, rel=WITHIN)
            assert row.before is None or row.after <= 0.8 * row.before
            assert (then.status == "identified") == (row.after <= row.tolerance)


@pytest.mark.at_length(LONG)
@pytest.mark.parametrize("case", PLANS)
def test_a_run_with_its_remedy_gives_what_was_promised(case: str) -> None:
    """Measured again with all postures changed, or with one more measurement."""
    plan = PLANS[case]()
    _, run = simulated(plan, TABLE_2, seed=5)
    before = solve(Problem.from_run(run))
    remedies = tried_of(before.null_space)
    assert before.verdict != "pass"
    assert remedies
    for tried in remedies:
        assert tried.measured
        assert tried.how != "replace"  # what is measured is not measured again
        after = solve(Problem.from_run(measured_again(plan, run, before, tried)))
        for row in tried.predicted:
            assert before[row.name].std == (None if row.before is None else pytest.approx(row.before))
            assert after[row.name].std == pytest.approx(row.after, rel=WITHIN)


def measured_again(plan: Plan, run: Run, before: Solution, tried: Tried) -> Run:
    problem = before.problem
    shots = changed_shots(problem, before.fit.x, tried, problem.shot_numbers)
    names = [problem.targets[k] for k in shots.target_index]
    _, new = simulated(plan_of(plan.header, shots.joints, names), TABLE_2, seed=6)
    if tried.how == "vary":
        kept = [shot for shot in run.shots if shot.shot not in tried.postures]
        return run_of(run.header, [*new.shots, *kept])
    return run_of(run.header, [*run.shots, *(s.model_copy(update={"shot": 100 + s.shot}) for s in new.shots)])
