"""tests/experiments/makers/generic/test_joint_logs.py."""

import contextlib
import gc
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from import_files import import_csv, import_log
from recorded_logs import HEADER, POSTURES, moves, table, ur

from zerobeam.experiments.makers.contents import contents_of
from zerobeam.experiments.makers.generic.joint_logs import (
    CsvLayout,
    calmest,
    dwell_of_each,
    find_dwells,
    held,
    repeats,
)
from zerobeam.experiments.makers.generic.layouts import Stillness
from zerobeam.experiments.makers.import_jobs import uncollected
from zerobeam.model.files.header import UrdfRef
from zerobeam.model.files.robot_file import BUILT_IN, load_robot
from zerobeam.model.files.run import read_run, write_run

TOLERANCE = np.full(6, 0.02)


def plain_rest(times, joints, tolerance, seconds):
    """(N,) whether the window that begins at each reading is at rest, one after the other."""
    rest = np.zeros(len(times), dtype=bool)
    for i in range(len(times)):
        behind = np.flatnonzero(times >= times[i] + seconds - 1e-9)
        if len(behind):
            window = slice(i, behind[0] + 1)
            small = np.all(np.ptp(joints[window], axis=0) <= tolerance)
            rest[i] = small and np.diff(times[window]).max(initial=0) <= seconds / 2
    return rest


def test_dwells_are_found_where_they_are():
    times, joints = moves(stand_s=1.0, move_s=0.6, rate=100)
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert len(dwells) == len(POSTURES)
    for i, dwell in enumerate(dwells):
        begin = 0.6 + 1.6 * i - 0.01  # the first reading is one step into the first move
        # The ends of a smooth move are within the tolerance as well.
        assert begin - 0.03 < dwell.start_s < begin + 0.02
        assert begin + 0.98 < dwell.end_s < begin + 1.05
        np.testing.assert_allclose(dwell.joints, POSTURES[i], atol=1e-12)
        assert np.all(dwell.spread <= TOLERANCE)


def test_noise_is_averaged_and_too_much_of_it_is_no_dwell():
    times, joints = moves(noise_deg=0.002, rate=250, stand_s=2.0)
    dwells, _ = find_dwells(times, joints, TOLERANCE, 0.5)
    assert len(dwells) == 4
    for dwell, posture in zip(dwells, POSTURES, strict=True):
        count = dwell.used.stop - dwell.used.start
        assert count > 400
        # 24 means: the largest of them is below five standard errors in all but 1 of 70 000 such tests.
        assert np.abs(dwell.joints - posture).max() < 5 * 0.002 / np.sqrt(count)
    times, joints = moves(noise_deg=0.02, rate=250, stand_s=2.0)
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])


def test_short_stops_are_no_dwells():
    times, joints = moves(stand_s=0.3)
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])
    assert len(find_dwells(times, joints, TOLERANCE, 0.3)[0]) == 4


def test_a_slow_drift_is_passed_over_and_not_cut_into_dwells():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.01 * times  # 0.005 degrees in half a second, 0.2 in all
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert dwells == []
    (drift,) = drifting
    assert drift.spread[2] == pytest.approx(0.2, rel=0.02)
    # Control: as slow a drift that ends within the tolerance is a dwell.
    assert len(find_dwells(times[:150], joints[:150], TOLERANCE, 0.5)[0]) == 1


def test_a_drift_whose_windows_are_not_all_at_rest_is_one_drift():
    times = np.arange(0, 20, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[:, 2] += 0.03 * times
    joints[::40, 2] += 0.012  # with such a reading at its end a window is beyond the tolerance
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert not all(plain_rest(times[:200], joints[:200], TOLERANCE, 0.5)[:140])
    assert dwells == []
    assert len(drifting) == 1


def test_a_small_step_parts_two_dwells():
    times = np.arange(0, 4, 0.01)
    joints = np.tile(POSTURES[0], (len(times), 1))
    joints[200:, 4] += 0.03
    dwells, drifting = find_dwells(times, joints, TOLERANCE, 0.5)
    assert drifting == []
    assert [(s.first, s.last) for s in dwells] == [(0, 199), (200, 399)]
    joints[200:, 4] -= 0.02
    assert len(find_dwells(times, joints, TOLERANCE, 0.5)[0]) == 1


def test_what_happened_in_a_gap_is_not_known():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    there = (times < 1.5) | (times > 2.5)
    dwells, _ = find_dwells(times[there], joints[there], TOLERANCE, 0.5)
    assert len(dwells) == 2
    assert repeats(dwells, TOLERANCE) == [None, 0]
    few = slice(0, None, 30)  # a reading each 0.3 s cannot show a dwell of 0.5 s
    assert find_dwells(times[few], joints[few], TOLERANCE, 0.5) == ([], [])
    assert len(find_dwells(times[few], joints[few], TOLERANCE, 0.6)[0]) == 1


def test_one_joint_that_moves_is_enough():
    times, joints = np.arange(0, 4, 0.01), np.tile(POSTURES[0], (400, 1))
    for i in range(6):
        moving = joints.copy()
        moving[:, i] += np.sin(times)
        assert find_dwells(times, moving, TOLERANCE, 0.5)[0] == []
        assert calmest(times, moving, TOLERANCE, 0.5)[1] == i


def test_windows_at_uneven_times_against_a_plain_search():
    random = np.random.default_rng(3)
    times = np.cumsum(random.uniform(0.001, 0.05, 600))
    joints = np.cumsum(random.normal(0, 0.004, (600, 2)) * (random.random(600) < 0.3)[:, None], axis=0)
    tolerance = np.array([0.02, 0.02])
    rest = plain_rest(times, joints, tolerance, 0.4)
    assert 0.1 < rest.mean() < 0.9
    dwells, drifting = find_dwells(times, joints, tolerance, 0.4)
    covered = np.zeros(600, dtype=bool)
    for i in np.flatnonzero(rest):
        covered[i : np.searchsorted(times, times[i] + 0.4 - 1e-9) + 1] = True
    mine = np.zeros(600, dtype=bool)
    for dwell in (*dwells, *drifting):
        mine[dwell.first : dwell.last + 1] = True
    np.testing.assert_array_equal(mine, covered)


def test_too_short_a_recording_has_no_window():
    times, joints = np.arange(0, 0.4, 0.01), np.tile(POSTURES[0], (40, 1))
    assert find_dwells(times, joints, TOLERANCE, 0.5) == ([], [])
    assert calmest(times, joints, TOLERANCE, 0.5) is None
    assert len(find_dwells(times, joints, TOLERANCE, 0.39)[0]) == 1


def test_repeats_and_marks():
    times, joints = moves(POSTURES[[0, 1, 0, 2]])
    dwells, _ = find_dwells(times, joints, TOLERANCE, 0.5)
    assert repeats(dwells, TOLERANCE) == [None, None, 0, None]
    middle = [(dwell.start_s + dwell.end_s) / 2 for dwell in dwells]
    assert dwell_of_each(dwells, np.array(middle))[0].tolist() == [0, 1, 2, 3]
    near = np.array([dwells[1].start_s - 0.2, dwells[-1].end_s + 0.24, dwells[-1].end_s + 0.26])
    nearest, away = dwell_of_each(dwells, near)
    assert nearest.tolist() == [1, 3, 3]
    np.testing.assert_allclose(away, [0.2, 0.24, 0.26])


def test_rows_that_hold_until_the_next():
    times, joints = held(np.array([0.0, 2.0, 2.1]), np.array([[1.0], [2.0], [3.0]]), 0.5)
    assert times[0] == 0
    assert times[-1] == 2.1
    assert np.diff(times).max() <= 0.125 + 1e-12
    assert np.all(np.diff(times) > 0)
    np.testing.assert_array_equal(joints[times < 2.0, 0], 1.0)
    np.testing.assert_array_equal(joints[(times >= 2.0) & (times < 2.1), 0], 2.0)
    (dwell,) = find_dwells(times, joints, np.array([0.02]), 0.5)[0]
    assert 1.8 < dwell.end_s < 2.0


@pytest.mark.parametrize(
    ("deg", "seconds"), [(0, 1), (0.01, 0), (-1, 1), (float("nan"), 1), (0.01, float("inf"))]
)
def test_a_tolerance_that_cannot_be_used(refused, tmp_path, deg, seconds):
    robot = load_robot("irb1600", tmp_path)
    assert "is out of range" in refused(Stillness(deg, seconds).tolerance, robot).what
    np.testing.assert_array_equal(Stillness(0.02, 1).tolerance(robot), TOLERANCE)


ROWS = np.array([[10, 20, -30, 40, 50, -60], [11, 21, -31, 41, 51, -61], [170.5, 22, -32, 42, 52, 300]])


def csv(folder: Path, name: str, rows, top="", delimiter=",") -> Path:
    path = folder / name
    lines = [delimiter.join(str(value) for value in row) for row in rows]
    path.write_text(top + "\n".join(lines) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def out(tmp_path) -> Path:
    return tmp_path / "run.jsonl"


@pytest.fixture
def read(header, out):
    return lambda files, names, layout: import_csv(files, names, layout, header, out)


def test_several_files_go_into_one_run_numbered_on(tmp_path, read, out):
    last = ROWS[1:] + 0.25  # rows that are there already would be copies
    files = [csv(tmp_path, "a.csv", ROWS), csv(tmp_path, "b.csv", ROWS[:2]), csv(tmp_path, "c.csv", last)]
    found = read(files, ["one", "two", "one"], CsvLayout("deg"))
    assert [shot.shot for shot in found.shots] == list(range(7))
    assert [shot.target for shot in found.shots] == ["one"] * 3 + ["two"] * 2 + ["one"] * 2
    assert not out.exists()
    write_run(out, found.header, found.shots)
    run = read_run(out)
    run.require_analysable()
    expected = np.radians(np.concatenate([ROWS, ROWS[:2], last]))
    np.testing.assert_allclose(run.joints, expected, rtol=1e-15)


def test_the_collector_of_circles_rests_within_an_import_alone():
    for failing in (False, True):
        with contextlib.suppress(ZeroDivisionError), uncollected():
            assert not gc.isenabled()
            if failing:
                raise ZeroDivisionError
        assert gc.isenabled()
    gc.disable()
    with uncollected():
        pass
    assert not gc.isenabled()
    gc.enable()


def test_radians_are_turned_into_degrees_and_the_wrong_unit_is_asked_about(tmp_path, read, refused):
    small, large = csv(tmp_path, "a.csv", np.radians(ROWS)), csv(tmp_path, "b.csv", ROWS)
    found = read([small], ["one"], CsvLayout("rad"))
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], ROWS, rtol=1e-14)
    assert "angles in radians, converted to degrees" in found.understood
    assert "--units rad" in refused(read, [small], ["one"], CsvLayout("deg")).remedy
    assert "radians?" in refused(read, [large], ["one"], CsvLayout("rad")).remedy


def test_what_was_understood_is_told(tmp_path, read):
    files = [csv(tmp_path, "a.csv", ROWS), csv(tmp_path, "b.csv", ROWS[:2])]
    told = read(files, ["one", "two"], CsvLayout("deg", delimiter=",")).understood
    assert told[0] == "2 files, 5 measurements, robot irb1600 (6 joints)"
    assert told[1].endswith("a.csv: 3 measurements of target 'one', numbered 0 to 2")
    assert told[2].endswith("b.csv: 2 measurements of target 'two', numbered 3 to 4")
    assert told[3] == "angles in degrees"
    assert told[4] == "columns in file order, joint 1 first; no header row"
    assert told[5] == "joint 1 (joint1): 10.00 to 170.50 deg, limits -180.00 to 180.00"
    assert told[11].startswith("note: the joints of measurements 0, 1, 3, 4 look commanded, not read back")
    assert len(told) == 12


def test_columns_by_name(tmp_path, read, refused):
    names = [f"j{i}" for i in range(1, 7)]
    rows = [[i, *row[[5, 0, 1, 2, 3, 4]]] for i, row in enumerate(ROWS)]
    file = csv(tmp_path, "a.csv", rows, "time,j6,j1,j2,j3,j4,j5\n")
    found = read([file], ["one"], CsvLayout("deg", header_row=True, columns=names))
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], ROWS)

    def what(columns, header_row=True):
        return refused(read, [file], ["one"], CsvLayout("deg", header_row=header_row, columns=columns))

    error = what([*names[:5], "j7"])
    assert (error.found, error.allowed, error.line) == ("j7", "time, j6, j1, j2, j3, j4, j5", 1)
    assert "not just the joints in their order" in what(None).what
    assert "one column is required" in what(names[:5]).what
    assert "no header row" in what(names, header_row=False).what


def test_a_header_row_must_be_stated_and_be_one(tmp_path, read, refused):
    names = [f"joint{i}" for i in range(1, 7)]
    headed = CsvLayout("deg", header_row=True)
    right = csv(tmp_path, "a.csv", ROWS, ",".join(names) + "\n")
    assert len(read([right], ["one"], headed).shots) == 3
    turned = csv(tmp_path, "b.csv", ROWS[:, ::-1], ",".join(reversed(names)) + "\n")
    assert "in their order" in refused(read, [turned], ["one"], headed).what
    error = refused(read, [right], ["one"], CsvLayout("deg"))
    assert "the first row holds no numbers" in error.what
    assert "header row" in error.remedy
    assert error.line == 1
    plain = csv(tmp_path, "c.csv", ROWS)
    assert "not a header row" in refused(read, [plain], ["one"], headed).what


@pytest.mark.parametrize(
    ("content", "what", "line"),
    [
        ("1,2,3,4,5,6\n1,2,3,4,5\n", "wrong number of values", 2),
        ("1,2,3,4,5,6\n\n1,2,3,4,5,6,7\n", "wrong number of values", 3),
        ("1,2,3,4,5,6\n1,2,x,4,5,6\n", "column 3 is not a number", 2),
        ("1,2,3,4,5,6\n1,2,,4,5,6\n", "column 3 is not a number", 2),
        ("1,2,3,4,5,6\n1,2,1_0,4,5,6\n", "column 3 is not a number", 2),
        ("1,2,3,4,5,nan\n", "column 6 is not a finite number", 1),
        ("1,2,3,4,5,inf\n", "column 6 is not a finite number", 1),
        ("1,2,3,4,5\n", "wrong number of values", 1),
        ("1;2;3;4;5;6\n", "wrong number of values|holds no numbers", 1),
        ('1,2,3,4,5,"6\n', "not valid CSV", 1),
        ("1,2,3,4,5,6\n1,2,3,4,200,6\n", "row 2: joint 5 is outside its limits", 2),
        ("\n \n", "empty", None),
        (",,\n", "no rows", None),
    ],
)
def test_rows_that_cannot_be_used(tmp_path, read, refused, content, what, line):
    good = csv(tmp_path, "good.csv", ROWS)
    bad = tmp_path / "bad.csv"
    bad.write_text(content)
    error = refused(read, [good, bad], ["one", "two"], CsvLayout("deg", delimiter=","))
    assert any(part in error.what for part in what.split("|")), error
    assert error.line == line
    assert error.file == str(bad)


def test_another_delimiter(tmp_path, read, refused):
    file = csv(tmp_path, "a.csv", ROWS, delimiter=";")
    found = read([file], ["one"], CsvLayout("deg", delimiter=";"))
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], ROWS)
    assert "delimiter" in refused(read, [file], ["one"], CsvLayout("deg", delimiter=",")).remedy
    assert "not a delimiter" in refused(read, [file], ["one"], CsvLayout("deg", delimiter=";;")).what


def test_what_must_be_stated(tmp_path, read, header, refused):
    file, absent = csv(tmp_path, "a.csv", ROWS), tmp_path / "x.csv"
    for files, targets, what in (
        ([file], [], "one target name"),
        ([], [], "no file"),
        ([file, file], ["a", "b"], "duplicate"),
        ([file], ["tool"], "'tool'"),
        ([absent], ["a"], "no such file"),
    ):
        assert what in refused(read, files, targets, CsvLayout("deg")).what
    assert "unit" in refused(read, [file], ["one"], CsvLayout("grad")).what
    header.write_text(HEADER + "distances: [{between: [one, two], mm: 50, sigma_mm: 0.1}]\n")
    assert refused(read, [file], ["one"], CsvLayout("deg")).found == "two"


def test_limits_warn_is_respected(tmp_path, read, header):
    far = ROWS.astype(float)
    far[1, 4] = 140
    header.write_text(HEADER + "limits: warn\n")
    found = read([csv(tmp_path, "a.csv", far)], ["one"], CsvLayout("deg"))
    assert found.understood[-1].endswith("up to 140 deg, in 1 of 3 measurements: 1")


SCARA = """
schema: zerobeam/robot/1
name: scara
convention: standard
joints:
  - {a_mm: 300, alpha_deg: 0, d_mm: 400, theta_deg: 0, lower_deg: -130, upper_deg: 130}
  - {kind: prismatic, a_mm: 0, alpha_deg: 0, d_mm: 0, theta_deg: 0, lower_mm: -200, upper_mm: 10}
"""


def test_the_unit_of_prismatic_joints_is_stated_too(tmp_path, out, refused):
    folder = tmp_path / "cell"
    folder.mkdir()
    (folder / "scara.yaml").write_text(SCARA)
    header = folder / "header.yaml"
    text = HEADER.replace("irb1600", "scara.yaml").replace(
        "joint_deg: 0.01", "joint_deg: 0.01, joint_mm: 0.1"
    )
    header.write_text(text)
    file = csv(tmp_path, "a.csv", [[1.5, -0.1], [1.2, -0.15]])
    assert "prismatic" in refused(import_csv, [file], ["one"], CsvLayout("rad"), header, out).what
    found = import_csv([file], ["one"], CsvLayout("rad", lengths="m"), header, out)
    np.testing.assert_allclose(
        [shot.joints_deg for shot in found.shots], [[np.degrees(1.5), -100], [np.degrees(1.2), -150]]
    )
    # The robot's file is found from where the run will stand, not from where the header stood.
    assert found.header.robot == "cell/scara.yaml"
    write_run(out, found.header, found.shots)
    assert read_run(out).robot.name == "scara"


def arm(shared_data: Path, tmp_path: Path, name: str, robot: str):
    folder = tmp_path / "headers"
    folder.mkdir()
    header = folder / "header.yaml"
    header.write_text(HEADER.replace("irb1600", robot.format(shared_data / "mukca/urdf")))
    files = sorted((shared_data / "mukca" / name).rglob("*.csv"))
    names = [f"{file.parent.name}.{file.stem}" for file in files]
    return files, names, header


PANDA = "{{urdf: {}/panda.urdf, base: panda_link0, tip: panda_hand_tcp}}"


def test_the_recordings_of_panda_2(shared_data, tmp_path, out):
    files, names, header = arm(shared_data, tmp_path, "panda_2", PANDA)
    found = import_csv(files, names, CsvLayout("rad"), header, out)
    assert (len(files), len(found.shots)) == (18, 559)
    assert isinstance(found.header.robot, UrdfRef)
    write_run(out, found.header, found.shots)
    run = read_run(out)
    run.require_analysable()
    assert run.warnings == ()
    recorded = np.concatenate([np.loadtxt(file, delimiter=",", ndmin=2) for file in files])
    np.testing.assert_allclose(run.joints, recorded, rtol=1e-14)


def test_the_recordings_of_panda_taken_for_degrees(shared_data, tmp_path, out, refused):
    files, names, header = arm(shared_data, tmp_path, "panda_1", PANDA)
    error = refused(import_csv, files, names, CsvLayout("deg"), header, out)
    assert "look like radians" in error.what
    assert "--units rad" in error.remedy


def test_the_arm_that_goes_beyond_its_limits(shared_data, tmp_path, out, refused):
    robot = "{{urdf: {}/gen3lite.urdf, base: kinova_base_link, tip: end_effector_link}}"
    files, names, header = arm(shared_data, tmp_path, "dinova_1", robot)
    error = refused(import_csv, files, names, CsvLayout("rad"), header, out)
    assert "joint 6 is outside its limits" in error.what
    assert "limits: warn" in error.remedy
    header.write_text(header.read_text() + "limits: warn\n")
    found = import_csv(files, names, CsvLayout("rad"), header, out)
    assert len(found.shots) == 137
    write_run(out, found.header, found.shots)
    (warning,) = read_run(out).warnings
    assert warning.startswith("joint 6 is outside its limits (-119.748 to 119.748 deg), up to -157.128")
    assert "in 33 of 137 measurements" in warning


PENDANT = """
mounting: {below_base_mm: 0}
pendant:
  joint3: ground
  order: [1, 2, 6, 3, 4, 5]
  names: [S, L, U, R, B, T]
  unit: pulse
  pulses_per_deg: [100, -200, 300, 400, 500, 600]
"""


def test_a_table_as_the_pendant_shows_it_in_pulses_and_in_its_order(tmp_path, out, refused):
    arm = (BUILT_IN / "irb1600.yaml").read_text(encoding="utf-8")
    (tmp_path / "arm.yaml").write_text(arm[: arm.index("mounting:")] + PENDANT.lstrip(), encoding="utf-8")
    header = tmp_path / "header.yaml"
    header.write_text(HEADER.replace("irb1600", "arm.yaml"))
    ground = ROWS.copy()
    ground[:, 2] -= ROWS[:, 1]
    pulses = ground * [100, -200, 300, 400, 500, 600]
    file = csv(tmp_path, "a.csv", pulses[:, [0, 1, 5, 2, 3, 4]])
    found = import_csv([file], ["one"], CsvLayout("pulse"), header, out)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], ROWS, atol=1e-9)
    said = " ".join(found.understood)
    for words in ("from the ground, as the robot file of irb1600 states", "as on the pendant", "in pulses"):
        assert words in said
    # Columns may be named for the pendant's names; `--j3` overrides the file.
    layout = CsvLayout("pulse", columns=["1=S", "2=L", "3=T", "4=U", "5=R", "6=B"], j3="link")
    plain = import_csv([file], ["one"], layout, header, out)
    np.testing.assert_allclose([shot.joints_deg[2] for shot in plain.shots], ground[:, 2], atol=1e-9)
    header.write_text(HEADER)
    assert (
        "pulses for a degree are not stated"
        in refused(import_csv, [file], ["one"], CsvLayout("pulse"), header, out).what
    )


LISTS = "".join(
    f"  VAR jointtarget p{i} = j:{{{','.join(map(str, row))}}}{{EJ 0,0.0}};\n" for i, row in enumerate(ROWS)
)


@pytest.mark.parametrize(
    "text",
    [
        LISTS,
        LISTS.replace("{EJ 0,0.0}", ""),
        LISTS.replace("  VAR jointtarget", "GLOBAL").replace("j:", "J : "),
    ],
)
def test_lists_of_joints_of_rokae_are_rows(tmp_path, read, text):
    file = tmp_path / "points.txt"
    file.write_text(text)
    found = read([file], ["one"], CsvLayout("deg"))
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], ROWS)
    assert [shot.source for shot in found.shots] == ["points.txt:1", "points.txt:2", "points.txt:3"]
    assert contents_of(file).columns[4].highest == 52


def test_lists_that_say_more_than_joints_are_refused(tmp_path, read, refused):
    file = tmp_path / "points.txt"
    file.write_text(LISTS.replace("{EJ 0,0.0}", "{EJ 0,12.5}", 1))
    error = refused(read, [file], ["one"], CsvLayout("deg"))
    assert "external axes that are not at 0" in error.what
    assert error.line == 1
    file.write_text(LISTS + "p = P:{900,0,900}{1,0,0,0}\n")
    assert "column 1 is not a number" in refused(read, [file], ["one"], CsvLayout("deg")).what


HEADER_HALF_TURNS = """\
robot: {robot}
tool: {{kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, spot_mm: 0.05}}
"""
JOINTS = np.array(
    [[10.5, -20.25, 30.5, 40.75, -50.5, 60.25, 170.5], [-170.5, 15.5, -30.75, -40.5, 50.5, -60.5, 3.25]]
)


def imported(tmp_path, joints, robot="gen3"):
    (tmp_path / "header.yaml").write_text(HEADER_HALF_TURNS.format(robot=robot), encoding="utf-8")
    rows = "\n".join(",".join(map(str, row)) for row in joints.tolist())
    (tmp_path / "joints.csv").write_text(rows, encoding="utf-8")
    files = ["--units", "deg", tmp_path / "joints.csv", "--header", tmp_path / "header.yaml"]
    answer = zerobeam("import", "csv", *files, "--target", "psd", "-o", tmp_path / "run.jsonl")
    if answer.status:
        return answer, None
    return answer, [shot.joints_deg for shot in read_run(tmp_path / "run.jsonl").shots]


def test_a_turn_is_taken_from_what_a_controller_counts_to_360(tmp_path):
    answer, joints = imported(tmp_path, JOINTS % 360)
    np.testing.assert_allclose(joints, JOINTS, atol=1e-9)
    assert (
        "joints counted from 0 to 360°: of joint 1, 2, 3, 4, 5, 6 values above 180° are taken less"
        in answer.out
    )


@pytest.mark.parametrize(("robot", "columns"), [("ur5e", 6), ("gen3", 7)])
def test_control_what_is_within_the_limits_stays(robot, columns, tmp_path):
    """A UR turns to 360° itself; a negative value says that the controller does not count from 0."""
    joints = (JOINTS % 360 if robot == "ur5e" else JOINTS)[:, :columns]
    answer, read = imported(tmp_path, joints, robot)
    np.testing.assert_allclose(read, joints, atol=1e-9)
    assert "less 360" not in answer.out


def test_control_what_stays_outside_the_limits_is_refused(tmp_path):
    joints = JOINTS % 360
    joints[0, 1] = 200.0  # -160°: outside ±138° too
    answer, _ = imported(tmp_path, joints)
    assert answer.status == 2


STILL = Stillness(0.02, 0.5)


@pytest.fixture
def read_known(tmp_path, header):
    def call(kind, text, **options):
        path = tmp_path / "log.csv"
        path.write_text(text)
        still = options.pop("still", STILL)
        return import_log(kind, [path], ["a"], header, tmp_path / "run.jsonl", still=still, **options)

    return call


def shots(found):
    return np.array([shot.joints_deg for shot in found.shots])


def test_a_recording_of_universal_robots(read_known):
    found = read_known("ur", ur(*moves()))
    np.testing.assert_allclose(shots(found), POSTURES, atol=1e-9)
    told = "\n".join(found.understood)
    assert "angles in radians, converted to degrees" in told
    assert "joint 1 first: actual_q_0, actual_q_1" in told
    assert "time in s: column timestamp" in told
    assert "dwell 4: 5.3" in told


def test_a_marker_column_chooses_the_stands(read_known, refused):
    times, joints = moves()
    marker = np.isin(np.arange(len(times)), [*range(45, 60), *range(210, 230)]).astype(int)
    found = read_known("ur", ur(times, joints, marker), marker_column="bit")
    np.testing.assert_allclose(shots(found), POSTURES[[0, 2]], atol=1e-9)
    assert any("dwells without a marker, not imported: 2" in line for line in found.understood)
    error = refused(read_known, "ur", ur(times, joints), marker_column="bit")
    assert "no marker in the recording" in error.what
    assert refused(read_known, "ur", ur(times, joints), marker_column="bits").remedy == "did you mean 'bit'?"


def test_another_delimiter_and_a_column_that_is_not_there(read_known, refused):
    text = ur(*moves())
    assert len(read_known("ur", text.replace(" ", ","), delimiter=",").shots) == 4
    assert 'seems to be " "' in refused(read_known, "ur", text, delimiter=";").remedy
    error = refused(read_known, "ur", text.replace("actual_q_3", "actual_q3"))
    assert error.remedy == "did you mean 'actual_q3'?"


def egm(times, joints):
    """As EGMLogger prints: six significant digits, the time as a whole number of ms."""
    names = ["TIMESTAMP", *(f"R_FB_POS_RJ{i + 1}" for i in range(6)), "R_PL_POS_RJ1"]
    rows = [
        [round(1000 * time) + 120_000, *(f"{value:.6g}" for value in row), 0.0]
        for time, row in zip(times, joints, strict=True)
    ]
    return table(names, rows, ",")


def test_an_egm_log(read_known):
    found = read_known("egm", egm(*moves(rate=250)))
    np.testing.assert_allclose(shots(found), POSTURES, atol=1e-9)
    assert "angles in degrees" in found.understood
    assert "time in ms: column TIMESTAMP" in found.understood
    assert found.shots[1].time_s - found.shots[0].time_s == pytest.approx(1.6, abs=0.01)


def robodk(times, joints):
    """As MonitorJoints writes: no header row, a row only where a joint has changed by 0.0001 degrees."""
    rows, last = [], None
    for time, row in zip(times, joints, strict=True):
        if last is None or np.any(np.abs(row - last) > 1e-4):
            rows.append([*row, f"{time:.3f}"])
            last = row
    return table(None, rows, ", ")


def test_a_robodk_log_has_no_rows_while_the_arm_stands(read_known):
    times, joints = moves(stand_s=3.0)
    text = robodk(times, joints)
    assert text.count("\n") < 200 < len(times)
    found = read_known("robodk", text)
    np.testing.assert_allclose(shots(found), POSTURES, atol=1e-4)
    assert "time in s: column 7" in found.understood
    # Where recording ends before the arm moves again, how long it stood is not in the file.
    end = np.searchsorted(times, found.shots[3].time_s)
    np.testing.assert_allclose(
        shots(read_known("robodk", robodk(times[:end], joints[:end]))), POSTURES[:3], atol=1e-4
    )


def test_a_recording_in_which_the_arm_never_stands(read_known, refused):
    times, joints = moves(stand_s=0.2)
    error = refused(read_known, "ur", ur(times, joints))
    assert "never dwells" in error.what
    assert "in the calmest window" in error.found
    joints = np.tile(POSTURES[0], (len(times), 1)) + 0.02 * times[:, None]
    assert "drifts by" in refused(read_known, "ur", ur(times, joints)).found


def test_times_must_ascend(read_known, refused):
    times, joints = moves()
    times = np.where(np.arange(len(times)) < 100, times, times - 1.5)
    assert "do not increase" in refused(read_known, "ur", ur(times, joints)).what


def test_a_stand_that_repeats_is_told(read_known):
    found = read_known("ur", ur(*moves(POSTURES[[0, 1, 0]])))
    assert len(found.shots) == 3
    (told,) = [line for line in found.understood if line.endswith("; repeats dwell 1")]
    assert told.startswith("  dwell 3")
