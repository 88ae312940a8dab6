"""A KRC as far as KRL programs of people need it: runs a program on an arm, and says where its flange is.

Written from the manuals, without the code that is tested: own words, own arithmetic, `ControllerArm` for the
kinematics. A PTP obeys S and T; without S it keeps the status, without T it takes the shortest way. Linear
motions follow the line, and end where it leads. What is no valid program (or no reachable position) is
`Invalid`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from controller_arm import ControllerArm, on_line
from krl_values import XYZABC, Expression, Invalid, components, copied, frame, split, top, words

from zerobeam.model.arrays import Matrix

_AXES = [f"A{i}" for i in range(1, 7)]
_TYPES = {"INT", "REAL", "BOOL", "CHAR", "E6POS", "POS", "FRAME", "E6AXIS", "FDAT", "LDAT", "PDAT"}
_STEPS = 12  # of a line that is followed


class _Return(Exception):
    pass


class Ends(Exception):
    """Enough was run."""


def status(joints: Matrix) -> int | None:
    """Bits 0 to 2 of S of a KR 6 R900, by the side view of its data sheet; None near a singularity."""
    q2, q3 = np.radians(joints[1]), np.radians(joints[1] + joints[2])
    ahead = 25 + 455 * np.cos(q2) + 35 * np.sin(q3) + 420 * np.cos(q3)
    elbow = (joints[2] - np.degrees(np.arctan2(35, 420)) + 180) % 360 - 180
    bend = (joints[4] + 180) % 360 - 180
    if abs(ahead) < 15 or min(abs(elbow), 180 - abs(elbow)) < 1.5 or abs(bend) < 1.5:
        return None
    return int(ahead < 0) + 2 * int(elbow > 0) + 4 * int(bend < 0)


@dataclass
class Routine:
    """Its lines as words; where each structure goes on."""

    name: str
    parameters: list[str]
    lines: list[list[str]]
    jumps: dict[int, int] = field(default_factory=dict)
    labels: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        stack: list[list[int]] = []
        for at, line in enumerate(self.lines):
            first = line[0]
            if first in ("IF", "FOR", "WHILE", "LOOP", "REPEAT", "SWITCH"):
                stack.append([at])
            elif first in ("ELSE", "CASE", "DEFAULT"):
                stack[-1].append(at)
            elif first in ("ENDIF", "ENDFOR", "ENDWHILE", "ENDLOOP", "UNTIL", "ENDSWITCH"):
                marks = [*stack.pop(), at]
                for mark, following in pairwise(marks):
                    self.jumps[mark] = following
                self.jumps[at] = marks[0]
            elif line[1:] == [":"]:
                self.labels[first] = at
        if stack:
            raise Invalid("a structure is not closed")

    def end_of(self, at: int) -> int:
        """The last line of the structure that begins here."""
        while self.lines[at][0] not in ("ENDIF", "ENDFOR", "ENDWHILE", "ENDLOOP", "UNTIL", "ENDSWITCH"):
            at = self.jumps[at]
        return at


class Controller:
    """Runs a program (its .src and .dat as one text) once; `poses` are those of the flange of `true` at the
    end of each motion, but for targets that are `left` and for $AXIS_ACT. `config` has what other files
    declare, `foreign` their routines."""

    def __init__(
        self,
        text: str,
        nominal: ControllerArm,
        true: ControllerArm,
        hints: Matrix,
        limits: tuple[Matrix, Matrix],
        seed: int,
        config: dict[str, Any],
        foreign: dict[str, Callable[[Controller], None]],
        left: Sequence[str] = (),
    ) -> None:
        self.nominal, self.true, self.hints, self.limits = nominal, true, hints, limits
        self.rng = np.random.default_rng(seed)
        self.config, self.foreign, self.left = {k: copied(v) for k, v in config.items()}, foreign, left
        self.joints = np.array(hints[self.rng.integers(len(hints))], dtype=float)
        self.data: dict[str, Any] = {}
        self.types: dict[str, str] = {}
        self.system: dict[str, Any] = {
            "$ORI_TYPE": "#VAR",
            "$IPO_MODE": "#BASE",
            "$TOOL": None,
            "$BASE": None,
        }
        self.scopes: list[dict[str, Any]] = [{}]
        self.interrupts: dict[int, list[str]] = {}
        self.enabled: set[int] = set()
        self.triggers: list[list[str]] = []
        self.poses: list[Matrix] = []
        # Of S without T there are two readings: that it is obeyed, and that both are needed.
        self.needs_both = self.rng.random() < 0.5
        self.block: dict[str, Any] | None = None
        self.at_last_motion: tuple[Matrix, Matrix] | None = None
        self._count, self._depth = 0, 0
        self.routines: dict[str, Routine] = {}
        self._load(text)

    def run(self) -> Matrix:
        """(N, 4, 4): from the first routine, until it ends or has done enough."""
        with suppress(Ends):
            self._call(next(iter(self.routines.values())), [])
        return np.array(self.poses).reshape(-1, 4, 4)

    # Reading

    def _load(self, text: str) -> None:
        name, parameters, lines, in_data = "", [], [], False
        for raw in text.split("\n"):
            line = words(raw)
            if not line or line[0] == "&":
                continue
            if line[0] == "GLOBAL" and line[1] in ("DEF", "DEFFCT"):
                line = line[1:]
            if line[0] in ("DEF", "DEFFCT"):
                name = line[1] if line[0] == "DEF" else line[2]
                inner = line[line.index("(") + 1 : line.index(")")]
                kept = [word for i, word in enumerate(inner) if i == 0 or inner[i - 1] == ","]
                parameters, lines = [word for word in kept if word != ","], []
            elif line[0] in ("END", "ENDFCT"):
                self.routines[name] = Routine(name, parameters, lines)
                name = ""
            elif line[0] in ("DEFDAT", "ENDDAT"):
                in_data = line[0] == "DEFDAT"
            elif in_data:
                self._statement(line)
            elif name:
                lines.append(line)
            else:
                raise Invalid("a statement outside of a routine")
        if name or in_data:
            raise Invalid("no END")

    # Running

    def _call(self, routine: Routine, arguments: list[tuple[Any, str | None]]) -> Any:
        self._depth += 1
        if self._depth > 8:
            raise Invalid("calls are nested too deep")
        scope = {name: copied(value) for name, (value, _) in zip(routine.parameters, arguments, strict=True)}
        outer = self.scopes
        self.scopes = [self.scopes[0], scope]
        result = None
        try:
            self._lines(routine)
        except _Return as returned:
            result = returned.args[0]
        self.scopes = outer
        for name, (_, variable) in zip(routine.parameters, arguments, strict=True):
            if variable is not None:
                self._store(variable, scope[name])
        self._depth -= 1
        return result

    def _lines(self, routine: Routine) -> None:
        at, loops = 0, dict[int, float]()
        while at < len(routine.lines):
            self._count += 1
            if self._count > 600 or len(self.poses) >= 16:
                raise Ends
            line, first = routine.lines[at], routine.lines[at][0]
            if first == "IF":
                if not self._value(line[1:-1]):
                    at = routine.jumps[at]
            elif first == "ELSE" or (first in ("CASE", "DEFAULT")):
                at = routine.end_of(at)
            elif first == "SWITCH":
                at = self._case(routine, at, self._value(line[1:]))
            elif first == "FOR":
                at = self._for(routine, at, loops)
            elif first == "WHILE":
                if not self._value(line[1:]):
                    at = routine.jumps[at]
            elif first in ("ENDFOR", "ENDWHILE", "ENDLOOP"):
                at = routine.jumps[at] - 1
            elif first == "UNTIL":
                if not self._value(line[1:]):
                    at = routine.jumps[at]
            elif first == "EXIT":
                at = self._exit(routine, at, loops)
            elif first == "GOTO":
                at = routine.labels[line[1]]
            elif first == "RETURN":
                raise _Return(self._value(line[1:]) if line[1:] else None)
            elif first not in ("LOOP", "REPEAT", "ENDIF", "ENDSWITCH") and line[1:] != [":"]:
                self._statement(line)
                self._interrupted()
            at += 1

    def _case(self, routine: Routine, at: int, value: Any) -> int:
        while True:
            at = routine.jumps[at]
            line = routine.lines[at]
            if line[0] in ("DEFAULT", "ENDSWITCH") or value in [float(word) for word in line[1::2]]:
                return at

    def _for(self, routine: Routine, at: int, loops: dict[int, float]) -> int:
        line = routine.lines[at]
        name, to = line[1], line.index("TO")
        if at not in loops:
            loops[at] = self._value(line[3:to])
        else:
            loops[at] += 1
        self._store(name, loops[at])
        if loops[at] > self._value(line[to + 1 :]):
            del loops[at]
            return routine.jumps[at]
        return at

    def _exit(self, routine: Routine, at: int, loops: dict[int, float]) -> int:
        begins = [
            begin
            for begin, line in enumerate(routine.lines[:at])
            if line[0] in ("FOR", "WHILE", "LOOP", "REPEAT") and routine.end_of(begin) > at
        ]
        loops.pop(begins[-1], None)
        return routine.end_of(begins[-1])

    def _interrupted(self) -> None:
        for number in sorted(self.enabled & self.interrupts.keys()):
            if self.rng.random() < 0.1:
                self._statement(self.interrupts[number])

    # Statements

    def _statement(self, line: list[str]) -> None:
        first = line[0]
        if first == "GLOBAL":
            line, first = line[1:], line[1]
        if first in ("DECL", "CONST"):
            self._declare(line[1:])
        elif first in ("EXT", "EXTFCT", "SIGNAL", "ENUM", "WAIT", "HALT", "CONTINUE", "ANOUT"):
            pass
        elif first in _TYPES and len(line) > 1 and re.fullmatch(r"[A-Z_]\w*", line[1]):
            self._declare(line)
        elif re.fullmatch(r"S?(PTP|LIN|CIRC)(_REL)?|SPL", first):
            self._motion(line)
        elif first in ("SPLINE", "PTP_SPLINE"):
            self.block = self._with(line[1:])
        elif first == "ENDSPLINE":
            self.block = None
        elif first == "INTERRUPT":
            self._interrupt(line)
        elif first == "TRIGGER":
            do = line.index("DO")
            end = line.index("PRIO") if "PRIO" in line else len(line)
            self.triggers.append(line[do + 1 : end])
        elif first == "BAS":
            self._bas(line[2:-1])
        else:
            equal = top(line, "=")
            if equal:
                self._assign(line[: equal[0]], self._value(line[equal[0] + 1 :]))
            elif line[1:2] == ["("]:
                self._value(line)
            else:
                raise Invalid(" ".join(line))

    def _declare(self, line: list[str]) -> None:
        kind, rest = line[0], line[1:]
        while kind in ("DECL", "CONST", "GLOBAL"):
            kind, rest = rest[0], rest[1:]
        for part in split(rest, ","):
            name = part[0]
            self.types[name] = kind
            value = self._value(part[part.index("=") + 1 :]) if "=" in part else None
            if "[" in part and "=" not in part:
                value = {}
            if name not in self.scopes[-1]:
                (self.scopes[-1] if len(self.scopes) > 1 else self.data)[name] = value

    def _interrupt(self, line: list[str]) -> None:
        if line[1] == "DECL":
            self.interrupts[int(line[2])] = line[line.index("DO") + 1 :]
        elif line[1] in ("ON", "ENABLE"):
            self.enabled |= {int(line[2])} if line[2:] else set(self.interrupts)
        else:
            self.enabled -= {int(line[2])} if line[2:] else set(self.interrupts)

    def _bas(self, line: list[str]) -> None:
        command, number = line[0], line[2:]
        if command == "#INITMOV":
            self.system |= {"$TOOL": np.eye(4), "$BASE": np.eye(4), "$ORI_TYPE": "#VAR"}
        elif command in ("#TOOL", "#BASE"):
            self._choose(command[1:], int(self._value(number)))
        elif command in ("#FRAMES", "#PTP_PARAMS", "#CP_PARAMS"):
            data = self._name("FDAT_ACT")
            self._choose("TOOL", int(data["TOOL_NO"]))
            self._choose("BASE", int(data["BASE_NO"]))
            path = self.config.get("LDAT_ACT")
            if command == "#CP_PARAMS" and path:
                self.system["$ORI_TYPE"] = path.get("ORI_TYP", "#VAR")

    def _choose(self, word: str, index: int) -> None:
        self.system[f"${word}"] = self._of_number(word, index)

    def _of_number(self, word: str, index: int) -> Matrix:
        if index == 0:
            return np.eye(4)
        found = self.config.get(f"{word}_DATA", {}).get(index)
        if found is None:
            raise Invalid(f"{word}_DATA[{index}] has no value")
        return frame(found)

    def _assign(self, place: list[str], value: Any) -> None:
        name = place[0]
        if name in ("$TOOL", "$BASE"):
            if place[1:2] == ["."]:
                changed = components(self.system[name])
                changed[place[2]] = value
                value = changed
            self.system[name] = frame(value)
        elif name == "$ROBROOT":
            raise Invalid("$ROBROOT is of the machine")
        elif name.startswith("$"):
            self.system[name] = value
        elif len(place) == 1:
            known = self._find(name)
            if isinstance(value, dict) and isinstance(known, dict):
                value = {**known, **value}
            self._store(name, copied(value))
        elif place[1] == ".":
            self._name(name)[place[2]] = value
        elif place[1:3] == ["[", "]"]:
            self._store(name, value)
        else:
            close = place.index("]")
            index = int(self._value(place[2:close]))
            array = self._find(name)
            if array is None:
                raise Invalid(f"{name} is not declared")
            if place[close + 1 :]:
                array[index][place[close + 2]] = value
            else:
                array[index] = copied(value)

    # Variables

    def _find(self, name: str) -> Any:
        for scope in (self.scopes[-1], self.data, self.config):
            if name in scope:
                return scope[name]
        return None

    def _name(self, name: str) -> Any:
        found = self._find(name)
        if found is None:
            raise Invalid(f"{name} has no value")
        return found

    def _store(self, name: str, value: Any) -> None:
        for scope in (self.scopes[-1], self.data, self.config):
            if name in scope:
                scope[name] = value
                return
        if name in ("FDAT_ACT", "LDAT_ACT", "PDAT_ACT"):
            self.config[name] = value
            return
        raise Invalid(f"{name} is not declared")

    # Expressions

    def _value(self, line: list[str]) -> Any:
        parser = Expression(self, line)
        result = parser.logic()
        if parser.at != len(line):
            raise Invalid(" ".join(line))
        return result

    # Motions

    def _with(self, line: list[str]) -> dict[str, Any]:
        """What WITH sets for a motion or a block."""
        result: dict[str, Any] = {}
        if "WITH" not in line:
            return result
        line = line[line.index("WITH") + 1 :]
        while line and line[-1].startswith("C_"):
            line = line[:-1]
        for part in split(line, ","):
            name, right = part[0], part[part.index("=") + 1 :]
            if right[0] == "STOOL2":
                result[name] = self._of_number("TOOL", int(self._name(right[2])["TOOL_NO"]))
            elif right[0] == "SBASE":
                result[name] = self._of_number("BASE", int(self._name(right[2])["BASE_NO"]))
            elif right[0] == "SORI_TYP":
                result[name] = self._name(right[2]).get("ORI_TYP", "#VAR")
            elif right[0] == "SIPO_MODE":
                result[name] = self._name(right[2]).get("IPO_FRAME", "#BASE")
            elif name in ("$TOOL", "$BASE"):
                result[name] = frame(self._value(right))
            elif name in ("$ORI_TYPE", "$IPO_MODE"):
                result[name] = right[0]
        return result

    def _motion(self, line: list[str]) -> None:
        word = line[0]
        end = next((i for i, w in enumerate(line) if w == "WITH" or re.fullmatch(r"C_\w+", w)), len(line))
        rest = line[1:end]
        parts = split(rest, ",")
        system = {**self.system, **(self.block or {}), **self._with(line)}
        if "#TCP" in rest or system["$IPO_MODE"] != "#BASE":
            raise Invalid("the tool is fixed in the room")
        if parts[0][0] == "$AXIS_ACT":
            return
        targets = [self._value(part) for part in parts[: 2 if "CIRC" in word else 1]]
        target = targets[-1]
        relative = word.endswith("_REL")
        word = word.removesuffix("_REL")
        word = word[1:] if word.startswith("S") and word != "SPL" else word
        if "A1" in target or (relative and "X" not in target and set(target) & set(_AXES)):
            if word != "PTP":
                raise Invalid("axes in a linear motion")
            begin = self.joints if relative else np.zeros(6)
            if not relative and any(axis not in target for axis in _AXES):
                raise Invalid("axes are missing")
            self.joints = begin + [float(target.get(axis, 0)) for axis in _AXES]
            self._require_limits(self.joints)
        else:
            self._to_pose(word, targets, system, relative)
        if system["$TOOL"] is not None and system["$BASE"] is not None:
            self.at_last_motion = system["$TOOL"], system["$BASE"]
        if parts[0][0] not in self.left:
            self.poses.append(self.true.fk(self.joints, "deg"))
        triggers, self.triggers = self.triggers, []
        for each in triggers:
            self._statement(each)

    def _to_pose(self, word: str, targets: list[Any], system: dict[str, Any], relative: bool) -> None:
        tool, base = system["$TOOL"], system["$BASE"]
        if tool is None or base is None:
            raise Invalid("tool or base is not set")
        now = np.linalg.inv(base) @ self.nominal.fk(self.joints, "deg") @ tool
        target = targets[-1]
        if relative:
            begin = components(now)
            target = {key: begin[key] + target.get(key, 0.0) for key in XYZABC}
        if any(key not in target for key in XYZABC) or any(target.get(f"E{i}", 0) for i in range(1, 7)):
            raise Invalid("components are missing")
        pose = frame(target)
        if word != "PTP" and system["$ORI_TYPE"] == "#CONSTANT":
            pose[:3, :3] = now[:3, :3]
        flange = base @ pose @ np.linalg.inv(tool)
        if word == "PTP":
            self.joints = self._ptp(flange, target)
            return
        self.joints = self._line(flange)  # of a circle too: the status does not change on the way
        self._require_limits(self.joints)

    def _ptp(self, flange: Matrix, target: dict[str, Any]) -> Matrix:
        kept = target.get("S") is None or (target.get("T") is None and self.needs_both)
        wanted = status(self.joints) if kept else int(target["S"]) & 7
        found = self._with_status(flange, wanted)
        turns = target.get("T")
        if turns is None or target.get("S") is None:
            found = found + 360 * np.round((self.joints - found) / 360)
        else:
            for i in range(6):
                negative = bool(int(turns) >> i & 1)
                options = [v for v in found[i] + 360.0 * np.arange(-2, 3) if self._within(i, v)]
                options = [v for v in options if abs(v) < 2e-3 or (v < 0) == negative]
                if not options:
                    raise Invalid("T cannot be had")
                found[i] = options[int(np.argmin(np.abs(options - self.joints[i])))]
        for i in range(6):
            while not self._within(i, found[i]) and abs(found[i]) > 180:
                found[i] -= 360 * np.sign(found[i])
        self._require_limits(found)
        return np.asarray(found)

    def _with_status(self, flange: Matrix, wanted: int | None) -> Matrix:
        if wanted is None:
            raise Invalid("the arm is near a singularity")
        reached = self.nominal.frames(self.hints)[-1]
        apart = np.linalg.norm((reached - flange)[:, :3, 3], axis=1)
        apart += 300 * np.linalg.norm((reached - flange)[:, :3, :3], axis=(1, 2))
        nearest = [row for row in self.hints[np.argsort(apart)] if status(row) == wanted]
        for start in (*nearest[:1], self.hints, None):
            found = self.nominal.solutions(flange) if start is None else self.nominal.climbed(flange, start)
            rows = [row for row in found if status(row) == wanted]
            if rows:
                return (np.array(rows[0]) + 180) % 360 - 180
        raise Invalid("no joints have S there")

    def _line(self, flange: Matrix) -> Matrix:
        """Joints at the end of a line: those of the same status, if the way there is smooth; else those where
        small steps lead."""
        begin = self.nominal.fk(self.joints, "deg")
        try:
            end = self._with_status(flange, status(self.joints))
        except Invalid:
            return self._followed(begin, flange)
        end = end + 360 * np.round((self.joints - end) / 360)
        for share in (0.33, 0.67):
            between = (1 - share) * self.joints + share * end
            arrived = self.nominal.climbed(on_line(begin, flange, share), between)
            if not len(arrived) or np.abs(arrived[0] - between).max() > 25:
                return self._followed(begin, flange)
        return np.asarray(end)

    def _followed(self, begin: Matrix, flange: Matrix) -> Matrix:
        joints = self.joints
        for share in np.linspace(0, 1, _STEPS + 1)[1:]:
            arrived = self.nominal.climbed(on_line(begin, flange, share), joints)
            if not len(arrived) or np.abs(arrived[0] - joints).max() > 40:
                raise Invalid("the line cannot be followed")
            joints = arrived[0]
        return joints

    def _within(self, axis: int, value: float) -> bool:
        lower, upper = self.limits
        return bool(lower[axis] - 1e-3 <= value <= upper[axis] + 1e-3)

    def _require_limits(self, joints: Matrix) -> None:
        if not all(self._within(i, value) for i, value in enumerate(joints)):
            raise Invalid("beyond the limits")
