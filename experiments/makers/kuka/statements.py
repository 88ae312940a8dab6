"""The statements of a KRL module (KUKA), its .src and its .dat as one text, and what its names are.

A line is one statement. What the grammar does not derive is a problem with its line.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from lark import Token, Tree

from ....model.arrays import Matrix
from ....model.kinematics.orientation import from_abc
from ..program_parts import LiteralSpan, Parsed, Source, span, understood

POSE = ("X", "Y", "Z", "A", "B", "C")
SCALARS = {"INT", "REAL", "BOOL", "CHAR"}
POSITIONS = {"POS", "E3POS", "E6POS", "FRAME", "AXIS", "E3AXIS", "E6AXIS"}
# Instructions of the controller that move no arm and change no frame.
BUILT_IN = {
    *("PULSE", "IR_STOPM", "ABS", "SQRT", "SIN", "COS", "TAN", "ACOS", "ATAN2", "VARSTATE"),
    *("STRLEN", "STRDECLLEN", "STRCLEAR", "STRADD", "STRFIND", "STRCOMP", "STRCOPY"),
}
_CAPITALS = str.maketrans("abcdefghijklmnopqrstuvwxyz", "ABCDEFGHIJKLMNOPQRSTUVWXYZ")
_BLANKED = re.compile(r'"[^"\n]*"|;[^\n]*')
_AGGREGATE = re.compile(r"\{[^{}]*\}")
_OF_POSE = re.compile(r"[{,:]\s*(?:[XYZABC]|A[1-6])(?![A-Z0-9_$])")
_HINTS = (
    (re.compile(r"\s*S?(?:PTP|LIN|CIRC|SPL)_REL\b"), "a relative motion cannot be corrected"),
    (re.compile(r".*#TCP\b"), "the tool is fixed in the room (#TCP), which is not understood"),
    (re.compile(r"\s*S?CIRC\b.*,\s*CA\b"), "the end of a circle with an angle (CA) cannot be corrected"),
    (
        re.compile(r"\s*(?:S?PTP|S?LIN|S?CIRC|SPL)\b"),
        "the target is computed when it runs, or an option is not understood",
    ),
    (
        re.compile(r"\s*(?:SPLINE\b.*)?\$?(?:TOOL|BASE|ROBROOT|WORLD)(?:_DATA)?\b"),
        "a tool or a base is computed or changed in part; state all its six numbers, or TOOL_DATA[…],"
        " BASE_DATA[…]",
    ),
)


def bare(text: str) -> str:
    """The text in capitals, with blanks for its comments, and the letters of its strings as `_`."""

    def blanked(match: re.Match[str]) -> str:
        inner = len(match[0]) - 2
        return '"' + "_" * inner + '"' if match[0][0] == '"' else " " * len(match[0])

    return _BLANKED.sub(blanked, text).translate(_CAPITALS)


def krl_literals(text: str) -> list[tuple[int, int]]:
    """The places of all aggregates that state X, Y, Z, A, B, C or an axis of the robot."""
    code = bare(text)
    return [match.span() for match in _AGGREGATE.finditer(code) if _OF_POSE.search(match[0])]


class KrlStatement(NamedTuple):
    """A line that is understood: its derivation, with places in the whole text."""

    pos: int
    tree: Tree[Token]

    @property
    def kind(self) -> str:
        return str(self.tree.data)

    def names(self) -> list[str]:
        """The names among its tokens, without those of its parts."""
        return [str(each) for each in self.tree.children if isinstance(each, Token) and each.type == "NAME"]


def statements(source: Source, parsed: Parsed) -> list[KrlStatement]:
    """All that are understood; the others are problems."""
    text, rows, pos = bare(source.text), [], 0
    if (lone := re.search(r"\r(?!\n)", source.text)) is not None:
        parsed.problems.append((source.line(lone.start()), "a line ends by a carriage return alone"))
    for line in text.split("\n"):
        if line.strip():
            tree = understood("kuka/krl", "statement", text, pos, pos + len(line))
            if tree is None:
                shown = " ".join(source.text[pos : pos + len(line)].split(";")[0].split())[:60]
                parsed.problems.append((source.line(pos), f"{shown}: {_why(line)}"))
            else:
                rows.append(KrlStatement(pos, tree))
        pos += len(line) + 1
    return rows


def _why(line: str) -> str:
    for pattern, sentence in _HINTS:
        if pattern.match(line):
            return sentence
    return "this statement is not understood, so that it may move the arm or change a frame or a target"


Fields = dict[str, "Token | Tree[Token]"]


def fields(aggregate: Tree[Token]) -> Fields | None:
    """The components of an aggregate by name; None where one is there twice."""
    result: Fields = {}
    for component in aggregate.children:
        if isinstance(component, Tree):
            name = str(component.children[0])
            if name in result:
                return None
            result[name] = component.children[1]
    return result


def number(value: Token | Tree[Token] | None) -> float | None:
    """A finite number; None of anything else."""
    if not isinstance(value, Token) or value.type != "SIGNED":
        return None
    result = float(value)
    return result if np.isfinite(result) else None


def whole(value: Token | Tree[Token] | None) -> int | None:
    """A number without decimals, or bits."""
    if isinstance(value, Token) and value.type == "BITS":
        return int(value[2:-1], 2 if value[1] == "B" else 16)
    if isinstance(value, Token) and value.type == "NUMBER":
        return int(value) if value.isdecimal() else None
    result = number(value)
    return int(result) if result is not None and result == int(result) else None


def pose_of(aggregate: Tree[Token]) -> Matrix | None:
    """(4, 4) of a frame that is stated as a whole, in numbers."""
    parts = fields(aggregate)
    values = [number(parts.get(name)) for name in POSE] if parts is not None else []
    if parts is None or set(parts) != set(POSE) or None in values:
        return None
    return from_abc([value for value in values if value is not None])


@dataclass(frozen=True, eq=False)
class Position:
    """A literal position: of a name, or that of a motion (which has none)."""

    key: str
    aggregate: Tree[Token]
    fields: Fields

    @property
    def pos(self) -> int:
        return span(self.aggregate)[0]

    @property
    def axes(self) -> bool:
        return any(re.fullmatch("A[1-6]", name) for name in self.fields)


@dataclass
class KrlNames:
    """The names of a module, in small letters: scalar variables, `positions` (None without a value
    as yet), data sets of frames as numbers of tool and base, data sets of paths, any other data."""

    source: Source
    parsed: Parsed
    scalars: set[str] = field(default_factory=set)
    positions: dict[str, Position | None] = field(default_factory=dict)
    frames: dict[str, tuple[int, int]] = field(default_factory=dict)
    paths: set[str] = field(default_factory=set)
    others: set[str] = field(default_factory=set)

    def problem(self, pos: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(pos), sentence))

    def claim(self, aggregate: Tree[Token], use: str) -> None:
        assert use in ("target", "frame", "left")
        self.parsed.literals.append(LiteralSpan(*span(aggregate), use))  # type: ignore[arg-type]

    def declare(self, all_statements: list[KrlStatement]) -> None:
        """All that is declared, then the values that are assigned to positions."""
        kinds = {each.names()[0] for each in all_statements if each.kind == "enumeration"}
        for each in all_statements:
            if each.kind == "declaration":
                self._declaration(each, SCALARS | kinds)
            elif each.kind == "signal":
                self.scalars.add(each.names()[0].lower())
        for each in all_statements:
            if each.kind == "value":
                self._value(each)

    def holds_position(self, name: str) -> bool:
        """Whether a name is a position, or a data set that a motion may depend on."""
        return name in self.positions or name in self.frames or name in self.paths

    def _declaration(self, statement: KrlStatement, scalar_types: set[str]) -> None:
        kind = statement.names()[0]
        for declared in statement.tree.find_data("declared"):
            name = str(declared.children[0]).lower()
            value = next((each for each in declared.children if isinstance(each, Tree)), None)
            before = self.holds_position(name) or name in self.others
            if before or (name in self.scalars and kind not in scalar_types):
                self.problem(statement.pos, f"{self.source.written(name)} is declared twice")
            if kind in scalar_types:
                self.scalars.add(name)
            elif kind in POSITIONS:
                self.positions[name] = None
                if value is not None:
                    self._take(name, value, statement.pos)
            elif kind == "FDAT":
                self.frames[name] = (-1, -1) if value is None else self.data_of_frames(value)
            elif kind == "LDAT":
                self.paths.add(name)
                if value is not None:
                    self.check_path(value)
            else:
                self.others.add(name)

    def data_of_frames(self, aggregate: Tree[Token]) -> tuple[int, int]:
        """Numbers of tool and base."""
        parts = fields(aggregate) or {}
        tool, base = (whole(parts.get(name)) for name in ("TOOL_NO", "BASE_NO"))
        pos = span(aggregate)[0]
        if tool is None or base is None or min(tool, base) < 0:
            self.problem(pos, "the data set does not state TOOL_NO and BASE_NO in numbers")
            return -1, -1
        if parts.get("IPO_FRAME", "#BASE") != "#BASE":
            self.problem(pos, "the tool is fixed in the room (IPO_FRAME #TCP), which is not understood")
        self.has("tool", tool)
        self.has("base", base)
        return tool, base

    def has(self, word: str, index: int | None) -> None:
        """The program has a tool or base of this number."""
        self.source.facts.has("--tool" if word == "tool" else "--frame", str(index))

    def check_path(self, aggregate: Tree[Token]) -> None:
        """A data set of a path: with another ORI_TYP the orientation of the target is not reached."""
        parts = fields(aggregate)
        kind = "" if parts is None else str(parts.get("ORI_TYP", "#VAR"))
        if kind != "#VAR":
            self.problem(
                span(aggregate)[0],
                f"with ORI_TYP {kind} the orientation of the target may not be reached; allowed is #VAR",
            )

    def _value(self, statement: KrlStatement) -> None:
        variable, aggregate = statement.tree.children
        assert isinstance(variable, Tree)
        assert isinstance(aggregate, Tree)
        name = str(variable.children[0]).lower()
        indices = variable.children[1:]
        if name in self.others:
            return
        key = name
        if indices:
            tokens = [str(each) for each in variable.scan_values(bool)]
            if len(tokens) != 2 or not tokens[1].isdecimal():
                self.problem(statement.pos, f"the index of {self.source.written(name)} is not a number")
                return
            index = tokens[1]
            key = f"{name}[{index}]"
        if name not in self.positions or self.positions[name] is not None:
            written = self.source.written(name)
            self.problem(
                statement.pos,
                f"{written} has two values"
                if name in self.positions
                else f"{written} is changed when the program runs, and is not declared here as a position",
            )
            return
        self._take(key, aggregate, statement.pos)

    def _take(self, key: str, aggregate: Tree[Token], pos: int) -> None:
        if self.positions.get(key) is not None:
            self.problem(pos, f"{self.source.written(key)} has two values")
            return
        parts = fields(aggregate)
        if parts is None:
            self.problem(pos, f"{self.source.written(key)} states a component twice")
        self.positions[key] = Position(key, aggregate, parts or {})
