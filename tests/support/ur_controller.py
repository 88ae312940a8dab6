"""A controller that runs URScript: what the joints of a UR5e are commanded to.

Tokens, arithmetic and inverse kinematics (closed form of the nominal arm) of its own. Radians; poses are
(4, 4) in millimetres.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from controller_arm import ControllerArm, on_line
from operators import ORDER, SUMS, Operators, operated
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

_D1, _A2, _A3, _D4, _D5, _D6 = 162.5, -425.0, -392.2, 133.3, 99.7, 99.6
_MOST_STATEMENTS, _MOST_MOTIONS, _STEPS = 300, 30, 16
_TOKEN = re.compile(
    r"""\s*("[^"]*"|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|p(?=\[)|[A-Za-z_]\w*|==|!=|<=|>=|[-+*/%=<>(),\[\]:])"""
)
_LEVELS: tuple[Operators, ...] = (
    {"or": lambda a, b: a or b, "xor": lambda a, b: bool(a) != bool(b)},
    {"and": lambda a, b: a and b},
    {"==": operator.eq, "!=": operator.ne, **ORDER},
    SUMS,
    {"*": operator.mul, "/": operator.truediv, "%": operator.mod},
)
_READS = ("get_standard_digital_in", "get_digital_in", "get_flag", "read_input_boolean_register")


class NoProgram(Exception):
    """The controller does not run this."""


class _Alarm(Exception):
    pass


class _Leaves(Exception):
    def __init__(self, how: str, value: Any = None) -> None:
        self.how, self.value = how, value


def pose_of(values: Sequence[float]) -> Matrix:
    """(4, 4) of metres and a rotation vector."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(list(values[3:])).as_matrix()
    pose[:3, 3] = 1000 * np.array(values[:3])
    return pose


def values_of(pose: Matrix) -> Matrix:
    return np.concatenate([pose[:3, 3] / 1000, Rotation.from_matrix(pose[:3, :3]).as_rotvec()])


def _link(theta: float, d: float, a: float, alpha: float) -> Matrix:
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    return np.array([[c, -s * ca, s * sa, a * c], [s, c * ca, -c * sa, a * s], [0, sa, ca, d], [0, 0, 0, 1]])


def inverse(flange: Matrix) -> Matrix:
    """(M, 6) radians: the solutions of a pose of the flange, up to eight."""
    found = []
    centre = flange[:3, 3] - _D6 * flange[:3, 2]
    radius = np.hypot(centre[0], centre[1])
    if radius <= _D4:
        return np.empty((0, 6))
    for shoulder in (1, -1):
        one = np.arctan2(centre[1], centre[0]) + shoulder * np.arccos(_D4 / radius) + np.pi / 2
        s1, c1 = np.sin(one), np.cos(one)
        cosine = (flange[0, 3] * s1 - flange[1, 3] * c1 - _D4) / _D6
        for wrist in (1, -1) if abs(cosine) <= 1 else ():
            five = wrist * np.arccos(cosine)
            s5 = np.sin(five)
            six = np.arctan2(
                (-flange[0, 1] * s1 + flange[1, 1] * c1) / s5, (flange[0, 0] * s1 - flange[1, 0] * c1) / s5
            )
            end = _link(five, _D5, 0, -np.pi / 2) @ _link(six, _D6, 0, 0)
            middle = np.linalg.inv(_link(one, _D1, 0, np.pi / 2)) @ flange @ np.linalg.inv(end)
            x, y = middle[:2, 3]
            cosine3 = (x * x + y * y - _A2**2 - _A3**2) / (2 * _A2 * _A3)
            for elbow in (1, -1) if abs(cosine3) <= 1 else ():
                three = elbow * np.arccos(cosine3)
                two = np.arctan2(y, x) - np.arctan2(_A3 * np.sin(three), _A2 + _A3 * np.cos(three))
                four = np.arctan2(middle[1, 0], middle[0, 0]) - two - three
                found.append([one, two, three, four, five, six])
    return np.array(found).reshape(-1, 6)


def nearest(flange: Matrix, near: Matrix) -> Matrix:
    """The solution nearest to joints (6,), whole turns included."""
    rows = inverse(flange)
    if not len(rows):
        raise _Alarm("out of reach")
    rows = rows + 2 * np.pi * np.round((near - rows) / (2 * np.pi))
    return np.asarray(rows[np.argmin(np.linalg.norm(rows - near, axis=1))])


@dataclass
class _Block:
    head: str
    place: int
    body: list[Any] = field(default_factory=list)


def blocks_of(text: str) -> list[Any]:
    """Statements, and blocks of them; comments are gone."""
    stack, joined = [_Block("", 0)], ""
    for line in text.splitlines():
        bare = re.sub(r'("[^"]*")|#.*', lambda found: found[1] or "", line)
        joined = f"{joined} {bare}".strip()
        outside = re.sub(r'"[^"]*"', "", joined)
        if sum(map(outside.count, "([")) > sum(map(outside.count, ")]")) or not joined:
            continue
        word = re.match(r"\w*", joined)[0]
        if word == "end" and joined == "end":
            if len(stack) == 1:
                raise NoProgram("end")
            stack.pop()
        elif word in ("def", "thread", "if", "while"):
            if not joined.endswith(":"):
                raise NoProgram(joined)
            block = _Block(joined, 0)
            stack[-1].body.append(block)
            stack.append(block)
        else:
            stack[-1].body.append(joined)
        joined = ""
    if joined or len(stack) > 1:
        raise NoProgram("the end")
    return stack[0].body


@dataclass
class UrController:
    """The nominal `arm`, the `tcp` (4, 4) before a program, and `routines` of other files."""

    arm: ControllerArm
    tcp: Matrix
    routines: dict[str, Callable[[UrRun], None]] = field(default_factory=dict)

    def run(self, text: str, start: Matrix, rng: np.random.Generator) -> list[Matrix]:
        """The joints (6,) degrees at the end of each motion."""
        run = UrRun(self, np.radians(start), rng)
        with suppress(_Alarm, _Leaves):
            run.program(blocks_of(text))
        return [np.degrees(row) for row in run.visits]


class UrRun:
    def __init__(self, controller: UrController, start: Matrix, rng: np.random.Generator) -> None:
        self.controller, self.joints, self.rng, self.tcp = controller, start, rng, controller.tcp
        self.visits: list[Matrix] = []
        self.names: dict[str, Any] = {}
        self.defined: dict[str, _Block] = {}
        self.steps = 0

    def program(self, body: list[Any]) -> None:
        self.block(body)
        if not any(isinstance(each, str) for each in body) and body:
            self.call_defined(next(reversed(self.defined.values())), [])

    def block(self, body: list[Any]) -> None:
        for each in body:
            self.steps += 1
            if self.steps > _MOST_STATEMENTS or len(self.visits) >= _MOST_MOTIONS:
                raise _Leaves("halt")
            if isinstance(each, str):
                self.statement(each)
            else:
                self.opened(each)

    def opened(self, block: _Block) -> None:
        word, rest = block.head.split(None, 1)
        if word in ("def", "thread"):
            self.defined[re.match(r"\w+", rest)[0]] = block
        elif word == "while":
            while self.value(rest[:-1]):
                self.steps += 1
                if self.steps > _MOST_STATEMENTS:
                    raise _Leaves("halt")
                try:
                    self.block(block.body)
                except _Leaves as leaves:
                    if leaves.how == "break":
                        break
                    if leaves.how != "continue":
                        raise
        else:
            parts: list[tuple[str, list[Any]]] = [(rest[:-1], [])]
            for each in block.body:
                if isinstance(each, str) and re.match(r"(?:elif\b.*|else\s*):$", each):
                    parts.append((each[4:-1] if each.startswith("elif") else "True", []))
                else:
                    parts[-1][1].append(each)
            for condition, body in parts:
                if self.value(condition):
                    self.block(body)
                    return

    def call_defined(self, block: _Block, values: list[Any]) -> Any:
        names = re.findall(r"\w+", block.head.split("(", 1)[1])
        kept = dict(self.names)
        self.names.update(zip(names, values, strict=False))
        result: Any = None
        try:
            self.block(block.body)
        except _Leaves as leaves:
            if leaves.how != "return":
                raise
            result = leaves.value
        for name in names:
            self.names.pop(name, None)
            if name in kept:
                self.names[name] = kept[name]
        return result

    def statement(self, text: str) -> None:
        word = re.match(r"[$\w]*", text)[0]
        if word == "$" or word in ("kill", "join", "enter_critical", "exit_critical", "run"):
            return
        if word in ("break", "continue", "halt"):
            raise _Leaves(word)
        if word == "return":
            raise _Leaves("return", self.value(text[6:]) if text[6:].strip() else None)
        assigned = re.match(r"(?:global\s+|local\s+)?(\w+)((?:\[[^\]]*\])*)\s*=(?!=)(.*)$", text)
        if assigned is None:
            self.value(text)
        elif assigned[2]:
            held = self.names[assigned[1]]
            held[int(self.value(assigned[2][1:-1]))] = self.value(assigned[3])
        elif re.match(r"\s*run\b", assigned[3]) is None:
            self.names[assigned[1]] = self.value(assigned[3])

    # Expressions

    def value(self, text: str) -> Any:
        tokens, place = [], 0
        while text[place:].strip():
            found = _TOKEN.match(text, place)
            if found is None:
                raise NoProgram(text)
            tokens.append(found[1])
            place = found.end()
        value = self.operation(tokens)
        if tokens:
            raise NoProgram(text)
        return value

    def operation(self, tokens: list[str]) -> Any:
        return operated(tokens, _LEVELS, lambda: self.operand(tokens))

    def operand(self, tokens: list[str]) -> Any:
        if not tokens:
            raise NoProgram("an expression ends")
        token = tokens.pop(0)
        if token in ("-", "+", "not"):
            value = self.operand(tokens)
            return -value if token == "-" else value if token == "+" else not value
        if token == "(":
            value = self.operation(tokens)
            self.expect(tokens, ")")
        elif token == "p":
            self.expect(tokens, "[")
            value = pose_of(self.listed(tokens, "]")[0])
        elif token == "[":
            value = self.listed(tokens, "]")[0]
        elif token[0] == '"':
            value = token[1:-1]
        elif token[0].isdigit() or token[0] == ".":
            value = float(token)
        elif token in ("True", "False"):
            value = token == "True"
        elif tokens and tokens[0] == "(":
            tokens.pop(0)
            value = self.called(token, *self.listed(tokens, ")"))
        elif token in self.names:
            value = self.names[token]
        else:
            raise NoProgram(token)
        while tokens and tokens[0] == "[":
            tokens.pop(0)
            index = int(self.operation(tokens))
            value = value[index] if isinstance(value, list) else values_of(value)[index]
            self.expect(tokens, "]")
        return value

    def expect(self, tokens: list[str], token: str) -> None:
        if not tokens or tokens.pop(0) != token:
            raise NoProgram(token)

    def listed(self, tokens: list[str], end: str) -> tuple[list[Any], dict[str, Any]]:
        values: list[Any] = []
        named: dict[str, Any] = {}
        while tokens and tokens[0] != end:
            if len(tokens) > 1 and tokens[1] == "=":
                name = tokens.pop(0)
                tokens.pop(0)
                named[name] = self.operation(tokens)
            else:
                values.append(self.operation(tokens))
            if tokens and tokens[0] == ",":
                tokens.pop(0)
        self.expect(tokens, end)
        return values, named

    def called(self, name: str, values: list[Any], named: dict[str, Any]) -> Any:
        if name in self.defined:
            return self.call_defined(self.defined[name], values)
        if name in self.controller.routines:
            self.controller.routines[name](self)
            return 0.0
        if name in ("movej", "movel", "movep", "servoj", "movec"):
            for target in values[: 2 if name == "movec" else 1]:
                self.go(name, target)
            return None
        if name == "set_tcp":
            self.tcp = values[0]
        elif name == "get_inverse_kin":
            near = named.get("qnear", values[1] if len(values) > 1 else list(self.joints))
            tcp = named.get("tcp", values[4] if len(values) > 4 else self.tcp)
            return list(nearest(values[0] @ np.linalg.inv(tcp), np.array(near)))
        elif name == "get_forward_kin":
            return self.controller.arm.fk(np.degrees(values[0] if values else self.joints), "deg") @ self.tcp
        elif name == "get_actual_tcp_pose":
            return self.controller.arm.fk(np.degrees(self.joints), "deg") @ self.tcp
        elif name == "get_actual_joint_positions":
            return list(self.joints)
        elif name == "pose_trans":
            return values[0] @ values[1]
        elif name == "pose_add":
            return pose_of(values_of(values[0]) + np.array([*values_of(values[1])[:3], 0, 0, 0]))
        elif name == "d2r":
            return np.radians(values[0])
        elif name == "random":
            return float(self.rng.random())
        elif name in _READS:
            return bool(self.rng.random() < 0.5)
        elif name == "sqrt":
            return float(np.sqrt(values[0]))
        elif re.match(r"sleep|sync|textmsg|popup|set_|write_|modbus|socket", name) is None:
            raise NoProgram(name)
        return 0.0

    def go(self, word: str, target: Any) -> None:
        arm, flange = self.controller.arm, None
        if isinstance(target, np.ndarray):
            flange = target @ np.linalg.inv(self.tcp)
        elif len(target) != 6:
            raise NoProgram("joints")
        elif word in ("movel", "movep"):
            flange = arm.fk(np.degrees(target), "deg")
        if flange is None:
            self.joints = np.array(target)
        elif word in ("movej", "servoj"):
            self.joints = nearest(flange, self.joints)
        else:
            begin = arm.fk(np.degrees(self.joints), "deg")
            for share in np.linspace(0, 1, _STEPS + 1)[1:]:
                self.joints = nearest(on_line(begin, flange, share), self.joints)
        self.visits.append(self.joints)
