"""The targets, tools and work objects of a RAPID module."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from lark import Token, Tree

from ....model.arrays import Matrix
from ....model.kinematics.branches import Branch, abb_configuration, is_abb_configuration
from ....model.kinematics.orientation import from_quaternion, orientation
from ..program_parts import (
    NULL,
    Edit,
    JointTarget,
    LiteralSpan,
    Parsed,
    PoseTarget,
    Source,
    number_edits,
    span,
    understood,
)
from .rapid_statements import rapid_literals, tokens, trees

TARGETS = ("jointtarget", "robtarget")
FRAMES = ("tooldata", "wobjdata")
_UNUSED = 9e9  # of an external axis
_FARTHEST = 1e5  # mm, deg

Node = Tree[Token] | Token


class _Literal(NamedTuple):
    """A target that is written in numbers, at `spans` of the text."""

    kind: str
    name: str
    line: int
    spans: list[tuple[int, int]]
    values: list[float]


class Positions:
    """Targets, tools and frames that a module declares and uses. `names` (in small letters) are those of all
    data that hold a position, a tool or a frame, here or in another file."""

    def __init__(self, source: Source, bare: str, parsed: Parsed) -> None:
        self.source, self.bare, self.parsed = source, bare, parsed
        self.names = {"tool0", "wobj0"}
        self._declared: set[str] = set()
        self._literals: dict[str, _Literal] = {}
        self._arrays: dict[str, list[str]] = {}
        self._frames: dict[str, Matrix | None] = {}  # None for one that moves
        self._external: list[_Literal] = []
        self._spans = rapid_literals(source.text)

    def problem(self, pos: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(pos), sentence))

    def claim(self, start: int, end: int, use: Literal["frame", "left"]) -> None:
        """All literals in a part of the text, found without the grammar, are understood."""
        self.parsed.literals += [
            LiteralSpan(*literal, use) for literal in self._spans if start <= literal[0] < end
        ]

    def has_literals(self, start: int, end: int) -> bool:
        return any(start <= literal[0] < end for literal in self._spans)

    def left(self, name: str) -> bool:
        return self.source.facts.leaves(name.lower(), name)

    def declare(self, kind: str, name: Token, sizes: Sequence[Node] | None, value: Node | None) -> None:
        """Data of a type that holds a position, a tool or a frame."""
        low, pos = name.lower(), span(name)[0]
        self.names.add(low)
        if low in self._declared:
            self.problem(pos, f"{name} is declared twice")
        self._declared.add(low)
        if kind in FRAMES:
            if value is not None:
                self._declare_frame(kind, name, sizes, value)
        elif self.left(name):
            self.claim(pos, pos if value is None else span(value)[1], "left")
        elif kind in TARGETS:
            if value is not None:
                self._declare_targets(kind, name, sizes, value)
        elif value is not None:
            self.problem(
                pos, f"{name} is a {kind}, which is not corrected, and neither is what is computed from it"
            )

    def _declare_targets(self, kind: str, name: Token, sizes: Sequence[Node] | None, value: Node) -> None:
        low, pos = name.lower(), span(name)[0]
        literals = self._written(kind, value)
        if literals is None:
            self.problem(pos, f"the value of {name} is not written in numbers")
            return
        if sizes is None:
            keys = [""]
        else:
            counts = [int(size) if isinstance(size, Token) and size.isdigit() else 0 for size in sizes]
            keys = [
                "{" + ",".join(map(str, index)) + "}"
                for index in product(*(range(1, count + 1) for count in counts[:3]))
            ][: len(literals) + 1]
        if len(keys) != len(literals):
            self.problem(pos, f"the value of {name} has another size than {name}")
            return
        if sizes is not None:
            self._arrays[low] = [low + key for key in keys]
        for key, literal in zip(keys, literals, strict=True):
            self._enter(low + key, kind, name + key, self.source.line(pos), literal)

    def _written(self, kind: str, value: Node) -> list[Tree[Token]] | None:
        tree = understood("abb/rapid", f"{kind}s", self.bare, *span(value))
        return None if tree is None else sorted(tree.find_data(kind), key=lambda each: each.meta.start_pos)

    def _enter(self, key: str, kind: str, name: str, line: int, tree: Tree[Token]) -> None:
        spans = [span(number) for number in tokens(tree)]
        values = [float(self.bare[slice(*number_span)]) for number_span in spans]
        literal = self._literals[key] = _Literal(kind, name, line, spans, values)
        self.parsed.literals.append(LiteralSpan(*span(tree), "target"))
        external = 6 if kind == "jointtarget" else 11
        if not all(abs(value) < _FARTHEST for value in values[:external]):
            self.parsed.problems.append((line, f"a number of {name} is too large"))
            values[:external] = [0.0] * 3 + [1.0] + [0.0] * (external - 4)
        if any(value not in (0.0, _UNUSED) for value in values[external:]):
            self._external.append(literal)
        if kind == "jointtarget":
            n = self.source.robot.n

            def write(joints: Matrix) -> list[Edit]:
                return number_edits(spans[:n], self.source.text, joints.tolist(), [6] * n)

            self.parsed.targets[key] = JointTarget(name, line, np.array(values[:n]), write)

    def _declare_frame(self, kind: str, name: Token, sizes: Sequence[Node] | None, value: Node) -> None:
        tree = understood("abb/rapid", kind, self.bare, *span(value))
        if tree is None or sizes is not None:
            self.problem(span(name)[0], f"the value of {name} is not written in numbers")
            return
        self.claim(*span(value), "frame")
        words = [word.upper() for word in tokens(tree) if word.type != "NUMBER"]
        fixed = words[:1] == ["TRUE"] if kind == "tooldata" else words == ["FALSE", "TRUE", '""']
        poses = [[float(number) for number in tokens(each)] for each in tree.find_data("pose")]
        if not all(np.all(np.abs(pose) < _FARTHEST) and _is_unit(pose[3:]) for pose in poses):
            self.problem(span(name)[0], f"{name} is no pose: a number too large, or no unit quaternion")
            return
        frame = NULL
        for each in sorted(tree.find_data("pose"), key=lambda each: each.meta.start_pos):
            frame = frame @ from_quaternion([float(number) for number in tokens(each)])
        self._frames[name.lower()] = frame if fixed else None

    def named(self, target: Node, kind: str) -> list[str] | None:
        """Names of the targets of a motion; None where it is left as it is, or is a problem."""
        start, end = span(target)
        if isinstance(target, Tree) and target.data == "aggregate":
            literals = self._written(kind, target)
            if literals is not None and len(literals) == 1 and span(literals[0]) == (start, end):
                key = self.source.key_at(start, self._literals)
                self._enter(key, kind, key, self.source.line(start), literals[0])
                return [key]
        elif isinstance(target, Tree) and target.data == "reference":
            return self._referred(target, kind)
        self.problem(
            start,
            f"the target {' '.join(self.bare[start:end].split())[:60]} is computed when the program runs",
        )
        return None

    def _referred(self, target: Tree[Token], kind: str) -> list[str] | None:
        name, parts = tokens(target)[0], trees(target)
        low = name.lower()
        self.names.add(low)
        if self.left(name):
            return None
        text = "".join(self.bare[slice(*span(target))].split()).lower()
        if [part.data for part in parts] == ["index"] and low in self._arrays:
            names = [text] if text in self._literals else self._arrays[low]
            if self._literals[names[0]].kind == kind and (
                text in self._literals or not text[len(low) + 1 : -1].isdigit()
            ):
                return names
        elif low in self._literals and self._literals[low].kind == kind and not parts:
            return [low]
        self.problem(span(target)[0], f"{name} is not declared in this file with a value (--leave?)")
        return None

    def use(self, name: str, tool: Token, wobj: Token | None) -> bool:
        """Enter a robtarget as used with a tool and a work object; False where that is a problem."""
        facts, pos = self.source.facts, span(tool)[0]
        world = facts.frame("wobj0", None if "wobj0" in facts.frames else NULL)
        in_flange = self._frame(tool, "tool")
        in_world = NULL if wobj is None or wobj.lower() == "wobj0" else self._frame(wobj, "work object")
        if in_flange is None or in_world is None:
            return False
        assert world is not None
        frame = world @ in_world
        known = self.parsed.targets.get(name)
        if isinstance(known, PoseTarget):
            if np.allclose(known.tool, in_flange) and np.allclose(known.frame, frame):
                return True
            self.problem(pos, f"{self._literals[name].name} is used with different tools or work objects")
            return False
        return self._add_pose(name, in_flange, frame)

    def _frame(self, name: Token, what: Literal["tool", "work object"]) -> Matrix | None:
        facts, low = self.source.facts, name.lower()
        self.names.add(low)
        if low in self._frames and self._frames[low] is None:
            where = "is not held by the robot" if what == "tool" else "moves"
            self.problem(span(name)[0], f"the {what} {name} {where}, so that its targets cannot be corrected")
            return None
        declared = NULL if low == "tool0" else self._frames.get(low)
        frame = facts.tool(low, declared) if what == "tool" else facts.frame(low, declared)
        if frame is None:
            option: Literal["--tool", "--frame"] = "--tool" if what == "tool" else "--frame"
            request = facts.require(option, str(name), "X,Y,Z,Q1,Q2,Q3,Q4")
            self.problem(span(name)[0], f"the {what} {name} is not known; {request}")
        return frame

    def _add_pose(self, key: str, tool: Matrix, frame: Matrix) -> bool:
        _, name, line, spans, values = self._literals[key]
        text, turn = self.source.text, values[3:7]
        configuration = (values[7], values[8], values[9], values[10])
        if not _is_unit(turn):
            self.parsed.problems.append((line, f"the orientation of {name} is not a unit quaternion"))
            return False

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = np.array(orientation(pose[:3, :3]).quaternion)
            new = -new if new @ turn < 0 else new
            edits = number_edits(spans[:7], text, [*pose[:3, 3].tolist(), *new.tolist()], [4] * 3 + [9] * 4)
            if branch is None or is_abb_configuration(configuration, branch, joints):
                return edits
            return edits + number_edits(spans[7:11], text, abb_configuration(branch, joints), [0] * 4)

        self.parsed.targets[key] = PoseTarget(
            name,
            line,
            from_quaternion(values[:7]),
            tool,
            frame,
            lambda branch, joints: is_abb_configuration(configuration, branch, joints),
            f"[{','.join(f'{value:g}' for value in configuration)}]",
            write,
        )
        return True

    def finish(self) -> None:
        """Problems that all motions together show."""
        poses = any(isinstance(target, PoseTarget) for target in self.parsed.targets.values())
        for literal in self._external:
            if literal.kind == "robtarget" or poses:
                self.parsed.problems.append(
                    (
                        literal.line,
                        f"{literal.name} has positions of external axes, which may carry the robot",
                    )
                )
        for key, literal in self._literals.items():
            if literal.kind == "robtarget" and key not in self.parsed.targets:
                unused = "is not the target of a motion here, so that its tool is not known (--leave?)"
                if not self.parsed.speaks_of(literal.line, literal.name):
                    self.parsed.problems.append((literal.line, f"{literal.name} {unused}"))


def _is_unit(quaternion: Sequence[float]) -> bool:
    return abs(math.hypot(*quaternion) - 1) <= 0.01
