"""The built-in arms of collaborative robots, against the URDFs of the recordings (not shipped)."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, load_robot
from zerobeam.model.files.urdf import read_urdf
from zerobeam.model.kinematics.robot import Robot


def pose(robot: Robot, joints: Matrix) -> tuple[Matrix, Matrix]:
    rotation, position = robot.flange_pose(ca.SX(joints))
    return np.array(ca.DM(rotation)), np.array(ca.DM(position))[:, 0]


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
        (turn, position), (other_turn, other_place) = pose(robot, joints), pose(other, joints)
        np.testing.assert_allclose(position, other_place, atol=apart_mm, rtol=0)
        np.testing.assert_allclose(turn, other_turn, atol=2e-5, rtol=0)
    for mine, theirs in ((robot.upper, other.upper), (-robot.lower, -other.lower)):
        assert (np.abs(mine - theirs) <= np.radians(further_deg)).all()


def test_the_reach_of_the_stretched_arms_is_as_published() -> None:
    # Straight up: base to flange, mm, of the lengths in the data sheets.
    assert set(built_in_robots()) >= {"irb1600", "panda", "iiwa14", "gen3_lite"}
    heights = {"iiwa14": 360 + 420 + 400 + 126, "gen3_lite": 243.3 + 280 + 245 + 105}
    for name, height in heights.items():
        robot = load_robot(name, Path())
        assert pose(robot, np.zeros(robot.n))[1][2] == pytest.approx(height)
    panda = load_robot("panda", Path())
    # The elbow's offsets of 82.5 mm cancel; the hand looks down from 88 mm before the wrist.
    assert pose(panda, np.zeros(7))[1] == pytest.approx([88, 0, 333 + 316 + 384 - 107])


def test_every_built_in_arm_states_its_vendor_and_offsets_keep_it() -> None:
    vendors = {name: load_robot(name).vendor for name in built_in_robots()}
    assert None not in vendors.values()
    assert {"irb1600": "abb", "iiwa14": "kuka", "panda": "franka"}.items() <= vendors.items()
    robot = load_robot("irb1600")
    assert robot.with_offsets(np.zeros(6)).vendor == "abb"


def test_a_vendor_is_optional_and_one_of_a_list(tmp_path: Path) -> None:
    text = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    mine = tmp_path / "mine.yaml"
    mine.write_text(text.replace("vendor: abb\n", ""), encoding="utf-8")
    assert load_robot(mine).vendor is None
    mine.write_text(text.replace("vendor: abb", "vendor: Abb"), encoding="utf-8")
    with pytest.raises(BadInput, match="vendor"):
        load_robot(mine)
