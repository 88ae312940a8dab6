"""Reasons of an uncertain arm: for designs that are singular on purpose, status and cause are those of exact
geometry, whether the design is singular exactly or only within the noise."""

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from cells import (
    AXIS_LASER,
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
    random_robot,
    simulated_problem,
    varied_postures,
)

from zerobeam.analysis.estimation.fit import Optimum, fit_likelihood
from zerobeam.analysis.observability.causes import (
    BaseFrame,
    Cause,
    CommonMotion,
    Held,
    LocalOptima,
    NoiseSplit,
    OnAxis,
    OnePosition,
    ParallelAxes,
    TargetUnseen,
    ToleranceOnly,
    TooFewMeasurements,
    ToolAgainstTarget,
    ToolRotation,
    WithinTolerances,
    cause_for,
)
from zerobeam.analysis.observability.check import aim_plan, check, without_posture
from zerobeam.analysis.observability.identifiability import Identified, identify, unexplained
from zerobeam.analysis.solution import Solution, judge, so_far, solve
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.observability import reason, remedy
from zerobeam.words.sentences import to_json

ARMS = ("exact", "typical", "typical, tool 1 mm and 0.5°")
ROUGH_LASER = {**LASER, "sigma": {"shift_mm": 1.0, "tilt_deg": 0.5}}
ROUGH_PROBE = {**PROBE, "sigma": {"shift_mm": 1.0}}


def of_arm(plan: Plan, arm: str, **changes: Any) -> Plan:
    """The plan for an arm of that kind."""
    content = plan.header.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    del content["geometry"]
    if arm == "exact":
        content["geometry"] = "exact"
    tool = content["tool"]
    if arm == ARMS[2] and tool.get("calibrated", True):
        sigma = ROUGH_LASER["sigma"] if tool["kind"] == "laser" else ROUGH_PROBE["sigma"]
        content["tool"] = {**tool, "sigma": sigma}
    own = Header.model_validate({**content, **changes})
    return plan_of(own, plan.postures, plan.targets, plan.robot)


def jittered(plan: Plan, degrees: float) -> Plan:
    """The plan with noise on every recorded joint."""
    noise = np.random.default_rng(1).normal(size=plan.postures.shape) * np.radians(degrees)
    return plan_of(plan.header, plan.postures + noise, plan.targets, plan.robot)


def with_constant(count: int) -> Plan:
    """Varied postures in which the first joints do not change."""
    plan = good_plan(16)
    postures = plan.postures.copy()
    postures[:, :count] = [0.1, 0.3, -0.2][:count]
    return plan_of(plan.header, postures)


def stretched_wrist() -> Plan:
    """Joint 5 at 0: the axes of joints 4 and 6 are one line."""
    plan = good_plan(24)
    postures = plan.postures.copy()
    postures[:, 4] = 0.0
    return plan_of(plan.header, postures)


def seen_once() -> Plan:
    own = header(targets={name: {"guess_mm": [900, 0, 0]} for name in "ab"})
    return plan_of(own, good_plan(16).postures, ["a"] * 15 + ["b"])


def first(count: int) -> Plan:
    plan = good_plan()
    return plan_of(plan.header, plan.postures[:count])


@dataclass(frozen=True)
class Design:
    """A plan whose parameter `of` is not determined, `because` of a cause that `says` something."""

    plan: Callable[[], Plan]
    of: str
    because: type
    says: str


DESIGNS = {
    "a target seen once": Design(seen_once, "b.z", TargetUnseen, "the target b has one measurement only"),
    "base frame": Design(lambda: good_plan(16, held=[]), "delta1", BaseFrame, "joint 1 defines the base"),
    "beam on the last axis": Design(
        lambda: good_plan(12, 5, AXIS_LASER), "delta6", OnAxis, "the beam lies on or near the axis of joint 6"
    ),
    "free laser": Design(
        lambda: good_plan(16, 5, OPEN_LASER, held=["delta1"]),
        "delta6",
        ToolRotation,
        "the uncalibrated tool",
    ),
    "free probe": Design(
        lambda: good_plan(16, 7, OPEN_PROBE, target=(700.0, 200.0, 900.0)),
        "delta6",
        ToolRotation,
        "joint 6 and a free probe tip rotate together",
    ),
    "X-Pattern": Design(
        lambda: pattern_plan("x"), "delta2", CommonMotion, "included (the X-Pattern of the paper)"
    ),
    "joint 1 constant": Design(lambda: with_constant(1), "delta2", CommonMotion, "everything after joint 1"),
    "joints 1 and 2 constant": Design(
        lambda: with_constant(2), "delta3", CommonMotion, "everything after joint 2"
    ),
    "joint 5 stretched": Design(
        stretched_wrist, "delta4", ParallelAxes, "the axes of joints 4 and 6 stay parallel"
    ),
    "3 measurements": Design(
        lambda: first(3),
        "delta2",
        TooFewMeasurements,
        "3 measurements give 6 numbers; 5 offsets and 3 target coordinates, 8 in all, must be determined",
    ),
    "2 measurements": Design(
        lambda: first(2), "delta5", TooFewMeasurements, "2 measurements give 4 numbers;"
    ),
}


def judged(plan: Plan, *, deviating: int | None = None) -> tuple[Problem, Identified]:
    """The plan judged at its nominal values, or at links and tool that deviate as their tolerances allow."""
    problem = Problem.from_plan(plan)
    x = problem.nominal()
    if deviating is not None:
        at = problem.tolerated
        draws = np.random.default_rng(deviating).normal(size=len(at))
        x[at] += draws * problem.parameters.prior_std[at]
    return problem, identify(problem, x)


def cause_of(problem: Problem, identified: Identified, name: str) -> Cause | None:
    i = problem.parameters.index(name)
    return cause_for(identified.facts.null_space, problem.parameters.items[i], identified.status[i])


@pytest.mark.one_in(3)
@pytest.mark.parametrize("jitter_deg", [0.0, 0.01, 0.04])  # of the stated noise, and more
@pytest.mark.parametrize("case", DESIGNS)
@pytest.mark.at_length(r"-0\.0(1|4)$")
def test_status_and_cause_are_those_of_exact_geometry(case: str, jitter_deg: float) -> None:
    design, advised = DESIGNS[case], set()
    for arm in ARMS:
        plan = of_arm(design.plan(), arm)
        problem, identified = judged(jittered(plan, jitter_deg))
        names = problem.parameters.names
        assert identified.status[names.index(design.of)] == "unidentifiable", arm
        cause = cause_of(problem, identified, design.of)
        assert isinstance(cause, design.because), (arm, cause)
        assert design.says in reason(cause)
        advised.add(remedy(cause))
        # Rank and null space agree, and nothing that has a tolerance is in it.
        facts, tolerated = identified.facts, {names[i] for i in problem.tolerated}
        assert facts.size == int(problem.parameters.free.sum())
        lost = sum(d.kind == "exact" or (d.data_std or 0) >= 1 for d in facts.null_space)
        assert facts.size - facts.rank == lost
        assert not any(tolerated & set(d.combination) for d in facts.null_space)
        matters = {"offset", "target"} | (set() if problem.tool.calibrated else {"tool"})
        groups = dict(zip(names, (item.group for item in problem.parameters.items), strict=True))
        assert all(groups[name] in matters for d in facts.null_space for name in d.combination)
    assert len(advised) == 1


@pytest.mark.parametrize("case", ["beam on the last axis", "X-Pattern", "joint 5 stretched"])
@pytest.mark.at_length(r"^X-Pattern")
def test_deviations_do_not_hide_what_is_singular(case: str) -> None:
    """An estimated tilt takes a beam off the axis, a link's misaligns axes: what is then observed of an
    offset is as uncertain as the tilt, and the reason is that of the arm by its nominal geometry."""
    design = DESIGNS[case]
    for seed in range(3):
        problem, identified = judged(of_arm(design.plan(), "typical"), deviating=seed)
        assert identified.status[problem.parameters.index(design.of)] == "unidentifiable"
        assert isinstance(cause_of(problem, identified, design.of), design.because)


def test_a_typical_arm_is_never_known_better_than_an_exact_one() -> None:
    for plan in (good_plan(), pattern_plan("y"), pattern_plan("x", 400.0)):
        std = [judged(of_arm(plan, arm))[1].data_std[1:6] for arm in ARMS]
        assert (std[1] >= std[0]).all()
        assert (std[2] >= std[1]).all()


def test_a_good_plan_has_no_null_directions() -> None:
    """Directions of what has a tolerance alone, with next to nothing of an offset, are no finding."""
    problem, identified = judged(good_plan(40, geometry=None))
    facts = identified.facts
    assert (facts.rank, facts.size, facts.null_space) == (facts.size, 8 + len(problem.tolerated), ())
    assert identified.status[:6] == ("held", *["identified"] * 4, "assumed")
    tilt = problem.parameters.index("tool.tilt1")
    assert isinstance(cause_of(problem, identified, "tool.tilt1"), ToleranceOnly) == (
        identified.status[tilt] == "unidentifiable"
    )


def test_noise_that_the_scatter_does_not_separate() -> None:
    for arm in ARMS:
        plan = of_arm(pattern_plan("x", noise={"scale": "separate"}), arm)
        problem, identified = judged(plan)
        directions = [d for d in identified.facts.null_space if isinstance(d.cause, NoiseSplit)]
        assert len(directions) == 1, arm
        assert set(directions[0].combination) == {"noise.joint", "noise.spot"}
        assert problem.noise.separate


def test_a_slide_that_defines_the_base_frame() -> None:
    """A shift along its axis is free, whether the slide is held for that or not."""
    robot = random_robot("prrrr", 8)
    postures = np.random.default_rng(2).uniform(-0.5, 0.5, (16, 5)) * np.where(robot.display > 1, 1, 200.0)
    for held in (None, []):
        own = header(PROBE, target=(300.0, 0.0, 0.0), noise={"joint_mm": 0.02}, held=held)
        problem, identified = judged(plan_of(own, postures, robot=robot))
        cause = cause_of(problem, identified, "delta1")
        assert cause == (BaseFrame(prismatic=True) if held == [] else Held("base frame", prismatic=True))
        assert "a shift along its axis together with every target" in reason(cause)
        assert "paper" not in reason(cause)


def test_a_tool_that_does_not_rotate() -> None:
    """A gantry: what its free probe is off, the target may be off too."""
    robot = random_robot("ppp", 3)
    own = header(OPEN_PROBE, target=(300.0, 0.0, 0.0), noise={"joint_mm": 0.02}, held=[])
    postures = np.random.default_rng(4).uniform(-200, 200, (8, 3))
    for arm in ARMS:
        bent = {} if arm == "exact" else {"geometry": {"harmonics": False, "gravity": False}}
        problem, identified = judged(of_arm(plan_of(own, postures, robot=robot), arm, **bent))
        causes = [d.cause for d in identified.facts.null_space if "tool.x" in d.combination]
        assert ToolAgainstTarget() in causes, arm
        assert identified.status[problem.parameters.index("tool.x")] == "unidentifiable"


def test_one_position_of_a_probe() -> None:
    for arm in ARMS:
        problem = Problem.from_plan(of_arm(good_plan(8, 7, PROBE, target=(700.0, 200.0, 900.0)), arm))
        assert unexplained(problem).cause == OnePosition()


def test_two_optima_of_a_typical_arm() -> None:
    """What differs between them has no number, and that is the reason. If they differ in what has a
    tolerance alone, that is no finding."""
    _, problem = simulated_problem(good_plan(12, geometry=None), TABLE_2, seed=2)
    fit = fit_likelihood(problem, starts=0)
    alone = judge(replace(fit, others=()))
    free = problem.parameters.free
    names = np.array(problem.parameters.names)[free]
    known = np.array([status in ("identified", "weak") for status in alone.status])[free]
    link = names[known & problem.parameters.tolerated[free]][0]

    def with_optimum(*differs: str) -> Solution:
        away = np.where(np.isin(names, differs), 5.0, 0.0)
        return judge(replace(fit, others=(Optimum(fit.z + away * fit.std, fit.std, 1.0),)))

    told = with_optimum("delta3", link)
    assert (told["delta3"].status, told["delta3"].estimate) == ("unidentifiable", None)
    assert isinstance(told["delta3"].cause, LocalOptima)
    assert told[link].status == "unidentifiable"
    of_link = with_optimum(link)
    assert (of_link[link].status, of_link[link].cause) == ("unidentifiable", ToleranceOnly())
    assert of_link.null_space == alone.null_space
    assert of_link["delta3"].status == alone["delta3"].status != "unidentifiable"


def test_too_few_measurements_count_no_tolerance() -> None:
    """What measurements give, and what they must determine."""
    distance = [{"between": ["a", "b"], "mm": 60.0, "sigma_mm": 0.5}]
    for arm in ARMS:
        cause = unexplained(Problem.from_plan(of_arm(first(3), arm))).cause
        assert cause == TooFewMeasurements(3, 0, 6, {"offset": 5, "target": 3}, 4)
        own = header(targets={name: {"guess_mm": [900, 0, 0]} for name in "ab"}, distances=distance)
        plan = of_arm(plan_of(own, first(4).postures, ["a", "b", "a", "b"]), arm)
        cause = unexplained(Problem.from_plan(plan)).cause
        assert reason(cause) == (
            "too few measurements: 4 measurements and 1 stated distance give 9 numbers; 5 offsets and 6"
            " target coordinates, 11 in all, must be determined"
        )
        assert "at least 5 measurements" in remedy(cause)
        enough = unexplained(Problem.from_plan(of_arm(first(4), arm))).cause
        assert not isinstance(enough, TooFewMeasurements)


# What is known by tolerances


def test_an_offset_that_the_tolerance_of_the_tool_sets_is_said_to_be() -> None:
    """A rotation of the last joint is a tilt of the beam: δ6 is known as well as tool.sigma, and by it."""
    shares, stds = [], []
    for tilt in (0.01, 0.05, 0.08):
        tool = {**LASER, "sigma": {"shift_mm": 0.001, "tilt_deg": tilt}}
        row = {row.name: row for row in check(good_plan(60, 5, tool)).parameters}["delta6"]
        assert row.status == "identified"
        assert row.std is not None
        assert row.tolerance_share is not None
        shares.append(row.tolerance_share)
        stds.append(row.std)
    assert stds[1] == pytest.approx(0.05, rel=0.01)
    assert stds[2] == pytest.approx(0.08, rel=0.01)
    assert shares[0] < shares[1] < shares[2]
    assert shares[1] > 0.99
    # An exact tool leaves none of it to a tolerance: control.
    exact = {row.name: row for row in check(good_plan(60)).parameters}["delta6"]
    assert (exact.tolerance_share, exact.status) == (None, "assumed")
    assert exact.std is not None
    assert exact.std < stds[0] / 2


@pytest.mark.parametrize(("tilt", "status"), [(0.5, "weak"), (9.0, "unidentifiable")])
def test_a_tool_known_too_badly_is_named_with_its_sigma(tilt: float, status: str) -> None:
    tool = {**LASER, "sigma": {"shift_mm": 0.1, "tilt_deg": tilt}}
    problem, identified = judged(good_plan(30, 5, tool, geometry=None))
    assert identified.status[problem.parameters.index("delta6")] == status
    cause = cause_of(problem, identified, "delta6")
    assert cause == ToolRotation("laser", 6, pytest.approx(tilt))
    assert cause is not None
    assert reason(cause) == (
        "a rotation of joint 6 is equivalent to a tilt of the laser, which is known to"
        f" {tilt:g}° (tool.sigma)"
    )
    assert "uncalibrated" not in reason(cause) + remedy(cause)
    (null,) = [d for d in identified.facts.null_space if d.cause == cause]
    assert null.combination == {"delta6": 1.0}


def test_a_tip_known_too_badly_is_named_with_its_sigma() -> None:
    tool = {**PROBE, "point_mm": [60, 20, 150], "sigma": {"shift_mm": 20.0}}
    places = (700.0, 200.0, 900.0)
    own = header(tool, target=places, geometry="exact")
    problem, identified = judged(plan_of(own, varied_postures(own, irb1600(), places, 20, 7)))
    cause = cause_of(problem, identified, "delta6")
    assert cause is not None
    assert reason(cause) == (
        "a rotation of joint 6 is equivalent to a shift of the probe tip, which is known to"
        " 20\N{NO-BREAK SPACE}mm (tool.sigma)"
    )


def test_an_offset_that_links_leave_weak_names_them() -> None:
    """Shares add up, and the largest are named with their tolerances."""
    answer = check(good_plan(9, geometry=None))
    by_name = {row.name: row for row in answer.parameters}
    named = [d for d in answer.identifiability.null_space if isinstance(d.cause, WithinTolerances)]
    assert named
    for direction in named:
        cause = direction.cause
        assert isinstance(cause, WithinTolerances)
        assert 0.5 <= cause.share <= 1
        for each in cause.largest:
            assert by_name[each.name].prior_std == pytest.approx(each.std)
        assert "of the variance, most by" in reason(cause)
    weak = [row for row in answer.parameters if row.status == "weak" and row.group == "target"]
    assert weak
    assert {type(row.cause) for row in weak} == {WithinTolerances}
    # Control: with a tenth of the tolerances, nothing is left of it.
    known = {"tolerance": {"length_mm": 0.03, "angle_deg": 0.01}, "gravity": False, "harmonics": False}
    finer = check(good_plan(9, geometry=known)).identifiability.null_space
    assert not any(isinstance(d.cause, WithinTolerances) for d in finer)


# Check, analyse and a run that is not finished agree


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.one_in(3)
def test_check_and_analysis_agree_on_the_x_pattern_of_a_typical_arm(seed: int) -> None:
    target = {"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 100}}
    plan = of_arm(pattern_plan("x"), "typical", targets=target)
    planned = check(plan)
    _, problem = simulated_problem(plan, TABLE_2, seed=seed)
    measured, live = solve(problem), so_far(problem)
    assert planned.verdict == measured.verdict == live.verdict == "degenerate"
    rows = {row.name: row for row in planned.parameters}
    for name in ("delta2", "psd.x", "psd.y", "psd.z"):
        causes = [rows[name].cause, measured[name].cause, live[name].cause]
        assert [rows[name].status, measured[name].status, live[name].status] == ["unidentifiable"] * 3
        for cause in causes:
            assert isinstance(cause, CommonMotion)
            assert (cause.joint, cause.revolute) == (2, (True, True))
        # The same words but for how much joint 1 varies.
        words = [reason(cause).split("an offset of joint 2", 1) for cause in causes if cause is not None]
        assert len({after for _, after in words}) == 1
        assert words[0][0] == "joint 1 does not change over the measurements, so "
        assert {start.split(" by only")[0] for start, _ in words[1:]} == {"joint 1 varies"}
    firsts = [
        facts.null_space[0].combination for facts in (planned.identifiability, measured.identified.facts)
    ]
    assert set(firsts[0]) == set(firsts[1]) == {"delta2", "psd.x", "psd.z"}


@pytest.mark.parametrize("geometry", ["exact", None])
@pytest.mark.parametrize("at_deg", [-0.0008, 0.05])
def test_a_part_too_small_to_be_listed_has_the_reason_of_its_direction(
    at_deg: float, geometry: str | None
) -> None:
    """Joint 1 rests beside 0, so that the axis of joint 2 is not quite the y axis: a rotation about it moves
    psd.y a little too, and without a bound."""
    problem = Problem.from_plan(pattern_plan("x", geometry=geometry))
    joints = problem.joints.copy()
    joints[:, 0] = np.radians(at_deg)
    identified = identify(problem.moved(joints, problem.spots), problem.nominal())
    (direction, *_) = identified.facts.null_space
    assert "psd.y" not in direction.combination
    for item, status in zip(problem.parameters.items, identified.status, strict=True):
        if item.name in ("delta2", "psd.x", "psd.y", "psd.z"):
            assert status == "unidentifiable"
            assert isinstance(cause_for(identified.facts.null_space, item, status), CommonMotion)


def test_what_a_plan_of_a_typical_arm_comes_to_without_a_posture() -> None:
    plan = good_plan(4, geometry=None)
    rest = without_posture(aim_plan(plan), 1)
    assert rest is not None
    again = check(plan_of(plan.header, np.delete(plan.postures, 1, axis=0)))
    rows = [row for row in again.parameters if row.group == "offset"]
    assert rest.verdict == again.verdict == "degenerate"
    assert rest.status == {row.name: row.status for row in rows}
    assert rest.std == {row.name: row.std for row in rows}
    assert {type(row.cause) for row in rows if not row.held} == {TooFewMeasurements}


def test_the_outlook_of_a_typical_arm() -> None:
    """The curve ends at the largest u."""
    answer = check(pattern_plan("x", geometry=None))
    # Nothing but the prior is known of δ2.
    assert answer.curve[-1].worst_std == pytest.approx(5.0, rel=1e-3)
    assert answer.over_target is None
    spread = {"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 1.0}}
    good = good_plan(30)
    near = check(plan_of(header(targets=spread, geometry=None), good.postures))
    assert near.over_target is not None
    largest = max(row.std or 0.0 for row in near.parameters if row.group == "offset")
    assert near.curve[-1].worst_std == pytest.approx(largest, rel=1e-6)
    assert max(near.over_target.worst_std.values()) == pytest.approx(largest, rel=0.05)


def test_the_document_has_what_measurements_must_determine_alone() -> None:
    document = to_json(check(pattern_plan("x", geometry=None)))
    for direction in json.loads(json.dumps(document))["identifiability"]["null_space"]:
        assert all(name.startswith(("delta", "psd")) for name in direction["combination"])
