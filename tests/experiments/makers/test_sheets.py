"""The sheets for UR, KUKA and FANUC: their signs, followed by hand, give true positions."""

import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import zerobeam
from exact_runs import demo_runs

from zerobeam.experiments.makers.calibration import calibration
from zerobeam.experiments.makers.fanuc.mastering import FanucCounts, fanuc_text
from zerobeam.experiments.makers.maker import makers
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import read_run

SHEETS = {kind.name: kind.text for maker in makers() for kind in maker.offsets}
GOOD = demo_runs()[0].path
PULSES = (10000.0, -11000.0, 12000.0, -9000.0, 8000.5, 7000.0)
COUNTS = (100, 200, -300, 400, 500, 600)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The good run with a robot of no known vendor."""
    folder = tmp_path_factory.mktemp("sheets")
    made = folder / "arm.yaml"
    told = zerobeam("export", "robot", GOOD, "-o", made)
    assert told.status == 0
    text = re.sub(r"^vendor:.*\n", "", made.read_text(), flags=re.MULTILINE)
    factory = "# Arm with the factory calibration of calibration.conf.\n"
    made.write_text(factory + re.sub(r"^name:.*", "name: arm", text, flags=re.MULTILINE))
    copy = folder / "run.jsonl"
    stated = '"sigma":{"tilt_deg":1e-5,"shift_mm":1e-5},"kind":"laser"'  # what is assumed is not exported
    text = GOOD.read_text().replace('"robot":"irb1600"', '"robot":"arm.yaml"', 1)
    copy.write_text(text.replace('"kind":"laser"', stated, 1))
    return read_run(copy)


@pytest.fixture(scope="module")
def offsets(run):
    """The calibration of the run, and its offsets in degrees."""
    found = calibration(run)
    return found, [own.applied for own in found.offsets]


def numbers(text, pattern):
    return [float(value) for value in re.findall(pattern, text, flags=re.MULTILINE)]


@pytest.mark.long
def test_universal_robots(run, offsets):
    found, values = offsets
    text = SHEETS["ur"](run, found)
    at = numbers(text, r"^J\d +\S+ +([-+][\d.]+)$")
    # Where the controller reads this, the joint is truly at zero: true = reading + offset.
    np.testing.assert_allclose(np.array(at) + values[1:], 0, atol=1e-6)
    assert re.search(r"^J1 +- +leave it as it is$", text, flags=re.MULTILINE)
    assert "CAUTION" in text
    text.encode("ascii")


def test_kuka(run, offsets):
    found, values = offsets
    text = SHEETS["kuka"](run, found)
    np.testing.assert_allclose(
        numbers(text, r"mastering position +([-+][\d.]+) deg"), np.negative(values[1:]), atol=1e-6
    )
    np.testing.assert_allclose(numbers(text, r"old value +([-+][\d.]+)$"), values[1:], atol=1e-6)


def test_yaskawa(run, offsets):
    """At the reading where the home position is registered, reading + offset is zero; in pulses too."""
    found, values = offsets
    pattern = r"^J\d +\S+ +([-+][\d.]+) deg"
    np.testing.assert_allclose(
        numbers(SHEETS["yaskawa"](run, found), pattern), np.negative(values[1:]), atol=1e-6
    )
    pulses = replace(run.robot.conventions, unit="pulse", pulses_per_deg=PULSES)
    text = SHEETS["yaskawa"](replace(run, robot=replace(run.robot, conventions=pulses)), found)
    shown = np.array(numbers(text, r"= ([-+]\d+) pulses$")) / PULSES[1:]
    np.testing.assert_allclose(shown, np.negative(values[1:]), atol=1e-4)


def test_epson(run, offsets):
    found, values = offsets
    shown = numbers(SHEETS["epson"](run, found), r"Agl\(\d\) = +([-+][\d.]+) deg   Calib \d$")
    np.testing.assert_allclose(shown, np.negative(values[1:]), atol=1e-6)


@pytest.mark.parametrize("encoder", ["link", "ground"])
@pytest.mark.parametrize("pendant", ["link", "ground"])
def test_fanuc_counts_make_the_controller_read_the_truth(run, offsets, encoder, pendant):
    """What the encoder measures decides, whatever the pendant counts joint 3 from."""
    found, values = offsets
    robot = replace(run.robot, conventions=replace(run.robot.conventions, encoder3=encoder))
    text = fanuc_text(robot, found, FanucCounts(COUNTS, PULSES), pendant)
    assert "--master-counts" in fanuc_text(robot, found, None, pendant)
    assert "--master-counts" not in text
    assert ("from the ground: at the same place" in text) == (pendant == "ground")
    assert "DCS (Dual Check Safety)" in text
    rows = re.findall(r"^J(\d) +\S+ +(-?\d+) +\(now (-?\d+)\)$", text, flags=re.MULTILINE)
    assert [int(row[0]) for row in rows] == [2, 3, 4, 5, 6]
    pulses = np.array([5000, 6000, 7000, 8000, 9000, 10000])

    def read(counts):
        """The angles between the links that a controller with these encoders believes in."""
        own = (pulses - counts) / np.array(PULSES)
        if encoder == "ground":
            own[2] += own[1]
        return own

    new = np.array([COUNTS[0], *(int(row[1]) for row in rows)])
    np.testing.assert_allclose(read(new) - read(np.array(COUNTS)), values, atol=2e-4)


def test_a_vendor_is_known_by_the_robots_name_too(run, offsets):
    found, _ = offsets
    named = replace(run, robot=replace(run.robot, name="My IRB 1600"))
    assert (run.robot.vendor, named.robot.vendor) == (None, None)
    for name in ("ur", "kuka", "fanuc"):
        with pytest.raises(BadInput, match="this sheet is for robots of"):
            SHEETS[name](named, found)


def test_counts_that_cannot_be_used():
    for master, pulses in (
        ("1,2", "1000,2000,3000"),
        ("1,2,x", "1000,2000,3000"),
        ("1,2,3", None),
        ("1.5,2,3", "1000,2000,3000"),
        ("1,2,3", "1000,0,3000"),
        ("1,2,3", "1000,-99,3000"),
    ):
        with pytest.raises(BadInput):
            FanucCounts.of_options(master, pulses, 3)
    FanucCounts.of_options("1,2,3", "1000,-100,3000", 3)
    assert FanucCounts.of_options(None, None, 3) is None


def must_read(text):
    """What the pendant is to read more, deg, by the check of a sheet."""
    rows = re.findall(r"^  (\w+) ([-+][\d.]+) deg(?:, within [\d.]+ deg)?$", text, flags=re.MULTILINE)
    return {name: float(change) for name, change in rows}


@pytest.mark.parametrize("name", ["ur", "kuka", "epson", "yaskawa"])
def test_a_sheet_says_what_the_pendant_reads_after_the_change(run, offsets, name):
    found, values = offsets
    reads = must_read(SHEETS[name](run, found))
    np.testing.assert_allclose(list(reads.values()), values[1:], atol=6e-4)


@pytest.mark.parametrize("pendant", ["link", "ground"])
def test_a_fanuc_sheet_checks_signs_before_and_readings_after(run, offsets, pendant):
    found, values = offsets
    robot = replace(run.robot, conventions=replace(run.robot.conventions, encoder3="link"))
    text = fanuc_text(robot, found, FanucCounts(COUNTS, PULSES), pendant)
    assert "J1 +100000, J2 -110000, J3 +120000, J4 -90000" in text
    assert "jog each joint alone (JOINT) by +10 deg" in text
    assert "$DMR_GRP[1].$MASTER_DONE must be TRUE" in text
    reads = list(must_read(text).values())
    # Counted from the ground, joint 3 is that of the link less joint 2.
    np.testing.assert_allclose(reads[1], values[2] - (values[1] if pendant == "ground" else 0), atol=6e-4)
    np.testing.assert_allclose([reads[0], *reads[2:]], [values[1], *values[3:]], atol=6e-4)


@pytest.mark.parametrize("name", ["ur", "kuka", "epson", "yaskawa"])
def test_an_offset_that_no_arm_has_is_in_no_sheet(run, offsets, name):
    found, _ = offsets
    first, second, *others = found.offsets
    for size in (9.9, -10.1):
        large = replace(second, row=replace(second.row, estimate=size), to_enter=None)
        answer = replace(found, offsets=(first, large, *others))
        if abs(size) < 10:
            assert f"{size:+.3f} deg" in SHEETS[name](run, answer)
        else:
            with pytest.raises(BadInput, match="more than an offset of a calibrated arm"):
                SHEETS[name](run, answer)


@pytest.mark.parametrize("name", ["ur", "kuka", "yaskawa"])
def test_a_simulated_run_is_said_to_be_in_the_first_line_and_at_the_table(run, offsets, name):
    lines = SHEETS[name](run, offsets[0]).splitlines()
    stated = "SIMULATED: no robot was measured, so that nothing here may be applied to one"
    head, table = (i for i, line in enumerate(lines) if line == stated)
    assert head == 0
    assert "offset deg" in lines[table + 1]
    measured = replace(run, header=run.header.model_copy(update={"provenance": {}}))
    assert "SIMULATED" not in SHEETS[name](measured, calibration(measured))


def test_a_sheet_without_counts_says_so_when_it_is_written(run, tmp_path):
    text = (run.path.parent / "arm.yaml").read_text() + "encoder: {joint3: link}\n"
    (tmp_path / "arm.yaml").write_text(text)
    copy = tmp_path / "run.jsonl"
    copy.write_bytes(run.path.read_bytes())
    options = ["export", "fanuc", copy, "--j3", "ground", "--json"]
    without = zerobeam(*options, "-o", tmp_path / "a.txt").json
    sentence = (
        "without new counts: state --backup FOLDER, or master counts, pulses per degree and signs, for them"
    )
    assert sentence in without["notes"]
    counts, pulses = (",".join(map(str, values)) for values in (COUNTS, PULSES))
    stated = [f"--master-counts={counts}", f"--pulses-per-degree={pulses}"]
    assert sentence not in zerobeam(*options, *stated, "-o", tmp_path / "b.txt").json["notes"]
