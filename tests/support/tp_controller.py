"""A controller that runs TP listings: what the joints of a LR Mate 200iD are commanded to.

It reads listings by tokens of its own, and knows nothing of the code that is tested. Degrees and millimetres;
joint 3 counts from link 2 inside and from the ground in listings.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from controller_arm import ControllerArm
from operators import ORDER, SUMS, Operators, operated
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

_MOST_STATEMENTS, _MOST_MOTIONS = 300, 40
_TOKEN = re.compile(
    r"""\s*(?P<token>'[^'\n]*' | \d+\.?\d* | \.\d+ | \$[\w.$]+ | <> | <= | >= | [-+*/=<>!(),%] | \w+
        | \[(?:[^\[\]]|\[[^\]]*\])*\])""",
    re.VERBOSE,
)
_LEVELS: tuple[Operators, ...] = (
    {"OR": lambda a, b: bool(a) or bool(b)},
    {"AND": lambda a, b: bool(a) and bool(b)},
    {"=": operator.eq, "<>": operator.ne, **ORDER},
    SUMS,
    {
        "*": operator.mul,
        "/": lambda a, b: a / b if b else 0.0,
        "DIV": lambda a, b: a // b if b else 0.0,
        "MOD": lambda a, b: a % b if b else 0.0,
    },
)


class NoProgram(Exception):
    """The controller does not load this listing, or has not this instruction."""


class _Alarm(Exception):
    """The controller stops with an alarm."""


class _Finished(Exception):
    pass


class Visit(NamedTuple):
    """The end of a motion: to which position, the commanded joints (6,), and whether the listing states
    joints."""

    name: str
    joints: Matrix
    in_joints: bool


class Position(NamedTuple):
    """Of a listing: `values` are joints, or X, Y, Z, W, P, R."""

    in_joints: bool
    values: Matrix
    user: int
    tool: int
    config: str


def frame(x: float, y: float, z: float, w: float, p: float, r: float) -> Matrix:
    """(4, 4) of mm and degrees, about fixed x, y, z."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("xyz", [w, p, r], degrees=True).as_matrix()
    pose[:3, 3] = x, y, z
    return pose


def values_of(pose: Matrix) -> Matrix:
    """The same backwards."""
    return np.concatenate([pose[:3, 3], Rotation.from_matrix(pose[:3, :3]).as_euler("xyz", degrees=True)])


def configuration(row: Matrix) -> str:
    """CONFIG of joints: N where J5 is negative, U and T by the side view of the data sheet, and the turns."""
    letters, _ = clear_letters(row)
    turns = ", ".join(str(int(np.floor((row[k] + 180) / 360))) for k in (0, 3, 5))
    return f"{letters}, {turns}"


def clear_letters(row: Matrix) -> tuple[str, float]:
    """The letters, and how far, mm or deg, the posture is from another one."""
    q2, q3 = np.radians(row[1]), np.radians(row[2] - row[1])
    elbow = np.array([330 * np.sin(q2), 330 * np.cos(q2)])
    fore = np.array([335 * np.cos(q3) - 35 * np.sin(q3), 335 * np.sin(q3) + 35 * np.cos(q3)])
    up = (elbow[1] * fore[0] - elbow[0] * fore[1]) / 330
    ahead = 50 + elbow[0] + fore[0]
    letters = f"{'N' if row[4] < 0 else 'F'} {'U' if up > 0 else 'D'} {'T' if ahead > 0 else 'B'}"
    return letters, min(abs(up), abs(ahead), abs(float(row[4])))


@dataclass
class TpController:
    """`user` and `tools` are the frames by number, `registers` the position registers (4, 4), `taught` those
    that hold joints, `meant` joints near which the positions of a listing are, `routines` what
    other programs do to a run.

    `checks_frames`: a pose in another frame than the active one stops the program ($FRM_CHKTYP); else it is
    taken to be in the active one.
    """

    arm: ControllerArm
    user: dict[int, Matrix]
    tools: dict[int, Matrix]
    registers: dict[int, Matrix]
    meant: dict[str, Matrix]
    taught: dict[str, Matrix] = field(default_factory=dict)
    routines: dict[str, Callable[[TpRun], None]] = field(default_factory=dict)
    checks_frames: bool = True
    active_user: int = 1
    active_tool: int = 1
    solved: dict[bytes, Matrix | None] = field(default_factory=dict)

    def run(self, listing: str, start: Matrix, rng: np.random.Generator) -> list[Visit]:
        """The motions of a run with random inputs, up to an alarm, the end, or many motions."""
        run = TpRun(self, listing, start, rng)
        with suppress(_Alarm, _Finished):
            run.go()
        return run.visits


def _sections(listing: str) -> dict[str, list[str]]:
    parts: dict[str, list[str]] = {}
    current = ""
    for line in listing.replace("\r\n", "\n").split("\n"):
        if line.startswith("/"):
            current = line.split()[0]
            parts.setdefault(current, [])
        elif line.strip() and not current:
            raise NoProgram(line)
        elif current:
            parts[current].append(line)
    if list(parts)[:1] != ["/PROG"] or list(parts)[-3:] != ["/MN", "/POS", "/END"]:
        raise NoProgram("the parts of the listing")
    return parts


def _statements(lines: list[str]) -> list[str]:
    """Of /MN, with continued lines joined; remarks are empty."""
    found: list[str] = []
    open_one = ""
    for line in lines:
        if not line.strip():
            continue
        number, colon, rest = line.partition(":")
        if not colon or (number.strip() and not number.strip().isdigit()) or (open_one and number.strip()):
            raise NoProgram(line)
        open_one += " " + rest
        if open_one.rstrip().endswith(";"):
            body = open_one.rstrip()[:-1].strip()
            found.append("" if body.startswith(("!", "//", "--")) else body)
            open_one = ""
    if open_one:
        raise NoProgram(open_one)
    return found


def _positions(lines: list[str]) -> dict[str, Position]:
    text, found = "\n".join(lines), {}
    for block in re.finditer(r"P\[(\d+)[^\]]*\]\{(.*?)\};", text, re.DOTALL):
        arm = re.split(r"GP[2-9]:", block[2])[0]
        frames = re.search(r"UF : (\w+), UT : (\w+)", arm)
        values = dict(re.findall(r"\b([XYZWPR]|[JE]\d) ?= *(-?[\d.]+|\*+) +(?:mm|deg)", arm))
        if frames is None or "*" in "".join(values.values()):
            raise NoProgram(block[0])
        keys = [f"J{k}" for k in range(1, 7)] if "J1" in values else list("XYZWPR")
        if not set(keys) <= set(values):
            raise NoProgram(block[0])
        config = re.search(r"CONFIG : '(.*?)'", arm)
        numbers = np.array([float(values[key]) for key in keys])
        if "J1" in values:
            numbers[2] += numbers[1]
        numbers_of = [-1 if number == "F" else int(number) for number in frames.groups()]
        found[f"P[{block[1]}]"] = Position(
            "J1" in values, numbers, *numbers_of, "" if config is None else config[1]
        )
    return found


class TpRun:
    def __init__(
        self, controller: TpController, listing: str, start: Matrix, rng: np.random.Generator
    ) -> None:
        parts = _sections(listing)
        self.controller, self.joints, self.rng = controller, start, rng
        self.statements, self.positions = _statements(parts["/MN"]), _positions(parts["/POS"])
        self.user, self.tool = controller.active_user, controller.active_tool
        self.user_frames, self.tool_frames = dict(controller.user), dict(controller.tools)
        self.registers = {key: value.copy() for key, value in controller.registers.items()}
        self.numbers: dict[str, float] = {}
        self.offset = self.tool_offset = 0
        self.tracked = bool(re.search(r"SCHEDULE_NUMBER\s*: [1-9]", "\n".join(parts.get("/APPL", []))))
        self.visits: list[Visit] = []
        self.loops: list[tuple[int, str, float]] = []
        self.selected: float | None = None
        self.place = 0

    def go(self) -> None:
        for _ in range(_MOST_STATEMENTS):
            if self.place >= len(self.statements) or len(self.visits) >= _MOST_MOTIONS:
                return
            body = self.statements[self.place]
            self.place += 1
            self._statement(body)

    def _label(self, number: str) -> None:
        for place, body in enumerate(self.statements):
            if re.match(rf"LBL\[{number}(:[^\]]*)?\]$", body):
                self.place = place + 1
                return
        raise _Alarm(f"no LBL[{number}]")

    def _statement(self, body: str) -> None:
        word = re.match(r"[A-Z_a-z]*", body)[0]
        if not body or word in (
            "LBL",
            "MESSAGE",
            "UALM",
            "PAYLOAD",
            "COL",
            "LOCK",
            "UNLOCK",
            "OVERRIDE",
            "PAUSE",
        ):
            return
        if word in ("JOINT_MAX_SPEED", "LINEAR_MAX_SPEED", "TIMER", "SKIP") or body.startswith("$"):
            return
        if re.match(r"[JLCAS]\s+P", body):
            self._motion(body)
        elif word in ("UFRAME_NUM", "UTOOL_NUM"):
            number = int(self._value(body.split("=", 1)[1]))
            self.user, self.tool = (number, self.tool) if word == "UFRAME_NUM" else (self.user, number)
        elif word in ("UFRAME", "UTOOL"):
            index, value = re.fullmatch(r"\w+\[(.*?)\]=PR\[(\d+)\]", body).groups()
            frames = self.user_frames if word == "UFRAME" else self.tool_frames
            frames[int(self._value(index))] = self.registers[int(value)]
        elif word in ("OFFSET", "TOOL_OFFSET"):
            number = int(re.search(r"PR\[(\d+)\]", body)[1])
            self.offset, self.tool_offset = (
                (number, self.tool_offset) if word == "OFFSET" else (self.offset, number)
            )
        elif word in ("PR", "P"):
            self._position_assignment(body)
        elif word == "WAIT":
            timeout = re.search(r"TIMEOUT,LBL\[(\d+)", body)
            if timeout is not None and self.rng.random() < 0.3:
                self._label(timeout[1])
        elif word in ("IF", "ELSE", "ENDIF", "FOR", "ENDFOR", "SELECT") or body.startswith("="):
            self._flow(word, body)
        else:
            self._action(body)

    def _action(self, body: str) -> None:
        call = re.fullmatch(r"(?:CALL|RUN)\s+([\w-]+)(\(.*\))?", body)
        jump = re.fullmatch(r"JMP\s+LBL\[(.*?)\]", body)
        register = re.fullmatch(r"R\[(\d+|R\[\d+\])(?::[^\]]*)?\]=(.*)", body)
        if jump is not None:
            self._label(str(int(self._value(jump[1]))))
        elif body in ("END", "ABORT"):
            raise _Finished
        elif call is not None or body in self.controller.routines:
            name = body if call is None else call[1]
            if name not in self.controller.routines:
                raise NoProgram(name)
            self.controller.routines[name](self)
        elif register is not None:
            self.numbers[str(int(self._value(register[1])))] = self._value(register[2])
        elif re.match(r"(?:[DRGAW]O|F|M)\[", body) is None and body != "PAUSE":
            raise NoProgram(body)

    def _flow(self, word: str, body: str) -> None:
        if word == "IF" and body.endswith("THEN"):
            if not self._value(body[2:-4]):
                self._skip(("ELSE", "ENDIF"), "IF")
        elif word == "IF":
            condition, action = re.fullmatch(
                r"IF\s+(.*?),\s*((?:JMP|CALL|[A-Z]+\[|PAUSE|END|ABORT).*)", body
            ).groups()
            if self._value(condition):
                self._action(action)
        elif word == "ELSE" and "," in body:
            if self.selected is not None:
                self._action(body.split(",", 1)[1].strip())
        elif word == "ELSE":
            self._skip(("ENDIF",), "IF")
        elif word == "FOR":
            register, begin, end = re.fullmatch(
                r"FOR\s+R\[(\d+)(?::[^\]]*)?\]=(.*?)\s+TO\s+(.*)", body
            ).groups()
            self.numbers[register] = self._value(begin)
            if self.numbers[register] > self._value(end):
                self._skip(("ENDFOR",), "FOR")
            else:
                self.loops.append((self.place, register, self._value(end)))
        elif word == "ENDFOR":
            begin_at, register, last = self.loops[-1]
            self.numbers[register] += 1
            if self.numbers[register] <= last:
                self.place = begin_at
            else:
                self.loops.pop()
        elif word == "SELECT":
            value, case = re.fullmatch(r"SELECT\s+(R\[[^\]]*\])(=.*)", body).groups()
            self.selected = self._value(value)
            self._case(case)
        elif body.startswith("="):
            self._case(body)

    def _case(self, body: str) -> None:
        value, action = body[1:].split(",", 1)
        if self.selected is not None and self.selected == self._value(value):
            self.selected = None
            self._action(action.strip())

    def _skip(self, ends: tuple[str, ...], begin: str) -> None:
        """Behind the end of this block, or the ELSE in it."""
        depth = 0
        while self.place < len(self.statements):
            body = self.statements[self.place]
            self.place += 1
            if not depth and body in ends:
                return
            depth += body.startswith(begin + " ") and (begin == "FOR" or body.endswith("THEN"))
            depth -= body == "END" + begin
        raise NoProgram(f"no {ends[-1]}")

    def _value(self, text: str) -> float:
        tokens = [match["token"] for match in _TOKEN.finditer(text)]
        if "".join(tokens).replace(" ", "") != text.replace(" ", ""):
            raise NoProgram(text)
        value = self._expression(tokens)
        if tokens:
            raise NoProgram(text)
        return value

    def _expression(self, tokens: list[str]) -> float:
        return float(operated(tokens, _LEVELS, lambda: self._operand(tokens)))

    def _operand(self, tokens: list[str]) -> float:
        if not tokens:
            raise NoProgram("an expression ends")
        token = tokens.pop(0)
        if token in "!-":
            value = self._operand(tokens)
            return float(not value) if token == "!" else -value
        if token == "(":
            value = self._expression(tokens)
            if tokens.pop(0) != ")":
                raise NoProgram("a bracket")
            return value
        if token in ("ON", "OFF"):
            return float(token == "ON")
        if re.fullmatch(r"\d+\.?\d*|\.\d+", token):
            return float(token)
        if token.startswith("$"):
            del tokens[: bool(tokens) and tokens[0].startswith("[")]
            return 1.0
        if not tokens or not tokens[0].startswith("["):
            raise NoProgram(token)
        index = tokens.pop(0)[1:-1].split(":")[0]
        if token == "SQRT":
            return float(np.sqrt(abs(self._value(index))))
        if token == "R":
            return self.numbers.setdefault(str(int(self._value(index))), 0.0)
        if token in ("DI", "RI", "F", "DO", "RO"):
            return float(self.rng.random() < 0.5)
        if token in ("GI", "AI", "AR", "TIMER"):
            return float(self.rng.integers(0, 4))
        raise NoProgram(token)

    def _position_assignment(self, body: str) -> None:
        left, right = body.split("=", 1)
        element = re.fullmatch(r"PR\[(\d+),(\d)\]", left)
        if element is not None:
            values = values_of(self.registers[int(element[1])])
            values[int(element[2]) - 1] = self._value(right)
            self.registers[int(element[1])] = frame(*values)
            return
        kind, number = re.fullmatch(r"(PR?)\[(\d+)\]", left).groups()
        other = re.fullmatch(r"(PR?)\[(\d+)\]", right)
        here = (
            np.linalg.inv(self.user_frames[self.user])
            @ self.controller.arm.fk(self.joints, "deg")
            @ self.tool_frames[self.tool]
        )
        pose = here if right == "LPOS" else self._of_name(other)
        if kind == "PR":
            self.registers[int(number)] = pose
        else:
            old = self.positions[f"P[{number}]"]
            self.positions[f"P[{number}]"] = Position(
                False,
                values_of(pose),
                self.user,
                self.tool,
                old.config or configuration(self.controller.meant[f"P[{number}]"]),
            )

    def _of_name(self, name: Any) -> Matrix:
        if name[1] == "PR":
            return self.registers[int(name[2])]
        position = self.positions[f"P[{name[2]}]"]
        if position.in_joints:
            raise NoProgram("joints as a pose")
        return frame(*position.values)

    def _motion(self, body: str) -> None:
        kind = body[0]
        names = re.findall(r"(?:(?<=\s)|(?<=^))(PR?\[[^\]]*\])(?=\s)", body[1:])
        rest = body[1:]
        for name in names[: 2 if kind == "C" else 1]:
            rest = rest.replace(name, " ", 1)
        form = re.match(
            r"\s*(?:[\d.]+|R\[[^\]]*\])(?:%|mm/sec|cm/min|sec|msec|deg/sec)\s+(?:FINE|CNT\s*(?:\d+|R\[\d+\])|CR\d+mm)(?P<options>.*)$",
            rest,
        )
        if form is None or len(names) < (2 if kind == "C" else 1):
            raise NoProgram(body)
        options = form["options"].strip()
        skip = re.search(r"Skip,LBL\[(\d+)", options)
        before = self.joints
        for name in names[: 2 if kind == "C" else 1]:
            self._go_to(kind, name, options)
        if skip is not None and self.rng.random() < 0.4:
            self.visits.pop()
            self.joints = before + 0.5 * (self.joints - before)
        elif skip is not None:
            self._label(skip[1])

    def _go_to(self, kind: str, name: str, options: str) -> None:
        is_register = name.startswith("PR")
        index = name[name.index("[") + 1 : -1].split(":")[0]
        key = f"{'PR' if is_register else 'P'}[{int(self._value(index))}]"
        if key in self.controller.taught:
            position = Position(True, self.controller.taught[key], 0, 0, "")
        elif is_register:
            meant = self.controller.meant.get(key, self.joints)
            position = Position(
                False, values_of(self.registers[int(key[3:-1])]), self.user, self.tool, configuration(meant)
            )
        elif key not in self.positions:
            raise _Alarm(key)
        else:
            position = self.positions[key]
        if position.in_joints and not options_shift(options):
            self.joints = position.values
        else:
            self.joints = self._solved(kind, key, position, options)
        self.visits.append(Visit(key, self.joints, position.in_joints))

    def _solved(self, kind: str, key: str, position: Position, options: str) -> Matrix:
        user, tool = position.user, position.tool
        if (user, tool) != (self.user, self.tool):
            if self.controller.checks_frames and -1 not in (user, tool):
                raise _Alarm("INTP-253 frame number mismatch")
            user, tool = self.user, self.tool
        pose = frame(*position.values)
        if " INC" in f" {options}":
            here = (
                np.linalg.inv(self.user_frames[user])
                @ self.controller.arm.fk(self.joints, "deg")
                @ self.tool_frames[tool]
            )
            pose = here @ np.eye(4)
            pose[:3, 3] += 0.01 * position.values[:3]
        shift = re.search(r"(?<!_)JointOffset(?:,PR\[(\d+))?", options)
        if shift is not None:
            pose = self.registers[int(shift[1] or self.offset)] @ pose
        in_tool = re.search(r"Tool_Offset(?:,PR\[(\d+))?", options)
        if in_tool is not None:
            pose = pose @ self.registers[int(in_tool[1] or self.tool_offset)]
        if self.tracked:
            pose = frame(3.0 * (len(self.visits) + 1), 0, 0, 0, 0, 0) @ pose
        flange = self.user_frames[user] @ pose @ np.linalg.inv(self.tool_frames[tool])
        near = self.controller.meant.get(key, self.joints)
        at = flange.tobytes() + near.tobytes()
        if at not in self.controller.solved:
            rows = self.controller.arm.climbed(flange, near)
            self.controller.solved[at] = rows[0] if len(rows) else None
        row = self.controller.solved[at]
        if row is None or configuration(row) != re.sub(r"\s*,\s*", ", ", position.config):
            raise _Alarm("the position cannot be reached so")
        if kind != "J" and configuration(row)[:5] != configuration(self.joints)[:5]:
            raise _Alarm("the configuration would change")
        return row


def options_shift(options: str) -> bool:
    """Whether a motion's options shift it."""
    return bool(re.search(r"JointOffset|INC", options))
