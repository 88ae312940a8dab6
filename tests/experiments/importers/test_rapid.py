"""jointtargets as they are declared in RAPID modules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_logs import HEADER, POSTURES

from zerobeam.experiments.importers import import_rapid
from zerobeam.experiments.importers.rapid import rapid_positions

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


@pytest.fixture
def header(tmp_path):
    path = tmp_path / "header.yaml"
    path.write_text(HEADER)
    return path


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
