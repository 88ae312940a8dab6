"""What the reader of each language refuses or lists, by line: nothing is written then.

The control: the same backup without the line is converted, and with the line, but without the check, too.
"""

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_backups import DIALECTS, ENTERED, MadeBackup, kept, written

from zerobeam.experiments.converted_programs import shown_programs
from zerobeam.experiments.positions import arm_change
from zerobeam.experiments.positions.position import BackupReading, FileReading


@dataclass(frozen=True)
class Case:
    """A replacement in the generated backup of a seed, and how what is said of it begins, by line."""

    old: str
    new: str
    said: str
    checked: bool = True  # whether it would be written without the check


INIT, HEAD = "BAS (#INITMOV,0 )\r\n", "   1:  !P[9]=LPOS    ;\n"
CASES: dict[str, dict[str, Case]] = {
    "KRL": {  # positions in a .dat, what becomes of them in the .src beside it
        "axis": Case(INIT, INIT + "XP1.A1=XP1.A1+5\r\n", "the program overwrites the stored position XP1"),
        "blanks": Case(INIT, INIT + "XP2 . Z = 5\r\n", "the program overwrites the stored position XP2"),
        "by a call": Case(INIT, INIT + "CALC(XP2)\r\n", "XP2 is used by this statement"),
        "on a branch": Case(INIT, INIT + "RETURN XP2\r\n", "XP2 is used by this statement"),
        "tool data": Case(INIT, INIT + "TOOL_DATA[1].Z=5\r\n", "TOOL_DATA[1] is set when the program runs"),
        "elsewhere": Case("PTP XP1\r\n", "PTP $AXIS_ACT\r\nPTP GRID[I]\r\n", "GRID[I] is computed"),
    },
    "TP": {
        "which one": Case(
            HEAD, HEAD + "  98:  P[R[1]]=LPOS    ;\n", "P[R[1]]: which position is overwritten"
        ),
        "on a branch": Case(HEAD, HEAD + "  98:  IF R[1]=1,P[1]=LPOS    ;\n", "the program overwrites the"),
        "registers": Case(HEAD, HEAD + "  98:  PR[R[1]]=LPOS    ;\n", "PR[R[1]] is computed"),
    },
    "RAPID": {
        "overwritten": Case("    TPWrite", "    P1:=CJointT();\r\n    TPWrite", "the program overwrites the"),
        "on a branch": Case("    TPWrite", "    IF a P1:=p;\r\n    TPWrite", "the program overwrites the"),
        "by a call": Case("    TPWrite", "    calc P1;\r\n    TPWrite", "P1 is used by this statement"),
        "tool by a call": Case("    TPWrite", "    calc tTorch;\r\n    TPWrite", "tTorch is used by this"),
        "tool data": Case("    TPWrite", "    tTorch.tframe:=p;\r\n    TPWrite", "tTorch is set when the"),
    },
    "INFORM": {
        "cut off": Case("END\r\n", "", "1: this is no whole job", checked=False),
        "lost position": Case("NPOS 2,", "NPOS 3,", "4: ///NPOS states 3 C and 0 P; there are (2, 0)"),
        "damaged": Case("C00001=", "C0000O=", "this position is not understood"),
        "tool at run time": Case("NOP\r\n", "NOP\r\nCHANGE TOOL#(2)\r\n", "CHANGE: tools or frames are set"),
        "frame at run time": Case("NOP\r\n", "NOP\r\nMFRAME UF#(2) P001 P002 P003\r\n", "MFRAME: tools or"),
        "another arm": Case("GROUP1 RB1", "GROUP1 RB1,RB2", "the job moves another arm"),
        "which one": Case("NOP\r\n", "NOP\r\nSET P[B000] P002\r\n", "P[B000]: which position is"),
        "shift": Case("NOP\r\n", "NOP\r\nSFTON P001\r\n", "SFTON shifts the positions"),
        "step": Case("NOP\r\n", "NOP\r\nIMOV P001 V=10.0\r\n", "IMOV is a step"),
        "base axis": Case("//INST", "BC00000=100\r\n//INST", "BC00000: a base axis carries the arm"),
        "station": Case("//INST", "EC00000=100\r\n//INST", "EC00000 is of a station"),
        "elsewhere": Case("NOP\r\n", "NOP\r\nMOVJ P049 VJ=1.00\r\n", "P49 is stored elsewhere"),
        "computed": Case("NOP\r\n", "NOP\r\nMOVL P[I050] V=1.0\r\n", "MOVL P[I050] V=1.0 is computed"),
    },
    "AS": {
        "cut off": Case(".END\r\n.REALS\r\na = 1\r\n.END\r\n", "", "the file ends before .END"),
        "damaged": Case(".TRANS\r\n", ".TRANS\r\nz 1 2 3 4 5\r\n", "z has 5 numbers"),
        "no number": Case(".TRANS\r\n", ".TRANS\r\nz 1 2 3 4 5 **\r\n", "this position is not"),
        "external axis": Case(".JOINTS\r\n", ".JOINTS\r\n#z 1 2 3 4 50 6 7\r\n", "#z has positions of"),
        "configuration": Case("  DELAY 1", "  RIGHTY\r\n  DELAY 1", "RIGHTY changes the configuration"),
        "offset": Case(".TRANS\r\n", ".TRANS\r\nz 1 2 3 4 5 6\r\n", "no statement of the backup moves to z"),
        "relative": Case("  DELAY 1", "  LDEPART 100\r\n  DELAY 1", "LDEPART"),
        "approach": Case("  DELAY 1", "  JAPPRO #z,100\r\n  DELAY 1", "JAPPRO #z"),
        "compound": Case("  DELAY 1", "  LMOVE a+b\r\n  DELAY 1", "a+b is computed"),
        "stored": Case("  DELAY 1", "  POINT z = a+b\r\n  DELAY 1", "a+b is computed"),
        "any of an array": Case("  DELAY 1", "  LMOVE a[.i]\r\n  DELAY 1", "a[.i] is computed"),
        "frame at run time": Case("  DELAY 1", "  HERE jig\r\n  DELAY 1", "jig is set when the program"),
        "home": Case("  DELAY 1", "  HOME\r\n  DELAY 1", "HOME is stored in the controller"),
        "half a literal": Case("  DELAY 1", "  JMOVE #[1,2,3,4,5,\r\n  DELAY 1", "this position is not"),
    },
    "SPEL+": {
        "lost points": Case("nNumberOfPoints=", "nNumberOfPoints=9", "nNumberOfPoints=9"),
        "other arm": Case("nNumberOfJoints=6", "nNumberOfJoints=4", "nNumberOfJoints=4: there are"),
        "turn": Case("nJ4Flag=0", "nJ4Flag=1", "5: Point 0 is not understood"),
        "rest": Case("nNumberOfJoints=6\r\n", "nNumberOfJoints=6\r\nPoint9 {\r\n", "this position is"),
        "pulses": Case("Fend", "  Pulse 1,2,3,4,5,6\r\nFend", "Pulse: pulses"),
        "frame at run time": Case("Fend", "  Local 2, XY(1, 2, 3, 4)\r\nFend", "Local: pulses, frames"),
        "tool at run time": Case("Fend", "  TLSet 2, P0 +X(1)\r\nFend", "TLSet: tools are set"),
        "another branch": Case("Fend", "  Go P0 /L\r\nFend", "P0 /L: another configuration"),
        "no orientation": Case("Fend", "  Go XY(1, 2, 3, 4)\r\nFend", "XY(1, 2, 3, 4) is not understood"),
        "which one": Case("Fend", "  P(n) = Here\r\nFend", "P(n): which position is overwritten"),
        "overwritten": Case("Fend", "  CX(P0) = 10\r\nFend", "the program overwrites the stored position P0"),
        "relative": Case("Fend", "  Go P0 +Z(50)\r\nFend", "P0 +Z(50)"),
        "step": Case("Fend", "  TMove XY(0,0,5,0)\r\nFend", "TMove"),
        "computed": Case("Fend", "  Go P(n)\r\nFend", "P(n) is computed"),
        "other points": Case(
            "Fend", '  ImportPoints "a.pts", "b.pts"\r\nFend', "ImportPoints changes points"
        ),
        "in a loop": Case("Fend", "  For i=0 To 1: P(i)=Here: Next\r\nFend", "P is used by this"),
        "here": Case("Fend", "  Go Here +Z(50)\r\nFend", "Here +Z(50) is computed"),
        "call": Case("Fend", "  Call pick(P0)\r\nFend", "P0 is used by this"),
    },
    "MELFA-BASIC": {
        "damaged": Case("Dly 0.5", "P9=(+1.00,+2.00", "P9: this position is not understood"),
        "five numbers": Case("Dly 0.5", "P9=(1,2,3,4,5)(7,0)", "P9 has 5 numbers"),
        "turns": Case("Dly 0.5", "P9=(1,2,3,4,5,6)(7,1)", "P9: turns of joints"),
        "external axis": Case("Dly 0.5", "J9=(1,2,3,4,50,6,7)", "J9 has positions of external axes"),
        "base": Case("Dly 0.5", "Base P9", "Base: tools, frames or pallets"),
        "tool variable": Case("Dly 0.5", "PGrip.Z=5", "PGrip is set when the program runs"),
        "tool by number": Case("Dly 0.5", "M_Tool=2", "M_Tool=: tools, frames"),
        "system": Case("Dly 0.5", "P_Tool=P9", "P_Tool=: tools, frames"),
        "which one": Case("Dly 0.5", "PA(1)=(1,2,3,4,5,6)(7,0)\r\nPA(M1)=P_Curr", "PA(M1): which"),
        "relative": Case("Dly 0.5", "Mov J9, -50", "Mov J9, -50"),
        "compound": Case("Dly 0.5", "Mov P8*P9", "P8*P9"),
        "computed": Case("Dly 0.5", "Mov PB(M1)", "PB(M1) is computed"),
        "elsewhere": Case("Dly 0.5", "If M1=1 Then Mov P_99", "P_99 is computed"),
        "offset": Case("Dly 0.5", "P9=(1,2,3,4,5,6)(7,0)", "no statement of the backup moves to P9"),
    },
    "VAL3": {
        "no encoding": Case('encoding="utf-8"', 'encoding="utf-78"', "1: this is no whole file of an app"),
        "cut off": Case("</Datas>\r\n</Database>", "", "1: this is no whole file of an application"),
        "damaged": Case(
            ' rz="',
            ' rq="',
            "8: pP1[1]: its frame usrapp/work:fjig[0]: it is not in six numbers",
            checked=False,
        ),
        "five numbers": Case(
            "</Datas>",
            '<Data name="pZ" type="pointRx" size="1"><Value key="0" x="1" /></Data>\r\n</Datas>',
            "pZ[0] states 1 numbers",
        ),
        "seven axes": Case(
            "</Datas>",
            '<Data name="jZ" type="jointRx" size="1"><Value key="0" j1="1" j2="1" j3="1" j4="1" j5="40"'
            ' j6="1" j7="5" /></Data>\r\n</Datas>',
            "jZ[0] states 6 numbers",
        ),
        "tool at run time": Case(
            "  waitEnd", "  tGrip.trsf.z=9\r\n  waitEnd", "tGrip is set when the program"
        ),
        "frame at run time": Case(
            "  waitEnd", "  fJig.trsf=fA.trsf\r\n  waitEnd", "fJig is set when the program"
        ),
        "any frame": Case("  waitEnd", "  fJig[i].trsf.z=5\r\n  waitEnd", "fJig[i] is set when the program"),
        "an array": Case("  waitEnd", "  insert(pP1,1)\r\n  waitEnd", "pP1 is used by this"),
        "linked": Case("  waitEnd", "  link(pA, fJig)\r\n  waitEnd", "link(: tools or frames are set"),
        "any tool": Case(
            "  waitEnd",
            "  movej(pP1[1],tAny[i],m)\r\n  waitEnd",
            "8: pP1[1] is used with several",
            checked=False,
        ),
        "overwritten": Case("  waitEnd", "  pP1[1]=here(tGrip,world)\r\n  waitEnd", "the program overwrites"),
        "component": Case("  waitEnd", "  pP1[1].trsf.z=5\r\n  waitEnd", "the program overwrites"),
        "relative": Case("  waitEnd", "  movel(appro(pP1[1],tr),tTorch,m)\r\n  waitEnd", "appro(pP1[1],tr)"),
        "computed": Case("  waitEnd", "  movej(pP1[i],tTorch,m)\r\n  waitEnd", "pP1[i] is computed"),
        "here": Case("  waitEnd", "  movej(herej(),flange,m)\r\n  waitEnd", "herej() is computed"),
        "library": Case("  waitEnd", "  movej(lib:pA,flange,m)\r\n  waitEnd", "lib:pA is computed"),
        "elsewhere": Case(
            "  waitEnd", "  movej(pNone,flange,m)\r\n  waitEnd", "pnone[0] is stored elsewhere"
        ),
        "call": Case("  waitEnd", "  call pick(pP1[1])\r\n  waitEnd", "pP1[1] is used by this"),
    },
    "DRL": {
        "tool at run time": Case("wait(0.5)", "add_tcp('a', t)", "add_tcp: tools or frames are set"),
        "frame at run time": Case("wait(0.5)", "u = set_user_cart_coord(p)", "set_user_cart_coord: tools or"),
        "any frame": Case("wait(0.5)", "movel(posx(1,2,3,4,5,6), ref=u)", "the frame of this motion is set"),
        "five numbers": Case("wait(0.5)", "movej(posj(1,2,3,4,5))", "line 9 has 5 numbers"),
        "overwritten": Case("wait(0.5)", "P1[2] += 10", "the program overwrites the stored position P1"),
        "on a branch": Case("wait(0.5)", "if a: P1 = b", "P1 is used by this"),
        "in a loop": Case("wait(0.5)", "for P1 in points:", "P1 is used by this"),
        "two values": Case("wait(0.5)", "P1 = posx(1,2,3,4,5,6)", "P1 has several values"),
        "computed": Case("wait(0.5)", "movel(add_pose(P1, d))", "add_pose(P1, d) is computed"),
        "elsewhere": Case("wait(0.5)", "movej(Global_P1)", "global_p1 is stored elsewhere"),
        "step": Case("wait(0.5)", "movel(posx(0,0,9,0,0,0), mod=DR_MV_MOD_REL)", "posx(0,0,9,0,0,0)"),
        "spiral": Case("wait(0.5)", "move_spiral(rev=3, rmax=20)", "move_spiral is a step"),
        "home": Case("wait(0.5)", "move_home(DR_HOME_TARGET_USER)", "move_home: home is stored"),
        "call": Case("wait(0.5)", "pick(P1)", "P1 is used by this"),
        "offset": Case("wait(0.5)", "D = posx(0,0,9,0,0,0)", "no statement of the backup moves to D"),
    },
    "PacScript": {
        "tool at run time": Case("  GiveArm", "  Tool 2, P[5]", "Tool 2, P[5]: tools or frames are set"),
        "work at run time": Case("  GiveArm", "  Work 2, CurPos", "Work 2, CurPos: tools or frames are set"),
        "any tool": Case("  GiveArm", "  ChangeTool n\r\n  Move P, P1", "9: P1 is used with several tools"),
        "taken again": Case("  GiveArm", "  TakeArm\r\n  Move P, P1", "9: P1 is used with several tools"),
        "matrix": Case("  GiveArm", "  Move P, T(1,2,3,1,0,0,0,1,0,5)", "line 18: this position is not"),
        "five numbers": Case("  GiveArm", "  Move P, J(1,2,3,4,5)", "line 18 has 5 numbers"),
        "external axis": Case("  GiveArm", "  Move P, J(1,2,3,4,50,6,7)", "line 18 has positions of"),
        "axes": Case("  GiveArm", "  DriveA (1, 90)", "line 18 has 2 numbers"),
        "which one": Case("  GiveArm", "  P[n] = CurPos", "P[n]: which position is overwritten"),
        "overwritten": Case("  GiveArm", "  LetX P1 = 10", "the program overwrites the stored position P1"),
        "on a branch": Case("  GiveArm", "  If a Then P1 = CurPos", "P1 is used by this"),
        "component": Case("  GiveArm", "  PosX(P1) = 5", "P1 is used by this"),
        "two values": Case("  GiveArm", "  P1 = P(1,2,3,4,5,6,5)", "P1 has several values"),
        "relative": Case("  GiveArm", "  Move L, P1 + P(0,0,9,0,0,0)", "P1 + P(0,0,9,0,0,0)"),
        "approach": Case("  GiveArm", "  Approach L, P1, h", "Approach L P1 h"),
        "step": Case("  GiveArm", "  Draw L, V1", "Draw L V1"),
        "computed": Case("  GiveArm", "  Move P, P[n]", "P[n] is computed"),
        "spline": Case("  GiveArm", "  Move S, 1", "Move S 1 is computed"),
        "elsewhere": Case("  GiveArm", "  Move P, P[99]", "p[99] is stored elsewhere"),
        "call": Case("  GiveArm", "  Call pick(P1)", "P1 is used by this"),
    },
    "URScript": {
        "no near joints": Case(
            "end\r\n", "  movel(p[.4,.2,.3,0.1,3,0])\r\nend\r\n", "11: line 11: several sets", checked=False
        ),
        "five numbers": Case("end\r\n", "  movej([1,2,3,4,5])\r\nend\r\n", "line 11 has 5 numbers"),
        "tool at run time": Case(
            "end\r\n",
            "  set_tcp(t)\r\n  movel(P1_p)\r\nend\r\n",
            "4: P1_p is used with several",
            checked=False,
        ),
        "conveyor": Case(
            "end\r\n", "  track_conveyor_linear(d, 9)\r\nend\r\n", "track_conveyor_linear: tools"
        ),
        "overwritten": Case(
            "end\r\n", "  P1_p[2]=0.3\r\nend\r\n", "the program overwrites the stored position"
        ),
        "two values": Case("end\r\n", "  P1_p=p[1,2,3,4,5,6]\r\nend\r\n", "P1_p has several values"),
        "relative": Case(
            "end\r\n", "  movel(pose_trans(P1_p, p[0,0,.1,0,0,0]))\r\nend\r\n", "pose_trans(P1_p"
        ),
        "in a frame": Case(
            "end\r\n", "  movel(pose_trans(plane, P1_p))\r\nend\r\n", "pose_trans(plane, P1_p) is"
        ),
        "computed": Case(
            "end\r\n", "  movej(get_actual_joint_positions())\r\nend\r\n", "get_actual_joint_pos"
        ),
        "elsewhere": Case("end\r\n", "  movej(home_q)\r\nend\r\n", "home_q is stored elsewhere"),
        "speed": Case("end\r\n", "  speedl([0,0,.1,0,0,0], 1)\r\nend\r\n", "speedl(: where it ends"),
        "call": Case("end\r\n", "  pick(P1_p)\r\nend\r\n", "P1_p is used by this"),
    },
}


# With two poses of one tool and frame, each declared.
SEEDS = {"VAL3": 24, "DRL": 31, "PacScript": 15, "URScript": 23}


@cache
def _made(language: str) -> MadeBackup:
    return DIALECTS[language].made(SEEDS.get(language, 11), 2)


@pytest.mark.parametrize("language", CASES)
def test_without_these_lines_it_is_converted(language: str, tmp_path: Path) -> None:
    backup = _made(language)
    assert kept(written(backup, tmp_path), backup.dialect.robot, **backup.options).converted


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("language", "case"), [(language, case) for language, cases in CASES.items() for case in cases]
)
def test_it_is_refused_or_listed_by_line(
    language: str, case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dialect, one = DIALECTS[language], CASES[language][case]
    backup = _made(language)
    name = next(name for name, text in backup.texts.items() if one.old in text)
    at = backup.texts[name].index(one.old) + len(one.new) - len(one.new.lstrip())
    backup = replace(backup, texts=backup.texts | {name: backup.texts[name].replace(one.old, one.new, 1)})
    answer = kept(written(backup, tmp_path / "bad"), dialect.robot, **backup.options)
    assert not answer.converted
    found = [(each.line, each.sentence) for each in (*answer.refused, *answer.open_lines)]
    sentences = [f"{line}: {sentence}" if one.said[:1].isdigit() else sentence for line, sentence in found]
    assert any(each.startswith(one.said) for each in sentences), sentences
    line = backup.texts[name].count("\n", 0, at) + 1
    assert any(line <= of <= line + one.new.count("\n") for of, _ in found) or one.said[:1].isdigit(), found
    _without_checks(monkeypatch)
    options = backup.options | {"accept": []}  # nothing is listed then
    assert kept(tmp_path / "bad", dialect.robot, **options).converted == one.checked


def _without_checks(monkeypatch: pytest.MonkeyPatch) -> None:
    def nothing(*_: Any, **__: Any) -> None: ...

    monkeypatch.setattr(FileReading, "refuse", nothing)
    monkeypatch.setattr(FileReading, "doubt", nothing)
    finished = BackupReading.finished

    def without(self: BackupReading) -> BackupReading:
        result = finished(self)
        result.refused.clear()
        result.doubtful.clear()
        return result

    monkeypatch.setattr(BackupReading, "finished", without)


def test_a_variable_of_inform_that_the_job_computes_is_refused(tmp_path: Path) -> None:
    backup = replace(_made("INFORM"), texts=dict(_made("INFORM").texts))
    name, text = next((name, text) for name, text in backup.texts.items() if "//INST" in text)
    stored = "///POSTYPE PULSE\r\n///PULSE\r\nP0001=1000,2000,3000,4000,20000,6000\r\n//INST"
    text = text.replace("NPOS 2,0,0,0", "NPOS 2,0,0,1").replace("//INST", stored)
    for line, sentence in {
        "SETE P001 (3) 100": "the program overwrites the stored position P001",
        "GETS PX001 $PX000": "the program overwrites the stored position P001",
        "SFTON P001": "P0001 is a place at one statement and an offset at another",
    }.items():
        backup.texts[name] = text.replace("NOP\r\n", f"NOP\r\n{line}\r\nMOVJ P001 VJ=1.00\r\n")
        answer = kept(written(backup, tmp_path), backup.dialect.robot, **backup.options)
        assert [one.sentence for one in answer.refused] == [sentence]
    backup.texts[name] = text.replace("NOP\r\n", "NOP\r\nMOVJ P001 VJ=1.00\r\n")
    assert len(kept(written(backup, tmp_path), backup.dialect.robot, **backup.options).positions) == 3


def test_words_that_are_not_published_must_not_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    dialect = DIALECTS["SPEL+"]
    near = np.array([15.0, 25.0, -75.0, 90.05, 50.0, -20.0])
    monkeypatch.setattr(dialect, "near", near)
    monkeypatch.setattr(dialect, "random_joints", lambda rng: near)
    backup = dialect.made(11, 2)
    said = [one.sentence for one in kept(written(backup, tmp_path), dialect.robot, **backup.options).refused]
    assert said
    assert all("joint 4 passes a quarter turn" in sentence for sentence in said)
    assert kept(tmp_path, dialect.robot, -ENTERED, **backup.options).converted
    monkeypatch.setattr(arm_change, "_sides_of_wrist", lambda joints: [])
    assert kept(tmp_path, dialect.robot, **backup.options).converted


@pytest.mark.parametrize(("language", "data"), [("SPEL+", "robot1.pts"), ("VAL3", "usrapp/work/work.dtx")])
def test_a_data_file_alone_is_read_with_the_programs_beside_it(
    language: str, data: str, tmp_path: Path
) -> None:
    backup, case = _made(language), CASES[language]["overwritten"]
    program, text = next((name, text) for name, text in backup.texts.items() if case.old in text)
    written(replace(backup, texts=backup.texts | {program: text.replace(case.old, case.new, 1)}), tmp_path)
    said = shown_programs(tmp_path / data)
    assert [(one.file, one.sentence[:22]) for one in said.refused] == [
        (Path(program).name, "the program overwrites")
    ]
    assert any(row.tool for row in said.positions)
    (tmp_path / program).unlink()
    assert shown_programs(tmp_path / data).refused == ()
