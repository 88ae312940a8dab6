"""Robot files from the lengths of data sheets: other arms of each maker, whose files have other sources."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zerobeam.experiments.command_options import NewRobotOptions
from zerobeam.experiments.new_robot import LIKE, content_of, typed_lengths, write_robot
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot, read_robot

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
    write_robot(path, content_of("mine", NewRobotOptions(vendor, sheet=lengths, ranges=RANGES))[0])
    mine, arm = read_robot(path), load_robot(name)
    for joints in np.random.default_rng(0).uniform(-100, 100, (5, 6)):
        np.testing.assert_allclose(mine.fk(joints, "deg"), arm.fk(joints, "deg"), rtol=0, atol=1e-8)
    assert mine.conventions.below_base == arm.conventions.below_base
    assert mine.conventions.joint3 == arm.conventions.joint3
    with pytest.raises(BadInput, match="exists already"):
        write_robot(path, {})


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
        content_of("a", options)


def test_lengths_that_are_missing_are_named() -> None:
    with pytest.raises(BadInput, match="forearm: from axis 3 to axis 5"):
        typed_lengths("height=1, upper=2, wrist=4")
    with pytest.raises(BadInput, match="no such length"):
        typed_lengths("hight=1")
