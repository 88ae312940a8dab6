from pathlib import Path

import numpy as np
import pytest

from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.plausible import DoubtfulRobot
from zerobeam.model.kinematics.robot import euler

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="world"/>
  <link name="base"/>
  <link name="upper"/>
  <link name="slide"/>
  <link name="hand"/>
  <link name="finger"/>
  <joint name="mount" type="fixed"><parent link="world"/><child link="base"/><origin xyz="9 9 9"/></joint>
  <joint name="turn" type="revolute">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.4" rpy="0 0 1.5707963267948966"/>
    <axis xyz="0 0 2"/>
    <limit lower="-2" upper="1" effort="0" velocity="1.5"/>
  </joint>
  <joint name="push" type="prismatic">
    <parent link="upper"/><child link="slide"/>
    <axis xyz="1 0 0"/>
    <limit lower="0" upper="0.3" effort="0" velocity="0"/>
  </joint>
  <joint name="roll" type="continuous">
    <parent link="slide"/><child link="hand"/>
    <origin xyz="0.1 0 0"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="hand"/><child link="finger"/>
    <axis xyz="0 1 0"/>
    <limit lower="0" upper="0.04" effort="0" velocity="0.2"/>
    <mimic joint="push"/>
  </joint>
</robot>
"""


def urdf(folder: Path, text: str = ARM) -> Path:
    path = folder / "arm.urdf"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_chain_in_millimetres_with_limits_and_speeds(tmp_path):
    robot = read_urdf(urdf(tmp_path), "base", "hand")
    assert robot.name == "arm"
    assert [joint.name for joint in robot.joints] == ["turn", "push", "roll"]
    assert [joint.kind for joint in robot.joints] == ["revolute", "prismatic", "revolute"]
    np.testing.assert_allclose(robot.lower, [-2, 0, -2 * np.pi])
    np.testing.assert_allclose(robot.upper, [1, 300, 2 * np.pi])
    assert [joint.speed for joint in robot.joints] == [1.5, None, None]
    np.testing.assert_allclose([np.linalg.norm(joint.axis) for joint in robot.joints], 1)


def test_a_chain_by_hand(tmp_path):
    robot = read_urdf(urdf(tmp_path), "base", "hand")
    # The base turns everything by 90 degrees, the slide goes out along it, the hand sits 100 mm on.
    at_zero = robot.fk([0, 250, 0], "rad")
    np.testing.assert_allclose(at_zero[:3, 3], [0, 350, 400], atol=1e-9)
    np.testing.assert_allclose(robot.fk([-np.pi / 2, 250, 0], "rad")[:3, 3], [350, 0, 400], atol=1e-9)
    # URDF's default axis is x.
    np.testing.assert_allclose(robot.fk([-np.pi / 2, 0, np.pi / 2], "rad")[:3, 1], [0, 0, 1], atol=1e-12)


def test_fixed_joints_before_and_after_the_moving_ones_count(tmp_path):
    with pytest.warns(DoubtfulRobot, match="beyond any real arm"):
        from_world = read_urdf(urdf(tmp_path), "world", "hand")
    np.testing.assert_allclose(from_world.fk([0, 0, 0], "rad")[:3, 3], [9000, 9100, 9400], atol=1e-9)


def test_roll_pitch_yaw_turn_about_fixed_axes():
    roll, pitch, yaw = 0.3, -0.7, 1.1
    half = euler("xyz", (roll, 0, 0)), euler("xyz", (0, pitch, 0)), euler("xyz", (0, 0, yaw))
    np.testing.assert_allclose(euler("xyz", (roll, pitch, yaw)), half[2] @ half[1] @ half[0], atol=1e-15)
    # The x axis ends at heading yaw, below the horizon by pitch, whatever the roll.
    expected = [np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)]
    np.testing.assert_allclose(euler("xyz", (roll, pitch, yaw))[:3, 0], expected, atol=1e-15)


@pytest.mark.parametrize(
    ("old", "new", "what", "line"),
    [
        ('type="revolute"', 'type="floating"', "of a kind that a serial arm cannot have", 10),
        ('type="revolute"', 'type="planar"', "of a kind that a serial arm cannot have", 10),
        ('<limit lower="-2" upper="1" effort="0" velocity="1.5"/>', "", "'turn' has no limits", 10),
        ('<limit lower="-2" upper="1"', "<limit", "'turn' has no limits", 14),
        ('lower="-2"', 'lower="2"', "lower limit ≥ upper limit", 14),
        ('lower="-2"', 'lower="nan"', "'lower' of <limit> cannot be read", 14),
        ('xyz="0 0 0.4"', 'xyz="0 0 1e30"', "'xyz' of <origin> cannot be read", 12),
        ('upper="1"', 'upper="1e16"', "'upper' of <limit> cannot be read", 14),
        ('xyz="0 0 0.4"', 'xyz="0 0,4"', "'xyz' of <origin> cannot be read", 12),
        ('xyz="0 0 0.4"', 'xyz="0 0 0 0.4"', "'xyz' of <origin> cannot be read", 12),
        ('xyz="0 0 2"', 'xyz="0 0 0"', "has no length", 13),
        ('<parent link="slide"/>', "", "has no <parent>", 21),
        ('<parent link="slide"/>', '<parent link="slid"/>', "names a link that is not there", 22),
        ('<child link="hand"/>', '<child link="upper"/>', "hangs on two joints", 21),
        ('<link name="finger"/>', '<link name="finger"/><link name="loose"/>', "do not form one tree", 2),
        ('<link name="finger"/>', '<link name="finger"/><link name="hand"/>', "duplicate link", 2),
        ("</robot>", "", "not valid XML", None),
        ("<robot ", "<!DOCTYPE robot>\n<robot ", "no document type", 2),
        (
            "<robot ",
            '<!DOCTYPE robot [<!ENTITY a "b">]>\n<robot ',
            "no document type",
            2,
        ),
    ],
)
def test_a_file_that_cannot_be_used(tmp_path, refused, old, new, what, line):
    assert old in ARM
    error = refused(read_urdf, urdf(tmp_path, ARM.replace(old, new, 1)), "base", "hand")
    assert what in error.what
    assert line is None or error.line == line
    assert error.file == str(tmp_path / "arm.urdf")


def test_links_that_are_no_chain(tmp_path, refused):
    path = urdf(tmp_path)
    error = refused(read_urdf, path, "base", "hnad")
    assert error.allowed == "world, base, upper, slide, hand, finger"
    assert "'hand'" in error.remedy
    assert refused(read_urdf, path, "Base", "hand").found == "Base"
    assert refused(read_urdf, path, "hand", "base").remedy == "exchange base and tip"
    assert "no joint moves" in refused(read_urdf, path, "world", "base").what
    assert "no joint moves" in refused(read_urdf, path, "hand", "hand").what


def test_a_mimicking_joint_matters_only_on_the_chain(tmp_path, refused):
    assert read_urdf(urdf(tmp_path), "base", "hand").n == 3
    error = refused(read_urdf, urdf(tmp_path), "base", "finger")
    assert "mimics" in error.what
    assert error.line == 29


def test_other_xml_and_xacro(tmp_path, refused):
    assert "not a URDF" in refused(read_urdf, urdf(tmp_path, "<sdf/>"), "a", "b").what
    assert "xacro" in refused(read_urdf, urdf(tmp_path, '<robot name="x"/>'), "a", "b").remedy


def test_a_loop_of_links_is_no_tree(tmp_path, refused):
    loop = """<robot name="loop"><link name="root"/><link name="a"/><link name="b"/>
    <joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
    <joint name="ba" type="fixed"><parent link="b"/><child link="a"/></joint></robot>"""
    assert "no chain" in refused(read_urdf, urdf(tmp_path, loop), "root", "b").what


def test_panda_against_the_maker_s_rows(shared_data):
    """Modified DH of the Panda as its maker publishes it, then 107 mm flange, -45 degrees, 103.4 mm hand."""
    robot = read_urdf(shared_data / "mukca/urdf/panda.urdf", "panda_link0", "panda_hand_tcp")
    assert robot.n == 7
    a = [0, 0, 0, 82.5, -82.5, 0, 88]
    alpha = [0, -90, 90, 90, -90, 90, 90]
    d = [333, 0, 316, 0, 384, 0, 0]
    q = [0.1, -0.5, 0.3, -2.2, 0.4, 1.8, 0.7]
    expected = np.eye(4)
    for a_i, alpha_i, d_i, q_i in zip(a, alpha, d, q, strict=True):
        link = euler("xyz", (np.radians(alpha_i), 0, 0))
        link[0, 3] = a_i
        turn = euler("xyz", (0, 0, q_i))
        turn[2, 3] = d_i
        expected = expected @ link @ turn
    hand = euler("xyz", (0, 0, -np.pi / 4))
    hand[2, 3] = 107 + 103.4
    np.testing.assert_allclose(robot.fk(q, "rad"), expected @ hand, atol=1e-6)


def test_the_other_recorded_arms_have_chains(shared_data):
    kuka = read_urdf(shared_data / "mukca/urdf/iiwa14.urdf", "base_link", "tool0")
    np.testing.assert_allclose(kuka.fk([0] * 7, "rad")[:3, 3], [0, 0, 1306], atol=1e-6)
    assert read_urdf(shared_data / "mukca/urdf/gen3lite.urdf", "kinova_base_link", "end_effector_link").n == 6
