"""The targets of a URScript program (Universal Robots)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from ....model.arms.branches import Branch
from ....model.arms.orientation import orientation
from ....model.arms.poses import from_rotation_vector
from ....model.robot import Matrix
from .parts import NULL, NUMBER, Edit, JointTarget, Motion, Parsed, PoseTarget, Source, new_number

_JOINT_DECIMALS, _POSE_DECIMALS = {"rad": 8, "deg": 6}, 8
_TEXT = re.compile(r'"[^"\n]*"|#[^\n]*')
_ASSIGNED = re.compile(
    r"^[ \t]*(?:global[ \t]+|local[ \t]+)?(?P<name>\w+)[ \t]*=[ \t]*(?P<value>p?\[[^\]]*\])[ \t]*$",
    re.MULTILINE,
)
_MOVE = re.compile(r"\b(?P<word>movej|movel|movep|movec)\s*\(")
_OTHER_MOTION = re.compile(
    r"\b(?:servoj|servoc|servol|speedj|speedl|optimovej|optimovel|track_conveyor_\w+|path_offset_\w+"
    r"|set_conveyor_\w+)\s*\("
)
_TCP = re.compile(r"\bset_tcp\s*\(")
_ELEMENT = re.compile(rf"\s*(?:(?P<deg>d2r\(\s*)?(?P<value>{NUMBER})(?(deg)\s*\)))\s*")
_INVERSE = re.compile(r"get_inverse_kin\s*\(")


class _Value(NamedTuple):
    """A list of six numbers: where they are, and whether each is in degrees."""

    pose: bool
    spans: list[tuple[int, int]]
    degrees: list[bool]
    line: int


def urscript_head(text: str) -> tuple[int, str]:
    """Where comments at the head of a program are put, and what they begin with."""
    return 0, "# "


def urscript_targets(source: Source) -> Parsed:
    """What is to be corrected in a program."""
    return _Script(source).read()


class _Script:
    def __init__(self, source: Source) -> None:
        self.source, self.parsed = source, Parsed()
        self.bare = _TEXT.sub(lambda found: " " * len(found[0]), source.text)
        self.values: dict[str, _Value] = {}
        self.allowed: set[tuple[int, int]] = set()
        self.used: set[str] = set()
        self.twice: set[str] = set()
        self.tcp: Matrix | None = None

    def read(self) -> Parsed:
        for match in _ASSIGNED.finditer(self.bare):
            value = self._value(match["value"], match.start("value"))
            if value is not None and match["name"] not in self.source.stated.leave:
                self.allowed.add(match.span("name"))
                if match["name"] in self.values:
                    self.twice.add(match["name"])
                self.values[match["name"]] = value
        self._set_tcp()
        routines = [
            found.start() for found in re.finditer(r"^[ \t]*(?:def|thread)\b", self.bare, re.MULTILINE)
        ]
        before = -1
        for move in _MOVE.finditer(self.bare):
            first = before < 0 or any(before < place < move.start() for place in routines)
            self._move(move, first)
            before = move.start()
        self._not_understood()
        return self.parsed

    def _problem(self, place: int, said: str) -> None:
        self.parsed.problems.append((self.source.line(place), said))

    def _value(self, text: str, place: int) -> _Value | None:
        """Six numbers; None where they are not that."""
        pose = text.startswith("p")
        begun = place + (2 if pose else 1)
        spans, degrees = [], []
        for part in text[2 if pose else 1 : -1].split(","):
            found = _ELEMENT.fullmatch(part)
            if found is None:
                return None
            spans.append((begun + found.start("value"), begun + found.end("value")))
            degrees.append(found["deg"] is not None)
            begun += len(part) + 1
        return _Value(pose, spans, degrees, self.source.line(place)) if len(spans) == 6 else None

    def _numbers(self, value: _Value) -> list[float]:
        """Metres and radians."""
        found = [float(self.bare[start:end]) for start, end in value.spans]
        return [math.radians(own) if deg else own for own, deg in zip(found, value.degrees, strict=True)]

    def _set_tcp(self) -> None:
        stated, found = self.source.stated.tools.get(""), []
        for match in _TCP.finditer(self.bare):
            inner = self._argument(match.end())
            value = self._value(inner, match.end()) if inner.startswith("p[") else None
            if value is None:
                self._problem(match.start(), "the TCP is not written in numbers")
                return
            found.append(from_rotation_vector(self._numbers(value)))
            if not np.allclose(found[0], found[-1]) or (
                stated is not None and not np.allclose(stated, found[0])
            ):
                self._problem(match.start(), "there is more than one TCP")
                return
        self.tcp = found[0] if found else stated

    def _argument(self, place: int) -> str:
        return next(self._arguments(place), ("", place))[0]

    def _arguments(self, place: int) -> Iterator[tuple[str, int]]:
        """The arguments of a call, from behind its bracket, each with its place."""
        depth, begun = 0, place
        for i in range(place, len(self.bare)):
            letter = self.bare[i]
            depth += (letter in "[(") - (letter in "])")
            if depth < 0 or (letter == "," and not depth):
                own = self.bare[begun:i]
                yield own.strip(), begun + len(own) - len(own.lstrip())
                begun = i + 1
                if depth < 0:
                    return

    def _move(self, move: re.Match[str], first: bool) -> None:
        word, arguments = move["word"], list(self._arguments(move.end()))
        linear = word != "movej"
        for i, (text, place) in enumerate(arguments[: 2 if word == "movec" else 1]):
            inverse = _INVERSE.match(text)
            near = None
            if inverse is not None and word == "movej":
                inner = list(self._arguments(place + inverse.end()))
                text, place = inner[0]
                if len(inner) > 1:
                    near = self._near(*inner[1])
                    if near is None:
                        return
            name = self._named(text, place)
            line = self.source.line(place)
            if name is None:
                self.parsed.motions.append(Motion(None, line, linear, True))
            elif self._target(name, near):
                self.parsed.motions.append(Motion(name, line, linear, first and not i))

    def _near(self, text: str, place: int) -> Matrix | None:
        """Joints in degrees of the argument qnear, a target itself."""
        name = re.match(r"qnear\s*=\s*", text)
        skip = 0 if name is None else name.end()
        key = self._named(text[skip:], place + skip)
        if key is None or self.values[key].pose or not self._target(key, None):
            self._problem(place, "qnear is not a list of joints in numbers")
            return None
        return np.degrees(self._numbers(self.values[key]))

    def _named(self, text: str, place: int) -> str | None:
        """The key of a target; None where it is left as it is, or is a problem."""
        if text in self.source.stated.leave:
            return None
        value = self._value(text, place) if re.match(r"p?\[.*\]$", text, re.DOTALL) else None
        if value is not None:
            key = f"the target in line {value.line}"
            while key in self.values:
                key += "'"
            self.values[key] = value
            return key
        if text in self.values:
            self.allowed.add((place, place + len(text)))
            self.used.add(text)
            return text
        self._problem(place, f"the target {' '.join(text.split())[:60]} is computed when the program runs")
        return None

    def _target(self, name: str, near: Matrix | None) -> bool:
        """Enter a target; False where it is a problem."""
        if name in self.parsed.targets:
            return True
        value = self.values[name]
        numbers = self._numbers(value)
        if not value.pose:
            self.parsed.targets[name] = JointTarget(
                name, value.line, np.degrees(numbers), lambda joints: self._edits(value, np.radians(joints))
            )
            return True
        if self.tcp is None:
            said = "the TCP is not known; state --tool X,Y,Z,RX,RY,RZ in metres and radians"
            if not any(said == own for _, own in self.parsed.problems):
                self.parsed.problems.append((value.line, said))
            return False
        twin = self.values.get(f"{name[:-2]}_q") if name.endswith("_p") else None
        if near is None and twin is not None and not twin.pose:
            near = np.degrees(self._numbers(twin))

        def write(pose: Matrix, _: Branch | None, __: Matrix) -> list[Edit]:
            turn = np.array(orientation(pose[:3, :3]).rotation_vector)
            return self._edits(
                value, np.array([*pose[:3, 3] / 1000, *_near_turn(turn, np.array(numbers[3:]))])
            )

        self.parsed.targets[name] = PoseTarget(
            name, value.line, from_rotation_vector(numbers), self.tcp, NULL, None, "", write, near
        )
        return True

    def _edits(self, value: _Value, numbers: Matrix) -> list[Edit]:
        edits = []
        for (start, end), deg, new in zip(value.spans, value.degrees, numbers.tolist(), strict=True):
            places = _POSE_DECIMALS if value.pose else _JOINT_DECIMALS["deg" if deg else "rad"]
            own = math.degrees(new) if deg else new
            edits.append(Edit(start, end, new_number(self.source.text[start:end], own, places)))
        return edits

    def _not_understood(self) -> None:
        for found in _OTHER_MOTION.finditer(self.bare):
            self._problem(found.start(), f"{found[0].rstrip('( ')} is a motion that is not understood")
        for found in re.finditer(r"\b[A-Za-z_]\w*", self.bare):
            again = found[0] in self.twice or found.span() not in self.allowed
            if found[0] in self.used and again:
                self.parsed.changed(self.source.line(found.start()), found[0])


def _near_turn(turn: Matrix, old: Matrix) -> Matrix:
    """The rotation vector of the same rotation that is nearest to the old one."""
    angle = float(np.linalg.norm(turn))
    if not angle:
        return turn
    each = [turn, turn * (1 - 2 * np.pi / angle)]
    return min(each, key=lambda own: float(np.linalg.norm(own - old)))
