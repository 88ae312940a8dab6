"""A backup of a FANUC controller says counts, signs and coupling; the sheet made by it removes the error."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_line import zerobeam
from exact_runs import demo_runs
from fanuc_backups import M900IA, R2000IB, FanucEncoders, write_backup

from zerobeam.experiments.makers.calibration import RobotCalibration, calibration
from zerobeam.experiments.makers.fanuc.backup import read_fanuc_backup
from zerobeam.experiments.makers.fanuc.mastering import FanucCounts, fanuc_text
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run

OFFSETS = (0.42, -0.31, 0.55, 0.61, -0.48, 0.2)  # deg, between links; J1 and J2 are those with another sign
POSTURE = np.array([20.0, -15.0, 35.0, 40.0, -60.0, 80.0])  # deg, between links
ARM = load_robot("r2000ic_165f")


@pytest.fixture(scope="module")
def found() -> RobotCalibration:
    """The answer of a run, with the offsets of this arm."""
    answer = calibration(read_run(demo_runs()[0].path))
    row = answer.offsets[1].row
    offsets = [
        replace(offset, row=replace(row, name=f"delta{i}", estimate=value), to_enter=None)
        for i, (offset, value) in enumerate(zip(answer.offsets, OFFSETS, strict=True), start=1)
    ]
    return replace(answer, offsets=tuple(offsets))


def as_owner(text: str, encoders: FanucEncoders) -> list[int]:
    """The master counts after a person has followed the sheet."""
    counts = list(encoders.master)
    for joint, new, now in re.findall(r"^J(\d) +\S+ +(-?\d+) +\(now (-?\d+)\)$", text, flags=re.MULTILINE):
        assert int(now) == counts[int(joint) - 1]
        counts[int(joint) - 1] = int(new)
    return counts


def errors(encoders: FanucEncoders, master: list[int]) -> tuple[float, np.ndarray]:
    """By how far the flange is off, mm, and each reading, deg, at a posture of the true arm."""
    truth = POSTURE + OFFSETS
    # Its encoders read POSTURE with the counts that the controller has: the zeros are wrong by the offsets.
    pulses = encoders.pulses(POSTURE, encoders.master)
    read = encoders.angles(pulses, master)
    at = [ARM.fk(joints, unit="deg")[:3, 3] for joints in (truth, read)]
    return float(np.linalg.norm(at[0] - at[1])), read - truth


def arm_of(encoders: FanucEncoders):
    encoder = "link" if encoders.couple3 == -2 else "ground"
    return replace(ARM, conventions=replace(ARM.conventions, encoder3=encoder))


@pytest.mark.parametrize("encoders", [R2000IB, M900IA], ids=["link", "ground"])
def test_the_sheet_by_a_backup_removes_the_error(encoders, found, tmp_path):
    before, _ = errors(encoders, list(encoders.master))
    assert before > 10
    counts = FanucCounts.of_options(None, None, 6, backup=write_backup(tmp_path / "b", encoders))
    text = fanuc_text(arm_of(encoders), found, counts)
    after, left = errors(encoders, as_owner(text, encoders))
    np.testing.assert_allclose(left, 0, atol=1e-5)  # a pulse; with the wrist's coupling
    assert after < 0.01
    assert encoders.model in text
    assert "within" not in text.split("Check, before any motion")[1]
    # By hand the coupling of the wrist is left out, and no more; the sheet's last check allows for it.
    signs = ",".join("TRUE" if up else "FALSE" for up in encoders.mosign)
    scales, master = (",".join(map(str, each)) for each in (encoders.scales, encoders.master))
    by_hand = fanuc_text(arm_of(encoders), found, FanucCounts.of_options(master, scales, 6, signs))
    after, left = errors(encoders, as_owner(by_hand, encoders))
    assert after < before / 20
    np.testing.assert_allclose(left[:4], 0, atol=1e-5)
    assert 0.003 < abs(left[4]) < 0.010
    allowed = dict(re.findall(r"^  (J\d) \S+ deg, within ([\d.]+) deg$", by_hand, flags=re.MULTILINE))
    assert set(allowed) == {"J5", "J6"}
    for joint, within in allowed.items():
        assert abs(left[int(joint[1]) - 1]) < float(within) < 0.02


@pytest.mark.parametrize("encoders", [R2000IB, M900IA], ids=["link", "ground"])
def test_without_the_sign_the_error_of_a_joint_doubles_which_is_refused(encoders, found):
    """The negative control: what a sheet did that took $ENCSCALES, all positive, for the sign."""
    unsigned = FanucCounts(encoders.master, encoders.scales)
    _, left = errors(encoders, as_owner(fanuc_text(arm_of(encoders), found, unsigned), encoders))
    wrong = [i for i, up in enumerate(encoders.mosign) if not up and not (i == 2 and encoders.couple3 == 0)]
    np.testing.assert_allclose(left[wrong], -2 * np.array(OFFSETS)[wrong], atol=1e-4)
    scales, master = (",".join(map(str, each)) for each in (encoders.scales, encoders.master))
    with pytest.raises(BadInput, match=r"the sign of the pulses is not stated: \$ENCSCALES has none"):
        FanucCounts.of_options(master, scales, 6)


def test_what_a_person_states_by_hand():
    scales = "333637.8,422707.2,393473"
    counts = FanucCounts.of_options("1,2,3", scales, 3, "false, TRUE,TRUE")
    assert counts.per_degree == (-333637.8, 422707.2, 393473.0)
    for pulses, mosign, what in (
        (scales, "FALSE,TRUE", "--mosign is not understood"),
        (scales, "0,1,1", "--mosign is not understood"),
        ("-333637.8,422707.2,393473", "FALSE,TRUE,TRUE", "the sign of the pulses is stated twice"),
        ("19116040,24219340,22544340", "FALSE,TRUE,TRUE", "these are not the pulses for a degree"),
    ):
        with pytest.raises(BadInput, match=what):
            FanucCounts.of_options("1,2,3", pulses, 3, mosign)
    with pytest.raises(BadInput, match="the counts are stated twice"):
        FanucCounts.of_options("1,2,3", scales, 3, backup=Path())


def test_what_is_read(tmp_path):
    for encoders, encoder3 in ((R2000IB, "link"), (M900IA, "ground")):
        folder = write_backup(tmp_path / encoder3, encoders)
        read = read_fanuc_backup(folder, 6)
        assert (read.model, read.master, read.encoder3) == (encoders.model, encoders.master, encoder3)
        np.testing.assert_allclose(read.per_degree, encoders.per_degree)
        np.testing.assert_allclose(read.coupling, encoders.coupling, atol=1e-6)
        assert read_fanuc_backup(folder / "SYSMAST.VA", 6).master == read.master
    (tmp_path / "link" / "SYSMAST.VA").rename(tmp_path / "link" / "sysmast.va")
    assert read_fanuc_backup(tmp_path / "link", 6).encoder3 == "link"


@pytest.mark.parametrize(
    ("old", "new", "what", "by_line"),
    [
        ("      [3] = 31987538", "      [3] = 3198x538", "damaged", True),
        ("      [3] = 31987538\n", "", "damaged", True),
        ("      [2] = 17967951", "      [2] = 17967951.5", "damaged", True),
        ("      [2] = 17967951", "      [2] = Uninitialized", "damaged", True),
        ("$DMR_GRP[1].$MASTER_COUN  ARRAY[9] OF INTEGER", "$DMR_GRP[1].$MASTER_COUN  ARR", "damaged", True),
        ("$DMR_GRP[1].$MASTER_COUN  ARRAY[9]", "$DMR_GRP[1].$MASTER_COUN  ARRAY[5]", "damaged", True),
        ("$DMR_GRP[2].$MASTER_COUN", "$DMR_GRP[1].$MASTER_COUN", "not whole", True),
        ("$DMR_GRP[1].$MASTER_COUN", "$DMR_GRP[3].$MASTER_COUN", "not whole", False),
        ("BOOLEAN = TRUE", "BOOLEAN = FALSE", "not mastered", False),
        ("      [1] = 3.336378e+05", "      [1] = 0.000000e+00", "damaged", True),
        ("      [1] = 3.336378e+05", "      [1] = nan", "damaged", True),
        ("$PARAM_GROUP[1].$MOSIGN", "$PARAM_GROUP[1].$MOSIG", "not whole", False),
        ("      [3] = -2", "      [3] = 2", "not worked out", False),
    ],
)
def test_a_damaged_file_is_refused_by_its_line(old, new, what, by_line, tmp_path):
    whole = write_backup(tmp_path / "whole", R2000IB)
    folder = write_backup(tmp_path / "b", R2000IB, {old: new})
    with pytest.raises(BadInput, match=what) as refused:
        read_fanuc_backup(folder, 6)
    name = Path(refused.value.file).name
    before, _, _ = (whole / name).read_text("latin-1").partition(old.rstrip())
    assert refused.value.line == (before.count("\n") + 1 if by_line else None)


def test_a_file_that_is_cut_off_is_refused(tmp_path):
    """Anywhere: at no line a whole answer is left of less than the file."""
    folder = write_backup(tmp_path / "b", R2000IB)
    lines = (folder / "SYMOTN.VA").read_bytes().splitlines(keepends=True)
    for count in range(1, len(lines), 3):
        (folder / "SYMOTN.VA").write_bytes(b"".join(lines[:count]))
        with pytest.raises(BadInput):
            read_fanuc_backup(folder, 6)


def test_other_couplings_and_folders_are_refused(tmp_path):
    backwards = replace(R2000IB, driven=((3, 4, 0.009),))
    falling = replace(R2000IB, mosign=(False, True, True, False, True, True))
    strong = replace(R2000IB, driven=((4, 3, 0.2),))
    for name, encoders in (("a", backwards), ("b", falling), ("c", strong)):
        with pytest.raises(BadInput, match="not worked out here"):
            read_fanuc_backup(write_backup(tmp_path / name, encoders), 6)
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(BadInput, match="the backup is not understood"):
        read_fanuc_backup(empty, 6)
    with pytest.raises(BadInput, match="no such folder"):
        read_fanuc_backup(tmp_path / "none", 6)


def test_a_backup_of_another_arm_is_refused(found, tmp_path):
    counts = FanucCounts.of_options(None, None, 6, backup=write_backup(tmp_path / "b", M900IA))
    with pytest.raises(BadInput, match="disagree on what the encoder of joint 3 measures"):
        fanuc_text(ARM, found, counts)
    unstated = replace(ARM, conventions=replace(ARM.conventions, encoder3=None))
    assert "the direction of link 3" in fanuc_text(unstated, found, counts)
    with pytest.raises(BadInput, match="what does the encoder of joint 3 measure"):
        fanuc_text(unstated, found, None)


ROWS = ["312 -90 0 0 -185 185", "1075 180 0 -90 -60 76", "225 -90 0 0 -155 240"]
ROWS += ["0 90 -1280 0 -360 360", "0 -90 0 0 -125 125", "0 0 -215 0 -360 360"]


def test_a_new_robot_file_has_what_a_backup_says(tmp_path):
    folder, mine = write_backup(tmp_path / "b", M900IA), tmp_path / "mine.yaml"
    rows = [part for row in ROWS for part in ("--row", row)]
    new = ["robot", "new", "-o", mine, "--vendor", "fanuc", "--fanuc-backup", folder]
    told = zerobeam(*new, *rows)
    assert told.status == 0
    assert "encoder: {joint3: ground}" in mine.read_text()
    assert "M-900iA/260L_iC" in mine.read_text()
    assert "joint 3" in told.out
    kuka = zerobeam(
        "robot", "new", "-o", tmp_path / "k.yaml", "--vendor", "kuka", "--fanuc-backup", folder, *rows
    )
    assert kuka.status == 2
    assert not (tmp_path / "k.yaml").exists()
    copied = zerobeam("robot", "r2000ic_165f", "-o", tmp_path / "c.yaml", "--fanuc-backup", folder)
    assert "disagree on what the encoder of joint 3 measures" in copied.err
