"""The targets of a RAPID module (ABB)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from ....model.arms.branches import Branch, abb_configuration, is_abb_configuration
from ....model.arms.orientation import orientation
from ....model.arms.poses import from_quaternion
from ....model.robot import Matrix
from ...importers.rapid import DECLARED, without_text
from .parts import NULL, Edit, JointTarget, Motion, Parsed, PoseTarget, Source, number_edits, number_spans

# Of a literal: jointtarget [[6],[6]], robtarget [[3],[4],[4],[6]].
_SIZES = {"jointtarget": 12, "robtarget": 17}
_MOVES = {"moveabsj": 1, "movej": 1, "movel": 1, "movec": 2}
_MOVE = re.compile(r"\b(?P<word>MoveAbsJ|MoveJ|MoveL|MoveC)\b(?P<rest>[^;]*);", re.IGNORECASE)
_OTHER_MOTION = re.compile(
    r"\b(?:Move(?:AbsJ|J|L|C)(?:DO|AO|GO|Sync)|MoveExtJ|MoveLDO|Trigg(?:L|J|C|AbsJ)\w*|Search[LC]|Arc[LC]\w*"
    r"|Disp[LC]\w*|Paint[LCJ]\w*|Spot[LJM]\w*|Cap[LC]|Cont[LC]|EGMMove\w*|EGMRun\w*|IndAMove|IndRMove)\b",
    re.IGNORECASE,
)
_SHIFTS = re.compile(
    r"\b(?:PDispOn|PDispSet|EOffsOn|EOffsSet|CorrCon|SoftAct|WorldAccLim|SingArea\s*\\\s*Wrist"
    r"|Conf[JL]\s*\\\s*Off)\b",
    re.IGNORECASE,
)
_ROUTINE = re.compile(r"\b(?:PROC|FUNC|TRAP)\b", re.IGNORECASE)
_OWN = re.compile(r"\bzb_(?:command|true|offset_deg)\b", re.IGNORECASE)
_NAME = re.compile(r"(?P<name>[A-Za-z]\w*)\s*(?P<index>\{[^{}]*\})?")
_UNUSED = 9e9


def rapid_head(text: str) -> tuple[int, str]:
    """Where comments at the head of a module are put, and what they begin with."""
    found = re.search(
        r"^[ \t]*(?:LOCAL\s+)?MODULE\b[^\n]*\n", without_text(text), re.MULTILINE | re.IGNORECASE
    )
    return (0 if found is None else found.end()), "  ! "


def rapid_targets(source: Source) -> Parsed:
    """What is to be corrected in a module."""
    return _Module(source).read()


class _Module:
    def __init__(self, source: Source) -> None:
        self.source, self.bare, self.parsed = source, without_text(source.text), Parsed()
        self.spans: dict[str, tuple[str, list[tuple[int, int]], int]] = {}  # kind, places of numbers, line
        self.poses: dict[str, Matrix | None] = {}  # of tools and work objects that are declared
        self.arrays: dict[str, list[str]] = {}
        self.allowed: list[tuple[int, int]] = []  # where the name of a target may stand

    def read(self) -> Parsed:
        self._declarations()
        routines = [found.start() for found in _ROUTINE.finditer(self.bare)]
        before = -1
        for move in _MOVE.finditer(self.bare):
            first = any(before < place < move.start() for place in routines) or before < 0
            self._move(move, first)
            before = move.start()
        self._not_understood()
        self._unused()
        return self.parsed

    def _problem(self, place: int, said: str) -> None:
        self.parsed.problems.append((self.source.line(place), said))

    def _declarations(self) -> None:
        for match in DECLARED.finditer(self.bare):
            name, kind = match["name"].lower(), match["kind"].lower()
            self.allowed.append(match.span("name"))
            if kind in ("tooldata", "wobjdata"):
                self.poses[name] = self._frame(match, kind)
                continue
            if name in self.source.stated.leave:
                continue
            spans = number_spans(self.bare, *match.span("value"))
            size, plain = _SIZES[kind], re.fullmatch(r"[\[\]\s,0-9eE+.\-]*", match["value"])
            if plain is None or not spans or len(spans) % size or (not match["sizes"] and len(spans) != size):
                self._problem(match.start(), f"the value of {match['name']} is not written in numbers")
                continue
            elements = range(len(spans) // size)
            keys = [name if match["sizes"] is None else f"{name}{{{i + 1}}}" for i in elements]
            if name in self.spans or name in self.arrays:
                self._problem(match.start(), f"{match['name']} is declared twice")
            if match["sizes"] is not None:
                self.arrays[name] = keys
            for i, key in enumerate(keys):
                self.spans[key] = (
                    kind,
                    spans[size * i : size * (i + 1)],
                    self.source.line(match.start("name")),
                )
                if kind == "jointtarget":
                    self._add_joints(key)

    def _frame(self, match: re.Match[str], kind: str) -> Matrix | None:
        """The pose of a declared tool or work object; None where it is not a fixed one on the arm, or in the
        room."""
        spans = number_spans(self.bare, *match.span("value"))
        values = [float(self.bare[start:end]) for start, end in spans]
        flags = [word.upper() for word in re.findall(r"\b(?:TRUE|FALSE)\b", match["value"], re.IGNORECASE)]
        if kind == "tooldata":
            return from_quaternion(values[:7]) if flags == ["TRUE"] and len(values) >= 7 else None
        unit = re.search(r'"([^"]*)"', self.source.text[slice(*match.span("value"))])
        if flags != ["FALSE", "TRUE"] or len(values) != 14 or unit is None or unit[1]:
            return None
        return from_quaternion(values[:7]) @ from_quaternion(values[7:])

    def _add_joints(self, key: str) -> None:
        _, spans, line = self.spans[key]
        n = self.source.robot.n
        values = [float(self.bare[start:end]) for start, end in spans]
        if any(values[n:6]):
            self.parsed.problems.append(
                (line, f"{self.source.written(key)} has values for joints that the robot does not have")
            )

        def write(joints: Matrix) -> list[Edit]:
            return number_edits(spans[:n], self.source.text, joints.tolist(), [6] * n)

        self.parsed.targets[key] = JointTarget(self.source.written(key), line, np.array(values[:n]), write)

    def _move(self, move: re.Match[str], first: bool) -> None:
        word, linear = move["word"].lower(), move["word"].lower() in ("movel", "movec")
        arguments = list(_arguments(move["rest"], move.start("rest")))
        if arguments and not arguments[0][0]:  # \Conc,
            arguments = arguments[1:]
        count = _MOVES[word]
        if len(arguments) < count + 3:
            self._problem(move.start(), f"{move['word']} is not understood")
            return
        tool, wobj = arguments[count + 2][0], _option(move["rest"], "wobj") or "wobj0"
        for i, (text, place) in enumerate(arguments[:count]):
            names = self._named(text, place, "jointtarget" if word == "moveabsj" else "robtarget")
            if names is None:
                self.parsed.motions.append(Motion(None, self.source.line(place), linear, first))
                continue
            for name in names:
                if word == "moveabsj" or self._use(name, tool, wobj, place):
                    self.parsed.motions.append(
                        Motion(name, self.source.line(place), linear, first and i == 0)
                    )

    def _named(self, text: str, place: int, kind: str) -> list[str] | None:
        """Names of the targets of a motion; None where it is left as it is, or is a problem."""
        name = _NAME.fullmatch(text)
        if text.startswith("["):
            spans = number_spans(self.bare, place, place + len(text))
            if len(spans) == _SIZES[kind] and re.fullmatch(r"[\[\]\s,0-9eE+.\-]*", text):
                line = self.source.line(place)
                key = f"the target in line {line}"
                while key in self.spans:
                    key += "'"
                self.spans[key] = kind, spans, line
                if kind == "jointtarget":
                    self._add_joints(key)
                return [key]
        elif name is not None:
            low, index = name["name"].lower(), name["index"]
            if low in self.source.stated.leave:
                return None
            self.allowed.append((place, place + len(name["name"])))
            if index is not None and low in self.arrays:
                own = f"{low}{{{index[1:-1].strip()}}}"
                return [own] if own in self.spans else self.arrays[low]
            if low in self.spans and self.spans[low][0] == kind:
                return [low]
            self._problem(place, f"{name['name']} is not declared in this file with a value (--leave?)")
            return None
        self._problem(place, f"the target {' '.join(text.split())[:60]} is computed when the program runs")
        return None

    def _use(self, name: str, tool: str, wobj: str, place: int) -> bool:
        """Enter the robtarget as used with a tool and a work object; False where that is a problem."""
        frames = []
        for word, called, stated, none in (
            ("tool", tool, self.source.stated.tools, "tool0"),
            ("work object", wobj, self.source.stated.frames, "wobj0"),
        ):
            low = called.lower()
            frame = stated.get(low, self.poses.get(low, NULL if low == none else stated.get("")))
            if frame is None:
                option = f"{'--tool' if word == 'tool' else '--frame'} {called}"
                self._problem(
                    place,
                    f"the {word} {called} is not known, or not fixed; state {option}=X,Y,Z,Q1,Q2,Q3,Q4",
                )
                return False
            frames.append(frame)
        known = self.parsed.targets.get(name)
        if isinstance(known, PoseTarget):
            if np.allclose(known.tool, frames[0]) and np.allclose(known.frame, frames[1]):
                return True
            self._problem(place, f"{self.source.written(name)} is used with different tools or work objects")
            return False
        return self._add_pose(name, *frames)

    def _add_pose(self, name: str, tool: Matrix, frame: Matrix) -> bool:
        _, spans, line = self.spans[name]
        text = self.source.text
        values = [float(text[start:end]) for start, end in spans]
        turn, stated = values[3:7], tuple(values[7:11])
        if abs(math.hypot(*turn) - 1) > 0.01:
            self.parsed.problems.append(
                (line, f"the orientation of {self.source.written(name)} is not a unit quaternion")
            )
            return False
        if any(value not in (0.0, _UNUSED) for value in values[11:]):
            self.parsed.problems.append(
                (
                    line,
                    f"{self.source.written(name)} has positions of external axes, which may carry the robot",
                )
            )
            return False

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = np.array(orientation(pose[:3, :3]).quaternion)
            new = -new if new @ turn < 0 else new
            edits = number_edits(spans[:7], text, [*pose[:3, 3].tolist(), *new.tolist()], [4] * 3 + [9] * 4)
            if branch is None or is_abb_configuration(stated, branch, joints):
                return edits
            return edits + number_edits(spans[7:11], text, abb_configuration(branch, joints), [0] * 4)

        self.parsed.targets[name] = PoseTarget(
            self.source.written(name),
            line,
            from_quaternion(values[:7]),
            tool,
            frame,
            lambda branch, joints: is_abb_configuration(stated, branch, joints),
            f"[{','.join(f'{value:g}' for value in stated)}]",
            write,
        )
        return True

    def _not_understood(self) -> None:
        for pattern, said in (
            (_OTHER_MOTION, "{} is a motion that is not understood"),
            (_SHIFTS, "{}: the arm is then not where the targets say, or its configuration not theirs"),
            (_OWN, "{}: the module of zerobeam export rapid would correct a second time"),
        ):
            for found in pattern.finditer(self.bare):
                self._problem(found.start(), said.format(" ".join(found[0].split())))
        names = {re.sub(r"\{.*", "", name) for name in self.spans}
        allowed = set(self.allowed)
        for found in re.finditer(r"\b[A-Za-z]\w*", self.bare):
            low = found[0].lower()
            assigned = low in self.poses and re.match(r"[\w.]*\s*:=", self.bare[found.end() :])
            if (low in names or assigned) and found.span() not in allowed:
                self.parsed.changed(self.source.line(found.start()), found[0])

    def _unused(self) -> None:
        for name, (kind, _, line) in self.spans.items():
            if kind == "robtarget" and name not in self.parsed.targets:
                said = "is not the target of a motion here, so that its tool is not known (--leave?)"
                if not self.parsed.speaks_of(line, name):
                    self.parsed.problems.append((line, f"{self.source.written(name)} {said}"))


def _arguments(text: str, place: int) -> Iterator[tuple[str, int]]:
    r"""The arguments of an instruction without their options (\…), each with its place."""
    depth, begun = 0, 0
    for i, letter in enumerate(text + ","):
        depth += (letter in "[({") - (letter in "])}")
        if letter == "," and not depth:
            own = text[begun:i].split("\\")[0]
            yield own.strip(), place + begun + len(own) - len(own.lstrip())
            begun = i + 1


def _option(text: str, name: str) -> str | None:
    found = re.search(rf"\\\s*{name}\s*:=\s*(\w+)", text, re.IGNORECASE)
    return None if found is None else str(found[1])
