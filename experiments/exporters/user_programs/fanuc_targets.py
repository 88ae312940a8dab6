"""The targets of a TP program in ASCII (FANUC)."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator

import numpy as np
from lark import Token, Tree

from ....model.arrays import Matrix
from ....model.kinematics.branches import Branch, fanuc_configuration, is_fanuc_configuration
from ....model.kinematics.orientation import from_rpy, orientation
from ....model.kinematics.pendant import Pendant
from .fanuc_statements import Frames, read_statements
from .grammar import understood
from .parts import NULL, Edit, JointTarget, Parsed, Place, PoseTarget, Source

_DECIMALS = 3  # of the controller's own listings
_ROOM = 40  # blanks before a number, at most, that a longer one may take
_FARTHEST = 1e6  # mm or deg: no position has more
_PART = re.compile(r"^/(PROG|ATTR|APPL|MN|POS|END)\b[^\n]*", re.MULTILINE)
_ORDER = re.compile(r"PROG( ATTR)?( APPL)* MN POS END")
_ENTRY = re.compile(r'(?:"[^"\n]*"|[^;"\s])(?:"[^"\n]*"|[^;"])*;')
_STATEMENT = re.compile(r"^[ \t]*\d*[ \t]*:(?P<body>[^;\n]*(?:\n[ \t]*:[^;\n]*)*);[ \t]*\r?$", re.MULTILINE)
_CONTINUED = re.compile(r"\n[ \t]*:")
_REMARK_OR_TEXT = re.compile(r'^[ \t]*\d*[ \t]*:[ \t]*(?:!|--|//)[^\n]*|"[^"\n]*"', re.MULTILINE)
_POINT = re.compile(r"^[ \t]*P\[[^{}]*\{[^{}]*\}[ \t]*;", re.MULTILINE)
_LITERAL = re.compile(
    r"(?<!\w)[A-Z]\d?\s*=\s*[^\s,=]+\s*(?:mm|deg)(?:\s*,\s*[A-Z]\d?\s*=\s*[^\s,=]+\s*(?:mm|deg))+"
)
_AXES = 3  # entries of a literal with the shape of a pose or of joints, at least: fewer are a positioner's
_POSE = "XYZWPR"


def fanuc_head(text: str) -> tuple[int, str]:
    """Where remarks at the head of a program are put, and what they begin with."""
    found = re.search(r"^/MN[^\n]*\n", text, re.MULTILINE)
    return (0 if found is None else found.end()), "    :  !"


def fanuc_literals(text: str) -> list[tuple[int, int]]:
    """The places of all entries `X = 1.000 mm, Y = …` of poses and joints."""
    bare = _REMARK_OR_TEXT.sub(lambda found: " " * len(found[0]), text)
    return [found.span() for found in _LITERAL.finditer(bare) if found[0].count("=") >= _AXES]


def _start(token: Token) -> int:
    assert token.start_pos is not None
    return token.start_pos


def _end(token: Token) -> int:
    return _start(token) + len(token)


def _replaced(token: Token, text: str) -> Edit:
    return Edit(_start(token), _end(token), text)


def fanuc_targets(source: Source) -> Parsed:
    """What is to be corrected in a listing."""
    return _Listing(source).read()


class _Listing:
    def __init__(self, source: Source) -> None:
        self.source, self.stated, self.parsed = source, source.stated, Parsed()
        self.bare = _CONTINUED.sub(lambda mark: "\n".ljust(len(mark[0])), source.text)
        self.frames: dict[str, Frames] = {}
        self.names: set[str] = set()

    def read(self) -> Parsed:
        text, heads = self.source.text, list(_PART.finditer(self.source.text))
        order = " ".join(head[1] for head in heads)
        if not _ORDER.fullmatch(order) or text[: heads[0].start()].strip() or text[heads[-1].end() :].strip():
            self._problem(0, "this is no whole listing: /PROG, /ATTR, /APPL, /MN, /POS, /END, in this order")
            return self.parsed
        self._derived("heading", heads[0].start(), heads[0].end())
        parts = {"ATTR": _ENTRY, "APPL": _ENTRY, "MN": _STATEMENT, "POS": _POINT}
        statements = []
        for head, following in itertools.pairwise(heads):
            if head[1] == "PROG" and text[head.end() : following.start()].strip():
                self._problem(head.end() + 1, "this line is not understood")
            for piece in self._pieces(parts.get(head[1]), head.end(), following.start()):
                if head[1] == "MN":
                    statements.append(piece)
                elif head[1] == "POS":
                    self._point(piece)
                else:
                    rule = "attribute" if head[1] == "ATTR" else "application"
                    self._derived(rule, piece.start(), piece.end())
        read_statements(self.source, self.bare, statements, self.frames, self.parsed)
        return self.parsed

    def _problem(self, place: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(place), sentence))

    def _pieces(self, kind: re.Pattern[str] | None, start: int, end: int) -> Iterator[re.Match[str]]:
        """The pieces of a part; a problem of each line that is in none."""
        place, pieces = start, [] if kind is None else list(kind.finditer(self.source.text, start, end))
        for piece in [*pieces, None] if kind is not None else ():
            gap = self.source.text[place : end if piece is None else piece.start()]
            for line in re.finditer(r"\S[^\n]*", gap):
                self._problem(place + line.start(), "this line is not understood")
            if piece is not None:
                yield piece
                place = piece.end()

    def _derived(self, rule: str, start: int, end: int) -> Tree[Token] | None:
        tree = understood("fanuc", rule, self.bare, start, end)
        if tree is None:
            written = " ".join(self.bare[start:end].split())[:60]
            self._problem(start, f"{written}: this is not understood")
        return tree

    def _point(self, piece: re.Match[str]) -> None:
        place = piece.start() + piece[0].index("P")
        tree = self._derived("point", place, piece.end())
        if tree is None:
            return
        groups = [child for child in tree.children if isinstance(child, Tree)]
        name = f"P[{int(str(tree.children[0]))}]"
        if name in self.names:
            self._problem(place, f"{name} is in the listing more than once")
            return
        self.names.add(name)
        left = self.stated.leaves(name[2:-1], name)
        for group in groups:
            entries = list(group.find_data("entry"))
            if len(entries) >= _AXES and (left or str(group.children[0])[2] == "1"):
                place_of = (entries[0].meta.start_pos, entries[-1].meta.end_pos)
                self.parsed.literals.append(Place(*place_of, "left" if left else "target"))
        of_arm = [group for group in groups if str(group.children[0])[2] == "1"]
        if not left and len(of_arm) != 1:
            self._problem(place, f"{name} has no group 1, or more than one")
        elif not left:
            self._add(name, place, of_arm[0])

    def _add(self, name: str, place: int, group: Tree[Token]) -> None:
        """Enter the position of group 1."""
        entries = [
            [token for token in entry.children if isinstance(token, Token)]
            for entry in group.find_data("entry")
        ]
        values = {str(key): shown for key, shown, _ in entries}
        units = {str(key): str(unit) for key, _, unit in entries}
        if any("*" in shown for shown in values.values()):
            self._problem(place, f"{name} is not taught")
        elif len(values) < len(entries):
            self._problem(place, f"{name} has a value twice")
        elif not all(abs(float(shown)) < _FARTHEST for shown in values.values()):
            self._problem(place, f"{name} has a value that no position has")
        elif "J1" in values:
            self._add_joints(name, place, values, units)
        else:
            self._add_pose(name, place, values, units, group)

    def _add_joints(self, name: str, place: int, values: dict[str, Token], units: dict[str, str]) -> None:
        keys = [f"J{i}" for i in range(1, self.source.robot.n + 1)]
        if [key for key in values if key[0] != "E"] != keys or any(units[key] != "deg" for key in keys):
            self._problem(place, f"the joints of {name} are not those of the robot")
            return
        robot = self.source.robot
        pendant = Pendant(robot, self.stated.j3)
        shown = np.array([float(values[key]) for key in keys])

        def write(new: Matrix) -> list[Edit]:
            written = pendant.counted(new)
            return [self._edit(values[key], value) for key, value in zip(keys, written.tolist(), strict=True)]

        joints = pendant.between_links(shown)
        self.parsed.targets[name] = JointTarget(name, self.source.line(place), joints, write)

    def _add_pose(
        self, name: str, place: int, values: dict[str, Token], units: dict[str, str], group: Tree[Token]
    ) -> None:
        user, tool, *configuration = (child for child in group.children[1:] if isinstance(child, Token))
        keys = [key for key in values if key[0] != "E"]
        orderly = keys == list(_POSE) and [units[key] for key in keys] == ["mm"] * 3 + ["deg"] * 3
        if not orderly or not configuration:
            self._problem(place, f"{name} is not understood: UF, UT, CONFIG, X to R are required")
            return
        if any(float(values[key]) for key in values if key[0] == "E"):
            self._problem(place, f"{name} has positions of external axes, which may carry the robot")
            return
        frames = []
        for word, option, stated, number in (
            ("tool frame", "--tool", self.stated.tool, tool),
            ("user frame", "--frame", self.stated.frame, user),
        ):
            frame = None if number == "F" else stated(str(int(number)), NULL if int(number) == 0 else None)
            if frame is None:
                state = "" if number == "F" else f"; state {option} {number}=X,Y,Z,W,P,R"
                self._problem(place, f"{name}: {word} {number} is not known{state}")
                return
            frames.append(frame)
        self.frames[name] = Frames(str(int(user)), str(int(tool)))
        written, stated_turns = configuration
        letters = " ".join(re.findall(r"[A-Z]", written))
        turns = tuple(int(turn) for turn in stated_turns.split(","))

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = [*pose[:3, 3].tolist(), *orientation(pose[:3, :3]).roll_pitch_yaw]
            edits = [self._edit(values[key], value) for key, value in zip(_POSE, new, strict=True)]
            if branch is None or is_fanuc_configuration(letters, turns, branch, joints):
                return edits
            word, now = fanuc_configuration(branch, joints)
            return [*edits, _replaced(written, word), _replaced(stated_turns, ", ".join(map(str, now)))]

        self.parsed.targets[name] = PoseTarget(
            name,
            self.source.line(place),
            from_rpy([float(values[key]) for key in _POSE]),
            frames[0],
            frames[1],
            lambda branch, joints: is_fanuc_configuration(letters, turns, branch, joints),
            f"{letters}, {stated_turns}",
            write,
        )

    def _edit(self, shown: Token, value: float) -> Edit:
        """A number in the room of the old one and of the blanks before it."""
        if abs(float(shown) - value) <= 0.5 * 10.0**-_DECIMALS:
            return _replaced(shown, str(shown))
        end, text = _end(shown), f"{value + 0.0:.{_DECIMALS}f}"
        blank = re.search(r"[ \t]*\Z", self.source.text[max(0, _start(shown) - _ROOM) : _start(shown)])
        start = _start(shown) - (0 if blank is None else len(blank[0]))
        return Edit(start, end, text.rjust(end - start))
