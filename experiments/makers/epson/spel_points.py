"""Programs of SPEL+ (Epson) with the files of points (.pts) of their folder, as one text.

Facts, from the SPEL+ Language Reference and files of points that post processors write (Visual Components):
a point has a number, and perhaps a label; X, Y, Z, mm, and U, V, W, degrees about z, the new y and the new x,
in the frame of its Local, of which 0 is the base; Hand 1 is righty, Elbow 1 above, Wrist 1 no flip, as
/R /A /NF of XY; J4Flag and J6Flag 0 are joints within half a turn. Which branch each word is, is not
interpreted. The first line of a file may have a checksum, of which nothing is published.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from lark import Token, Tree

from ..line_language import NUMBER, LineLanguage, Statement, tokens
from ..maker import blanked

_POINT = re.compile(r"^[ \t]*Point\d+[ \t]*\{([^{}]*)\}", re.MULTILINE)
_FIELD = re.compile(r"^[ \t]*([a-z]\w*)=([^\r\n]*?)[ \t]*\r?$", re.MULTILINE)
_HEAD = re.compile(
    r"^(?:ENVT\d+,.*|sVersion=.*|nDisplayMode=.*|bDisplay[RST]=.*|nNumberOfJoints=(?P<joints>\d+)"
    r"|nNumberOfPoints=(?P<count>\d{1,6}))[ \t]*\r?$",
    re.MULTILINE,
)
_POSE = ("rX", "rY", "rZ", "rU", "rV", "rW")
_WORDS = {"nHand": ("/R", "/L"), "nElbow": ("/A", "/B"), "nWrist": ("/NF", "/F")}
# Further axes, turns, and what only other kinds of arms have.
_ZERO = ("rR", "rS", "rT", "nJ1Flag", "nJ2Flag", "nJ4Flag", "nJ6Flag", "rJ1Angle", "rJ4Angle")
_OTHERS = ("nNumber", "sLabel", "sDescription", "nUndefined", "nLocal", "bSimVisible")
_LIST = re.compile(r"\(\s*([^()\n]*?(?:,[^()\n]*?){5,})\s*\)")
_WHOLE = re.compile(r"0|[1-9][0-9]{0,5}")  # a number, written in one way

Fields = dict[str, tuple[str, int]]  # values by name, and where they begin


def _fields(point: re.Match[str]) -> Fields | None:
    """What a point states; None where anything else is in it, or a field twice."""
    fields = {field[1]: (field[2], point.start(1) + field.start(2)) for field in _FIELD.finditer(point[1])}
    lines = [line for line in point[1].split("\n") if line.strip()]
    return fields if len(lines) == len(fields) and {*fields} <= {*_POSE, *_WORDS, *_ZERO, *_OTHERS} else None


def _name(fields: Fields) -> tuple[str, int] | None:
    """The name that a program has for a point: its label, else P and its number."""
    number, start = fields.get("nNumber", ("", 0))
    label, label_start = fields.get("sLabel", ('""', 0))
    if not _WHOLE.fullmatch(number) or not re.fullmatch(r'"(?:[A-Za-z]\w*)?"', label, re.ASCII):
        return None
    return (label[1:-1], label_start + 1) if label != '""' else (f"P{number}", start)


def _position(fields: Fields) -> Tree[Token] | None:
    """The position of a point; None where its fields are not understood."""
    name, local = _name(fields), fields.get("nLocal", ("", 0))
    numbers = [fields.get(key, ("", 0)) for key in _POSE]
    words = [(fields.get(key, ("", 0))[0], names) for key, names in _WORDS.items()]
    right = (
        all(re.fullmatch(NUMBER, number) for number, _ in numbers)
        and [start for _, start in numbers] == sorted(start for _, start in numbers)
        and all(re.fullmatch(r"0(?:\.0*)?", fields.get(key, ("0", 0))[0]) for key in _ZERO)
        and all(number in ("1", "2") for number, _ in words)
        and _WHOLE.fullmatch(local[0])
        and fields.get("nUndefined", ("0", 0))[0] == "0"
    )
    if name is None or not right:
        return None
    return Tree(
        "position",
        [
            Token("NAME", name[0].upper(), start_pos=name[1]),
            Tree("pose", [Token("VALUE", number, start_pos=start) for number, start in numbers]),
            Tree("frame", [Token("WORD", local[0], start_pos=local[1])]),
            *(Token("CONFIGURATION", names[int(number) - 1], start_pos=name[1]) for number, names in words),
        ],
    )


def _code(text: str) -> str:
    """The text with blanks for files of points."""
    return _HEAD.sub(_blank, _POINT.sub(_blank, text))


def _blank(match: re.Match[str]) -> str:
    return re.sub(r"[^\r\n]", " ", match[0])


def _statements(program: LineLanguage, text: str) -> Iterator[Statement]:
    points = [(match, _fields(match)) for match in _POINT.finditer(text)]
    head = [*_HEAD.finditer(text)]
    for match in head:
        if match["joints"] not in (None, "6"):
            yield match.start(), match.end(), None
    counts = [match for match in head if match["count"] is not None]
    if sum(int(match["count"]) for match in counts) != len(points):
        for match in counts or [match for match, _ in points]:
            yield match.start(), match.end(), None  # points are lost
    labels: dict[str, str] = {}
    numbers = [(fields or {}).get("nNumber", ("", 0))[0] for _, fields in points]
    several = Counter(numbers)
    for (match, fields), number in zip(points, numbers, strict=True):
        tree = None if fields is None or several[number] > 1 else _position(fields)
        if tree is not None:
            labels[f"P{number}"] = str(tree.children[0])
        yield match.start(), match.end(), tree
    for begin, end, tree in program.statements(_code(text)):
        for part in () if tree is None else tree.iter_subtrees():
            part.children = [
                Token.new_borrow_pos("NAME", labels.get(each, each), each)
                if isinstance(each, Token) and each.type == "NAME"
                else each
                for each in part.children
            ]
        yield begin, end, tree


def _positions(program: LineLanguage, text: str) -> list[tuple[int, int]]:
    """The spans of lists of six numbers in the program, and from the first to the last of each point."""
    spans = [match.span(1) for match in _LIST.finditer(blanked(_code(text), program.remark))]
    for point in _POINT.finditer(text):
        numbers = [field for field in _FIELD.finditer(point[1]) if field[1] in _POSE]
        if numbers:
            spans.append((point.start(1) + numbers[0].start(2), point.start(1) + numbers[-1].end(2)))
    return spans


def _in_order(tree: Tree[Token]) -> bool:
    """The words of an XY are hand, elbow and wrist."""
    words = [str(token) for token in tokens(tree, "CONFIGURATION")]
    return not words or all(word in names for word, names in zip(words, _WORDS.values(), strict=True))


def with_points(program: LineLanguage) -> LineLanguage:
    """The language of a program and its points."""
    program = replace(program, derives=_in_order)
    return replace(
        program,
        read=lambda text: _statements(program, text),
        positions=lambda text: _positions(program, text),
    )
