"""Built-in arms against the descriptions that their files name, without Denavit-Hartenberg rows.

Of each description: the origins of the joints and of the flange, mm, each from the one before it in the base
frame at zero; the axes of the joints there; roll, pitch and yaw of the flange.
"""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot, stated_rows

DESCRIBED = {
    "rs007n": ("0 0 360; 0 0 0; 0 0 355; 0 0 92.5; 0 0 282.5; 0 0 78; 0 0 0", "-z -x x z x z", (0, 0, 0)),
    "rs007l": ("0 0 360; 0 0 0; 0 0 455; 0 0 92.5; 0 0 382.5; 0 0 78; 0 0 0", "-z -x x z x z", (0, 0, 0)),
    "rs013n": ("0 0 505; 0 0 0; 0 0 700; 0 0 110; 0 0 650; 0 0 78; 0 0 0", "-z -x x z x z", (0, 0, 0)),
    "rs080n": ("0 0 680; 0 150 0; 0 0 870; 0 0 267; 0 0 813; 0 0 165; 0 0 0", "-z -x x z x z", (0, 0, 0)),
    "crx10ia": ("0 0 0; 0 0 0; 0 0 540; 0 0 0; 540 0 0; 0 -150 0; 160 0 0", "z y -y -x -y -x", (180, -90, 0)),
    "m20id_25": ("0 0 0; 75 0 0; 0 0 840; 0 0 215; 890 0 0; 0 0 0; 90 0 0", "z y -y -x -y -x", (180, -90, 0)),
    "r2000ic_165f": (
        "0 0 0; 312 0 0; 0 0 1075; 0 0 225; 1280 0 0; 0 0 0; 215 0 0",
        "z y -y -x -y -x",
        (180, -90, 0),
    ),
    "irb4600": ("0 0 495; 175 0 0; 0 0 1095; 0 0 175; 1270 0 0; 135 0 0; 0 0 0", "z y y x y x", (0, 90, 0)),
    "irb6640": ("0 0 780; 320 0 0; 0 0 1075; 0 0 200; 1392 0 0; 200 0 0; 0 0 0", "z y y x y x", (0, 90, 0)),
    "crb15000": ("0 0 265; 0 0 0; 0 0 444; 0 0 110; 470 0 0; 101 0 80; 0 0 0", "z y y x y x", (0, 90, 0)),
    "kr16_2": ("0 0 675; 260 0 0; 680 0 0; 670 0 -35; 0 0 0; 0 0 0; 158 0 0", "-z y y -x y -x", (0, 90, 0)),
    "iiwa7": (
        "0 0 147.5; 0 -10.5 192.5; 0 10.5 207.5; 0 10.5 192.5; 0 -10.5 207.5; 0 -70.7 192.5; 0 70.7 91;"
        " 0 0 35",
        "z y z -y z y z",
        (0, 0, 0),
    ),
    "gp8": ("0 0 0; 40 0 0; 0 0 345; 340 0 40; 0 0 0; 0 0 0; 80 0 0", "z y -y -x -y -x", (180, -90, 0)),
    "gp12": ("0 0 0; 155 0 0; 0 0 614; 640 0 200; 0 0 0; 0 0 0; 100 0 0", "z y -y -x -y -x", (180, -90, 0)),
    "gp25": ("0 0 0; 150 0 0; 0 0 760; 0 0 200; 795 0 0; 0 0 0; 100 0 0", "z y -y -x -y -x", (180, -90, 0)),
    "hc10dt": ("0 0 0; 0 0 0; 0 0 700; 0 0 -500; 0 162 0; 0 0 0; 0 0 -170", "z y -y z -y z", (180, 0, 0)),
    "tx2_90": ("0 0 0; 50 0 0; 0 50 425; 0 0 0; 0 0 425; 0 0 100; 0 0 0", "z y y z y z", (0, 0, 0)),
    "rx160": ("0 0 0; 150 0 0; 0 0 825; 0 0 0; 0 0 625; 0 0 110; 0 0 0", "z y y z y z", (0, 0, 0)),
    "m1013": ("0 0 152.5; 0 34.5 0; 0 0 620; 0 0 559; 0 0 0; 0 0 121; 0 0 0", "z y y z y z", (0, 0, 0)),
    "m0609": ("0 0 152.5; 0 6 0; 0 0 411; 0 0 368; 0 0 0; 0 0 121; 0 0 0", "z y y z y z", (0, 0, 0)),
    "tm5_900": (
        "0 0 145.1; 0 0 0; 0 0 429; 0 -122.2 411.5; 0 0 106; 0 -114.4 0; 0 0 0",
        "z y y y z -y",
        (90, 0, 0),
    ),
    "tm12": (
        "0 0 165.2; 0 0 0; 0 0 636.1; 0 -156.3 557.9; 0 0 106; 0 -113.15 0; 0 0 0",
        "z y y y z -y",
        (90, 0, 0),
    ),
    "vs060": (
        "0 0 181.5; 0 0 163.5; 0 0 305; -10 0 164.5; 0 0 135.5; 0 0 70; 0 0 0",
        "z y y z y z",
        (0, 0, 0),
    ),
    "rv2fr": ("0 0 0; 0 0 295; 0 0 230; -50 0 0; 0 0 270; 0 0 70; 0 0 0", "z y y z y z", (0, 0, 0)),
    "rv4frl": ("0 0 0; 0 0 350; 0 0 310; -50 0 0; 0 0 335; 0 0 85; 0 0 0", "z y y z y z", (0, 0, 0)),
    "rv7frl": ("0 0 0; 0 0 400; 0 0 435; -50 0 0; 0 0 470; 0 0 85; 0 0 0", "z y y z y z", (0, 0, 0)),
    "fr3": (
        "0 0 333; 0 0 0; 0 0 316; 82.5 0 0; -82.5 0 384; 0 0 0; 88 0 0; 0 0 -107",
        "z y z -y z -y -z",
        (180, 0, 0),
    ),
    "gen3": (
        "0 0 156.43; 0 -5.375 128.38; 0 -6.375 210.38; 0 -6.375 210.38; 0 -6.375 208.43; 0 0 105.93;"
        " 0 0 105.93; 0 0 61.525",
        "-z y -z y -z y -z",
        (0, 0, 0),
    ),
    "lite6": (
        "0 0 243.5; 0 0 0; 0 0 200.2; 87 0 -227.61; 0 0 0; 0 0 -62.5; 0 0 0",
        "z y -y -z y -z",
        (180, 0, 0),
    ),
    "xarm7": (
        "0 0 267; 0 0 0; 0 0 293; 52.5 0 0; 77.5 0 -342.5; 0 0 0; 76 0 -97; 0 0 0",
        "z y z -y -z y -z",
        (180, 0, 0),
    ),
}
# Reach of the makers' data sheets, mm: from axis 1 to the wrist, or to the flange, with the arm stretched.
TO_WRIST = {
    **{"rs007n": 730, "rs007l": 930, "rs013n": 1460, "rs080n": 2100, "m20id_25": 1831, "irb4600": 2550},
    **{"irb6640": 2800, "kr16_2": 1611, "gp8": 727, "gp12": 1440, "gp25": 1730, "vs060": 605},
    **{"rv2fr": 504, "rv4frl": 649, "rv7frl": 908},
}
TO_FLANGE = {"tx2_90": 1000, "rx160": 1710, "m1013": 1300, "m0609": 900}


def described_pose(name: str, joints_deg: Matrix) -> Matrix:
    origins, axes, flange = DESCRIBED[name]
    steps = np.array([[float(word) for word in step.split()] for step in origins.split(";")])
    turn, position = Rotation.identity(), np.zeros(3)
    for step, axis, angle in zip(steps, axes.split(), joints_deg, strict=False):
        position = position + turn.apply(step)
        vector = np.eye(3)["xyz".index(axis[-1])] * (-1 if axis.startswith("-") else 1)
        turn = turn * Rotation.from_rotvec(vector * np.radians(angle))
    pose = np.eye(4)
    pose[:3, 3] = position + turn.apply(steps[-1])
    pose[:3, :3] = (turn * Rotation.from_euler("xyz", flange, degrees=True)).as_matrix()
    return pose


@pytest.mark.parametrize("name", DESCRIBED)
@pytest.mark.one_in(4)
def test_an_arm_is_that_of_its_description(name: str) -> None:
    robot = load_robot(name)
    slip = np.eye(robot.n)[2] * 0.1
    worst = 0.0
    for joints in np.random.default_rng(0).uniform(robot.lower, robot.upper, (10, robot.n)) * robot.display:
        expected = described_pose(name, joints)
        np.testing.assert_allclose(robot.fk(joints, "deg"), expected, rtol=0, atol=1e-8)
        worst = max(worst, np.abs(described_pose(name, joints + slip) - expected).max())
    assert worst > 0.1  # control: a tenth of a degree would show


@pytest.mark.parametrize("name", [*TO_WRIST, *TO_FLANGE])
def test_the_reach_is_that_of_the_data_sheet(name: str) -> None:
    rows = stated_rows(name, Path()).joints
    wrist = rows[0].a_mm + rows[1].a_mm + np.hypot(rows[2].a_mm, rows[3].d_mm)
    if name in TO_WRIST:
        assert wrist == pytest.approx(TO_WRIST[name], abs=3)
    else:
        assert wrist + rows[5].d_mm == pytest.approx(TO_FLANGE[name], abs=3)


def test_the_payload_class_is_that_of_the_name() -> None:
    classes = {
        "rs080n": 80,
        "gp12": 12,
        "irb6640": 185,
        "kr16_2": 16,
        "rv7frl": 7,
        "r2000ic_165f": 165,
        "ur30": 30,
    }
    for name, payload in classes.items():
        assert stated_rows(name, Path()).payload_kg == payload
