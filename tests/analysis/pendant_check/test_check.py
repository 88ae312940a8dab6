"""Twelve mistakes of home-made robot files, by two poses of the pendant; and what two poses cannot say."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from zerobeam.analysis.pendant_check.pose_check import PendantCheck, _file_changes, check_poses
from zerobeam.analysis.pendant_check.poses import (
    FORM_OF_VENDOR,
    Counting,
    PendantPose,
    entries,
    levers,
    poses_along,
)
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.header import UrdfRef
from zerobeam.model.files.robot_file import RobotFile, load_robot, stated_rows
from zerobeam.model.kinematics.orientation import orientation
from zerobeam.model.options import PoseAngles
from zerobeam.words.pendant_check import check_sentences

POSTURES = ((20.0, -30.0, 40.0, 50.0, -60.0, 70.0), (-35.0, 25.0, -10.0, -80.0, 45.0, 110.0))
ARMS = ("gp7", "ur5e", "kr6_r900", "lrmate_200id", "tx2_60", "irb120")
Wrong = tuple[RobotFile, Counting]


def numbers_shown(pose: Matrix, form: PoseAngles) -> tuple[tuple[float, ...], float]:
    """A pose as a pendant rounds it, and the last digit of its orientation."""
    forms = orientation(pose[:3, :3])
    angles, digits = {
        "quaternion": (forms.quaternion, 5),
        "abc": (forms.abc, 3),
        "wpr": (forms.roll_pitch_yaw, 3),
        "rotation-vector": (forms.rotation_vector, 4),
        "xyz": (forms.xyz, 3),
        "zyz": (forms.zyz, 3),
    }[form]
    return (*np.round(pose[:3, 3], 2).tolist(), *np.round(angles, digits).tolist()), 10.0**-digits


def right_reading(file: RobotFile) -> Counting:
    return Counting(FORM_OF_VENDOR[file.vendor or ""], file.pendant.joint3 or "link")


def shown_poses(name: str, postures: object = POSTURES) -> list[PendantPose]:
    """What the pendant of a built-in arm shows: by its own forward kinematics, not by that of the check."""
    file, robot = stated_rows(name, Path()), load_robot(name)
    poses = []
    for counted in np.array(postures):
        between = counted + (counted[1] * (np.arange(6) == 2) if file.pendant.joint3 == "ground" else 0.0)
        numbers, digit = numbers_shown(robot.fk(between, "deg"), right_reading(file).form)
        poses.append(PendantPose(tuple(counted.tolist()), numbers, 0.01, 0.01, digit))
    return poses


def with_row(file: RobotFile, number: int, **values: float) -> RobotFile:
    rows = list(file.joints)
    rows[number - 1] = rows[number - 1].model_copy(update=values)
    return file.model_copy(update={"joints": tuple(rows)})


def longest(file: RobotFile) -> tuple[int, str]:
    """Number and key of the longest link."""
    lengths = [
        (abs(getattr(row, key)), i, key)
        for i, row in enumerate(file.joints, start=1)
        for key in ("a_mm", "d_mm")
    ]
    return max(lengths)[1:]


def other_way(file: RobotFile, reading: Counting) -> Wrong:
    """Joint 5 moves the other way: what is before and behind it is turned about x by half a turn."""
    before, row = file.joints[3], file.joints[4]
    turned = with_row(file, 4, alpha_deg=before.alpha_deg + 180)
    values = {"alpha_deg": row.alpha_deg + 180, "d_mm": -row.d_mm, "theta_deg": -row.theta_deg}
    return with_row(turned, 5, **values), reading


def longer(file: RobotFile, reading: Counting) -> Wrong:
    number, key = longest(file)
    return with_row(file, number, **{key: getattr(file.joints[number - 1], key) + 12.5}), reading


def swapped(file: RobotFile, reading: Counting) -> Wrong:
    number, _ = longest(file)
    row = file.joints[number - 1]
    return with_row(file, number, a_mm=row.d_mm, d_mm=row.a_mm), reading


def other_joint3(file: RobotFile, reading: Counting) -> Wrong:
    return file, replace(reading, joint3="link" if reading.joint3 == "ground" else "ground")


def other_angles(file: RobotFile, reading: Counting) -> Wrong:
    if reading.form == "quaternion":  # has no other order: that of the file's own angles then
        flange = file.flange.model_copy(update={"rpy_deg": (10.0, 20.0, 30.0)})
        return file.model_copy(update={"flange": flange}), reading
    return file, replace(reading, form="zyz")


def in_radians(file: RobotFile, reading: Counting) -> Wrong:
    rows = (
        row.model_copy(
            update={"alpha_deg": math.radians(row.alpha_deg), "theta_deg": math.radians(row.theta_deg)}
        )
        for row in file.joints
    )
    return file.model_copy(update={"joints": tuple(rows)}), reading


def in_metres(file: RobotFile, reading: Counting) -> Wrong:
    rows = (row.model_copy(update={"a_mm": row.a_mm / 1000, "d_mm": row.d_mm / 1000}) for row in file.joints)
    return file.model_copy(update={"joints": tuple(rows)}), reading


MISTAKES: Mapping[str, tuple[Callable[[RobotFile, Counting], Wrong], str]] = {
    "sign of a joint": (other_way, "direction of joint 5"),
    "zero of joint 2": (
        lambda file, reading: (with_row(file, 2, theta_deg=file.joints[1].theta_deg + 90), reading),
        "theta_deg of joint 2",
    ),
    "a length": (longer, "LONGEST"),
    "a and d": (swapped, "a_mm and d_mm of joint LONGEST"),
    "sign of a twist": (
        lambda file, reading: (with_row(file, 4, alpha_deg=-file.joints[3].alpha_deg), reading),
        "alpha_deg of joint 4",
    ),
    "joint 3 from the ground": (other_joint3, "pendant.joint3"),
    "no flange": (lambda file, reading: (with_row(file, 6, d_mm=0), reading), "d_mm of joint 6"),
    "height of the base": (
        lambda file, reading: (with_row(file, 1, d_mm=file.joints[0].d_mm - 330), reading),
        "d_mm of joint 1",
    ),
    "order of the angles": (other_angles, "order of the pose's angles"),
    "radians": (in_radians, "all angles of the rows"),
    "metres": (in_metres, "a_mm and d_mm of all joints"),
    "convention": (
        lambda file, reading: (file.model_copy(update={"convention": "modified"}), reading),
        "convention",
    ),
}


def expected_entry(mistake: str, file: RobotFile) -> str:
    entry = MISTAKES[mistake][1]
    number, key = longest(file)
    return entry.replace("joint LONGEST", f"joint {number}").replace("LONGEST", f"{key} of joint {number}")


def checked(name: str, mistake: str, postures: object = POSTURES) -> tuple[PendantCheck, str]:
    file = stated_rows(name, Path())
    wrong, reading = MISTAKES[mistake][0](file, right_reading(file))
    return check_poses(wrong, reading, shown_poses(name, postures)), expected_entry(mistake, file)


@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.one_in(3)
def test_each_of_twelve_mistakes_is_named_by_two_poses(mistake: str) -> None:
    check, entry = checked("gp7", mistake)
    assert not check.agrees
    entries = [suspect.entry for suspect in check.suspects]
    assert entry in entries
    assert len(entries) <= 2, entries  # the other is the same arm: a flange or a base frame
    assert check.same_arm
    assert entry.partition(" of ")[0] in " ".join(check_sentences(check))


def test_the_right_file_agrees_and_nothing_is_unchecked() -> None:
    for name in ("gp7", "lrmate_200id"):
        file = stated_rows(name, Path())
        check = check_poses(file, right_reading(file), shown_poses(name))
        assert check.agrees
        assert check.suspects == ()
        assert check.unchecked == ()


def test_a_posture_with_joints_at_zero_says_what_it_does_not_check() -> None:
    file = stated_rows("gp7", Path())
    check = check_poses(
        file, right_reading(file), shown_poses("gp7", [(0, 0, 0, 0, 0, 0), (40, 0, 20, 0, 30, 0)])
    )
    assert check.agrees
    unchecked = {change.entry for change in check.unchecked}
    assert {"direction of joint 2", "direction of joint 4", "pendant.joint3"} <= unchecked
    assert "direction of joint 5" not in unchecked


def test_two_mistakes_at_once_are_not_blamed_on_one_entry() -> None:
    file = stated_rows("gp7", Path())
    wrong = with_row(with_row(file, 2, a_mm=455.0), 5, theta_deg=10.0)
    check = check_poses(wrong, right_reading(file), shown_poses("gp7"))
    assert not check.agrees
    assert check.suspects == ()
    assert "two entries or more" in " ".join(check_sentences(check))


def test_a_tool_that_is_active_is_told_from_a_wrong_file() -> None:
    file, robot = stated_rows("gp7", Path()), load_robot("gp7")
    tool = np.eye(4)
    tool[:3, 3] = 10, -20, 150
    poses = []
    for counted in POSTURES:
        numbers, digit = numbers_shown(robot.fk(counted, "deg") @ tool, "wpr")
        poses.append(PendantPose(counted, numbers, 0.01, 0.01, digit))
    check = check_poses(file, right_reading(file), poses)
    assert check.suspects == ()
    assert check.tool is not None
    np.testing.assert_allclose(check.tool[:3, 3], [10, -20, 150], atol=0.5)
    assert check.frame is None


def test_lengths_of_a_joint_whose_name_has_a_unit_in_it_are_in_mm() -> None:
    robot = load_robot("gp7")
    joints = list(robot.joints)
    longer = joints[2].fixed + 20.0 * np.eye(4)[:, [0]] * np.eye(4)[3]
    joints[2] = replace(joints[2], name="j3_deg", fixed=longer)
    wrong = replace(robot, joints=tuple(joints))
    check = check_poses(wrong, right_reading(stated_rows("gp7", Path())), shown_poses("gp7"))
    (said,) = (line for line in check_sentences(check) if "origin x of joint j3_deg" in line)
    assert said.replace("\u00a0", " ").endswith("is 20 mm; 0 mm ± 0.2 mm agrees.")


def test_poses_levers_and_entries_are_those_of_the_arm(shared_data: Path) -> None:
    urdf = UrdfRef(
        urdf=str(shared_data / "mukca" / "urdf" / "panda.urdf"), base="panda_link0", tip="panda_link8"
    )
    rng = np.random.default_rng(0)
    for source, robot in (
        *((stated_rows(name, Path()), load_robot(name)) for name in ("gp7", "panda")),
        (load_robot(urdf), load_robot(urdf)),
    ):
        for joints in rng.uniform(-2, 2, (5, robot.n)):
            poses = poses_along(robot, joints)
            np.testing.assert_allclose(poses[-1], robot.fk(joints, "rad"), atol=1e-8)
            jacobian = np.linalg.norm(robot.jacobian(joints, "rad")[:3], axis=0)
            np.testing.assert_allclose(levers(robot, poses), jacobian, atol=1e-6)
        assert len({entry.name for entry in entries(source)}) == len(list(entries(source)))
        for entry in entries(source):
            same = poses_along(entry.arm(entry.value), joints)[-1]
            np.testing.assert_allclose(same, poses[-1], atol=1e-8, err_msg=entry.name)
            other = entry.value + 40.0
            angle = np.radians(other)
            courses = (1.0, np.cos(angle), np.sin(angle)) if entry.turns else (1.0, other)
            parts = entry.parts(lambda arm, at=joints: poses_along(arm, at)[-1])
            whole = sum(course * part for course, part in zip(courses, parts, strict=True))
            moved = poses_along(entry.arm(other), joints)[-1]
            np.testing.assert_allclose(whole, moved, atol=1e-8, err_msg=entry.name)


@pytest.mark.long
@pytest.mark.parametrize("mistake", MISTAKES)
@pytest.mark.parametrize("name", ARMS)
def test_the_wrong_entry_is_among_the_suspects_of_every_arm_and_posture(name: str, mistake: str) -> None:
    if (name, mistake) in {("irb120", "order of the angles")}:
        pytest.skip("a quaternion has no order of angles")
    rng = np.random.default_rng(1)
    for _ in range(10):
        postures = np.round(rng.uniform(15, 110, (2, 6)) * rng.choice([-1, 1], (2, 6)), 2)
        check, entry = checked(name, mistake, postures)
        entries = [suspect.entry for suspect in check.suspects]
        assert entry in entries or check.agrees, (postures, entries)
        assert not check.agrees or mistake == "height of the base"


def test_angles_in_radians_are_tried_of_all_and_of_each_kind_alone() -> None:
    """The kinds are α and θ; β is changed with all angles only."""
    file = with_row(stated_rows("irb120", Path()), 2, alpha_deg=2.0, theta_deg=3.0, beta_deg=4.0)
    degree = math.degrees(1)
    found = {
        change[1]: tuple(getattr(change[4].joints[1], key) for key in ("alpha_deg", "theta_deg", "beta_deg"))
        for change in _file_changes(file)
        if change[0] == "radians"
    }
    assert found == {
        "all angles of the rows": pytest.approx((2 * degree, 3 * degree, 4 * degree)),
        "alpha_deg of all joints": pytest.approx((2 * degree, 3.0, 4.0)),
        "theta_deg of all joints": pytest.approx((2.0, 3 * degree, 4.0)),
    }
