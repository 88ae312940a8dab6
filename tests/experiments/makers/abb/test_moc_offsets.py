"""Motor calibration offsets: the diff, applied by a plain model of patch to a file read by a plain parser."""

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_runs import HOSTILE, SLIDING, WITHIN_NOISE_MM, arm_run, hostile, rms_mm, urdf_run

from zerobeam.experiments.makers.abb.moc_offsets import TURN, Gears, moc_text
from zerobeam.experiments.makers.calibration import JointOffset, RobotCalibration, calibration
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import Run

Refused = Callable[..., BadInput]

# Made up; the ratios are in the file for motors 3 and 5 only.
MOC = """MOC:CFG_1.0:6:0::
#
# MOTOR_CALIB is below; -name "rob1_2" -cal_offset 7 -valid_cal_offset is a comment
ARM:

      -name "rob1_1" -use_arm_calib "-cal_offset 3" -cal_offset 8 -valid_cal_offset
#
MOTOR_CALIB:

      -name "rob1_1" -com_offset 1.5708 -valid_com_offset -cal_offset 0.5 \\
      -valid_cal_offset

      -name "rob1_2" -com_offset 1.5708 -valid_com_offset \\
      -cal_offset 3.25 -valid_cal_offset -note "-cal_offset 9"

      -name "rob1_3" -valid_cal_offset -cal_offset -1e-1

#      -name "rob1_4" -cal_offset 1.1 -valid_cal_offset
      -name "rob1_4" -cal_offset 6.1 \\
# -cal_offset 7
      -valid_cal_offset
      -name "rob1_5" -cal_offset .2 -valid_cal_offset
      -name "rob1_6" -cal_offset 2 -valid_cal_offset
      -name "M7DM1" -cal_offset 0.3 -valid_cal_offset
#
TRANSMISSION:

      -name "rob1_3" -rotating_move -transm_joint -90.5
      -name "rob1_5" -transm_joint 50 -rotating_move"""
OLD = [0.5, 3.25, -0.1, 6.1, 0.2, 2.0]
RATIOS = [100.0, 121.0, -90.5, 60.0, 50.0, -40.0]
SIGNS = [1, -1, -1, 1, -1, 1]


def weakened(offset: JointOffset) -> JointOffset:
    return replace(offset, row=replace(offset.row, status="weak"))


def patched(text: str, diff: str) -> str:
    """The text with a unified diff applied; what stands before its `---` is passed over."""
    lines, rows = text.split("\n"), diff.split("\n")
    start = next(i for i, row in enumerate(rows) if row.startswith("--- "))
    assert rows[start + 1].startswith("+++ ")
    result: list[str] = []
    at = 0
    for row in rows[start + 2 :]:
        hunk = re.match(r"@@ -(\d+)(?:,\d+)? \+\d+(?:,\d+)? @@", row)
        if hunk:
            result += lines[at : int(hunk[1]) - 1]
            at = int(hunk[1]) - 1
        elif row[:1] in (" ", "-"):
            assert lines[at] == row[1:]
            if row[0] == " ":
                result.append(lines[at])
            at += 1
        elif row[:1] == "+":
            result.append(row[1:])
    return "\n".join(result + lines[at:])


def calibrated(text: str) -> list[float]:
    """cal_offset of motors 1 to 6, from the section by hand."""
    section = text.split("\nMOTOR_CALIB:")[1].split("\nTRANSMISSION:")[0]
    section = "".join(line for line in section.splitlines(keepends=True) if not line.startswith("#"))
    entries = re.split(r'-name "', re.sub(r'-note "[^"]*"', "", section))[1:7]
    return [float(re.search(r"-cal_offset (\S+)", entry)[1]) for entry in entries]  # type: ignore[index]


@pytest.fixture
def told(tmp_path: Path) -> tuple[Run, RobotCalibration, Path]:
    run = arm_run(tmp_path)
    path = tmp_path / "MOC.cfg"
    path.write_text(MOC)
    return run, calibration(run), path


def change_of_readings(new: Sequence[float], signs: Sequence[int], turned: bool) -> np.ndarray:
    """rad: what the controller reads more after its cal_offsets are `new`; `turned`: counters updated, so
    that the motors' whole turns are such that the readings are near what they were."""
    motor = np.array(new) - OLD
    reading = np.array(signs) * motor / RATIOS
    if turned:
        turn = TURN / np.abs(RATIOS)
        wanted = np.radians([0, -2.4, 1.4, 0.3, -0.9, 0.6])
        reading += np.round((wanted - reading) / turn) * turn
    return reading


def test_applied_it_makes_the_readings_hit_the_target(told: tuple[Run, RobotCalibration, Path]) -> None:
    run, answer, path = told
    text = moc_text(answer, Gears(RATIOS, SIGNS), path)  # type: ignore[arg-type]
    new = calibrated(patched(MOC, text))
    assert new[0] == OLD[0]  # held: as it was
    assert all(-TURN <= value <= TURN for value in new)
    assert rms_mm(run) > 10 * WITHIN_NOISE_MM
    assert rms_mm(run, run.joints + change_of_readings(new, SIGNS, True)) < WITHIN_NOISE_MM
    wrong = change_of_readings(new, [-sign for sign in SIGNS], False)
    assert rms_mm(run, run.joints + wrong) > 10 * WITHIN_NOISE_MM
    assert path.read_text() == MOC  # never applied by itself


def test_sign_and_ratio_give_the_joint_offsets_back(told: tuple[Run, RobotCalibration, Path]) -> None:
    """Within the six decimals that are written; whole turns are told, with what the readings will be."""
    _, answer, path = told
    text = moc_text(answer, Gears(RATIOS, SIGNS), path)  # type: ignore[arg-type]
    new = calibrated(patched(MOC, text))
    offsets = np.array([offset.applied_rad for offset in answer.offsets])
    found = change_of_readings(new, SIGNS, True)
    np.testing.assert_allclose(found, offsets, atol=1.01 * 5e-7 / 40, rtol=0)
    before = np.degrees(change_of_readings(new, SIGNS, False))
    for i in range(1, 6):
        said = re.search(rf"^#   rob1_{i + 1}: ([-+][.\d]+)$", text, re.MULTILINE)
        assert float(said[1]) == pytest.approx(before[i], abs=1.1e-4)
    turned = [i for i in range(6) if abs(before[i] - np.degrees(offsets[i])) > 1e-4]
    assert turned  # or nothing of the turns is tested
    for i in range(1, 6):
        assert bool(re.search(rf"rob1_{i + 1}: cal_offset .* turn\(s\) taken off", text)) == (i in turned)


def test_one_sign_may_stand_for_all_and_ratios_come_from_the_file(
    told: tuple[Run, RobotCalibration, Path],
) -> None:
    run, _, path = told
    few = calibration(run, without=["delta2", "delta4", "delta6"])
    text = moc_text(few, Gears.of_options(None, "-1", 6), path)
    stated = moc_text(few, Gears.of_options(",".join(map(str, RATIOS)), "-1,-1,-1,-1,-1,-1", 6), path)
    assert text == stated
    new = calibrated(patched(MOC, text))
    assert [a != b for a, b in zip(new, OLD, strict=True)] == [False, False, True, False, True, False]
    opposite = calibrated(patched(MOC, moc_text(few, Gears.of_options(None, "1", 6), path)))
    assert new[4] - OLD[4] == pytest.approx(OLD[4] - opposite[4], abs=2e-6)


def test_carriage_returns_and_a_missing_last_line_end_stay(told: tuple[Run, RobotCalibration, Path]) -> None:
    _, answer, path = told
    path.write_bytes(MOC.replace("\n", "\r\n").encode())
    text = moc_text(answer, Gears(RATIOS, SIGNS), path)  # type: ignore[arg-type]
    after = patched(MOC.replace("\n", "\r\n"), text)
    plain = moc_text(answer, Gears(RATIOS, SIGNS), replaced(path, MOC))  # type: ignore[arg-type]
    assert after == patched(MOC, plain).replace("\n", "\r\n")
    short = MOC[: MOC.index('      -name "M7DM1"')].rstrip("\n")
    few = moc_text(answer, Gears(RATIOS, SIGNS), replaced(path, short))  # type: ignore[arg-type]
    assert few.count("\\ No newline at end of file") == 2
    assert calibrated(patched(short, few)) == calibrated(after.replace("\r\n", "\n"))


def replaced(path: Path, text: str) -> Path:
    path.write_bytes(text.encode())
    return path


def test_the_sign_is_never_guessed(told: tuple[Run, RobotCalibration, Path], refused: Refused) -> None:
    _, answer, path = told
    error = refused(moc_text, answer, Gears(RATIOS, None), path)
    assert "the sign must be stated" in error.what
    assert "--motor-sign" in str(error.allowed)


def test_what_is_missing_or_contradicts(told: tuple[Run, RobotCalibration, Path], refused: Refused) -> None:
    run, answer, path = told
    gears = Gears(RATIOS, SIGNS)  # type: ignore[arg-type]

    def why(text: str, own: Gears = gears, unit: str = "rob1") -> str:
        return str(refused(moc_text, answer, own, replaced(path, text), unit))

    assert "the gear ratio of rob1_2 is not known" in why(MOC, Gears(None, gears.signs))
    other = Gears([100, 121, 90.5, 60, 50, -40], gears.signs)
    assert "--ratio 90.5, transm_joint -90.5" in why(MOC, other)
    answer = calibration(run, without=["delta2", "delta4", "delta6"])
    zero = MOC.replace("-transm_joint 50", "-transm_joint 0")
    assert "rob1_5 is not known found: transm_joint 0" in " ".join(
        why(zero, Gears(None, gears.signs)).split()
    )
    answer = calibration(run)
    assert "no motor 'irb_2' in MOTOR_CALIB" in why(MOC, unit="irb")
    assert "rob1_1, rob1_2" in why(MOC, unit="irb")
    assert "no entry of MOTOR_CALIB" in why("MOC:CFG_1.0:6:0::\n")
    missing = MOC.replace("-cal_offset 6.1 ", "")
    assert "rob1_4 has no cal_offset" in why(missing)
    assert "line 19:" in why(missing)
    assert "rob1_4 has cal_offset more than once" in why(MOC.replace("6.1", "6.1 -cal_offset 6.2"))
    assert "not valid" in why(MOC.replace('2 -valid_cal_offset\n      -name "M7', '2\n      -name "M7'))
    assert "duplicate entry" in why(MOC.replace("rob1_6", "rob1_5", 1))
    assert "rob1_4 has no cal_offset" in why(MOC.replace("-cal_offset 6.1", "-cal_offset 6.1rad"))


@pytest.mark.parametrize(
    ("ratio", "sign"), [("1,2", "1"), ("0,1,1,1,1,1", "1"), ("nan,1,1,1,1,1", "1"), ("a", "1"), (None, "2")]
)
def test_ratios_and_signs_that_are_none(ratio: str | None, sign: str, refused: Refused) -> None:
    assert "is not understood" in refused(Gears.of_options, ratio, sign, 6).what


def test_without_the_controllers_file_a_table(told: tuple[Run, RobotCalibration, Path]) -> None:
    """At the joint; at the motor only once sign and ratios are stated."""
    _, answer, _ = told
    bare = moc_text(answer, Gears())
    whole = moc_text(answer, Gears(RATIOS, SIGNS))  # type: ignore[arg-type]
    for i, offset in enumerate(answer.offsets[1:], start=1):
        row = rf"^# {i + 1}; ([-+.\d]+); \S+; ([-+.\d]+); (.*)$"
        told_bare, told_whole = (re.search(row, text, re.MULTILINE) for text in (bare, whole))
        assert float(told_bare[2]) == pytest.approx(offset.applied_rad, abs=6e-10)
        assert told_bare[3].startswith("unknown")
        assert float(told_whole[3]) == pytest.approx(SIGNS[i] * RATIOS[i] * offset.applied_rad, abs=6e-7)
    assert "No public" in bare


def test_the_head_says_what_is_not_known(told: tuple[Run, RobotCalibration, Path]) -> None:
    run, _, path = told
    answer = calibration(run, without=["delta6"])
    weak = replace(answer, offsets=tuple(weakened(o) if o.exported else o for o in answer.offsets))
    text = moc_text(weak, Gears(RATIOS, SIGNS), path)  # type: ignore[arg-type]
    head = " ".join(line.strip("# ") for line in text.split("\n---")[0].split("\n"))
    assert "No public source is known" in head
    assert "gears are coupled" in head
    assert head.count("WEAK") == 4
    assert "delta1 (joint1): HELD at 0" in head
    assert "EXCLUDED on request" in head


def test_hostile_names_stay_in_the_head(told: tuple[Run, RobotCalibration, Path]) -> None:
    run, answer, path = told
    wild = replaced(path.with_name(HOSTILE.replace("/", "")), MOC)
    text = moc_text(calibration(hostile(run)), Gears(RATIOS, SIGNS), wild)  # type: ignore[arg-type]
    tame = moc_text(answer, Gears(RATIOS, SIGNS), path)  # type: ignore[arg-type]
    assert patched(MOC, text) == patched(MOC, tame)
    head = text.split("\n--- ", 1)[0]
    assert all(line.startswith("#") for line in head.split("\n"))
    assert head.isascii()


def test_a_prismatic_joint_is_refused(tmp_path: Path, refused: Refused) -> None:
    run = urdf_run(tmp_path, SLIDING)
    error = refused(moc_text, calibration(run), Gears())
    assert error.found == "delta3"
    assert "--without delta3" in str(error.remedy)
    assert "2; " in moc_text(calibration(run, without=["delta3"]), Gears())
