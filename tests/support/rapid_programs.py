"""Random RAPID modules: statements that are understood, and forms that must not be.

A program is made of rows of joints: its targets are where the nominal arm has the flange there.
"""

from __future__ import annotations

import random
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from controller_arm import ControllerArm
from rapid_controller import WRISTS, Wrist, matrix

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.kinematics.robot import Robot

_UNUSED = "[9E9,9E9,9E9,9E9,9E9,9E9]"
_LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"


@dataclass(frozen=True)
class Form:
    """What is added to a good program: a statement of `main`, declarations, routines. `line` is what of the
    program is in the line that the refusal names: by default the statement, else the declaration."""

    statement: str = ""
    declaration: str = ""
    routine: str = ""
    line: str = ""
    calls: tuple[str, ...] = ()
    leave: tuple[str, ...] = ()

    @property
    def named(self) -> str:
        return self.line or self.statement or self.declaration or self.routine


# {p}: a robtarget of the tool tCell in wCell, which are data of another file; {q}: one of tHand in wFix,
# which the program declares; {j}: a jointtarget; {v}: the value of {p}.
FORMS: dict[str, Form] = {
    "a component of a work object of another file": Form("wCell.oframe.trans.z:=wCell.oframe.trans.z+5;"),
    "a component in an instruction": Form("Add wCell.oframe.trans.z,5;"),
    "a component of wobj0": Form("wobj0.oframe.trans.z:=5;"),
    "a component of tool0": Form("tool0.tframe.trans.z:=5;"),
    "a component of a tool of another file": Form("tCell.tframe.trans.z:=tCell.tframe.trans.z+5;"),
    "a component of a declared work object": Form("wFix.uframe.trans.x:=wFix.uframe.trans.x+5;"),
    "a component of a declared tool": Form("tHand.tframe.rot:=[1,0,0,0];"),
    "a work object that is assigned": Form("wFix:=wCell;"),
    "a tool of another file that is assigned": Form("tCell:=tHand;"),
    "a conditional option": Form(
        "SlowTo\\wo:=wFix;",
        routine="PROC SlowTo(\\PERS wobjdata wo)\n    MoveJ {q},v50,fine,tHand\\WObj?wo;\n  ENDPROC",
        line="MoveJ {q},v50,fine,tHand\\WObj?wo;",
    ),
    "a value that is passed": Form("PickAt {v};"),
    "a value that is passed to a stated routine": Form("PickAt {v};", calls=("PickAt",)),
    "a target that is passed to a stated routine": Form("PickAt {p};", calls=("PickAt",)),
    "a robtarget in a record": Form(
        "n1:=stOne.nr;",
        "RECORD station\n    robtarget pick;\n    num nr;\n  ENDRECORD\n  CONST station stOne:=[{v},3];",
        line="CONST station stOne",
    ),
    "a motion to a component of a record": Form(
        "MoveJ stOne.pick,v100,fine,tCell\\WObj:=wCell;",
        "RECORD station\n    robtarget pick;\n  ENDRECORD\n  CONST station stOne:=[{v}];",
    ),
    "a component of a target": Form("{p}.trans.z:=0.9*{p}.trans.z;"),
    "a target that is assigned": Form("{p}:=Offs({p},0,0,5);"),
    "a target that is read": Form("n1:={p}.trans.z;"),
    "a condition on a target": Form("IF {p}.trans.z>300 Set do1;"),
    "a compact IF that changes a target": Form("IF di1=1 {p}.trans.z:=0.9*{p}.trans.z;"),
    "Offs": Form("MoveL Offs({p},0,0,5),v100,fine,tCell\\WObj:=wCell;"),
    "RelTool": Form("MoveL RelTool({p},0,0,5),v100,fine,tCell\\WObj:=wCell;"),
    "a position that is read": Form("pHere:=CRobT(\\Tool:=tCell\\WObj:=wCell);", "VAR robtarget pHere;"),
    "a literal with an expression": Form(
        "MoveJ [[n1,400,500],[1,0,0,0],[0,0,0,0],{u}],v100,fine,tCell\\WObj:=wCell;"
    ),
    "a target of another file": Form("MoveJ pElse,v100,fine,tCell\\WObj:=wCell;"),
    "a target that equals another": Form("", "CONST robtarget pSame:={p};"),
    "a target with a number that is computed": Form(
        "", "CONST robtarget pSum:=[[1+2,0,0],[1,0,0,0],[0,0,0,0],{u}];"
    ),
    "a target without a motion": Form("", "CONST robtarget pSpare:={v};"),
    "a pose": Form("", "CONST pose peAny:=[[1,2,3],[1,0,0,0]];"),
    "a position": Form("", "PERS pos psAny:=[1,2,3];"),
    "a type by another name": Form("", "ALIAS robtarget spot;\n  CONST spot pSpot:={v};", line="CONST spot"),
    "an array of tools": Form("", "PERS tooldata tAll{1}:=[[TRUE,[[0,0,1],[1,0,0,0]],{load}]];"),
    "a shift of all targets": Form("PDispSet [[0,0,5],[1,0,0,0]];"),
    "a shift by a pose": Form("PDispSet peAny;", "VAR pose peAny;"),
    "a shift by a motion": Form("PDispOn {p},tCell;"),
    "a shift of external axes": Form("EOffsSet [5,0,0,0,0,0];"),
    "a path correction": Form("CorrCon cd1;"),
    "an option for path corrections": Form("MoveL {p},v100,fine,tCell\\WObj:=wCell\\Corr;"),
    "configurations of linear motions off": Form("ConfL\\Off;"),
    "configurations of joint motions off": Form("ConfJ\\Off;"),
    "orientations that are not kept": Form("SingArea\\Wrist;"),
    "soft joints": Form("SoftAct 3,50;"),
    "a mechanical unit": Form("ActUnit STN1;"),
    "an external axis of a target": Form("MoveAbsJ [{joints},[300,9E9,9E9,9E9,9E9,9E9]],v100,fine,tool0;"),
    "another tool at a target": Form("MoveJ {p},v100,fine,tHand\\WObj:=wCell;"),
    "another work object at a target": Form("MoveJ {p},v100,fine,tCell;"),
    "a tool that nobody states": Form("MoveJ {v},v100,fine,tElse\\WObj:=wCell;"),
    "a work object twice": Form("MoveJ {v},v100,fine,tCell\\WObj:=wCell\\WObj:=wFix;"),
    "a stationary tool": Form(
        "MoveJ {v},v100,fine,tStill\\WObj:=wCell;",
        "PERS tooldata tStill:=[FALSE,[[0,0,1],[1,0,0,0]],{load}];",
    ),
    "a work object on the robot": Form(
        "MoveJ {v},v100,fine,tCell\\WObj:=wHeld;",
        'PERS wobjdata wHeld:=[TRUE,TRUE,"",[[0,0,1],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
    ),
    "a work object that moves": Form(
        "MoveJ {v},v100,fine,tCell\\WObj:=wTurns;",
        'PERS wobjdata wTurns:=[FALSE,FALSE,"STN1",[[0,0,1],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];',
    ),
    "a routine with a target": Form(
        "GoTo {p};",
        routine="PROC GoTo(robtarget pAny)\n    MoveJ pAny,v100,fine,tCell\\WObj:=wCell;\n  ENDPROC",
        line="PROC GoTo",
    ),
    "a number of a frame by reference": Form(
        "Raise5 wCell.oframe.trans.z;", routine="PROC Raise5(INOUT num nAny)\n    nAny:=nAny+5;\n  ENDPROC"
    ),
    "a work object by reference": Form(
        "Shift5 wCell;",
        routine="PROC Shift5(INOUT wobjdata wAny)\n    Add wAny.oframe.trans.z,5;\n  ENDPROC",
    ),
    "a function of targets": Form(
        "MoveJ Above(5),v100,fine,tCell\\WObj:=wCell;",
        routine="FUNC robtarget Above(num nAny)\n    RETURN Offs({p},0,0,nAny);\n  ENDFUNC",
    ),
    "a target of the routine with another's name": Form(
        "Local1;",
        routine="PROC Local1()\n    VAR robtarget {p}:={v};\n    "
        "MoveJ {p},v100,fine,tCell\\WObj:=wCell;\n  ENDPROC",
        line="VAR robtarget {p}",
    ),
    "a number with a target's name": Form(
        "Local2;", routine="PROC Local2()\n    VAR num {p}:=3;\n    {p}:=4;\n  ENDPROC", line="VAR num {p}"
    ),
    "a loop with a work object's name": Form(
        "FOR wCell FROM 1 TO 2 DO\n    ENDFOR\n    wCell.oframe.trans.z:=3;"
    ),
    "a motion with a signal": Form("MoveLDO {p},v100,fine,tCell\\WObj:=wCell,do1,1;"),
    "a motion with a trigger": Form("TriggL {p},v100,tr1,fine,tCell\\WObj:=wCell;"),
    "a motion with a trigger, stated": Form("TriggL nAny;", calls=("TriggL",)),
    "a search": Form("SearchL\\Stop,di1,pFound,{p},v100,tCell\\WObj:=wCell;"),
    "an arc": Form("ArcL {p},v100,sm1,wd1,fine,tCell\\WObj:=wCell;"),
    "a name in a text": Form('%"other"%;'),
    "a call by a number": Form('CallByVar "other",n1;'),
    "data by a name in a text": Form('SetDataVal "{p}",n1;'),
    "a configuration of the controller": Form('WriteCfgData "/MOC/ROBOT/rob1","base_frame_pos_x",n1;'),
    "a module that is loaded": Form('Load\\Dynamic,"HOME:/other.mod";'),
    "an interrupt that moves": Form(
        "CONNECT i1 WITH tMove;",
        "VAR intnum i1;",
        "TRAP tMove\n    MoveAbsJ {j},v100,fine,tool0;\n  ENDTRAP",
        line="TRAP tMove",
    ),
    "an interrupt that calls": Form(
        "CONNECT i1 WITH tCall;",
        "VAR intnum i1;",
        "TRAP tCall\n    Home;\n  ENDTRAP\n  PROC Home()\n    MoveAbsJ {j},v100,fine,tool0;\n  ENDPROC",
        line="TRAP tCall",
    ),
    "an interrupt of another file": Form("CONNECT i1 WITH tElse1;", "VAR intnum i1;"),
    "a routine of another file": Form("Other1;"),
    "a function of another file": Form("n1:=nOther1(3);"),
    "an instruction of another file with a language's name": Form(
        "Set do1;",
        routine="PROC Set(VAR signaldo doAny)\n    MoveAbsJ {j},v100,fine,tool0;\n  ENDPROC",
        line="PROC Set",
    ),
    "data of another file, assigned": Form("wNext:=wThis;"),
    "data of another file, by an expression": Form("psNext:=psThis*2;"),
    "a way that is stored": Form("StorePath;"),
    "zerobeam's own functions": Form("MoveAbsJ zb_command({j}),v100,fine,tool0;"),
    "an element that is not there": Form(
        "MoveJ pMany{7},v100,fine,tCell\\WObj:=wCell;", "CONST robtarget pMany{1}:=[{v}];"
    ),
    "an array of another size": Form(
        "MoveJ pMany{n1},v100,fine,tCell\\WObj:=wCell;",
        "CONST robtarget pMany{3}:=[{v}];",
        line="CONST robtarget pMany",
    ),
    "joints as numbers": Form("", "CONST num nRows{2,6}:=[[1,2,3,4,5,6],[9,9,9,9,9,9]];"),
    "a number that is none": Form(
        "MoveJ [[1E400,0,500],[1,0,0,0],[0,0,0,0],{u}],v100,fine,tCell\\WObj:=wCell;"
    ),
    "joints that are none": Form("MoveAbsJ [[0,0,1E400,0,30,0],{u}],v100,fine,tool0;"),
    "an orientation that is none": Form("MoveJ [[400,0,500],[1,1,0,0],[0,0,0,0],{u}],v100,fine,tool0;"),
    "a configuration that is none": Form("MoveJ [[400,0,500],[0,0,1,0],[7,0,0,0],{u}],v100,fine,tool0;"),
    "a pose out of reach": Form("MoveJ [[9000,0,500],[0,0,1,0],[0,0,0,0],{u}],v100,fine,tool0;"),
    "a singular wrist": Form("MoveJ {singular},v100,fine,tool0;"),
    "a line end within a line": Form("! it goes on\rMoveAbsJ {j},v100,fine,tool0;", line="! it goes on"),
    "a semicolon that is missing": Form("n1:=2\n    Set do1;", line="n1:=2"),
    "an end without a begin": Form("ENDIF"),
    "a begin without an end": Form("IF n1=3 THEN", line="ENDPROC"),
    "brackets without an end": Form("n1:=((2);"),
    "a handler of steps back": Form(
        "Back1;",
        routine="PROC Back1()\n    n1:=3;\n  BACKWARD\n    MoveAbsJ {j},v100,fine,tool0;\n  ENDPROC",
        line="BACKWARD",
    ),
    "a handler of stops": Form(
        "Undo1;", routine="PROC Undo1()\n    n1:=3;\n  UNDO\n    n1:=4;\n  ENDPROC", line="UNDO"
    ),
    "a placeholder": Form("<SMT>"),
    "a second module": Form("", routine="ENDMODULE\nMODULE other", line="MODULE other"),
}


@dataclass
class RapidProgram:
    """A module, what is stated of it, and the data of other files with which it runs."""

    robot: Robot
    text: str
    rows: Matrix  # (K, 6) joints that its targets mean
    choices: ProgramOptions
    elsewhere: dict[str, tuple[str, Any]]
    counts: dict[str, int] = field(default_factory=dict)  # literals that are targets, frames, left

    @cached_property
    def nominal(self) -> ControllerArm:
        return ControllerArm.of(self.robot)

    @property
    def wrist(self) -> Wrist:
        return WRISTS[self.robot.name]


_robot = lru_cache(load_robot)


def random_pose(rng: random.Random, most: float) -> list[list[float]]:
    turn = np.array([rng.gauss(0, 1) for _ in range(4)])
    turn = (turn / np.linalg.norm(turn)).round(9)
    return [[round(rng.uniform(-most, most), 3) for _ in range(3)], turn.tolist()]


def listed(values: Any) -> str:
    if isinstance(values, list):
        return f"[{','.join(map(listed, values))}]"
    return f"{values:.9f}".rstrip("0").rstrip(".") if isinstance(values, float) else str(values)


class Writer:
    """Writes random programs for an arm."""

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.robot = _robot(self.rng.choice(["irb120", "irb1600"]))
        self.arm, self.wrist = ControllerArm.of(self.robot), WRISTS[self.robot.name]
        rng = self.rng
        frames = {"tHand": 80, "tCell": 60, "wFix": 150, "wCell": 120}
        self.frames = {name: random_pose(rng, most) for name, most in frames.items()}
        self.counts = {"target": 0, "frame": 0, "left": 0}
        self.rows: list[Matrix] = []
        self.declarations: list[str] = []
        self.motions: list[str] = []  # to targets that are declared
        self.words: dict[str, str] = {"u": _UNUSED, "load": _LOAD}
        self.base = self._row(None)
        self.routines: list[str] = []
        self.leave: list[str] = []
        self.depth, self.labels = 0, 0

    def program(self, forms: list[Form], length: int, plain: bool = False) -> RapidProgram:
        """`plain`: the forms are at the end, each line is as it is written here."""
        self._frames()
        self._targets()
        body = [self._settled(), self._statements(length)]
        added = [form for form in forms if form.statement]
        statements = [self.filled(form.statement) for form in added]
        body += [*self._closing(), *statements] if plain else [*statements, *self._closing()]
        declared = [
            *self.declarations,
            *(self.filled(form.declaration) for form in forms if form.declaration),
        ]
        routines = [*self.routines, *(self.filled(form.routine) for form in forms if form.routine)]
        if not plain and self.rng.random() < 0.5:
            routines.reverse()
        main = "\n".join(["PROC main()", *("    " + line for line in body), "  ENDPROC"])
        lines = ["MODULE job", *("  " + line for line in [*declared, main, *routines]), "ENDMODULE", ""]
        if not plain and self.rng.random() < 0.3:
            lines = ["%%%", "  VERSION:1", "  LANGUAGE:ENGLISH", "%%%", *lines]
        text = "\n".join(lines) if plain else self._disguised("\n".join(lines))
        values = {name: self._stated(name) for name in ("tCell", "wCell")}
        wobj = [False, True, "", [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]], self.frames["wCell"]]
        elsewhere = {
            "tcell": (
                "tooldata",
                [True, self.frames["tCell"], [1.0, [0.0, 0.0, 1.0], [1.0, 0, 0, 0], 0, 0, 0]],
            ),
            "wcell": ("wobjdata", wobj),
            "pelse": ("robtarget", [*self._value(self._row(self.base)), [9e9] * 6]),
        }
        choices = ProgramOptions(
            tools=[values["tCell"]],
            frames=[values["wCell"]],
            leave=[*self.leave, *(name for form in forms for name in form.leave)],
            calls=[*["Log1"][: "Log1" in text], *(name for form in forms for name in form.calls)],
        )
        return RapidProgram(self.robot, text, np.array(self.rows), choices, elsewhere, self.counts)

    def _stated(self, name: str) -> str:
        trans, turn = self.frames[name]
        return f"{name}={','.join(map(listed, [*trans, *turn]))}"

    def filled(self, text: str) -> str:
        for key, value in self.words.items():
            text = text.replace("{" + key + "}", value)
        return text

    # Positions

    def _row(self, near: Matrix | None) -> Matrix:
        """Joints away from limits and singularities; near others in their posture."""
        rng = self.rng
        lower, upper = (
            np.degrees(np.maximum(self.robot.lower, -3.0)) * 0.8,
            np.degrees(np.minimum(self.robot.upper, 3.0)) * 0.8,
        )
        while True:
            row = np.array([rng.uniform(*each) for each in zip(lower, upper, strict=True)])
            if near is not None:
                row = np.clip(near + np.array([rng.uniform(-35, 35) for _ in range(6)]), lower, upper)
            row = row.round(4)
            ahead, before_arm, bent = self.wrist.sides(self.arm, row)
            if abs(ahead) < 90 or abs(before_arm) < 70 or not 6 < abs(bent) < 115:
                continue
            if near is None or self._branch(row) == self._branch(near):
                return row

    def _branch(self, row: Matrix) -> int:
        return self.wrist.configuration(self.arm, row)[3]

    def _value(self, row: Matrix, tool: str = "tCell", wobj: str = "wCell") -> list[Any]:
        in_flange = np.eye(4) if tool == "tool0" else matrix(self.frames[tool])
        frame = np.eye(4) if wobj == "wobj0" else matrix(self.frames[wobj])
        pose = np.linalg.inv(frame) @ self.arm.fk(row, "deg") @ in_flange
        values, vectors = np.linalg.eigh(_quaternion_form(pose[:3, :3]))
        turn = vectors[:, np.argmax(values)]
        return [pose[:3, 3].tolist(), turn.tolist(), self.wrist.configuration(self.arm, row)]

    def robtarget(self, tool: str, wobj: str) -> str:
        far = self.rng.random() < self.far
        row = self._row(None if far else self.base)
        self.rows.append(row)
        unused = self.rng.choice([_UNUSED, "[9E+09, 9E+09, 9E+09, 9E+09, 9E+09, 9E+09]", "[0,0,0,0,0,0]"])
        return f"{listed(self._value(row, tool, wobj))[:-1]},{unused}]"

    def jointtarget(self) -> str:
        row = self._row(None if self.rng.random() < self.far else self.base)
        self.rows.append(row)
        return f"[{listed(row.tolist())},{_UNUSED}]"

    def _frames(self) -> None:
        self.far = self.rng.choice([0.0, 0.0, 0.0, 0.3])
        self.declarations += [
            f"PERS tooldata tHand:=[TRUE,{listed(self.frames['tHand'])},{_LOAD}];",
            f'PERS wobjdata wFix:=[FALSE,TRUE,"",{listed(self.frames["wFix"])},[[0,0,0],[1,0,0,0]]];',
            *("VAR num n1:=0;", "VAR num n2:=3;", "VAR bool b1:=FALSE;", 'VAR string s1:="a ! b";'),
            *("CONST num nList{3}:=[1,2,3];", "VAR speeddata vSlow:=[50,500,5000,1000];"),
        ]
        self.counts["frame"] += 3

    def _targets(self) -> None:
        rng = self.rng
        pairs = [("tCell", "wCell"), ("tHand", "wFix"), ("tool0", "wobj0"), ("tHand", "wCell")]
        for i, (tool, wobj) in enumerate([*pairs[:2], *rng.choices(pairs, k=rng.randint(0, 3))]):
            name, value = f"p{i}", self.robtarget(tool, wobj)
            storage = rng.choice(["CONST", "PERS", "VAR", "LOCAL CONST", "TASK PERS"])
            self.declarations.append(f"{storage} robtarget {name}:={value};")
            self.counts["target"] += 1
            self._motion(name, tool, wobj)
            if i < 2:
                self.words["pq"[i]] = name
        if rng.random() < 0.3:
            values = [self.robtarget("tCell", "wCell") for _ in range(3)]
            self.declarations.append(f"CONST robtarget pRow{{3}}:=[{','.join(values)}];")
            self.counts["target"] += 3
            for index in ("1", "n2", "3"):
                self._motion(f"pRow{{{index}}}", "tCell", "wCell")
        for i in range(rng.randint(1, 3)):
            self.declarations.append(f"CONST jointtarget j{i}:={self.jointtarget()};")
            self.counts["target"] += 1
            self.motions.append(f"MoveAbsJ j{i}\\NoEOffs,v100,fine,tool0;")
        if rng.random() < 0.3:
            value = self.robtarget("tHand", "wFix")
            self.declarations.append(f"PERS robtarget pTaught:={value};")
            self.leave.append("pTaught")
            self.counts["left"] += 1
        row = self._row(self.base)
        self.words |= {"j": "j0", "joints": listed(row.tolist())}
        self.words["v"] = f"{listed(self._value(row))[:-1]},{_UNUSED}]"
        straight = row * np.array([1, 1, 1, 1, 0, 1])
        self.words["singular"] = f"{listed(self._value(straight, 'tool0', 'wobj0'))[:-1]},{_UNUSED}]"

    def _motion(self, name: str, tool: str, wobj: str) -> None:
        rng = self.rng
        option = rng.choice(["", "\\WObj:=wobj0"]) if wobj == "wobj0" else f"\\WObj:={wobj}"
        for word in rng.sample(["MoveJ", "MoveL"], k=rng.randint(1, 2)):
            speed = rng.choice(["v100", "vSlow", "v50\\V:=40", "[100,500,5000,1000]", "v50\\T:=n2"])
            zone = rng.choice(["fine", "z10", "fine\\Inpos:=inpos50", "z1\\Z:=2"])
            head = rng.choice(["", "", "\\Conc, "])
            load = rng.choice(["", "\\TLoad:=load0"])
            self.motions.append(f"{word} {head}{name},{speed},{zone},{tool}{option}{load};")
        if rng.random() < 0.2 and "{" not in name:
            motion = f"MoveC {name},{self.robtarget(tool, wobj)},v100,fine,{tool}{option};"
            self.counts["target"] += 1
            self.routines.append(f"PROC Arc{len(self.routines)}()\n    {motion}\n  ENDPROC")

    # Statements

    def _settled(self) -> str:
        settings = ["ConfL\\On;", "SingArea\\Off;", "CirPathMode\\CirPointOri;", "AccSet 50,50;"]
        return f"MoveAbsJ j0,v100,fine,tool0;\n    {self.rng.choice(settings)}"

    def _closing(self) -> list[str]:
        """All targets are used, also where the rest is not reached."""
        arcs = [each.split("(")[0].removeprefix("PROC ") for each in self.routines if "PROC Arc" in each]
        return [*self.motions, *(f"{name};" for name in arcs)]

    def _statements(self, count: int) -> str:
        return "\n    ".join(self._statement() for _ in range(count))

    def _statement(self) -> str:
        rng = self.rng
        simple = [
            *(
                "n1:=n1+1;",
                "Incr n1;",
                "Add n2,-1;",
                "b1:=di1=1 OR n1>3;",
                's1:="n"+NumToStr(n1,0);',
                "reg1:=reg1+1;",
            ),
            *("Set do1;", "Reset do1;", "SetDO do1,1;", "PulseDO\\PLength:=0.2,do1;", "WaitTime\\InPos,0.1;"),
            *("WaitUntil di1=1;", 'TPWrite "n"\\Num:=n1;', "vSlow.v_tcp:=40;", "Log1 n1;", "n2:=nList{1};"),
            *(
                "ClkReset clock1;",
                "nElse:=3;",
                "ConfJ\\On;",
                "! comment; MoveJ p9,v1,fine,tool0;",
                "n2:=Abs(n1-2) MOD 3+1;",
            ),
            "IF di1=1 n1:=2;",
            "IF b1 AND n1<4 Incr n1;",
            f"IF di2=0 {rng.choice(self.motions)}",
        ]
        if rng.random() < 0.45:
            return rng.choice(self.motions)
        if rng.random() < 0.55 or self.depth > 2:
            return rng.choice(simple)
        self.depth += 1
        try:
            return self._block()
        finally:
            self.depth -= 1

    def _block(self) -> str:
        rng = self.rng

        def inner() -> str:
            return self._statements(rng.randint(0, 3))

        self.labels += 1
        kind = rng.choice(
            ["if", "else", "for", "while", "test", "goto", "call", "literal", "trap", "error", "function"]
        )
        i = self.labels
        if kind == "if":
            return f"IF di1=1 THEN {inner()} ENDIF"
        if kind == "else":
            return f"IF n1=1 THEN {inner()} ELSEIF (di2=1) THEN {inner()} ELSE {inner()} ENDIF"
        if kind == "for":
            return f"FOR k FROM 1 TO {rng.choice(['2', 'n2'])} DO {inner()} ENDFOR"
        if kind == "while":
            return f"n1:=0; WHILE n1<2 DO n1:=n1+1; {inner()} ENDWHILE"
        if kind == "test":
            return f"TEST n2 CASE 1,2: {inner()} CASE 3: {inner()} DEFAULT: {inner()} ENDTEST"
        if kind == "goto":
            return f"IF di1=1 GOTO lab{i}; {inner()} lab{i}: {rng.choice(self.motions)}"
        if kind == "literal":
            tool, wobj = rng.choice([("tCell", "wCell"), ("tHand", "wobj0")])
            self.counts["target"] += 1
            if rng.random() < 0.3:
                return f"MoveAbsJ {self.jointtarget()},v100,fine,tool0;"
            return f"MoveJ {self.robtarget(tool, wobj)},v100,fine,{tool}\\WObj:={wobj};"
        if kind == "call":
            self.routines.append(
                f"PROC Sub{i}(num nUp,INOUT num nBack \\switch bFast)\n    VAR num n1:=1;\n    {inner()}\n"
                "    nBack:=nUp+1;\n    IF di1=1 RETURN;\n  ENDPROC"
            )
            return f"Sub{i} n1+1,n2" + rng.choice([";", "\\bFast;"])
        if kind == "function":
            self.routines.append(f"FUNC num Count{i}(num nUp)\n    {inner()}\n    RETURN nUp+1;\n  ENDFUNC")
            return f"n1:=Count{i}(n2);"
        if kind == "trap":
            self.routines.append(f"TRAP Beep{i}\n    n2:=2;\n    Set do1;\n  ENDTRAP")
            self.declarations.append(f"VAR intnum iBeep{i};")
            return f"CONNECT iBeep{i} WITH Beep{i}; ISignalDI di1,1,iBeep{i};"
        self.routines.append(
            f"PROC Try{i}()\n    {inner()}\n    WaitDI di3,1\\MaxTime:=2;\n    {inner()}\n  ERROR\n"
            f"    {inner()}\n    {rng.choice(['RETRY;', 'TRYNEXT;', 'RETURN;'])}\n  ENDPROC"
        )
        return f"Try{i};"

    def _disguised(self, text: str) -> str:
        """Other letters, blanks and ends of lines."""
        rng = self.rng
        if rng.random() < 0.3:
            for word in ("MoveJ", "MoveL", "robtarget", "WObj", "IF ", "THEN", "p0", "tHand", "wCell"):
                if rng.random() < 0.5:
                    text = text.replace(word, rng.choice([word.upper(), word.lower()]))
        if rng.random() < 0.3:
            text = text.replace(",fine", " ,\t fine").replace(":=[", " := [ ")
        if rng.random() < 0.3:
            text = text.replace(";\n", ';  ! caf\xe9 "x; MoveL p1,v1,z1,tool0;\n')
        return text.replace("\n", "\r\n") if rng.random() < 0.5 else text


def _quaternion_form(turn: Matrix) -> Matrix:
    """The symmetric matrix (4, 4) of which the quaternion of a rotation is the eigenvector of the largest
    value (I. Y. Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", 2000)."""
    m = turn
    return np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2]],
            [m[0, 2] - m[2, 0], m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2]],
            [m[1, 0] - m[0, 1], m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
