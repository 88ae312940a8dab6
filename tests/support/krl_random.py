"""Random KRL programs, as integrators write them, and worse: with statements that no rewriter may accept.

A program is written along the text; what is really active at a motion the interpreter finds out. Literals are
counted as they are written.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from controller_arm import ControllerArm
from krl_controller import status
from krl_values import components, frame

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix

TOOLS = {1: (0, 0, 150, 0, 0, 0), 3: (10, -5, 120, 20, 30, 0)}
BASES = {2: (300, -100, 50, 15, 0, 0), 4: (280, 80, -30, -20, 5, 2)}
HOME = {"A1": 5.0, "A2": -85.0, "A3": 95.0, "A4": 10.0, "A5": 40.0, "A6": 0.0}


@dataclass(frozen=True)
class Bad:
    """What is refused: `lines` of a routine, `data` of the data list, `more` behind all.

    `{name}` is a position, `{data}` its data set, `{pose}` a literal, `{flipped}` one of another status,
    `{axes}` joints. The line that is to be named has `>` before it; in a program it has ;BAD behind it.
    """

    lines: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    more: tuple[str, ...] = ()


_SHIFT = "{{X 20,Y 10,Z 0,A 0,B 0,C 0}}"
BAD: dict[str, Bad] = {
    "a component of the base": Bad((">$BASE.X=320",)),
    "a base and a shift": Bad((f">$BASE=BASE_DATA[2]:{_SHIFT}",)),
    "a base that is computed for a spline": Bad(
        (f">SPLINE WITH $BASE=BASE_DATA[2]:{_SHIFT}", "SPL {name}", "ENDSPLINE")
    ),
    "a component of the tool": Bad((">$TOOL.Z=130",)),
    "a component of a tool of the controller": Bad((">TOOL_DATA[3].Z=130", "BAS(#TOOL,3)")),
    "another base for an inline form": Bad((">{data}.BASE_NO=4",)),
    "a base of the controller from a variable": Bad(
        (">BASE_DATA[2]=SHIFTED", "BAS(#BASE,2)"), ("DECL FRAME SHIFTED={{X 310,Y -80,Z 50,A 15,B 0,C 0}}",)
    ),
    "the foot of the robot": Bad((f">$ROBROOT={_SHIFT}",)),
    "a position passed to a routine": Bad(
        (">GOPOS({pose})",), (), ("DEF GOPOS(P:IN)", "DECL E6POS P", "PTP P", "END")
    ),
    "a position passed to another file": Bad((">GOPOS({pose})",)),
    "a target passed to a routine": Bad(
        (">GOPOS({name})",), (), ("DEF GOPOS(P:IN)", "DECL E6POS P", "LIN P", "END")
    ),
    "a component of a target": Bad((">{name}.Z={name}.Z+20",)),
    "a target that is taught at run time": Bad((">{name}=$POS_ACT",)),
    "a second value of a target": Bad((">{name}={pose}",)),
    "a target from another": Bad((">{name}=XOTHER",), ("DECL E6POS XOTHER={pose}",)),
    "a relative PTP": Bad((">PTP_REL {{A1 5}}",)),
    "a relative linear motion": Bad((">LIN_REL {{Z 10}}",)),
    "a target and a shift": Bad((f">LIN {{name}}:{_SHIFT}",)),
    "a target of an array by a variable": Bad((">PTP P[N]",), ("DECL E6POS P[2]", "P[1]={pose}")),
    "a target of another file": Bad((">PTP XGLOBAL",)),
    "axes in part": Bad((">PTP {{A1 10}}",)),
    "a pose in part": Bad((">LIN {{X 500}}",)),
    "axes in a linear motion": Bad((">LIN {{A1 0,A2 -90,A3 90,A4 0,A5 30,A6 0}}",)),
    "an external axis": Bad((">LIN {pose_with_axis}",)),
    "a circle with an angle": Bad((">CIRC {name}, {name}, CA 180",)),
    "a circle of which the end is a shift": Bad((f">CIRC {{name}}, {{name}}:{_SHIFT}",)),
    "a tool fixed in the room": Bad((">$IPO_MODE=#TCP",)),
    "a tool fixed in the room for a motion": Bad((">LIN {name} #TCP",)),
    "a tool fixed in the room by a data set": Bad(
        ("FDAT_ACT=FTCP",), (">DECL FDAT FTCP={{TOOL_NO 3,BASE_NO 2,IPO_FRAME #TCP}}",)
    ),
    "an orientation that is not reached": Bad((">$ORI_TYPE=#CONSTANT",)),
    "an orientation that is not reached, by a data set": Bad(
        ("LDAT_ACT=LBAD", "BAS(#CP_PARAMS,0.1)"), (">DECL LDAT LBAD={{VEL 2.0,ACC 100.0,ORI_TYP #CONSTANT}}",)
    ),
    "an orientation that is not reached, for a motion": Bad((">SLIN {name} WITH $ORI_TYPE=#CONSTANT",)),
    "a path by a data set of another file": Bad((">LDAT_ACT=LGLOBAL",)),
    "an interrupt that moves": Bad(
        (">INTERRUPT DECL 21 WHEN $IN[9]==TRUE DO AWAY()", "INTERRUPT ON 21"),
        (),
        ("DEF AWAY()", "PTP {axes}", "END"),
    ),
    "an interrupt that changes the base": Bad(
        (">INTERRUPT DECL 21 WHEN $IN[9]==TRUE DO AWAY()", "INTERRUPT ON 21"),
        (),
        ("DEF AWAY()", "BAS(#BASE,4)", "END"),
    ),
    "a trigger that changes the tool": Bad(
        (">TRIGGER WHEN DISTANCE=1 DELAY=0 DO AWAY() PRIO=-1",),
        (),
        ("DEF AWAY()", "$TOOL=TOOL_DATA[1]", "END"),
    ),
    "a trigger that calls another file": Bad((">TRIGGER WHEN DISTANCE=0 DELAY=0 DO ELSEWHERE() PRIO=-1",)),
    "a trigger that shifts the base": Bad((">TRIGGER WHEN DISTANCE=0 DELAY=0 DO $BASE.X=330",)),
    "a routine of another file": Bad((">ELSEWHERE()",)),
    "a function of another file": Bad((">N=ELSEWHERE()+1",)),
    "a base that moves": Bad((">$BASE=EK(MACHINE_DEF[2].ROOT,#EASYS,{{X 0,Y 0,Z 0,A 0,B 0,C 0}})",)),
    "an external base": Bad((">BAS(#EX_BASE,1)",)),
    "axes beside the robot": Bad((">ASYPTP {{E1 10}}",)),
    "a tool by a variable": Bad((">$TOOL=TOOL_DATA[N]",)),
    "a base by a variable": Bad((">BAS(#BASE,N)",)),
    "a tool by a variable for a motion": Bad((">SPTP {name} WITH $TOOL=TOOL_DATA[N]",)),
    "a base by a function for a motion": Bad((">SLIN {name} WITH $BASE=SBASE(N)",)),
    "the components of a target in a condition": Bad((">IF {name}.Z>100 THEN", "WAIT SEC 0.1", "ENDIF")),
    "the position of the arm in a condition": Bad((">IF $POS_ACT.Z>100 THEN", "WAIT SEC 0.1", "ENDIF")),
    "the axes of the arm in a variable": Bad((">R=$AXIS_ACT.A1",)),
    "the position with another base": Bad(("BAS(#BASE,4)", ">LIN $POS_ACT")),
    "other postures by the controller's choice": Bad((">$TARGET_STATUS=#BEST",)),
    "another behaviour in singularities": Bad((">$SINGUL_POS[3]=1",)),
    "a palletizing robot": Bad((">$PAL_MODE=TRUE",)),
    "a motion that is stopped": Bad((">BRAKE",)),
    "a resumed program": Bad((">RESUME",)),
    "a variable that is not declared": Bad((">BASE_TYPE[2]=#ERSYS",)),
    "a data set of another type": Bad((">MACHINE_FRAME_DAT[2].MACH_DEF_INDEX=1",)),
    "a home position in numbers": Bad((">$H_POS={{A1 0,A2 -90,A3 90,A4 0,A5 0,A6 0}}",)),
    "a command as a text": Bad((">CWRITE($CMD,STAT,MODE,X[])",)),
    "a base that differs by branches": Bad(
        ("IF $IN[3] THEN", "BAS(#BASE,4)", "ELSE", "BAS(#BASE,2)", "ENDIF", ">LIN {pose}", "BAS(#BASE,2)")
    ),
    "a base that is changed in a routine": Bad(
        ("MAYBE()", ">LIN {pose}", "BAS(#BASE,2)"),
        (),
        ("DEF MAYBE()", "IF $IN[3] THEN", "BAS(#BASE,4)", "ENDIF", "END"),
    ),
    "a posture that differs by branches": Bad(
        ("IF $IN[3] THEN", "PTP {flipped}", "ENDIF", ">LIN {name}", "PTP {axes}")
    ),
    "a posture that is not that of the motion before": Bad(("PTP {flipped}", ">LIN {name}", "PTP {axes}")),
    "a posture behind a target that is left": Bad(("PTP XHOME", ">LIN {name}", "PTP {axes}")),
    "a posture that a routine changes": Bad(
        ("FLIP()", ">LIN {name}", "PTP {axes}"), (), ("DEF FLIP()", "PTP {flipped}", "END")
    ),
    "a posture in the second round": Bad(
        ("FOR N=1 TO 2", ">LIN {name}", "PTP {flipped}", "ENDFOR", "PTP {axes}")
    ),
    "a posture behind a jump": Bad(
        (
            *("IF $IN[3] THEN", "PTP {flipped}", "GOTO BEHIND", "ENDIF"),
            *("PTP {axes}", "BEHIND:", ">LIN {name}", "PTP {axes}"),
        )
    ),
    "a posture that a routine begins with": Bad(
        (), (), ("GLOBAL DEF FROMOUTSIDE()", "BAS(#TOOL,3)", "BAS(#BASE,2)", ">LIN {name}", "END")
    ),
    "S without T behind another posture": Bad(("PTP {flipped}", ">PTP {without_t}", "PTP {axes}")),
    "a function that moves in a condition": Bad(
        (">WHILE MOVES()", "WAIT SEC 0.1", "EXIT", "ENDWHILE"),
        (),
        ("DEFFCT BOOL MOVES()", "PTP {axes}", "RETURN TRUE", "ENDFCT"),
    ),
    "a number that is none": Bad((">PTP {{A1 1e400,A2 -90,A3 90,A4 0,A5 30,A6 0}}",)),
    "half a motion": Bad((">LIN",)),
    "a bracket that is not closed": Bad((">LIN {{X 500,Y 0,Z 600",)),
    "a structure that is not closed": Bad((">IF $IN[3] THEN",)),
    "an end without a begin": Bad((">ENDIF",)),
    "a motion of a spline alone": Bad((">SPL {name}",)),
    "a position that is a parameter": Bad(
        (), (), (">GLOBAL DEF FROMOUTSIDE({name}:IN)", "PTP {name}", "END")
    ),
    "a position that counts": Bad((">FOR {name}=1 TO 2", "ENDFOR")),
    "a name that is declared twice": Bad((), ("DECL INT TWICE", ">DECL E6POS TWICE={pose}"), ()),
}


@dataclass
class Program:
    """The text of .src and .dat, what is stated of it, how many literals there are of each use; joints that
    its targets mean; the names of what was put in that has to be refused."""

    src: str
    dat: str
    choices: ProgramOptions
    literals: Counter[str]
    rows: Matrix
    bad: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return self.src + self.dat

    def config(self) -> dict[str, Any]:
        """What other files declare."""
        names = ("X", "Y", "Z", "A", "B", "C")
        return {
            "TOOL_DATA": {n: dict(zip(names, map(float, v), strict=True)) for n, v in TOOLS.items()},
            "BASE_DATA": {n: dict(zip(names, map(float, v), strict=True)) for n, v in BASES.items()},
            "XHOME": dict(HOME),
            "FHOME": {"TOOL_NO": 1.0, "BASE_NO": 2.0, "IPO_FRAME": "#BASE"},
            "PDEFAULT": {},
        }


def rows_of(rng: np.random.Generator, lower: Matrix, upper: Matrix, count: int) -> Matrix:
    """(N, 6) joints near each other, of one status, away from singularities and limits."""
    while True:
        middle = rng.uniform(0.6 * lower, 0.6 * upper)
        near = middle + rng.uniform(-9, 9, (4 * count, 6))
        wanted = status(middle)
        kept = [row for row in np.round(near, 3) if _clear(row, lower, upper) and status(row) == wanted]
        if len(kept) >= count and wanted is not None:
            return np.array(kept[:count])


def _clear(row: Matrix, lower: Matrix, upper: Matrix) -> bool:
    around = [status(row + shift) for shift in 6 * np.vstack([np.eye(6), -np.eye(6)])]
    inside = bool((row > 0.9 * lower).all() and (row < 0.9 * upper).all())
    return inside and None not in around and len(set(around)) == 1 and abs(row[4]) > 15


class Writer:
    """Writes one program."""

    def __init__(self, seed: int, arm: ControllerArm, lower: Matrix, upper: Matrix) -> None:
        self.rng, self.arm = np.random.default_rng(seed), arm
        self.rows = rows_of(self.rng, lower, upper, 8)
        other = rows_of(self.rng, lower, upper, 2)
        while status(other[0]) == status(self.rows[0]):
            other = rows_of(self.rng, lower, upper, 2)
        self.other = other
        self.lines: list[str] = []
        self.data: list[str] = []
        self.more: list[str] = []
        self.literals: Counter[str] = Counter()
        self.points: list[tuple[str, int, int]] = []
        self.arrays: list[str] = []
        self.tool, self.base = frame_of(TOOLS[3]), frame_of(BASES[2])
        self.numbers = 3, 2
        self.used: set[str] = set()
        self.depth = self.labels = self.in_routine = 0
        self.subs: list[str] = []

    def chance(self, share: float) -> bool:
        return bool(self.rng.random() < share)

    def one_of(self, *items: Any) -> Any:
        return items[int(self.rng.integers(len(items)))]

    # Literals

    def row(self) -> Matrix:
        return np.asarray(self.rows[self.rng.integers(len(self.rows))])

    def pose(self, row: Matrix, tool: Matrix, base: Matrix, parts: str = "ST") -> str:
        values = components(np.linalg.inv(base) @ self.arm.fk(row, "deg") @ tool)
        shown = [f"{name} {value:.9g}" for name, value in values.items()]
        if "S" in parts:
            own = status(row)
            assert own is not None
            shown.append(f"S {own + int(self.one_of(0, 0, 16))}" if self.chance(0.9) else f"S 'B{own:03b}'")
        if "T" in parts:
            shown.append(f"T {sum(1 << i for i, value in enumerate(row) if value < 0)}")
        if self.chance(0.3):
            shown += [f"E{i} 0.0" for i in range(1, 7)]
        return "{" + self.one_of(",", ", ").join(shown) + "}"

    def here(self, parts: str = "ST", row: Matrix | None = None, use: str = "target") -> str:
        self.literals[use] += 1
        return self.pose(self.row() if row is None else row, self.tool, self.base, parts)

    def axes(self, row: Matrix | None = None) -> str:
        self.literals["target"] += 1
        row = self.row() if row is None else row
        return "{" + ",".join(f"A{i} {value:.6g}" for i, value in enumerate(row, start=1)) + "}"

    def frame_literal(self, pose: Matrix) -> str:
        self.literals["frame"] += 1
        kind = self.one_of("", "FRAME: ")
        return "{" + kind + ",".join(f"{k} {v:.9g}" for k, v in components(pose).items()) + "}"

    def point(self, tool: int, base: int, parts: str = "ST") -> str:
        """A position and its data set, both in the data list: the name without X and F."""
        if self.points and self.chance(0.25):
            known = [name for name, t, b in self.points if (t, b) == (tool, base)]
            if known:
                return str(self.one_of(*known))
        name = f"P{len(self.points) + 1}"
        self.points.append((name, tool, base))
        pose = self.pose(self.row(), frame_of(TOOLS[tool]), frame_of(BASES[base]), parts)
        self.literals["target"] += 1
        self.data += [
            f"DECL E6POS X{name}={pose}",
            f"DECL FDAT F{name}={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #BASE,"
            'POINT2[] " ",TQ_STATE FALSE}',
        ]
        self.uses(tool, base)
        return name

    def uses(self, tool: int, base: int) -> None:
        self.used |= {f"tool {tool}", f"base {base}"}

    def choose(self, tool: int, base: int) -> None:
        self.numbers = tool, base
        self.tool, self.base = frame_of(TOOLS[tool]), frame_of(BASES[base])
        self.uses(tool, base)

    # Statements

    def say(self, *lines: str) -> None:
        self.lines += lines

    def inline(self) -> None:
        tool, base = self.one_of((3, 2), (3, 2), (3, 2), (1, 4), (3, 4))
        word = self.one_of("PTP", "PTP", "LIN", "LIN", "CIRC")
        point = self.point(tool, base)
        self.choose(tool, base)
        if word == "PTP":
            self.say(
                f";FOLD PTP {point} Vel=100 % PDAT1 Tool[{tool}] Base[{base}];%{{PE}}", "$BWDSTART=FALSE"
            )
            self.say("PDAT_ACT=PPDAT1", f"FDAT_ACT=F{point}", "BAS(#PTP_PARAMS,100)", f"PTP X{point} C_PTP")
        else:
            self.say(f";FOLD {word} {point}", "LDAT_ACT=LCPDAT1", f"FDAT_ACT=F{point}", "BAS(#CP_PARAMS,0.5)")
            names = f"X{self.point(tool, base)}, X{point}" if word == "CIRC" else f"X{point}"
            self.say(f"{word} {names}{self.one_of('', ' C_DIS', ' C_DIS C_DIS')}")
        self.say(";ENDFOLD")

    def spline_inline(self) -> None:
        tool, base = self.one_of((3, 2), (1, 4))
        word = self.one_of("SPTP", "SLIN", "SCIRC")
        point = self.point(tool, base)
        names = f"X{self.point(tool, base)}, X{point}" if word == "SCIRC" else f"X{point}"
        data = f"F{point}"
        self.say(
            f"{word} {names} WITH $VEL_AXIS[1]=SVEL_JOINT(100.0), $TOOL=STOOL2({data}),"
            f" $BASE=SBASE({data}.BASE_NO), $IPO_MODE=SIPO_MODE({data}.IPO_FRAME),"
            f" $LOAD=SLOAD({data}.TOOL_NO), $APO=SAPO_PTP(PPDAT1){self.one_of('', ' C_SPL')}"
            if word == "SPTP"
            else f"{word} {names} WITH $VEL=SVEL_CP(2.0, , LCPDAT1), $TOOL=STOOL2({data}),"
            f" $BASE=SBASE({data}.BASE_NO), $ORI_TYPE=SORI_TYP(LCPDAT1), $JERK=SJERK(LCPDAT1)"
        )
        if self.chance(0.7):
            self.frames()

    def literal(self) -> None:
        kind = int(self.rng.integers(8))
        if kind == 0:
            self.say(f"PTP {self.axes()}{self.one_of('', ' C_PTP')} ; to {{A1 0}}")
        elif kind == 1:
            self.say(f"PTP {self.here()}")
        elif kind == 2:
            self.say(f"LIN {self.here(self.one_of('ST', 'S', ''))} C_DIS")
        elif kind == 3:
            self.say(f"PTP {self.here(self.one_of('S', 'T', ''))}")
        elif kind == 4:
            self.say(f"CIRC {self.here('')}, {self.here('')}")
        elif kind == 5:
            self.say(f"slin {self.here(self.one_of('ST', '')).lower()}")
        elif kind == 6 and self.chance(0.3):
            self.say(f"PTP {self.here(row=self.other[0])}", f"PTP {self.here()}")
        else:
            name = f"Q[{len(self.arrays) + 1}]"
            self.arrays.append(name)
            self.data.append(f"{name}={{E6POS: {self.here()[1:]}")
            self.say(f"{self.one_of('PTP', 'LIN')} {name}")

    def frames(self) -> None:
        kind = int(self.rng.integers(7))
        tool, base = self.one_of((3, 2), (3, 2), (1, 4))
        self.choose(tool, base)
        if kind == 0:
            self.say(f"$BASE=BASE_DATA[{base}]", f"$TOOL = TOOL_DATA[{tool}]")
        elif kind == 1:
            self.base = frame_of(self.one_of((250, 50, 20, 5, 0, 0), (320, -20, 10, 0, 3, 0)))
            self.say(f"BAS(#TOOL,{tool})", f"$BASE={self.frame_literal(self.base)}")
        elif kind == 2:
            self.tool = frame_of((0, 20, 100, 10, 0, 0))
            self.say(f"BAS(#BASE,{base})", f"$TOOL={self.frame_literal(self.tool)}")
        elif kind == 3:
            self.base = np.eye(4)
            self.say(f"BAS(#TOOL,{tool})", self.one_of("$BASE=$NULLFRAME", "BAS(#BASE,0)", "$BASE=$WORLD"))
        elif kind == 4:
            self.say(f"FDAT_ACT={{TOOL_NO {tool},BASE_NO {base},IPO_FRAME #BASE}}", "BAS(#FRAMES)")
        elif kind == 5:
            self.base = frame_of((290, 30, 15, 5, 0, 4))
            number = 7 if self.chance(0.8) else 8
            self.used |= {f"defined {number}"}
            self.say(f"BASE_DATA[{number}]={self.frame_literal(self.base)}", f"BAS(#BASE,{number})")
            self.say(f"BAS(#TOOL,{tool})")
        else:
            self.say(f"bas (#tool, {tool} )", f"BAS(#BASE,{base})")

    def block(self) -> None:
        tool, base = self.numbers
        self.choose(tool, base)
        self.say(f"SPLINE WITH $BASE=BASE_DATA[{base}], $TOOL=TOOL_DATA[{tool}]")
        for _ in range(int(self.rng.integers(1, 4))):
            word = self.one_of("SPL", "SLIN", "SPL", "SCIRC")
            first = f"{self.here('')}, " if word == "SCIRC" else ""
            self.say(f"{word} {first}{self.here(self.one_of('ST', ''))}")
        self.say(f"ENDSPLINE{self.one_of('', ' C_SPL')}", f"BAS(#TOOL,{tool})", f"BAS(#BASE,{base})")

    def flow(self) -> None:
        if self.depth >= 2:
            return
        self.depth += 1
        kind = int(self.rng.integers(8))
        condition = self.one_of("$IN[3]", "$IN[4]==TRUE AND NOT (N>7)", "N<3", "ABS(N)>1 OR $FLAG[2]")
        if kind == 0:
            self.say(f"IF {condition} THEN", *self.inner(), "ENDIF")
        elif kind == 1:
            self.say(f"IF {condition} THEN", *self.inner(), "ELSE", *self.inner(), "ENDIF")
        elif kind == 2:
            self.say("FOR M=1 TO 2", *self.inner(), "ENDFOR")
        elif kind == 3:
            self.say("WHILE $IN[5]", *self.inner(), "ENDWHILE")
        elif kind == 4:
            self.say("LOOP", *self.inner(), "IF $IN[6] THEN", "EXIT", "ENDIF", "ENDLOOP")
        elif kind == 5:
            self.say("REPEAT", *self.inner(), "UNTIL $IN[7] OR $IN[8]")
        elif kind == 6:
            self.say("SWITCH $ANIN[1]", "CASE 1", *self.inner(), "CASE 2, 3", *self.inner())
            self.say(*(["DEFAULT", *self.inner()] if self.chance(0.5) else []), "ENDSWITCH")
        else:
            self.labels += 1
            label = f"L{self.labels}"
            self.say(f"IF {condition} THEN", f"GOTO {label}", "ENDIF", *self.inner(), f"{label}:")
        self.depth -= 1

    def inner(self) -> list[str]:
        outer, self.lines = self.lines, []
        before = self.tool, self.base, self.numbers
        for _ in range(int(self.rng.integers(1, 4))):
            self.good()
        found, self.lines = self.lines, outer
        if self.chance(0.6):
            found += ["BAS(#TOOL,3)", "BAS(#BASE,2)"]
            self.choose(3, 2)
        elif self.chance(0.5):
            self.tool, self.base, self.numbers = before
        return found

    def call(self) -> None:
        if self.in_routine or not self.subs or self.chance(0.4):
            name = f"SUB{len(self.subs) + 1}"
            if self.in_routine:
                return
            self.subs.append(name)
            outer, self.lines, self.in_routine = self.lines, [], 1
            before = self.tool, self.base, self.numbers
            self.say(f"DEF {name}(K:IN)", "DECL INT K", "DECL INT N, M", "N=K+1", "M=2")
            if self.chance(0.4):
                self.say("$OUT[5]=TRUE", "WAIT SEC 0.1")
            else:
                if self.chance(0.7):
                    self.frames()
                for _ in range(int(self.rng.integers(1, 4))):
                    self.good()
                if self.chance(0.2):
                    self.say("IF $IN[9] THEN", "RETURN", "ENDIF")
                    self.good()
            self.say("END")
            self.more += self.lines
            self.lines, self.in_routine = outer, 0
            if self.chance(0.7):
                self.say(f"{name}(N)", "BAS(#TOOL,3)", "BAS(#BASE,2)")
                self.choose(3, 2)
                return
            self.tool, self.base, self.numbers = before
        self.say(f"{self.one_of(*self.subs)}({self.one_of('1', 'N', 'N+2')})")

    def noise(self) -> None:
        kind = int(self.rng.integers(12))
        if kind == 0:
            self.say("GRIPPER(1, N)")
            self.used.add("GRIPPER")
        elif kind == 1:
            self.literals["frame"] += 1
            self.say("$LOAD.CM={X 0, Y 0, Z 50, A 0, B 0, C 0}", "$LOAD.M=2.5")
        elif kind == 2:
            self.say("TRIGGER WHEN DISTANCE=0 DELAY=20 DO $OUT[8]=TRUE")
        elif kind == 3:
            self.say("PTP $AXIS_ACT ; {X 1, Y 2}")
        else:
            self.say(
                self.one_of(
                    "N=N+1",
                    "N=-N*(M-3)",
                    "$OUT[3]=TRUE",
                    "WAIT FOR $IN[1] OR NOT $IN[2]",
                    "WAIT SEC 0.5 ; $BASE.X=800",
                    "PULSE($OUT[1],TRUE,0.5)",
                    "$VEL.CP=0.2",
                    "$VEL_AXIS[2]=25",
                    "$ADVANCE=3",
                    "R=2.5*N-'H0F'",
                    'NAME[]="LIN {X 1, Y 2}"',
                    "HALT",
                    "$TIMER[1]=0",
                )
            )

    def good(self) -> None:
        statement = self.rng.choice(
            ["inline", "spline_inline", "literal", "frames", "block", "flow", "call", "noise"],
            p=[0.3, 0.1, 0.2, 0.06, 0.05, 0.11, 0.08, 0.1],
        )
        getattr(self, str(statement))()

    def bad(self, name: str) -> None:
        """Something that has to be refused, at this place."""
        bad = BAD[name]
        point = self.one_of(*[each[0] for each in self.points])
        tool, base = next((t, b) for n, t, b in self.points if n == point)
        self.choose(tool, base)
        flipped = self.pose(self.other[0], self.tool, self.base)
        pose = self.pose(self.row(), self.tool, self.base)
        forms = {
            "name": f"X{point}",
            "data": f"F{point}",
            "pose": pose,
            "flipped": flipped,
            "without_t": self.pose(self.row(), self.tool, self.base, "S"),
            "pose_with_axis": self.pose(self.row(), self.tool, self.base, "")[:-1].split(",E1")[0]
            + ",E1 100}",
            "axes": self.axes(),
        }
        self.say(f"BAS(#TOOL,{tool})", f"BAS(#BASE,{base})")
        self.say(*_marked(bad.lines, forms))
        self.data += _marked(bad.data, forms)
        self.more += _marked(bad.more, forms)

    def program(self, bad: list[str]) -> Program:
        self.point(3, 2)
        home = self.chance(0.5)
        self.say("BAS (#INITMOV,0 )")
        if self.chance(0.3):
            self.say("PTP $AXIS_ACT")
        if home:
            self.say("FDAT_ACT=FHOME", "BAS(#PTP_PARAMS,100)", "PTP XHOME")
        if self.chance(0.85):
            self.frames()
        if self.chance(0.9):
            self.say(f"PTP {self.axes()}")
        count = int(self.rng.integers(3, 9))
        places = sorted(int(self.rng.integers(0, count)) for _ in bad)
        for at in range(count):
            for name, place in zip(bad, places, strict=True):
                if place == at:
                    self.bad(name)
            self.good()
        self.say("FDAT_ACT=FP1", "BAS(#PTP_PARAMS,50)", "PTP XP1")
        if home:
            self.say("PTP XHOME")
        return self.finished(bad, home or any("XHOME" in line for line in self.lines))

    def finished(self, bad: list[str], home: bool) -> Program:
        interrupt = ["GLOBAL INTERRUPT DECL 3 WHEN $STOPMESS==TRUE DO IR_STOPM ( )", "INTERRUPT ON 3"]
        head = ["&ACCESS RVP", "DEF job( )", "DECL INT N, M", "REAL R", "CHAR NAME[20]"]
        start = [*(interrupt if self.chance(0.5) else []), "N=1", "M=2", "R=0.5"]
        src = [*head, *start, *self.lines, "END", *self.more]
        dat = ["&ACCESS RVP", "DEFDAT job PUBLIC", "DECL PDAT PPDAT1={VEL 100.0,ACC 100.0,APO_MODE #CPTP}"]
        dat.append("DECL LDAT LCPDAT1={VEL 2.0,ACC 100.0,ORI_TYP #VAR,CIRC_TYP #BASE,EXAX_IGN 0}")
        if self.arrays:
            dat.append(f"DECL E6POS Q[{len(self.arrays)}]")
        dat += [*self.data, "ENDDAT"]
        choices = ProgramOptions(
            tools=[f"{n}={','.join(map(str, v))}" for n, v in TOOLS.items() if f"tool {n}" in self.used],
            frames=[f"{n}={','.join(map(str, v))}" for n, v in BASES.items() if f"base {n}" in self.used],
            leave=["XHOME"] if home else [],
            calls=["GRIPPER"] if "GRIPPER" in self.used else [],
        )
        rows = np.vstack([self.rows, self.other])
        return Program("\n".join([*src, ""]), "\n".join([*dat, ""]), choices, self.literals, rows, bad)


def _marked(lines: tuple[str, ...], forms: dict[str, str]) -> list[str]:
    shown = [line.format(**forms) for line in lines]
    return [f"{line[1:]} ;BAD" if line[0] == ">" else line for line in shown]


def frame_of(values: tuple[float, ...]) -> Matrix:
    """(4, 4) of X, Y, Z, A, B, C."""
    return frame(dict(zip("XYZABC", values, strict=True)))
