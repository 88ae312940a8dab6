"""CSV files with columns of their own for targets, shots, spots, times and markers, and decimal commas."""

import numpy as np
import pytest
from import_files import import_csv
from recorded_logs import HEADER, POSTURES, moves

from zerobeam.experiments.makers.generic.layouts import NO_DWELLS, CsvLayout, Stillness
from zerobeam.model.files.run import read_run, write_run

LASER = """\
robot: irb1600
tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
"""
TOP = "t,target,nr,a6,a1,a2,a3,a4,a5,dx,dy"
COLUMNS = [f"a{i}" for i in range(1, 7)]


@pytest.fixture
def read(tmp_path):
    def call(text, targets=(), header=LASER, still=NO_DWELLS, **options):
        path, top = tmp_path / "shots.csv", tmp_path / "header.yaml"
        path.write_text(text)
        top.write_text(header)
        layout = CsvLayout("deg", **options)
        return import_csv([path], list(targets), layout, top, tmp_path / "run.jsonl", still=still)

    return call


def rows():
    lines = [TOP]
    for i, joints in enumerate(POSTURES):
        turned = joints[[5, 0, 1, 2, 3, 4]]
        values = [500 + 1000 * i, "left" if i < 2 else "right", 10 + i, *turned, 0.1 * i, -0.2]
        lines.append(",".join(map(str, values)))
    return "\n".join(lines) + "\n"


ALL = {
    "header_row": True,
    "columns": COLUMNS,
    "target_column": "target",
    "shot_column": "nr",
    "spot_columns": ["dx", "dy"],
    "time_column": "t",
    "time_units": "ms",
}


def test_every_column_that_a_shot_can_have(read, tmp_path):
    found = read(rows(), **ALL)
    assert [shot.target for shot in found.shots] == ["left", "left", "right", "right"]
    assert [shot.shot for shot in found.shots] == [10, 11, 12, 13]
    assert [shot.time_s for shot in found.shots] == [0.0, 1.0, 2.0, 3.0]
    np.testing.assert_allclose([shot.spot_mm for shot in found.shots], [[0.1 * i, -0.2] for i in range(4)])
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)
    for told in ("target: column target", "spot in mm (dx, dy): column dx, dy", "time in ms: column t"):
        assert told in found.understood
    write_run(tmp_path / "run.jsonl", found.header, found.shots)
    run = read_run(tmp_path / "run.jsonl")
    assert all(shot.spot_mm is not None for shot in run.shots)
    assert run.target_names == ("left", "right")


def test_columns_by_number(read, refused):
    numbers = ["5", "6", "7", "8", "9", "4"]
    found = read(rows(), ["a"], header_row=True, columns=numbers)
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)
    bare = rows().split("\n", 1)[1]
    found = read(bare, columns=numbers, target_column="2")
    assert [shot.target for shot in found.shots] == ["left", "left", "right", "right"]
    assert refused(read, bare, ["a"], columns=[*numbers[:5], "12"]).allowed == "1 to 11"
    assert "there is no column" in refused(read, bare, ["a"], columns=[*numbers[:5], "0"]).what
    assert "no header row" in refused(read, bare, ["a"], columns=COLUMNS).what
    assert refused(read, bare, columns=numbers, target_column="target").allowed == "1 to 11"


def test_decimal_commas(read, refused):
    text = "\n".join(";".join(str(value + 0.5).replace(".", ",") for value in row) for row in POSTURES)
    found = read(text, ["a"], delimiter=";", decimal=",")
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES + 0.5)
    error = refused(read, text, ["a"], delimiter=";")
    assert "holds no numbers" in error.what
    error = refused(read, text.replace("10,5", "10.5"), ["a"], delimiter=";", decimal=",")
    assert error.allowed == "finite numbers with a decimal comma"
    assert "are the same" in refused(read, text, ["a"], delimiter=",", decimal=",").what
    assert "decimal sign" in refused(read, text, ["a"], decimal="'").what


def test_fanuc_csv(read):
    text = "\n".join(",".join(map(str, row)) for row in POSTURES)
    found = read(text, ["a"], j3="ground")
    expected = POSTURES.copy()
    expected[:, 2] += POSTURES[:, 1]
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], expected)


def test_what_does_not_go_together(read, refused):
    def what(text, *args, **changes):
        return refused(read, text, *args, **{**ALL, **changes}).what

    assert "both by name and by a column" in what(rows(), ["a"])
    assert "one target name" in what(rows(), target_column=None)
    assert "unit of the times" in what(rows(), time_units=None)
    assert "has not 2 columns" in what(rows(), spot_columns=["dx"])
    assert "is not a measurement number" in what(rows().replace(",11,", ",1.5,"))
    assert "duplicate" in what(rows().replace(",11,", ",10,"))
    assert "column 10 is not a finite number" in what(rows().replace(",0.1,", ",nan,"))
    assert "a probe records no spot_mm" in what(rows(), header=HEADER)
    assert "'tool'" in what(rows().replace("left", "tool"))
    still = Stillness(0.02, 0.5)
    assert "what counts as a dwell" in what(rows(), marker_column="nr")
    assert "column of times" in what(rows(), still=still, time_column=None)
    assert "no number of its own" in what(rows(), still=still)
    assert "without markers" in what(rows(), still=still, shot_column=None)


def log(times, joints, marks):
    spots = np.where(np.arange(len(times)) % 2, 0.3, 0.1)
    lines = ["t,target,mark,a1,a2,a3,a4,a5,a6,dx,dy"]
    for i, (time, row) in enumerate(zip(times, joints, strict=True)):
        target = "left" if time < 3 else "right"
        lines.append(",".join(map(str, [time, target, marks[i], *row, spots[i], 0.0])))
    return "\n".join(lines) + "\n"


def test_marked_stands_with_targets_and_spots(read):
    times, joints = moves()
    marks = np.zeros(len(times), int)
    marks[[50, 51, 220]] = 1
    found = read(
        log(times, joints, marks),
        header_row=True,
        columns=COLUMNS,
        target_column="target",
        spot_columns=["dx", "dy"],
        time_column="t",
        time_units="s",
        marker_column="mark",
        still=Stillness(0.02, 0.5),
    )
    assert [shot.target for shot in found.shots] == ["left", "right"]
    assert not any("markers beyond" in line for line in found.understood)  # rows 50 and 51 are one marker
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], POSTURES[[0, 2]], atol=1e-9)
    np.testing.assert_allclose([shot.spot_mm for shot in found.shots], [[0.2, 0]] * 2, atol=0.01)


def test_the_times_of_several_files_have_no_common_start(tmp_path):
    paths = [tmp_path / name for name in ("a.csv", "b.csv")]
    for path in paths:
        path.write_text("\n".join(",".join(map(str, [i, *row])) for i, row in enumerate(POSTURES)))
    top = tmp_path / "header.yaml"
    top.write_text(LASER)
    options = {"columns": list("234567"), "time_column": "1", "time_units": "s"}
    both = import_csv(paths, ["a", "a"], CsvLayout("deg", **options), top, tmp_path / "run.jsonl")
    assert {shot.time_s for shot in both.shots} == {None}
    one = import_csv(paths[:1], ["a"], CsvLayout("deg", **options), top, tmp_path / "run.jsonl")
    assert [shot.time_s for shot in one.shots] == [0, 1, 2, 3]


def test_columns_by_the_names_of_joints_in_any_order(read, refused):
    mapped = [f"a{i}=j{i}" for i in (3, 1, 2, 6, 5, 4)]
    found = read(rows(), ["a"], header_row=True, columns=mapped)
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)
    assert "columns by name, joint 1 first: a1, a2, a3, a4, a5, a6" in found.understood
    named = ["a1=joint1", "a2=2", "a3=J3", "a4=joint4", "a5=5", "a6=joint6"]
    np.testing.assert_array_equal(
        [shot.joints_deg for shot in read(rows(), ["a"], header_row=True, columns=named).shots], POSTURES
    )
    error = refused(read, rows(), ["a"], header_row=True, columns=[*mapped[:5], "a4=j7"])
    assert error.what == "the joint of a column is not understood"
    error = refused(read, rows(), ["a"], header_row=True, columns=[*mapped, "t=j4"])
    assert error.what == "duplicate joint"
    assert refused(read, rows(), ["a"], header_row=True, columns=mapped[:5]).found.startswith("a3=j3")


@pytest.mark.parametrize(
    ("top", "what"),
    [
        ("J1 [rad],J2 [rad],J3 [rad],J4 [rad],J5 [rad],J6 [rad]", "another unit"),
        ("j1_deg,j2_deg,j3_deg,j4 (rad),j5 (rad),j6 (rad)", "another unit"),
        ("j1,j3,j2,j4,j5,j6", "not just the joints in their order"),
        ("J1 [°],J2 [°],J3 [°],J4 [°],J6 [°],J5 [°]", "not just the joints in their order"),
    ],
)
def test_a_header_row_that_contradicts_what_is_stated(top, what, read, refused):
    """Whatever the program would make of the numbers, someone wrote down what they are."""
    text = "\n".join([top, *(",".join(map(str, joints)) for joints in POSTURES)])
    error = refused(read, text, ["a"], header_row=True)
    assert what in error.what
    assert error.line == 1
    alike = text.replace(top, "J1 (deg),J2 (deg),J3 deg,j4_deg,5,joint6 [degrees]")
    found = read(alike, ["a"], header_row=True)
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)


def test_spots_in_another_unit_than_mm(read, refused):
    error = refused(
        read, rows().replace("dx,dy", "dx [m],dy [m]"), **ALL | {"spot_columns": ["dx [m]", "dy [m]"]}
    )
    assert error.found == "dx [m], read in mm"
    alike = read(rows().replace("dx,dy", "dx_mm,dy [mm]"), **ALL | {"spot_columns": ["dx_mm", "dy [mm]"]})
    assert alike.shots[1].spot_mm == (0.1, -0.2)


@pytest.mark.parametrize(
    ("sign", "name"), [(",", "comma"), (";", "semicolon"), ("\t", "tab"), ("   ", "blank")]
)
def test_a_delimiter_is_found_and_told(read, sign, name):
    text = "\n".join(sign.join(map(str, row)) for row in POSTURES) + "\n"
    found = read(text, ["a"], delimiter=None)
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)
    assert f"  delimiter found: {name}" in found.understood
    if sign != ",":
        found = read(text.replace(".", ","), ["a"], delimiter=None, decimal=",")
        np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)


def test_a_delimiter_among_decimal_commas(read, refused):
    text = "\n".join(";".join(map(str, row)) for row in POSTURES).replace(".", ",") + "\n"
    assert len(read(text, ["a"], delimiter=None, decimal=",").shots) == 4
    assert "--decimal ," in refused(read, text, ["a"], delimiter=None).remedy
    few = refused(read, "nothing\n", ["a"], delimiter=None)
    assert few.what == "the row has the wrong number of values"
    assert str(few.remedy).startswith("complete the row")
    assert "right file" in str(refused(read, "", ["a"]).remedy)
