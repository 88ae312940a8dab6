"""`zerobeam plan` from a header to a checked file: what it writes, and what it refuses and why."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import LASER, header, irb1600
from plan_requests import plan_request

from zerobeam.analysis.observability.check import check
from zerobeam.analysis.observability.clearance import Clearance, floor_of, meets_box, segment_distance
from zerobeam.experiments.plans.make import MadePlan, make_plan, read_obstacles
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Box, Obstacles, read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Joint, Robot, shift
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.sentences import to_json

OFFSETS = [f"delta{i}" for i in range(2, 7)]
PLANAR_ROBOT = """\
schema: zerobeam/robot/1
name: gantry arm
convention: standard
joints:
  - {kind: prismatic, a_mm: 0, alpha_deg: -90, d_mm: 300, theta_deg: 0, lower_mm: -300, upper_mm: 300}
  - {a_mm: 150, alpha_deg: -90, d_mm: 400, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 500, alpha_deg: 0, d_mm: 0, theta_deg: -90, lower_deg: -90, upper_deg: 120}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 180, lower_deg: -200, upper_deg: 65}
  - {a_mm: 0, alpha_deg: -90, d_mm: 400, theta_deg: 0, lower_deg: -180, upper_deg: 180}
  - {a_mm: 0, alpha_deg: 90, d_mm: 0, theta_deg: 0, lower_deg: -115, upper_deg: 115}
  - {a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -300, upper_deg: 300}
"""


def made(file: Path, **changes: Any) -> MadePlan:
    return make_plan(plan_request(**changes), file, lambda stage, share: None)


@pytest.mark.parametrize("kind", ["x", "y", "optimal"])
@pytest.mark.one_in(3)
def test_a_plan_is_written_that_check_reads(kind: str, tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    answer = to_json(made(file, kind=kind))
    json.dumps(answer, allow_nan=False)
    plan = read_plan(file)
    again = check(plan)
    assert plan.postures.shape == (7, 6)
    assert answer["plan"] == "plan.yaml"
    assert answer["verdict"] == again.verdict == {"x": "degenerate", "y": "weak", "optimal": "pass"}[kind]
    stds = {row.name: row.std for row in again.parameters if row.name in OFFSETS}
    assert {name: answer["predicted_std"][name] for name in OFFSETS} == stds
    assert max(posture.off_mm for posture in again.postures) < 1e-3
    assert (stds["delta2"] is None) == (kind == "x")
    if kind == "optimal":
        assert 0.5 < answer["efficiency"] <= 1
        assert answer["candidates"] == 300
        assert answer["travel_s"] > 0
        assert re.match(r"300 of \d+ postures are left; ", answer["removed"])
    else:
        assert answer["efficiency"] is None
        assert answer["removed"] is None


def test_a_y_pattern_whose_line_is_stated(tmp_path: Path) -> None:
    """The best of docs/paper.md: a pass, where the usual one is weak."""
    line = {"distance_mm": 300.0, "height_mm": 700.0, "width_mm": 1600.0, "roll_deg": 0.0}
    answer = made(tmp_path / "plan.yaml", kind="y", target=(900.0, 100.0, 800.0), **line)
    assert answer.checked is not None
    assert answer.checked.verdict == "pass"
    assert max(row.std or 9 for row in answer.checked.parameters if row.name in OFFSETS) < 0.06


@pytest.mark.long
def test_without_a_file_it_is_the_same_plan(tmp_path: Path) -> None:
    written = made(tmp_path / "plan.yaml")
    plan = make_plan(plan_request(), None, lambda stage, share: None)
    assert plan.file is None
    assert plan.plan.sha256 == written.plan.sha256
    np.testing.assert_array_equal(plan.plan.postures, written.plan.postures)


def test_no_file_is_written_over(tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    file.write_text("mine")
    with pytest.raises(BadInput, match="exists"):
        made(file)
    assert file.read_text() == "mine"


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"target": (5000.0, 0.0, 0.0)}, r"found:.*\d+ "),
        ({"margin_deg": 200.0}, "margin"),
        ({"acceptance_deg": 0.0}, "argument acceptance_deg: the angle is out of range"),
        ({"beam_mm": (500.0, 400.0)}, "argument beam_mm: the lengths are out of order"),
        ({"facing": (0.0, 0.0, 0.0)}, "argument facing: this direction has no length"),
        ({"shots": 20, "candidates": 10}, r"too few postures to choose 20 measurements from"),
        ({"kind": "x", "target": (5000.0, 0.0, 0.0)}, "X-Pattern cannot be made"),
    ],
)
@pytest.mark.at_length(r"^changes6")
def test_what_cannot_be_is_refused_and_nothing_written(
    changes: dict[str, Any], expected: str, tmp_path: Path
) -> None:
    file = tmp_path / "plan.yaml"
    with pytest.raises(BadInput, match=expected):
        made(file, **changes)
    assert not file.exists()


@pytest.mark.long
def test_the_fewest_shots(tmp_path: Path) -> None:
    enough = to_json(made(tmp_path / "enough.yaml", shots=6))["predicted_std"]
    tolerance = 1.001 * max(enough[name] for name in OFFSETS)
    plan = made(tmp_path / "plan.yaml", tolerance=tolerance, max_shots=20, shots=99)
    answer = to_json(plan)
    assert answer["limit"] is None
    assert answer["shots"] == answer["curve"][-1]["shots"]
    assert max(answer["predicted_std"][name] for name in OFFSETS) <= tolerance * (1 + 1e-4)
    # One fewer is not enough: for the tolerance, or to notice wrong models.
    fewer = to_json(made(tmp_path / "fewer.yaml", tolerance=tolerance, max_shots=answer["shots"] - 1))
    assert (fewer["plan"], fewer["limit"] is None) == (None, False)


def test_a_tolerance_that_no_number_reaches(tmp_path: Path) -> None:
    file = tmp_path / "plan.yaml"
    answer = to_json(made(file, tolerance=0.001, max_shots=6))
    assert not file.exists()
    assert [answer[key] for key in ("plan", "verdict", "shots", "check")] == [None] * 4
    assert answer["predicted_std"] == {}
    assert "noise" in answer["limit"]
    assert re.search(r"some \d+ would be needed", answer["limit"])
    assert [point["shots"] for point in answer["curve"]][-1] == 6


def test_a_gauge_is_the_limit(tmp_path: Path) -> None:
    """With delta1 freed no number of shots will do."""
    own = header(LASER, target=None, held=[])
    answer = to_json(made(tmp_path / "plan.yaml", header=own, tolerance=0.02, max_shots=6))
    assert "delta1" in answer["limit"]
    assert "almost no information" in answer["limit"]


def test_a_header_with_another_target_is_refused(tmp_path: Path) -> None:
    own = header(LASER, target=None, targets={"ball": {"guess_mm": [1, 2, 3]}})
    with pytest.raises(BadInput, match="states other targets"):
        made(tmp_path / "plan.yaml", header=own)
    # Its own target may be there: what is known of it stays, the place is that of --target.
    own = header(LASER, target=None, targets={"psd": {"guess_mm": [1, 2, 3], "sigma_mm": 50}})
    made(tmp_path / "plan.yaml", header=own)
    stated = read_plan(tmp_path / "plan.yaml").header.targets["psd"]
    assert stated.guess_mm == (900.0, 0.0, 0.0)
    assert stated.sigma_mm == 50


@pytest.mark.long
def test_another_robot_and_its_path_as_seen_from_the_plan(tmp_path: Path) -> None:
    """Seven joints, the first prismatic; the robot file stands beside the header, the plan elsewhere."""
    (tmp_path / "cell").mkdir()
    (tmp_path / "plans").mkdir()
    (tmp_path / "cell" / "arm.yaml").write_text(PLANAR_ROBOT)
    own = header(LASER, target=None, noise={"joint_mm": 0.02}).model_copy(update={"robot": "arm.yaml"})
    file = tmp_path / "plans" / "plan.yaml"
    answer = to_json(made(
        file, header=own, header_folder=tmp_path / "cell", target=(500.0, 300.0, 0.0), shots=8,
        facing=None, bodies=Obstacles(floor_mm=None),
    ))  # fmt: skip
    plan = read_plan(file)
    assert plan.robot.name == "gantry arm"
    assert plan.header.robot == "../cell/arm.yaml"
    assert plan.postures.shape == (8, 7)
    assert np.ptp(plan.postures[:, 0]) > 1.0
    assert answer["units"]["delta2"] == "deg"
    assert answer["travel_s"] is None


@pytest.mark.long
def test_the_same_seed_gives_the_same_file(tmp_path: Path) -> None:
    files = [tmp_path / f"{i}.yaml" for i in range(3)]
    for file, seed in zip(files, (4, 4, 5), strict=True):
        made(file, seed=seed)
    assert files[0].read_bytes() == files[1].read_bytes()
    assert files[0].read_bytes() != files[2].read_bytes()


def test_a_bound_that_did_not_converge_is_said(tmp_path: Path) -> None:
    plan = made(tmp_path / "plan.yaml")
    said = "The bound did not converge within its number of steps"
    assert plan.proposal is not None
    for converged in (True, False):
        own = replace(plan, proposal=replace(plan.proposal, converged=converged))
        assert any(line.startswith(said) for line in own.sentences) == (not converged)
        assert to_json(own)["converged"] is converged


def _slides(robot):
    return any(joint.kind == "prismatic" for joint in robot.joints)


def clearance(obstacles=None, robot=None, **changes):
    own = header({**LASER, **changes}, noise={"joint_mm": 0.05} if robot and _slides(robot) else None)
    robot = robot or irb1600()
    problem = Problem.build(own, robot, np.zeros((1, robot.n)), ["psd"])
    return Clearance(problem, obstacles or Obstacles())


def sampled_distance(a, b, c, d, count=200):
    s = np.linspace(0, 1, count)[:, None]
    first, second = a + s * (b - a), c + s * (d - c)
    return np.linalg.norm(first[:, None] - second[None], axis=2).min()


def _points(judge: Clearance, joints):
    """(N, n + 3, 3): the skeleton and the TCP."""
    return judge._standing(joints)[:, 1:]


def test_distances_of_segments_equal_sampled_ones():
    rng = np.random.default_rng(0)
    a, b, c, d = rng.uniform(-1, 1, (4, 60, 3))
    found = segment_distance(a, b, c, d)
    for i in range(60):
        sampled = sampled_distance(a[i], b[i], c[i], d[i])
        assert found[i] <= sampled + 1e-12
        assert found[i] >= sampled - 0.02


@pytest.mark.parametrize(
    ("a", "b", "c", "d", "expected"),
    [
        ([0, 0, 0], [1, 0, 0], [0, 2, 0], [1, 2, 0], 2.0),  # parallel
        ([0, 0, 0], [1, 0, 0], [3, 0, 0], [5, 0, 0], 2.0),  # on one line
        ([0, 0, 0], [1, 0, 0], [5, 3, 0], [6, 4, 0], 5.0),  # parallel to nothing, nearest at two ends
        ([0, 0, 0], [2, 0, 0], [1, -1, 0], [1, 1, 0], 0.0),  # crossing
        ([0, 0, 0], [2, 0, 0], [1, 0, 3], [1, 0, 3], 3.0),  # a point
        ([1, 1, 1], [1, 1, 1], [1, 1, 4], [1, 1, 4], 3.0),  # two points
        ([0, 0, 0], [4, 0, 0], [6, 1, 0], [-2, 1, 0], 1.0),  # against each other
    ],
)
def test_known_distances(a, b, c, d, expected):
    found = segment_distance(*(np.array([p], dtype=float) for p in (a, b, c, d)))
    assert found[0] == pytest.approx(expected)


def test_boxes_are_met_as_sampling_says():
    rng = np.random.default_rng(1)
    box = Box(name="b", min_mm=(-30, -20, -10), max_mm=(40, 30, 20))
    a, b = rng.uniform(-100, 100, (2, 1000, 3))
    b[:100, 0] = a[:100, 0]  # along a face
    b[100:200] = a[100:200]  # points
    s = np.linspace(0, 1, 1001)[:, None, None]
    points = a + s * (b - a)
    for radius in (0.0, 15.0):
        low, high = np.array(box.min_mm) - radius, np.array(box.max_mm) + radius
        sampled = ((points >= low) & (points <= high)).all(axis=2).any(axis=0)
        found = meets_box(a, b, box, radius)
        assert not (sampled & ~found).any()
        # What sampling does not see has only a corner grazed.
        grown = ((points >= low - 0.4) & (points <= high + 0.4)).all(axis=2).any(axis=0)
        assert not (found & ~grown).any()
        assert 50 < found.sum() < 950


def test_the_links_are_as_thick_as_stated_and_the_arm_at_zero_hits_nothing():
    assert clearance(Obstacles(thickness_mm=33))._radius == 33
    judge = clearance()
    # 700 + 600 + 65 mm lie beyond the base's column.
    assert judge._radius == pytest.approx(0.05 * 1365)
    assert not judge.hits_itself(np.zeros((1, 6)))[0]
    assert not judge.hits_cell(np.zeros((1, 6)))[0]


def forearm_to_column(judge, degrees):
    """mm; with a straight wrist the tool goes on where the forearm ends."""
    points = _points(judge, np.radians([degrees]))[0]
    return sampled_distance(points[1], points[2], points[4], points[8], count=150)


def test_a_forearm_folded_onto_the_column_hits():
    """Joint 2 all the way down, the elbow shut: the forearm comes back to the base."""
    postures = [[0.0, 120, third, 0, 0, 0] for third in range(-240, 65, 4)]
    judge = clearance()
    distances = [forearm_to_column(judge, posture) for posture in postures]
    nearest, folded = min(distances), postures[int(np.argmin(distances))]
    assert nearest < 2 * judge._radius
    assert judge.hits_itself(np.radians([folded]))[0]
    # Turned by joint 1 it does too; an arm as thin as the gap does not, nor does an open elbow.
    assert judge.hits_itself(np.radians([[77, *folded[1:]]]))[0]
    assert not judge.hits_itself(np.radians([postures[int(np.argmax(distances))]]))[0]
    for share, hits in ((0.99, False), (1.01, True)):
        thin = clearance(Obstacles(thickness_mm=share * nearest / 2))
        assert thin.hits_itself(np.radians([folded]))[0] == hits


def test_hits_equal_sampled_distances_of_the_links():
    """Column, upper arm, forearm and tool by their own formula, for random postures."""
    judge = clearance(Obstacles(thickness_mm=120))
    rng = np.random.default_rng(2)
    robot = irb1600()
    joints = rng.uniform(robot.lower, robot.upper, (300, 6))
    points = _points(judge, joints)
    names = {"column": (1, 2), "upper arm": (2, 3), "forearm": (4, 5), "tool": (7, 8)}
    pairs = [("column", "forearm"), ("column", "tool"), ("upper arm", "tool")]
    hits = judge.hits_itself(joints)
    for i in range(len(joints)):
        nearest = min(
            sampled_distance(*(points[i, k] for name in pair for k in names[name]), count=80)
            for pair in pairs
        )
        if abs(nearest - 240) > 10:
            assert hits[i] == (nearest < 240)
    assert 4 < hits.sum() < 150


def test_links_built_near_each_other_do_not_count():
    """A wrist of short links is always nearer to itself than it is thick: that is no collision."""
    axes = [np.array([0.0, 0, 1]), np.array([0.0, 1, 0])]
    steps = [shift(), shift(z=300), shift(x=600), shift(x=600), shift(x=90), shift(z=90)]
    joints = tuple(
        Joint(f"j{i}", "revolute", step, axes[min(i, 1) if i != 4 else 0], -3.0, 3.0)
        for i, step in enumerate(steps)
    )
    robot = Robot("short wrist", joints, shift(x=80))
    judge = clearance(Obstacles(thickness_mm=70), robot, point_mm=[0, 0, 50])
    assert not judge.hits_itself(np.zeros((1, 6)))[0]
    # The elbow folded shut: the wrist lies on the upper arm.
    assert judge.hits_itself(np.array([[0, 0, 3.0, 0, 0, 0]]))[0]


def test_a_drawn_in_slide_is_no_gap():
    """A prismatic link of length zero does not make its neighbours strangers."""
    axis = np.array([0.0, 0, 1])
    joints = (
        Joint("turn", "revolute", shift(z=400), axis, -3.0, 3.0),
        Joint("elbow", "revolute", shift(x=500), axis, -3.0, 3.0),
        Joint("slide", "prismatic", shift(x=500), axis, 0.0, 400.0),
        Joint("last", "revolute", shift(), axis, -3.0, 3.0),
    )
    judge = clearance(Obstacles(thickness_mm=30), Robot("scara", joints, shift(x=200)), point_mm=[0, 0, 10])
    assert not judge.hits_itself(np.array([[0.0, 0, 0, 0]]))[0]
    assert not judge.hits_itself(np.array([[0.0, 0, 300, 0]]))[0]


def test_the_floor_is_hit_by_what_moves():
    judge = clearance()
    # The arm laid forward and bent down: the wrist is below the floor.
    low = np.radians([[0, 100, 0, 0, 0, 0]])
    assert _points(judge, low)[0][:, 2].min() < 0
    assert judge.hits_cell(low)[0]
    assert not clearance(Obstacles(floor_mm=None)).hits_cell(low)[0]
    assert not clearance(Obstacles(floor_mm=-5000)).hits_cell(low)[0]
    # Nearer to it than the arm is thick: the height counts, not only the sign.
    height = _points(judge, np.zeros((1, 6)))[0][2:, 2].min()
    assert not clearance(Obstacles(floor_mm=height - judge._radius - 1)).hits_cell(np.zeros((1, 6)))[0]
    assert clearance(Obstacles(floor_mm=height - judge._radius + 1)).hits_cell(np.zeros((1, 6)))[0]


def test_a_box_in_the_arms_way():
    judge = clearance()
    elbow = _points(judge, np.zeros((1, 6)))[0][3]
    inside = Box(name="pillar", min_mm=tuple(elbow - 20), max_mm=tuple(elbow + 20))
    beside = Box(name="pillar", min_mm=(-20, 300, 0), max_mm=(20, 400, 2000))
    assert clearance(Obstacles(boxes=[inside])).hits_cell(np.zeros((1, 6)))[0]
    assert not clearance(Obstacles(boxes=[beside])).hits_cell(np.zeros((1, 6)))[0]
    # Turned towards it, the arm does hit.
    assert clearance(Obstacles(boxes=[beside])).hits_cell(np.radians([[90.0, 0, 0, 0, 0, 0]]))[0]


def test_a_box_blocks_the_beam_but_not_the_one_with_the_target():
    table = Box(name="table", min_mm=(500, -500, 0), max_mm=(1500, 500, 101))
    wall = Box(name="wall", min_mm=(600, -50, 300), max_mm=(700, 50, 400))
    origins = np.array([[300.0, 0, 600], [900.0, 0, 800]])
    target = np.array([900.0, 0, 100])
    assert not clearance(Obstacles(boxes=[table])).beam_blocked(origins, target).any()
    blocked = clearance(Obstacles(boxes=[table, wall])).beam_blocked(origins, target)
    np.testing.assert_array_equal(blocked, [True, False])
    # A table that ends below the target is in nobody's way, one above it is.
    lid = Box(name="lid", min_mm=(500, -500, 200), max_mm=(1500, 500, 210))
    assert clearance(Obstacles(boxes=[lid])).beam_blocked(origins, target).all()


def test_a_file_is_read(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text(
        "floor_mm: -100\nboxes:\n  - {name: table, min_mm: [0, 0, 0], max_mm: [1, 2, 3]}\nthickness_mm: 70\n"
    )
    found = read_obstacles(file)
    assert found.floor_mm == -100
    assert found.thickness_mm == 70
    assert found.boxes[0].max_mm == (1, 2, 3)


@pytest.mark.parametrize(
    ("text", "line", "part"),
    [
        ("floor_mm: 0\nboxes:\n  - {name: a, min_mm: [0, 0, 5], max_mm: [1, 1, 1]}\n", 3, "is empty"),
        ("floor_mm: 0\n\nflor_mm: 0\n", 3, "flor_mm"),
        ("boxes: []\nthickness_mm: -3\n", 2, "thickness_mm"),
        ("boxes:\n  - name: a\n    min_mm: [0, 0]\n    max_mm: [1, 1, 1]\n", 3, "3 values"),
        ("floor_mm: .nan\n", 1, "not finite"),
    ],
)
def test_faults_in_a_file_have_a_line(tmp_path, refused, text, line, part):
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    error = refused(read_obstacles, file)
    assert error.line == line
    assert part in str(error)
    assert "cell.yaml" in str(error)


@pytest.mark.parametrize(
    ("name", "below"), [("lrmate_200id", 330), ("m10ia", 450), ("gp7", 330), ("tx2_60", 375)]
)
def test_an_arm_does_not_hit_the_floor_with_its_own_base(name, below):
    robot = load_robot(name)
    judge = clearance(robot=robot)
    up = np.zeros((1, robot.n))
    assert not judge.hits_cell(up)[0]
    assert floor_of(Obstacles(), robot) == -below
    # The control: a floor at the base frame's origin is as high as the shoulder, where the upper arm begins.
    assert clearance(Obstacles(floor_mm=0.0), robot=robot).hits_floor(up)[0]
    # Nor does it hit a pedestal or a table that it stands on.
    pedestal = Box(name="pedestal", min_mm=(-200, -200, -900), max_mm=(200, 200, 5 - below))
    assert not clearance(Obstacles(floor_mm=None, boxes=[pedestal]), robot=robot).hits_boxes(up)[0]


def test_the_upper_arm_of_an_arm_without_a_column_is_no_column():
    """Axes 1 and 2 of a TX2-60 meet at the base frame's origin: its first link is the upper arm."""
    judge = clearance(robot=load_robot("tx2_60"))
    down = np.radians([[0.0, 127, 0, 0, 0, 0]])  # the upper arm hangs down, along its own base
    reached = _points(judge, down)[0][3, 2]
    assert reached < -150
    box = Box(name="box", min_mm=(150, -50, -300), max_mm=(300, 50, -150))
    assert clearance(Obstacles(floor_mm=None, boxes=[box]), robot=load_robot("tx2_60")).hits_boxes(down)[0]


def test_an_arm_hits_its_own_base_below_the_base_frame():
    """The forearm of an LR Mate that is folded down against the column below its shoulder."""
    robot = load_robot("lrmate_200id")
    judge = clearance(robot=robot)
    rows = np.zeros((400, 6))
    grid = np.stack(np.meshgrid(np.linspace(90, 145, 20), np.linspace(-70, 205, 20)), axis=-1).reshape(-1, 2)
    rows[:, 1:3] = np.radians(grid)
    skeleton = _points(judge, rows)
    foot, top = np.array([0.0, 0.0, -330.0]), np.zeros(3)
    near = np.array([sampled_distance(foot, top, p[4], p[5], count=80) for p in skeleton])
    assert (near < judge._radius).any()
    assert judge.hits_itself(rows)[near < judge._radius].all()


@pytest.mark.parametrize("turn", [-110, -130, -150, 200, 240])
def test_an_elbow_that_folds_through_the_upper_arm_hits(turn):
    judge = clearance(robot=load_robot("m10ia"))
    rows = np.radians([[0.0, 20, turn, 0, 0, 0], [0.0, 20, -80, 0, 0, 0], [0.0, 20, 150, 0, 0, 0]])
    assert judge.hits_itself(rows).tolist() == [True, False, False]
