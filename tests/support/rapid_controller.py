"""A controller that runs RAPID modules on an arm: frames, tools, displacements, configurations, interrupts.

It computes with nominal kinematics (`ControllerArm`) and commands joints; the flange goes where the true arm
has it. Inputs are random numbers. Nothing here is of the code that is tested.
"""

from __future__ import annotations

import contextlib
import copy
import math
import random
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from controller_arm import ControllerArm
from rapid_syntax import parse

from zerobeam.model.arrays import Matrix

_NUMBERS = {
    "pos": "x y z",
    "orient": "q1 q2 q3 q4",
    "confdata": "cf1 cf4 cf6 cfx",
    "robjoint": "rax_1 rax_2 rax_3 rax_4 rax_5 rax_6",
    "extjoint": "eax_a eax_b eax_c eax_d eax_e eax_f",
    "speeddata": "v_tcp v_ori v_leax v_reax",
}
FIELDS: dict[str, list[tuple[str, str]]] = {
    **{kind: [(name, "num") for name in names.split()] for kind, names in _NUMBERS.items()},
    "pose": [("trans", "pos"), ("rot", "orient")],
    "robtarget": [("trans", "pos"), ("rot", "orient"), ("robconf", "confdata"), ("extax", "extjoint")],
    "jointtarget": [("robax", "robjoint"), ("extax", "extjoint")],
    "tooldata": [("robhold", "bool"), ("tframe", "pose"), ("tload", "loaddata")],
    "wobjdata": [
        *(
            ("robhold", "bool"),
            ("ufprog", "bool"),
            ("ufmec", "string"),
            ("uframe", "pose"),
            ("oframe", "pose"),
        )
    ],
}
_UNIT = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]]
_LONGEST = 400  # statements of a run


class Stopped(Exception):
    """The controller stops the program: the rest of it is not run."""


class _Jump(Exception):
    """To a label, out of a routine, to an error handler and back."""

    def __init__(self, kind: str, value: Any = None) -> None:
        self.kind, self.value = kind, value


@dataclass
class _Variable:
    kind: str
    values: list[Any]  # one: the value


@dataclass(frozen=True)
class Wrist:
    """What configurations are counted from, of the data sheet, mm: axis 1 to axis 2, the lower arm, the
    height of axis 2, the wrist's centre to the flange."""

    ahead: float
    lower: float
    height: float
    depth: float

    def sides(self, arm: ControllerArm, row: Matrix) -> tuple[float, float, float]:
        """Positive: the wrist is in front of axis 1, in front of the lower arm (mm²/mm), joint 5 positive."""
        flange = arm.fk(row - np.array([row[0], 0, 0, 0, 0, 0]), "deg")
        wrist = flange[:3, 3] - self.depth * flange[:3, 2]
        angle = math.radians(row[1])
        lower = self.lower * np.array([math.sin(angle), math.cos(angle)])
        fore = np.array([wrist[0], wrist[2]]) - np.array([self.ahead, self.height]) - lower
        return wrist[0], float(lower[1] * fore[0] - lower[0] * fore[1]) / self.lower, float(row[4])

    def configuration(self, arm: ControllerArm, row: Matrix) -> list[int]:
        ahead, before_arm, bent = self.sides(arm, row)
        quadrants = [math.floor(row[i] / 90) for i in (0, 3, 5)]
        return [*quadrants, 4 * (ahead < 0) + 2 * (before_arm < 0) + (bent < 0)]


WRISTS = {"irb120": Wrist(0, 270, 290, 72), "irb1600": Wrist(150, 700, 486.5, 65)}


_parsed = lru_cache(maxsize=4)(parse)


def matrix(pose: list[list[float]]) -> Matrix:
    """(4, 4) of a RAPID pose."""
    (x, y, z), turn = pose[0], np.array(pose[1], dtype=float)
    if abs(np.linalg.norm(turn) - 1) > 1e-3:
        raise Stopped("the orientation is not normalised")
    w, i, j, k = turn / np.linalg.norm(turn)
    return np.array(
        [
            [w * w + i * i - j * j - k * k, 2 * (i * j - w * k), 2 * (i * k + w * j), x],
            [2 * (i * j + w * k), w * w - i * i + j * j - k * k, 2 * (j * k - w * i), y],
            [2 * (i * k - w * j), 2 * (j * k + w * i), w * w - i * i - j * j + k * k, z],
            [0, 0, 0, 1],
        ]
    )


class RapidController:
    """One run of a program: `poses` are those of the flange at the targets of all motions, in their order.

    `meant` (K, 6) are joints near which targets are (inverse kinematics starts there; the configuration
    decides); `elsewhere` has the data of other files, (type, value) by name, `harmless` their routines.
    """

    def __init__(
        self,
        nominal: ControllerArm,
        true: ControllerArm,
        wrist: Wrist,
        meant: Matrix,
        elsewhere: dict[str, tuple[str, Any]],
        harmless: frozenset[str] = frozenset(),
    ) -> None:
        self.nominal, self.true, self.wrist, self.meant, self.harmless = nominal, true, wrist, meant, harmless
        self.meant_poses = nominal.frames(meant)[-1]
        load = [1.0, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0]
        self.elsewhere = {
            "tool0": ("tooldata", [True, _UNIT, load]),
            "wobj0": ("wobjdata", [False, True, "", _UNIT, _UNIT]),
            **{f"reg{i}": ("num", 0.0) for i in range(1, 6)},
            **elsewhere,
        }
        self.solved: dict[tuple[Any, ...], Matrix] = {}

    def run(self, text: str, seed: int, start: Matrix) -> Matrix:
        """(N, 4, 4); the arm begins at joints (6,). ValueError for what is no program."""
        self.module, self.inputs = _parsed(text), random.Random(seed)
        self.fields = {**FIELDS, **self.module["records"]}
        self.data: dict[str, _Variable] = {
            name: _Variable(kind, [copy.deepcopy(value)]) for name, (kind, value) in self.elsewhere.items()
        }
        self.scopes: list[dict[str, _Variable]] = []
        self.poses: list[Matrix] = []
        self.joints, self.track, self.shift = start, 0.0, np.eye(4)
        self.obeyed = {"confj": True, "confl": True}
        self.interrupts: list[str] = []
        self.steps = 0
        for statement in self.module["data"]:
            self._declare(statement, self.data)
        if "main" not in self.module["routines"]:
            raise ValueError("main is missing")
        with contextlib.suppress(Stopped, _Jump):
            self._routine("main", [])
        return np.array(self.poses).reshape(-1, 4, 4)

    # Data

    def _declare(self, statement: Any, scope: dict[str, _Variable]) -> None:
        _, kind, name, sizes, value = statement
        if name in scope and scope is not self.data:
            raise ValueError(f"{name} is there twice")
        found = None if value is None else copy.deepcopy(self._value(value))
        if found is None:
            found = self._empty(kind)
            for size in reversed(sizes):
                found = [copy.deepcopy(found) for _ in range(int(self._value(size)))]
        scope[name] = _Variable(kind, [found])

    def _empty(self, kind: str) -> Any:
        if kind in self.fields:
            return [self._empty(each) for _, each in self.fields[kind]]
        return {"string": "", "bool": False}.get(kind, 0.0)

    def _variable(self, name: str) -> _Variable:
        for scope in (self.scopes[-1] if self.scopes else {}, self.data):
            if name in scope:
                return scope[name]
        return _Variable("signal", [float(self.inputs.randint(0, 1))])

    def _place(self, reference: Any) -> tuple[list[Any], int, str]:
        """Where a value is kept, and its type."""
        _, name, parts = reference
        variable = self._variable(name)
        values, i, kind = variable.values, 0, variable.kind
        for sign, part in parts:
            values = values[i]
            if sign == "{":
                indices = [int(self._value(each)) - 1 for each in part]
                for index in indices[:-1]:
                    values = values[index]
                i = indices[-1]
                if not 0 <= i < len(values):
                    raise Stopped("no such element")
            else:
                names = [each for each, _ in self.fields.get(kind, [])]
                if part not in names:
                    raise ValueError(f"a {kind} has no {part}")
                i = names.index(part)
                kind = self.fields[kind][i][1]
        return values, i, kind

    def _value(self, value: Any) -> Any:
        kind = value[0]
        if kind == "constant":
            return value[1]
        if kind == "list":
            return [self._value(each) for each in value[1]]
        if kind == "reference":
            values, i, _ = self._place(value)
            return values[i]
        if kind == "function":
            return self._function(value[1], value[2])
        if kind == "operation":
            return _operated(value[1], self._value(value[2]), self._value(value[3]))
        other = self._value(value[1])
        return (not other) if kind == "NOT" else -other if kind == "-" else other

    def _function(self, name: str, arguments: Any) -> Any:
        if name in self.module["routines"]:
            return self._routine(name, arguments)
        if name in ("testdi", "dinput"):
            return bool(self.inputs.randint(0, 1))
        values = [self._value(value) for value, _ in arguments if value is not None]
        if name == "offs":
            target = copy.deepcopy(values[0])
            target[0] = [one + two for one, two in zip(target[0], values[1:], strict=True)]
            return target
        if name == "reltool":
            target = copy.deepcopy(values[0])
            target[0] = (matrix(target[:2]) @ np.array([*values[1:4], 1]))[:3].tolist()
            return target
        if name == "crobt":
            return self._read_target(arguments)
        if name in self.harmless:
            return 1.0
        known = {
            "abs": abs,
            "round": round,
            "sin": math.sin,
            "numtostr": lambda x, _: f"{x:g}",
            "strlen": len,
        }
        if name not in known:
            raise ValueError(f"{name} is no function here")
        return known[name](*values)

    def _read_target(self, arguments: Any) -> Any:
        options = arguments[0][1] if arguments else {}
        tool, frame = self._frames(
            self._option(options, "tool", "tool0"), self._option(options, "wobj", "wobj0")
        )
        pose = np.linalg.inv(frame) @ self.nominal.fk(self.joints, "deg") @ tool
        w = math.sqrt(max(0.0, 1 + np.trace(pose[:3, :3]))) / 2
        vector = [
            (pose[2, 1] - pose[1, 2]) / 4 / w,
            (pose[0, 2] - pose[2, 0]) / 4 / w,
            (pose[1, 0] - pose[0, 1]) / 4 / w,
        ]
        return [
            pose[:3, 3].tolist(),
            [w, *vector],
            self.wrist.configuration(self.nominal, self.joints),
            [9e9] * 6,
        ]

    def _option(self, options: dict[str, Any], name: str, otherwise: str) -> Any:
        value = options.get(name, ("reference", otherwise, []))
        if value is not None and value[0] == "present":
            known = self.scopes and value[1] in self.scopes[-1]
            value = ("reference", value[1] if known else otherwise, [])
        if value is None or value[0] != "reference":
            raise ValueError(f"{name} is no data")
        return self._value(value)

    # Routines

    def _routine(self, name: str, arguments: Any) -> Any:
        _, parameters, body, handler = self.module["routines"][name]
        scope: dict[str, _Variable] = {}
        given = [value for value, _ in arguments if value is not None]
        options = {key: value for _, each in arguments for key, value in each.items()}
        if len(given) != sum(not optional for *_, optional in parameters) or len(self.scopes) > 20:
            raise ValueError(f"{name} has other arguments")
        for mode, of, parameter, optional in parameters:
            value = options.get(parameter) if optional else given.pop(0)
            if value is None:
                continue
            if mode == "IN":
                scope[parameter] = _Variable(of, [copy.deepcopy(self._value(value))])
            else:
                values, i, _ = self._place(value)
                scope[parameter] = _Variable(of, _Window(values, i))  # type: ignore[arg-type]
        self.scopes.append(scope)
        try:
            self._handled(body, handler)
        except _Jump as jump:
            if jump.kind != "return":
                raise
            return jump.value
        finally:
            self.scopes.pop()
        return None

    def _handled(self, body: list[Any], handler: list[Any]) -> None:
        i = 0
        while i < len(body):
            try:
                self._block(body, i)
                return
            except _Jump as jump:
                if jump.kind != "error" or not handler or jump.value is None:
                    raise
                at = self.failed
            try:
                self._block(handler, 0)
            except _Jump as jump:
                if jump.kind not in ("retry", "trynext"):
                    raise
                i = at + (jump.kind == "trynext")
                continue
            return

    def _block(self, body: list[Any], i: int = 0) -> None:
        """Run the statements from number i on."""
        while i < len(body):
            try:
                self._statement(body[i])
            except _Jump as jump:
                labels = [k for k, each in enumerate(body) if each[0] == "label" and each[1] == jump.value]
                if jump.kind == "error":
                    self.failed = i
                if jump.kind != "goto" or not labels:
                    raise
                i = labels[0]
            i += 1

    def _statement(self, statement: Any) -> None:
        self.steps += 1
        if self.steps > _LONGEST:
            raise Stopped("long enough")
        for trap in self.interrupts:
            if self.inputs.random() < 0.05:
                kept, self.interrupts = self.interrupts, []
                self._routine(trap, [])
                self.interrupts = kept
        kind = statement[0]
        if kind == "data":
            self._declare(statement, self.scopes[-1])
        elif kind == "assign":
            values, i, _ = self._place(statement[1])
            values[i] = copy.deepcopy(self._value(statement[2]))
        elif kind == "if":
            for condition, body in statement[1]:
                if self._value(condition):
                    self._block(body)
                    return
            self._block(statement[2])
        elif kind == "while":
            while self._value(statement[1]) and self.steps < _LONGEST:
                self.steps += 1
                self._block(statement[2])
        elif kind == "for":
            _, name, begin, end, step, body = statement
            first, last = self._value(begin), self._value(end)
            by = (1.0 if last >= first else -1.0) if step is None else self._value(step)
            while (last - first) * by >= 0 and self.steps < _LONGEST:
                self.scopes[-1][name] = _Variable("num", [first])
                self._block(body)
                first, self.steps = first + by, self.steps + 1
        elif kind == "test":
            value = self._value(statement[1])
            for values, body in statement[2]:
                if values is None or value in [self._value(each) for each in values]:
                    self._block(body)
                    return
        elif kind == "call":
            self._call(statement[1], statement[2])
        elif kind == "connect":
            self.interrupts.append(statement[1][2])
        elif kind == "raise":
            raise _Jump("error", 1)
        elif kind == "return":
            raise _Jump("return", None if statement[1] is None else self._value(statement[1]))
        elif kind != "label":
            if kind == "exit":
                raise Stopped("EXIT")
            raise _Jump(kind, statement[1])

    def _call(self, name: str, arguments: Any) -> None:
        if name in self.module["routines"]:
            self._routine(name, arguments)
        elif name in ("moveabsj", "movej", "movel", "movec"):
            self._move(name, arguments)
        elif name in ("confj", "confl"):
            self.obeyed[name] = "on" in arguments[0][1]
        elif name == "pdispset":
            self.shift = matrix(self._value(arguments[0][0]))
        elif name == "pdispoff":
            self.shift = np.eye(4)
        elif name in ("incr", "decr", "add", "clear"):
            values, i, _ = self._place(arguments[0][0])
            by = (
                self._value(arguments[1][0])
                if name == "add"
                else {"incr": 1, "decr": -1}.get(name, -values[i])
            )
            values[i] += by
        elif name == "waitdi" and "maxtime" in arguments[1][1]:
            if self.inputs.random() < 0.2:
                raise _Jump("error", 1)
        elif name == "pickat":  # of another file: it goes where it is told
            self._move(
                "movej",
                [arguments[0], *[(("reference", "v100", []), {})] * 2, (("reference", "tool0", []), {})],
            )
        elif name not in _NOTHING | self.harmless:
            raise ValueError(f"{name} is no instruction here")

    # Motions

    def _frames(self, tool: Any, wobj: Any) -> tuple[Matrix, Matrix]:
        if tool[0] is not True or wobj[:3] != [False, True, ""]:
            raise Stopped("a stationary tool, or a work object that moves")
        return matrix(tool[1]), matrix(wobj[3]) @ matrix(wobj[4])

    def _move(self, word: str, arguments: Any) -> None:
        if arguments[0][0] is None:
            arguments = arguments[1:]
        count = 2 if word == "movec" else 1
        if len(arguments) != count + 3:
            raise ValueError(f"{word} has other arguments")
        last, options = arguments[count + 2]
        if last[0] != "reference":
            raise ValueError("the tool is no data")
        for value, _ in arguments[:count]:
            target = self._value(value)
            if word == "moveabsj":
                self.joints = np.array(target[0], dtype=float)
                self._carry(target[1][0])
            else:
                tool, frame = self._frames(self._value(last), self._option(options, "wobj", "wobj0"))
                self._carry(target[3][0])
                carried = np.eye(4)
                carried[0, 3] = self.track
                pose = np.linalg.inv(carried) @ frame @ self.shift @ matrix(target[:2]) @ np.linalg.inv(tool)
                self.joints = self._solved(pose, target[2], word != "movej")
            flange = self.true.fk(self.joints, "deg")
            flange[0, 3] += self.track
            self.poses.append(flange)

    def _carry(self, value: float) -> None:
        """The first external axis carries the robot along x."""
        if value < 8e9:
            self.track = value

    def _solved(self, pose: Matrix, stated: list[float], linear: bool) -> Matrix:
        if not self.obeyed["confl" if linear else "confj"]:
            found = self.nominal.straight(pose, self.joints) if linear else None
            found = self.nominal.nearest(pose, self.joints) if found is None else found
            if found is None:
                raise Stopped("out of reach")
            return found
        key = (*pose.round(5).ravel(), *stated)
        if key not in self.solved:
            self.solved[key] = self._with_configuration(pose, stated)
        row = self.solved[key]
        if linear and self.wrist.configuration(self.nominal, self.joints)[3] != stated[3]:
            raise Stopped("a linear motion does not change the configuration")
        return row

    def _with_configuration(self, pose: Matrix, stated: list[float]) -> Matrix:
        apart = np.abs(self.meant_poses - pose)
        order = np.argsort(apart[:, :3, 3].sum(axis=1) + 300 * apart[:, :3, :3].sum(axis=(1, 2)))
        for starts in (self.meant[order[:1]], self.meant[order[:6]], None):
            rows = self.nominal.solutions(pose) if starts is None else self.nominal.climbed(pose, starts)
            for row in rows:
                turned = row.copy()
                for i, quadrant in zip((0, 3, 5), stated[:3], strict=True):
                    turned[i] += 360 * round((90 * quadrant + 45 - row[i]) / 360)
                inside = all(
                    -1e-3 <= turned[i] - 90 * quadrant <= 90 + 1e-3
                    for i, quadrant in zip((0, 3, 5), stated[:3], strict=True)
                )
                if inside and self.wrist.configuration(self.nominal, turned)[3] == stated[3]:
                    return np.asarray(turned)
        raise Stopped("no joints with this configuration")


class _Window:
    """A value that is kept elsewhere, as the only element of a list."""

    def __init__(self, values: list[Any], i: int) -> None:
        self.values, self.i = values, i

    def __getitem__(self, _: int) -> Any:
        return self.values[self.i]

    def __setitem__(self, _: int, value: Any) -> None:
        self.values[self.i] = value


_NOTHING = {
    *("set", "reset", "setdo", "pulsedo", "waittime", "waituntil", "waitdi", "tpwrite", "accset", "velset"),
    *("gripload", "stop", "clkstart", "clkreset", "isignaldi", "idelete", "singarea", "cirpathmode", "write"),
    *("tperase", "motionsup"),
}


def _operated(sign: str, one: Any, two: Any) -> Any:
    if sign in ("+", "-") and isinstance(one, list):
        return [a + b if sign == "+" else a - b for a, b in zip(one, two, strict=True)]
    operations = {
        "+": lambda: one + two,
        "-": lambda: one - two,
        "*": lambda: one * two,
        "/": lambda: one / two if two else 0.0,
        "DIV": lambda: float(one // two) if two else 0.0,
        "MOD": lambda: one % two if two else 0.0,
        "=": lambda: one == two,
        "<>": lambda: one != two,
        "<": lambda: one < two,
        ">": lambda: one > two,
        "<=": lambda: one <= two,
        ">=": lambda: one >= two,
        "AND": lambda: bool(one and two),
        "OR": lambda: bool(one or two),
        "XOR": lambda: bool(one) != bool(two),
    }
    return operations[sign]()
