"""Robot files from the chains of URDF files: the same arms, whatever axes and frames the files have."""

from __future__ import annotations

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.experiments.new_robot import write_robot
from zerobeam.experiments.urdf_robot import UrdfChain, content_of_chain
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot, read_robot, read_rows
from zerobeam.model.kinematics.orientation import angles_of
from zerobeam.model.kinematics.robot import Robot

# Crossing, skew and parallel axes, seven joints, axis 1 downwards, a flange turned from the last axis.
ARMS = ("irb120", "ur5e", "iiwa14", "gen3_lite", "gp7", "panda", "kr6_r900")


def signed_axes(rng: np.random.Generator) -> Matrix:
    """(4, 4) turn that takes axes to axes."""
    order = list(permutations(range(3)))[rng.integers(6)]
    turn = np.zeros((4, 4))
    turn[order, range(3)] = rng.choice([-1.0, 1.0], 3)
    turn[3, 3] = 1
    if np.linalg.det(turn) < 0:
        turn[:3, 0] *= -1
    return turn


def urdf_of(robot: Robot, path: Path, digits: int = 15, *, slide: int | None = None) -> Path:
    """A URDF of the arm whose joints turn about or slide along (`slide`, from 1) x, y or z, either way."""
    rng = np.random.default_rng(7)
    lines, back = [f'<robot name="{robot.name}">', '<link name="link0"/>'], np.eye(4)

    def origin(pose: Matrix) -> str:
        xyz, rpy = pose[:3, 3] / 1000, angles_of(pose[:3, :3])
        texts = (" ".join(f"{value:.{digits}g}" for value in values) for values in (xyz, rpy))
        return '<origin xyz="{}" rpy="{}"/>'.format(*texts)

    for number, joint in enumerate(robot.joints, start=1):
        turn = signed_axes(rng)
        axis = " ".join(f"{value:g}" for value in turn[:3, :3] @ joint.axis)
        sliding = number == slide
        lower, upper = (0, 0.3) if sliding else (joint.lower, joint.upper)
        lines += [
            f'<link name="link{number}"/><joint name="axis{number}"'
            f' type="{"prismatic" if sliding else "revolute"}">',
            f'<parent link="link{number - 1}"/><child link="link{number}"/>',
            origin(back @ joint.fixed @ turn.T),
            f'<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" velocity="2"/></joint>',
        ]
        back = turn
    lines += [
        '<link name="tool0"/><joint name="last" type="fixed">'
        f'<parent link="link{robot.n}"/><child link="tool0"/>',
        origin(back @ robot.flange),
        "</joint></robot>",
    ]
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def made_of(urdf: Path, vendor: str = "other") -> Path:
    path = urdf.with_name("mine.yaml")
    chain = UrdfChain(urdf, "link0", "tool0", 12.5)
    write_robot(path, content_of_chain("mine", vendor, chain), chain.head)
    return path


@pytest.mark.one_in(4)
@pytest.mark.parametrize("slide", [None, 3])
@pytest.mark.parametrize("name", ARMS)
def test_the_rows_are_the_arm_of_the_chain(tmp_path: Path, name: str, slide: int | None) -> None:
    urdf = urdf_of(load_robot(name), tmp_path / "arm.urdf", slide=slide)
    chain = {"urdf": str(urdf), "base": "link0", "tip": "tool0"}
    told = zerobeam("robot", urdf, "--base", chain["base"], "--tip", chain["tip"], "--json").json
    made = read_robot(made_of(urdf))
    assert [joint.name for joint in made.joints] == [f"axis{i}" for i in range(1, made.n + 1)]
    np.testing.assert_allclose(made.lower * made.display, [joint["lower"] for joint in told["joints"]])
    assert made.joints[0].speed == pytest.approx(2)
    assert made.conventions.below_base == 12.5
    for joints in np.random.default_rng(0).uniform(-60, 60, (3, made.n)):
        typed = " ".join(str(value) for value in joints)
        options = ("--base", "link0", "--tip", "tool0", "--joints", typed, "--json")
        pose = zerobeam("robot", urdf, *options).json["poses"][0]
        np.testing.assert_allclose(made.fk(joints, "deg")[:3, 3], pose["xyz_mm"], rtol=0, atol=2e-5)
        if slide is None:
            np.testing.assert_allclose(
                made.fk(joints, "deg"), load_robot(name).fk(joints, "deg"), rtol=0, atol=2e-5
            )


@pytest.mark.parametrize("name", ["ur5e", "iiwa14", "gp7"])
def test_rounded_angles_give_the_rows_of_a_table(tmp_path: Path, name: str) -> None:
    """Most URDF files have pi/2 to ten digits: no twist of 89.99999999 degrees, and no beta."""
    rows = read_rows(made_of(urdf_of(load_robot(name), tmp_path / "arm.urdf", 10)))
    angles = [angle for joint in rows.joints for angle in (joint.alpha_deg, joint.theta_deg)]
    assert all(angle % 90 == 0 for angle in angles)
    assert not any(joint.beta_deg for joint in rows.joints)
    assert all(abs(joint.a_mm - round(joint.a_mm, 1)) < 1e-6 for joint in rows.joints)


def test_a_pendant_that_counts_joint_3_from_the_ground(tmp_path: Path) -> None:
    arm = load_robot("lrmate_200id")
    made = read_robot(made_of(urdf_of(arm, tmp_path / "arm.urdf"), "fanuc"))
    assert made.conventions.joint3 == "ground"
    np.testing.assert_allclose(made.lower, arm.lower)
    np.testing.assert_allclose(made.upper, arm.upper)


def test_a_chain_by_options(tmp_path: Path) -> None:
    urdf, path = urdf_of(load_robot("ur5e"), tmp_path / "arm.urdf"), tmp_path / "mine.yaml"
    made = ("robot", "new", "-o", path, "--vendor", "universal-robots", "--urdf", urdf)
    chain = ("--base", "link0", "--tip", "tool0")
    for wrong, said in (
        ((*made, *chain, "--row", "1 2 3"), "stated once"),
        ((*made, *chain, "--convention", "modified"), "stated once"),
        ((*made, "--base", "tool0", "--tip", "link0"), "exchange base and tip"),
        ((*made, "--base", "link0"), "allowed: link0, link1"),
        ((*made[:-2], *chain), "--urdf FILE"),
    ):
        assert said in zerobeam(*wrong).refused()
    assert not path.exists()
    answer = zerobeam(*made, *chain, "--json")
    assert answer.status == 0, answer.err
    assert answer.json["name"] == "mine"
    assert read_robot(path).vendor == "universal-robots"
    assert path.read_text(encoding="utf-8").startswith("# The chain link0 to tool0 of arm.urdf")
    assert path.with_suffix(".html").exists()
    assert "exists already" in zerobeam(*made, *chain).refused()


def test_a_chain_without_joints_is_refused(tmp_path: Path) -> None:
    urdf = urdf_of(load_robot("ur5e"), tmp_path / "arm.urdf")
    with pytest.raises(BadInput, match="no joint moves"):
        content_of_chain("mine", "other", UrdfChain(urdf, "link6", "tool0"))
