"""Joints as a pendant counts, orders and limits them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header, header_content
from zerobeam.model.files.joint_values import check_limits
from zerobeam.model.files.robot_file import load_robot, rebased
from zerobeam.model.kinematics.pendant import (
    Pendant,
    beyond_limits,
    encoder3_of,
    pendant_of,
    require_link_encoder,
)
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.options import J3


def test_there_and_back_for_one_posture_and_for_many() -> None:
    robot = load_robot("lrmate_200id")
    pendant = Pendant(robot, "ground")
    joints = np.random.default_rng(0).normal(size=(4, robot.n))
    before = joints.copy()
    assert pendant.between_links(joints[0]) == pytest.approx(joints[0] + np.eye(6)[2] * joints[0, 1])
    np.testing.assert_array_equal(pendant.between_links(joints)[0], pendant.between_links(joints[0]))
    assert pendant.counted(pendant.between_links(joints)) == pytest.approx(joints)
    assert not np.allclose(pendant.counted(joints), pendant.between_links(joints))
    np.testing.assert_array_equal(joints, before)


@pytest.mark.parametrize("name", ["two", "slides"])
def test_an_arm_without_such_a_joint_is_refused(name: str) -> None:
    robot = load_robot("irb1600")
    joints = list(robot.joints)
    joints[2] = replace(joints[2], kind="prismatic")
    other = replace(robot, name=name, joints=tuple(joints[:2] if name == "two" else joints))
    with pytest.raises(BadInput, match="not counted from the ground"):
        Pendant(other, "ground")


COUPLED = """schema: zerobeam/robot/1
name: coupled
convention: standard
joints:
  - {a_mm: 50, alpha_deg: -90, d_mm: 0, theta_deg: 0, lower_deg: -170, upper_deg: 170}
  - {a_mm: 330, alpha_deg: 180, d_mm: 0, theta_deg: -90, lower_deg: -100, upper_deg: 145}
  - {a_mm: 35, alpha_deg: -90, d_mm: 0, theta_deg: 0, lower_deg: -140, upper_deg: 280}
mounting: {below_base_mm: 330}
pendant: {joint3: ground, order: [3, 1, 2], names: [S, L, U], unit: pulse, pulses_per_deg: [1000, -2000, 500]}
limits: {joint3_to_link2_deg: [-70, 205]}
encoder: {joint3: link}
"""


def robot_of(folder: Path, text: str) -> Robot:
    path = folder / "arm.yaml"
    path.write_text(text, encoding="utf-8")
    return load_robot(path)


def test_order_names_unit_and_counting_of_a_pendant(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, COUPLED)
    pendant = pendant_of(robot)
    joints = np.array([10.0, 20.0, 50.0])  # joint 3 from link 2; the pendant shows 50 - 20 = 30 deg of it
    assert pendant.shown(joints).tolist() == [30 * 500, 10 * 1000, 20 * -2000]
    assert pendant.read(pendant.shown(joints)) == pytest.approx(joints)
    assert [name for name, _, _ in pendant.readings(joints)] == ["U", "S", "L"]
    assert pendant.counted(joints).tolist() == [10, 20, 30]
    for word in ("from the ground", "U, S, L", "pulses"):
        assert word in pendant.sentence
    assert robot.conventions.below_base == 330
    other = Pendant(robot, "link")
    assert other.counted(joints).tolist() == [10, 20, 50]
    assert [limit[2] for limit in pendant.limits] == pytest.approx([-140, 280])
    assert [limit[2] for limit in other.limits] == pytest.approx([-70, 205])


@pytest.mark.parametrize("joint3", ["ground", "link"])
def test_the_share_of_joint_2_gives_the_counting(tmp_path: Path, joint3: J3) -> None:
    robot = robot_of(tmp_path, COUPLED)
    pendant = Pendant(robot, joint3)
    joints = np.random.default_rng(3).uniform(-90, 90, (5, robot.n))
    shares = np.outer(joints[:, 1], pendant.less_joint2)
    np.testing.assert_allclose(joints - shares, pendant.counted(joints), rtol=0, atol=1e-12)


def test_both_ranges_of_a_coupled_joint_3_are_kept(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, COUPLED)
    rows = np.radians([[0, 0, 50], [0, 0, 206], [0, 0, -71], [0, 145, 4], [0, 145, 6], [0, -100, 181]])
    # As the pendant shows joint 3: 50, 206, -71, -141, -139, 281; between the links 206 and -71 are too far.
    assert beyond_limits(robot, rows)[:, 2].tolist() == [False, True, True, True, False, True]
    assert not beyond_limits(robot, rows)[:, :2].any()
    # The range between the links follows from those of joints 2 and 3 where it is not stated.
    free = robot_of(tmp_path, COUPLED.replace("limits: {joint3_to_link2_deg: [-70, 205]}\n", ""))
    assert np.degrees([free.lower[2], free.upper[2]]) == pytest.approx([-240, 425])
    assert beyond_limits(free, rows)[:, 2].tolist() == [False, False, False, True, False, True]
    with pytest.raises(BadInput, match="joint 3 is outside its limits") as caught:
        check_limits(robot, np.degrees(rows[3:4]), "posture", [0], [7], limits="error", file=None)
    assert (caught.value.found, caught.value.line) == ("-141 deg, as the pendant counts it", 7)
    with pytest.raises(BadInput) as caught:
        check_limits(robot, np.degrees(rows[2:3]), "posture", [0], [7], limits="error", file=None)
    assert caught.value.found == "-71 deg, between links 2 and 3"


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("joint3: ground, order", "joint3: link, order", "joint3_to_link2_deg is for a pendant"),
        ("order: [3, 1, 2]", "order: [3, 1, 1]", "order does not name each joint once"),
        ("names: [S, L, U]", "names: [S, L]", "names has not one value for each joint"),
        ("names: [S, L, U]", "names: [S, L, S]", "two joints have the same name"),
        ("unit: pulse, ", "", "belong together"),
        ("[1000, -2000, 500]", "[1000, 0, 500]", "0 pulses"),
        ("[-70, 205]", "[205, -70]", "the range is empty"),
        ("[-70, 205]", "[430, 500]", "leave nothing between links 2 and 3"),
        ("joint3: ground, order", "joint_3: ground, order", "unknown key 'joint_3'"),
    ],
)
def test_conventions_that_contradict_themselves(tmp_path: Path, old: str, new: str, what: str) -> None:
    assert old in COUPLED
    with pytest.raises(BadInput, match=what):
        robot_of(tmp_path, COUPLED.replace(old, new))


def test_what_a_maker_counts_from_the_ground_is_asked_for_where_nothing_says_it(tmp_path: Path) -> None:
    bare = COUPLED[: COUPLED.index("mounting")]
    arm = robot_of(tmp_path, bare)
    assert pendant_of(arm).joint3 == "link"
    with pytest.raises(BadInput, match="counted from"):
        pendant_of(arm, vendor="fanuc")
    fanuc = replace(arm, vendor="fanuc")
    for use in (pendant_of, encoder3_of):
        with pytest.raises(BadInput, match="joint 3"):
            use(fanuc)
    assert pendant_of(fanuc, "ground").ground
    with pytest.raises(BadInput, match="not understood"):
        pendant_of(arm, "base")  # type: ignore[arg-type]


def test_encoders_that_measure_from_the_ground_are_refused_where_no_file_holds_them(tmp_path: Path) -> None:
    arm = robot_of(tmp_path, COUPLED.replace("encoder: {joint3: link}", "encoder: {joint3: ground}"))
    assert encoder3_of(arm) == "ground"
    with pytest.raises(BadInput, match="measures from the ground"):
        require_link_encoder(arm, "this sheet")


def test_the_conventions_of_a_urdf_stand_beside_its_chain(tmp_path: Path) -> None:
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><origin xyz="0 0 0.3"/>'
        '<axis xyz="0 1 0"/><limit lower="-1.2" upper="3.5" velocity="1"/></joint><link name="l{0}"/>'
    )
    text = (
        '<robot name="arm"><link name="l0"/>'
        + "".join(joint.format(i, i - 1) for i in (1, 2, 3))
        + "</robot>"
    )
    (tmp_path / "arm.urdf").write_text(text, encoding="utf-8")
    content = {
        "robot": {
            "urdf": "arm.urdf", "base": "l0", "tip": "l3", "mounting": {"below_base_mm": 120.0},
            "pendant": {"joint3": "ground"}, "limits": {"joint3_pendant_deg": [-90.0, 100.0]},
            "encoder": {"joint3": "link"},
        },
        "tool": {"kind": "laser", "point_mm": [0.0, 0.0, 50.0], "direction": [1.0, 0.0, 0.0]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    }  # fmt: skip
    header = Header.model_validate(content)
    robot = load_robot(header.robot, tmp_path)
    assert (robot.conventions.below_base, robot.conventions.encoder3) == (120.0, "link")
    assert [limit[2] for limit in pendant_of(robot).limits] == pytest.approx([-90, 100])
    assert np.degrees(robot.upper[2]) == pytest.approx(np.degrees(3.5))
    # They are written with the header, and go along to another folder.
    assert header_content(header, "zerobeam/plan/1")["robot"] == content["robot"]
    (tmp_path / "deeper").mkdir()
    moved = rebased(header.robot, tmp_path, tmp_path / "deeper")
    assert load_robot(moved, tmp_path / "deeper").conventions == robot.conventions
    content["robot"]["pendant"] = {"joint3": "link"}  # type: ignore[index]
    with pytest.raises(ValidationError, match="joint3_pendant_deg is for a pendant"):
        Header.model_validate(content)
