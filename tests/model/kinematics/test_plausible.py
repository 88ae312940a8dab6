from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from zerobeam.model.files.header import UrdfRef
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, doubts, load_robot, stated_rows
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
    "a twist with few decimals": ({"alpha_deg: -90": "alpha_deg: -89.95"}, "-89.95 is near -90"),
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
