import errno
import hashlib
import json
import os

import numpy as np
import pytest

from zerobeam.model.errors import BadInput
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import read_run, shot_text, write_run
from zerobeam.model.files.shot import Shot

HEADER = {
    "schema": "zerobeam/run/1",
    "robot": "irb1600",
    "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
}
JOINTS = [10.0, 20.0, -30.0, 40.0, 50.0, -60.0]


def shot(number, **changes):
    content = {"shot": number, "target": "psd", "joints_deg": [value + number for value in JOINTS], **changes}
    return {key: value for key, value in content.items() if value is not ...}


def text(*rows, header=HEADER, **changes):
    top = {key: value for key, value in {**header, **changes}.items() if value is not ...}
    return "".join(row if isinstance(row, str) else json.dumps(row) + "\n" for row in (top, *rows))


@pytest.fixture
def run_file(tmp_path):
    def write(content):
        path = tmp_path / "run.jsonl"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


FOUR = [shot(0), shot(1, target="b", spot_mm=[0.5, -0.25]), shot(2), shot(3, target="b", time_s=12.5)]


def test_a_run_in_internal_units(run_file):
    path = run_file(text(*FOUR))
    run = read_run(path)
    run.require_analysable()
    assert run.robot.name == "irb1600"
    np.testing.assert_allclose(run.joints[2], np.radians(np.array(JOINTS) + 2))
    np.testing.assert_array_equal(run.spots, [[0, 0], [0.5, -0.25], [0, 0], [0, 0]])
    assert [shot.spot_mm is not None for shot in run.shots] == [False, True, False, False]
    assert run.target_names == ("psd", "b")
    np.testing.assert_array_equal(run.target_index, [0, 1, 0, 1])
    assert run.lines == (2, 3, 4, 5)
    assert run.warnings == ()
    assert run.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_blank_lines_and_foreign_line_ends_do_not_count(run_file):
    rows = text(*FOUR).replace("\n", "\r\n\r\n")
    run = read_run(run_file("\ufeff" + rows))
    assert run.lines == (3, 5, 7, 9)
    assert run.warnings == ()


def test_a_prismatic_joint_stays_in_millimetres(tmp_path, run_file):
    (tmp_path / "scara.yaml").write_text(
        "schema: zerobeam/robot/1\nname: scara\nconvention: standard\njoints:\n"
        "  - {a_mm: 300, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: -130, upper_deg: 130}\n"
        "  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_mm: 0, upper_mm: 400}\n"
    )
    rows = [shot(i, joints_deg=[90, 100 + i]) for i in range(3)]
    noise = {"joint_deg": 0.01, "joint_mm": 0.02, "spot_mm": 0.1}
    run = read_run(run_file(text(*rows, robot="scara.yaml", noise=noise)))
    np.testing.assert_allclose(run.joints, [[np.pi / 2, 100], [np.pi / 2, 101], [np.pi / 2, 102]])


def test_wherever_the_last_line_breaks_off_the_rest_is_used(run_file):
    whole = text(*FOUR)
    start = whole.rindex("{")
    for end in range(start + 1, len(whole) - 1):
        run = read_run(run_file(whole[:end]))
        assert len(run.shots) == 3, whole[start:end]
        assert len(run.warnings) == 1
        assert run.warnings[0].startswith("line 5, the last, is torn")


def test_a_last_line_that_lacks_only_its_line_end_is_whole(run_file):
    run = read_run(run_file(text(*FOUR).rstrip("\n")))
    assert len(run.shots) == 4
    assert run.warnings == ()


@pytest.mark.parametrize("tail", [b"\0" * 300, b'{"shot":4,\0\0\0', b"\xff\xfe", b'{"shot":4,"tar\n'])
def test_a_tail_of_no_meaning_is_torn_too(run_file, tail):
    run = read_run(run_file(text(*FOUR).encode() + tail))
    assert len(run.shots) == 4
    assert "torn" in run.warnings[0]


def test_a_broken_line_in_the_middle_is_an_error(run_file, refused):
    error = refused(read_run, run_file(text(shot(0), '{"shot":1,"tar\n', shot(2))))
    assert "not JSON" in error.what
    assert error.line == 3
    error = refused(read_run, run_file(text(shot(0)).encode() + b"\xff\n" + text(shot(2)).encode()))
    assert error.line == 3
    assert "UTF-8" in error.what


@pytest.mark.parametrize(
    ("rows", "what", "line"),
    [
        ([shot(0, speed=1)], "unknown key 'speed'", 2),
        ([shot(0), shot(1, joints=JOINTS, joints_deg=...)], "unknown key 'joints'", 3),
        ([shot(0, target=...)], "'target' is missing", 2),
        ([shot(0, target="")], "cannot be a name", 2),
        ([shot(-1)], "shot is out of range", 2),
        ([shot(0, shot=1.0)], "shot is not a whole number", 2),
        ([shot(0, shot=True)], "shot is not a whole number", 2),
        ([shot(0, joints_deg=JOINTS[:5])], "wrong number of joints", 2),
        ([shot(0, joints_deg=[*JOINTS, 1])], "wrong number of joints", 2),
        ([shot(0, joints_deg=[])], "not a list of numbers", 2),
        ([shot(0, joints_deg=[*JOINTS[:2], None, *JOINTS[3:]])], "joint 3 is not a number", 2),
        ([shot(0, joints_deg=[*JOINTS[:5], "60"])], "joint 6 is not a number", 2),
        ([shot(0), text(header=shot(1, joints_deg=[float("nan")] * 6)), shot(2)], "not finite", 3),
        ([shot(0), text(header=shot(1, joints_deg=[float("nan")] * 6))], "not finite", 3),
        ([shot(0, spot_mm=[1, 2, 3])], "spot_mm is not a pair", 2),
        ([shot(0, spot_mm=[1, "2"])], "item 2 of spot_mm", 2),
        ([shot(0), shot(1), shot(0)], "duplicate measurement number 0", 4),
        ([shot(0), HEADER, shot(1)], "a second header", 3),
        ([shot(0), [1, 2], shot(1)], "is not keys and values", 3),
        ([shot(0), '{"shot":1,"shot":2}\n'], "duplicate", 3),
        ([shot(0, joints_deg=[190.0, *JOINTS[1:]])], "joint 1 is outside its limits", 2),
        ([], "no measurements", None),
        (['{"shot":0,"tar'], "no measurements", None),
    ],
)
def test_shots_that_cannot_be_used(run_file, refused, rows, what, line):
    path = run_file(text(*rows))
    error = refused(read_run, path)
    assert what in error.what, error
    assert error.line == line, error
    assert error.file == str(path)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"schema": ...}, "not a run file"),
        ({"schema": "zerobeam/plan/1"}, "not a run file"),
        ({"robot": "irb1601"}, "no robot of this name"),
        ({"robot": "none.yaml"}, "file of the robot is not there"),
        ({"robot": {"urdf": "none.urdf", "base": "a", "tip": "b"}}, "file of the robot is not there"),
        ({"tol": {}}, "unknown key 'tol'"),
        ({"noise": ...}, "'noise' is missing"),
        ({"noise": {"joint_deg": [0.1, 0.1], "spot_mm": 0}}, "wrong number of values"),
    ],
)
def test_headers_that_cannot_be_used(run_file, refused, changes, what):
    error = refused(read_run, run_file(text(*FOUR, **changes)))
    assert what in error.what
    assert error.line == 1


def test_files_that_are_no_runs(run_file, refused):
    assert "header is not on the first line" in refused(read_run, run_file(text(header=shot(0)))).what
    assert "empty" in refused(read_run, run_file("")).what
    assert "binary" in refused(read_run, run_file(b"\x89PNG\0\0\n\0\0")).what
    error = refused(read_run, run_file("1.0,2.0,3.0\n1.0,2.0,3.0\n"))
    assert "not JSON" in error.what
    assert error.line == 1
    assert "not a run file" in refused(read_run, run_file("12\n")).what


def test_a_probe_makes_no_spot(run_file, refused):
    tool = {"kind": "probe", "point_mm": [0, 0, 100]}
    assert len(read_run(run_file(text(shot(0), shot(1), tool=tool))).shots) == 2
    error = refused(read_run, run_file(text(shot(0), shot(1, spot_mm=[0, 0]), tool=tool)))
    assert "a probe records no spot_mm" in error.what
    assert error.line == 3


def test_a_joint_outside_its_limits_names_value_and_range(run_file, refused):
    far = [*JOINTS[:4], 120.5, JOINTS[5]]
    error = refused(read_run, run_file(text(shot(0), shot(1, joints_deg=far))))
    assert error.what == "measurement 1: joint 5 is outside its limits"
    assert error.found == "120.5 deg"
    assert error.allowed.startswith("-115 to 115 deg (irb1600")
    assert "or is it another arm?" in error.remedy
    assert "limits: warn" in error.remedy
    assert error.line == 3


def test_a_limit_itself_is_inside(run_file):
    edge = [[180, -90, -245, 200, 115, -400], [-180, 120, 65, -200, -115, 400]]
    assert read_run(run_file(text(*[shot(i, joints_deg=row) for i, row in enumerate(edge)]))).warnings == ()


def test_with_limits_warn_the_shots_are_named_and_used(run_file):
    far = [*JOINTS[:4], 120.5, JOINTS[5]]
    rows = [shot(0), shot(7, joints_deg=far), shot(9, joints_deg=[*far[:4], -130, far[5]])]
    run = read_run(run_file(text(*rows, limits="warn")))
    assert len(run.shots) == 3
    assert run.warnings == (
        "joint 5 is outside its limits (-115 to 115 deg), up to -130 deg, in 2 of 3 measurements: 7, 9",
    )


def small(number, scale=1.0):
    return shot(number, joints_deg=[scale * np.radians(value + number) for value in JOINTS])


def test_angles_in_radians_are_asked_about(run_file, refused, tmp_path):
    run = read_run(run_file(text(small(0), small(1))))
    assert len(run.warnings) == 1
    assert run.warnings[0].startswith("radians?")
    # One shot in degrees: no doubt any more.
    assert read_run(run_file(text(small(0), shot(1)))).warnings == ()
    # Where radians fall outside the limits, the error asks.
    (tmp_path / "one.yaml").write_text(
        "schema: zerobeam/robot/1\nname: one\nconvention: standard\njoints:\n"
        "  - {a_mm: 300, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_deg: 20, upper_deg: 130}\n"
    )
    error = refused(read_run, run_file(text(shot(0, joints_deg=[1.5]), robot="one.yaml")))
    assert "radians?" in error.remedy
    error = refused(read_run, run_file(text(shot(0, joints_deg=[0.1]), robot="one.yaml")))
    assert "radians?" not in error.remedy


def test_degrees_that_were_converted_twice_are_asked_about(run_file, refused):
    rows = [shot(i, joints_deg=[np.degrees(value + i) for value in JOINTS]) for i in range(2)]
    error = refused(read_run, run_file(text(*rows)))
    assert "radians?" in error.remedy
    assert "57.3" in error.remedy
    assert "state deg as their unit" in error.remedy
    # A slip in one value is no question of units.
    slip = refused(read_run, run_file(text(shot(0, joints_deg=[190.0, *JOINTS[1:]]))))
    assert "radians?" not in slip.remedy


def test_a_run_of_one_shot_tells_nothing(run_file, refused):
    error = refused(read_run(run_file(text(shot(0)))).require_analysable)
    assert "one measurement can neither determine nor test" in error.what
    assert "at least 4" in error.allowed
    assert error.line == 2
    tool = {**HEADER["tool"], "calibrated": False}
    error = refused(read_run(run_file(text(shot(0), tool=tool))).require_analysable)
    assert "at least 6" in error.allowed


def test_a_target_seen_once(run_file, refused):
    rows = [shot(0), shot(1), shot(2, target="pds"), shot(3)]
    error = refused(read_run(run_file(text(*rows))).require_analysable)
    assert "'pds' is measured only once" in error.what
    assert error.found == "measurement 2"
    assert error.line == 4
    assert "did you mean 'psd'?" in error.remedy


def test_a_distance_to_an_unknown_target(run_file, refused):
    distances = [{"between": ["psd", "c"], "mm": 50, "sigma_mm": 0.1}]
    error = refused(read_run(run_file(text(*FOUR, distances=distances))).require_analysable)
    assert error.found == "c"
    assert error.allowed == "psd, b"
    distances[0]["between"] = ["psd", "b"]
    read_run(run_file(text(*FOUR, distances=distances))).require_analysable()


def test_targets_of_the_header_that_no_shot_has_are_told(run_file):
    run = read_run(run_file(text(*FOUR, targets={"psd": {}, "bb": {}})))
    assert len(run.warnings) == 2
    assert "'bb', but no measurement" in run.warnings[0]
    assert "'b' is not among" in run.warnings[1]


def model(**changes):
    return Header.model_validate({**{k: v for k, v in HEADER.items() if k != "schema"}, **changes})


SHOTS = [Shot.model_validate(content) for content in FOUR]


def test_what_was_written_is_read_again_to_the_last_digit(tmp_path):
    values = np.random.default_rng(3).uniform(-80, 60, (5, 6))
    shots = [Shot(shot=i, target="Größe 1", joints_deg=tuple(row)) for i, row in enumerate(values.tolist())]
    write_run(tmp_path / "r.jsonl", model(), shots)
    run = read_run(tmp_path / "r.jsonl")
    assert list(run.shots) == shots
    assert run.header.schema_ == "zerobeam/run/1"
    assert run.header.noise == model().noise
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.jsonl"]


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"target": 'a "ß", b', "joints_deg": [0.1, -0.0, 1e-7, 1e5, 1 / 3, 5]},
        {"spot_mm": [1e-12, 2], "time_s": 0.0},
        {"time_s": 1e12},
        {"comment": 'the beam "flickers"'},
    ],
)
def test_the_line_of_a_shot_is_json_without_blanks(changes):
    values = Shot.model_validate(shot(7, **changes))
    content = {key: value for key, value in values if value is not None}
    assert shot_text(values) == json.dumps(content, ensure_ascii=False, separators=(",", ":")) + "\n"


def test_nothing_is_overwritten_and_nothing_unsound_is_written(tmp_path, refused):
    path = tmp_path / "r.jsonl"
    path.write_text("mine")
    assert "exists already" in refused(write_run, path, model(), SHOTS).what
    assert path.read_text() == "mine"
    other = tmp_path / "other.jsonl"
    assert "duplicate" in refused(write_run, other, model(), [SHOTS[0], SHOTS[0]]).what
    assert "no measurements" in refused(write_run, other, model(), []).what
    assert "no robot" in refused(write_run, other, model(robot="nobody"), SHOTS).what
    assert "does not exist" in refused(write_run, tmp_path / "no" / "r.jsonl", model(), SHOTS).what
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.jsonl"]


def test_a_write_that_fails_leaves_nothing(tmp_path, refused, monkeypatch):
    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    assert "No space left" in refused(write_run, tmp_path / "r.jsonl", model(), SHOTS).what
    assert list(tmp_path.iterdir()) == []


def test_shots_of_one_and_the_same_posture_are_refused(run_file):
    """Nothing can be fitted to them; one posture that differs is enough to be let through."""
    same = [shot(number, joints_deg=JOINTS) for number in range(5)]
    with pytest.raises(BadInput, match="are of one posture") as refused:
        read_run(run_file(text(*same))).require_analysable()
    assert "5 measurements" in str(refused.value)
    read_run(run_file(text(*same, shot(5)))).require_analysable()
