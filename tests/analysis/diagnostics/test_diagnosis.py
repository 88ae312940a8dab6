"""What explains a misfit: known causes are named, and where there is none nothing is."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from cells import (
    LASER,
    OPEN_PROBE,
    TABLE_2,
    good_plan,
    header,
    irb1600,
    placed_plan,
    plan_of,
    random_robot,
    run_of,
    simulated,
    simulated_problem,
)
from corruptions import CORRUPTIONS, coupled, demo, leant_on, probe_run, robot_with, swapped, zero_off

import zerobeam as zb
from zerobeam.analysis.diagnostics.diagnosis import Explanation, _explanations, diagnose, undecided
from zerobeam.analysis.diagnostics.hypotheses import HypothesisFit, changes, file_variants
from zerobeam.analysis.diagnostics.suspects import Cause
from zerobeam.analysis.misfit import TightPrior
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.run import Run
from zerobeam.model.files.shot import Shot
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.kinematics.dh import along_z
from zerobeam.model.likelihood.geometry import Geometry
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.case import RunCase
from zerobeam.words.catalogue import _mend_causes
from zerobeam.words.message import message
from zerobeam.words.misfit_words import (
    alternatives,
    cause_sentence,
    criterion_sentence,
    explanation_sentence,
    mend,
)

FAST = {"starts": 0}


def of(problem: Problem) -> Solution:
    return solve(problem, **FAST)


def exact(run: Run) -> Run:
    """The run of an arm that has nominal geometry, and of a tool that is as stated."""
    return replace(run, header=run.header.model_copy(update={"geometry": "exact"}))


def spoilt(name, spoil, tmp_path) -> Solution:
    return of(Problem.from_run(exact(spoil(demo(name), tmp_path))))


@pytest.mark.parametrize("name", ["good", "uncalibrated", "x-pattern"])
@pytest.mark.one_in(3)
def test_right_data_need_no_explanation(name: str) -> None:
    assert diagnose(of(Problem.from_run(demo(name)))) == ()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.one_in(3)
def test_noise_alone_needs_no_explanation(seed: int) -> None:
    tool = LASER if seed % 2 else OPEN_PROBE
    _, problem = simulated_problem(good_plan(8, seed=seed, tool=tool), TABLE_2, seed=seed)
    assert diagnose(of(problem)) == ()


def test_noise_that_is_understated_is_named_with_its_factor() -> None:
    plan = good_plan(20, joint_deg=0.04, spot_mm=0.2, geometry="exact")
    _, problem = simulated_problem(plan, TABLE_2, seed=3)
    noise = problem.noise.times(1 / 4)
    found = diagnose(of(replace(problem, noise=noise)))[0]
    assert (found.cause, found.amount) == ("noise", pytest.approx(4, rel=0.3))
    assert found.factor < 1.5


def test_one_wrong_length_is_named_with_its_size(tmp_path) -> None:
    _, run = simulated(good_plan(20, geometry="exact"), TABLE_2)
    run = replace(run, robot=robot_with(tmp_path, 2, "a_mm", 712))
    found = diagnose(of(Problem.from_run(run)))[0]
    assert (found.cause, found.of) == ("length", "link2.a")
    assert found.amount == pytest.approx(-12, abs=0.5)


def test_the_exchange_is_said_with_what_it_leaves(tmp_path) -> None:
    (found,) = diagnose(spoilt("good", swapped(4, 6), tmp_path))
    right = of(Problem.from_run(exact(demo("good")))).against_noise
    assert found.factor == pytest.approx(np.sqrt(right.chi2 / right.dof), rel=1e-3)
    assert found.agrees
    assert found.freed == 0
    before = f"{found.before:,.0f}"
    assert found.before > 1000
    left = f"0.61 times the noise instead of {before}"
    assert explanation_sentence(found) == f"with J4 and J6 exchanged: {left}"


def test_a_zero_that_an_offset_takes_up_is_named_by_its_prior(tmp_path) -> None:
    (found,) = diagnose(spoilt("good", zero_off(2, 90), tmp_path))
    assert (found.cause, found.joints, found.amount) == ("zero", (2,), -90)
    assert found.farthest < 1 < 17 < found.farthest_before
    assert "with 90° subtracted from J2: the estimates are within" in explanation_sentence(found)
    # By no quarter turn: as far as the fit has it, for one freed parameter.
    (found,) = diagnose(spoilt("good", zero_off(3, 30), tmp_path))
    assert (found.cause, found.joints) == ("zero", (3,))
    assert found.amount == pytest.approx(-30 + TABLE_2["delta3"], abs=0.05)


def test_what_a_wrist_cannot_decide_is_all_listed(tmp_path) -> None:
    """J4 turned by half and J5 the other way round is the same pose: both are said, the one that leaves less
    first."""
    found = diagnose(spoilt("good", zero_off(4, 180), tmp_path))
    assert {(own.cause, own.joints) for own in found} == {("zero", (4,)), ("sign", (5,))}
    assert found[0].cause == "zero"


def test_both_directions_of_coupling(tmp_path) -> None:
    for times in (1.0, -1.0):
        (found,) = diagnose(spoilt("good", coupled(times), tmp_path))
        assert (found.cause, found.joints, found.amount) == ("coupling", (2, 3), -times)


def test_one_wrong_measurement_is_found_and_not_taken_for_a_moved_target(tmp_path) -> None:
    found = diagnose(spoilt("uncalibrated", leant_on(3), tmp_path))
    assert (found[0].cause, found[0].measurements, found[0].targets) == ("measurements", (3,), ("psd",))


# Seven measurements of an ordinary arm. One degree more at joint 5 of the fourth leaves residuals as small as
# the noise, and strains the harmonics beyond what is assumed of them.
SEVEN = """
-69.348,-18.862,49.270,136.545,-39.529,-82.750
70.583,-18.738,43.354,-137.022,-72.592,75.127
48.951,71.922,-72.708,44.776,95.417,-51.190
48.228,-33.230,40.231,47.941,-66.007,-65.266
-17.603,77.423,-75.731,-39.334,80.942,49.244
-40.469,64.940,-117.719,114.765,69.238,-22.223
-8.226,51.019,24.533,-17.649,61.184,134.831
"""


def seven(**tool: Any) -> Run:
    own = header({**LASER, **tool}, target=None, geometry=None)
    rows = [tuple(map(float, line.split(","))) for line in SEVEN.split()]
    return run_of(own, [Shot(shot=i, target="psd", joints_deg=row) for i, row in enumerate(rows)])


def test_a_measurement_that_strains_a_tolerance_is_a_cause_and_comes_first() -> None:
    """What the measurements do not decide is no reason to loosen what is assumed of the arm."""
    result = zb.analyse(seven(), ess=100).result
    assert result.misfit is not None
    (tight,) = result.misfit.criteria
    assert isinstance(tight, TightPrior)
    assert tight.assumed
    assert criterion_sentence(tight).startswith("The assumed tolerance of the first harmonics is too small")
    first, *others = alternatives(result.diagnosis)
    assert (first.cause, first.measurements) == ("measurements", (3,))
    assert others[-1].cause == "harmonics"
    assert "state" not in mend(first)
    action = message(result).action
    assert action.text.startswith("Enter nothing. If it is single measurements: Compare measurement 3")
    assert "geometry" not in action.text
    assert action.command == "zerobeam analyse run.jsonl --drop 3"


@pytest.mark.parametrize("direction", [[0, 0, 1], [0, 1, 0], [0.6, 0.0, 0.8]])
@pytest.mark.one_in(3)
def test_a_beam_along_another_axis_is_named(direction: list[float]) -> None:
    true = [0.8, 0.0, 0.6] if 0.6 in direction else [1, 0, 0]
    run = simulated(good_plan(8, tool={**LASER, "direction": true}, geometry=None), TABLE_2, 3)[1]
    own = run.header.model_copy(update={"tool": header({**LASER, "direction": direction}).tool})
    with one_blas_thread():
        found = diagnose(of(Problem.from_run(replace(run, header=own))))
    (tool,) = (one for one in found if one.cause == "tool")
    assert tool.agrees
    assert tool.of == str(true).replace("0.0", "0")
    assert f"the beam along {tool.of} of the flange" in explanation_sentence(tool)
    assert f"correct tool.direction to {tool.of} if it is so" in mend(tool)


def test_what_leaves_a_misfit_is_not_the_likeliest_and_no_tolerance_is_to_be_stated_for_it() -> None:
    far = replace(_explained("geometry", 1.0, amount=10.0, factor=11.1, before=93.3), agrees=False)
    assert cause_sentence((far,)).startswith("Closest: link geometry. With the links 10.0 times the ")
    assert _mend_causes((far,), cast(RunCase, None)).startswith("Check joint columns")


@pytest.mark.long
def test_a_placement_of_two_targets_is_left_out_as_one(tmp_path) -> None:
    corruption = next(each for each in CORRUPTIONS if each.cause == "placement")
    found = diagnose(of(Problem.from_run(exact(corruption.spoilt(tmp_path)))))
    assert corruption.named_by(found[0])
    assert diagnose(of(Problem.from_run(exact(probe_run())))) == ()


@pytest.mark.parametrize("scale", ["estimated", "separate"])
@pytest.mark.long
def test_an_estimated_noise_does_not_hide_the_exchange(scale: str, tmp_path) -> None:
    """The factor is of the stated noise whatever the header does with its scale."""
    _, run = simulated(good_plan(12, noise={"scale": scale}, geometry="exact"), TABLE_2)
    assert diagnose(of(Problem.from_run(run))) == ()
    found = diagnose(of(Problem.from_run(swapped(2, 3)(run, tmp_path))))
    assert (found[0].cause, found[0].joints) == ("swapped_joints", (2, 3))
    assert found[0].factor < 2
    assert found[0].before > 100


@pytest.mark.long
def test_of_many_measurements_a_part_is_tried_first(tmp_path) -> None:
    _, run = simulated(good_plan(170, geometry="exact"), TABLE_2)
    (found,) = diagnose(of(Problem.from_run(swapped(3, 5)(run, tmp_path))))
    assert (found.cause, found.joints) == ("swapped_joints", (3, 5))
    right = of(Problem.from_run(run)).against_noise
    assert found.factor == pytest.approx(np.sqrt(right.chi2 / right.dof), rel=1e-2)
    found = diagnose(of(Problem.from_run(leant_on(40)(run, tmp_path))))[0]
    assert (found.cause, found.measurements) == ("measurements", (40,))


@pytest.mark.long
def test_two_things_at_once_are_said_to_be_more_than_one(tmp_path) -> None:
    """With an exchange in an arm that is not as drawn, to undo it leaves far less, yet more than noise."""
    _, run = simulated(good_plan(12, geometry="exact"), TABLE_2)
    run = replace(swapped(4, 6)(run, tmp_path), robot=robot_with(tmp_path, 2, "a_mm", 706))
    found = diagnose(of(Problem.from_run(run)))
    assert (found[0].cause, found[0].joints, found[0].agrees) == ("swapped_joints", (4, 6), False)
    assert 1 < found[0].factor < found[0].before / 20


def test_a_robot_with_its_axes_along_z_is_the_robot() -> None:
    for robot in (irb1600(), random_robot("rrrprr", 2)):
        q = np.random.default_rng(0).uniform(-1, 1, (5, robot.n))
        np.testing.assert_allclose(along_z(robot).fk(q, "rad"), robot.fk(q, "rad"), atol=1e-9)


def test_a_reversed_twist_is_the_robot_file_with_the_other_sign(tmp_path) -> None:
    q = np.random.default_rng(1).uniform(-1, 1, (5, 6))
    twists = {one.joints: one.robot for one in file_variants(irb1600()) if one.cause == "twist"}
    assert set(twists) == {(1, 2), (3, 4), (4, 5), (5, 6)}
    for row, alpha in ((1, 90), (3, -90), (4, 90), (5, -90)):
        other = robot_with(tmp_path, row, "alpha_deg", alpha)
        np.testing.assert_allclose(twists[row, row + 1].fk(q, "rad"), other.fk(q, "rad"), atol=1e-9)


def test_units_are_tried_only_where_angles_can_be_in_them() -> None:
    problem = Problem.from_run(demo("good"))
    x = np.zeros(len(problem.parameters))

    def units(joints: Matrix) -> list[float]:
        return [each.amount for each in changes(problem.moved(joints), x) if each.cause == "units"]

    assert units(problem.joints) == []
    assert units(np.radians(problem.joints)) == [pytest.approx(57.29578)]
    assert units(np.degrees(problem.joints)) == [pytest.approx(1 / 57.29578)]


def test_columns_of_different_units_are_not_exchanged() -> None:
    robot = random_robot("rrprr", 0)
    plan = good_plan(4)
    problem = replace(Problem.from_plan(plan), robot=robot, joints=np.zeros((4, 5)))
    tried = [
        each.joints
        for each in changes(problem, problem.parameters.prior_mean)
        if each.cause == "swapped_joints"
    ]
    assert all(3 not in joints for joints in tried)
    assert len(tried) == 6


@pytest.mark.parametrize(("cost", "causes"), [(45.0, ["geometry"]), (30.0, ["measurements"])])
def test_what_blames_the_data_has_to_be_clearly_likelier_than_links(cost: float, causes: list[str]) -> None:
    """The second is 10 in log evidence above links, beyond log 1000; the first is 2.5 above."""
    base = HypothesisFit(None, 500.0, 500.0, 50, 50, 1.0)
    links = HypothesisFit("geometry", 50.0, 50.0, 50, 50, 1.0, freed=10)
    outlying = HypothesisFit("measurements", cost, cost, 50, 50, 1.0, freed=2)
    assert [found.cause for found in _explanations(base, [links, outlying], 1.0, exact=True)] == causes
    (found, *_) = _explanations(base, [links, outlying], 1.0, exact=False)
    assert found.cause == "measurements"


@pytest.mark.parametrize(
    ("cause", "stated", "words"),
    [
        ("units", {"amount": 57.3}, "with the joint angles read as radians"),
        (
            "twist",
            {"joints": (6,)},
            "with the sign of the twist from J6 to the flange reversed in the robot file",
        ),
        ("measurements", {"measurements": (3, 5)}, "without measurements 3 and 5"),
        ("geometry", {}, "with link geometry estimated"),
    ],
)
def test_sentences(cause, stated, words) -> None:
    own = {"joints": (), "targets": (), "measurements": (), "amount": 0.0, "factor": 1.1, "before": 1333.2}
    fitted = {"farthest": 1, "farthest_before": 2, "freed": 0, "p_value": 0, "agrees": True}
    found = Explanation(cause=cause, **(own | fitted | stated))
    assert explanation_sentence(found) == f"{words}: 1.1 times the noise instead of 1,333"


def of_another_arm(seed: int, factor: float = 1.0) -> Solution:
    """The probe on an arm with links drawn from `factor` times the typical tolerances, solved as nominal."""
    run = exact(probe_run())
    geometry, rng = Geometry.of_links(run.robot, 0.3, 0.1), np.random.default_rng(seed)
    values = rng.normal(size=len(geometry.names)) * [geometry.prior_std(*own) for own in geometry.names]
    postures = np.radians([shot.joints_deg for shot in run.shots])
    arm = geometry.applied(run.robot, factor * values)
    plan = plan_of(run.header, postures, [shot.target for shot in run.shots], arm)
    return of(Problem.from_run(replace(simulated(plan, TABLE_2, seed)[1], robot=run.robot)))


@pytest.mark.parametrize("seed", [2, 3, 4])
@pytest.mark.one_in(3)
def test_links_within_tolerance_are_named_and_nothing_else(seed: int) -> None:
    solution = of_another_arm(seed)
    assert solution.verdict == "misfit"
    (found,) = diagnose(solution)
    assert (found.cause, found.agrees) == ("geometry", True)
    assert found.factor < 1.3
    assert 5 < found.freed < 15
    assert "with link geometry estimated" in explanation_sentence(found)


@pytest.mark.long
def test_links_far_beyond_tolerance_are_no_explanation() -> None:
    assert "geometry" not in {own.cause for own in diagnose(of_another_arm(4, 30.0)) if own.agrees}


def test_what_leaves_no_number_over_is_no_explanation() -> None:
    """Four measurements at each of two placements: without one the rest can be met, whatever is wrong."""
    places = {"left": (800.0, 300.0, 100.0), "right": (850.0, -350.0, 200.0)}
    plan = placed_plan(places, {"left": 4, "right": 4}, geometry="exact")
    _, problem = simulated_problem(plan, TABLE_2, seed=1)
    joints = problem.joints.copy()
    joints[2] += np.radians([0.0, 3.0, -2.0, 4.0, 1.0, 0.0])
    solution = of(problem.moved(joints, problem.spots))
    assert solution.verdict == "misfit"
    named = {each.cause for each in diagnose(solution)}
    assert not {"placement", "moved_target"} & named


def _explained(cause: Cause, odds: float, **more: Any) -> Explanation:
    numbers: dict[str, Any] = {"joints": (3,), "targets": (), "measurements": (3, 4), "amount": 0.1}
    numbers |= {"factor": 1.0, "before": 3.0, "farthest": 1.0, "farthest_before": 1.0}
    return Explanation(cause, **numbers | more, freed=1.0, p_value=1e-6, agrees=True, odds=odds)


def test_a_cause_is_named_only_where_it_is_twenty_times_as_likely_as_the_next() -> None:
    best = _explained("jump", 1.0)
    near, far = _explained("drift", 0.9, measurements=()), _explained("drift", 0.04, measurements=())
    assert undecided((best, near)) == (best, near)
    assert undecided((best, far)) == undecided((best,)) == undecided(()) == ()
    asked = cause_sentence((best, near, far))
    assert "Most likely" not in asked
    assert asked.startswith("The measurements do not decide what is wrong: ")
    assert "(evidence 1 : 1.1)" in asked
    assert cause_sentence((best, far)).startswith("Most likely: zero of a joint that jumped.")


def test_exact_geometry_is_named_first() -> None:
    links = _explained("geometry", 0.5, amount=1.0)
    assert undecided((links, _explained("jump", 1.0))) == ()
    assert "geometry: exact" in cause_sentence((links, _explained("jump", 1.0)))
    base = HypothesisFit(None, 500.0, 500.0, 50, 50, 1.0)
    fits = [
        HypothesisFit("length", 48.0, 48.0, 50, 50, 1.0, freed=2),
        HypothesisFit("geometry", 50.0, 50.0, 50, 50, 1.0, freed=10),
    ]
    assert [one.cause for one in _explanations(base, fits, 1.0, exact=True)] == ["geometry", "length"]
    assert [one.cause for one in _explanations(base, fits, 1.0, exact=False)] == ["length", "geometry"]
