"""What cannot be corrected is named by line, and nothing is written."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from user_programs import OFFSETS, STATED, UserProgram, frame, judged, read, varied, written

from zerobeam.experiments.makers.user_programs import ProgramOptions, corrected_program
from zerobeam.model.errors import BadInput
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.inverse import Solver

RAPID = """MODULE m
  CONST robtarget p1:=[[700,0,900],[0.5,0,0.866025404,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST jointtarget j1:=[[0,0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PERS tooldata tUser:=[TRUE,[[0,0,100],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  PROC main()
    MoveAbsJ j1,v100,fine,tool0;
    {}
  ENDPROC
ENDMODULE
"""
KRL = """DEF m()
E6AXIS J1
BAS(#TOOL,0)
BAS(#BASE,0)
PTP {{A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}}
{}
END
"""
FANUC = """/PROG M
/MN
   1:J P[1] 100% FINE ;
   2:{} ;
/POS
P[1]{{
   GP1:
\tUF : 0, UT : 1,
\tJ1= 0.000 deg, J2= 0.000 deg, J3= 0.000 deg, J4= 0.000 deg, J5= -30.000 deg, J6= 0.000 deg
}};
P[2]{{
   GP1:
\tUF : 0, UT : 5,\tCONFIG : 'N U T, 0, 0, 0',
\tX = 400.000 mm, Y = 0.000 mm, Z = 300.000 mm, W = 180.000 deg, P = 0.000 deg, R = 0.000 deg
   GP2:
\tUF : 0, UT : 5,
\tJ1=     0.000  mm
}};
/END
"""
UR = """def m():
  q1 = [0, -1.2, 1.2, -1.2, -1.2, 0]
  movej(q1, a=1, v=1)
  {}
end
"""
PARTS = {
    ".mod": ("irb1600", RAPID, ProgramOptions()),
    ".src": ("kr6_r900", KRL, ProgramOptions()),
    ".ls": ("lrmate_200id", FANUC, ProgramOptions(tools=["5=0,0,100,0,0,0"], j3="ground")),
    ".script": ("ur5e", UR, ProgramOptions(tools=["0,0,0.1,0,0,0"])),
}


def tried(folder: Path, suffix: str, line: str, choices: ProgramOptions | None = None) -> str:
    name, text, usual = PARTS[suffix]
    robot = load_robot(name)
    (folder / f"in{suffix}").write_text(text.format(line))
    return read(
        corrected_program(
            robot, judged(robot), folder / f"in{suffix}", folder / f"out{suffix}", choices or usual
        )
    )


@pytest.mark.parametrize(
    ("suffix", "line"),
    [
        (".mod", "MoveJ p1,v100,fine,tUser;"),
        (".src", "PTP {A1 10,A2 -80,A3 90,A4 0,A5 30,A6 0}"),
        (".ls", "J P[2] 100% FINE"),
        (".script", "movej(p[0.4, 0.2, 0.4, 0, 3.1, 0], a=1, v=1)"),
    ],
)
def test_each_is_written_without_the_line_that_is_refused(tmp_path: Path, suffix: str, line: str) -> None:
    assert "zerobeam export program" in tried(tmp_path, suffix, line)


@pytest.mark.parametrize(
    ("suffix", "line", "said"),
    [
        (".mod", "MoveL Offs(p1,0,0,50),v100,fine,tool0;", "line 7: the target Offs(p1,0,0,50) is computed"),
        (".mod", "MoveL RelTool(p1,0,0,5),v100,fine,tool0;", "is computed when the program runs"),
        (".mod", "MoveL p9,v100,fine,tool0;", "p9 is not declared in this file"),
        (".mod", "p1.trans.z:=5; MoveJ p1,v100,fine,tool0;", "line 7: p1 is used or changed"),
        (".mod", "MoveJ p1,v100,fine,tGrip;", "state --tool tGrip=X,Y,Z,Q1,Q2,Q3,Q4"),
        (".mod", "MoveJ p1,v100,fine,tool0\\WObj:=wPart;", "state --frame wPart="),
        (".mod", "MoveJ p1,v1,fine,tool0; MoveJ p1,v1,fine,tUser;", "p1 is used with different tools"),
        (".mod", "tUser.tframe:=f; MoveJ p1,v1,fine,tUser;", "tUser is used or changed"),
        (".mod", "TriggL p1,v100,t1,fine,tool0;", "TriggL is a motion that is not understood"),
        (".mod", "ConfL\\Off; MoveL p1,v100,fine,tool0;", "ConfL\\Off"),
        (".mod", "PDispOn p1,tool0; MoveJ p1,v100,fine,tool0;", "PDispOn"),
        (".mod", "MoveAbsJ zb_command(j1),v100,fine,tool0;", "would correct a second time"),
        (".mod", "! p1 is never used", "p1 is not the target of a motion here"),
        (".src", "PTP_REL {A1 10}", "a relative motion cannot be corrected"),
        (".src", "LIN_REL {Z 10}", "a relative motion cannot be corrected"),
        (".src", "PTP {A1 10}", "does not state the 6 axes"),
        (".src", "PTP XHOME", "XHOME has no value in these files (--leave XHOME?)"),
        (".src", "PTP {X 600,Y 0,Z 700,A 0,B 90,C 0,S 2,T 35}:off", "computed when it runs"),
        (".src", "BAS(#TOOL,4)\nLIN {X 600,Y 0,Z 700,A 0,B 90,C 0}", "tool 4 is not known; state --tool 4="),
        (".src", "$TOOL=mine\nLIN {X 600,Y 0,Z 700,A 0,B 90,C 0}", "the active tool is not known"),
        (".src", "LIN {X 600,Y 0,Z 700,A 0,B 90,C 0,E1 100}", "external axes"),
        (
            ".src",
            "BAS(#TOOL,4)\nLIN {X 1,Y 0,Z 7,A 0,B 90,C 0}\nTOOL_DATA[4]={X 1,Y 0,Z 0,A 0,B 0,C 0}",
            "tool 4 is not",
        ),
        (".src", "TOOL_DATA[4]={X 0}", "is not stated in numbers"),
        # S of the joints before is 2; linear motions ignore their own, and here it is another.
        (".src", "LIN {X 600,Y 0,Z 700,A 0,B 90,C 0,S 6,T 58}", "would change the arm's configuration"),
        (".ls", "J PR[2] 100% FINE", "computed when the program runs"),
        (".ls", "L P[2] 100mm/sec FINE JointOffset,PR[3]", "computed when the program runs"),
        (".ls", "L P[2] 100mm/sec FINE INC", "INC is not understood"),
        (".ls", "J P[R[1]] 100% FINE", "computed when the program runs"),
        (".ls", "P[2]=LPOS", "a position is used when the program runs"),
        (".ls", "UTOOL[5]=PR[1]", "frames are changed"),
        (".ls", "WAIT 1 ;\nJ P[2] 100% FINE", "line 5: this line is not understood"),
        (".ls", "J P[7] 100% FINE", "P[7] is not in the listing"),
        (".script", "movel(pose_trans(q1, q2), a=1, v=1)", "is computed when the program runs"),
        (".script", "q1[0] = 1", "q1 is used or changed"),
        (".script", "q1 = [0, 0, 0, 0, 0, 0]", "q1 is used or changed"),
        (".script", "servoj(q1)", "servoj is a motion that is not understood"),
        (".script", "set_tcp(mine)", "the TCP is not written in numbers"),
        (".script", "set_tcp(p[0, 0, 0.2, 0, 0, 0])", "more than one TCP"),
    ],
)
@pytest.mark.one_in(3)
def test_motions_that_are_not_understood(tmp_path: Path, suffix: str, line: str, said: str) -> None:
    with pytest.raises(BadInput) as refused:
        tried(tmp_path, suffix, line)
    assert " ".join(str(refused.value.found).split()).count(said) == 1  # each line is named once
    assert "nothing is written" in str(refused.value)


@pytest.mark.long
def test_joints_near_by_are_those_of_the_pendant(tmp_path: Path) -> None:
    """A configuration that a FANUC cannot have there, and J3 counted from the ground."""
    robot = load_robot("lrmate_200id")
    rows = np.array([[10.0, 20, 10, 5, -80, 30], [12.0, 40, 20, 5, -70, 30]])
    program = UserProgram("fanuc", robot, rows)
    path = written(tmp_path, program, program.text().replace("'N U T", "'N D T"))
    tools, frames = STATED["fanuc"].tools, STATED["fanuc"].frames
    with pytest.raises(BadInput, match="with the stated configuration N D T"):
        corrected_program(robot, judged(robot), path, tmp_path / "out.ls", STATED["fanuc"])
    near = ProgramOptions(tools=tools, frames=frames, near="12,40,-20,5,-70,30", j3="ground")
    done = corrected_program(robot, judged(robot), path, tmp_path / "out.ls", near)
    np.testing.assert_allclose(program.commanded(read(done)), rows - OFFSETS, atol=5e-3)


def test_a_tool_and_a_base_that_a_krl_program_defines(tmp_path: Path) -> None:
    """As RoboDK writes them; linear motions without S and T follow the arm."""
    lines = [
        "BASE_DATA[2] = {FRAME: X 100,Y 50,Z 10,A 0,B 0,C 0}",
        "TOOL_DATA[1] = {X 0,Y 0,Z 100,A 0,B 0,C 0}",
        "FDAT_ACT = {TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}",
        "BAS(#FRAMES)",
        "LIN {X 500,Y -50,Z 600,A 0,B 120,C 0} C_DIS",
    ]
    text = tried(tmp_path, ".src", "\n".join(lines))
    said = re.search(r"LIN \{(.*?)\}", text)
    values = {key: float(value) for key, value in (part.split() for part in said[1].split(","))}
    robot = load_robot("kr6_r900")
    tool, base = frame(0, 0, 100, 0, 0, 0), frame(100, 50, 10, 0, 0, 0)

    def flange(x: float, y: float, z: float, a: float, b: float, c: float) -> np.ndarray:
        return np.asarray(base @ frame(x, y, z, c, b, a) @ np.linalg.inv(tool))

    solver = Solver(robot)
    joints = np.degrees(solver.solutions(flange(*(values[key] for key in "XYZABC"))))
    true = robot.with_offsets(np.radians(OFFSETS)).fk(joints, "deg")
    assert np.abs(true - flange(500, -50, 600, 0, 120, 0)).max(axis=(1, 2)).min() < 1e-3


def test_a_configuration_that_the_arm_has_not_there_is_refused_but_for_near(tmp_path: Path) -> None:
    folded = "PTP {X 600,Y 0,Z 700,A 0,B 90,C 0,S 1,T 35}"
    with pytest.raises(BadInput, match=r"with the stated configuration S 1, T 35"):
        tried(tmp_path, ".src", folded)
    near = ProgramOptions(near="0,-90,90,0,40,0")
    assert "configuration taken from the joints nearest by" in tried(tmp_path, ".src", folded, near)


def test_a_pose_needs_its_tool_and_joints_do_not(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"state --tool X,Y,Z,RX,RY,RZ"):
        tried(tmp_path, ".script", "movel(p[0.4, 0.2, 0.4, 0, 3.1, 0], a=1, v=1)", ProgramOptions(tools=()))
    assert "movej" in tried(tmp_path, ".script", "sleep(1)", ProgramOptions(tools=()))


MANY = {
    ".mod": [
        "".join(f"MoveJ p1,v100,fine,t{i}\\WObj:=w{i};" for i in range(6)),
        [f"{option}{i}=X,Y,Z,Q1,Q2,Q3,Q4" for option in ("--tool t", "--frame w") for i in range(6)],
    ],
    ".src": [
        "\n".join(
            f"BAS(#TOOL,{i})\nBAS(#BASE,{i + 1})\nLIN {{X 600,Y 0,Z 700,A 0,B 90,C 0}}" for i in range(1, 7)
        ),
        [
            f"{option} {i + (option == '--frame')}=X,Y,Z,A,B,C"
            for option in ("--tool", "--frame")
            for i in range(1, 7)
        ],
    ],
}


@pytest.mark.parametrize("suffix", MANY)
def test_all_tools_and_frames_that_are_missing_are_named_at_once(tmp_path: Path, suffix: str) -> None:
    """More of them than problems are shown."""
    line, required = MANY[suffix]
    with pytest.raises(BadInput) as refused:
        tried(tmp_path, suffix, line, ProgramOptions())
    assert refused.value.remedy is not None
    assert refused.value.remedy.startswith(f"state {' '.join(required)}; ")
    assert re.search(r"and \d more", str(refused.value.found))


def test_of_a_fanuc_position_both_frames_are_named(tmp_path: Path) -> None:
    name, text, _ = PARTS[".ls"]
    path, robot = tmp_path / "in.ls", load_robot(name)
    path.write_text(text.format("J P[2] 100% FINE").replace("UF : 0, UT : 5", "UF : 3, UT : 5"))
    with pytest.raises(BadInput, match=r"to do:\s+state --tool 5=X,Y,Z,W,P,R --frame 3=X,Y,Z,W,P,R; "):
        corrected_program(robot, judged(robot), path, tmp_path / "out.ls", ProgramOptions(j3="ground"))


def test_a_target_that_is_left_stays(tmp_path: Path) -> None:
    text = tried(tmp_path, ".mod", "MoveL pOther,v100,fine,tool0;", ProgramOptions(leave=["pOther", "p1"]))
    assert "left as they are: pOther and p1" in text
    assert RAPID.splitlines()[1] in text
    left = tried(
        tmp_path,
        ".ls",
        "J P[2] 100% FINE",
        ProgramOptions(leave=["P[1]"], tools=["5=0,0,100,0,0,0"], j3="link"),
    )
    assert "J5= -30.000 deg" in left
    home = ProgramOptions(leave=["PR[2]"], tools=["5=0,0,100,0,0,0"], j3="link")
    assert "J2=" in tried(tmp_path, ".ls", "J PR[2:HOME] 10% CNT10", home)
    with pytest.raises(BadInput, match="computed when the program runs"):
        tried(tmp_path, ".ls", "J PR[2] 10% CNT10 JointOffset,PR[2]", home)


def test_a_program_is_corrected_once_only_and_for_its_own_robot(tmp_path: Path) -> None:
    robot = load_robot("irb120")
    program = UserProgram("rapid", robot, varied(robot, 2))
    path = written(tmp_path, program, program.text())
    done = corrected_program(robot, judged(robot), path, tmp_path / "out.mod")
    again = tmp_path / "again.mod"
    again.write_bytes(next(iter(done.files.values())))
    with pytest.raises(BadInput, match="applied twice"):
        corrected_program(robot, judged(robot), again, tmp_path / "out.mod")
    other = load_robot("ur5e")
    with pytest.raises(BadInput, match="is for robots of ABB"):
        corrected_program(other, judged(other), path, tmp_path / "out.mod")
    with pytest.raises(BadInput, match="of no language that is read here"):
        corrected_program(robot, judged(robot), path.with_suffix(".txt"), tmp_path / "out.txt")
    with pytest.raises(BadInput, match="this is a folder"):
        corrected_program(robot, judged(robot), tmp_path, tmp_path / "out.mod")


def test_what_is_not_corrected_is_said(tmp_path: Path) -> None:
    robot = load_robot("lrmate_200id")
    program = UserProgram("fanuc", robot, varied(robot, 4))
    path = written(tmp_path, program, program.text())
    some = judged(robot, np.array([0, -0.9, 0, 0.4, 0, 0.5]))
    done = corrected_program(robot, some, path, tmp_path / "out.ls", STATED["fanuc"])
    assert "not corrected, as 0: delta1, delta3, delta5" in done.notes
    assert "!delta3 NOT CORRECTED ;" in read(done)
    assert "!delta4 +0.4000 ;" in read(done)


def test_a_corrected_wrist_that_passes_its_singularity_has_another_configuration(tmp_path: Path) -> None:
    robot = load_robot("irb120")
    rows = np.array([[10.0, 20, 10, 15, 30, 40], [10.0, 20, 10, 15, 0.4, 40], [-20.0, 10, 5, 0.2, 30, 0.3]])
    program = UserProgram("rapid", robot, rows)
    path = written(tmp_path, program, program.text())
    offsets = np.array([0, 0, 0, 0.4, 0.7, 0.5])
    done = corrected_program(robot, judged(robot, offsets), path, tmp_path / "out.mod")
    assert any("another configuration is needed, and written, at p1" in said for said in done.notes)
    commanded = program.commanded(read(done))
    assert commanded[1, 4] == pytest.approx(-0.3, abs=1e-3)


@pytest.mark.parametrize("name", ["P2", "P[2]", "2", "p2"])
def test_a_position_of_a_listing_is_left_by_each_of_its_names(tmp_path: Path, name: str) -> None:
    text = tried(tmp_path, ".ls", "J P[2] 100% FINE", ProgramOptions(leave=[name], j3="ground"))
    assert "X = 400.000 mm" in text
    assert "J5= -30.000" not in text  # the control: P[1] is corrected


def test_a_listing_says_from_where_joint_3_is_counted(tmp_path: Path) -> None:
    name, text, _ = PARTS[".ls"]
    robot = load_robot(name)
    (tmp_path / "in.ls").write_text(text.format("WAIT 1.00(sec)"))
    choices = ProgramOptions(leave=["P2"], j3="ground")
    done = corrected_program(robot, judged(robot), tmp_path / "in.ls", tmp_path / "out.ls", choices)
    assert any("joint 3 is counted from the ground" in note for note in done.notes)
    assert b"NEVER ENTER THE OFFSETS AS WELL" in done.files[tmp_path / "out.ls"]
