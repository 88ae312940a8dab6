"""calibration.yaml of a UR with offsets: read back it is the calibrated arm, in the frames of ROS."""

from pathlib import Path

import numpy as np
import pytest
from cells import LASER, header, plan_of, simulated, varied_postures
from command_line import zerobeam
from exact_runs import demo_runs
from export_runs import TRUTH, saved

from zerobeam.model.files.robot_file import load_robot, read_robot
from zerobeam.model.kinematics.robot import Robot
from zerobeam.model.parsing.reading import read_yaml

JOINTS = np.random.default_rng(5).uniform(-180, 180, (40, 6))


def ur_run(folder: Path, robot: Robot, ref: str = "ur5e", geometry: str | None = "exact") -> Path:
    """A run of a UR with the true offsets TRUTH, as a file."""
    target = (600.0, 0.0, 100.0)
    own = header(LASER, target=target, robot=ref, geometry=geometry)
    plan = plan_of(own, varied_postures(own, robot, target, 16, 4), robot=robot)
    return saved(folder, own, simulated(plan, TRUTH, 1)[1]).path


def same_flange(one: Robot, other: Robot, mm: float = 1e-5) -> bool:
    return bool(np.abs(one.fk(JOINTS, "deg") - other.fk(JOINTS, "deg")).max() < mm)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return ur_run(tmp_path_factory.mktemp("ur"), load_robot("ur5e"))


@pytest.fixture(scope="module")
def exported(run: Path) -> Path:
    out = run.with_name("calibration.yaml")
    told = zerobeam("export", "ur-calibration", run, "-o", out, "--allow-weak")
    assert told.status == 0, told.err
    return out


def test_read_back_it_is_the_calibrated_arm(run: Path, exported: Path, tmp_path: Path) -> None:
    made, back = tmp_path / "corrected.yaml", tmp_path / "back.yaml"
    assert zerobeam("export", "robot", run, "-o", made, "--allow-weak").status == 0
    told = zerobeam("import", "ur-calibration", exported, "--robot", "ur5e", "-o", back)
    assert told.status == 0, told.err
    assert same_flange(read_robot(back), read_robot(made))
    assert not same_flange(read_robot(back), load_robot("ur5e"), 1.0)


@pytest.mark.long
def test_of_a_typical_arm_it_has_the_links_but_what_is_beside_the_last_axis_and_says_so(
    tmp_path: Path,
) -> None:
    run = ur_run(tmp_path, load_robot("ur5e"), geometry=None)
    out, back, made = (tmp_path / name for name in ("calibration.yaml", "back.yaml", "made.yaml"))
    done = zerobeam("export", "ur-calibration", run, "-o", out, "--allow-weak")
    assert done.status == 0, done.err
    said = " ".join(done.out.split())
    assert "NOT IN THIS FILE, as nominal: link6.a, link6.b, link6.alpha, link6.beta, joint2.gravity" in said
    assert "with what this file holds" in said
    assert "link6.d:" in said  # along the axis, where the file has a place
    assert zerobeam("import", "ur-calibration", out, "--robot", "ur5e", "-o", back).status == 0
    beside = [f"--without=link6.{axis}" for axis in ("a", "b", "alpha", "beta")]
    assert zerobeam("export", "robot", run, "-o", made, "--allow-weak", *beside).status == 0
    assert same_flange(read_robot(back), read_robot(made))


def test_its_frames_are_those_of_ros(exported: Path) -> None:
    """ur_description's default_kinematics.yaml of the UR5e, but for the offsets about z."""
    links = read_yaml(exported).data["kinematics"]
    theirs = {
        "shoulder": (0, 0, 0.1625),
        "upper_arm": (0, 0, 0),
        "forearm": (-0.425, 0, 0),
        "wrist_1": (-0.3922, 0, 0.1333),
        "wrist_2": (0, -0.0997, 0),
        "wrist_3": (0, 0.0996, 0),
    }
    for name, place in theirs.items():
        assert [links[name][key] for key in "xyz"] == pytest.approx(place, abs=1e-12)
    assert links["hash"] == "zerobeam_corrected"


def test_the_hash_of_the_arm_is_kept_and_another_arm_refused(
    run: Path, exported: Path, tmp_path: Path
) -> None:
    # As if the factory had found that: the arm with its own calibration, and its robot file.
    factory, arm = tmp_path / "factory.yaml", tmp_path / "theirs.yaml"
    factory.write_text(exported.read_text().replace("zerobeam_corrected", "calib_123"))
    assert zerobeam("import", "ur-calibration", factory, "--robot", "ur5e", "-o", arm).status == 0
    again, out = ur_run(tmp_path, read_robot(arm), "theirs.yaml"), tmp_path / "calibration.yaml"
    against = ("--against", factory, "--allow-weak")
    told = zerobeam("export", "ur-calibration", again, "-o", out, *against)
    assert told.status == 0, told.err
    assert read_yaml(out).data["kinematics"]["hash"] == "calib_123"
    wrong = zerobeam("export", "ur-calibration", run, "-o", tmp_path / "c.yaml", *against)
    assert "analysed with another arm" in wrong.refused()
    kept = zerobeam("export", "ur-calibration", again, "-o", factory, "--against", factory, "--force")
    assert "it would be lost" in kept.refused()


def test_another_vendors_arm_is_refused(tmp_path: Path) -> None:
    told = zerobeam("export", "ur-calibration", demo_runs()[0].path, "-o", tmp_path / "c.yaml")
    assert "is for robots of Universal Robots" in told.refused()
