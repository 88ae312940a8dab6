"""jointtargets as they are declared in RAPID modules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from import_files import import_rapid
from recorded_logs import POSTURES
from scipy.spatial.transform import Rotation
from user_programs import TABLE, TOOL, UserProgram, flange_arm, varied

from zerobeam.experiments.makers.abb.rapid_points import rapid_positions
from zerobeam.model.files.robot_file import load_robot

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
    assert [point.line for point in rapid_positions(MODULE, Path("a.mod"))] == [3, 4, 8, 8, 10]


@pytest.mark.parametrize(
    "value",
    ["[[1,2,3],[9E9]]", "[[1,2,3,4,5,x],[]]", "[" * 3000, "p2", "[[1,2,3,4,5,[6]],[0,0,0,0,0,0]]", "7"],
)
def test_targets_that_cannot_be_read(tmp_path, header, refused, value):
    error = refused(read, tmp_path, header, f"MODULE a\nCONST jointtarget p1:={value};\nENDMODULE\n")
    assert error.what == "the axes of p1 cannot be read"
    assert error.line == 2


def robtargets(rows, tool, frame, conf=None) -> str:
    """A module whose robtargets are where the arm has the tool at the joints (rows, degrees)."""
    arm = flange_arm(load_robot("irb1600"))
    lines = []
    for i, row in enumerate(rows):
        pose = np.linalg.inv(frame) @ arm.fk(row, "deg") @ tool
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
        place = ",".join(f"{value:.3f}" for value in pose[:3, 3])
        turn = ",".join(f"{value:.7f}" for value in (w, x, y, z))
        own = conf or UserProgram("rapid", arm, np.array([row])).confdata(row)
        lines.append(f"  CONST robtarget p{i}:=[[{place}],[{turn}],[{','.join(map(str, own))}],{EXTERNAL}];")
    return "\n".join(["MODULE a", *lines, "ENDMODULE"])


@pytest.mark.long
def test_robtargets_of_a_stated_tool_have_the_joints_of_their_configuration(tmp_path, header, refused):
    rows = varied(load_robot("irb1600"), 6, seed=8)
    file = tmp_path / "points.mod"
    file.write_text(robtargets(rows, TOOL, TABLE))
    tool = "10,-5,120," + ",".join(map(str, np.roll(Rotation.from_matrix(TOOL[:3, :3]).as_quat(), 1)))
    frame = "300,-100,50," + ",".join(map(str, np.roll(Rotation.from_matrix(TABLE[:3, :3]).as_quat(), 1)))

    def run(**stated):
        return import_rapid([file], ["a"], header, tmp_path / "run.jsonl", **stated)

    found = run(tool=tool, frame=frame)
    np.testing.assert_allclose([shot.joints_deg for shot in found.shots], rows, atol=2e-3)
    assert any("by inverse kinematics of the nominal arm" in line for line in found.understood)
    assert refused(run).what == "point p0 has no joint values"
    assert "need their tool" in refused(run, frame=frame).what
    assert "--tool is not understood" in refused(run, tool="1,2").what
    file.write_text(robtargets(rows[:1], TOOL, TABLE, conf=(3, 3, 3, 7)))
    assert refused(run, tool=tool, frame=frame).what == "p0 does not say what the joints are"
