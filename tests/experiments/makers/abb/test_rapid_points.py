"""jointtargets as they are declared in RAPID modules."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from import_files import import_rapid, positions_of
from made_backups import DIALECTS
from recorded_logs import POSTURES

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
