"""Programs of a plan, read back to its last digit; what their languages cannot hold is refused."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import fanuc_interpreter
import numpy as np
import pytest
import robodk_interpreter
import ros_interpreter
import urscript_interpreter
from cells import good_plan, random_robot
from command_line import zerobeam
from exact_runs import demo_runs
from import_files import import_csv, positions_of
from krl_interpreter import KrlController
from rapid_interpreter import RapidController

from zerobeam.experiments.makers import plan_programs
from zerobeam.experiments.makers.calibration import calibration
from zerobeam.experiments.makers.fanuc.mastering import FanucCounts, fanuc_text
from zerobeam.experiments.makers.generic.joint_logs import CsvLayout
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.manifest import ProgramTemplate
from zerobeam.experiments.makers.plan_programs import (
    ProgramMotion,
    decimal,
    percents,
    program_texts,
    steps_of,
    write_program,
)
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import read_run

PLAN = """\
schema: zerobeam/plan/1
robot: {robot}
tool: {{kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}}
noise: {{joint_deg: 0.01, spot_mm: 0.05}}
targets: {{"left \\"one\\"": {{guess_mm: [500, 0, 0]}}, right: {{guess_mm: [500, 100, 0]}}}}
postures_deg:
  - {{joints_deg: [-69.348, -18.862, 49.27, 0.0000001, -39.5, 12.123456789], target: right}}
  - joints_deg: [10, -20, 30, 40, -50, 60]
    target: 'left "one"'
    via_deg: [[0, -10, 20, 0.5, -30, 0], [5, -15, 25, 0, -40, 30]]
"""
ROBOTS = {
    "rapid": "irb1600",
    "urscript": "ur5e",
    "krl": "kr6_r900",
    "fanuc": "lrmate_200id",
    "robodk": "gp7",
    "ros": "irb2600",
    "csv": "tx2_60",
}
FIRST = (-69.348, -18.862, 49.27, 1e-7, -39.5, 12.123456789)
VIA = ((0.0, -10.0, 20.0, 0.5, -30.0, 0.0), (5.0, -15.0, 25.0, 0.0, -40.0, 30.0))
LAST = (10.0, -20.0, 30.0, 40.0, -50.0, 60.0)


class Obedient:
    """Goes where it is told; nothing has to be centred."""

    def __init__(self, plan: Plan) -> None:
        self.plan, self.moves, self.paused_after = plan, [], []

    def move(self, joints: Any) -> None:
        self.moves.append(tuple(joints))

    def joints(self) -> list[float]:
        return list(self.moves[-1]) if self.moves else [0.0] * self.plan.robot.n

    def centre(self) -> None:
        self.paused_after.append(len(self.moves))


def plan_of(folder: Path, kind: str) -> Plan:
    path = folder / "plan.yaml"
    text = PLAN.format(robot=ROBOTS[kind])
    path.write_text(text)
    return read_plan(path)


def files_of(folder: Path, kind: str, motion: ProgramMotion) -> dict[str, str]:
    suffix = {"krl": ".src", "fanuc": ".ls"}.get(kind, ".txt")
    texts = program_texts(kind, plan_of(folder, kind), motion, folder / f"zb_plan{suffix}")
    return {path.suffix: text for path, text in texts.items()}


def moved(folder: Path, kind: str, motion: ProgramMotion, monkeypatch: pytest.MonkeyPatch) -> Obedient:
    """What an interpreter does with the program."""
    monkeypatch.chdir(folder)
    arm: Any = Obedient(plan_of(folder, kind))
    texts = files_of(folder, kind, motion)
    text = next(iter(texts.values()))
    if kind == "rapid":
        RapidController(text, arm).run()
    elif kind == "urscript":
        urscript_interpreter.carried_out(text, arm)
    elif kind == "fanuc":
        fanuc_interpreter.carried_out(text, arm, ground=motion.j3 == "ground")
    elif kind == "robodk":
        robodk_interpreter.carried_out(text, arm)
    elif kind == "ros":
        ros_interpreter.carried_out(text, arm)
    else:
        controller = KrlController(texts[".src"], texts[".dat"], arm)
        while controller.start():
            arm.centre()
    return arm


@pytest.mark.parametrize("kind", [kind for kind in ROBOTS if kind != "csv"])
def test_a_program_goes_through_the_plan_in_its_order_and_waits_at_each_posture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    arm = moved(tmp_path, kind, ProgramMotion(j3="ground" if kind == "fanuc" else None), monkeypatch)
    np.testing.assert_allclose(arm.moves, [FIRST, *VIA, LAST], atol=1e-10, rtol=0)
    assert arm.paused_after == [1, 4]


@pytest.mark.parametrize("kind", ["rapid", "urscript", "krl", "fanuc", "robodk"])
def test_the_path_is_rounded_at_intermediate_postures_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    motion = ProgramMotion(zone=20, j3="link" if kind == "fanuc" else None)
    text = next(iter(files_of(tmp_path, kind, motion).values()))
    rounded = {"rapid": r",zb_zone;", "urscript": r"r=0.02", "krl": r"C_PTP", "fanuc": r"CNT20"}
    if kind == "robodk":
        assert "robot.setRounding(20)" in text
    else:
        assert len(re.findall(rounded[kind], text)) == 2
    assert moved(tmp_path, kind, motion, monkeypatch).paused_after == [1, 4]


def test_declared_positions_are_those_of_the_plan_to_the_last_digit(tmp_path: Path) -> None:
    rapid = positions_of("rapid", files_of(tmp_path, "rapid", ProgramMotion())[".txt"], tmp_path)
    assert [point.joints for point in rapid] == [FIRST, *VIA, LAST]
    assert [point.name for point in rapid] == ["zb_p0", "zb_v1_1", "zb_v1_2", "zb_p1"]
    kuka = positions_of("krl", files_of(tmp_path, "krl", ProgramMotion())[".dat"], tmp_path)
    assert [point.joints for point in kuka][:4] == [FIRST, *VIA, LAST]
    link = positions_of("fanuc", files_of(tmp_path, "fanuc", ProgramMotion(j3="link"))[".ls"], tmp_path)
    assert [point.joints for point in link] == [FIRST, *VIA, LAST]
    ground = positions_of("fanuc", files_of(tmp_path, "fanuc", ProgramMotion(j3="ground"))[".ls"], tmp_path)
    assert [point.joints[2] for point in ground] == [68.132, 30.0, 40.0, 50.0]
    assert [point.joints[1] for point in ground] == [-18.862, -10.0, -15.0, -20.0]


def test_the_table_is_read_by_the_importer_of_tables(tmp_path: Path) -> None:
    plan = good_plan(3)
    file = tmp_path / "plan.csv"
    write_program("csv", plan, ProgramMotion(), file)
    (tmp_path / "header.yaml").write_text(
        "robot: irb1600\ntool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}\n"
        "noise: {joint_deg: 0.01, spot_mm: 0.05}\n"
    )
    columns = [f"joint{i}_deg" for i in range(1, 7)]
    layout = CsvLayout("deg", header_row=True, columns=columns, target_column="target", shot_column="posture")
    found = import_csv([file], [], layout, tmp_path / "header.yaml", tmp_path / "run.jsonl")
    assert [shot.joints_deg for shot in found.shots] == [
        step.joints for step in steps_of(plan, ProgramMotion())
    ]
    assert [shot.target for shot in found.shots] == ["psd"] * 3
    rows = files_of(tmp_path, "csv", ProgramMotion())[".txt"].splitlines()
    assert rows[2] == ",,0.0,-10.0,20.0,0.5,-30.0,0.0"


def test_no_joint_is_faster_than_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = load_robot("kr6_r900")
    top = np.array([joint.speed for joint in robot.joints]) * robot.display
    assert (np.array(percents(robot, 10.0)) * top / 100 <= 10.0).all()
    assert percents(replace(robot, joints=(replace(robot.joints[0], speed=None),)), 20.0) == [2]
    source = files_of(tmp_path, "krl", ProgramMotion(speed=30))[".src"]
    assert [int(value) for value in re.findall(r"\$VEL_AXIS\[\d\]=(\d+)", source)] == percents(robot, 30)
    assert " 5% FINE" in files_of(tmp_path, "fanuc", ProgramMotion(speed=50, j3="link"))[".ls"]
    assert "global zb_v = d2r(12.5)" in files_of(tmp_path, "urscript", ProgramMotion(speed=12.5))[".txt"]
    # RAPID computes the time of a motion where it runs: from zero to -69.348 degrees at 10 degrees a second.
    plan: Any = Obedient(plan_of(tmp_path, "rapid"))
    controller = RapidController(files_of(tmp_path, "rapid", ProgramMotion())[".txt"], plan)
    controller.run()
    assert controller.longest_s == pytest.approx(7.4348)
    time = re.findall(r"time_from_start: (.*)", files_of(tmp_path, "ros", ProgramMotion())[".txt"])
    assert json.loads(time[1])["sec"] == math.floor(69.348 / 10 + 1)


@pytest.mark.parametrize("kind", ["rapid", "urscript", "krl", "fanuc"])
def test_a_robot_of_another_vendor_is_refused(
    tmp_path: Path, kind: str, refused: Callable[..., BadInput]
) -> None:
    file = tmp_path / {"krl": "a.src", "fanuc": "a.ls"}.get(kind, "a.txt")
    motion = ProgramMotion(j3="ground" if kind == "fanuc" else None)
    for other, robot in ROBOTS.items():
        if other == kind or (kind == "rapid" and robot.startswith("irb")):
            continue
        path = tmp_path / f"{robot}.yaml"
        path.write_text(PLAN.format(robot=robot))
        error = refused(write_program, kind, read_plan(path), motion, file)
        assert "is for robots of" in error.what
        path.unlink()
    assert list(tmp_path.iterdir()) == []


def test_a_vendor_by_the_name_alone_and_one_that_nobody_knows(
    tmp_path: Path, refused: Callable[..., BadInput]
) -> None:
    plan = good_plan(2)
    kuka = replace(plan, robot=replace(plan.robot, vendor=None, name="KR 10 R1100-2"))
    error = refused(write_program, "rapid", kuka, ProgramMotion(), tmp_path / "a.mod")
    assert error.found == "KR 10 R1100-2, of kuka"
    unknown = replace(plan, robot=replace(plan.robot, vendor=None, name="our arm"))
    files, notes = write_program("rapid", unknown, ProgramMotion(), tmp_path / "a.mod")
    assert "nothing says who made 'our arm'" in notes[0]
    assert "nothing says who made 'our arm'" in files[0].read_text()


def test_joints_that_a_language_cannot_hold(tmp_path: Path, refused: Callable[..., BadInput]) -> None:
    plan = good_plan(2)
    robot = replace(random_robot("rrprrr", 1), name="irb", vendor="abb")
    error = refused(write_program, "rapid", replace(plan, robot=robot), ProgramMotion(), tmp_path / "a.mod")
    assert error.found == "6 joints, prismatic: joint3"
    seven = replace(random_robot("rrrrrrr", 1), name="iiwa14", vendor="kuka")
    error = refused(write_program, "krl", replace(plan, robot=seven), ProgramMotion(), tmp_path / "a.src")
    assert error.allowed == "at most 6 revolute joints"


@pytest.mark.parametrize(
    ("kind", "motion", "what"),
    [
        ("rapid", {"tool": "a;b"}, "--tool is not a name of RAPID"),
        ("rapid", {"j3": "ground"}, "--j3 is not for rapid"),
        ("krl", {"tool": "0"}, "--tool is not a tool number of KRL"),
        (
            "fanuc",
            {"j3": "link", "register": 100},
            "the position registers of the postures do not exist",
        ),
        ("fanuc", {"j3": "link", "tool": "11"}, "--tool is not a tool frame number of FANUC"),
        ("urscript", {"listener": "here"}, "--listener is not understood"),
        ("urscript", {"tool": "1"}, "--tool is not for urscript"),
        ("csv", {"speed": 20.0}, "--speed is not for csv"),
        ("rapid", {"speed": 200.0}, "--speed is out of range"),
        ("rapid", {"speed": math.nan}, "--speed is out of range"),
        ("rapid", {"zone": -1.0}, "--zone is out of range"),
        ("ros", {"zone": 5.0}, "--zone is not for ros"),
    ],
)
def test_options_that_a_language_has_no_place_for(
    tmp_path: Path, kind: str, motion: dict[str, Any], what: str, refused: Callable[..., BadInput]
) -> None:
    assert refused(lambda: files_of(tmp_path, kind, ProgramMotion(**motion))).what == what


def test_names_that_a_controller_does_not_allow(tmp_path: Path, refused: Callable[..., BadInput]) -> None:
    plan = plan_of(tmp_path, "krl")
    assert refused(write_program, "krl", plan, ProgramMotion(), tmp_path / "1st.src").found == "1st"
    assert refused(write_program, "krl", plan, ProgramMotion(), tmp_path / "a.krl").what == (
        "a KRL program is a .src and a .dat"
    )
    (tmp_path / "a.dat").write_text("mine")
    refused(write_program, "krl", plan, ProgramMotion(), tmp_path / "a.src")
    assert not (tmp_path / "a.src").exists()


def test_numbers_as_machines_read_them() -> None:
    assert [decimal(value) for value in (4.05, 0.0, -69.348, 1e-7, 180.0)] == [
        *("4.05", "0.0", "-69.348", "0.0000001", "180.0")
    ]
    assert decimal(4.0, 3) == "4.000"


def test_a_tp_program_says_which_registers_it_overwrites(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, "fanuc")
    last = 31 + len(plan.postures) - 1
    file = tmp_path / "job.ls"
    _, notes = write_program("fanuc", plan, ProgramMotion(j3="ground", register=31), file)
    (note,) = (note for note in notes if "posreg.va" in note)
    assert f"PR[31] to PR[{last}], and leaves the recorded joints in them" in note
    assert any("counted from the ground" in note for note in notes)
    remarks = re.findall(r"!(.*?) ;", file.read_text())
    assert max(map(len, remarks)) <= 32
    head = " ".join(remarks)
    assert f"OVERWRITES PR[31] to PR[{last}]: save posreg.va before." in head
    assert "about 10 deg/s" in head
    assert "Not checked: collisions." in head
    written = {
        int(number) for number in re.findall(r"PR\[(\d+)[,\]]", file.read_text().partition("UFRAME")[2])
    }
    assert written == set(range(31, last + 1))


# What may hold a name of the plan, remarks first: nothing else of a program may depend on one.
HOLDS_NAMES = {
    "rapid": r"(?m)^ *![^\n]*|\"[^\"\n]*\"",
    "pacscript": r"(?m)^ *'[^\n]*|\"[^\"\n]*\"",
    "drl": r"(?m)^#[^\n]*|\"[^\"\n]*\"",
    "spel": r"(?m)^ *'[^\n]*|\"[^\"\n]*\"",
    "fanuc": r"(?m)^ *\d+:  ![^;\n]* ;$",
    "franka": r"#[^\n]*",
    "as": r"(?m)^ *;[^\n]*|\"[^\"\n]*\"",
    "krl": r"(?m)^ *;[^\n]*",
    "melfa": r"(?m)^'[^\n]*",
    "slim": r"(?m)^'[^\n]*|^REM \"[^\"\n]*\"",
    "val3": r"(?m)^  //(?:(?!\]\]>)[^\n])*",
    "tmscript": r"(?m)^//[^\n]*|\"[^\"\n]*\"",
    "urscript": r"(?m)^#[^\n]*|\"[^\"\n]*\"",
    "inform": r"(?m)^(?:'[^\n]*\n)+",
    "robodk": r"(?s)\A\"\"\".*?\"\"\"|\"(?:[^\"\n\\]|\\.)*\"|'(?:[^'\n\\]|\\.)*'",
}
EVIL = "x\"'); ENDPROC ]]> */ \\ ;\nMoveJ\r\nEND\u2028\x85\x00ü {{ 7 }} << 7 >> {% raw %}"
TEMPLATES = [program for maker in makers() for program in maker.program if program.name in HOLDS_NAMES]


def _without_names(
    kind: str, folder: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> list[tuple[str, str]]:
    monkeypatch.setattr(plan_programs, "called", lambda plan, number: name)
    plan = plan_of(folder, "rapid")
    pulses = replace(plan.robot.conventions, pulses_per_deg=(1000.0,) * 6)
    robot = replace(plan.robot, vendor=None, name=f"arm {name}", conventions=pulses)
    motion = ProgramMotion(j3="link" if kind == "fanuc" else None)
    file = next(folder / program.files[0] for program in TEMPLATES if program.name == kind)
    texts = program_texts(kind, replace(plan, robot=robot, path=Path(f"{name}.yaml")), motion, file)
    return [(path.name, re.sub(HOLDS_NAMES[kind], "@", text)) for path, text in texts.items()]


@pytest.mark.parametrize("kind", HOLDS_NAMES)
def test_no_name_of_a_plan_gets_out_of_a_remark_or_a_string(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    tame, evil = (_without_names(kind, tmp_path, name, monkeypatch) for name in ("psd", EVIL))
    assert [text.encode("ascii") for _, text in evil] == [text.encode() for _, text in tame]


def test_without_the_rules_of_a_language_names_do_get_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tame = {kind: _without_names(kind, tmp_path, "psd", monkeypatch) for kind in HOLDS_NAMES}
    monkeypatch.setattr(plan_programs, "one_line", str)
    monkeypatch.setattr(plan_programs.filled, "__defaults__", (str, str, str))  # quote, escape, line
    monkeypatch.setattr(ProgramTemplate, "__getattribute__", _without_rules)
    for kind in sorted({*HOLDS_NAMES} - {"robodk"}):
        assert _without_names(kind, tmp_path, EVIL, monkeypatch) != tame[kind], kind


def _without_rules(template: ProgramTemplate, name: str) -> Any:
    return str if name in ("quote", "escape") else object.__getattribute__(template, name)


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
