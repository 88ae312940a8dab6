"""Robot files from the lengths of data sheets: other arms of each maker, whose files have other sources."""

from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam

from zerobeam.experiments.command_options import NewRobotOptions
from zerobeam.experiments.new_robot import (
    LIKE,
    UrdfChain,
    file_of_chain,
    stated_arm,
    typed_lengths,
    write_robot,
)
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot, read_robot, read_rows
from zerobeam.model.kinematics.orientation import angles_of
from zerobeam.model.kinematics.robot import Robot

SHEETS = {
    "irb4600": ("abb", "height=495 shoulder=175 upper=1095 elbow=175 forearm=1270 wrist=135"),
    "m20id_25": ("fanuc", "height=425 shoulder=75 upper=840 elbow=215 forearm=890 wrist=90"),
    "rs013n": ("kawasaki", "height=505 upper=700 forearm=760 wrist=78"),
    "kr16_2": ("kuka", "height=675 shoulder=260 upper=680 elbow=-35 forearm=670 wrist=158"),
    "rv7frl": ("mitsubishi", "height=400 upper=435 elbow=50 forearm=470 wrist=85"),
    "tx2_90": ("staubli", "height=478 shoulder=50 side=50 upper=425 forearm=425 wrist=100"),
    "gp12": ("yaskawa", "height=450 shoulder=155 upper=614 elbow=200 forearm=640 wrist=100"),
}
RANGES = ["-170 170 200"] * 6


def test_each_maker_has_a_sheet_here() -> None:
    assert {vendor for vendor, _ in SHEETS.values()} == set(LIKE)


@pytest.mark.parametrize("name", SHEETS)
def test_an_arm_from_its_data_sheet(tmp_path: Path, name: str) -> None:
    vendor, lengths = SHEETS[name]
    path = tmp_path / "mine.yaml"
    file, _ = stated_arm("mine", NewRobotOptions(vendor, sheet=lengths, ranges=RANGES))
    write_robot(path, file)
    mine, arm = read_robot(path), load_robot(name)
    for joints in np.random.default_rng(0).uniform(-100, 100, (5, 6)):
        np.testing.assert_allclose(mine.fk(joints, "deg"), arm.fk(joints, "deg"), rtol=0, atol=1e-8)
    assert mine.conventions.below_base == arm.conventions.below_base
    assert mine.conventions.joint3 == arm.conventions.joint3
    with pytest.raises(BadInput, match="exists already"):
        write_robot(path, file)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (NewRobotOptions("abb"), "neither"),
        (NewRobotOptions("abb", row=["1 2 3"]), "speed optional"),
        (NewRobotOptions("abb", row=["0 0 100 0 90 -90"]), "lower_deg"),
        (NewRobotOptions("abb", sheet="height=1 upper=2 forearm=3 wrist=4"), "a range"),
        (NewRobotOptions("nachi", sheet="", ranges=RANGES), "--row"),
    ],
)
def test_entries_that_make_no_arm_are_refused(options: NewRobotOptions, message: str) -> None:
    with pytest.raises(BadInput, match=message):
        stated_arm("a", options)


def test_lengths_that_are_missing_are_named() -> None:
    with pytest.raises(BadInput, match="forearm: from axis 3 to axis 5"):
        typed_lengths("height=1, upper=2, wrist=4")
    with pytest.raises(BadInput, match="no such length"):
        typed_lengths("hight=1")


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
    write_robot(path, file_of_chain("mine", vendor, chain), chain.head)
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
        file_of_chain("mine", "other", UrdfChain(urdf, "link6", "tool0"))
