"""Expressions of KRL, and their values, as a controller has them."""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from zerobeam.model.arrays import Matrix

if TYPE_CHECKING:
    from krl_controller import Controller

_WORD = re.compile(
    r"""\s*("[^"]*"|'[BH][0-9A-F]+'|\d+\.?\d*(?:E[-+]?\d+)?|[A-Z_$#][\w$]*|==|<>|<=|>=|.)""", re.I
)
XYZABC = "XYZABC"


class Invalid(Exception):
    """The controller would not run it."""


def frame(values: dict[str, Any]) -> Matrix:
    """(4, 4) of X, Y, Z, A, B, C."""
    result = np.eye(4)
    result[:3, :3] = Rotation.from_euler("ZYX", [values[k] for k in "ABC"], degrees=True).as_matrix()
    result[:3, 3] = [values[k] for k in "XYZ"]
    return result


def components(pose: Matrix) -> dict[str, Any]:
    """X, Y, Z, A, B, C of (4, 4)."""
    angles = Rotation.from_matrix(pose[:3, :3]).as_euler("ZYX", degrees=True)
    return dict(zip(XYZABC, [*pose[:3, 3].tolist(), *angles.tolist()], strict=True))


def words(text: str) -> list[str]:
    """Of a line, without its comment."""
    found = []
    for match in _WORD.finditer(text.strip()):
        if match[1] == ";":
            break
        if match[1].strip():
            found.append(match[1] if match[1][0] == '"' else match[1].upper())
    return found


class Expression:
    """A value of words: logic, comparison, sum, product, geometric operator, part."""

    def __init__(self, controller: Controller, line: list[str]) -> None:
        self.controller, self.line, self.at = controller, line, 0

    def _next(self) -> str:
        return self.line[self.at] if self.at < len(self.line) else ""

    def _take(self) -> str:
        word = self._next()
        if not word:
            raise Invalid("an expression is not complete")
        self.at += 1
        return word

    def _expect(self, word: str) -> None:
        if self._take() != word:
            raise Invalid(f"{word} is missing")

    def logic(self) -> Any:
        value = self._comparison()
        while self._next() in ("AND", "OR", "EXOR"):
            word, other = self._take(), self._comparison()
            value = {"AND": value and other, "OR": value or other, "EXOR": value != other}[word]
        return value

    def _comparison(self) -> Any:
        if self._next() == "NOT":
            self._take()
            return not self._comparison()
        value = self._sum()
        while self._next() in ("==", "<>", "<", ">", "<=", ">="):
            word, other = self._take(), self._sum()
            value = {
                "==": value == other,
                "<>": value != other,
                **({} if isinstance(value, str) else {"<": value < other, ">": value > other}),
                **({} if isinstance(value, str) else {"<=": value <= other, ">=": value >= other}),
            }[word]
        return value

    def _sum(self) -> Any:
        value = self._product()
        while self._next() in ("+", "-"):
            value = value + self._product() if self._take() == "+" else value - self._product()
        return value

    def _product(self) -> Any:
        value = self._geometric()
        while self._next() in ("*", "/"):
            value = value * self._geometric() if self._take() == "*" else value / self._geometric()
        return value

    def _geometric(self) -> Any:
        value = self._part()
        while self._next() == ":":
            self._take()
            value = {**value, **components(frame(value) @ frame(self._part()))}
        return value

    def _part(self) -> Any:
        word = self._take()
        if word == "-":
            return -self._part()
        if word == "(":
            value = self.logic()
            self._expect(")")
            return value
        if word == "{":
            return self._aggregate()
        if word[0] == "'":
            return int(word[2:-1], 2 if word[1] == "B" else 16)
        if word[0].isdigit():
            return float(word)
        if word in ("TRUE", "FALSE"):
            return word == "TRUE"
        if word[0] in '"#':
            return word
        return self._variable(word)

    def _aggregate(self) -> dict[str, Any]:
        if self.line[self.at + 1 : self.at + 2] == [":"]:
            self.at += 2
        result: dict[str, Any] = {}
        while True:
            name = self._take()
            if self._next() == "[":
                self.at += 2
            result[name] = self._part()
            if self._take() == "}":
                return result

    def _variable(self, word: str) -> Any:
        own = self.controller
        if self._next() == "(":
            return self._call(word)
        index = None
        if self._next() == "[":
            self._take()
            index = self.logic()
            self._expect("]")
        if word in ("$IN", "$ANIN", "$FLAG", "$DIGIN"):
            return bool(own.rng.random() < 0.5) if word in ("$IN", "$FLAG") else own.rng.integers(1, 4)
        if word in ("$NULLFRAME", "$WORLD"):
            value: Any = components(np.eye(4))
        elif word in ("$TOOL", "$BASE"):
            value = components(own.system[word])
        elif word == "$POS_ACT":
            if own.at_last_motion is None:
                raise Invalid("no position yet")
            tool, base = own.at_last_motion
            value = components(np.linalg.inv(base) @ own.nominal.fk(own.joints, "deg") @ tool)
        elif word.startswith("$"):
            value = own.system.get(word, 0.0)
        else:
            value = own._name(word)
        if index is not None and isinstance(value, dict):
            value = value.get(int(index))
        if self._next() == "." and isinstance(value, dict):
            self._take()
            value = value.get(self._take())
        if value is None:
            raise Invalid(f"{word} has no value")
        return value

    def _call(self, name: str) -> Any:
        own = self.controller
        self._take()
        arguments: list[tuple[Any, str | None]] = []
        while self._next() != ")":
            alone = self.line[self.at + 1] in (",", ")") and re.fullmatch(r"[A-Z_]\w*", self._next())
            variable = self._next() if alone else None
            arguments.append((self.logic(), variable))
            if self._next() == ",":
                self._take()
        self._expect(")")
        if name in own.routines:
            return own._call(own.routines[name], arguments)
        if name in own.foreign:
            return own.foreign[name](own)
        if name in ("PULSE", "IR_STOPM"):
            return 0.0
        if name == "ABS":
            return abs(arguments[0][0])
        raise Invalid(f"the routine {name} is not there")


def copied(value: Any) -> Any:
    return {key: copied(each) for key, each in value.items()} if isinstance(value, dict) else value


def top(line: list[str], word: str) -> list[int]:
    """Where a word is outside of brackets."""
    depth, found = 0, []
    for at, each in enumerate(line):
        depth += (each in "({[") - (each in ")}]")
        if each == word and not depth:
            found.append(at)
    return found


def split(line: list[str], word: str) -> list[list[str]]:
    cuts = [-1, *top(line, word), len(line)]
    return [line[a + 1 : b] for a, b in pairwise(cuts)]
