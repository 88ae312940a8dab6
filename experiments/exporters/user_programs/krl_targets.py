"""The targets of a KRL module (KUKA): its .src and its .dat as one text, the .dat behind.

Which tool and base a Cartesian target has is said by the motion: by the data set of an inline form
(FDAT_ACT=…, STOOL2(…)), or by what was set before it.
"""

from __future__ import annotations

import re

import numpy as np

from ....model.arms.branches import Branch, is_kuka_turn, kuka_status, kuka_turn
from ....model.arms.orientation import orientation
from ....model.arms.poses import from_abc
from ....model.robot import Matrix
from ...importers.kuka import AGGREGATE, without_comments
from .parts import NULL, NUMBER, Edit, JointTarget, Motion, Parsed, PoseTarget, Source, number_edits

_FIELD = re.compile(
    rf"\b(?P<name>A[1-6]|E[1-6]|[XYZABCST])\s+(?P<value>{NUMBER}|'B[01]+'|'H[0-9A-F]+')", re.IGNORECASE
)
_POSE = ("X", "Y", "Z", "A", "B", "C")
_MOTION = re.compile(r"\s*(?P<word>S?PTP|S?LIN|S?CIRC|SPL)\b(?P<rest>.*)", re.IGNORECASE)
_RELATIVE = re.compile(r"\s*S?(?:PTP|LIN|CIRC|SPL)_REL\b|\s*BRAKE\b.*\bPOS\b", re.IGNORECASE)
_HERE = re.compile(r"\s*\$(?:AXIS_ACT|POS_ACT)\b", re.IGNORECASE)
_DATA = re.compile(
    r"\bFDAT\s+(?P<name>\w+)\s*=\s*\{[^}]*?TOOL_NO\s+(?P<tool>\d+)\s*,\s*BASE_NO\s+(?P<base>\d+)[^}]*\}",
    re.IGNORECASE,
)
_SETS = {
    "tool": re.compile(
        r"\$TOOL\s*=\s*(?:TOOL_DATA\[(?P<n>\d+)\]|(?P<null>\$NULLFRAME)|(?P<other>[^,]+))|BAS\s*\(\s*#TOOL\s*,\s*(?P<bas>\w+)\s*\)",
        re.IGNORECASE,
    ),
    "base": re.compile(
        r"\$BASE\s*=\s*(?:BASE_DATA\[(?P<n>\d+)\]|(?P<null>\$NULLFRAME|\$WORLD)|(?P<other>[^,]+))|BAS\s*\(\s*#BASE\s*,\s*(?P<bas>\w+)\s*\)",
        re.IGNORECASE,
    ),
}
_BY_DATA = re.compile(
    r"\bFDAT_ACT\s*=\s*(\w+)|\bSTOOL2?\s*\(\s*(\w+)\s*\)"
    r"|\bFDAT_ACT\s*=\s*\{[^}]*?TOOL_NO\s+(\d+)\s*,\s*BASE_NO\s+(\d+)",
    re.IGNORECASE,
)
_FRAME = re.compile(r"(?P<word>tool|base)_data\[(?P<number>\d+)\]")
_CONTROL = re.compile(
    r"\s*(?:IF|ELSE|ENDIF|FOR|ENDFOR|WHILE|ENDWHILE|LOOP|ENDLOOP|REPEAT|UNTIL|SWITCH|CASE|DEFAULT|ENDSWITCH"
    r"|GOTO|\w+\s*:\s*$)\b|\s*\w+\s*:\s*$",
    re.IGNORECASE,
)
_CALL = re.compile(r"\s*(?!BAS\b|WAIT\b|INTERRUPT\b|TRIGGER\b|PULSE\b)\w+\s*\([^)]*\)\s*$", re.IGNORECASE)
_BEGIN = re.compile(r"\s*(?:GLOBAL\s+)?DEF(?:FCT|DAT)?\b", re.IGNORECASE)
_BASE_OF_TOOL = re.compile(r"IPO_FRAME\s+#TCP|\$IPO_MODE\s*=\s*#TCP", re.IGNORECASE)
_UNKNOWN = "?"


def krl_head(text: str) -> tuple[int, str]:
    """Where comments at the head of a file are put, and what they begin with."""
    found = re.search(r"^[ \t]*(?:GLOBAL\s+)?DEF(?:FCT|DAT)?\b[^\n]*\n", text, re.MULTILINE | re.IGNORECASE)
    return (0 if found is None else found.end()), "; "


def krl_targets(source: Source) -> Parsed:
    """What is to be corrected in a module."""
    return _Module(source).read()


class _Module:
    def __init__(self, source: Source) -> None:
        self.source, self.bare, self.parsed = source, without_comments(source.text), Parsed()
        self.places: dict[str, tuple[int, int]] = {}  # of the aggregates of names
        self.defined: dict[tuple[str, str], tuple[int, Matrix]] = {}  # of tools and bases: where, and what
        self.allowed: set[tuple[int, int]] = set()
        self.data = {
            found["name"].lower(): (found["tool"], found["base"]) for found in _DATA.finditer(self.bare)
        }
        self.active: dict[str, str] = {}
        self.every: dict[str, set[str]] = {"tool": set(), "base": set()}
        self.begun: set[str] = set()  # of these, what was set by now

    def read(self) -> Parsed:
        self._declarations()
        self._settings()
        place, first = 0, True
        for line in self.bare.splitlines(keepends=True):
            self._line(line, place, first)
            if _BEGIN.match(line):
                first, self.active = True, {}
            elif _MOTION.match(line):
                first = False
            place += len(line)
        self._not_understood()
        self._unused()
        return self.parsed

    def _problem(self, place: int, said: str) -> None:
        self.parsed.problems.append((self.source.line(place), said))

    def _declarations(self) -> None:
        for match in AGGREGATE.finditer(self.bare):
            name = match["name"].lower()
            self.allowed.add(match.span("name"))
            if name.startswith("$") or self.bare[match.start("name") - 1 : match.start("name")] == "$":
                continue
            if name in self.source.stated.leave:
                continue
            frame = _FRAME.fullmatch(name)
            if frame is not None:
                self._define(frame, match)
                continue
            if name in self.places:
                self._problem(match.start(), f"{match['name']} has two values")
            self.places[name] = match.span("fields")
            if match["fields"].strip()[0] in "Aa":
                self._add_joints(name, match["name"])

    def _define(self, frame: re.Match[str], match: re.Match[str]) -> None:
        """A tool or base that the program itself defines."""
        fields = {found["name"].upper(): found for found in _FIELD.finditer(self.bare, *match.span("fields"))}
        values = [float(fields[name]["value"]) for name in _POSE if name in fields]
        key = frame["word"], frame["number"]
        if len(values) != len(_POSE) or key in self.defined:
            self._problem(match.start(), f"{match['name']} has two values, or is not stated in numbers")
            return
        self.defined[key] = match.start(), from_abc(values)

    def _fields(self, name: str) -> dict[str, re.Match[str]]:
        return {found["name"].upper(): found for found in _FIELD.finditer(self.bare, *self.places[name])}

    def _add_joints(self, key: str, name: str) -> bool:
        fields, place, n = self._fields(key), self.places[key][0], self.source.robot.n
        axes = [f"A{i}" for i in range(1, n + 1)]
        if any(axis not in fields for axis in axes) or any(
            axis[0] == "A" and axis not in ("A", *axes) and float(found["value"])
            for axis, found in fields.items()
        ):
            self._problem(place, f"{name} does not state the {n} axes of the robot, in numbers")
            return False
        spans = [fields[axis].span("value") for axis in axes]

        def write(joints: Matrix) -> list[Edit]:
            return number_edits(spans, self.source.text, joints.tolist(), [6] * n)

        joints = np.array([float(self.bare[start:end]) for start, end in spans])
        self.parsed.targets[key] = JointTarget(
            self.source.written(key), self.source.line(place), joints, write
        )
        return True

    def _settings(self) -> None:
        for word, pattern in _SETS.items():
            self.every[word] = {_set(found) for found in pattern.finditer(self.bare)}
        for found in _BY_DATA.finditer(self.bare):
            for word, number in zip(("tool", "base"), self._of_data(found), strict=True):
                self.every[word].add(number)

    def _of_data(self, found: re.Match[str]) -> tuple[str, str]:
        if found[3]:
            return found[3], found[4]
        return self.data.get((found[1] or found[2]).lower(), (_UNKNOWN, _UNKNOWN))

    def _line(self, line: str, place: int, first: bool) -> None:
        if _CONTROL.match(line) or _CALL.match(line):
            self.active = {}
        motion = None if _RELATIVE.match(line) else _MOTION.match(line)
        own = dict(self.active)
        for word, pattern in _SETS.items():
            for found in pattern.finditer(line):
                own[word] = _set(found)
        for found in _BY_DATA.finditer(line):
            own["tool"], own["base"] = self._of_data(found)
        self.begun |= own.keys()
        if motion is None:
            self.active = own
            return
        self._motion(motion, place, own, first)

    def _motion(self, motion: re.Match[str], place: int, active: dict[str, str], first: bool) -> None:
        word = motion["word"].upper().removeprefix("S")
        linear, count = word != "PTP", 2 if word == "CIRC" else 1
        rest, at = motion["rest"], place + motion.start("rest")
        if _HERE.match(rest):
            self.parsed.motions.append(Motion(None, self.source.line(at), linear, True))
            return
        for i in range(count):
            found = re.match(r"[\s,]*(?P<name>\w+(?:\[\d+\])?|\{[^}]*\})(?P<then>\s*[:+\[.]?)", rest)
            if found is None or found["then"].strip():
                self._problem(at, f"{' '.join(motion[0].split())[:60]}: the target is computed when it runs")
                return
            key = self._named(found["name"], at + found.start("name"))
            if key is None:
                self.parsed.motions.append(Motion(None, self.source.line(at), linear, True))
            elif isinstance(self.parsed.targets.get(key), JointTarget) or (
                key in self.places and self._use(key, active, at, linear)
            ):
                self.parsed.motions.append(Motion(key, self.source.line(at), linear, first and not i))
            at += found.end("name")
            rest = rest[found.end("name") :]

    def _named(self, text: str, place: int) -> str | None:
        """The key of a target; None where it is left as it is, or is a problem."""
        if text.startswith("{"):
            key = f"the target in line {self.source.line(place)}"
            while key in self.places:
                key += "'"
            inner = re.match(r"\{\s*(?:\w+\s*:)?\s*", text)
            assert inner is not None
            self.places[key] = place + inner.end(), place + len(text) - 1
            if re.match(r"A[1-6]\b", text[inner.end() :], re.IGNORECASE):
                return key if self._add_joints(key, key) else None
            return key
        low = text.lower()
        if low in self.source.stated.leave:
            return None
        self.allowed.add((place, place + len(text)))
        if low not in self.places:
            self._problem(place, f"{text} has no value in these files (--leave {text}?)")
            return None
        return low

    def _use(self, key: str, active: dict[str, str], place: int, linear: bool) -> bool:
        """Enter the pose as used with the tool and base that are active; False where that is a problem."""
        frames = []
        for word, option, stated in (
            ("tool", "--tool", self.source.stated.tools),
            ("base", "--frame", self.source.stated.frames),
        ):
            one = len(self.every[word]) == 1 and word in self.begun
            number = active.get(word) or (min(self.every[word]) if one else "")
            frame = stated.get(number, NULL if number == "0" else None)
            begun, own = self.defined.get((word, number), (place, None))
            if own is not None and begun < place:
                if frame is not None and not np.allclose(frame, own):
                    self._problem(place, f"{word} {number} is defined in the program, and stated otherwise")
                    return False
                frame = own
            if frame is None and number in ("", _UNKNOWN):
                frame = stated.get("")
            if frame is None:
                known = f"{word} {number}" if number.isdecimal() else f"the active {word}"
                said = f"{number}=" if number.isdecimal() else ""
                self._problem(place, f"{known} is not known; state {option} {said}X,Y,Z,A,B,C")
                return False
            frames.append(frame)
        before = self.parsed.targets.get(key)
        if isinstance(before, PoseTarget):
            if np.allclose(before.tool, frames[0]) and np.allclose(before.frame, frames[1]):
                return linear or self._add_pose(key, frames, linear)
            self._problem(place, f"{self.source.written(key)} is used with different tools or bases")
            return False
        return self._add_pose(key, frames, linear)

    def _add_pose(self, key: str, frames: list[Matrix], linear: bool) -> bool:
        fields, (place, _) = self._fields(key), self.places[key]
        text, line = self.source.text, self.source.line(place)
        if any(name not in fields for name in _POSE):
            self._problem(place, f"{self.source.written(key)} does not state X, Y, Z, A, B and C in numbers")
            return False
        if any(name[0] == "E" and float(found["value"]) for name, found in fields.items()):
            self._problem(
                place, f"{self.source.written(key)} has positions of external axes, which may carry the robot"
            )
            return False
        spans = [fields[name].span("value") for name in _POSE]
        values = [float(text[start:end]) for start, end in spans]
        status, turn = (_integer(fields[name]["value"]) if name in fields else None for name in "ST")

        def matches(branch: Branch, joints: Matrix) -> bool:
            # A linear motion keeps S and ignores T.
            return (
                status is not None
                and status & 7 == kuka_status(branch)
                and (linear or turn is None or is_kuka_turn(turn, joints))
            )

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = [*pose[:3, 3].tolist(), *orientation(pose[:3, :3]).abc]
            edits = number_edits(spans, text, new, [6] * 6)
            if branch is not None and status is not None and status & 7 != kuka_status(branch):
                edits.append(Edit(*fields["S"].span("value"), str(status & ~7 | kuka_status(branch))))
            if turn is not None and not linear and not is_kuka_turn(turn, joints):
                edits.append(Edit(*fields["T"].span("value"), str(kuka_turn(joints))))
            return edits

        self.parsed.targets[key] = PoseTarget(
            self.source.written(key),
            line,
            from_abc(values),
            frames[0],
            frames[1],
            None if status is None else matches,
            f"S {status}" + ("" if linear or turn is None else f", T {turn}"),
            write,
        )
        return True

    def _not_understood(self) -> None:
        place = 0
        for line in self.bare.splitlines(keepends=True):
            if _RELATIVE.match(line):
                self._problem(place, f"{' '.join(line.split())[:60]}: a relative motion cannot be corrected")
            if _BASE_OF_TOOL.search(line):
                self._problem(place, "the tool is fixed in the room (#TCP), which is not understood")
            place += len(line)
        # A corrected home position is where the controller reads it.
        self.allowed |= {
            found.span(1) for found in re.finditer(r"\$H_POS\s*=\s*(\w+)", self.bare, re.IGNORECASE)
        }
        for found in re.finditer(r"(?<![$\w#])[A-Za-z_]\w*(?:\[\d+\])?", self.bare):
            if found[0].lower() in self.places and found.span() not in self.allowed:
                self.parsed.changed(self.source.line(found.start()), found[0])

    def _unused(self) -> None:
        for key, (place, _) in self.places.items():
            line = self.source.line(place)
            if key not in self.parsed.targets and not self.parsed.speaks_of(line, self.source.written(key)):
                said = "is not the target of a motion here, so that its tool is not known (--leave?)"
                self.parsed.problems.append((line, f"{self.source.written(key)} {said}"))


def _set(found: re.Match[str]) -> str:
    if found["null"]:
        return "0"
    number = found["n"] or found["bas"]
    return number if number and number.isdecimal() else _UNKNOWN


def _integer(text: str) -> int:
    if text.startswith("'"):
        return int(text[2:-1], 2 if text[1] in "Bb" else 16)
    return int(float(text))
