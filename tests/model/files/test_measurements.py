"""Measurements of instruments of any kind: in runs, journals and plans, from files and from arrays."""

import json

import numpy as np
import pytest
from stub_kinds import quaternion, stub_kinds

import zerobeam as zb
from zerobeam.model.files.header import Header
from zerobeam.model.files.journal import RunJournal
from zerobeam.model.files.plan import Plan, read_plan, write_plan
from zerobeam.model.files.run import Run, read_run, shot_text, write_run
from zerobeam.model.files.shot import shot_model
from zerobeam.model.parsing.validation import validate

LASER = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
INSTRUMENTS = {
    "eye": {"kind": "camera"},
    "left": {"kind": "beacon", "reflectors": {"r1": 1.0, "r2": 1.0}},
    "right": {"kind": "six"},
    "edge": {"kind": "edge"},
    "ball": {"kind": "globe"},
    "beam": LASER,
}
TARGETS = {
    "top": {"kind": "plane", "normal": [0, 0, 1]},
    "bowl": {"kind": "sphere", "diameter_mm": 38.1},
}
J0, J1, J2 = [0, 10, 20, 30, 40, 50], [5, 10, 20, 30, 40, 50], [5, 15, 20, 30, 40, 50]
# One of each, the first two in the same posture.
ROWS = [
    {"posture": 7, "instrument": "left", "reflector": "r1", "joints_deg": J0, "measured_mm": [1, 2, 3]},
    {"posture": 7, "instrument": "left", "reflector": "r2", "joints_deg": J0, "measured_mm": [1.5, 2, 3]},
    {"instrument": "eye", "target": "mark", "joints_deg": J1, "pixel_px": [320.5, 200]},
    {
        "instrument": "right",
        "joints_deg": J2,
        "measured_mm": [1, 2, 3],
        "measured_quat": [0.7071, 0, 0, 0.7071],
    },
    {"instrument": "edge", "target": "top", "joints_deg": J1, "measured_mm": 0.25},
    {"instrument": "ball", "target": "bowl", "joints_deg": J2},
    {"instrument": "beam", "target": "mark", "joints_deg": J2, "spot_mm": [0.5, -0.5], "time_s": 3.5},
    {"instrument": "left", "reflector": "r2", "joints_deg": J1, "measured_mm": [1, 2, 3], "sigma_mm": 0.02},
]
CONTENT = {
    "robot": "irb1600",
    "instruments": INSTRUMENTS,
    "targets": TARGETS,
    "noise": {"joint_deg": 0.01, "spot_mm": 0.1},
}


@pytest.fixture(autouse=True)
def _stubs():
    with stub_kinds():
        yield


def written(path, rows, **content):
    """A run file of these measurements, numbered from 0."""
    lines = [{"schema": "zerobeam/run/1", **CONTENT, **content}]
    lines += [{"shot": i, **row} for i, row in enumerate(rows)]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


@pytest.fixture
def run(tmp_path):
    return read_run(written(tmp_path / "mixed.jsonl", ROWS))


def test_each_measurement_says_what_it_is_of_and_what_was_read(run):
    made = run.measurements
    assert [m.instrument for m in made] == ["left", "left", "eye", "right", "edge", "ball", "beam", "left"]
    assert [m.variant for m in made] == ["r1", "r2", "", "", "", "", "", "r2"]
    assert [m.target for m in made] == [None, None, "mark", None, "top", "bowl", "mark", None]
    assert [m.posture for m in made] == [0, 0, 1, 2, 3, 4, 5, 6]
    assert [m.sigma_mm for m in made] == [None] * 7 + [0.02]
    assert made[0].measured == {"measured_mm": (1.0, 2.0, 3.0)}
    assert made[2].measured == {"pixel_px": (320.5, 200.0)}
    assert made[4].measured == {"measured_mm": (0.25,)}
    assert (made[5].measured, made[6].measured) == ({}, {"spot_mm": (0.5, -0.5)})
    assert run.target_names == ("mark", "top", "bowl")
    np.testing.assert_array_equal(run.target_index, [-1, -1, 0, -1, 1, 2, 0, -1])


def test_a_quaternion_is_of_length_one_for_whoever_calculates_and_stays_as_recorded(run):
    np.testing.assert_allclose(
        run.measurements[3].measured["measured_quat"], quaternion(np.pi / 2), atol=1e-15
    )
    assert run.shots[3].measured_quat == (0.7071, 0.0, 0.0, 0.7071)


def test_a_run_is_written_as_it_was_read(run, tmp_path):
    write_run(tmp_path / "again.jsonl", run.header, run.shots)
    again = read_run(tmp_path / "again.jsonl")
    assert (again.header, again.measurements) == (run.header, run.measurements)
    for shot, row in zip(run.shots, ROWS, strict=True):
        assert json.loads(shot_text(shot)) == {"shot": shot.shot, **row}


def test_a_journal_records_them_and_is_resumed(run, tmp_path):
    path = tmp_path / "journal.jsonl"
    with RunJournal(path, run.header) as journal:
        for shot in run.shots[:4]:
            journal.append(shot)
    with RunJournal.resumed(path, run.header) as journal:
        for shot in run.shots[4:]:
            journal.append(shot)
    assert read_run(path).measurements == run.measurements


def test_a_journal_refuses_what_a_posture_cannot_have(run, tmp_path, refused):
    other = run.shots[1].model_copy(update={"joints_deg": (1.0, *run.shots[1].joints_deg[1:])})
    with RunJournal(tmp_path / "journal.jsonl", run.header) as journal:
        journal.append(run.shots[0])
        assert "joint 1: 0 and 1" in str(refused(journal.append, other))
        journal.append(run.shots[1])
    assert len(read_run(tmp_path / "journal.jsonl").shots) == 2


def columns():
    """ROWS as the argument `measured`, and the targets."""
    keys = dict.fromkeys(key for row in ROWS for key in row if key not in ("target", "joints_deg"))
    return {key: [row.get(key) for row in ROWS] for key in keys}, [row.get("target") for row in ROWS]


def test_the_same_run_from_arrays(run):
    measured, targets = columns()
    again = Run.from_arrays(
        robot="irb1600",
        instruments=INSTRUMENTS,
        joints=[row["joints_deg"] for row in ROWS],
        unit="deg",
        noise=zb.Noise(joint_deg=0.01, spot_mm=0.1),
        targets=targets,
        target_priors=TARGETS,
        measured=measured,
    )
    assert again.measurements == run.measurements
    assert again.sha256 != run.sha256  # the file has other blanks


def test_arrays_of_one_instrument_need_no_names():
    run = Run.from_arrays(
        robot="irb1600",
        instruments={"left": {"kind": "beacon"}},
        joints=[J0, J1],
        unit="deg",
        noise=zb.Noise(joint_deg=0.01),
        measured={"measured_mm": np.arange(6.0).reshape(2, 3)},
    )
    assert [m.measured["measured_mm"] for m in run.measurements] == [(0, 1, 2), (3, 4, 5)]
    assert run.target_names == ()


@pytest.mark.parametrize(
    ("measured", "argument", "words"),
    [
        ({}, "joints", "'measured_mm' is missing"),
        ({"measured_mm": [[1, 2, 3]]}, "measured", "found:   1"),
        ({"measured_mm": 3}, "measured", "measured_mm is not a list"),
        ({"measured_mm": [[1, 2, "3"]] * 2}, "measured", "a reading is not a number"),
        ({"measured_m": [[1, 2, 3]] * 2}, "measured", "did you mean 'measured_mm'?"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(measured, argument, words, refused):
    error = refused(
        Run.from_arrays,
        robot="irb1600",
        instruments={"left": {"kind": "beacon"}},
        joints=[J0, J1],
        unit="deg",
        noise=zb.Noise(joint_deg=0.01),
        measured=measured,
    )
    assert (error.argument, words in str(error)) == (argument, True), error


BEACON, SIX, EYE, EDGE = ROWS[0], ROWS[3], ROWS[2], ROWS[4]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({**BEACON, "instrument": "lef"}, "did you mean 'left'?"),
        ({key: BEACON[key] for key in BEACON if key != "instrument"}, "the key 'instrument' is missing"),
        ({key: BEACON[key] for key in BEACON if key != "reflector"}, "the key 'reflector' is missing"),
        ({**BEACON, "reflector": "r3"}, "r1, r2"),
        ({**EYE, "reflector": "r1"}, "no such reflector of eye"),
        ({**BEACON, "target": "mark"}, "a beacon measures no target"),
        ({key: EYE[key] for key in EYE if key != "target"}, "the key 'target' is missing"),
        ({**EYE, "target": "eye"}, "called as an instrument"),
        ({**EYE, "target": "top"}, "a camera cannot measure a target that is a plane"),
        ({**EDGE, "target": "mark"}, "a edge cannot measure a target that is a point"),
        ({**ROWS[5], "target": "mark"}, "state targets.mark: {kind: sphere, …}"),
        ({**EYE, "spot_mm": [0, 0]}, "a camera records no spot_mm"),
        ({key: EYE[key] for key in EYE if key != "pixel_px"}, "the key 'pixel_px' is missing"),
        ({**EYE, "pixel_px": [1, 2, 3]}, "a list of 2 numbers"),
        ({**EYE, "pixel_px": [1, None]}, "a reading is not a number"),
        ({**EYE, "pixel": [1, 2]}, "did you mean 'pixel_px'?"),
        ({**EDGE, "measured_mm": [1]}, "measured_mm: a number"),
        ({**BEACON, "measured_mm": 1}, "a list of 3 numbers"),
        ({**EYE, "sigma_mm": 1}, "the same noise in every measurement"),
        ({**BEACON, "sigma_mm": 0}, "> 0"),
        ({**SIX, "measured_quat": [1, 0, 0]}, "a quaternion has four numbers"),
        ({**SIX, "measured_quat": [0.7, 0, 0, 0.7]}, "length 0.989949"),
        ({**SIX, "measured_quat": [90, 0, 0, 0]}, "whether these are angles"),
        ({**BEACON, "measured_mm": [1e9, 0, 0]}, "-1e+06 to 1e+06 mm"),
        ({**BEACON, "joints_deg": [1, 2]}, "2"),
    ],
)
def test_a_measurement_that_its_instrument_cannot_make(row, words, tmp_path, refused):
    path = written(tmp_path / "bad.jsonl", [ROWS[6], row])
    error = refused(read_run, path)
    assert (error.file, error.line) == (str(path), 3)
    assert words in str(error)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({**ROWS[1], "joints_deg": J1}, "measurements 0 and 1 state posture 7, but have other joints"),
        ({**ROWS[1], "reflector": "r1"}, "but are of the same instrument"),
        ({**EYE, "posture": 7, "joints_deg": J0}, None),
    ],
)
def test_what_measurements_of_one_posture_share(row, words, tmp_path, refused):
    path = written(tmp_path / "posture.jsonl", [BEACON, row])
    if words is None:
        assert [m.posture for m in read_run(path).measurements] == [0, 0]
        return
    error = refused(read_run, path)
    assert words in error.what
    assert error.line == 3


def test_a_posture_has_one_target(tmp_path, refused):
    eye = {**EYE, "posture": 3}
    path = written(
        tmp_path / "p.jsonl", [eye, {**ROWS[6], "posture": 3, "joints_deg": J1, "target": "other"}]
    )
    assert "have different targets" in refused(read_run, path).what


def test_measurements_of_a_tool_need_no_more_than_before(tmp_path):
    rows = [{"target": "psd", "joints_deg": J0}, {"target": "psd", "joints_deg": J1, "spot_mm": [0.5, 0]}]
    path = tmp_path / "old.jsonl"
    header = {"schema": "zerobeam/run/1", "robot": "irb1600", "tool": LASER, "noise": CONTENT["noise"]}
    path.write_text(
        "".join(json.dumps(r) + "\n" for r in [header, *({"shot": i, **r} for i, r in enumerate(rows))])
    )
    run = read_run(path)
    assert [m.instrument for m in run.measurements] == ["tool", "tool"]
    assert [m.posture for m in run.measurements] == [0, 1]
    assert run.measurements[0].measured == {}
    np.testing.assert_array_equal(run.spots, [[0, 0], [0.5, 0]])


def test_only_what_an_instrument_records_is_a_key():
    header = validate(Header, CONTENT, file=None, line=lambda _: None)
    assert "pixel_px" in shot_model(header).model_fields
    tool = {"robot": "irb1600", "tool": LASER, "noise": CONTENT["noise"]}
    assert "pixel_px" not in shot_model(validate(Header, tool, file=None, line=lambda _: None)).model_fields


PLAN = """\
schema: zerobeam/plan/1
robot: irb1600
instruments:
  left: {kind: beacon, reflectors: {r1: 1, r2: 1}}
  eye: {kind: camera}
noise: {joint_deg: 0.01}
postures_deg:
  - {joints_deg: [0, 10, 20, 30, 40, 50], instrument: left, reflector: r1, posture: 0}
  - {joints_deg: [0, 10, 20, 30, 40, 50], instrument: left, reflector: r2, posture: 0}
  - {joints_deg: [5, 10, 20, 30, 40, 50], instrument: eye, target: mark}
"""


def planned(path, text):
    path.write_text(text)
    return read_plan(path)


def test_a_plan_says_what_each_posture_is_measured_with(tmp_path):
    plan = planned(tmp_path / "plan.yaml", PLAN)
    assert plan.targets == (None, None, "mark")
    assert plan.called == ("r1", "r2", "mark")
    assert [(m.instrument, m.variant, m.posture) for m in plan.measurements] == [
        ("left", "r1", 0),
        ("left", "r2", 0),
        ("eye", "", 1),
    ]
    np.testing.assert_array_equal(plan.target_index, [-1, -1, 0])
    rows = plan.postures * plan.robot.display
    write_plan(tmp_path / "again.yaml", plan.header, np.round(rows, 9), plan.targets, means=plan.means)
    again = read_plan(tmp_path / "again.yaml")
    assert (again.measurements, again.means) == (plan.measurements, plan.means)
    made = Plan.from_arrays(
        robot="irb1600",
        instruments={key: INSTRUMENTS[key] for key in ("left", "eye")},
        postures=[J0, J0, J1],
        unit="deg",
        noise=zb.Noise(joint_deg=0.01),
        targets=plan.targets,
        means=[
            {key: value for key, value in more._asdict().items() if value is not None} for more in plan.means
        ],
    )
    assert (made.measurements, made.means) == (plan.measurements, plan.means)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("r2, posture", "r3, posture", 9, "posture 1: the header states no such reflector of left"),
        ("instrument: eye, ", "", 10, "posture 2: the key 'instrument' is missing"),
        (", target: mark", "", 10, "posture 2: the key 'target' is missing"),
        (
            "[0, 10, 20, 30, 40, 50], instrument: left, reflector: r2",
            "[1, 10, 20, 30, 40, 50], instrument: left, reflector: r2",
            9,
            "have other joints",
        ),
        ("instrument: eye", "instrumen: eye", 10, "did you mean 'instrument'?"),
    ],
)
def test_a_plan_that_does_not_fit_its_header(old, new, line, words, tmp_path, refused):
    error = refused(planned, tmp_path / "plan.yaml", PLAN.replace(old, new))
    assert words in str(error)
    assert error.line == line


def test_postures_of_an_only_instrument_without_targets_are_plain_rows(tmp_path):
    text = (
        PLAN[: PLAN.index("  eye:")]
        + "noise: {joint_deg: 0.01}\npostures_deg:\n  - [0, 10, 20, 30, 40, 50]\n"
    )
    plan = planned(tmp_path / "plan.yaml", text.replace("{r1: 1, r2: 1}", "{r1: 1}"))
    assert (plan.targets, plan.called, plan.means) == ((None,), ("r1",), ())
    write_plan(tmp_path / "again.yaml", plan.header, [J0], plan.targets)
    assert "- [0.0, 10.0, 20.0, 30.0, 40.0, 50.0]" in (tmp_path / "again.yaml").read_text()


@pytest.mark.parametrize(("touches", "enough"), [(2, False), (3, False), (4, True)])
def test_few_numbers_of_a_target_determine_it_at_most(touches, enough, tmp_path, refused):
    rows = [{**EDGE, "joints_deg": [i, *J0[1:]]} for i in range(touches)]
    run = read_run(written(tmp_path / "few.jsonl", rows, targets={"top": TARGETS["top"]}))
    if enough:
        run.require_analysable()
        return
    error = refused(run.require_analysable)
    assert f"'top' is measured with {touches} numbers" in error.what
    assert error.line == 2


def test_planes_of_a_datum_cube_need_fewer(tmp_path):
    rows = [{**EDGE, "joints_deg": [i, *J0[1:]]} for i in range(4)]
    rows += [{**EDGE, "target": "side", "joints_deg": [i, *J1[1:]]} for i in range(2)]
    targets = {"top": TARGETS["top"], "side": {"kind": "plane", "normal": [1, 0, 0]}}
    angles = [{"between": ["top", "side"], "deg": 90, "sigma_deg": 0.01}]
    read_run(written(tmp_path / "cube.jsonl", rows, targets=targets, angles=angles)).require_analysable()
