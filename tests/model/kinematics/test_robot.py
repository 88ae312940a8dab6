from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from plain_model import DESIGNED, by_complex_step, turn
from plain_model import arm as plain_arm
from scipy.spatial.transform import Rotation

from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import UrdfRef
from zerobeam.model.files.robot_file import load_robot, read_robot, rebased
from zerobeam.model.kinematics.dh import along_z
from zerobeam.model.kinematics.robot import axis_rotation, onto_z, rotations

HERE = Path()


def test_irb1600_is_table_1_with_the_limits_and_speeds_of_the_arm():
    robot = load_robot("irb1600", HERE)
    degrees = robot.display
    assert robot.name == "irb1600"
    assert robot.n == 6
    np.testing.assert_allclose(robot.lower * degrees, [-180, -90, -245, -200, -115, -400])
    np.testing.assert_allclose(robot.upper * degrees, [180, 120, 65, 200, 115, 400])
    speeds = [joint.speed * joint.display for joint in robot.joints]
    np.testing.assert_allclose(speeds, [150, 160, 170, 320, 400, 460])


def test_irb1600_at_zero_by_hand():
    """Upper arm straight up, forearm straight ahead: 150 + 600 out, 486.5 + 700 up, tool along x."""
    robot = load_robot("irb1600", HERE)
    at_zero = robot.fk([0] * 6, "deg")
    np.testing.assert_allclose(at_zero[:3, 3], [750, 0, 1186.5], atol=1e-9)
    np.testing.assert_allclose(at_zero[:3, 2], [1, 0, 0], atol=1e-12)
    # The flange face is 65 mm further on: 815 mm out, as in the arm's data sheet.
    np.testing.assert_allclose((at_zero @ [0, 0, 65, 1])[:3], [815, 0, 1186.5], atol=1e-9)


@pytest.mark.parametrize("q", [[0, 0, 0], [30, 20, -40], [-120, -60, 50], [180, 120, -245]])
def test_irb1600_wrist_centre_against_the_closed_form(q):
    """In the arm's plane: radius 150 + 700 sin q2 + 600 cos(q2 + q3), the rest by the same triangle."""
    robot = load_robot("irb1600", HERE)
    q1, q2, q3 = np.radians(q)
    radius = 150 + 700 * np.sin(q2) + 600 * np.cos(q2 + q3)
    height = 486.5 + 700 * np.cos(q2) - 600 * np.sin(q2 + q3)
    expected = [radius * np.cos(q1), radius * np.sin(q1), height]
    for wrist in ([0, 0, 0], [50, -70, 110]):
        np.testing.assert_allclose(robot.fk([*q, *wrist], "deg")[:3, 3], expected, atol=1e-9)


def robot_file(folder: Path, text: str, name: str = "arm.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


ROW = "{{a_mm: {a}, alpha_deg: {alpha}, d_mm: {d}, theta_deg: {theta}, lower_deg: -180, upper_deg: 180}}"


def arm(convention: str, rows: list[tuple[float, float, float, float]], rest: str = "") -> str:
    joints = "".join(f"  - {ROW.format(a=a, alpha=alpha, d=d, theta=theta)}\n" for a, alpha, d, theta in rows)
    return f"schema: zerobeam/robot/1\nname: arm\nconvention: {convention}\njoints:\n{joints}{rest}"


def test_standard_and_modified_rows_of_the_same_arm_agree(tmp_path):
    """a and alpha of a standard row are those of the next modified row; the last pair is the flange."""
    standard = [(150, -90, 486.5, 0), (700, 10, 20, -90), (30, 90, 0, 180)]
    modified = [(0, 0, 486.5, 0), (150, -90, 20, -90), (700, 10, 0, 180)]
    flange = "flange: {xyz_mm: [30, 0, 0], rpy_deg: [90, 0, 0]}\n"
    one = read_robot(robot_file(tmp_path, arm("standard", standard), "s.yaml"))
    other = read_robot(robot_file(tmp_path, arm("modified", modified, flange), "m.yaml"))
    without = read_robot(robot_file(tmp_path, arm("modified", modified), "n.yaml"))
    for q in ([0, 0, 0], [10, -50, 70], [-120, 33, 179]):
        np.testing.assert_allclose(one.fk(q, "deg"), other.fk(q, "deg"), atol=1e-9)
        assert np.abs(one.fk(q, "deg") - without.fk(q, "deg")).max() > 1
    swapped = read_robot(robot_file(tmp_path, arm("modified", standard), "w.yaml"))
    assert np.abs(one.fk([10, -50, 70], "deg") - swapped.fk([10, -50, 70], "deg")).max() > 1


def test_base_and_flange_transforms_stand_at_the_two_ends(tmp_path):
    rows = [(100.0, 0.0, 0.0, 0.0)]
    plain = read_robot(robot_file(tmp_path, arm("standard", rows), "p.yaml"))
    ends = "base: {xyz_mm: [1, 2, 3], rpy_deg: [0, 0, 90]}\nflange: {xyz_mm: [0, 0, 7]}\n"
    moved = read_robot(robot_file(tmp_path, arm("standard", rows, ends), "e.yaml"))
    base = np.array([[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]])
    flange = np.eye(4)
    flange[2, 3] = 7
    np.testing.assert_allclose(moved.fk([25], "deg"), base @ plain.fk([25], "deg") @ flange, atol=1e-12)


PRISMATIC = """
schema: zerobeam/robot/1
name: scara
convention: standard
joints:
  - {a_mm: 300, alpha_deg: 0, d_mm: 400, theta_deg: 0, lower_deg: -130, upper_deg: 130}
  - {name: lift, kind: prismatic, a_mm: 0, alpha_deg: 180, d_mm: -50, theta_deg: 30, lower_mm: -200,
     upper_mm: 10, speed_mm_s: 500}
"""


def test_a_prismatic_joint_slides_along_its_z(tmp_path):
    robot = read_robot(robot_file(tmp_path, PRISMATIC))
    lift = robot.joints[1]
    assert (lift.name, lift.kind, lift.unit) == ("lift", "prismatic", "mm")
    assert (lift.lower, lift.upper, lift.speed) == (-200, 10, 500)
    np.testing.assert_allclose(robot.display, [np.degrees(1), 1])
    np.testing.assert_allclose(robot.fk([90, -120], "deg")[:3, 3], [0, 300, 400 - 50 - 120], atol=1e-9)
    still, moved = robot.fk([90, 0], "deg"), robot.fk([90, -120], "deg")
    np.testing.assert_allclose(still[:3, :3], moved[:3, :3], atol=1e-12)
    angle = np.radians(90 + 30)
    np.testing.assert_allclose(still[:3, 0], [np.cos(angle), np.sin(angle), 0], atol=1e-12)


def test_the_file_knows_the_unit_of_each_kind_of_joint(tmp_path, refused):
    error = refused(read_robot, robot_file(tmp_path, PRISMATIC.replace("lower_mm", "lower_deg")))
    assert "lower_deg is stated for a prismatic joint" in error.what
    assert error.line == 7
    error = refused(read_robot, robot_file(tmp_path, PRISMATIC.replace("lower_deg: -130, ", "")))
    assert "no lower_deg" in error.what
    assert error.line == 6


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ("robot/1", "robot/2", "not a robot file", 2),
        ("schema: zerobeam/robot/1", "", "not a robot file", 3),
        ("standard", "classic", "convention is not one of", 4),
        ("d_mm: 400, ", "", "'d_mm' is missing", 6),
        ("d_mm: 400, ", "d_mm: 400, d: 1, ", "unknown key 'd' in item 1 of joints", 6),
        ("-130", "130", "lower_deg is not below", 6),
        ("-130", ".nan", "finite", 6),
        ("-130", "'-130'", "not a number", 6),
        ("name: lift", "name: joint1", "two joints have the same name", 7),
        ("speed_mm_s: 500", "speed_mm_s: 0", "out of range", 8),
        ("name: scara", "name: scara\nbase: {xyz_mm: [1, 2]}", "a list of 3 values", 4),
    ],
)
def test_a_robot_file_that_cannot_be_used(tmp_path, refused, old, new, what, line):
    assert old in PRISMATIC
    error = refused(read_robot, robot_file(tmp_path, PRISMATIC.replace(old, new, 1)))
    assert what in error.what
    assert error.line == line
    assert error.file == str(tmp_path / "arm.yaml")


def test_a_robot_without_joints(tmp_path, refused):
    text = "schema: zerobeam/robot/1\nname: none\nconvention: standard\njoints: []\n"
    error = refused(read_robot, robot_file(tmp_path, text))
    assert "joints is empty" in error.what
    assert error.line == 4


def test_unknown_robots_tell_which_there_are(tmp_path, refused):
    error = refused(load_robot, "irb160", tmp_path, file=Path("run.jsonl"), line=1)
    assert "irb1600" in error.allowed
    assert "did you mean 'irb1600'?" in error.remedy
    assert (error.file, error.line) == ("run.jsonl", 1)
    error = refused(load_robot, "sub/none.yaml", tmp_path, file=Path("run.jsonl"), line=1)
    assert error.found == tmp_path / "sub/none.yaml"
    assert "base: <link>" in refused(load_robot, "arm.urdf", tmp_path).remedy
    assert (
        refused(load_robot, UrdfRef(urdf="no.urdf", base="a", tip="b"), tmp_path).found
        == tmp_path / "no.urdf"
    )


def test_a_robot_named_from_another_folder(tmp_path):
    old, new = tmp_path / "a" / "b", tmp_path / "c"
    for folder in (old, new):
        folder.mkdir(parents=True)
    robot_file(old, PRISMATIC, "scara.yaml")
    moved = rebased("scara.yaml", old, new)
    assert moved == "../a/b/scara.yaml"
    assert load_robot(moved, new).name == "scara"
    assert rebased("irb1600", old, new) == "irb1600"
    assert rebased(str(old / "scara.yaml"), old, new) == str(old / "scara.yaml")
    ref = rebased(UrdfRef(urdf="x.urdf", base="a", tip="b"), old, new)
    assert ref == UrdfRef(urdf="../a/b/x.urdf", base="a", tip="b")


@pytest.fixture(params=DESIGNED)
def own(request, tmp_path):
    """An arm of the package and its flange's pose by other means."""
    return plain_arm(request.param, tmp_path)


def numbers(inputs, values, *at):
    """Values of symbolic expressions, as arrays without axes of length one."""
    function = ca.Function("values", inputs, [ca.densify(ca.SX(value)) for value in values])
    return [np.squeeze(np.array(value)) for value in function.call([ca.DM(each) for each in at])]


@pytest.mark.parametrize("axis", [[0, 0, 1.0], [0, -1.0, 0], [1 / 3, -2 / 3, 2 / 3]])
def test_a_rotation_by_cosine_and_sine(axis):
    axis, angle = np.array(axis), ca.SX.sym("angle")
    rotation = axis_rotation(axis, ca.cos(angle), ca.sin(angle))
    for value in (0.0, 0.3, -2.9):
        (result,) = numbers([angle], [rotation], value)
        np.testing.assert_allclose(result, Rotation.from_rotvec(value * axis).as_matrix(), atol=1e-15)
        np.testing.assert_allclose(result, turn(axis, value).real, atol=1e-15)


def test_what_is_recorded_of_a_turn(own):
    """Cosine and sine of a revolute joint, the position and nothing of a prismatic one; any leading axes."""
    q = np.random.default_rng(1).uniform(-2, 2, (3, 4, own.robot.n))
    recorded = own.robot.recorded_turns(q)
    assert recorded.shape == (3, 4, 2 * own.robot.n)
    for i, joint in enumerate(own.robot.joints):
        pair = (np.cos(q[..., i]), np.sin(q[..., i]))
        first, second = pair if joint.kind == "revolute" else (q[..., i], np.zeros((3, 4)))
        np.testing.assert_array_equal(recorded[..., 2 * i], first)
        np.testing.assert_array_equal(recorded[..., 2 * i + 1], second)


def test_an_arm_with_offsets_is_the_arm_at_the_sum(own):
    rng = np.random.default_rng(6)
    q, delta = own.random(rng), rng.uniform(-0.5, 0.5, own.robot.n) * np.where(own.robot.display == 1, 100, 1)
    moved = own.robot.with_offsets(delta)
    np.testing.assert_allclose(moved.fk(q, "rad"), own.pose(q + delta).real, rtol=0, atol=1e-9)
    assert moved.vendor == own.robot.vendor


def test_turns_with_offsets_are_the_turns_of_the_sum(own):
    """The sum of two angles, against the turn of the summed angle: rounding alone."""
    robot, n = own.robot, own.robot.n
    rng = np.random.default_rng(2)
    q, delta = own.random(rng), rng.uniform(-0.5, 0.5, n) * np.where(robot.display == 1, 100, 1)
    recorded, theta, offset = ca.SX.sym("recorded", 2 * n), ca.SX.sym("theta", n), ca.SX.sym("delta", n)
    summed = [part for pair in robot.turns_with_offsets(recorded, offset) for part in pair]
    direct = [part for pair in robot.turns(theta) for part in pair]
    first = numbers([recorded, offset], summed, robot.recorded_turns(q), delta)
    second = numbers([theta], direct, q + delta)
    np.testing.assert_allclose(first, second, rtol=1e-15, atol=1e-15)
    wrong = numbers([theta], direct, q - delta)  # control
    assert np.abs(np.array(first) - wrong).max() > 1e-3


def test_a_point_as_seen_from_the_flange_and_the_joints(own):
    robot, n = own.robot, own.robot.n
    rng = np.random.default_rng(3)
    theta, point = ca.SX.sym("theta", n), ca.SX.sym("point", 3)
    observed, stations = robot.in_flange(robot.turns(theta), point)
    for _ in range(3):
        q, p = own.random(rng), rng.uniform(-2000, 2000, 3)
        flange = own.pose(q).real
        result, *at = numbers([theta, point], [observed, *stations], q, p)
        np.testing.assert_allclose(result, flange[:3, :3].T @ (p - flange[:3, 3]), atol=1e-9)
        assert len(at) == n
        # From joint 1, behind what is fixed before it: whatever the joints.
        first = robot.joints[0].fixed
        np.testing.assert_allclose(at[0], first[:3, :3].T @ (p - first[:3, 3]), atol=1e-9)
        # And a point on the axis of a turn stays where it is by that joint.
        lengths = [np.linalg.norm(station) for station in at]
        for i, joint in enumerate(robot.joints[:-1]):
            if joint.kind == "revolute":
                fixed = robot.joints[i + 1].fixed
                behind = np.linalg.norm(fixed[:3, :3] @ at[i + 1] + fixed[:3, 3])
                assert behind == pytest.approx(lengths[i], rel=1e-12)


@pytest.mark.parametrize("size", [2, 3])
def test_the_geometric_jacobian_against_complex_steps(own, size):
    """Of components along given directions of the flange; by joints and by the point. Control: without the
    turn of the directions."""
    robot, n = own.robot, own.robot.n
    rng = np.random.default_rng(4)
    theta, point = ca.SX.sym("theta", n), ca.SX.sym("point", 3)
    turns = robot.turns(theta)
    _, stations = robot.in_flange(turns, point)
    vectors = rng.normal(size=(3, size))
    by_joints, by_point = robot.in_flange_jacobian(turns, stations, ca.SX(vectors))
    for _ in range(3):
        q, p = own.random(rng), rng.uniform(-2000, 2000, 3)

        def components(z):
            flange = own.pose(z[:n])
            return vectors.T @ flange[:3, :3].T @ (z[n:] - flange[:3, 3])

        expected = by_complex_step(components, np.append(q, p))
        result = np.hstack(numbers([theta, point], [by_joints, by_point], q, p))
        np.testing.assert_allclose(result, expected, rtol=0, atol=1e-8)
        assert np.abs(expected).max(axis=0).min() > 1e-3  # no column of zeros
        assert np.abs(result[:, n:] - vectors.T).max() > 1e-3


@pytest.mark.parametrize("name", DESIGNED)
def test_fk_is_the_product_of_the_matrices_for_any_batch(name, tmp_path):
    actual = plain_arm(name, tmp_path)
    rng = np.random.default_rng(3)
    q = np.array([actual.random(rng) for _ in range(6)])
    expected = np.array([actual.pose(row).real for row in q])
    for batch in ((), (6,), (3, 2), (2, 3, 1)):
        count = int(np.prod(batch))
        poses = actual.robot.fk((q[:count] * actual.robot.display).reshape(*batch, -1), "deg")
        assert poses.shape == (*batch, 4, 4)
        np.testing.assert_allclose(poses.reshape(-1, 4, 4), expected[:count], atol=1e-9)
    np.testing.assert_allclose(actual.robot.fk(q, unit="rad"), expected, atol=1e-9)
    assert actual.robot.fk(np.zeros((0, actual.robot.n)), "deg").shape == (0, 4, 4)


@pytest.mark.parametrize("name", DESIGNED)
def test_the_jacobian_is_the_derivative_of_the_pose(name, tmp_path):
    actual = plain_arm(name, tmp_path)
    rng = np.random.default_rng(4)
    q = np.array([actual.random(rng) for _ in range(4)])
    jacobians = actual.robot.jacobian((q * actual.robot.display).reshape(2, 2, -1), "deg")
    assert jacobians.shape == (2, 2, 6, actual.robot.n)
    np.testing.assert_array_equal(jacobians[1, 0], actual.robot.jacobian(q[2] * actual.robot.display, "deg"))
    np.testing.assert_allclose(jacobians.reshape(4, 6, -1), actual.robot.jacobian(q, unit="rad"), atol=1e-9)
    for row, jacobian in zip(q, jacobians.reshape(4, 6, -1), strict=True):
        pose = actual.pose(row).real
        for j in range(actual.robot.n):
            step = np.zeros(actual.robot.n, dtype=complex)
            step[j] = 1e-30j
            by_joint = actual.pose(row + step).imag / 1e-30
            turned = by_joint[:3, :3] @ pose[:3, :3].T  # skew: the rotation per unit of the joint
            rotation = [turned[2, 1], turned[0, 2], turned[1, 0]]
            np.testing.assert_allclose(turned, -turned.T, atol=1e-9)
            np.testing.assert_allclose(jacobian[:, j], [*by_joint[:3, 3], *rotation], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "argument", "words"),
    [
        ((np.zeros(5), "deg"), "q", "(..., 6): irb1600 has 6 joints"),
        ((3.0, "deg"), "q", "found:   ()"),
        (("home", "deg"), "q", "not an array of numbers"),
        ((np.full(6, np.inf), "deg"), "q", "not finite"),
        ((np.zeros(6), "grad"), "unit", "'deg' or 'rad'"),
    ],
)
def test_bad_joint_positions_are_named(arguments, argument, words):
    robot = load_robot("irb1600")
    for ask in (robot.fk, robot.jacobian):
        with pytest.raises(BadInput) as caught:
            ask(*arguments)
        assert caught.value.argument == argument
        assert words in str(caught.value)


def test_a_robot_is_told_in_one_line():
    assert repr(load_robot(Path("irb1600"))) == "<Robot irb1600: 6 joints>"


def test_the_unit_is_stated() -> None:
    robot = load_robot("ur5e")
    for ask in (robot.fk, robot.jacobian):
        with pytest.raises(TypeError, match="unit"):
            ask(np.zeros(6))
        np.testing.assert_allclose(
            ask(np.full(6, 90.0), "deg"), ask(np.full(6, np.pi / 2), unit="rad"), atol=1e-9
        )


@pytest.mark.parametrize(
    "axis", [[0, 0, 1], [0, 0, -1], [1, 0, 0], [0, -1, 0], [0.48, 0.6, 0.64], [0.36, -0.48, -0.8]]
)
def test_a_rotation_takes_z_onto_an_axis(axis):
    turn = onto_z(np.array(axis, dtype=float))
    np.testing.assert_allclose(turn[:3, 2], axis, atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(4), atol=1e-12)
    assert np.linalg.det(turn[:3, :3]) == pytest.approx(1)
    # The shortest one: about an axis across both.
    assert np.trace(turn[:3, :3]) == pytest.approx(1 + 2 * axis[2])


def test_rotations_about_an_axis_are_rodrigues():
    axis, angles = np.array([0.48, 0.6, 0.64]), np.array([[0.3, -2.0], [np.pi, 0.0]])
    expected = Rotation.from_rotvec(angles.reshape(-1, 1) * axis).as_matrix().reshape(2, 2, 3, 3)
    np.testing.assert_allclose(rotations(axis, angles), expected, atol=1e-12)


@pytest.mark.parametrize("name", ["irb1600", "ur10e", "panda"])
def test_a_robot_along_z_is_the_same_robot(name):
    robot = load_robot(name)
    joints = np.random.default_rng(1).uniform(-1, 1, size=(5, robot.n))
    other = along_z(robot)
    assert all((joint.axis == [0, 0, 1]).all() for joint in other.joints)
    np.testing.assert_allclose(
        other.pose_and_jacobian(joints)[0], robot.pose_and_jacobian(joints)[0], atol=1e-9
    )
