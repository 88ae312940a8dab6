"""The targets of a URScript program (Universal Robots), its statements and its lists of six numbers."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from lark import Token, Tree

from ....model.arrays import Matrix
from ....model.kinematics.branches import Branch
from ....model.kinematics.orientation import from_rotation_vector, orientation
from ..maker import blanked
from ..program_parts import (
    NULL,
    NUMBER,
    Edit,
    JointTarget,
    Language,
    LiteralSpan,
    Motion,
    Parsed,
    PoseTarget,
    Source,
    new_number,
    span,
    understood,
)

_REMARK = r"#[^\n]*"
_ELEMENT = re.compile(rf"\s*(?:(?P<deg>d2r\s*\(\s*)?(?P<value>{NUMBER})(?(deg)\s*\)))\s*")
_POSE = re.compile(r"(?<!\w)p\s*\Z")
_PAIRS = {")": "(", "]": "["}


class Value(NamedTuple):
    """Six numbers: whether they are a pose (else joints), where they begin and end, where each is, and
    whether it is in degrees."""

    pose: bool
    start: int
    end: int
    spans: list[tuple[int, int]]
    degrees: list[bool]

    def numbers(self, text: str) -> list[float]:
        """Metres and radians."""
        values = [float(text[start:end]) for start, end in self.spans]
        return [
            math.radians(value) if deg else value for value, deg in zip(values, self.degrees, strict=True)
        ]


def statements_of(bare: str) -> Iterator[tuple[int, int]]:
    """The places of the statements, each a line, or several where a bracket is open at its end."""
    start, depth = 0, 0
    for line in re.finditer(r"[^\n]*(?:\n|\Z)", bare):
        depth += sum(line[0].count(letter) for letter in "([") - sum(line[0].count(letter) for letter in ")]")
        if depth <= 0 or line.end() == len(bare):
            statement = bare[start : line.end()]
            if statement.strip():
                yield line.end() - len(statement.lstrip()), line.end()
            start, depth = line.end(), 0


def value_at(bare: str, start: int, end: int) -> Value | None:
    """The value that a text is, `p[…]` or `[…]`; None where it is not six numbers."""
    opening = bare.index("[", start)
    begin, spans, degrees = opening + 1, [], []
    for part in bare[opening + 1 : end - 1].split(","):
        match = _ELEMENT.fullmatch(part)
        if match is None:
            return None
        spans.append((begin + match.start("value"), begin + match.end("value")))
        degrees.append(match["deg"] is not None)
        begin += len(part) + 1
    return Value(bare[start] == "p", start, end, spans, degrees) if len(spans) == 6 else None


def urscript_literals(text: str) -> list[tuple[int, int]]:
    """The places of all `p[…]`, and of all lists of six numbers."""
    bare, opened, literals = blanked(text, _REMARK), [], []
    for bracket in re.finditer(r"[\[\]()]", bare):
        if bracket[0] in "[(":
            opened.append(bracket)
        elif opened and opened[-1][0] == _PAIRS[bracket[0]]:
            start = opened.pop().start()
            pose = _POSE.search(bare, max(0, start - 9), start)
            if bracket[0] == "]" and pose is not None:
                literals.append((pose.start(), bracket.end()))
            elif bracket[0] == "]" and value_at(bare, start, bracket.end()) is not None:
                literals.append((start, bracket.end()))
    return literals


_JOINT_DECIMALS, _POSE_DECIMALS = {"rad": 8, "deg": 6}, 8
_FARTHEST = 1e4  # m or rad: no position has more
_HARMLESS = "states that it moves no arm and changes no tool, frame or position"
_OTHER = "this statement is not understood"
_REASONS = (  # why the grammar does not derive a statement that has these words
    (r"\bmovec\b", "movec ignores the orientation of its first pose, which the correction needs; use movep"),
    (r"\bset_tcp\b", "the TCP is not written in numbers"),
    (r"\bmove[jlp]\b", "its target is computed when the program runs (--leave?)"),
    (
        r"\b(?:servo|speed|force|freedrive|path_offset|\w*conveyor)\w*",
        "{} is a motion that is not understood",
    ),
)
_OPENING = ("define", "thread", "if", "while")
_JOINS = ("define", "thread", "elif", "else", "while", "end", "leaving")  # reached from elsewhere
_FORM = "X,Y,Z,RX,RY,RZ in metres and radians"


def urscript_targets(source: Source) -> Parsed:
    """The targets, motions and problems of a program."""
    return _Script(source).read()


@dataclass(frozen=True)
class _Statement:
    """`blocks` are the numbers of the statements that open the blocks around it, the outermost first."""

    number: int
    line: int
    start: int
    written: str
    tree: Tree[Token]
    blocks: tuple[int, ...]

    @property
    def kind(self) -> str:
        return str(self.tree.data)


class _Script:
    def __init__(self, source: Source) -> None:
        self.source, self.facts, self.parsed = source, source.facts, Parsed()
        self.bare = blanked(source.text, _REMARK)
        self.statements = list(self._statements())
        self.routines = self._named("define")
        self.threads = self._named("thread")
        self.values: dict[str, tuple[Value, _Statement]] = {}  # names that are a literal
        self.known: set[int] = set()  # places at which such a name may be
        self.tcp: Matrix | None = None
        self.tcp_known = False
        self.first = True

    def read(self) -> Parsed:
        for statement in self.statements:
            if statement.kind == "assignment":
                self._assigned(statement)
        self._set_tcp()
        moving = self._moving()
        for statement in self.statements:
            self._calls(statement, moving)
            if statement.kind == "motion":
                self._motion(statement)
            elif statement.kind == "payload":
                self._payload(statement)
            elif statement.kind in _JOINS:
                self.first = True
        self._rest()
        return self.parsed

    def _problem(self, line: int, sentence: str) -> None:
        self.parsed.problems.append((line, sentence))

    # The statements

    def _statements(self) -> Iterator[_Statement]:
        code, opened = blanked(self.source.text, _REMARK, strings=False), list[tuple[int, str]]()
        for number, (start, end) in enumerate(statements_of(self.bare)):
            line, tree = (
                self.source.line(start),
                understood("universal_robots/urscript", "statement", code, start, end),
            )
            written = " ".join(code[start:end].split())
            shown = written if len(written) < 60 else f"{written[:57]}..."
            if tree is None:
                words = ((re.search(pattern, written), reason) for pattern, reason in _REASONS)
                known = (reason.format(word[0]) for word, reason in words if word is not None)
                self._problem(line, f"{shown}: {next(known, _OTHER)}")
                continue
            inner = tree.children[0]
            assert isinstance(inner, Tree)
            kind = str(inner.data)
            if kind in ("elif", "else", "end") and (not opened or (kind != "end" and opened[-1][1] != "if")):
                self._problem(line, f"{shown}: the block that it belongs to does not begin")
                continue
            if kind == "end":
                opened.pop()
            yield _Statement(number, line, start, shown, inner, tuple(block for block, _ in opened))
            if kind in _OPENING:
                opened.append((number, kind))
        if opened:
            self._problem(self.source.line(len(self.bare)), "a block has no end")

    def _named(self, kind: str) -> dict[str, int]:
        """The numbers of the statements that define routines, by name."""
        numbers: dict[str, int] = {}
        for statement in self.statements:
            if statement.kind == kind:
                name = str(statement.tree.children[0])
                call = understood("universal_robots/urscript", "call", f"{name}()", 0, len(name) + 2)
                if name in numbers or call is None or getattr(call.children[0], "type", "") != "NAME":
                    self._problem(
                        statement.line, f"{name} is defined twice, or is an instruction of the language"
                    )
                numbers[name] = statement.number
        return numbers

    def _kinds(self, statement: _Statement) -> set[str]:
        """The kinds of the blocks around a statement."""
        return {each.kind for each in self.statements if each.number in statement.blocks}

    def _called(self, statement: _Statement) -> list[str]:
        """The names of the routines that are not of the language."""
        calls = [call.children[0] for call in statement.tree.find_data("call")]
        return [str(name) for name in calls if isinstance(name, Token) and name.type == "NAME"]

    def _moving(self) -> set[str]:
        """The routines of the program that move the arm or set the TCP, also by others."""
        doing = {
            name: [each for each in self.statements if number in each.blocks]
            for name, number in self.routines.items()
        }
        moving: set[str] = set()
        for _ in doing:
            moving |= {
                name
                for name, inside in doing.items()
                if any(each.kind in ("motion", "tcp") or moving & set(self._called(each)) for each in inside)
            }
        return moving

    def _calls(self, statement: _Statement, moving: set[str]) -> None:
        """Problems of what a statement calls."""
        in_thread = "thread" in self._kinds(statement)
        if in_thread and (statement.kind in ("motion", "tcp") or moving & set(self._called(statement))):
            self._problem(statement.line, f"{statement.written}: a thread moves the arm, or sets its TCP")
        started = [str(run.children[0]) for run in statement.tree.find_data("run")]
        for name in self._called(statement):
            if name in self.routines:
                self.first = True
            else:
                started.append(name)
        for name in started:
            if name not in self.threads and not self.facts.harmless(name):
                self._problem(
                    statement.line,
                    f"{statement.written}: what {name} does is not known; --call {name} {_HARMLESS}",
                )

    # Literals

    def _literal(self, child: Token | Tree[Token]) -> Value | None:
        """The value of `p[…]` or `[…]`; None where it is another expression, or no six numbers."""
        if not isinstance(child, Tree) or child.data not in ("pose", "list"):
            return None
        value = value_at(self.bare, child.meta.start_pos, child.meta.end_pos)
        if value is not None and max(map(abs, value.numbers(self.bare))) > _FARTHEST:
            self._problem(self.source.line(value.start), "this has a number that no position has")
            return None
        return value

    def _assigned(self, statement: _Statement) -> None:
        """A name that is a literal."""
        name = next(child for child in statement.tree.children if getattr(child, "type", "") == "NAME")
        assert isinstance(name, Token)
        value = self._literal(statement.tree.children[-1])
        if value is None:
            if getattr(statement.tree.children[-1], "data", "") == "pose":
                self._problem(
                    statement.line, f"{statement.written}: a pose is computed when the program runs"
                )
        elif self.facts.leaves(str(name)):
            self.parsed.literals.append(LiteralSpan(value.start, value.end, "left"))
        elif name in self.values:
            self.parsed.changed(statement.line, str(name))
        else:
            self.values[str(name)] = value, statement
            self.known.add(span(name)[0])

    def _set_tcp(self) -> None:
        """The TCP of all poses: set as a literal before all motions, or stated."""
        settings = [statement for statement in self.statements if statement.kind == "tcp"]
        poses = []
        for statement in settings:
            value = self._literal(statement.tree.children[1])
            if value is None:
                self._problem(statement.line, f"{statement.written}: the TCP is not written in numbers")
                return
            self.parsed.literals.append(LiteralSpan(value.start, value.end, "frame"))
            poses.append(from_rotation_vector(value.numbers(self.bare)))
        if not poses:
            return
        self.tcp_known, begin = True, settings[0]
        before = [each for each in self.statements if each.number < begin.number]
        behind = [each for each in self.statements if each.kind == "motion"]
        fixed = (
            self._kinds(begin) <= {"define"}
            and not any(
                each.kind == "motion" or set(self._called(each)) & set(self.routines) for each in before
            )
            and all(each.blocks[: len(begin.blocks)] == begin.blocks for each in behind)
        )
        self.tcp = self.facts.tool("", poses[0] if fixed else None)
        if self.tcp is None:
            self._problem(
                begin.line,
                f"{begin.written}: the TCP is set after a motion, in a branch or in another routine, so that"
                " the TCP of a pose is not known; set it before all motions",
            )
        elif not all(np.allclose(self.tcp, pose) for pose in poses):
            other = next(
                each for each, pose in zip(settings, poses, strict=True) if not np.allclose(self.tcp, pose)
            )
            self._problem(other.line, f"{other.written}: there is more than one TCP")

    def _payload(self, statement: _Statement) -> None:
        """The inertia of a payload has six numbers."""
        for argument in statement.tree.find_data("argument"):
            value = self._literal(argument.children[-1])
            if value is not None:
                self.parsed.literals.append(LiteralSpan(value.start, value.end, "frame"))

    # Motions

    def _motion(self, statement: _Statement) -> None:
        word, target = statement.tree.children[:2]
        linear, near = word != "movej", None
        if isinstance(target, Tree) and target.data == "inverse":
            _, target, *others = target.children
            if linear:
                self._problem(statement.line, f"{statement.written}: {word} takes a pose here, and no joints")
                return
            if others:
                near = self._near(others[-1], statement)
                if near is None:
                    self._problem(
                        statement.line, f"{statement.written}: qnear is not a list of joints in numbers"
                    )
                    return
        if isinstance(target, Token) and target.type == "NAME" and self.facts.leaves(str(target)):
            self.parsed.motions.append(Motion(None, statement.line, False, True))
            return
        key, value = self._key(target, statement)
        if key is None or value is None:
            sentence = "its target is computed when the program runs, or is another one by then (--leave?)"
            self._problem(statement.line, f"{statement.written}: {sentence}")
        elif not value.pose and (linear or statement.tree.children[1] is not target):
            self._problem(
                statement.line,
                f"{statement.written}: only the pose of these joints counts here, in any configuration that"
                " the arm has; write the pose, or movej to the joints",
            )
        elif self._enter(key, value):
            self.parsed.motions.append(Motion(key, statement.line, linear, self.first, near=near))
            self.first = False
            return
        self.first = True

    def _key(self, child: Token | Tree[Token], statement: _Statement) -> tuple[str | None, Value | None]:
        """The name of a target in this statement, and its value."""
        if isinstance(child, Token) and child.type == "NAME" and child in self.values:
            value, assigned = self.values[str(child)]
            inside = statement.blocks[: len(assigned.blocks)] == assigned.blocks
            if self._kinds(assigned) <= {"define"} or (inside and assigned.number < statement.number):
                self.known.add(span(child)[0])
                return str(child), value
            return None, None
        value_here = self._literal(child)
        if value_here is None:
            return None, None
        return self.source.key_at(value_here.start, self.parsed.targets), value_here

    def _near(self, child: Token | Tree[Token], statement: _Statement) -> Matrix | None:
        """Joints in degrees of the argument qnear, a target itself."""
        key, value = self._key(child, statement)
        if key is None or value is None or value.pose or not self._enter(key, value):
            return None
        return np.degrees(value.numbers(self.bare))

    def _enter(self, name: str, value: Value) -> bool:
        """Enter a target; False where it is a problem."""
        if name in self.parsed.targets:
            return True
        if value.pose and not self.tcp_known:
            self.tcp_known, self.tcp = True, self.facts.tool("")
            if self.tcp is None:
                request = self.facts.require("--tool", "", _FORM)
                self._problem(self.source.line(value.start), f"the TCP is not known; {request}")
        if value.pose and self.tcp is None:
            return False
        numbers, line = value.numbers(self.bare), self.source.line(value.start)
        self.parsed.literals.append(LiteralSpan(value.start, value.end, "target"))
        if not value.pose:
            self.parsed.targets[name] = JointTarget(
                name, line, np.degrees(numbers), lambda joints: self._edits(value, np.radians(joints))
            )
            return True
        assert self.tcp is not None

        def write(pose: Matrix, _: Branch | None, __: Matrix) -> list[Edit]:
            turn = np.array(orientation(pose[:3, :3]).rotation_vector)
            vector = _near_turn(turn, np.array(numbers[3:]))
            return self._edits(value, np.array([*pose[:3, 3] / 1000, *vector]))

        self.parsed.targets[name] = PoseTarget(
            name, line, from_rotation_vector(numbers), self.tcp, NULL, None, "", write
        )
        return True

    def _edits(self, value: Value, numbers: Matrix) -> list[Edit]:
        edits = []
        for (start, end), deg, new in zip(value.spans, value.degrees, numbers.tolist(), strict=True):
            decimals = _POSE_DECIMALS if value.pose else _JOINT_DECIMALS["deg" if deg else "rad"]
            shown = math.degrees(new) if deg else new
            edits.append(Edit(start, end, new_number(self.source.text[start:end], shown, decimals)))
        return edits

    def _rest(self) -> None:
        """Names that are literals, where they are used otherwise, and those that no motion uses."""
        for statement in self.statements:
            for token in statement.tree.scan_values(lambda token: isinstance(token, Token)):
                assert isinstance(token, Token)
                if token.type == "NAME" and token in self.values and span(token)[0] not in self.known:
                    self.parsed.changed(statement.line, str(token))
        for name, (value, statement) in self.values.items():
            if name not in self.parsed.targets and not self.parsed.speaks_of(statement.line, name):
                if value.pose:
                    self._problem(
                        statement.line, f"{name} is not the target of a motion here (--leave {name}?)"
                    )
                else:
                    self._enter(name, value)


def _near_turn(turn: Matrix, old: Matrix) -> Matrix:
    """The rotation vector of the same rotation that is nearest to the old one."""
    angle = float(np.linalg.norm(turn))
    if not angle:
        return turn
    each = [turn, turn * (1 - 2 * np.pi / angle)]
    return min(each, key=lambda vector: float(np.linalg.norm(vector - old)))


URSCRIPT = Language(
    "URScript",
    urscript_targets,
    r"\A",
    "# ",
    from_rotation_vector,
    "X,Y,Z,RX,RY,RZ in metres and radians",
    urscript_literals,
    case_sensitive=True,
)
