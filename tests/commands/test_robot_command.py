import warnings
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from scipy.spatial.transform import Rotation

from zerobeam.experiments.new_robot import typed_vendor
from zerobeam.model.files.robot_file import BUILT_IN, built_in_robots, load_robot


def test_the_built_in_robots_are_listed() -> None:
    lines = zerobeam("robot", "--list").out.splitlines()
    assert [line.split()[0] for line in lines[1:]] == list(built_in_robots())
    assert zerobeam("robot", "--list", "--json").json == {"robots": list(built_in_robots())}


def test_forward_kinematics_to_hold_against_the_pendant() -> None:
    answer = zerobeam("robot", "kr6_r900", "--joints", "{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}")
    assert answer.status == 0
    assert answer.err == ""
    words = " ".join(answer.out.split())
    assert "525.00\u00a0mm, 0.00\u00a0mm, 890.00\u00a0mm" in answer.out
    assert "A, B, C 0.000°, 90.000°, 0.000° KUKA" in words
    assert "A, B, C (ZYZ) 0.000°, 90.000°, 0.000° Doosan; O, A, T of Kawasaki" in words
    assert "981 mm from the axis of joint 1" in words
    assert "A6 joint6 revolute −350° 350° 615°/s" in words


def test_json_is_what_the_robot_computes() -> None:
    joints = [10.0, -20.0, 30.0, 40.0, -50.0, 60.0]
    told = zerobeam("robot", "ur5e", "--joints", str(joints), "--json").json
    pose = load_robot("ur5e").fk(joints, "deg")
    np.testing.assert_allclose(told["poses"][0]["xyz_mm"], pose[:3, 3])
    turned = Rotation.from_euler("ZYZ", told["poses"][0]["zyz_deg"], degrees=True).as_matrix()
    np.testing.assert_allclose(turned, pose[:3, :3], atol=1e-9)
    assert told["vendor"] == "universal-robots"
    assert len(told["joints"]) == 6
    radians = zerobeam(
        "robot", "ur5e", "--units", "rad", "--joints", str(np.radians(joints).tolist()), "--json"
    ).json
    np.testing.assert_allclose(radians["poses"][0]["xyz_mm"], pose[:3, 3])


def test_joint_3_from_the_ground() -> None:
    ground = zerobeam("robot", "lrmate_200id", "--joints", "0 20 10 0 0 0", "--json").json
    link = zerobeam("robot", "lrmate_200id", "--joints", "0 20 30 0 0 0", "--j3", "link", "--json").json
    assert ground["poses"][0]["xyz_mm"] == link["poses"][0]["xyz_mm"]
    assert (ground["poses"][0]["joints_deg"][2], ground["poses"][0]["counted_deg"][2]) == (
        pytest.approx(30),
        pytest.approx(10),
    )
    assert (ground["joints"][2]["lower"], ground["joints"][2]["upper"]) == (-140, 280)
    assert (link["joints"][2]["lower"], link["joints"][2]["upper"]) == (-70, 205)
    said = " ".join(zerobeam("robot", "lrmate_200id").out.split())
    assert "Joint 3 is counted from the ground (as the robot file of lrmate_200id states)" in said
    assert "Mounting face: at z = −330\u00a0mm" in zerobeam("robot", "lrmate_200id").out
    assert "The encoder of joint 3 measures the angle between links 2 and 3." in said


def test_a_fanuc_whose_file_does_not_say_how_joint_3_is_counted(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    text = (BUILT_IN / "lrmate_200id.yaml").read_text(encoding="utf-8").splitlines(keepends=True)
    keys = ("mounting", "pendant", "limits", "encoder")
    path.write_text("".join(line for line in text if not line.startswith(keys)), encoding="utf-8")
    assert "is not stated: here it is link 2" in " ".join(zerobeam("robot", path).out.split())
    assert "--j3 ground" in zerobeam("robot", path, "--joints", "0 20 10 0 0 0").refused()


def test_pulses_an_axis_a_line(tmp_path: Path) -> None:
    text = (BUILT_IN / "gp7.yaml").read_text(encoding="utf-8")
    counts = "unit: pulse, pulses_per_deg: [1000, 1000, 1000, 500, 1000, 1000]"
    arm = tmp_path / "mine.yaml"
    arm.write_text(text.replace("names: [S, L", f"{counts}, names: [S, L"), encoding="utf-8")
    lines = "S 1000\nL 2000\nU 3000\nR 4000\nB 5000\nT 6000"
    for typed in (lines, f"{lines} pulses", lines.replace("\n", " pulses\n") + " pulses"):
        pose = zerobeam("robot", arm, "--joints", typed, "--json").json["poses"][0]
        assert pose["joints_deg"] == pytest.approx([1, 2, 3, 8, 5, 6])


def test_postures_beyond_the_limits_are_shown_and_said() -> None:
    assert "beyond the limits: A2" in zerobeam("robot", "kr6_r900", "--joints", "0 90 0 0 0 0").out


def test_a_robot_file_in_metres_is_shown_with_a_note(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "schema: zerobeam/robot/1\nname: mine\nconvention: standard\njoints:\n"
        "  - {a_mm: 0, alpha_deg: 1.5708, d_mm: 0.1625, theta_deg: 0, lower_deg: -180, upper_deg: 180}\n"
        "  - {a_mm: -0.425, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -180, upper_deg: 180}\n",
        encoding="utf-8",
    )
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        answer = zerobeam("robot", path)
    assert answer.status == 0
    assert "look like metres" in answer.err
    assert "looks like radians" in answer.err


def test_the_picture_is_a_page_and_overwrites_nothing(tmp_path: Path) -> None:
    page = tmp_path / "arm.html"
    assert zerobeam("robot", "tx2_60", "--picture", page).status == 0
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!doctype html>")
    assert "target" not in text.split("<script")[0].split("</style>")[1].lower().replace("target=", "")
    assert "exists already" in zerobeam("robot", "tx2_60", "--picture", page).err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ((), "which robot?"),
        (("ur5",), "did you mean 'ur5e'?"),
        (("ur5e", "--joints", "1 2 3"), "3 numbers"),
        (("ur5e", "--joints", "[0, 0, 0, 0, 0, 0] rad"), "state --units rad"),
        (("arm.urdf", "--base", "a"), "both --base and --tip"),
    ],
)
def test_bad_input_is_one_message(arguments: tuple[str, ...], said: str) -> None:
    assert said in zerobeam("robot", *arguments).refused()


POSES = (
    ("--joints", "20.00 -30.00 40.00 50.00 -60.00 70.00"),
    ("--joints", "-35.00 25.00 -10.00 -80.00 45.00 110.00"),
)


def with_poses(arm: str) -> list[str]:
    """Options with two postures of a built-in arm and the poses that its pendant shows there."""
    options = []
    for option, joints in POSES:
        pose = zerobeam("robot", arm, option, joints, "--json").json["poses"][0]
        numbers = [*pose["xyz_mm"], *pose["rpy_deg"]]
        shown = " ".join(f"{name}= {value:.2f}" for name, value in zip("XYZWPR", numbers, strict=True))
        options += [option, joints, "--pose", shown]
    return options


@pytest.mark.long
def test_a_file_is_checked_against_poses_of_the_pendant(tmp_path: Path) -> None:
    options = with_poses("gp7")
    right = zerobeam("robot", "gp7", *options)
    assert right.status == 0
    assert "The file agrees with the 2 poses of the pendant" in " ".join(right.out.split())
    path = tmp_path / "mine.yaml"
    text = (BUILT_IN / "gp7.yaml").read_text(encoding="utf-8")
    path.write_text(text.replace("a_mm: 445", "a_mm: 435"), encoding="utf-8")
    wrong = zerobeam("robot", path, *options)
    assert wrong.status == 1
    assert "it is this: - a_mm of joint 2 is 435 mm; 445 mm" in " ".join(
        wrong.out.replace("\u00a0", " ").split()
    )
    check = zerobeam("robot", path, *options, "--json").json["check"]
    assert [(each["entry"], each["is"], each["would_be"]) for each in check["suspects"]] == [
        ("a_mm of joint 2", 435, 445)
    ]
    assert not check["agrees"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gp7", "--pose", "1 2 3 4 5 6"), "in pairs"),
        (("gp7", "--joints", "1 2 3 4 5 6", "--pose", "1 2 3"), "X, Y, Z and three angles"),
        (("irb120", "--joints", "1 2 3 4 5 6", "--pose", "1 2 3 4 5 6"), "q1, q2, q3, q4"),
        (("gen3_lite", "--joints", "1 2 3 4 5 6", "--pose", "1 2 3 4 5 6"), "--angles"),
        (("gp7", *(("--joints", "1 2 3 4 5 6", "--pose", "1 2 3 4 5 6") * 2)), "two postures are the same"),
    ],
)
def test_poses_that_cannot_be_read_are_refused(arguments: tuple[str, ...], message: str) -> None:
    assert message in zerobeam("robot", *arguments).refused()


def test_a_new_robot_of_a_data_sheet_is_written_drawn_and_checked(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    # The upper arm is 27 mm too long.
    lengths = "height=450 shoulder=155 side=0 upper=641 elbow=200 forearm=640 wrist=100"
    sheet = ["--sheet", lengths, *["--range", "-170 170 200"] * 6]
    answer = zerobeam("robot", "new", "-o", path, "--vendor", "yaskawa", *sheet, *with_poses("gp12"))
    assert answer.status == 1, answer.err
    words = " ".join(answer.out.replace("\u00a0", " ").split())
    assert "a_mm of joint 2 is 641 mm; 614 mm" in words
    assert path.with_suffix(".html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert load_robot(path).vendor == "yaskawa"
    again = zerobeam("robot", "new", "-o", path, "--vendor", "yaskawa", *sheet)
    assert "exists already" in again.refused()
    assert "a maker" in zerobeam("robot", "new").refused()
    assert "mine.yaml --vendor doosan" in zerobeam("robot", "new").refused()


M1013 = [
    *("0 -90 152.5 0 -360 360", "620 0 34.5 -90 -360 360", "0 90 0 90 -160 160", "0 -90 559 0 -360 360"),
    *("0 90 0 0 -360 360", "0 0 121 0 -360 360"),
]


def test_a_new_robot_of_rows(tmp_path: Path) -> None:
    new = ("robot", "new", "-o", tmp_path / "mine.yaml", "--vendor", "Doosan")
    assert "a_mm alpha_deg d_mm theta_deg lower_deg upper_deg [speed]" in zerobeam(*new).refused()
    for wrong, reason in (("620 0 34,5 -90 O 360", "the row is not"), ("0 0 1 0 9 -9", "lower_deg")):
        assert reason in zerobeam(*new, "--row", wrong).refused()
    answer = zerobeam(*new, *(word for row in M1013 for word in ("--row", row)))
    assert answer.status == 0, answer.err
    made = load_robot(tmp_path / "mine.yaml")
    assert made.vendor == "doosan"
    np.testing.assert_allclose(
        made.fk(np.full(6, 25.0), "deg"), load_robot("m1013").fk(np.full(6, 25.0), "deg"), atol=1e-9
    )


def test_a_rail_is_shown_in_millimetres(tmp_path: Path) -> None:
    rows = "\n".join(
        [
            "  - {name: rail, kind: prismatic, a_mm: 0, alpha_deg: -90, d_mm: 0, theta_deg: 0,"
            " lower_mm: 0, upper_mm: 2000}",
            "  - {a_mm: 150, alpha_deg: -90, d_mm: 486, theta_deg: 0, lower_deg: -170, upper_deg: 170}",
        ]
    )
    path = tmp_path / "rail.yaml"
    path.write_text(f"schema: zerobeam/robot/1\nname: rail\nconvention: standard\njoints:\n{rows}\n")
    assert "The pendant shows J1, J2, in degrees; prismatic joints in mm." in told_of(path)
    assert "in degrees." in told_of("irb1600")


def told_of(robot: Path | str) -> str:
    return " ".join(zerobeam("robot", robot).out.split())


def test_a_maker_that_there_is_not_is_refused(tmp_path: Path) -> None:
    refusal = zerobeam("robot", "new", "-o", tmp_path / "mine.yaml", "--vendor", "Dosan").refused()
    assert "did you mean 'doosan'?" in refusal
    assert typed_vendor("St\u00e4ubli") == "staubli"
    assert typed_vendor("Universal Robots") == "universal-robots"


def test_a_copy_of_a_built_in_robot_with_the_pulses_of_the_machine(tmp_path: Path) -> None:
    path, pulses = tmp_path / "mine.yaml", "1341.4,-1365.3,1205,1001.25,-980.5,455.1"
    answer = zerobeam("robot", "gp7", "-o", path, "--pulses-per-deg", pulses, "--joints", "0 0 0 0 0 45510")
    assert answer.status == 0, answer.err
    assert "in pulses" in answer.out
    copy, built_in = load_robot(path), load_robot("gp7")
    assert copy.conventions.pulses_per_deg == (1341.4, -1365.3, 1205.0, 1001.25, -980.5, 455.1)
    assert copy.conventions.names == built_in.conventions.names
    np.testing.assert_array_equal(copy.fk(np.full(6, 10.0), "deg"), built_in.fk(np.full(6, 10.0), "deg"))
    assert path.read_text(encoding="utf-8").startswith("# Yaskawa Motoman GP7")
    assert "exists already" in zerobeam("robot", "gp7", "-o", path).refused()
    other = tmp_path / "other.yaml"
    assert zerobeam("robot", path, "-o", other).status == 0
    assert load_robot(other).conventions == copy.conventions
    few = zerobeam("robot", "gp7", "-o", tmp_path / "few.yaml", "--pulses-per-deg", "1,2,3").refused()
    assert "allowed: 6 numbers" in few
    assert "-o mine.yaml" in zerobeam("robot", "gp7", "--pulses-per-deg", pulses).refused()
    assert "only a robot file" in zerobeam("robot", "arm.urdf", "-o", tmp_path / "few.yaml").refused()
