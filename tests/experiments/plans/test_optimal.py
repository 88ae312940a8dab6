import functools
import math
from dataclasses import replace
from itertools import pairwise, permutations

import numpy as np
import pytest
from cells import LASER, OPEN_PROBE, PROBE, header, irb1600, plan_of

from zerobeam.analysis.observability.check import check
from zerobeam.experiments.plans import patterns
from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.plans.optimal import Planner, _length, _shortest, _two_opt, travel_order
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Obstacles, read_plan, write_plan
from zerobeam.model.kinematics.robot import Joint, Robot

TARGET = np.array([900.0, 0.0, 0.0])


@functools.cache
def some(tool="laser"):
    stated, place = (LASER, TARGET) if tool == "laser" else (PROBE, TARGET + np.array([0, 0, 500.0]))
    return candidates(
        header(stated, target=tuple(place)),
        irb1600(),
        place,
        2000 if tool == "laser" else 500,
        obstacles=Obstacles(),
        seed=1,
    )


def planner(tool=LASER, count=2000, target=TARGET, **changes):
    kind = tool["kind"]
    place = target if kind == "laser" else target + np.array([0, 0, 500.0])
    own = header(tool, target=tuple(place), **changes)
    found = some(kind)
    few = replace(found, postures=found.postures[:count])
    return Planner(own, irb1600(), {"psd": place}, [few]), own


@functools.cache
def seven():
    return planner()[0].optimal(7)


def checked_std(own, postures, names):
    parameters = {p.name: p for p in check(plan_of(own, postures)).parameters}
    return {name: parameters[name].std for name in names}


@pytest.mark.long
def test_an_offset_that_no_shot_tells_does_not_swamp_the_criterion():
    """delta6 of a free probe tip is a gauge: its prior would be nearly all of the mean variance."""
    own_planner, own = planner(OPEN_PROBE, count=500)
    proposal = own_planner.optimal(6)
    assert proposal.std["delta6"] > 4
    others = [std for name, std in proposal.std.items() if name != "delta6"]
    assert max(others) < 0.1
    # The criterion is the mean variance of the others alone.
    assert proposal.value == pytest.approx(np.mean(np.square(others)), rel=1e-6)
    assert checked_std(own, proposal.postures, ["delta6"]) == {"delta6": None}
    # No number of shots is called enough while one offset stays open.
    answer = own_planner.fewest(0.1, 8)
    assert answer.proposal is None
    assert "delta6" in answer.limit


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
@pytest.mark.at_length(r"^(?!D)")
def test_check_finds_the_predicted_std_in_the_written_plan(tmp_path, criterion):
    own_planner, own = planner(count=400)
    proposal = own_planner.optimal(7, criterion)
    file = tmp_path / "plan.yaml"
    write_plan(file, own, np.round(np.degrees(proposal.postures), 3), ["psd"] * 7)
    answer = check(read_plan(file))
    assert answer.verdict == "pass"
    checked = {p.name: p.std for p in answer.parameters if p.group == "offset" and not p.held}
    assert set(proposal.std) == set(checked) == {f"delta{i}" for i in range(2, 7)}
    for name, std in proposal.std.items():
        assert checked[name] == pytest.approx(std, rel=0.02)
    assert max(p.off_mm for p in answer.postures) < 0.1
    assert proposal.worst == max(proposal.std.values())


@pytest.mark.parametrize("tool", [{**LASER, "calibrated": False}, PROBE, {**PROBE, "calibrated": False}])
@pytest.mark.one_in(3)
def test_other_tools(tool):
    own_planner, own = planner(tool, count=500)
    proposal = own_planner.optimal(9, starts=2)
    assert proposal.postures.shape == (9, 6)
    for name, std in checked_std(own, proposal.postures, proposal.std).items():
        if std is None:  # the shots do not tell it: what is predicted is the prior
            assert proposal.std[name] > 0.9 * 5.0
        else:
            assert std == pytest.approx(proposal.std[name], rel=1e-3)
    # What the method defines is not planned for: joint 1 and, with a beam that is not known, the last.
    assert "delta1" not in proposal.std
    assert ("delta6" in proposal.std) == (tool["kind"] == "probe")


def test_seven_of_two_thousand_are_nearly_the_best_possible():
    proposal = seven()
    assert proposal.value == pytest.approx(np.mean(np.square(list(proposal.std.values()))))  # deg²
    assert proposal.bound / proposal.value == pytest.approx(proposal.efficiency)
    assert 0.9 <= proposal.efficiency <= 1
    assert proposal.candidates == 2000
    random = np.random.default_rng(0).choice(2000, 7, replace=False)
    own_planner, own = planner()
    stds = checked_std(own, own_planner._postures[random], seven().std)
    assert max(stds.values()) > 1.5 * seven().worst


def worst_of_y(monkeypatch, span):
    forward, above, _ = patterns._LINES["y"]
    monkeypatch.setitem(patterns._LINES, "y", (forward, above, span))
    own = header(target=tuple(TARGET))
    naive = patterns.pattern(own, irb1600(), TARGET, "y", 7)
    return max(checked_std(own, naive, seven().std).values())


def test_far_better_than_a_y_pattern(monkeypatch):
    """Of 10,000 candidates: 126 times smaller than our wide line gives, 354 times than one of 0.4 reach."""
    assert worst_of_y(monkeypatch, patterns._LINES["y"][2]) > 100 * seven().worst
    assert worst_of_y(monkeypatch, 0.4) > 250 * seven().worst


@pytest.mark.long
def test_the_fewest_shots_that_will_do_are_taken():
    own_planner, own = planner(count=400)
    none = own_planner.fewest(1e-4, 8)
    assert [point.shots for point in none.curve] == [8]
    assert none.proposal is None
    tolerance = 1.001 * own_planner.optimal(7).worst
    answer = own_planner.fewest(tolerance, 10)
    assert answer.limit is None
    assert len(answer.proposal.postures) == answer.curve[-1].shots <= 10
    assert answer.proposal.worst <= tolerance
    assert max(checked_std(own, answer.proposal.postures, answer.proposal.std).values()) <= 1.001 * tolerance
    assert answer.curve[-2].shots == answer.curve[-1].shots - 1
    fewer = own_planner.optimal(answer.curve[-2].shots)  # not within the tolerance, or it hides a wrong model
    assert fewer.worst > tolerance or fewer.lacking
    assert not answer.proposal.lacking


@pytest.mark.parametrize(
    ("changes", "limit"),
    [
        ({"joint_deg": 0.01, "spot_mm": 0.001}, "the joint noise"),
        ({"joint_deg": 0.001, "spot_mm": 5.0}, "the spot noise"),
        ({"held": ["delta2"]}, "the measurements carry almost no information about delta1"),
    ],
)
@pytest.mark.at_length(r"^changes[02]")
def test_what_limits(changes, limit):
    own_planner, _ = planner(count=300, **changes)
    answer = own_planner.fewest(1e-4, 6)
    assert answer.proposal is None
    assert limit in answer.limit
    if "noise" in limit:
        needed = int(answer.limit.split(" would be")[0].split()[-1])
        worst = own_planner.optimal(6).worst
        assert needed == pytest.approx(6 * (worst / 1e-4) ** 2, abs=1.5)


def test_the_shares_of_the_variance_are_what_taking_the_noise_away_shows():
    """Spot's share: by the slope of the variance of the fit over the spot's variance, weights kept."""
    own_planner, _ = planner(count=300, spot_mm=0.3)
    rows = own_planner._design(7, "A", 0, 2).rows
    name, variance, prior, spot = own_planner._parts(rows)
    problem, x = own_planner._problem.select(rows), own_planner._x
    free = problem.parameters.free
    _, own = problem.linearise(x)
    whitened = problem.whiten(x)
    root = whitened.jacobian[:, free]
    gain = np.linalg.inv(root.T @ root + np.eye(free.sum())) @ root.T
    place = [item.name for item in problem.parameters.items if not item.held].index(name)
    item = next(item for item in problem.parameters.items if item.name == name)
    by_spot = by_joints = 0.0
    for i in range(7):
        weight = gain[place, 2 * i : 2 * i + 2] @ np.linalg.inv(whitened.factor[i])
        by_spot += weight @ weight * 0.3**2
        through = weight @ own[i][:, :6]
        by_joints += through @ np.diag(problem.noise.variances[:-1]) @ through
    scale = (item.prior_std * item.display) ** 2
    assert spot * variance == pytest.approx(by_spot * scale, rel=1e-9)
    assert (1 - prior - spot) * variance == pytest.approx(by_joints * scale, rel=1e-9)
    assert 0.05 < spot < 0.95


def test_the_order_is_the_shortest_of_all():
    robot = irb1600()
    rng = np.random.default_rng(3)
    speed = np.array([joint.speed for joint in robot.joints])
    for _ in range(5):
        postures = rng.uniform(robot.lower, robot.upper, (6, 6))
        order, travel = travel_order(robot, postures)
        times = [
            sum(np.max(np.abs(postures[a] - postures[b]) / speed) for a, b in pairwise(other))
            for other in permutations(range(6))
        ]
        assert sorted(order) == list(range(6))
        assert travel == pytest.approx(min(times))
        assert max(times) > 1.3 * travel


def test_many_postures_are_never_worse_than_nearest_neighbour():
    rng = np.random.default_rng(5)
    gained = 0
    for _ in range(10):
        places = rng.uniform(size=(15, 2))
        time = np.linalg.norm(places[:, None] - places[None], axis=2)
        nearest = []
        for start in range(15):
            order = [start]
            while len(order) < 15:
                order.append(min(set(range(15)) - set(order), key=lambda k: time[order[-1], k]))
            nearest.append(_length(time, order))
        improved = _two_opt(time)
        assert sorted(improved) == list(range(15))
        assert _length(time, improved) <= min(nearest) + 1e-12
        gained += _length(time, improved) < min(nearest) - 1e-9
        # Of nine of them the exact order is no longer.
        few = time[:9, :9]
        assert _length(few, _shortest(few)) <= _length(few, _two_opt(few)) + 1e-12
    assert gained >= 3


def test_travel_is_in_seconds_at_the_slowest_joint():
    speed = np.array([joint.speed for joint in irb1600().joints])
    moves = np.abs(np.diff(seven().postures, axis=0))
    assert seven().travel_s == pytest.approx((moves / speed).max(axis=1).sum())
    assert travel_order(irb1600(), np.zeros((1, 6))) == ([0], 0.0)


def test_without_stated_speeds_there_is_no_time():
    robot = irb1600()
    joints = tuple(Joint(j.name, j.kind, j.fixed, j.axis, j.lower, j.upper) for j in robot.joints)
    slow = Robot("unknown", joints, robot.flange)
    found = replace(some(), postures=some().postures[:50], drawn=50, removed={})
    proposal = Planner(header(target=tuple(TARGET)), slow, {"psd": TARGET}, [found]).optimal(5, starts=2)
    assert proposal.travel_s is None
    assert len(proposal.postures) == 5


def test_too_few_candidates_say_what_removed_the_others(refused):
    own = header(target=tuple(TARGET))
    few = replace(
        some(), postures=some().postures[:5], drawn=100, removed={"come too near to a joint limit": 95}
    )
    error = refused(Planner(own, irb1600(), {"psd": TARGET}, [few]).optimal, 7)
    assert "fewer candidates than measurements" in str(error)
    assert "7 measurements; 5 of 100 postures are left; 95 come too near to a joint limit" in str(error)
    none = replace(some(), postures=np.empty((0, 6)), drawn=100, removed={"make the arm hit itself": 100})
    assert "100 make the arm hit itself" in str(refused(Planner, own, irb1600(), {"psd": TARGET}, [none]))


def test_questions_without_an_answer(refused):
    own_planner, own = planner(count=50)
    assert "at least one measurement" in str(refused(own_planner.optimal, 0))
    assert "tolerance" in str(refused(own_planner.fewest, 0.0, 8))
    assert "tolerance" in str(refused(own_planner.fewest, math.nan, 8))
    assert "4 measurements or more" in str(refused(own_planner.fewest, 0.01, 3))
    held = Header.model_validate(
        {**own.model_dump(exclude_unset=True), "held": [f"delta{i}" for i in range(1, 7)]}
    )
    assert "every offset is held" in str(refused(Planner, held, irb1600(), {"psd": TARGET}, [some()]))
