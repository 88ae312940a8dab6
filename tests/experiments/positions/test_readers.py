"""What the readers find in files of each language, what they refuse by line; damaged files."""

import re
from pathlib import Path

import numpy as np
import pytest
from damaged_files import damaged
from made_backups import DIALECTS, Dialect, MadeBackup, MadePosition, kept, written

from zerobeam.experiments.converted_programs import shown_programs
from zerobeam.experiments.positions.conversion import Conversion, PositionRow
from zerobeam.experiments.positions.position import MOST_DIGITS, SourceFile
from zerobeam.model.errors import BadInput

COUNTS = pytest.mark.parametrize("count", [8, pytest.param(200, marks=pytest.mark.long)])


def shown(folder: Path, **files: str) -> Conversion:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("_", ".", 1)).write_text(text, encoding="latin-1")
    return shown_programs(folder)


def doubts(answer: Conversion) -> list[tuple[int, str]]:
    return [(one.line, one.kind) for one in answer.listed]


def refusals(answer: Conversion) -> list[str]:
    return [f"{one.line}: {one.sentence}" for one in answer.refused]


# Shapes of real files.

ARC = """/PROG  T1
/ATTR
OWNER\t\t= MNEDITOR;
DEFAULT_GROUP\t= 1,*,*,*,*;
/APPL
  ARC : TRUE ;
  ARC Welding Equipment : 1,*,*,*,*;
/MN
   1:  UFRAME_NUM=0 ;
   2:  UTOOL_NUM=0 ;
   3:J P[1] 100% CNT0 ACC100 TB .10sec,DO[1]=ON ;
   4:L P[2] 40mm/sec CNT100 ACC100    ;
   5:  Arc Start[1] ;
   6:L P[1] 40mm/sec CNT100    ;
   7:  Arc End[1] ;
/POS
P[1]{
   GP1:
\tUF : 0, UT : 0,
\tJ1=     0.000 deg,\tJ2=     0.000 deg,\tJ3=     0.000 deg,
\tJ4=     0.000 deg,\tJ5=   -90.000 deg,\tJ6=     0.000 deg
};
P[2]{
   GP1:
\tUF : 0, UT : 0,
\tJ1=    10.000 deg,\tJ2=     5.000 deg,\tJ3=     0.000 deg,
\tJ4=     0.000 deg,\tJ5=   -90.000 deg,\tJ6=     0.000 deg
};
/END
"""
BRAKE = """DEF t1( )
BAS (#INITMOV,0 )
BAS(#TOOL,0)
BAS(#BASE,0)
PTP {A1 0, A2 -90, A3 90, A4 0, A5 90, A6 0}
WAIT FOR $IN[1]==TRUE
IF $MODE_OP==#EX THEN
  HALT
ENDIF
BRAKE
END
"""
CAPITALS = """MODULE M
  CONST jointtarget JointTarget_1:=[[10,20,30,10,40,50],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ JointTarget_1,v200,fine,tool0;
  ENDPROC
ENDMODULE
"""


@pytest.mark.parametrize(
    ("name", "text", "robot", "count"),
    [
        ("T1.LS", ARC, "lrmate_200id", 2),
        ("t1.src", BRAKE, "kr6_r900", 1),
        ("M.mod", CAPITALS, "irb120", 1),
    ],
)
def test_shapes_of_real_files_are_converted(
    tmp_path: Path, name: str, text: str, robot: str, count: int
) -> None:
    (tmp_path / name).write_text(text)
    answer = kept(tmp_path, robot)
    assert answer.converted
    assert len(answer.positions) == count
    old, new = text.split("\n"), answer.content[name].decode().split("\n")
    changed = [before for before, after in zip(old, new, strict=True) if before != after]
    assert all(re.search(r"J\d=|\{A1|\[\[", line) for line in changed)
    for row in answer.positions:
        assert row.after is not None
        assert np.abs(np.array(row.after) - row.before).max() > 0.1


# KRL

KRL_HEAD = "DEF a( )\nBAS(#TOOL,1)\nBAS(#BASE,0)\n{}\nEND\n"
KRL_DATA = """DEFDAT a
DECL E6POS XP1={X 500,Y 0,Z 600,A 0,B 90,C 0,S 2,T 2,E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}
E6POS XTMP
ENDDAT
"""
KRL = {
    "LIN_REL {Z 100}": ([(4, "relative")], None),
    "XTMP=XP1\nXTMP.Z=XTMP.Z+50\nLIN XTMP": ([(4, "computed"), (5, "relative")], None),
    "LIN XP1:FRAME_OFF": ([(4, "computed")], None),
    "LIN XP7": ([(4, "elsewhere")], None),
    "$H_POS=XP1\nLIN XP1": ([], None),
    "CALC(XP1)\nLIN XP1": ([(4, "call")], None),
    "LIN GRID[I]\nLIN XP1": ([(4, "computed")], None),
    "PTP $AXIS_ACT\nLIN XP1": ([], None),
    "LIN {Z 500}": ([(4, "relative")], None),
    "XP1.Z=XP1.Z+50": ([], "4: the program overwrites the stored position XP1"),
    "$TOOL=TOOL_DATA[i]\nLIN XP1": ([], "2: XP1: its tool is chosen when the program runs"),
    "IF a THEN\nBAS(#TOOL,2)\nENDIF\nLIN XP1": ([], "2: XP1: its tool is chosen when the program runs"),
    "$IPO_MODE=#TCP": ([], "4: #TCP: the arm holds the work (remote TCP)"),
    "ASYPTP {E1 100}": ([], "4: ASYPTP moves external axes"),
    "GO({X 1,Y 2,Z 3,A 4,B 5,C 6})": ([], "4: line 4: it is not said what this position is, or for"),
    "LIN {X 1,Y 2,Z 3,A 4,B 5,C 6,E1 100}": ([], "4: line 4 has positions of external axes"),
}


@pytest.mark.parametrize("lines", KRL)
def test_statements_of_krl(tmp_path: Path, lines: str) -> None:
    listed, refused = KRL[lines]
    text = KRL_HEAD.replace("BAS(#TOOL,1)", "$TOOL=$NULLFRAME") if "TOOL" not in lines else KRL_HEAD
    (tmp_path / "a.src").write_text(text.format(lines))
    (tmp_path / "a.dat").write_text(KRL_DATA)
    answer = shown_programs(tmp_path)
    assert doubts(answer) == listed
    if refused is None:
        assert refusals(answer) == []
    else:
        assert any(each.startswith(refused) for each in refusals(answer)), refusals(answer)


INLINE_FORMS = """DEF prog( )
;FOLD INI;%{PE}
GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )
INTERRUPT ON 3
BAS (#INITMOV,0 )
;ENDFOLD (INI)
;FOLD PTP HOME  Vel= 100 % DEFAULT;%{PE}%MKUKATPBASIS,%CMOVE,%VPTP,%P 1:PTP, 2:HOME, 3:, 5:100, 7:DEFAULT
$BWDSTART = FALSE
PDAT_ACT=PDEFAULT
FDAT_ACT=FHOME
BAS (#PTP_PARAMS,100 )
$H_POS=XHOME
PTP  XHOME
;ENDFOLD
;FOLD PTP P1 CONT Vel=100 % PDAT1 Tool[1]:gun Base[2];%{PE}
PDAT_ACT=PPDAT1
FDAT_ACT=FP1
BAS(#PTP_PARAMS,100)
PTP XP1 C_PTP
;ENDFOLD
END
"""


def test_inline_forms_of_krl_have_the_tools_of_their_data(tmp_path: Path) -> None:
    home = "DECL E6AXIS XHOME={A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}\nFDAT FHOME={TOOL_NO 0,BASE_NO 0}"
    (tmp_path / "$config.dat").write_text(f"DEFDAT  $CONFIG\n{home}\nENDDAT\n")
    (tmp_path / "a.src").write_text(INLINE_FORMS)
    data = 'DECL FDAT FP1={TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE,POINT2[] " "}\nENDDAT'
    (tmp_path / "a.dat").write_text(KRL_DATA.replace("ENDDAT", data))
    answer = shown_programs(tmp_path)
    assert (answer.listed, answer.refused) == ((), ())
    assert [(row.name, row.tool, row.frame) for row in answer.positions if row.kind == "cartesian"] == [
        ("XP1", "1", "2")
    ]
    (tmp_path / "a.src").write_text(INLINE_FORMS.replace("BAS(#PTP", "IF a THEN\nENDIF\nBAS(#PTP"))
    assert "is chosen when the program runs" in refusals(shown_programs(tmp_path))[0]


IN_A_BRANCH = "BAS(#TOOL,1)\nIF a THEN\nBAS(#TOOL,2)\n{}LIN XP2\nENDIF"
# A routine with several tools and a branch: what stands between the line that sets one and the motion.
SET_BEFORE_A_MOTION = {
    "nothing": (IN_A_BRANCH.format(""), "2"),
    "parameters": (IN_A_BRANCH.format("$VEL.CP=2\nBAS(#CP_PARAMS,2)\n"), "2"),
    "a motion": (IN_A_BRANCH.format("PTP {A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}\n"), "2"),
    "a label": (IN_A_BRANCH.format("again:\n"), "?"),
    "the end of the branch": ("BAS(#TOOL,1)\nIF a THEN\nBAS(#TOOL,2)\nENDIF\nLIN XP2", "?"),
    "the other branch": ("BAS(#TOOL,1)\nIF a THEN\nBAS(#TOOL,2)\nELSE\nLIN XP2\nENDIF", "?"),
    "a loop": ("BAS(#TOOL,1)\nLOOP\nLIN XP2\nBAS(#TOOL,2)\nENDLOOP", "?"),
    "the end of a loop": ("REPEAT\nBAS(#TOOL,1)\nUNTIL a\nLIN XP2\nBAS(#TOOL,2)", "?"),
    "a case": ("BAS(#TOOL,1)\nSWITCH n\nCASE 1\nBAS(#TOOL,2)\nCASE 2\nLIN XP2\nENDSWITCH", "?"),
    "a call": (IN_A_BRANCH.format("change( )\n"), "?"),
    "a function": (IN_A_BRANCH.format("n=change( )\n"), "?"),
    "a start of all": (IN_A_BRANCH.format("BAS(#INITMOV,0)\n"), "?"),
    "a pause": (IN_A_BRANCH.format("WAIT FOR $IN[1]\n"), "?"),
    "an interrupt": (f"INTERRUPT DECL 5 WHEN $IN[1] DO change( )\n{IN_A_BRANCH.format('')}", "?"),
    "a trigger": (f"TRIGGER WHEN DISTANCE=0 DELAY=0 DO change( ) PRIO=-1\n{IN_A_BRANCH.format('')}", "?"),
}


@pytest.mark.parametrize("between", SET_BEFORE_A_MOTION)
def test_a_tool_set_on_the_line_before_a_motion_is_known_in_a_branch(tmp_path: Path, between: str) -> None:
    lines, tool = SET_BEFORE_A_MOTION[between]
    text = KRL_HEAD.replace("BAS(#TOOL,1)\n", "")
    assert text != KRL_HEAD
    (tmp_path / "a.src").write_text(text.format(lines))
    (tmp_path / "a.dat").write_text(KRL_DATA.replace("XP1", "XP2"))
    answer = shown_programs(tmp_path)
    assert [row.tool for row in answer.positions if row.name == "XP2"] == [tool]
    unknown = [one for one in refusals(answer) if "is chosen when the program runs" in one]
    assert bool(unknown) == (tool == "?"), refusals(answer)


def test_several_tools_one_after_the_other_are_no_question(tmp_path: Path) -> None:
    data = KRL_DATA.replace("ENDDAT", KRL_DATA.split("\n")[1].replace("XP1", "XP2") + "\nENDDAT")
    (tmp_path / "a.src").write_text(KRL_HEAD.format("LIN XP1\nBAS(#TOOL,2)\nLIN XP2"))
    (tmp_path / "a.dat").write_text(data)
    assert [one.tool for one in shown_programs(tmp_path).positions] == ["1", "2"]
    (tmp_path / "a.src").write_text(KRL_HEAD.format("LOOP\nLIN XP1\nBAS(#TOOL,2)\nLIN XP2\nENDLOOP"))
    (refused,) = shown_programs(tmp_path).refused
    assert refused.sentence.startswith("XP1: its tool is chosen")  # that before it, or that of the last round


# FANUC

TP = {
    "L P[1] 10mm/sec FINE Offset,PR[3]": ([(9, "relative")], None),
    "L P[1] 10mm/sec FINE Tool_Offset,PR[3]": ([(9, "relative")], None),
    "L P[R[1]] 10mm/sec FINE": ([(9, "computed")], None),
    "L P[9] 10mm/sec FINE": ([(9, "elsewhere")], None),
    "L P[1] 10mm/sec FINE VOFFSET,VR[1]": ([(9, "computed")], None),
    "L P[1] 10mm/sec FINE INC": ([], "9: INC: P[1] is a step, not a place"),
    "L P[1] 10mm/sec FINE COORD": ([], "9: COORD: tools, frames or work"),
    "L P[1] 10mm/sec FINE RTCP": ([], "9: RTCP: tools, frames or work"),
    "  UTOOL[1]=PR[2]": ([], "9: UTOOL[1]=: tools, frames or work"),
    "  P[1]=LPOS": ([], "9: the program overwrites the stored position P[1]"),
    "  !P[1]=LPOS": ([], None),
    "  CALL GRIP(P1)": ([], None),
}


@pytest.mark.parametrize("line", TP)
def test_statements_of_a_listing(tmp_path: Path, line: str) -> None:
    listed, refused = TP[line]
    answer = shown(tmp_path, T1_LS=ARC.replace("   1:  UFRAME_NUM=0 ;", f"   1:{line}    ;"))
    assert doubts(answer) == listed
    assert [each for each in refusals(answer) if each.startswith(refused or "")] == refusals(answer)
    assert bool(answer.refused) == (refused is not None)


def test_groups_registers_and_external_axes_of_fanuc(tmp_path: Path) -> None:
    gun = ARC.replace(
        "J6=     0.000 deg\n};", "J6=     0.000 deg\n   GP2:\n\tUF : 0, UT : 0,\n\tJ1= 25.000 mm\n};"
    )
    assert [one.kind for one in shown(tmp_path / "gun", T1_LS=gun).listed] == ["group", "group"]
    arm = gun.replace("J1= 25.000 mm", "J1= 25.000 deg,\tJ2= 5.000 deg")
    assert "of several axes" in refusals(shown(tmp_path / "arm", T1_LS=arm))[0]
    rail = ARC.replace("J6=     0.000 deg\n};", "J6=     0.000 deg,\tE1= 25.000 mm\n};", 1)
    assert "external axes" in refusals(shown(tmp_path / "rail", T1_LS=rail))[0]
    untaught = ARC.replace("J1=     0.000 deg", "J1= ******** deg", 1)
    assert "not taught" in refusals(shown(tmp_path / "untaught", T1_LS=untaught))[0]
    registers = (
        "[*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[1,3] OF Position Reg\n"
        "    [1,1] =   'Home'   Group: 1\n  J1 =     0.000 deg   J2 =   -60.000 deg   J3 =     0.000 deg\n"
        "  J4 =     0.000 deg   J5 =    90.000 deg   J6 =      .000 deg\n\n    [1,2] =   '' Uninitialized\n"
    )
    unused = shown(tmp_path / "unused", T1_LS=ARC, POSREG_VA=registers)
    assert [(one.file, one.kind) for one in unused.listed] == [("POSREG.VA", "elsewhere")]
    assert len(unused.positions) == 2
    used = shown(tmp_path / "used", T1_LS=ARC.replace("J P[1]", "J PR[1]"), POSREG_VA=registers)
    assert [row.name for row in used.positions] == ["PR[1]", "P[1]", "P[2]"]
    both = ARC.replace("L P[2] 40mm/sec CNT100 ACC100", "L P[2] 40mm/sec CNT100 Offset,PR[1]")
    both = both.replace("J P[1]", "J PR[1]")
    said = refusals(shown(tmp_path / "both", T1_LS=both, POSREG_VA=registers))
    assert "a place at one statement and an offset at another" in said[0]


# Damaged files: refused, or each position whose bytes are as they were means what it meant.


@COUNTS
@pytest.mark.parametrize("language", DIALECTS)
def test_damaged_files_are_refused_or_keep_their_places(language: str, count: int, tmp_path: Path) -> None:
    dialect = DIALECTS[language]
    backup = dialect.made(5, 3)
    main = dialect.main
    whole = kept(written(backup, tmp_path / "whole"), dialect.robot, **backup.options)
    meant = {row.name: row for row in whole.positions}
    refused = compared = 0
    for number, text in enumerate(damaged(backup.texts[main], count, seed=1)):
        copy = MadeBackup(dialect, backup.tools, backup.frames, [], backup.texts | {main: text})
        try:
            answer = kept(written(copy, tmp_path / str(number)), dialect.robot, **backup.options)
        except BadInput:
            refused += 1
            continue
        if not answer.converted:
            assert answer.refused or answer.open_lines or answer.to_state or not answer.positions
            refused += 1
            continue
        rows = {row.name: row for row in answer.positions}
        for one in backup.positions:
            label = dialect.label(one)
            row, before = rows.get(label), meant.get(label)
            if row is None or before is None or found(dialect, one, copy.texts) is None:
                continue
            as_it_was = found(dialect, one, copy.texts) == found(dialect, one, backup.texts)
            assert row.before == before.before or not as_it_was, (number, label)
            same_frames = (row.tool, row.frame) == (before.tool, before.frame)
            if as_it_was and same_frames and frames_of(answer, row) == frames_of(whole, before):
                assert row.after == before.after, (number, label)
                compared += 1
    assert 0.1 * count < refused < count
    assert compared


def found(dialect: Dialect, one: MadePosition, texts: dict[str, str]) -> object:
    """Its numbers and configuration; None where this file cannot read them."""
    try:
        numbers, configuration = dialect.found(one, texts)
    except (AssertionError, ValueError, KeyError, TypeError):
        return None
    return numbers, [*configuration]


def frames_of(answer: Conversion, row: PositionRow) -> list[object]:
    return [(one.what, one.numbers) for one in answer.frames if getattr(row, one.what) == one.name]


# RAPID: LOCAL data of several modules

JOINTS = "[[{},0,0,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
MODULE = """MODULE {0}
  {1} jointtarget p1:={2};
  LOCAL PERS tooldata grip:=[TRUE,[[0,0,{3}],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  LOCAL CONST robtarget r1:=[[500,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC go{0}()
    MoveAbsJ p1,v100,fine,grip;
    MoveL r1,v100,fine,grip;
    {4}
  ENDPROC
ENDMODULE
"""


def test_local_data_of_several_modules_are_of_their_module(tmp_path: Path) -> None:
    first = MODULE.format("A", "LOCAL CONST", JOINTS.format(10), 100, "")
    second = MODULE.format("B", "LOCAL CONST", JOINTS.format(20), 150, "")
    answer = shown(tmp_path / "local", A_mod=first, B_mod=second)
    assert refusals(answer) == []
    tools = {one.name: one.numbers for one in answer.frames if one.what == "tool"}
    assert {row.tool: tools[row.tool][2] for row in answer.positions if row.tool} == {
        "A.mod:grip": 100,
        "B.mod:grip": 150,
    }
    written_there = MODULE.format("B", "LOCAL CONST", JOINTS.format(20), 150, "p1:=CJointT();")
    (refused,) = shown(tmp_path / "written", A_mod=first, B_mod=written_there).refused
    assert (refused.file, refused.line) == ("B.mod", 8)
    plain = [text.replace("LOCAL CONST jointtarget", "CONST jointtarget") for text in (first, second)]
    assert "declared twice" in refusals(shown(tmp_path / "plain", A_mod=plain[0], B_mod=plain[1]))[0]
    hidden = shown(tmp_path / "hidden", A_mod=first, B_mod=plain[1])
    assert refusals(hidden) == []
    assert {row.file for row in hidden.positions} == {"A.mod", "B.mod"}


def test_a_number_of_thousands_of_digits_is_refused_with_its_line() -> None:
    """Python refuses to make an integer of more than 4,300: it was a fault of the program."""
    assert SourceFile("a.ls", "P[" + "1" * MOST_DIGITS + "]").line(0) == 1
    with pytest.raises(BadInput) as caught:
        SourceFile("a.ls", "/POS\nP[" + "1" * (MOST_DIGITS + 1) + "]")
    assert (caught.value.file, caught.value.line) == ("a.ls", 2)
