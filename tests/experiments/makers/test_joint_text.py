"""tests/experiments/makers/test_joint_text.py."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from import_files import import_program_log

from zerobeam.experiments.makers.import_jobs import Imported, ImportJob
from zerobeam.experiments.makers.joint_text import is_program_log, joints_so_far, labelled, typed_joints
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan, read_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.pendant import pendant_of

VALUES = (1.2, 3.0, -4.0, 5.0, 6.0, 7.5)


@pytest.mark.parametrize(
    "text",
    [
        "1.2 3 -4 5 6 7.5",
        "1.2, 3, -4, 5, 6, 7.5",
        "1.2,3,-4,5,6,7.5",
        "1.2;3;-4;5;6;7.5",
        "1.2\t3\t-4\t5\t6\t7.5\n",
        "1,2\t3\t-4\t5\t6\t7,5",
        "1,2; 3,0; -4,0; 5,0; 6,0; 7,5",
        "[1.2, 3.0, -4.0, 5, 6, 7.5]",
        "(1.2 3 −4 5 6 7.5)",
        "1.2° 3° -4° 5° 6° 7.5°",
        "[[1.2,3,-4,5,6,7.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]]",
        "CONST jointtarget p10:=[[1.2,3,-4,5,6,7.5],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];",
        "{A1 1.2,A2 3,A3 -4,A4 5,A5 6,A6 7.5,E1 0.0,E2 0.0}",
        "DECL E6AXIS XP1={A1 1.2,A2 3,A3 -4,A4 5,A5 6,A6 7.5}",
        "J1=     1.200 deg,\tJ2=  3.0 deg,\tJ3= -4 deg,\nJ4= 5.0 deg,\tJ5= 6 deg,\tJ6= 7.5 deg",
        "J6: 7.5 J1: 1.2 J2: 3 J3: -4 J4: 5 J5: 6",
        "Joint 1 1,2\nJoint 2 3\nJoint 3 -4\nJoint 4 5\nJoint 5 6\nJoint 6 7,5",
        "q0=1.2 q1=3 q2=-4 q3=5 q4=6 q5=7.5",
        "S 1.2 L 3 U -4 R 5 B 6 T 7.5",
        "S 1.2\nL 3\nU -4\nR 5\nB 6\nT 7.5",
        "1.2\n3\n-4\n5\n6\n7.5",
        "1.2 | 3 | -4 | 5 | 6 | 7.5",
        "+1.2 3. -4 5e0 6 0.75E1".replace("3. ", "3 "),
    ],
)
def test_common_forms(text: str) -> None:
    assert typed_joints(text, 6).values == VALUES


@pytest.mark.parametrize(
    ("text", "unit"),
    [("[1, 2] rad", "rad"), ("1 deg, 2 deg", "deg"), ("1° 2°", "deg"), ("1 2", None)],
)
def test_a_stated_unit_is_heard(text: str, unit: str | None) -> None:
    assert typed_joints(text, 2).unit == unit


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no numbers"),
        ("1 2 3 4 5", "5 numbers"),
        ("1 2 3 4 5 6 7", "7 numbers"),
        ("1 2 3 four 5 6", "no numbers"),
        ("X 100, Y 200, Z 300, A 0, B 90, C 0", "Cartesian"),
        ("{X 100,Y 200,Z 300,A 0,B 90,C 0,S 2,T 35}", "Cartesian"),
        ("J1= 1 deg, J2= 2 deg", "none for joint 3, 4, 5, 6"),
        ("1 2 3 nan 5 6", "no numbers"),
        ("\x1b[31m1 2", r"\u001b"),
    ],
)
def test_what_cannot_be_meant_is_refused(text: str, said: str) -> None:
    with pytest.raises(BadInput) as error:
        typed_joints(text, 6)
    assert said in str(error.value)


def test_labels_by_number() -> None:
    assert labelled("J1: 10 J3: −5") == {1: 10.0, 3: -5.0}
    assert labelled("1 2 3") == {}
    assert labelled("T 5 S 2") == {}  # KUKA's status and turn


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("S 1.2", 1),
        ("S: 1.2 deg L: -3,5 deg", 2),
        ("S 1000 pulses L 2000 pulses U 3 R 4 B 5 T 6", 6),
        ("1.2", 1),
        ("1.2 −3,5", 2),
        ("J1= 10 deg", 1),
        ("S 2 T 35", 0),
        ("T 5", 0),
        ("[1.2", 0),
        ("pause", 0),
    ],
)
def test_joints_that_are_begun(text: str, count: int) -> None:
    assert joints_so_far(text) == count


def test_values_without_names_are_in_the_pendants_order_and_names_are_the_pendants() -> None:
    own = replace(load_robot("gp7").conventions, order=(0, 1, 5, 2, 3, 4))
    pendant = pendant_of(replace(load_robot("gp7"), conventions=own))
    assert typed_joints("1 2 6 3 4 5", 6, pendant).values == (1, 2, 3, 4, 5, 6)
    assert typed_joints("T 6, S 1, L 2, U 3, R 4, B 5", 6, pendant).values == (1, 2, 3, 4, 5, 6)
    assert typed_joints("1 2 6 3 4 5 pulses", 6, pendant).unit == "pulse"
    assert labelled("Wrist 2: 5 deg, Base: −10", ["Base", "Shoulder", "Elbow", "Wrist 1", "Wrist 2"]) == {
        1: -10.0,
        5: 5.0,
    }


PLAN = """\
schema: zerobeam/plan/1
robot: irb1600
tool: {kind: laser, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
targets: {left: {guess_mm: [900, 0, 0]}, right: {guess_mm: [900, 100, 0]}}
postures_deg:
  - {joints_deg: [10, 20, -30, 40, 50, -60], target: left}
  - {joints_deg: [-12, 31, -20, 55, 40, -75], target: right}
  - {joints_deg: [25, 5, -44, 70, 65, -20], target: left}
"""
ROWS = ["10.1 20 -30 40 51.25 -60", "-12 31 -20 55.5 40 -75", "25 5 -44 70 65.5 -20"]


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    (tmp_path / "plan.yaml").write_text(PLAN)
    return read_plan(tmp_path / "plan.yaml")


def read(folder: Path, plan: Plan | Path, text: str, targets: tuple[str, ...] = ()) -> Imported:
    file = folder / "zb_plan.log"
    file.write_text(text)
    return import_program_log([file], targets, plan, folder / "run.jsonl", source="RAPID")


def lines(*numbers: int) -> str:
    return "".join(f"zerobeam posture {number} deg {ROWS[number]}\n" for number in numbers)


def test_measurements_have_the_numbers_and_targets_of_the_plan(tmp_path: Path, plan: Plan) -> None:
    found = read(tmp_path, plan, f"\nzerobeam plan {plan.sha256[:12]}\n" + lines(2, 0, 1))
    assert [(shot.shot, shot.target) for shot in found.shots] == [(2, "left"), (0, "left"), (1, "right")]
    np.testing.assert_array_equal(found.shots[1].joints_deg, [10.1, 20, -30, 40, 51.25, -60])
    assert found.header.provenance["plan sha256"] == plan.sha256
    assert f"postures and targets by the plan {plan.path}" in found.understood
    assert "RAPID: lines of a plan's program, in degrees, joint 1 first" in found.understood


def test_whole_millionths_in_a_list_behind_what_a_controller_prints(tmp_path: Path, plan: Plan) -> None:
    values = "[-12000001, 31000000, -20000000, 55500000, 40000000, -75000000]"
    text = f"2026-11-22 15:00 :-: zerobeam posture 1 microdegrees {values}\r\n"
    found = read(tmp_path, plan, text)
    np.testing.assert_allclose(found.shots[0].joints_deg, [-12.000001, 31, -20, 55.5, 40, -75], atol=1e-12)


def test_the_last_recording_of_a_posture_counts(tmp_path: Path, plan: Plan) -> None:
    found = read(tmp_path, plan, lines(0, 1).replace("51.25", "51") + lines(0))
    assert [shot.shot for shot in found.shots] == [1, 0]
    assert found.shots[1].joints_deg[4] == 51.25
    assert "  recorded more than once, the last one counts: posture 0" in found.understood


def test_a_line_without_its_end_may_lack_digits(tmp_path: Path, plan: Plan) -> None:
    found = read(tmp_path, plan, lines(0, 1, 2).removesuffix("0\n"))
    assert [shot.shot for shot in found.shots] == [0, 1]
    assert "  line 3 has no end and is ignored" in found.understood


@pytest.mark.parametrize(
    ("text", "what", "line"),
    [
        ("nothing\n", "no measurements found: the file has no line of a plan's program", None),
        ("zerobeam rehearsal 0 deg 1 2 3 4 5 6\n", "the log is of a rehearsal", 1),
        ("zerobeam plan 0123456789ab\n" + lines(0), "the log is of another plan", 1),
        ("zerobeam posture 0 deg 1 2 3\n", "the joints of a posture cannot be read", 1),
        ("zerobeam posture 0 deg 1 2 3 4 5 x\n", "the joints of a posture cannot be read", 1),
        ("zerobeam posture 0 deg 1 2 3 4 5 nan\n", "the joints of a posture cannot be read", 1),
        ("zerobeam posture 0 rad 1 2 3 4 5 6\n", "the joints of a posture cannot be read", 1),
        ("zerobeam posture 0 deg 1 2 3 4 5 6 7\n", "posture 0 has the wrong number of joints", 1),
        (lines(0).replace("posture 0", "posture 3"), "there are more measurements than the plan has", 1),
        (
            "\n" + lines(2).replace("posture 2", "posture 1"),
            "measurement 1 is not at the plan's posture 1",
            2,
        ),
    ],
)
def test_logs_that_are_refused(
    tmp_path: Path, plan: Plan, text: str, what: str, line: int | None, refused: Callable[..., BadInput]
) -> None:
    error = refused(read, tmp_path, plan, text)
    assert error.what.startswith(what)
    assert error.line == line
    assert error.file == str(tmp_path / "zb_plan.log")


def test_the_planned_postures_themselves_are_no_measurements(
    tmp_path: Path, plan: Plan, refused: Callable[..., BadInput]
) -> None:
    text = "zerobeam posture 0 deg 10 20 -30 40 50 -60\nzerobeam posture 2 deg 25 5 -44 70 65 -20\n"
    assert refused(read, tmp_path, plan, text).what == "these are the planned postures, not measured ones"
    assert len(read(tmp_path, plan, text + lines(1)).shots) == 3


def test_without_a_plan_a_header_and_a_target(
    tmp_path: Path, plan: Plan, refused: Callable[..., BadInput]
) -> None:
    header = tmp_path / "header.yaml"
    header.write_text(PLAN[PLAN.index("robot") : PLAN.index("targets")])
    assert [shot.target for shot in read(tmp_path, header, lines(2, 0), ("mine",)).shots] == ["mine"] * 2
    assert "targets are stated, and a plan" in refused(read, tmp_path, plan, lines(0), ("mine",)).what


def test_a_pattern_stands_for_files(tmp_path: Path, plan: Plan, refused: Callable[..., BadInput]) -> None:
    (tmp_path / "b.log").write_text(lines(1))
    (tmp_path / "a.log").write_text(lines(2, 0))
    pattern = tmp_path / "?.log"
    assert is_program_log(ImportJob.begin([pattern], plan, tmp_path / "run.jsonl"))
    found = import_program_log([pattern], [], plan, tmp_path / "run.jsonl", source="RAPID")
    assert [shot.shot for shot in found.shots] == [2, 0, 1]
    error = refused(
        import_program_log, [tmp_path / "*.txt"], [], plan, tmp_path / "run.jsonl", source="RAPID"
    )
    assert error.what == "no file matches"
    (tmp_path / "c.log").write_text(lines(1))
    error = refused(import_program_log, [pattern], [], plan, tmp_path / "run.jsonl", source="RAPID")
    assert error.what == "duplicate measurement number"
