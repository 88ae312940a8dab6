"""Bags are written by the library itself, as ROS would write them."""

import builtins
import contextlib
import sqlite3

import numpy as np
import pytest
from import_files import import_ros
from recorded_logs import POSTURES, moves

from zerobeam.experiments.makers.generic.layouts import Stillness
from zerobeam.model.files.run import read_run, write_run

pytest.importorskip("rosbags")

from ros_bags import Bag, file_of

KINDS = ["ros1", "sqlite3", "mcap"]
STILL = Stillness(0.02, 0.5)


def read(bag, header, tmp_path, targets=("a",), **options):
    return import_ros([bag], list(targets), header, tmp_path / "run.jsonl", still=STILL, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_stands_of_a_real_bag_become_shots(tmp_path, header, kind):
    bag = Bag(kind).states(*moves()).write(tmp_path)
    found = read(bag, header, tmp_path)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    assert [shot.target for shot in found.shots] == ["a"] * 4
    times = [shot.time_s for shot in found.shots]
    np.testing.assert_allclose(np.diff(times), 1.6, atol=0.02)
    told = "\n".join(found.understood)
    assert "joint states on /joint_states, in radians by definition of JointState" in told
    assert "joints by name, joint 1 first: joint1, joint2, joint3, joint4, joint5, joint6" in told
    assert "dwell 1: 0.5" in told
    assert "every dwell is a measurement" in told
    write_run(tmp_path / "run.jsonl", found.header, found.shots)
    assert len(read_run(tmp_path / "run.jsonl").shots) == 4


@pytest.mark.parametrize("kind", ["sqlite3", "mcap"])
def test_the_file_of_a_bag_without_its_folder(tmp_path, header, kind):
    bag = file_of(Bag(kind).states(*moves()).write(tmp_path))
    assert bag.suffix == {"sqlite3": ".db3", "mcap": ".mcap"}[kind]
    assert len(read(bag, header, tmp_path).shots) == 4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.one_in(3)
def test_joints_are_taken_by_name_in_the_stated_order(tmp_path, header, kind, refused):
    order = [3, 0, 5, 1, 4, 2]
    times, joints = moves()
    names = [f"arm_{i}" for i in order]
    bag = Bag(kind).states(times, joints[:, order], names)
    bag.states(times[::7] + 1e-4, np.zeros((len(times[::7]), 1)), ["gripper"])
    path = bag.write(tmp_path)
    columns = [f"arm_{i}" for i in range(6)]
    found = read(path, header, tmp_path, columns=columns)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES, atol=1e-9)
    error = refused(read, path, header, tmp_path)
    assert "have no joint 'joint1'" in error.what
    assert "arm_3" in error.found
    error = refused(read, path, header, tmp_path, columns=[*columns[:5], "arm_55"])
    assert "did you mean 'arm_5'?" in error.remedy
    assert "one name is required" in refused(read, path, header, tmp_path, columns=columns[:5]).what


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.one_in(3)
def test_markers_choose_the_stands_and_name_the_targets(tmp_path, header, kind, refused):
    times, joints = moves()
    bag = Bag(kind).states(times, joints).marker(1.1, "left").marker(4.3, "right").marker(4.4, "right")
    found = read(bag.write(tmp_path), header, tmp_path, targets=(), marker_topic="/shot")
    assert [shot.target for shot in found.shots] == ["left", "right"]
    np.testing.assert_allclose([s.joints_deg for s in found.shots], POSTURES[[0, 2]], atol=1e-9)
    told = "\n".join(found.understood)
    assert "dwells without a marker, not imported: 2" in told
    assert "second and later markers in a dwell: 1; each dwell is one measurement" in told
    assert "measurements at markers on /shot" in told
    again = tmp_path / "again"
    again.mkdir()
    bag.marker(4.5, "left")
    error = refused(read, bag.write(again), header, tmp_path, targets=(), marker_topic="/shot")
    assert "different targets" in error.what


def test_markers_without_text_want_a_target(tmp_path, header, refused):
    bag = Bag("mcap").states(*moves()).marker(1.1).write(tmp_path)
    assert [shot.target for shot in read(bag, header, tmp_path, marker_topic="/shot").shots] == ["a"]
    error = refused(read, bag, header, tmp_path, targets=(), marker_topic="/shot")
    assert "do not name a target" in error.what
    assert "one target name" in refused(read, bag, header, tmp_path, targets=()).what
    error = refused(read, bag, header, tmp_path, marker_topic="/shots")
    assert error.remedy == "did you mean '/shot'?"


def test_a_marker_while_the_arm_moves(tmp_path, header, refused):
    bag = Bag("ros1").states(*moves(stand_s=1.0, move_s=2.0)).marker(4.0, "a").write(tmp_path)
    error = refused(read, bag, header, tmp_path, targets=(), marker_topic="/shot")
    assert "did not dwell at a marker" in error.what
    assert "marker at 4.000 s; nearest dwell" in error.found


def test_topics_must_be_plain(tmp_path, header, refused):
    times, joints = moves()
    bag = Bag("mcap").states(times, joints).states(times, joints, topic="/other/joint_states").marker(1.0)
    path = bag.write(tmp_path)
    error = refused(read, path, header, tmp_path)
    assert "several topics" in error.what
    assert error.found == "/joint_states, /other/joint_states"
    assert len(read(path, header, tmp_path, topic="/joint_states").shots) == 4
    assert "no joint states" in refused(read, path, header, tmp_path, topic="/shot").what
    error = refused(read, path, header, tmp_path, topic="/joint_state")
    assert error.remedy == "did you mean '/joint_states'?"
    none = tmp_path / "none"
    none.mkdir()
    bare = Bag("mcap").marker(1.0).write(none)
    assert "no joint states" in refused(read, bare, header, tmp_path).what
    assert "no such file" in refused(read, tmp_path / "x.bag", header, tmp_path).what


def test_positions_that_are_no_numbers_and_values_beyond_the_limits(tmp_path, header, refused):
    times, joints = moves()
    joints[50, 2] = np.nan
    error = refused(read, Bag("ros1").states(times, joints).write(tmp_path), header, tmp_path)
    assert "position of joint 'joint3' is not a finite number" in error.what
    assert "joint3 nan" in error.found
    (tmp_path / "log.bag").unlink()
    times, joints = moves(np.degrees(POSTURES))  # a driver that publishes degrees
    error = refused(read, Bag("ros1").states(times, joints).write(tmp_path), header, tmp_path)
    assert "outside its limits" in error.what
    assert "radians?" in error.remedy


@pytest.mark.parametrize("kind", KINDS)
def test_a_torn_or_corrupted_bag_gives_one_message(tmp_path, header, kind, refused):
    path = file_of(Bag(kind).states(*moves(rate=50)).write(tmp_path))
    whole = path.read_bytes()
    assert len(read(path, header, tmp_path).shots) == 4
    for share in (0.02, 0.3, 0.6, 0.9, 0.999):
        path.write_bytes(whole[: int(len(whole) * share)])
        error = refused(read, path, header, tmp_path)
        assert "cannot be read" in error.what or "incomplete" in error.what, error
        assert error.file == str(path)
    path.write_bytes(np.random.default_rng(0).bytes(5000))
    assert "cannot be read" in refused(read, path, header, tmp_path).what
    path.write_bytes(b"")
    assert "cannot be read" in refused(read, path, header, tmp_path).what


def test_a_bag_with_fewer_messages_than_it_says(tmp_path, header, refused):
    path = Bag("sqlite3").states(*moves()).write(tmp_path)
    with contextlib.closing(sqlite3.connect(file_of(path))) as store:
        (count,) = store.execute("SELECT COUNT(*) FROM messages").fetchone()
        store.execute("DELETE FROM messages WHERE id % 50 = 0")
        store.commit()
    error = refused(read, path, header, tmp_path)
    assert "incomplete" in error.what
    assert error.allowed == f"{count}, as the bag itself says"


def test_without_the_library_one_message_says_what_to_install(tmp_path, header, refused, monkeypatch):
    bag = Bag("mcap").states(*moves()).write(tmp_path)
    real = builtins.__import__

    def missing(name, *args, **kwargs):
        if name.startswith("rosbags"):
            raise ImportError(name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", missing)
    assert refused(read, bag, header, tmp_path).remedy == 'pip install "zerobeam[ros]"'
