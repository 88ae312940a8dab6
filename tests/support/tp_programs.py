"""Random TP listings of a LR Mate 200iD, and instructions that have to be refused."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np
from controller_arm import ControllerArm
from scipy.spatial.transform import Rotation
from tp_controller import TpController, TpRun, clear_letters, configuration, frame, values_of

from zerobeam.experiments.makers.user_programs import ProgramOptions
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.robot_file import load_robot

FRAMES = {1: (300, -100, 50, 0, 0, 15), 2: (-50, 200, 20, 5, 0, -30), 4: (310, -95, 55, 1, 0, 16)}
TOOLS = {1: (10, -5, 120, 0, 30, 20), 3: (0, 15, 80, 0, 0, 0)}
_PAIRS = [(1, 1), (2, 3), (0, 1), (1, 3), (0, 0)]
HARMLESS = "GRIP_OPEN"
MACRO = "Close gripper 2"
HOME = "PR[2]"


def named(numbers: dict[int, tuple[float, ...]]) -> dict[int, Matrix]:
    return {0: np.eye(4), **{number: frame(*values) for number, values in numbers.items()}}


@cache
def nominal() -> ControllerArm:
    return ControllerArm.of(load_robot("lrmate_200id"))


@dataclass(frozen=True)
class Point:
    """P[number], with the joints (6,) that it means."""

    number: int
    row: Matrix
    in_joints: bool
    pair: tuple[int, int]

    @property
    def name(self) -> str:
        return f"P[{self.number}]"

    def lines(self, config: bool = True) -> list[str]:
        user, tool = self.pair
        frames = f"\tUF : {user}, UT : {tool},\t"
        if self.in_joints:
            shown = self.row - np.array([0, 0, self.row[1], 0, 0, 0])
            parts = [f"J{k}= {value:9.3f} deg" for k, value in enumerate(shown, start=1)]
        else:
            pose = np.linalg.inv(named(FRAMES)[user]) @ nominal().fk(self.row, "deg") @ named(TOOLS)[tool]
            units = ["mm"] * 3 + ["deg"] * 3
            parts = [
                f"{key} = {value:9.3f} {unit:>3}"
                for key, value, unit in zip("XYZWPR", values_of(pose), units, strict=True)
            ]
            frames += f"\tCONFIG : '{configuration(self.row)}'," * config
        comment = ':"part; X= 1.0 mm, Y= 1.0 mm, Z= 1.0 mm"' if self.number == 2 else ""
        return [
            f"P[{self.number}{comment}]{{",
            "   GP1:",
            frames,
            "\t" + ",\t".join(parts[:3]) + ",",
            "\t" + ",\t".join(parts[3:]),
            "};",
        ]


@dataclass
class Listing:
    """The parts of a listing; a line of the `body` that begins with \\0 is put there as it is."""

    points: list[Point]
    body: list[str]
    heading: str = "/PROG  JOB"
    attributes: list[str] = field(default_factory=lambda: ["OWNER\t\t= MNEDITOR;", 'COMMENT\t\t= "a; b";'])
    application: list[str] = field(default_factory=list)
    blocks: list[str] = field(default_factory=list)
    end: str = "\n"
    start: tuple[int, int] = (1, 1)
    left: frozenset[str] = frozenset()
    calls: frozenset[str] = frozenset()
    form: str = ""
    more_literals: int = 0

    def text(self) -> str:
        lines = [self.heading, "/ATTR", *self.attributes, "/APPL", *self.application, "/MN"]
        for number, statement in enumerate(self.body, start=1):
            if statement.startswith("\0"):
                lines.append(statement[1:])
                continue
            first, *more = statement.split("\n")
            space = "" if first[:2] in ("J ", "L ", "C ", "A ", "S ") else "  "
            rows = [f"{number:4}:{space}{first}", *(f"    :  {row}" for row in more)]
            rows[-1] += "    ;" if not space else " ;"
            lines += rows
        lines += [
            "/POS",
            *(line for point in self.points for line in point.lines()),
            *self.blocks,
            "/END",
            "",
        ]
        return self.end.join(lines)

    @property
    def choices(self) -> ProgramOptions:
        used = [point.pair for point in self.points if not point.in_joints and point.name not in self.left]
        return ProgramOptions(
            tools=[_option(tool, TOOLS) for tool in sorted({pair[1] for pair in used} - {0})],
            frames=[_option(user, FRAMES) for user in sorted({pair[0] for pair in used} - {0})],
            leave=sorted(self.left),
            calls=sorted(self.calls),
            j3="ground",
        )

    def controller(self) -> TpController:
        def other_tool(run: TpRun) -> None:
            run.tool_frames[run.tool] = run.tool_frames[run.tool] @ frame(15, -10, 20, 4, 0, 3)

        foreign = {"FOREIGN": other_tool, "Foreign tool": other_tool}
        return TpController(
            nominal(),
            named(FRAMES),
            named(TOOLS),
            registers={5: frame(12, -8, 6, 2, -1, 3), 6: frame(290, -105, 52, 0, 1, 14)},
            meant={point.name: point.row for point in self.points},
            taught={HOME: self.points[0].row, "PR[3]": self.points[0].row},
            routines={HARMLESS: lambda run: None, MACRO: lambda run: None, **foreign},
            active_user=self.start[0],
            active_tool=self.start[1],
        )


def _option(number: int, values: dict[int, tuple[float, ...]]) -> str:
    return f"{number}={','.join(map(str, values[number]))}"


def random_row(rng: np.random.Generator, letters: str) -> Matrix:
    while True:
        row = rng.uniform([-120, -50, -50, -150, -100, -250], [120, 90, 110, 150, 100, 250])
        found, clear = clear_letters(row)
        turned = np.abs((row[[0, 3, 5]] + 180) % 360)
        if clear > 30 and abs(row[4]) > 12 and turned.min() > 6 and turned.max() < 354 and found in letters:
            return np.round(row, 3)


class _Writer:
    """A random body; `pair` are the active frames, None where they depend on the way."""

    def __init__(self, rng: np.random.Generator, points: list[Point], start: tuple[int, int]) -> None:
        self.rng, self.points = rng, points
        self.pair: tuple[int, int] | None = start
        self.label = 0
        self.body: list[str] = []
        self.left: set[str] = set()
        self.calls: set[str] = set()

    def pick(self, *options: str) -> str:
        return str(self.rng.choice(list(options)))

    def add(self, *statements: str) -> None:
        self.body += statements

    def next_label(self) -> int:
        self.label += 1
        return self.label

    def joined(self) -> None:
        if len({point.pair for point in self.points if not point.in_joints}) > 1:
            self.pair = None

    def ready(self, point: Point) -> None:
        """Activate the frames of a pose."""
        if point.in_joints or self.pair == point.pair or self.rng.random() < 0.01:
            return
        if self.pair is None or self.pair[0] != point.pair[0]:
            self.add(f"UFRAME_NUM={point.pair[0]}")
        if self.pair is None or self.pair[1] != point.pair[1]:
            self.add(f"UTOOL_NUM{self.pick('', '[GP1]')}={point.pair[1]}")
        self.pair = point.pair

    def point(self) -> Point:
        return self.points[int(self.rng.integers(len(self.points)))]

    def motion(self) -> None:
        rng, point = self.rng, self.point()
        if rng.random() < 0.04:
            self.left.add(HOME)
            self.add(f"J {HOME[:-1]}{self.pick('', ':Home pos')}] 50% FINE")
            return
        self.ready(point)
        name = f"P[{point.number}{self.pick('', ':pick it')}]"
        end = self.pick("FINE", "CNT100", "CNT0", "CNT R[7]", "CR10mm")
        kind = rng.random()
        if kind < 0.5:
            line = f"J {name} {self.pick('100%', 'R[9:speed]%', '2.0sec')} {end}"
        elif kind < 0.9:
            word = self.pick("L", "L", "L", "A")
            speed = self.pick("100mm/sec", "R[9]mm/sec", "20cm/min", "5.5sec", "10deg/sec")
            line = f"{word} {name} {speed} {end}"
        else:
            others = [other for other in self.points if other.in_joints or other.pair == self.pair]
            other = others[int(rng.integers(len(others)))] if others else point
            line = f"C {name}\nP[{other.number}] 100mm/sec {end}"
        if rng.random() < 0.2:
            label = self.next_label()
            options = [" ACC80", "\nACC R[3]", " TB .20sec,DO[1]=ON", f" TA 1.00sec,CALL {HARMLESS}"]
            options += [" DB 5.0mm,DO[3:glue]=PULSE,0.5sec", f" Skip,LBL[{label}]"]
            option = self.pick(*options)
            if HARMLESS in option:
                self.calls.add(HARMLESS)
            if "Skip" in option:
                self.add("SKIP CONDITION DI[3]=ON", line + option, f"LBL[{label}:missed]")
                self.joined()
                return
            line += option
        self.add(line)

    def plain(self) -> None:
        call = self.rng.random()
        if call < 0.08:
            self.calls.add(HARMLESS)
            self.add(self.pick(f"CALL {HARMLESS}", f"CALL {HARMLESS}(1,R[2],'fast')", f"RUN {HARMLESS}"))
            return
        if call < 0.12:
            self.calls.add(MACRO)
            self.add(MACRO)
            return
        self.add(
            self.pick(
                "R[1:count]=R[1:count]+1",
                "R[2]=(R[1]*3+GI[2]) MOD 4",
                "R[R[3]]=(-5)",
                "R[4]=SQRT[R[1]]",
                "R[5]=$MNUFRAMENUM[1]",
                "DO[1:valve]=ON",
                "DO[R[3]]=(DI[1] AND !DI[2])",
                "RO[2]=PULSE,0.5sec",
                "GO[1]=R[1]",
                "F[3:ready]=(R[1]>2)",
                "WAIT   1.00(sec)",
                "WAIT R[6](sec)",
                "WAIT DI[5:part]=ON AND R[1]<>7",
                "TIMER[1]=START",
                "TIMER[1]=RESET",
                "OVERRIDE=80%",
                "OVERRIDE=R[8]",
                "JOINT_MAX_SPEED[1]=100",
                "LINEAR_MAX_SPEED=500",
                "PAYLOAD[1]",
                "UALM[2]",
                "PAUSE",
                "MESSAGE[next part]",
                "COL DETECT ON",
                "LOCK PREG",
                "$WAITTMOUT=500",
                "$MCR.$GENOVERRIDE=50",
                "",
                "!J P[98] 100% FINE",
                "!X= 1.0 mm, Y= 2.0 mm, Z= 3.0 mm",
                "//L P[1] 100mm/sec FINE\nOffset,PR[1]",
                "--eg:UFRAME[1]=PR[5]",
            )
        )

    def condition(self) -> str:
        return self.pick("R[1]=2", "DI[3]=ON", "(DI[1] OR R[2]<3)", "R[1]>=R[2] AND DI[2]=OFF", "(!F[1])")

    def block(self, depth: int) -> None:
        rng = self.rng
        for _ in range(int(rng.integers(1, 5))):
            kind = rng.random()
            if kind < 0.55:
                self.motion()
            elif kind < 0.78 or depth > 2:
                self.plain()
            else:
                self.structure(depth + 1)

    def structure(self, depth: int) -> None:
        kind = self.rng.integers(6)
        if kind == 0:
            self.add(
                f"IF {self.condition()} THEN" if self.rng.random() < 0 else f"IF ({self.condition()}) THEN"
            )
            self.block(depth)
            if self.rng.random() < 0.5:
                self.add("ELSE")
                self.joined()
                self.block(depth)
            self.add("ENDIF")
        elif kind == 1:
            register = 20 + depth
            self.add(f"FOR R[{register}]=1 TO {self.pick('2', '3', 'R[2]')}")
            self.joined()
            self.block(depth)
            self.add("ENDFOR")
        elif kind == 2:
            label = self.next_label()
            self.add(f"IF {self.condition()},JMP LBL[{label}]")
            self.block(depth)
            self.add(f"LBL[{label}:on]")
        elif kind == 3:
            label, register = self.next_label(), 30 + self.label
            self.add(f"R[{register}]=0", f"LBL[{label}]")
            self.joined()
            self.block(depth)
            self.add(f"R[{register}]=R[{register}]+1", f"IF R[{register}]<3,JMP LBL[{label}]")
            return
        elif kind == 4:
            one, two, end = self.next_label(), self.next_label(), self.next_label()
            self.add(
                f"SELECT R[1]=1,JMP LBL[{one}]", f"       =2,JMP LBL[{two}]", f"       ELSE,JMP LBL[{end}]"
            )
            for label in (one, two):
                self.add(f"LBL[{label}]")
                self.joined()
                self.block(depth)
                self.add(f"JMP LBL[{end}]")
            self.add(f"LBL[{end}]")
        else:
            label = self.next_label()
            self.add(f"WAIT DI[2]=ON TIMEOUT,LBL[{label}]")
            self.block(depth)
            self.add(f"LBL[{label}]")
        self.joined()


def good_listing(rng: np.random.Generator) -> Listing:
    """A listing whose instructions are all understood; it may still have a motion that the arm cannot do."""
    letters = str(rng.choice(["N U T", "F U T"]))
    mixed = rng.random() < 0.15
    pairs = [_PAIRS[int(rng.integers(len(_PAIRS)))] for _ in range(1 + int(rng.random() < 0.4))]
    points = []
    for number in range(1, int(rng.integers(3, 8))):
        row = random_row(rng, "N U T|F U T|N D T|F U B|N U B" if mixed else letters)
        in_joints = bool(rng.random() < 0.35)
        points.append(Point(number, row, in_joints, pairs[int(rng.integers(len(pairs)))]))
    writer = _Writer(rng, points, pairs[0])
    writer.block(0)
    writer.block(0)
    writer.motion()
    left = writer.left
    if rng.random() < 0.15:
        left.add(points[-1].name)
    tracking = ["", "LINE_TRACK;", "  LINE_TRACK_SCHEDULE_NUMBER      : 0;"]
    tracking += ["  CONTINUE_TRACK_AT_PROG_END      : TRUE;"]
    singular = ["AUTO_SINGULARITY_HEADER;", "  ENABLE_SINGULARITY_AVOIDANCE   : FALSE;"]
    return Listing(
        points,
        writer.body,
        application=[*(tracking if rng.random() < 0.3 else []), *(singular if rng.random() < 0.3 else [])],
        end="\r\n" if rng.random() < 0.3 else "\n",
        start=pairs[0],
        left=frozenset(left),
        calls=frozenset(writer.calls),
    )


@dataclass(frozen=True)
class Form:
    """What has to be refused: `lines` of a `part`. {p} is the number of a pose, {own_user} and {own_tool} are
    its frames, {user} and {tool} others."""

    name: str
    lines: tuple[str, ...]
    part: str = "body"
    runs: bool = False  # the interpreter can run it: it makes poses wrong where the rewriter does not see it


def _moves(name: str, option: str, runs: bool = False) -> Form:
    return Form(name, (f"L P[{{p}}] 100mm/sec FINE {option}",), runs=runs)


def _joints(group: int, *, five: str = "20.0 deg", six: str = ",\tJ6= 3.0 deg") -> tuple[str, ...]:
    return (
        f"   GP{group}:",
        "\tUF : 0, UT : 0,",
        "\tJ1= 1.0 deg,\tJ2= 2.0 deg,\tJ3= 3.0 deg,",
        f"\tJ4= 1.0 deg,\tJ5= {five}{six}",
    )


def _pose(user: str = "0", config: str = "\t\tCONFIG : 'N U T, 0, 0, 0',", more: str = "") -> tuple[str, ...]:
    return (
        "   GP1:",
        f"\tUF : {user}, UT : 0,{config}",
        "\tX = 400.0 mm,\tY = 0.0 mm,\tZ = 300.0 mm,",
        f"\tW = 180.0 deg,\tP = 0.0 deg,\tR = 0.0 deg{more}",
    )


def _block(name: str, *groups: tuple[str, ...], end: tuple[str, ...] = ("}};",)) -> Form:
    return Form(name, ("P[90]{{", *(line for group in groups for line in group), *end), "blocks")


FORMS = (
    Form("a user frame by register", ("UFRAME[R[1]]=PR[5]",)),
    Form("a user frame", ("UFRAME[{own_user}]=PR[6]", "J P[{p}] 100% FINE"), runs=True),
    Form("a tool frame", ("UTOOL[{own_tool}]=PR[5]", "J P[{p}] 100% FINE"), runs=True),
    Form("a tool frame by argument", ("UTOOL[AR[1]]=PR[5]",)),
    Form("another user frame", ("UFRAME_NUM={user}", "J P[{p}] 100% FINE"), runs=True),
    Form("another tool frame", ("UTOOL_NUM={tool}", "L P[{p}] 10mm/sec CNT5"), runs=True),
    Form("a user frame in a branch", ("IF (DI[1]) THEN", "UFRAME_NUM={user}", "ENDIF", "J P[{p}] 100% FINE")),
    Form("a tool frame in a loop", ("LBL[900]", "J P[{p}] 100% FINE", "UTOOL_NUM={tool}", "JMP LBL[900]")),
    Form("a user frame's number by register", ("UFRAME_NUM=R[1]",)),
    Form("a tool frame's number by argument", ("UTOOL_NUM=AR[1]",)),
    Form("an offset for all", ("OFFSET CONDITION PR[5]",)),
    Form("an offset for all in a frame", ("OFFSET CONDITION PR[5],UFRAME[1]",)),
    Form("a tool offset for all", ("TOOL_OFFSET CONDITION PR[5]",)),
    Form("a vision offset for all", ("VOFFSET CONDITION VR[1]",)),
    _moves("an offset", "JointOffset,PR[5]", runs=True),
    _moves("an offset of the condition", "JointOffset"),
    _moves("a tool offset", "Tool_Offset,PR[5]", runs=True),
    _moves("a tool offset of the condition", "Tool_Offset"),
    _moves("a vision offset", "VOFFSET,VR[1]"),
    _moves("a relative motion", "INC", runs=True),
    _moves("a wrist by joints", "Wjnt"),
    _moves("coordinated motion", "COORD"),
    _moves("a remote tool", "RTCP"),
    _moves("the rotation of the hand", "MROT"),
    _moves("a taught reference of tracking", "TA_REF PR[5]"),
    _moves("the begin of a weld", "Arc Start[1]"),
    _moves("a search", "Search[X]"),
    _moves("a position on the way", "Skip,LBL[900],PR[5]=LPOS"),
    _moves("a routine before the end", "TB .10sec,CALL FOREIGN"),
    Form("a position from a register", ("P[{p}]=PR[5]", "J P[{p}] 100% FINE"), runs=True),
    Form("a position from where the arm is", ("P[{p}]=LPOS",)),
    Form("a position by register", ("P[R[1]]=PR[5]",)),
    Form("an element of a position", ("P[{p},3]=100",)),
    Form("a register from a position", ("PR[5]=P[{p}]", "J PR[5] 100% FINE")),
    Form("a register from where the arm is", ("PR[5]=LPOS",)),
    Form("a register from a frame", ("PR[5]=UFRAME[1]",)),
    Form("an element of a register", ("PR[5,3]=PR[5,3]+10",)),
    Form("reading an element", ("R[1]=PR[5,1]",)),
    Form("a question to an element", ("IF (PR[5,3]>100),JMP LBL[900]",)),
    Form("a motion to a register", ("J PR[3] 100% FINE",), runs=True),
    Form("a motion to a register by register", ("L PR[R[1]] 100mm/sec FINE",)),
    Form("a motion to a position by register", ("J P[R[1]] 100% FINE",)),
    Form("a circle by a register", ("C P[{p}]\nPR[5] 100mm/sec FINE",)),
    Form("a position that is not there", ("J P[98] 100% FINE",)),
    Form("another program", ("CALL FOREIGN", "J P[{p}] 100% FINE"), runs=True),
    Form("another program with arguments", ("CALL FOREIGN(1,2)",)),
    Form("another task", ("RUN FOREIGN",)),
    Form("a program by name", ("CALL SR[1]",)),
    Form("another program in a branch", ("IF DI[1]=ON,CALL FOREIGN",)),
    Form("another program in a selection", ("SELECT R[1]=1,CALL FOREIGN",)),
    Form("a register as an argument", (f"CALL {HARMLESS}(PR[5])",)),
    Form("a macro", ("Foreign tool", "J P[{p}] 100% FINE"), runs=True),
    Form("a macro with arguments", ("Foreign(1,2)",)),
    Form("a condition monitor", ("MONITOR WATCH",)),
    Form("a condition", ("WHEN DI[1]=ON,CALL FOREIGN",)),
    Form("a program for errors", ("ERROR_PROG=FOREIGN",)),
    Form("a program for resuming", ("RESUME_PROG[1]=FOREIGN",)),
    Form("a conveyor", ("LINE[1] ON",)),
    Form("the end of tracking", ("STOP_TRACKING",)),
    Form("seam tracking", ("Track TAST[1]",)),
    Form("weaving", ("Weave Sine[1]",)),
    Form("a vision offset by the camera", ("VISION GET_OFFSET 'PART' VR[1] JMP LBL[900]",)),
    Form("soft axes", ("SOFTFLOAT[1]",)),
    Form("a sensor", ("SENSOR_ON 1",)),
    Form("a frame number as a variable", ("$MNUFRAMENUM[1]=2",)),
    Form("a tool as a variable", ("$MNUTOOL[1,1]=PR[5]",)),
    Form("the active frame as a variable", ("$GROUP[1].$UFRAME=PR[5]",)),
    Form("the check of frames", ("$FRM_CHKTYP=(-1)",)),
    Form("limits of joints", ("$PARAM_GROUP[1].$UPPERLIMS[1]=90",)),
    Form("equalization of a gun", ("BACKUP=5",)),
    Form("two statements in a line", ("\0   9:  DO[1]=ON ;  J PR[5] 100% FINE ;",)),
    Form("a statement behind a remark", ("\0   9:  !part ;  J PR[5] 100% FINE ;",)),
    Form("a statement without an end", ("\0   9:J P[{p}] 100% FINE",)),
    Form("a remark without an end", ("\0   9:  !part", "\0    :  J PR[5] 100% FINE ;")),
    Form("a line that is no statement", ("\0J P[{p}] 100% FINE ;",)),
    Form("half a statement", ("J P[{p}] 100%",)),
    Form("unbalanced brackets", ("R[1]=((R[2]+1)",)),
    Form(
        "a program that tracks",
        ("LINE_TRACK;", "  LINE_TRACK_SCHEDULE_NUMBER      : 1;"),
        "application",
        runs=True,
    ),
    Form(
        "avoidance of singularities",
        ("AUTO_SINGULARITY_HEADER;", "  ENABLE_SINGULARITY_AVOIDANCE   : TRUE;"),
        "application",
    ),
    Form("an application that is not known", ("CONVEYOR : 1;",), "application"),
    Form("another group", ("DEFAULT_GROUP\t= *,1,*,*,*;",), "attributes"),
    Form("an attribute that is not known", ("TRACKING\t= ON;",), "attributes"),
    Form("a program of conditions", ("/PROG  JOB\t  Cond",), "heading"),
    _block("another arm", _joints(1), _joints(2)),
    _block("a position of another arm only", _joints(2)),
    _block("a position twice", _joints(1), end=("}};", "P[90]{{", *_joints(1), "}};")),
    _block("a group twice", _joints(1), _joints(1)),
    _block("a position that is not taught", _joints(1, five="******** deg")),
    _block("a number beyond all", _joints(1, five="9" * 400 + " deg")),
    _block("a number with an exponent", _joints(1, five="1e400 deg")),
    _block("joints in millimetres", _joints(1, five="20.0 mm")),
    _block("five joints", _joints(1, six="")),
    _block("a value twice", _joints(1, six=",\tJ5= 3.0 deg")),
    _block("half a position", _joints(1)[:3], end=()),
    _block("any frame", _pose(user="F")),
    _block("no configuration", _pose(config="")),
    _block("an external axis", _pose(more=",\n\tE1= 100.0 mm")),
)


def with_form(listing: Listing, form: Form, rng: np.random.Generator) -> Listing:
    """The listing with a form in it; it has a pose that is not left."""
    poses = [point for point in listing.points if not point.in_joints and point.name not in listing.left]
    pose = poses[int(rng.integers(len(poses)))]
    values = {
        "p": pose.number,
        "own_user": pose.pair[0],
        "own_tool": pose.pair[1],
        "user": 4,
        "tool": 3 if pose.pair[1] == 1 else 1,
    }
    lines = [line.format(**values) for line in form.lines]
    if form.part == "heading":
        return replace(listing, heading=lines[0], form=form.name)
    if form.part == "body":
        place = int(rng.integers(len(listing.body) + 1))
        label = ["LBL[900]"] if any("LBL[900]" in line for line in lines) and "LBL[900]" not in lines else []
        return replace(
            listing, body=[*listing.body[:place], *lines, *listing.body[place:], *label], form=form.name
        )
    return replace(listing, **{form.part: [*getattr(listing, form.part), *lines]}, form=form.name)  # type: ignore[arg-type]


def rounding(row: Matrix, in_joints: bool, tool: Matrix) -> tuple[float, float]:
    """By how much, mm and degrees, the flange may be elsewhere because a listing has three decimals.

    Of joints each is 0.0005 degrees off, and joint 3 by that of joint 2 too; of a pose each coordinate, and
    each angle about the tool's point.
    """
    half = 0.0005
    if in_joints:
        frames = nominal().frames(row)[:, 0]
        levers = np.linalg.norm(frames[:6, :3, 3] - frames[6, :3, 3], axis=1)
        return float(np.radians(half) * (levers.sum() + levers[2])), 7 * half
    return float(half * np.sqrt(3) + np.radians(3 * half) * np.linalg.norm(tool[:3, 3])), 3 * half


def apart(meant: Matrix, reached: Matrix) -> tuple[float, float]:
    """mm and degrees between two poses."""
    turn = Rotation.from_matrix(meant[:3, :3] @ reached[:3, :3].T).magnitude()
    return float(np.linalg.norm(meant[:3, 3] - reached[:3, 3])), float(np.degrees(turn))
