import json
import re
import warnings
from pathlib import Path

import numpy as np
import pytest

import zerobeam as zb
from zerobeam.experiments.new_robot import UrdfChain, file_of_chain
from zerobeam.model.files.header import UrdfRef
from zerobeam.model.files.robot_file import (
    BUILT_IN,
    built_in_robots,
    doubts,
    load_robot,
    stated_rows,
)
from zerobeam.model.kinematics.plausible import DoubtfulRobot

# Each change of a UR5e, and what must be said of it.
LENGTHS = ("-392.2", "-425", "162.5", "133.3", "99.7", "99.6")
CHANGES = {
    "all lengths in metres": (
        {length: f"{float(length) / 1000:g}" for length in LENGTHS},
        "lengths look like metres: the largest is a_mm of joint 2: -0.425",
    ),
    "one length in metres": ({"-392.2": "-0.3922"}, "a_mm of joint 3: -0.3922 looks like metres: -392.2 mm"),
    "a twist in radians": ({"alpha_deg: 90": "alpha_deg: 1.5708"}, "1.5708 looks like radians: 90.0002 deg"),
    "a twist of 3.14": ({"alpha_deg: -90": "alpha_deg: 3.14"}, "3.14 looks like radians"),
    "limits in radians": ({"360": "6.28319"}, "all limits are within"),
    "speeds in radians": ({"speed_deg_s: 180": "speed_deg_s: 3.14"}, "makes 3.14 degrees a second"),
    "a twist that is mistyped": ({"alpha_deg: -90": "alpha_deg: -99"}, "joint 5: -99 is near -90"),
    "a twist with few decimals": ({"alpha_deg: -90": "alpha_deg: -89.95"}, "was -90° meant?"),
    "three decimals": ({"alpha_deg: -90": "alpha_deg: -90.046"}, "-90.046° is 0.046° beside a right angle"),
    "1.57 as degrees": ({"alpha_deg: 90": "alpha_deg: 89.9543738"}, "was 90° meant?"),
    "3.141 as degrees": ({"alpha_deg: -90": "alpha_deg: -179.9660431"}, "was -180° meant?"),
    "the rest of 3.141": ({"alpha_deg: -90": "alpha_deg: 0.0339569"}, "was 0° meant?"),
    "micrometres": ({"-392.2": "-392200"}, "beyond any real arm"),
}


def changed(tmp_path: Path, change: dict[str, str]) -> Path:
    text = (BUILT_IN / "ur5e.yaml").read_text(encoding="utf-8")
    for old, new in change.items():
        assert old in text
        text = re.sub(rf"{re.escape(old)}(?![\d.])", new, text)
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("what", CHANGES)
def test_numbers_in_another_unit_are_said(what: str, tmp_path: Path) -> None:
    change, words = CHANGES[what]
    with pytest.warns(DoubtfulRobot) as result:
        load_robot(changed(tmp_path, change))
    sentences = [str(each.message) for each in result]
    assert any(words in sentence for sentence in sentences), sentences
    assert all(sentence.startswith("robot ur5e: ") for sentence in sentences)


def test_no_built_in_robot_is_doubted() -> None:
    assert {name: doubts(stated_rows(name, Path())) for name in built_in_robots()} == dict.fromkeys(
        built_in_robots(), ()
    )


def test_a_calibrated_arm_is_not_doubted(tmp_path: Path) -> None:
    """Lengths and twists off by what calibrations find, with the digits that programs write."""
    rng, text = np.random.default_rng(0), (BUILT_IN / "ur5e.yaml").read_text(encoding="utf-8")
    for _ in range(20):
        mine = re.sub(
            r"(a_mm|d_mm): ([-\d.]+)", lambda m: f"{m[1]}: {float(m[2]) + rng.normal(0, 0.5)!r}", text
        )
        mine = re.sub(
            r"(alpha_deg|theta_deg): ([-\d.]+)",
            lambda m: f"{m[1]}: {float(m[2]) + rng.normal(0, 0.15)!r}",
            mine,
        )
        path = tmp_path / "mine.yaml"
        path.write_text(mine, encoding="utf-8")
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            load_robot(path)


def test_a_urdf_in_millimetres_is_said(tmp_path: Path) -> None:
    path = tmp_path / "arm.urdf"
    path.write_text(
        '<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>'
        '<joint name="one" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 400"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="0"/></joint>'
        '<joint name="end" type="fixed"><parent link="b"/><child link="c"/><origin xyz="300 0 0"/></joint>'
        "</robot>",
        encoding="utf-8",
    )
    with pytest.warns(
        DoubtfulRobot, match="700 m long, beyond any real arm: lengths are in metres in a URDF"
    ):
        load_robot(UrdfRef(urdf=str(path), base="a", tip="c"))


def arm_of(path: Path, *turns: str) -> Path:
    """A URDF of joints one after the other, each with its rpy."""
    links = "".join(f'<link name="l{i}"/>' for i in range(len(turns) + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        f'<origin xyz="0.3 0 0.1" rpy="{turn}"/><axis xyz="0 0 1"/>'
        '<limit lower="-3" upper="3" velocity="1" effort="0"/></joint>\n'
        for i, turn in enumerate(turns)
    )
    path.write_text(f'<robot name="arm">{links}\n{joints}</robot>', encoding="utf-8")
    return path


ROUNDED = {"1.57": "1.570796327 rad (90°)", "-1.57": "1.570796327 rad", "3.141": "3.141592654 rad (180°)"}
ROUNDED |= {"3.14": "(180°)", "1.571": "(90°)", "-4.71": "(270°)", "1.5705": "(90°)"}
EXACT = (
    "0",
    "1.5707963267948966",
    "1.5708",
    "-3.14159",
    "0.7853981634",
    "1.5702837465",
    "0.5",
    "1.6",
    "0.0008",
    "2.356",
)


@pytest.mark.parametrize("angle", ROUNDED)
def test_a_rounded_angle_of_a_urdf_is_said_with_the_value_that_is_meant(angle: str, tmp_path: Path) -> None:
    path = arm_of(tmp_path / "arm.urdf", "0 0 0", f"0 {angle} 0")
    with pytest.warns(DoubtfulRobot) as result:
        robot = load_robot(UrdfRef(urdf=str(path), base="l0", tip="l2"))
    (said,) = map(str, (each.message for each in result))
    assert said.startswith(f"robot arm: arm.urdf, pitch of joint 'j1' (line 3): {angle.strip('-')} rad is ")
    assert ROUNDED[angle] in said
    assert robot.doubts == (said,)
    # One of four decimals that is no rounding of pi / 2 is a doubt alone.
    assert robot.rounded == (() if angle == "1.5705" else (said,))


@pytest.mark.parametrize("angle", EXACT)
def test_an_angle_that_is_exact_or_calibrated_is_not_doubted(angle: str, tmp_path: Path) -> None:
    path = arm_of(tmp_path / "arm.urdf", "0 0 0", f"0 {angle} 0")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert load_robot(UrdfRef(urdf=str(path), base="l0", tip="l2")).doubts == ()


def test_a_rounded_urdf_is_said_of_its_rows_and_by_every_run_and_plan(tmp_path: Path) -> None:
    """`robot new` writes degrees of seven decimals: what was rounded in the URDF is still seen in them."""
    path = arm_of(tmp_path / "arm.urdf", "0 0 0", "-1.57 0 0", "1.57 0 0")
    run, plan = tmp_path / "run.jsonl", tmp_path / "plan.yaml"
    header = {
        "robot": {"urdf": "arm.urdf", "base": "l0", "tip": "l3"},
        "instruments": {"cam": {"kind": "pose", "sigma_mm": 0.1, "sigma_deg": 0.03}},
        "noise": {"joint_deg": 0.01},
    }
    readings = {"measured_mm": [1, 2, 3], "measured_quat": [1, 0, 0, 0]}
    shots = [{"shot": i, "joints_deg": [i, 20 * i, 5], **readings} for i in range(6)]
    lines = [{"schema": "zerobeam/run/1", **header}, *shots]
    run.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    joints = [shot["joints_deg"] for shot in shots]
    plan.write_text(json.dumps({"schema": "zerobeam/plan/1", **header, "postures_deg": joints}), "utf-8")
    with warnings.catch_warnings(action="ignore", category=DoubtfulRobot):
        robot = load_robot(UrdfRef(urdf=str(path), base="l0", tip="l3"))
        read = [zb.read_run(run), zb.read_plan(plan)]
        file = file_of_chain("arm", "abb", UrdfChain(path, "l0", "l3"))
    (said,) = robot.doubts
    assert robot.rounded == robot.doubts
    assert "roll of joint 'j1' (line 3), roll of joint 'j2' (line 4): 1.57 rad" in said
    assert all(said in each.warnings for each in read)
    assert any("° meant?" in doubt for doubt in doubts(file))
