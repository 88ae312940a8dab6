"""The RAPID module, read back and carried out by a small interpreter of what it may consist of."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from export_runs import SLIDING, arm_run, hostile, urdf_run
from import_files import import_rapid, positions_of
from made_backups import DIALECTS
from recorded_logs import POSTURES

from zerobeam.experiments.makers.abb import rapid_text
from zerobeam.experiments.makers.calibration import calibration
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput

_ROUNDED = np.radians(5e-7)  # six decimals of a degree


def carried_out(text: str, function: str, joints: Matrix) -> Matrix:
    """What the module's function gives for jointtargets (N, 6), degrees. Comments are not looked at."""
    code = [line.strip() for line in text.splitlines() if line.strip() and not line.strip().startswith("!")]
    assert re.fullmatch(r"MODULE [a-z_]{1,32}", code[0])
    assert code[-1] == "ENDMODULE"
    constant = re.fullmatch(r"CONST num zb_offset_deg\{6\}:=\[([-0-9.,]+)\];", code[1])
    offsets = [float(number) for number in constant.group(1).split(",")]
    start = next(i for i, line in enumerate(code) if line.startswith(f"FUNC jointtarget {function}("))
    body = code[start + 1 : code.index("ENDFUNC", start)]
    given = re.findall(r"\(jointtarget (\w+)\)", code[start])[0]
    assert body[:2] == ["VAR jointtarget result;", f"result:={given};"]
    assert body[-1] == "RETURN result;"
    result = joints.copy()
    for line in body[2:-1]:
        told = re.fullmatch(
            rf"result\.robax\.rax_(\d):={given}\.robax\.rax_(\d)([-+])zb_offset_deg\{{(\d)\}};", line
        )
        assert told is not None, line
        to, of, index = int(told[1]), int(told[2]), int(told[4])
        result[:, to - 1] = joints[:, of - 1] + float(f"{told[3]}1") * offsets[index - 1]
    return result


def test_commanded_by_it_the_arm_stands_where_it_is_wanted(tmp_path: Path) -> None:
    run = arm_run(tmp_path)
    answer = calibration(run)
    aimed = np.random.default_rng(0).uniform(-90, 90, (20, 6))
    reading = carried_out(rapid_text(answer), "zb_command", aimed)
    truly = np.radians(reading) + [offset.applied_rad for offset in answer.offsets]
    np.testing.assert_allclose(truly, np.radians(aimed), atol=1.01 * _ROUNDED, rtol=0)
    assert abs(reading - aimed).max() > 1
    back = carried_out(rapid_text(answer), "zb_true", reading)
    np.testing.assert_allclose(back, aimed, atol=1e-12)


def test_what_is_held_or_left_out_is_zero_and_said_so(tmp_path: Path) -> None:
    answer = calibration(arm_run(tmp_path), without=["delta4"])
    text = rapid_text(answer)
    joints = np.zeros((1, 6))
    moved = carried_out(text, "zb_true", joints)[0]
    assert (moved == 0).tolist() == [True, False, False, True, False, False]
    comments = " ".join(line.strip(" !") for line in text.splitlines() if line.strip().startswith("!"))
    assert re.search(r"delta1 \(joint1\): HELD at 0", comments)
    assert re.search(r"delta4 \(joint4\): \+0\.\d+ deg, u \S+ deg, identified, EXCLUDED", comments)
    assert answer.inputs.sha256 in comments


def test_a_module_of_a_simulated_run_moves_no_robot(tmp_path: Path) -> None:
    """Its only mark was a comment, and it loaded as any other."""
    run = arm_run(tmp_path)
    provenance = {**run.header.provenance, "origin": "simulated"}
    simulated = replace(run, header=run.header.model_copy(update={"provenance": provenance}))
    text = rapid_text(calibration(simulated))
    command = text.partition("FUNC jointtarget zb_command")[2].partition("ENDFUNC")[0]
    guard = command[command.index("IF RobOS() THEN") : command.index("ENDIF")]
    assert "EXIT;" in guard
    assert "SIMULATED" in guard
    assert command.index("VAR ") < command.index("IF ") < command.index("result:=")
    assert "RobOS" not in rapid_text(calibration(run))


def test_hostile_names_are_comments_only(tmp_path: Path) -> None:
    """Every line that is not a comment is the same as with tame names."""
    run = arm_run(tmp_path)
    tame, wild = (rapid_text(calibration(one)) for one in (run, hostile(run)))
    assert wild != tame
    assert wild.isascii()

    def code(text: str) -> list[str]:
        return [line for line in text.split("\n") if not line.lstrip().startswith("!")]

    assert code(wild) == code(tame)
    assert "\r" not in wild
    assert max(map(len, wild.split("\n"))) < 120


def test_robots_that_a_jointtarget_cannot_hold(tmp_path: Path, refused: Callable[..., BadInput]) -> None:
    run = urdf_run(tmp_path, SLIDING)
    assert "prismatic: j3" in str(refused(rapid_text, calibration(run)).found)


EXTERNAL = "[9E+09,9E9,9E9,9E9,9E9,9E9]"


def target(row) -> str:
    return f"[[{','.join(str(value) for value in row)}],{EXTERNAL}]"


MODULE = f"""\
MODULE Shots(SYSMODULE)
  ! CONST jointtarget no:={target(POSTURES[3])};
  CONST jointtarget p10:={target(POSTURES[0])};
  LOCAL PERS jointtarget p20 :=
    {target(POSTURES[1])}; ! taught
  VAR jointtarget now;
  PERS string said:="CONST jointtarget p5:=[1]; !";
  TASK PERS jointtarget list{{2}}:=[{target(POSTURES[2])},
    {target(POSTURES[3])}];
  CONST robtarget r1:=[[600,0,500],[0,0,1,0],[0,-1,0,1],{EXTERNAL}];
ENDMODULE
"""


def read(tmp_path, header, text, points=None):
    file = tmp_path / "shots.mod"
    file.write_text(text)
    return import_rapid([file], ["a"], header, tmp_path / "run.jsonl", points=points)


def test_declared_jointtargets(tmp_path, header, refused):
    points = ["p10", "p20", "list{1}", "list{2}"]
    found = read(tmp_path, header, MODULE, points)
    np.testing.assert_array_equal([shot.joints_deg for shot in found.shots], POSTURES)
    assert "  points in their order: p10, p20, list{1}, list{2}" in found.understood
    error = refused(read, tmp_path, header, MODULE)
    assert error.what == "point r1 has no joint values"
    assert error.line == 10
    assert [point.line for point in positions_of("rapid", MODULE, Path("a.mod"))] == [3, 5, 8, 9, 10]


@pytest.mark.parametrize(
    "value",
    ["[[1,2,3],[9E9]]", "[[1,2,3,4,5,x],[]]", "[" * 3000, "p2", "[[1,2,3,4,5,[6]],[0,0,0,0,0,0]]", "7"],
)
def test_targets_that_cannot_be_read(tmp_path, header, refused, value):
    error = refused(read, tmp_path, header, f"MODULE a\nCONST jointtarget p1:={value};\nENDMODULE\n")
    assert error.what == "point p1 cannot be read"
    assert error.line == 2


@pytest.mark.long
def test_robtargets_of_a_stated_tool_have_the_joints_of_their_configuration(tmp_path, header, refused):
    header.write_text(header.read_text().replace("irb1600", "irb120"))
    made = (DIALECTS["RAPID"].made(seed, 2) for seed in range(500))
    backup = next(
        one
        for one in made
        if len({(each.tool, each.frame) for each in one.positions}) == 1
        and not any(each.in_joints for each in one.positions)
        and one.positions[0].tool != "tool0"
        and one.positions[0].frame != "wobj0"
        and "CONST robtarget P2" in one.texts["TASK1/Work.mod"]
    )
    (text,) = backup.texts.values()
    file = tmp_path / "points.mod"
    file.write_bytes(re.sub(r"(?s)  PROC.*ENDPROC", "", text).encode())
    poses = re.findall(r"(?:TRUE|\"\"),\[(\[.*?\]),(\[.*?\])\]", text)
    names = re.findall(r"PERS \w+ (\w+):", text)
    stated = {
        name: ",".join(pose).replace("[", "").replace("]", "")
        for name, pose in zip(names, poses, strict=False)
    }
    frames = {"tool": stated[backup.positions[0].tool], "frame": stated.get(backup.positions[0].frame)}

    def run(**how):
        return import_rapid([file], ["a"], header, tmp_path / "run.jsonl", **how)

    found = run(**frames)
    declared = [one.joints for one in backup.positions if one.name in file.read_text()]
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], declared, atol=2e-3)
    assert any("by inverse kinematics of the nominal arm" in line for line in found.understood)
    assert "has no joint values" in refused(run).what
    assert "need their tool" in refused(run, frame=frames["tool"]).what
    assert "--tool is not understood" in refused(run, tool="1,2").what
    file.write_text(re.sub(r"\[-?\d,-?\d,-?\d,\d\]", "[3,3,3,7]", file.read_text()))
    assert "does not say what the joints are" in refused(run, **frames).what
