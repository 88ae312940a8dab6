import functools

import numpy as np
import pytest
from cells import LASER, PROBE, header, irb1600

from zerobeam.analysis.observability.aim import one_turn
from zerobeam.analysis.observability.clearance import Clearance
from zerobeam.experiments.plans import candidates as module
from zerobeam.experiments.plans.candidates import View, candidates
from zerobeam.model.files.plan import Box, Obstacles
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.likelihood.problem import Problem

TARGET = np.array([900.0, 100.0, 50.0])
PROBED = np.array([900.0, 100.0, 500.0])
OUT_OF_REACH = np.array([9000.0, 0.0, 0.0])
TABLE = Box(name="table", min_mm=(600, -400, 0), max_mm=(1300, 500, 60))
LID = Box(name="lid", min_mm=(500, -500, 70), max_mm=(1400, 700, 90))
PILLAR = Box(name="pillar", min_mm=(500, 300, 0), max_mm=(600, 400, 1500))


@pytest.fixture(autouse=True)
def small_batches(monkeypatch):
    """As many as the tests need, not as a plan does."""
    monkeypatch.setattr(module, "_BATCH", 3000)
    monkeypatch.setattr(module, "_LEAST_DRAWN", 6000)


@functools.cache
def found(tool="laser", count=300, seed=3, cell=True):
    own = header(LASER if tool == "laser" else PROBE, target=tuple(TARGET))
    obstacles = Obstacles(boxes=[TABLE, PILLAR]) if cell else None
    return candidates(
        own, irb1600(), TARGET if tool == "laser" else PROBED, count, obstacles=obstacles, seed=seed
    )


def beams_of(postures, tool=LASER, target=TARGET):
    problem = Problem.build(header(tool), irb1600(), postures, ["psd"] * len(postures))
    x = problem.parameters.prior_mean.copy()
    x[problem.parameters.group("target")] = target
    return problem, x, *problem.beams(x)


def added_up(own):
    return sum(own.removed.values()) + len(own.postures) == own.drawn


def test_as_many_as_asked_for_and_all_are_different():
    assert found().postures.shape == (300, 6)
    assert len(np.unique(found().postures.round(6), axis=0)) == 300
    # Spread over the joints, not a handful of places.
    assert (np.degrees(np.ptp(found().postures, axis=0)) > 60).all()


@pytest.mark.parametrize("tool", ["laser", "probe"])
def test_limits_are_kept_with_the_margin(tool):
    robot, margin = irb1600(), np.radians(5)
    assert (found(tool).postures >= robot.lower + margin).all()
    assert (found(tool).postures <= robot.upper - margin).all()


def test_every_beam_hits_the_face_from_the_front_within_the_stated_angle_and_length():
    problem, x, origin, direction = beams_of(found().postures)
    miss, _ = problem.linearise(x)
    assert np.linalg.norm(miss, axis=1).max() < 1e-6
    length = ((TARGET - origin) * direction).sum(axis=1)
    assert length.min() >= 200
    assert length.max() <= 2000
    np.testing.assert_allclose(origin + length[:, None] * direction, TARGET[None].repeat(300, 0), atol=1e-6)
    steepness = np.degrees(np.arccos(-direction[:, 2]))
    assert steepness.max() <= 60


def test_every_tip_is_at_the_target():
    _, _, origin, _ = beams_of(found("probe").postures, PROBE, PROBED)
    np.testing.assert_allclose(origin, np.tile(PROBED, (300, 1)), atol=1e-6)


def test_nothing_is_hit():
    problem, _, origin, _ = beams_of(found().postures)
    clearance = Clearance(problem, Obstacles(boxes=[TABLE, PILLAR]))
    assert not clearance.hits_itself(found().postures).any()
    assert not clearance.hits_cell(found().postures).any()
    assert not clearance.beam_blocked(origin, TARGET).any()
    # Negative control: in an empty cell some that are drawn would hit.
    free = found(cell=False).postures
    _, _, origin, _ = beams_of(free)
    assert clearance.hits_cell(free).any()


def test_another_view_is_kept_too():
    view = View(facing=(-2.0, 0, 2.0), acceptance=np.radians(25), beam=(500.0, 900.0), margin=np.radians(15))
    own = candidates(header(target=tuple(TARGET)), irb1600(), TARGET, 10, view=view)
    assert len(own.postures) == 10
    _, _, origin, direction = beams_of(own.postures)
    length = np.linalg.norm(TARGET - origin, axis=1)
    assert length.min() >= 500
    assert length.max() <= 900
    assert (-(direction @ [-1, 0, 1]) / np.sqrt(2)).min() >= np.cos(np.radians(25))
    assert (own.postures <= irb1600().upper - np.radians(15)).all()


def test_any_side_will_do_where_none_is_stated():
    own = candidates(header(target=tuple(TARGET)), irb1600(), TARGET, 300, view=View(facing=None))
    _, _, _, direction = beams_of(own.postures)
    assert (direction[:, 2] > 0).any()
    assert not any("face" in reason for reason, count in own.removed.items() if count)


@pytest.mark.parametrize("tool", ["laser", "probe"])
def test_the_counts_add_up(tool):
    own = found(tool)
    assert added_up(own)
    assert f"300 of {own.drawn} postures are left" in own.in_words()
    assert min(own.removed.values()) >= 0


@pytest.mark.parametrize(
    ("tool", "place", "changes", "boxes", "reason"),
    [
        (PROBE, OUT_OF_REACH, {}, [], "out of reach"),
        # Facing down, with the floor right under it: nobody gets there.
        (LASER, TARGET, {"facing": (0, 0, -1.0), "acceptance": np.radians(10)}, [], "from behind"),
        (LASER, TARGET, {"beam": (5000.0, 6000.0)}, [], "too short or too long"),
        (LASER, OUT_OF_REACH, {}, [], "too short or too long"),
        (LASER, TARGET, {}, [LID], "have a box in the beam's way"),
    ],
)
@pytest.mark.at_length(r"^tool0")
def test_where_nothing_is_left_it_says_what_took_how_many(tool, place, changes, boxes, reason):
    obstacles = Obstacles(floor_mm=None if boxes else 0.0, boxes=boxes)
    own = candidates(header(tool), irb1600(), place, 20, view=View(**changes), obstacles=obstacles, seed=1)
    assert len(own.postures) == 0
    assert own.postures.shape == (0, 6)
    assert added_up(own)
    assert f"0 of {own.drawn} postures are left" in own.in_words()
    (count,) = (count for key, count in own.removed.items() if reason in key)
    assert count > 30
    assert f"{count} " in own.in_words()


def test_progress_is_told():
    seen = []
    candidates(header(target=tuple(TARGET)), irb1600(), TARGET, 50, progress=seen.append)
    assert seen[-1] == 1.0


def test_contradictory_limits_name_the_joint(refused):
    error = refused(candidates, header(), irb1600(), TARGET, 5, view=View(margin=np.radians(106)))
    # Joint 2 has the smallest range: -90 to 120 degrees.
    assert "joint 2" in str(error)
    assert "-90.0 to 120.0 deg" in str(error)
    assert "106.0 deg" in str(error)


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        ({"beam": (900.0, 300.0)}, "900 to 300 mm"),
        ({"facing": (0.0, 0.0, 0.0)}, "no direction"),
        ({"acceptance": np.radians(120)}, "120 deg"),
        ({"acceptance": 0.0}, "acceptance"),
        ({"margin": -0.1}, "negative"),
    ],
)
def test_a_view_that_contradicts_itself(refused, changes, part):
    assert part in str(refused(candidates, header(), irb1600(), TARGET, 5, view=View(**changes)))
    assert "no candidates" in str(refused(candidates, header(), irb1600(), TARGET, 0))


def test_one_turn_nearest_to_zero_is_drawn_from():
    lower, upper = np.radians([-395.0, -90, 200, -700]), np.radians([395.0, 120, 300, -100])
    robot = irb1600()
    four = type(robot)("four", robot.joints[:4], robot.flange)
    low, high = one_turn(four, lower, upper)
    np.testing.assert_allclose(np.degrees(low), [-180, -90, 200, -460])
    np.testing.assert_allclose(np.degrees(high), [180, 120, 300, -100])


def test_what_one_condition_alone_removes_is_said_the_decisive_one_first():
    """A ceiling so low that every posture hits it: that is said first, not the limits of the joints, which
    come first where one condition is judged after the other."""
    lid = Box(name="ceiling", min_mm=(-3000, -3000, 300), max_mm=(3000, 3000, 3000))
    own = candidates(header(), irb1600(), TARGET, 20, obstacles=Obstacles(boxes=[lid]), seed=1)
    assert len(own.postures) == 0
    alone = own.alone
    assert alone.removes["make the arm hit the floor or a box"] == alone.aimed
    # Without that condition some postures would be left, without any other none.
    assert [reason for reason, left in alone.without.items() if left] == [
        "make the arm hit the floor or a box"
    ]
    said = own.reasons()
    assert said.startswith(own.in_words())
    one_by_one = said[len(own.in_words()) :]
    assert one_by_one.index("hit the floor or a box") < one_by_one.index("joint limit")
    assert (
        f"{alone.without['make the arm hit the floor or a box']} would be left without this condition"
        in one_by_one
    )
    free = candidates(header(), irb1600(), TARGET, 20, obstacles=Obstacles(), seed=1)
    assert free.alone is None


def test_both_ranges_of_a_coupled_joint_are_kept_with_the_margin():
    robot = load_robot("lrmate_200id")
    own = candidates(header(LASER, robot="lrmate_200id"), robot, np.array([450.0, 0, -200]), 40, seed=1)
    degrees = np.degrees(own.postures)
    for values, low, high in (
        (degrees[:, 2], -70, 205),
        (degrees[:, 2] - degrees[:, 1], -140, 280),
        (degrees[:, 1], -100, 145),
    ):
        assert values.min() >= low + 5 - 1e-9
        assert values.max() <= high - 5 + 1e-9
