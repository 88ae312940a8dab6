"""The built-in robots against what their makers publish: poses, chains of descriptions, URDFs.

The figures of a chain are those of the description that the robot's file names: each joint's origin in the
frame before it, mm, and its axis at zero; then the tool0 frame. They are independent of DH rows.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from documents import read
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, load_robot, stated_rows
from zerobeam.model.files.urdf import read_urdf

X, Y, Z = np.eye(3)
Origin = tuple[float, float, float]
SLIP = np.array([0, 0, 0.1, 0, 0, 0])  # degrees


@dataclass(frozen=True)
class Chain:
    """Origins of the joints and of tool0, mm; axes; turn of tool0 at zero."""

    origins: tuple[Origin, ...]
    axes: tuple[Matrix, ...]
    tool0: Rotation

    def pose(self, joints_deg: Matrix) -> Matrix:
        turn, position = Rotation.identity(), np.zeros(3)
        for origin, axis, angle in zip(self.origins, self.axes, joints_deg, strict=False):
            position = position + turn.apply(origin)
            turn = turn * Rotation.from_rotvec(axis * np.radians(angle))
        result = np.eye(4)
        result[:3, 3] = position + turn.apply(self.origins[-1])
        result[:3, :3] = (turn * self.tool0).as_matrix()
        return result


FORWARD = Rotation.from_euler("y", 90, degrees=True)
FANUC = Rotation.from_euler("xyz", [180, -90, 0], degrees=True)
ABB_AXES = (Z, Y, Y, X, Y, X)
KUKA_AXES = (-Z, Y, Y, -X, Y, -X)
FANUC_AXES = (Z, Y, -Y, -X, -Y, -X)


def abb(a1: float, height: float, upper: float, elbow: float, fore: float, flange: float) -> Chain:
    origins = (
        (0, 0, height),
        (a1, 0, 0),
        (0, 0, upper),
        (0, 0, elbow),
        (fore, 0, 0),
        (flange, 0, 0),
        (0, 0, 0),
    )
    return Chain(origins, ABB_AXES, FORWARD)


def kuka(upper: float, elbow: float, fore: float, flange: float) -> Chain:
    origins = ((0, 0, 400), (25, 0, 0), (upper, 0, 0), (0, 0, elbow), (fore, 0, 0), (flange, 0, 0), (0, 0, 0))
    return Chain(origins, KUKA_AXES, FORWARD)


def fanuc(a1: float, upper: float, elbow: float, fore: float, flange: float) -> Chain:
    origins = ((0, 0, 0), (a1, 0, 0), (0, 0, upper), (0, 0, elbow), (fore, 0, 0), (flange, 0, 0), (0, 0, 0))
    return Chain(origins, FANUC_AXES, FANUC)


DESCRIBED = {
    "irb120": abb(0, 290, 270, 70, 302, 72),
    "irb1200": abb(0, 399.1, 448, 42, 451, 82),
    "irb1200_7_70": abb(0, 399.1, 350, 42, 351, 82),
    "irb2600": abb(150, 445, 700, 115, 795, 85),
    "irb6700": abb(320, 780, 1125, 200, 1142.5, 200),
    "kr6_r900": kuka(455, 35, 420, 80),
    "kr6_r900_2": kuka(455, 25, 420, 90),
    "kr10_r1100": kuka(560, 35, 515, 80),
    "kr10_r1100_2": kuka(560, 25, 515, 90),
    "lrmate_200id": fanuc(50, 330, 35, 335, 80),
    "m10ia": fanuc(150, 600, 200, 640, 100),
    "gp7": fanuc(40, 445, 40, 440, 80),
    "tx2_60": Chain(
        ((0, 0, 0), (0, 0, 0), (0, 20, 290), (0, 0, 0), (0, 0, 310), (0, 0, 70), (0, 0, 0)),
        (Z, Y, Y, Z, Y, Z),
        Rotation.identity(),
    ),
}


@pytest.mark.parametrize("name", DESCRIBED)
@pytest.mark.one_in(4)
def test_a_robot_is_that_of_its_description(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(0)
    worst = 0.0
    for joints in rng.uniform(robot.lower, robot.upper, (20, 6)) * robot.display:
        expected = DESCRIBED[name].pose(joints)
        np.testing.assert_allclose(robot.fk(joints, "deg"), expected, rtol=0, atol=1e-9)
        worst = max(worst, np.abs(DESCRIBED[name].pose(joints + SLIP) - expected).max())
    assert worst > 0.1  # control: a tenth of a degree would show


def by_frames(origins_mm: Matrix, turns_rad: Matrix, joints_deg: Matrix) -> Matrix:
    """Pose of a chain in which every joint turns about z, behind an origin and fixed roll, pitch, yaw."""
    pose = np.eye(4)
    for origin, turn, angle in zip(origins_mm, turns_rad, np.radians(joints_deg), strict=True):
        step = np.eye(4)
        step[:3, 3] = origin
        step[:3, :3] = (Rotation.from_euler("xyz", turn) * Rotation.from_rotvec(Z * angle)).as_matrix()
        pose = pose @ step
    return pose


HALF = np.pi / 2
# x, y, z of shoulder, upper arm, forearm and three wrists of ur_description (UniversalRobots), m.
UR = {
    "ur3e": (0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": (0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": (0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": (0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "ur30": (0.2363, -0.637, -0.5037, 0.201, 0.1593, 0.1543),
    "ur20": (0.2363, -0.862, -0.7287, 0.201, 0.1593, 0.1543),
}


@pytest.mark.parametrize("name", UR)
def test_a_universal_robot_is_that_of_its_description(name: str) -> None:
    d1, a2, a3, d4, d5, d6 = np.array(UR[name]) * 1000
    origins = np.array([(0, 0, d1), (0, 0, 0), (a2, 0, 0), (a3, 0, d4), (0, -d5, 0), (0, d6, 0)])
    turns = np.array([(0, 0, 0), (HALF, 0, 0), (0, 0, 0), (0, 0, 0), (HALF, 0, 0), (HALF, np.pi, np.pi)])
    robot = load_robot(name)
    for joints in np.random.default_rng(1).uniform(-180, 180, (20, 6)):
        np.testing.assert_allclose(
            robot.fk(joints, "deg"), by_frames(origins, turns, joints), rtol=0, atol=1e-8
        )


# Origins, mm, and fixed turns of dsr_description2 (DoosanRobotics) and tm_description (TechmanRobotInc).
OTHERS = {
    "m1013": (
        [(0, 0, 152.5), (0, 34.5, 0), (620, 0, 0), (0, -559, 0), (0, 0, 0), (0, -121, 0)],
        [(0, 0, 0), (0, -HALF, -HALF), (0, 0, HALF), (HALF, 0, 0), (-HALF, 0, 0), (HALF, 0, 0)],
    ),
    "tm5_900": (
        [(0, 0, 145.1), (0, 0, 0), (429, 0, 0), (411.5, 0, -122.2), (0, -106, 0), (0, -114.4, 0)],
        [(0, 0, 0), (-HALF, -HALF, 0), (0, 0, 0), (0, 0, HALF), (HALF, 0, 0), (HALF, 0, 0)],
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_an_arm_of_turned_frames_is_that_of_its_description(name: str) -> None:
    origins, turns = (np.array(each) for each in OTHERS[name])
    robot = load_robot(name)
    for joints in np.random.default_rng(3).uniform(-150, 150, (20, 6)):
        np.testing.assert_allclose(
            robot.fk(joints, "deg"), by_frames(origins, turns, joints), rtol=0, atol=1e-8
        )


def test_the_xarm_is_that_of_its_description() -> None:
    origins = np.array([(0, 0, 267), (0, 0, 0), (53.5, -284.5, 0), (77.5, 342.5, 0), (0, 0, 0), (76, 97, 0)])
    turns = np.array([(0, 0, 0), (-HALF, 0, 0), (0, 0, 0), (-HALF, 0, 0), (HALF, 0, 0), (-HALF, 0, 0)])
    robot = load_robot("xarm6")
    for joints in np.random.default_rng(2).uniform(-180, 180, (20, 6)):
        np.testing.assert_allclose(
            robot.fk(joints, "deg"), by_frames(origins, turns, joints), rtol=0, atol=1e-6
        )


# Flange at given joints as makers and their manuals show it: where the arm is at zero, or at its home.
@pytest.mark.parametrize(
    ("name", "joints", "position", "z_axis"),
    [
        ("irb120", [0, 0, 0, 0, 0, 0], [374, 0, 630], X),
        ("irb1200", [0, 0, 0, 0, 0, 0], [533, 0, 889.1], X),
        ("irb2600", [0, 0, 0, 0, 0, 0], [1030, 0, 1260], X),
        ("kr6_r900", [0, -90, 90, 0, 0, 0], [525, 0, 890], X),
        ("kr10_r1100", [0, 0, 0, 0, 0, 0], [1180, 0, 435], X),
        ("lrmate_200id", [0, 0, 0, 0, 0, 0], [465, 0, 365], X),
        ("lrmate_200id", [0, 0, 0, 0, -90, 0], [385, 0, 285], -Z),
        ("xarm6", [0, 0, 0, 0, 0, 0], [207, 0, 112], -Z),
        ("ur5e", [0, 0, 0, 0, 0, 0], [-817.2, -232.9, 62.8], -Y),
        ("ur10e", [0, -90, 0, -90, 0, 0], [0, -290.7, 1484.8], -Y),
        ("tx2_60", [0, 0, 0, 0, 0, 0], [0, 20, 670], Z),
        ("gp7", [0, 0, 0, 0, 0, 0], [560, 0, 485], X),
    ],
)
def test_published_poses(name: str, joints: list[float], position: list[float], z_axis: Matrix) -> None:
    pose = load_robot(name).fk(joints, "deg")
    np.testing.assert_allclose(pose[:3, 3], position, rtol=0, atol=0.05)
    np.testing.assert_allclose(pose[:3, 2], z_axis, rtol=0, atol=1e-9)


# Reach of data sheets, mm: from axis 1 to the centre of the wrist with the arm stretched.
@pytest.mark.parametrize(
    ("name", "reach"),
    [
        ("irb120", 580),
        ("irb2600", 1650),
        ("irb6700", 2600),
        ("kr6_r900", 901),
        ("kr10_r1100", 1101),
        ("m10ia", 1420),
    ],
)
def test_the_reach_is_that_of_the_data_sheet(name: str, reach: float) -> None:
    rows = stated_rows(name, Path()).joints
    stretched = rows[0].a_mm + rows[1].a_mm + np.hypot(rows[2].a_mm, rows[3].d_mm)
    assert stretched == pytest.approx(reach, abs=12)


def test_every_robot_states_source_model_ranges_and_speeds() -> None:
    without_speeds = {"gen3_lite"}  # its guide states none
    names = built_in_robots()
    assert len(names) >= 40
    page = read("docs/how-to/my-robot.md")
    for name in names:
        text = (BUILT_IN / f"{name}.yaml").read_text(encoding="utf-8")
        assert text.startswith("# "), name
        robot = load_robot(name)
        assert robot.name == name
        assert robot.vendor
        assert (robot.upper > robot.lower).all()
        if name not in without_speeds:
            assert all(joint.speed for joint in robot.joints), name
        assert f"| `{name}` (" in page or f", `{name}` (" in page
        assert {"vendor", "model"} <= {line.partition(":")[0] for line in text.splitlines()}


# How far apart, mm: the URDF of the iiwa has offsets of 0.436 mm that the data sheet has not, that of the
# Gen3 lite rounds angles to 1.5708 and writes 128.25 mm where the guide says 128.3.
# How much further a joint may turn than the URDF says, degrees: limits there are rounded down, and joint 6
# of the Gen3 lite is at 120 where the guide says 149.
@pytest.mark.parametrize(
    ("name", "urdf", "base", "tip", "apart_mm", "further_deg"),
    [
        ("panda", "panda", "panda_link0", "panda_link8", 1e-6, 0.01),
        ("iiwa14", "iiwa14", "base_link", "tool0", 0.9, 0.05),
        ("gen3_lite", "gen3lite", "kinova_base_link", "end_effector_link", 0.06, 30.0),
    ],
)
def test_a_built_in_arm_is_that_of_its_urdf(
    shared_data: Path, name: str, urdf: str, base: str, tip: str, apart_mm: float, further_deg: float
) -> None:
    robot = load_robot(name, Path())
    other = read_urdf(shared_data / "mukca" / "urdf" / f"{urdf}.urdf", base, tip)
    rng = np.random.default_rng(0)
    for joints in rng.uniform(-2.5, 2.5, size=(20, robot.n)):
        here, there = robot.fk(joints, "rad"), other.fk(joints, "rad")
        np.testing.assert_allclose(here[:3, 3], there[:3, 3], atol=apart_mm, rtol=0)
        np.testing.assert_allclose(here[:3, :3], there[:3, :3], atol=2e-5, rtol=0)
    for mine, theirs in ((robot.upper, other.upper), (-robot.lower, -other.lower)):
        assert (np.abs(mine - theirs) <= np.radians(further_deg)).all()


def test_the_reach_of_the_stretched_arms_is_as_published() -> None:
    # Straight up: base to flange, mm, of the lengths in the data sheets.
    assert set(built_in_robots()) >= {"irb1600", "panda", "iiwa14", "gen3_lite"}
    heights = {
        "iiwa14": 360 + 420 + 400 + 126,
        "gen3": 156.4 + 128.4 + 2 * 210.4 + 208.4 + 2 * 105.9 + 61.5,
        "gen3_lite": 243.3 + 280 + 245 + 105,
    }
    for name, height in heights.items():
        robot = load_robot(name, Path())
        assert robot.fk(np.zeros(robot.n), "deg")[2, 3] == pytest.approx(height, abs=0.1)
    panda = load_robot("panda", Path())
    # The elbow's offsets of 82.5 mm cancel; the hand looks down from 88 mm before the wrist.
    assert panda.fk(np.zeros(7), "deg")[:3, 3] == pytest.approx([88, 0, 333 + 316 + 384 - 107])


def test_a_vendor_is_optional_and_one_of_a_list(tmp_path: Path) -> None:
    text = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(text.replace("vendor: abb\n", ""), encoding="utf-8")
    assert load_robot(mine).vendor is None
    mine.write_text(text.replace("vendor: abb", "vendor: Abb"), encoding="utf-8")
    with pytest.raises(BadInput, match="vendor"):
        load_robot(mine)
