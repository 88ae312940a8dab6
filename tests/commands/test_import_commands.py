"""`zerobeam import …` as a person calls it: it tells what it understood, then writes a run."""

import numpy as np
import pytest
from command_line import zerobeam
from recorded_logs import HEADER, POSTURES, fanuc_listing, fanuc_position, kuka_list, kuka_point, moves, ur

from zerobeam.model.files.run import read_run


@pytest.fixture
def asked(tmp_path):
    (tmp_path / "header.yaml").write_text(HEADER)
    return ["--header", tmp_path / "header.yaml", "-o", tmp_path / "run.jsonl"]


def written(told, tmp_path):
    """(N, 6) degrees of the run, after a look at what was printed."""
    assert (told.status, told.err) == (0, "")
    assert told.out.endswith(f"4 measurements written to {tmp_path / 'run.jsonl'}\n")
    assert "limits -180.00 to 180.00" in told.out
    return np.degrees(read_run(tmp_path / "run.jsonl").joints)


def test_fanuc(tmp_path, asked):
    (tmp_path / "a.ls").write_text(fanuc_listing("".join(map(fanuc_position, range(1, 5), POSTURES))))
    told = zerobeam("import", "fanuc", tmp_path / "a.ls", "--target", "a", "--j3", "ground", *asked)
    joints = written(told, tmp_path)
    np.testing.assert_allclose(joints[:, 2], POSTURES[:, 2] + POSTURES[:, 1], atol=1e-9)
    # The robot file of an IRB 1600 says that joint 3 is counted from link 2.
    told = zerobeam("import", "fanuc", tmp_path / "a.ls", "--target", "a", "--force", *asked)
    np.testing.assert_allclose(written(told, tmp_path)[:, 2], POSTURES[:, 2], atol=1e-9)


def test_kuka(tmp_path, asked):
    points = [kuka_point(f"XP{i}", row) for i, row in enumerate([*POSTURES, POSTURES[0]])]
    (tmp_path / "a.dat").write_text(kuka_list("".join(points)))
    names = "XP0, XP1,XP2,XP3"
    told = zerobeam("import", "kuka", tmp_path / "a.dat", "--target", "a", "--points", names, *asked)
    np.testing.assert_allclose(written(told, tmp_path), POSTURES, atol=1e-9)


def test_log(tmp_path, asked):
    (tmp_path / "a.csv").write_text(ur(*moves()))
    still = ["--still-deg", "0.02", "--still-s", "0.5"]
    told = zerobeam("import", "log", "ur", tmp_path / "a.csv", "--target", "a", *still, *asked)
    np.testing.assert_allclose(written(told, tmp_path), POSTURES, atol=1e-9)
    assert "dwell 4: " in told.out


def test_csv_of_a_log(tmp_path, asked):
    (tmp_path / "a.csv").write_text(ur(*moves()))
    columns = ",".join(f"actual_q_{i}" for i in range(6))
    layout = ["--units", "rad", "--header-row", "--delimiter", " ", "--columns", columns]
    clock = ["--time-column", "timestamp", "--time-units", "s", "--target", "a"]
    command = ["import", "csv", tmp_path / "a.csv", *layout, *clock, *asked]
    assert "a tolerance and a time" in zerobeam(*command, "--still-deg", "0.02").refused()
    told = zerobeam(*command, "--still-deg", "0.02", "--still-s", "0.5")
    np.testing.assert_allclose(written(told, tmp_path), POSTURES, atol=1e-9)


def test_ros(tmp_path, asked):
    pytest.importorskip("rosbags")
    from ros_bags import Bag

    bag = Bag("mcap").states(*moves())
    for time in (1.1, 2.7, 4.3, 5.9):
        bag.marker(time, "left")
    path = bag.write(tmp_path)
    still = ["--still-deg", "0.02", "--still-s", "0.5", "--marker-topic", "/shot"]
    np.testing.assert_allclose(
        written(zerobeam("import", "ros", path, *still, *asked), tmp_path), POSTURES, atol=1e-9
    )
    assert read_run(tmp_path / "run.jsonl").target_names == ("left",)


def test_a_dry_run_says_the_same_and_writes_nothing(tmp_path, asked):
    rows = (POSTURES * [1, -1, 1, 1, -1, 1]).tolist()
    (tmp_path / "a.csv").write_text("\n".join(",".join(map(str, row)) for row in rows))
    command = ["import", "csv", tmp_path / "a.csv", "--units", "deg", "--target", "a", *asked]
    tried = zerobeam(*command, "--reversed", "j2,joint5", "--dry-run")
    assert (tried.status, tried.err) == (0, "")
    assert tried.out.endswith(f"dry run: nothing was written to {tmp_path / 'run.jsonl'}\n")
    assert not (tmp_path / "run.jsonl").exists()
    told = zerobeam(*command, "--reversed", "j2,joint5")
    np.testing.assert_allclose(written(told, tmp_path), POSTURES, atol=1e-9)
    assert "signs reversed: j2, joint5" in told.out
    assert told.out.splitlines()[:-1] == tried.out.splitlines()[:-1]
    assert "exists already" in zerobeam(*command, "--dry-run").refused()


@pytest.mark.parametrize(("stated", "said"), [("j7", "not understood"), ("j2,joint2", "duplicate joint")])
def test_a_joint_to_be_reversed_is_one_of_the_robot(tmp_path, asked, stated, said):
    (tmp_path / "a.csv").write_text("10,20,30,40,50,60\n")
    command = ["import", "csv", tmp_path / "a.csv", "--units", "deg", "--target", "a", *asked]
    assert said in zerobeam(*command, "--reversed", stated).refused()
