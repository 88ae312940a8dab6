"""Poses as other programs write them: found, asked or read as stated; never taken for what they are not."""

import numpy as np
import pytest
from command_line import zerobeam
from pose_runs import pose_run, postures
from scipy.spatial.transform import Rotation

from zerobeam.model.files.run import read_run

HEADER = """\
robot: ur5e
instruments:
  cam: {kind: pose, frame: free, guess_mm: [1500, 500, 600], sigma_mm: 0.1, sigma_deg: 0.03, mount: {}}
noise: {joint_deg: 0.01}
"""
ALL, WRIST = (1, 2, 3, 4, 5, 6), (6,)
TRUTH = {"delta2": 0.4, "delta3": -0.6, "delta5": 0.5, "cam.mount.rx": 30.0}
COMMON = ["--joint-columns", "j1,j2,j3,j4,j5,j6", "--joint-units", "deg", "--units", "mm"]
QUATERNION = ["--quaternion-columns", "q1,q2,q3,q4"]


@pytest.fixture(scope="module")
def runs():
    return {moving: pose_run(postures(20, moving), TRUTH) for moving in (ALL, WRIST)}


@pytest.fixture
def imported(tmp_path, runs):
    """Import the poses of a run, as `written` (w x y z and position of each) puts them into a table."""

    def call(moving, written, *options, count=20):
        rows = []
        for shot in runs[moving].shots[:count]:
            quaternion, position = written(np.array(shot.measured_quat), np.array(shot.measured_mm))
            rows.append(",".join(f"{value:.12g}" for value in (*position, *quaternion, *shot.joints_deg)))
        names = ",".join(f"q{i + 1}" for i in range(len(quaternion)))
        table = tmp_path / "poses.csv"
        table.write_text("\n".join([f"X,Y,Z,{names},j1,j2,j3,j4,j5,j6", *rows]), encoding="utf-8")
        (tmp_path / "header.yaml").write_text(HEADER, encoding="utf-8")
        files = [table, "--header", tmp_path / "header.yaml", "-o", tmp_path / "run.jsonl", "--force"]
        answer = zerobeam("import", "points", *files, *COMMON, *options)
        return answer, None if answer.status else read_run(tmp_path / "run.jsonl")

    return call


def as_it_is(quaternion, position):
    return quaternion, position


def w_last(quaternion, position):
    return np.roll(quaternion, -1), position


def inverse_rotation(quaternion, position):
    return quaternion * [1, -1, -1, -1], position


def inverse_pose(quaternion, position):
    turn = Rotation.from_quat(quaternion, scalar_first=True).inv()
    return turn.as_quat(scalar_first=True), -turn.apply(position)


def require_right(run, of):
    np.testing.assert_allclose(
        [shot.measured_mm for shot in run.shots], [shot.measured_mm for shot in of.shots], atol=1e-6
    )
    turns = [
        Rotation.from_quat([shot.measured_quat for shot in one.shots], scalar_first=True) for one in (run, of)
    ]
    assert np.degrees((turns[0] * turns[1].inv()).magnitude()).max() < 1e-6


CASES = {
    w_last: ("with w last", ["--quaternion-columns", "q4,q1,q2,q3"]),
    inverse_rotation: ("as inverse rotations", [*QUATERNION, "--inverse", "rotation"]),
    inverse_pose: ("as inverse poses", [*QUATERNION, "--inverse", "pose"]),
}


@pytest.mark.parametrize("written", CASES)
def test_another_reading_that_fits_is_named_and_what_it_says_reads_it(written, imported, runs):
    answer, run = imported(ALL, written, *QUATERNION)
    what, options = CASES[written]
    assert run is None
    assert f"the poses fit the nominal arm {what}, and not as stated" in answer.err
    assert f"state {' '.join(options[-2:])}" in answer.err
    answer, run = imported(ALL, written, *options)
    assert answer.status == 0
    require_right(run, runs[ALL])


def test_poses_that_fit_as_they_are_stated_are_read(imported, runs):
    answer, run = imported(ALL, as_it_is, *QUATERNION)
    assert answer.status == 0
    require_right(run, runs[ALL])


def test_where_two_readings_fit_it_is_asked(imported, runs):
    """Rotations about one axis alone: turned about they are those of a mount that is turned about."""

    def turned_alone(quaternion, position):
        return quaternion, np.zeros(3)

    answer, _ = imported(WRIST, turned_alone, *QUATERNION)
    assert answer.status == 2
    assert "the poses fit the nominal arm both as stated and as inverse" in answer.err
    assert "--inverse none, where they are as stated" in answer.err
    assert imported(WRIST, turned_alone, *QUATERNION, "--inverse", "none")[0].status == 0


@pytest.mark.parametrize("inverse", ["rotation", "pose"])
def test_what_is_stated_is_not_looked_at(inverse, imported):
    """Who states that they are inverse poses is believed."""
    assert imported(ALL, as_it_is, *QUATERNION, "--inverse", inverse)[0].status == 0


def test_few_poses_are_read_as_stated(imported):
    assert imported(ALL, w_last, *QUATERNION, count=4)[0].status == 0


def test_joints_that_do_not_belong_to_the_poses_are_no_matter_of_the_poses(imported, runs):
    order = iter(np.random.default_rng(0).permutation(20))
    shots = runs[ALL].shots

    def shuffled(quaternion, position):
        other = shots[int(next(order))]
        return np.array(other.measured_quat), np.array(other.measured_mm)

    assert imported(ALL, shuffled, *QUATERNION)[0].status == 0


def test_rotation_vectors_are_read(imported, runs):
    def vector(quaternion, position):
        return Rotation.from_quat(quaternion, scalar_first=True).as_rotvec(), position

    columns = ["--rotation-columns", "q1,q2,q3", "--rotation-units", "rad"]
    for euler in ("vector", "find"):
        answer, run = imported(ALL, vector, *columns, "--euler", euler)
        assert answer.status == 0
        assert "vector" in answer.out
        require_right(run, runs[ALL])


def test_an_inverse_without_an_orientation_is_refused(imported):
    answer, _ = imported(ALL, as_it_is, "--inverse", "pose")
    assert "an inverse is stated, but no orientation" in answer.err


MARKERS = """\
n,x1,y1,z1,x2,y2,z2,j1,j2,j3,j4,j5,j6
1,1,2,3,4,5,6,10,-20,30,5,40,0.5
2,7,8,9,,,,-15,-25,35,0.5,35,20
3,11,12,13,14,15,16,60,5,-10,80,35,20.5
"""
TRACKER = """\
robot: irb1600
instruments:
  leica: {kind: tracker, frame: free, guess_mm: [2500, 500, 600], sigma_mm: 0.05, reflectors: {A: {}, B: {}}}
noise: {joint_deg: 0.01}
"""


def of_markers(tmp_path, *options, table=MARKERS):
    (tmp_path / "markers.csv").write_text(table, encoding="utf-8")
    (tmp_path / "tracker.yaml").write_text(TRACKER, encoding="utf-8")
    files = [tmp_path / "markers.csv", "--header", tmp_path / "tracker.yaml", "-o", tmp_path / "m.jsonl"]
    return zerobeam("import", "points", *files, *COMMON, *options)


@pytest.mark.parametrize("columns", [[], ["--columns", "x1,y1,z1,x2,y2,z2"]])
def test_several_markers_in_a_row_are_measurements_of_one_posture(columns, tmp_path):
    answer = of_markers(tmp_path, "--reflector", "A,B", *columns)
    assert answer.status == 0
    assert "2 markers in a row, A, B: 5 measurements" in answer.out
    shots = read_run(tmp_path / "m.jsonl").shots
    assert [(shot.reflector, shot.measured_mm) for shot in shots] == [
        ("A", (1.0, 2.0, 3.0)),
        ("B", (4.0, 5.0, 6.0)),
        ("A", (7.0, 8.0, 9.0)),
        ("A", (11.0, 12.0, 13.0)),
        ("B", (14.0, 15.0, 16.0)),
    ]
    assert shots[0].posture == shots[1].posture is not None
    assert shots[3].posture == shots[4].posture != shots[0].posture
    assert shots[2].posture is None
    assert shots[1].joints_deg == shots[0].joints_deg == (10.0, -20.0, 30.0, 5.0, 40.0, 0.5)


def test_which_reflector_each_marker_is_must_be_stated(tmp_path):
    answer = of_markers(tmp_path)
    assert answer.status == 2
    assert "a row has the positions of several markers" in answer.err
    assert "--reflector with 2 names" in answer.err
    answer = of_markers(tmp_path, "--reflector", "A", "--columns", "x1,y1,z1")
    assert answer.status == 0
    assert len(read_run(tmp_path / "m.jsonl").shots) == 3


def test_a_marker_that_is_seen_in_part_is_refused(tmp_path):
    answer = of_markers(tmp_path, "--reflector", "A,B", table=MARKERS.replace("7,8,9,,,", "7,8,9,1,,"))
    assert answer.status == 2
    assert "line 3" in answer.err
