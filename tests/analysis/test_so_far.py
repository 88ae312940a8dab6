from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from cells import (
    LASER,
    OPEN_LASER,
    OPEN_PROBE,
    PROBE,
    TABLE_2,
    good_plan,
    header,
    irb1600,
    pattern_plan,
    plan_of,
    run_of,
    simulated,
    simulated_problem,
)

from zerobeam.analysis.analyse import analyse
from zerobeam.analysis.estimation.fit import fit_likelihood
from zerobeam.analysis.posterior.posterior import UNSAMPLED
from zerobeam.analysis.solution import Solution, judge, so_far
from zerobeam.experiments.plans.patterns import pattern
from zerobeam.model.files.header import StatedDistance, StatedTarget
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem


def statuses(told: Solution) -> dict[str, str]:
    """Of the offsets that are not held, by name."""
    return {offset.name: offset.status for offset in told.offsets if offset.status != "held"}


def growing(plan: Plan, seed: int = 0) -> list[Solution]:
    """What each of the first shots of a run tells, one more at a time, as while they are made."""
    _, run = simulated(plan, TABLE_2, seed)
    functions = Problem.from_run(run).functions  # the same for any number of shots, and slow to make
    told = []
    for count in range(1, len(run.shots) + 1):
        problem = Problem.from_run(run_of(run.header, run.shots[:count]))
        told.append(so_far(replace(problem, functions=functions)))
    return told


PLANS: dict[str, Callable[[], Plan]] = {
    "good": lambda: good_plan(7),
    "x-pattern": lambda: pattern_plan("x"),
    "y-pattern": lambda: pattern_plan("y"),
    "open laser": lambda: good_plan(9, tool=OPEN_LASER),
    "probe": lambda: good_plan(7, tool=PROBE),
    "open probe": lambda: good_plan(9, tool=OPEN_PROBE),
    "estimated scale": lambda: good_plan(8, noise={"scale": "estimated"}),
}


@pytest.mark.parametrize("name", ["good", "x-pattern", "open probe", "estimated scale"])
@pytest.mark.at_length(r"^(open probe|estimated scale)")
def test_as_the_result_of_the_whole_run(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    _, run = simulated(PLANS[name](), {} if "probe" in name else TABLE_2, 2)
    told = so_far(Problem.from_run(run))
    monkeypatch.setattr("zerobeam.analysis.analyse.sample_posterior", lambda *_, **__: (UNSAMPLED, None))
    result = analyse(run).result
    rows = {row.name: row for row in result.parameters if row.group == "offset" and not row.held}
    assert statuses(told) == {name: row.status for name, row in rows.items()}
    assert {n for n, std in told.offset_std.items() if std is None} == {
        n for n, r in rows.items() if r.std is None
    }
    for one, row in rows.items():
        if row.std is not None:
            assert told.offset_std[one] == pytest.approx(row.std, rel=1e-4)
    known = [row.std for row in rows.values() if row.std is not None]
    assert told.worst == (pytest.approx(max(known), rel=1e-4) if len(known) == len(rows) else None)
    chance = result.likelihood.p_value
    assert told.p_value == (None if chance is None else pytest.approx(chance, rel=1e-4))
    assert told.moved_target is None


@pytest.mark.long
def test_what_another_optimum_disagrees_about_is_not_known() -> None:
    """An X-Pattern of ten targets has two, 0.2 apart in log-posterior; a climb from zero sees one."""
    own = header(target=(900.0, 0.0, 0.0), prior={"offset_deg": 6.0})
    names = [f"t{k // 2}" for k in range(20)]
    postures = pattern(own, irb1600(), np.array([900.0, 0.0, 0.0]), "x", len(names))
    postures[-1] = postures[-2]
    shots = simulated(plan_of(own, postures), TABLE_2, 2)[1].shots
    places = {"t9": StatedTarget(guess_mm=(900.0, 0.0, 0.0), sigma_mm=100.0)}
    apart = StatedDistance(between=("t0", "t3"), mm=50.0, sigma_mm=0.1)
    stated = own.model_copy(update={"targets": places, "distances": (apart,)})
    named = [shot.model_copy(update={"target": name}) for shot, name in zip(shots, names, strict=True)]
    problem = Problem.from_run(run_of(stated, named))
    alone = judge(fit_likelihood(problem, starts=0))
    assert (alone.fit.others, alone["delta5"].status) == ((), "weak")
    told = so_far(problem)
    assert [round(other.below, 1) for other in told.fit.others] == [0.2]
    assert statuses(told)["delta5"] == "unidentifiable"
    assert told.offset_std["delta5"] is None


@pytest.mark.parametrize("name", PLANS)
@pytest.mark.at_length(r"^(open probe|y-pattern|two|x-pattern)")
def test_shot_by_shot(name: str) -> None:
    """One shot tells nothing, and what cannot be told has no std at any number of shots."""
    told = growing(PLANS[name]())
    assert [one.problem.shots for one in told] == list(range(1, len(told) + 1))
    assert set(statuses(told[0]).values()) == {"unidentifiable"}
    assert told[0].p_value is None
    for one in told:
        assert np.isfinite(one.fit.x).all()
        assert one.consistent
        assert {n for n, std in one.offset_std.items() if std is None} == {
            n for n, status in statuses(one).items() if status == "unidentifiable"
        }
        judged = [status for status in statuses(one).values() if status != "assumed"]
        assert (one.worst is None) == (not judged or "unidentifiable" in judged)
    if name == "x-pattern":
        assert all(one.offset_std["delta2"] is None for one in told)
        assert told[-1].offset_std["delta4"] is not None
    if name == "good":
        assert told[-1].worst is not None


def test_more_shots_never_tell_less() -> None:
    """Where the mode hardly moves any more each shot lowers all stds, or leaves them (to second order)."""
    told = growing(good_plan(12, joint_deg=0.0005, spot_mm=0.002))[3:]
    for before, after in pairwise(told):
        for name, std in before.offset_std.items():
            later = after.offset_std[name]
            assert later <= 1.02 * std
    assert max(told[-1].offset_std.values()) < max(told[0].offset_std.values()) / 10
    # Four measurements of a tool that is taken as exact determine nothing without it: none is judged by them.
    assert told[0].worst is None
    assert told[-1].worst is not None


def test_without_enough_numbers_the_scale_is_not_known() -> None:
    """Four shots are as many numbers as unknowns: no std follows from misses that are always met."""
    estimated = growing(PLANS["estimated scale"]())
    assert set(statuses(estimated[3]).values()) == {"unidentifiable"}
    assert {"identified", "assumed"} & set(statuses(estimated[4]).values())
    known = growing(good_plan(8))
    assert set(statuses(known[3]).values()) == {"assumed"}
    assert "identified" in statuses(known[-1]).values()


def test_the_same_shots_tell_the_same() -> None:
    """To the last bit, whatever was asked before."""
    _, problem = simulated_problem(good_plan(7), TABLE_2)
    first = so_far(problem)
    so_far(simulated_problem(pattern_plan("x"))[1])
    again = so_far(simulated_problem(good_plan(7), TABLE_2)[1])
    assert first.fit.x.tobytes() == again.fit.x.tobytes()
    assert (first.offset_std, first.p_value) == (again.offset_std, again.p_value)
    assert statuses(first) == statuses(again)


def test_targets_seen_once_and_twice() -> None:
    places: dict[str, Any] = {n: {"guess_mm": [900, 0, 0], "sigma_mm": 50} for n in ("a", "b", "c")}
    own = header(LASER, targets=places)
    told = growing(plan_of(own, good_plan(10).postures, list("abcaaabaaa")))
    assert told[2].worst is None
    assert told[-1].worst is not None
    assert told[-1].consistent


def test_what_is_not_consistent() -> None:
    """A target that moves is named; understated noise is a lack of fit and no displacement."""
    _, problem = simulated_problem(good_plan(12, joint_deg=0.002), TABLE_2)
    assert so_far(problem).consistent
    noise = problem.noise.times(1 / 5)
    loud = so_far(replace(problem, noise=noise))
    assert not loud.consistent
    assert loud.moved_target is None
    assert loud.p_value < 1e-3
    # What a target that moved by 3 mm in z after the sixth shot does to the spots.
    n = problem.robot.n
    _, by_own = problem.linearise(so_far(problem).fit.x)
    later = np.arange(12)[:, None] > 5
    moved = so_far(
        problem.moved(problem.joints, problem.spots - np.where(later, 3.0 * by_own[:, :, n + 2], 0.0))
    )
    assert not moved.consistent
    found = moved.moved_target
    assert (found.target, found.after_shot, found.before_shot) == ("psd", 5, 6)
