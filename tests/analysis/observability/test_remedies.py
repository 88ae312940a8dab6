"""Remedies that are tried before they are said: carried out, in a plan and in simulation, each gives the
standard uncertainty that was promised. And the reasons beside them."""

from dataclasses import replace

import numpy as np
import pytest
from cells import (
    AXIS_LASER,
    LASER,
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
from messages_so_far import message_so_far

from zerobeam.analysis.observability.causes import (
    CommonMotion,
    Equivalent,
    NullDirection,
    OnAxis,
    ParallelAxes,
    ToolRotation,
    Tried,
    worst_direction,
)
from zerobeam.analysis.observability.check import Check, carried_out, check
from zerobeam.analysis.observability.identifiability import mechanisms
from zerobeam.analysis.observability.remedies import carried_out as changed_shots
from zerobeam.analysis.solution import Solution, solve
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.model.files.plan import Plan, StatedConstraints
from zerobeam.model.files.run import Run
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.message import message
from zerobeam.words.observability import direction_remedy, outlook_lines, reason
from zerobeam.words.sentences import to_json

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


@pytest.mark.one_in(2)
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
            assert now.status in ("weak", "unidentifiable", "assumed")
            assert then.std == pytest.approx(row.after, rel=WITHIN)
            assert row.before is None or row.after <= 0.8 * row.before
            if then.status != "assumed":
                assert (then.status == "identified") == (row.after <= row.tolerance)


@pytest.mark.at_length(LONG.replace("x$|", ""))
@pytest.mark.parametrize("case", PLANS)
def test_a_run_with_its_remedy_gives_what_was_promised(case: str) -> None:
    """Measured again with all postures changed, or with one more measurement; by the run's own estimate."""
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


def test_a_wrong_promise_is_noticed() -> None:
    """Negative control: what one change gives another does not."""
    plan = nearly_x(10.0)
    before = check(plan)
    tried = tried_of(before.identifiability.null_space)[0]
    less = replace(tried, amount=tried.amount / 2)
    after = check(changed_plan(plan, before, less))
    row = tried.predicted[0]
    assert after.parameters.named(row.name).std != pytest.approx(row.after, rel=WITHIN)


def null_space_of(answer: Check | Solution) -> tuple[NullDirection, ...]:
    return answer.identifiability.null_space if isinstance(answer, Check) else answer.null_space


def texts(answer: Check | Solution) -> str:
    """All that is said of why and what to do."""
    null_space = null_space_of(answer)
    if isinstance(answer, Check):
        said = message(answer)
    else:
        said = message_so_far(answer, "run.jsonl", header(geometry=None))
    lines = [said.cause or "", said.action.text]
    lines += [text for each in null_space for text in (reason(each.cause), direction_remedy(each))]
    if isinstance(answer, Check):
        lines += outlook_lines(answer)
    return "\n".join(lines)


@pytest.mark.at_length(LONG.replace("x$|", ""))
@pytest.mark.parametrize("case", PLANS)
def test_no_reason_is_missing_or_untrue(case: str) -> None:
    plan = PLANS[case]()
    for answer in (check(plan), solve(Problem.from_run(simulated(plan, TABLE_2, seed=5)[1]))):
        said = texts(answer)
        assert "no known mechanism" not in said
        assert "axes of joints 2 and 3" not in said  # they are parallel in every posture
        assert "up to" not in said.split("A run of this plan")[0]
        # What nothing is known of has no number now: 5° is its prior.
        lost = [row.name for row in answer.parameters if row.status == "unidentifiable"]
        assert "5.0° →" not in said
        assert "10000 mm →" not in said
        assert "from 5.0°" not in said
        for tried in tried_of(null_space_of(answer)):
            assert all(row.before is None for row in tried.predicted if row.name in lost)
            assert all(row.before is not None for row in tried.predicted if row.name not in lost)


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("range_deg", "start", "so"),
    [
        (0.0, "joint 1 does not change", "an offset of joint 2 is equivalent"),
        (0.1, "joint 1 varies by only 0.10°", "within the noise an offset of joint 2 is equivalent"),
        (0.5, "joint 1 varies by only 0.50°", "within the noise an offset of joint 2 is equivalent"),
        (1.0, "joint 1 varies by only 1.0°", "an offset of joint 2 is nearly equivalent"),
        (2.0, "joint 1 varies by only 2.0°", "an offset of joint 2 is nearly equivalent"),
    ],
)
def test_how_equivalent_an_offset_of_joint_2_is(range_deg: float, start: str, so: str) -> None:
    """Within the noise where the offset is unidentifiable, nearly where it is weak."""
    answer = check(nearly_x(range_deg))
    cause = worst_direction(answer.identifiability.null_space, "delta2").cause
    assert isinstance(cause, CommonMotion)
    assert reason(cause).startswith(f"{start} over the measurements, so {so} to a rotation of everything")
    lost = answer.parameters.named("delta2").status == "unidentifiable"
    assert cause.hidden == lost == (range_deg <= 0.5)


@pytest.mark.parametrize("range_deg", [5.0, 10.0, 30.0])
def test_offsets_that_together_act_as_a_displacement_of_the_target(range_deg: float) -> None:
    null_space = check(nearly_x(range_deg)).identifiability.null_space
    direction = worst_direction(null_space, "delta2")
    assert isinstance(direction.cause, Equivalent)
    assert {2, 3} <= set(direction.cause.joints)
    assert direction.cause.shifted == ("target",)
    assert ("joint 1 varies by only" in reason(direction.cause)) == (range_deg <= 10)
    assert direction.tried is not None
    assert (direction.tried.joint, direction.tried.how) in [(1, "vary"), (2, "add"), (2, "replace")]
    assert direction.tried.predicted[0].after < 0.25


def test_each_joint_has_its_own_range() -> None:
    answer = check(nearly_x(0.03))
    said = texts(answer)
    assert "although joint 2 varies by 65° (joint 1 varies by only 0.030°)" in said


def test_axes_are_a_reason_only_where_postures_make_them_parallel() -> None:
    """Those of joints 2 and 3 are so in every posture, those of 4 and 6 with joint 5 at 0."""

    def parallel(plan: Plan) -> set[tuple[int, int]]:
        causes = [each.cause for each in mechanisms(Problem.from_plan(plan))]
        return {(cause.first, cause.second) for cause in causes if isinstance(cause, ParallelAxes)}

    plan = good_plan(12)
    assert parallel(plan) == set()
    stretched = plan.postures.copy()
    stretched[:, 4] = 0.0
    assert parallel(plan_of(plan.header, stretched)) == {(4, 6)}


def test_what_does_not_help_is_not_said() -> None:
    """A beam on the last axis: no posture tells its rotation."""
    answer = check(good_plan(12, 5, AXIS_LASER))
    direction = worst_direction(answer.identifiability.null_space, "delta6")
    assert isinstance(direction.cause, OnAxis)
    assert direction.tried is None
    assert "predicted" not in direction_remedy(direction)
    # Negative control: a joint that may be moved.
    assert "predicted" in texts(check(pattern_plan("x")))


@pytest.mark.long
def test_a_remedy_keeps_to_the_constraints_of_its_plan() -> None:
    plan = nearly_x(10.0)
    free = tried_of(check_plan(plan).identifiability.null_space)[0]
    assert (free.how, free.joint) == ("vary", 1)
    narrow = {"facing": [0, 0, 1], "acceptance_deg": 45.0}
    bound = replace(plan, constraints=StatedConstraints.model_validate(narrow))
    answer = check_plan(bound)

    def broken(tried: Tried) -> set[int]:
        """Which of the new postures break the constraints."""
        changed = replace(changed_plan(plan, answer, tried), constraints=bound.constraints)
        new = {len(plan.postures)} if tried.how == "add" else set(tried.postures)
        return new & {each.posture for each in check_plan(changed).violations}

    remedies = tried_of(answer.identifiability.null_space)
    assert remedies
    assert not any(map(broken, remedies))
    assert broken(free)


def test_a_closer_tool_gives_what_was_promised() -> None:
    def answer(tilt_deg: float) -> Check:
        tool = {**LASER, "sigma": {"shift_mm": tilt_deg, "tilt_deg": tilt_deg}}
        return check(good_plan(12, 5, tool, geometry=None))

    before = answer(1.0)
    direction = worst_direction(before.identifiability.null_space, "delta6")
    assert isinstance(direction.cause, ToolRotation)
    tried = direction.tried
    assert tried is not None
    assert tried.how == "tolerances"
    (row,) = tried.predicted
    after = answer(1.0 / tried.amount)
    assert after.parameters.named("delta6").std == pytest.approx(row.after, rel=0.02)
    to = f"calibrate the tool to {1.0 / tried.amount:g}° and state that (tool.sigma)"
    assert direction_remedy(direction).startswith(to)


def test_a_target_seen_once_gets_what_was_promised() -> None:
    own = header(targets={name: {"guess_mm": [900, 0, 0]} for name in "ab"})
    plan = plan_of(own, good_plan(10).postures, ["a"] * 9 + ["b"])
    before = check(plan)
    (tried,) = tried_of(before.identifiability.null_space)
    assert (tried.how, tried.postures) == ("add", (9,))
    after = check(changed_plan(plan, before, tried))
    for row in tried.predicted:
        assert row.before is None
        assert after.parameters.named(row.name).std == pytest.approx(row.after, rel=0.01)
        assert row.after > 0.01  # mm


def test_the_numbers_are_in_the_documents() -> None:
    plan = nearly_x(10.0)
    answer = check(plan)
    tried = worst_direction(answer.identifiability.null_space, "delta2").tried
    assert tried is not None
    (said,) = [
        each["tried"]
        for each in to_json(answer)["identifiability"]["null_space"]
        if each["combination"].get("delta2") == 1.0
    ]
    assert (said["how"], said["joint"], said["amount"], said["unit"]) == ("vary", 1, 90.0, "deg")
    assert said["predicted"][0]["after"] == tried.predicted[0].after


def test_without_a_poor_offset_nothing_is_tried() -> None:
    answer = check(good_plan())
    assert answer.verdict == "pass"
    assert not tried_of(answer.identifiability.null_space)
    _, run = simulated(good_plan(), TABLE_2)
    assert solve(Problem.from_run(run)).null_space == ()


def test_a_long_run_is_searched_in_bounded_time() -> None:
    """Of 240 measurements some stand for all."""
    plan = pattern_plan("x", joint_deg=0.1)
    many = plan_of(plan.header, np.tile(plan.postures, (35, 1)))
    answer = check(many)
    tried = worst_direction(answer.identifiability.null_space, "delta2").tried
    assert tried is not None
    assert tried.how == "vary"
    after = check(changed_plan(many, answer, tried))
    assert after.parameters.named("delta2").std == pytest.approx(tried.predicted[0].after, rel=WITHIN)
