"""Logs over time, written here as the programs that they come from write them."""

import numpy as np
import pytest
from import_files import import_log
from recorded_logs import POSTURES, moves, table, ur

from zerobeam.experiments.makers.generic.layouts import Stillness

STILL = Stillness(0.02, 0.5)


@pytest.fixture
def read(tmp_path, header):
    def call(kind, text, **options):
        path = tmp_path / "log.csv"
        path.write_text(text)
        still = options.pop("still", STILL)
        return import_log(kind, [path], ["a"], header, tmp_path / "run.jsonl", still=still, **options)

    return call


def shots(found):
    return np.array([shot.joints_deg for shot in found.shots])


def test_a_recording_of_universal_robots(read):
    found = read("ur", ur(*moves()))
    np.testing.assert_allclose(shots(found), POSTURES, atol=1e-9)
    told = "\n".join(found.understood)
    assert "angles in radians, converted to degrees" in told
    assert "joint 1 first: actual_q_0, actual_q_1" in told
    assert "time in s: column timestamp" in told
    assert "dwell 4: 5.3" in told


def test_a_marker_column_chooses_the_stands(read, refused):
    times, joints = moves()
    marker = np.isin(np.arange(len(times)), [*range(45, 60), *range(210, 230)]).astype(int)
    found = read("ur", ur(times, joints, marker), marker_column="bit")
    np.testing.assert_allclose(shots(found), POSTURES[[0, 2]], atol=1e-9)
    assert any("dwells without a marker, not imported: 2" in line for line in found.understood)
    error = refused(read, "ur", ur(times, joints), marker_column="bit")
    assert "no marker in the recording" in error.what
    assert refused(read, "ur", ur(times, joints), marker_column="bits").remedy == "did you mean 'bit'?"


def test_another_delimiter_and_a_column_that_is_not_there(read, refused):
    text = ur(*moves())
    assert len(read("ur", text.replace(" ", ","), delimiter=",").shots) == 4
    assert 'seems to be " "' in refused(read, "ur", text, delimiter=";").remedy
    error = refused(read, "ur", text.replace("actual_q_3", "actual_q3"))
    assert error.remedy == "did you mean 'actual_q3'?"


def egm(times, joints):
    """As EGMLogger prints: six significant digits, the time as a whole number of ms."""
    names = ["TIMESTAMP", *(f"R_FB_POS_RJ{i + 1}" for i in range(6)), "R_PL_POS_RJ1"]
    rows = [
        [round(1000 * time) + 120_000, *(f"{value:.6g}" for value in row), 0.0]
        for time, row in zip(times, joints, strict=True)
    ]
    return table(names, rows, ",")


def test_an_egm_log(read):
    found = read("egm", egm(*moves(rate=250)))
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


def test_a_robodk_log_has_no_rows_while_the_arm_stands(read):
    times, joints = moves(stand_s=3.0)
    text = robodk(times, joints)
    assert text.count("\n") < 200 < len(times)
    found = read("robodk", text)
    np.testing.assert_allclose(shots(found), POSTURES, atol=1e-4)
    assert "time in s: column 7" in found.understood
    # Where recording ends before the arm moves again, how long it stood is not in the file.
    end = np.searchsorted(times, found.shots[3].time_s)
    np.testing.assert_allclose(
        shots(read("robodk", robodk(times[:end], joints[:end]))), POSTURES[:3], atol=1e-4
    )


def test_a_recording_in_which_the_arm_never_stands(read, refused):
    times, joints = moves(stand_s=0.2)
    error = refused(read, "ur", ur(times, joints))
    assert "never dwells" in error.what
    assert "in the calmest window" in error.found
    joints = np.tile(POSTURES[0], (len(times), 1)) + 0.02 * times[:, None]
    assert "drifts by" in refused(read, "ur", ur(times, joints)).found


def test_times_must_ascend(read, refused):
    times, joints = moves()
    times = np.where(np.arange(len(times)) < 100, times, times - 1.5)
    assert "do not increase" in refused(read, "ur", ur(times, joints)).what


def test_a_stand_that_repeats_is_told(read):
    found = read("ur", ur(*moves(POSTURES[[0, 1, 0]])))
    assert len(found.shots) == 3
    (told,) = [line for line in found.understood if line.endswith("; repeats dwell 1")]
    assert told.startswith("  dwell 3")
