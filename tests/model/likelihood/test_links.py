"""What the link parameters are: those of Denavit-Hartenberg rows, whatever a robot was written in."""

import casadi as ca
import numpy as np
import pytest
from plain_geometry import chain_of_robot, rotation, shift
from plain_model import URDF

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.dh import DHRow, dh_chain
from zerobeam.model.kinematics.robot import Joint, Robot
from zerobeam.model.likelihood.constraint import Posture
from zerobeam.model.likelihood.geometry import Geometry

Z = np.array([0.0, 0.0, 1.0])
LENGTHS = ("a", "b", "d")
WHOLE = ("a", "b", "d", "alpha", "beta")  # of the last link
# a, alpha, d, theta: crossing, skew, nearly parallel and parallel axes, negative lengths and twists.
ROWS = [
    (150, -90, 486.5, 0),
    (-700, 3, 20, -90),
    (80, 0, -30, 40),
    (0, 90, 12, 180),
    (60, -75, 600, 0),
    (0, 90, 0, 10),
    (25, 30, 90, 0),
]
FILE = """\
schema: zerobeam/robot/1
name: made
convention: {convention}
joints:
"""
ROW = "  - {{a_mm: {}, alpha_deg: {}, d_mm: {}, theta_deg: {}, lower_deg: -170, upper_deg: 170}}\n"


def robot_of(rows, convention, folder):
    path = folder / "made.yaml"
    path.write_text(
        FILE.format(convention=convention) + "".join(ROW.format(*row) for row in rows), encoding="utf-8"
    )
    return load_robot(str(path), folder)


def flange(robot, geometry, values, q):
    """(4, 4) with some parameters, by name in mm and degrees, and the others at zero."""
    names = [f"{of}.{axis}" for of, axis in geometry.names]
    arm = np.zeros(robot.n + len(names))
    for name, value in values.items():
        actual = float(np.radians(value)) if name.split(".")[1] not in ("a", "b", "d") else value
        arm[robot.n + names.index(name)] = actual
    posture = Posture(robot, geometry)
    rotation_, translation = posture.flange.rotation, posture.flange.translation
    function = ca.Function("pose", [posture.q, posture.arm], [ca.horzcat(rotation_, translation)])
    return np.array(function(q, arm))


def postures(n, count=2):
    return np.random.default_rng(3).uniform(-2, 2, (count, n))


def change(rows, row, column, step):
    return [
        tuple(value + step * (k == column) for k, value in enumerate(values)) if i == row else values
        for i, values in enumerate(rows)
    ]


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.at_length(r"^standard")
def test_a_row_that_is_changed_is_the_parameter_of_its_link(tmp_path, convention):
    """Name, sign and size: link i of a standard row i; of a modified arm a and alpha of row i + 1, d of row
    i. The steps are large: they are the same to all orders."""
    robot = robot_of(ROWS, convention, tmp_path)
    geometry = Geometry.of_links(robot, 0.3, 0.1)
    checked = set()
    for of, axis in geometry.names:
        link = int(of.removeprefix("link"))
        if axis in ("beta", "b"):
            continue
        column = {"a": 0, "alpha": 1, "d": 2}[axis]
        row = link - 1 if convention == "standard" or axis == "d" else link
        if row == len(ROWS):
            continue  # behind the last modified row there is the flange
        step = 7.0 if axis in ("a", "d") else 12.0
        other = robot_of(change(ROWS, row, column, step), convention, tmp_path)
        for q in postures(robot.n):
            result = flange(robot, geometry, {f"{of}.{axis}": step}, q)
            np.testing.assert_allclose(result, other.fk(q, "rad")[:3], rtol=0, atol=1e-9)
            opposite = flange(robot, geometry, {f"{of}.{axis}": -step}, q)  # negative control: the sign
            assert np.abs(opposite - other.fk(q, "rad")[:3]).max() > 0.01
        checked.add((link, axis))
    assert {axis for _, axis in checked} == {"a", "alpha", "d"}
    assert len(checked) >= 3 * 7 - 5


@pytest.mark.parametrize("convention", ["standard", "modified"])
def test_a_link_between_nearly_parallel_axes_has_beta_in_place_of_d(tmp_path, convention):
    robot = robot_of(ROWS, convention, tmp_path)
    values = {link.number: link.axes for link in Geometry.of_links(robot, 0.3, 0.1).links}
    twists = [row[1] for row in ROWS]
    if convention == "modified":
        twists = [*twists[1:], 0]
    assert values.pop(len(ROWS)) == WHOLE
    for number, twist in enumerate(twists[:-1], start=1):
        assert values[number] == ("a", "alpha", "beta" if abs(twist) < 5 else "d")


def mixed(kinds, rows):
    fixed, end = dh_chain(
        [DHRow(a, *np.radians([al]), d, *np.radians([th])) for a, al, d, th in rows], "standard"
    )
    names = {"r": "revolute", "p": "prismatic"}
    joints = [Joint(f"j{i}", names[k], fixed[i], Z, -2.0, 2.0) for i, k in enumerate(kinds)]
    return Robot("mixed", tuple(joints), end)


def test_links_beside_a_prismatic_joint():
    """4 r + 2 p: of a slide counts its direction alone, and behind it theta, where d is the offset."""
    rows = [(100, 90, 50, 0), (80, 60, 20, 10), (60, -90, 30, 0), (40, 70, 10, 5)]
    values = {link.number: link.axes for link in Geometry.of_links(mixed("rprr", rows), 0.3, 0.1).links}
    assert values == {
        1: ("alpha",),
        2: ("a", "theta", "alpha"),
        3: ("a", "alpha", "d"),
        4: WHOLE,
    }


def reframed(robot, rng, along):
    """The same arm with the frame of every joint turned about its axis, and moved along it."""
    joints, carried = [], np.eye(4)
    for joint in robot.joints:
        other = rotation("z", rng.uniform(-3, 3)).real @ shift(z=along * rng.uniform(-300, 300)).real
        joints.append(
            Joint(joint.name, joint.kind, carried @ joint.fixed @ other, joint.axis, joint.lower, joint.upper)
        )
        carried = np.linalg.inv(other)
    return Robot(robot.name, tuple(joints), carried @ robot.flange)


def columns(robot, geometry, q):
    """(9, g) of the flange's place and two of its axes by the geometry parameters at zero."""
    posture = Posture(robot, geometry)
    rotation_, translation = posture.flange.rotation, posture.flange.translation
    observed = ca.vertcat(translation, 500 * rotation_[:, 0], 500 * rotation_[:, 2])
    jacobian = ca.jacobian(observed, posture.arm)
    arm = np.zeros(robot.n + len(geometry.names))
    return np.array(ca.Function("columns", [posture.q, posture.arm], [ca.densify(jacobian)])(q, arm))


CROSSED = [(150, -90, 486.5, 0), (-70, 30, 20, -90), (0, 90, 12, 180), (60, -75, 600, 0), (30, 60, 5, 0)]


def aligned(found, expected, names):
    """x is the common normal in the sense of the next joint's own x axis: in another frame it may be the
    opposite one, and a and alpha (about x), beta (about y) have the other sign. d and theta never have."""
    for start in range(len(names)):
        of, axis = names[start]
        if axis in ("a", "b", "alpha", "beta") and found[:, start] @ expected[:, start] < 0:
            same = [
                k
                for k, (other, values) in enumerate(names)
                if other == of and values in ("a", "b", "alpha", "beta")
            ]
            found[:, same] *= -1
    return found


def test_the_parameters_depend_on_the_axes_alone_not_on_the_frames(tmp_path):
    """As a URDF has them: frames anywhere along and around the axes, an arm without parallel axes."""
    robot = robot_of(CROSSED, "standard", tmp_path)
    geometry = Geometry.of_links(robot, 0.3, 0.1)
    for seed in range(3):
        other = reframed(robot, np.random.default_rng(seed), 1.0)
        again = Geometry.of_links(other, 0.3, 0.1)
        assert again.names == geometry.names
        for q in postures(robot.n, 2):
            np.testing.assert_allclose(other.fk(q, "rad"), robot.fk(q, "rad"), rtol=0, atol=1e-9)
            expected = columns(robot, geometry, q)
            n = robot.n
            result = aligned(columns(other, again, q)[:, n:], expected[:, n:], geometry.names)
            np.testing.assert_allclose(result, expected[:, n:], rtol=0, atol=1e-7)


def test_between_parallel_axes_other_frames_give_the_same_arms(tmp_path):
    """There the joint's own origin is the place of beta: another origin gives the same arms by other numbers.
    Negative control: the columns themselves are others."""
    robot = robot_of(ROWS, "standard", tmp_path)
    geometry = Geometry.of_links(robot, 0.3, 0.1)
    other = reframed(robot, np.random.default_rng(1), 1.0)
    again = Geometry.of_links(other, 0.3, 0.1)
    assert again.names == geometry.names
    one = np.vstack([columns(robot, geometry, q) for q in postures(robot.n, 8)])
    two = np.vstack([columns(other, again, q) for q in postures(robot.n, 8)])
    length = np.linalg.norm(one, axis=0)
    left, singular, _ = np.linalg.svd(one / length, full_matrices=False)
    kept = left[:, singular > 1e-9]
    rest = two - kept @ (kept.T @ two)
    assert np.abs(rest).max() < 1e-6 * np.abs(two).max()
    n = robot.n
    assert np.abs(aligned(two[:, n:].copy(), one[:, n:], geometry.names) - one[:, n:]).max() > 10


def test_a_urdf_with_axes_askew(tmp_path):
    """The numbers of the second model: frames by least squares (tests/support/plain_geometry.py)."""
    path = tmp_path / "bent.urdf"
    path.write_text(URDF, encoding="utf-8")
    robot = read_urdf(path, "base", "hand")
    geometry, chain = Geometry.of_links(robot, 0.3, 0.1), chain_of_robot(robot)
    q = np.array([0.3, -0.4, 50.0, 0.7])
    for of, axis in geometry.names:
        value = 2.0 if axis in LENGTHS else np.radians(1.5)
        expected = chain.frames(q, {of: {axis: value}})[-1].real[:3]
        shown = value if axis in LENGTHS else np.degrees(value)
        np.testing.assert_allclose(flange(robot, geometry, {f"{of}.{axis}": shown}, q), expected, atol=1e-9)


def test_beta_is_continuous_where_a_twist_goes_through_zero(tmp_path):
    """Columns of two links whose axes are 0 to 4 degrees apart: they change no faster than the twist, 700 mm
    away, and have no pole: the foot of the common normal would have one."""
    q = np.array([0.4, -0.3, 0.5, 0.2, 0.1, -0.6, 0.3])

    def at(twist):
        robot = robot_of(change(ROWS, 1, 1, twist - 3), "standard", tmp_path)
        geometry = Geometry.of_links(robot, 0.3, 0.1)
        assert ("link2", "beta") in geometry.names
        return columns(reframed(robot, np.random.default_rng(2), 0.0), geometry, q)

    twists = [-4, -1, -1e-3, -1e-7, 0, 1e-7, 1e-3, 1, 4]
    values = [at(twist) for twist in twists]
    for one, other, step in zip(values[:-1], values[1:], np.diff(np.radians(twists)), strict=True):
        assert np.abs(other - one).max() < 5000 * abs(step) + 1e-7
    assert max(np.abs(value).max() for value in values) < 5000
