"""VAL3 (Stäubli): its positions, tools, frames and motions.

Facts, from the VAL3 reference manual (D28062804A) and files of RoboDK's and visose/Robots' post processors:
data are variables of arrays, of which NAME is NAME[0]; jointRx are degrees; x, y, z (mm), rx, ry, rz turn
about x, the new y and the new z; a point is in the frame fatherId, each motion states its tool. shoulder is
lefty in front of axis 1, elbow and wrist have the signs of joints 3 and 5: that is compared with the joints
nearest by, and a point that it does not fit is refused.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

from lark import Token, Tree

from ....model.errors import BadInput
from ..line_language import NUMBER, LineLanguage, Statement, capitals, understood
from ..maker import blanked
from .val3_files import XmlElement, code_of, documents

_REMARK = r"//[^\n]*"
_JOINTS = tuple(f"j{i}" for i in range(1, 7))
_POSE = ("x", "y", "z", "rx", "ry", "rz")
_WORDS = ("shoulder", "elbow", "wrist")
_OPEN = re.compile(r"[sew](?:same|free)")  # of a configuration that the arm has, or chooses
_KINDS = {"jointRx": _JOINTS, "pointRx": _POSE, "tool": _POSE, "frame": _POSE}
_ROOTS = {"flange": "tool", "world": "frame"}


def _key(name: str) -> str:
    """A name as it is compared: pA, pA[0] and PA [0] are one."""
    word, _, index = re.sub(r"\s", "", name).partition("[")
    number = index.removesuffix("]").lstrip("0")
    return f"{word}[{number}]" if number else word


def _numbers(value: XmlElement, keys: Sequence[str]) -> list[Token] | None:
    """Those of a Value that are stated; None where one is no number, or there are others."""
    if any(re.fullmatch(r"j\d+|r?[xyz]", key) and key not in keys for key in value.attributes):
        return None
    placed = [value.attributes[key] for key in keys if key in value.attributes]
    if not all(re.fullmatch(NUMBER, number) for number, _ in placed):
        return None
    return [Token("VALUE", number, start_pos=start) for number, start in placed]


def _require_s7(roots: Sequence[XmlElement]) -> None:
    """BadInput for an application of VAL3 s6, whose files have other elements and types (`programList`,
    `joint`, `point`)."""
    older = [root.of("xmlns") for root in roots if root.of("xmlns") in ("ProgramNameSpace", "DataNameSpace")]
    if older:
        raise BadInput(
            "this application is of VAL3 s6, and those of s7 alone are read",
            found=f'xmlns="{older[0]}"',
            allowed='xmlns="http://www.staubli.com/robotics/VAL3/…"',
            remedy="convert the application to s7 with the Staubli Robotics Suite",
        )


class _Application:
    """All documents of an application, in their order."""

    def __init__(self, text: str) -> None:
        self.text, self.roots = text, documents(text)
        _require_s7(self.roots)
        self.data = [data for root in self.roots if root.tag == "Database" for data in root.all("Data")]
        self.kinds = {data.of("name").lower(): data.of("type") for data in self.data}
        self.free: set[str] = set()  # points of which a word of the configuration is open

    def statements(self) -> Iterator[Statement]:
        yield from self._definitions()
        for data in self.data:
            if data.of("type") in ("jointRx", "pointRx"):
                for value in data.children:
                    yield value.start, value.end, self._position(data, value)
        for root in self.roots:
            if root.tag == "Programs":
                for program in root.all("Program"):
                    yield from self._program(program)
            elif root.tag == "Project":
                for unit in root.all("Parameters"):
                    if unit.of("millimeterUnit") != "true":  # lengths are inches
                        yield unit.start, unit.end, None
            elif root.tag != "Database":
                yield root.start, root.end, None

    def _name(self, data: XmlElement, value: XmlElement, kind: str) -> Token | None:
        key, size = value.of("key"), data.of("size")
        right = key.isdecimal() and size.isdecimal() and int(key) < int(size) and value.tag == "Value"
        name, start = data.attributes.get("name", ("", 0))
        if not right or not re.fullmatch(r"[A-Za-z]\w*", name):
            return None
        return Token(kind, _key(f"{name}[{key}]"), start_pos=start)

    def _position(self, data: XmlElement, value: XmlElement) -> Tree[Token] | None:
        name, joints = self._name(data, value, "NAME"), data.of("type") == "jointRx"
        numbers = _numbers(value, _KINDS[data.of("type")])
        if name is None or numbers is None:
            return None
        if not numbers:  # it is set when the program runs
            return _tree("plain")
        if joints:
            return _tree("position", name, _tree("joints", *numbers))
        words = [
            Token("CONFIGURATION", *value.attributes[word]) for word in _WORDS if word in value.attributes
        ]
        father = value.of("fatherId")
        if self._kind(_key(father)) != "frame":
            return None
        if len(words) < 3 or any(_OPEN.fullmatch(word) for word in words):
            self.free.add(name.lower())
            words = []
        return _tree("position", name, _tree("pose", *numbers), _tree("frame", _word(father)), *words)

    def _definitions(self) -> Iterator[Statement]:
        """Tools and frames, each behind the one that it is in."""
        left, ready = [], set(_ROOTS)
        for data in self.data:
            if data.of("type") in ("tool", "frame"):
                for value in data.children:
                    numbers, name = _numbers(value, _POSE), self._name(data, value, "WORD")
                    father = _key(value.of("fatherId")).lower()
                    within = self._kind(father) == data.of("type")
                    if name is None or numbers is None or (numbers and (len(numbers) < 6 or not within)):
                        yield value.start, value.end, None
                    elif numbers:
                        pose = _tree("pose", *numbers)
                        tree = _tree("definition", name, _word(father), pose)
                        left.append((value, name.lower(), father, tree))
        while left:
            now = [each for each in left if each[2] in ready]
            if not now:
                break
            left = [each for each in left if each[2] not in ready]
            ready |= {each[1] for each in now}
            for value, *_, tree in now:
                yield value.start, value.end, tree
        for value, *_ in left:
            yield value.start, value.end, None

    def _program(self, program: XmlElement) -> Iterator[Statement]:
        name, start = program.attributes.get("name", ("", program.start))
        yield program.start, program.end, _tree("routine", Token("WORD", name.lower(), start_pos=start))
        for local in (*program.all("Local"), *program.all("Parameter")):
            if self._moves(local.of("name")):  # it hides the variable of this name
                yield local.start, local.end, None
        for element in program.all("Code"):
            span = code_of(self.text, element)
            if span is None:
                yield element.start, element.end, None
                continue
            program_text = capitals(blanked(self.text[slice(*span)], _REMARK, strings=False))
            code = " " * span[0] + program_text
            for line in re.finditer(r"[^\r\n]+", program_text):
                if line[0].strip():
                    begin, end = span[0] + line.start(), span[0] + line.end()
                    yield begin, end, self._understood(code, begin, end)

    def _understood(self, code: str, begin: int, end: int) -> Tree[Token] | None:
        tree = understood("staubli/val3", "statement", code, begin, end)
        inner = None if tree is None else tree.children[0]
        if not isinstance(inner, Tree):
            return None
        for variable in inner.find_data("variable"):
            name, *index = variable.children
            if index and isinstance(index[0], Tree) and self._moves(str(name)):
                return None  # one of several positions, not known which
        for part in inner.iter_subtrees():
            part.children = [
                Token.new_borrow_pos(each.type, _key(each), each)
                if isinstance(each, Token) and each.type in ("NAME", "WORD")
                else each
                for each in part.children
            ]
        words = inner.scan_values(lambda token: isinstance(token, Token))
        names = [token for token in words if token.type == "NAME"]
        if any(self._kind(name) in ("tool", "frame") for name in names):
            return None  # changed, or used for a computed position
        if inner.data == "motion" and str(names[-2]).lower() in self.free:
            return None  # the controller chooses the configuration
        return inner

    def _kind(self, name: str) -> str:
        """The type of the variable that a name, with its index or without, is of."""
        word = name.partition("[")[0].strip().lower()
        return _ROOTS.get(word) or self.kinds.get(word, "")

    def _moves(self, name: str) -> bool:
        return self._kind(name) in _KINDS


def _tree(kind: str, *children: Token | Tree[Token]) -> Tree[Token]:
    return Tree(kind, list(children))


def _word(name: str) -> Token:
    return Token("WORD", _key(name).lower())


def _statements(text: str) -> Iterator[Statement]:
    return _Application(text).statements()


def _literals(text: str) -> list[tuple[int, int]]:
    """From the first to the last number of each Value of data that are neither trsf nor mdesc."""
    spans = []
    for data in re.finditer(
        r"<Data\b[^>]*>(?:(?!</?Data\b).)*", re.sub(r"<!--.*?-->", _blank, text, flags=re.S), re.S
    ):
        if re.search(r"""\stype\s*=\s*["'](?:trsf|mdesc)["']""", data[0].partition(">")[0]):
            continue
        for value in re.finditer(r"<Value\b[^>]*>", data[0]):
            numbers = [*re.finditer(r"""\s(?:j\d+|r?[xyz])\s*=\s*["']([^"']*)["']""", value[0])]
            if numbers:
                first = data.start() + value.start()
                spans.append((first + numbers[0].start(1), first + numbers[-1].end(1)))
    return spans


def _blank(match: re.Match[str]) -> str:
    return " " * len(match[0])


VAL3 = LineLanguage(
    name="VAL3",
    grammar="staubli/val3",
    remark=_REMARK,
    joint_decimals=4,
    saved_decimals=3,
    read=_statements,
    positions=_literals,
)
