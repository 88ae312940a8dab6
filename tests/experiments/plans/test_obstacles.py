import numpy as np
import pytest
from cells import LASER, header, irb1600

from zerobeam.analysis.observability.clearance import Clearance, floor_of, meets_box, segment_distance
from zerobeam.experiments.plans.obstacles import read_obstacles
from zerobeam.model.files.plan import Box, Obstacles
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.kinematics.transforms import shift
from zerobeam.model.likelihood.problem import Problem


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
