"""The targets of a TP program in ASCII (FANUC): its motions, in which frames they are, its positions."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np
from lark import Token, Tree

from ....model.arrays import Matrix
from ....model.kinematics.branches import Branch, fanuc_configuration, is_fanuc_configuration
from ....model.kinematics.orientation import from_rpy, orientation
from ....model.kinematics.pendant import Pendant
from ..program_parts import (
    NULL,
    Edit,
    JointTarget,
    Language,
    LiteralSpan,
    Motion,
    Parsed,
    PoseTarget,
    Source,
    span,
    understood,
)

_REMARK = re.compile(r"\s*(?:![^\n]*|--[^\n]*|//.*)", re.DOTALL)
_WORDS = re.compile(r"[A-Za-z_][\w -]*")  # a macro is called by its name alone
_COMPUTED = "its target or shift is computed when the program runs (--leave?)"
_REASONS = (  # why the grammar does not derive a statement that begins so
    (r"[JLCAS]\s.*(?:PR\[|P\[\s*[A-Z])", _COMPUTED),
    (r"(?:TOOL_|V)?OFFSET\b|.*\bU(?:FRAME|TOOL)(?:_NUM.*=|\[)", "frames are changed when the program runs"),
    (r"(?![JLCAS]\s).*(?<![A-Z])P\[", "a position is used when the program runs"),
    (r".*\bPR\[", "position registers are not understood"),
)
_HARMLESS = "states that it moves no arm and changes no frame, tool or position"
_KEY_OF = {"UFRAME_NUM": "UF", "UTOOL_NUM": "UT"}
_JOINS = ("label", "block", "jump", "leaving")  # what follows them is reached from elsewhere too


class FrameNumbers(NamedTuple):
    """The numbers of the frames that a pose states."""

    user: str
    tool: str


def read_statements(
    source: Source,
    bare: str,
    pieces: Sequence[re.Match[str]],
    frames: Mapping[str, FrameNumbers],
    parsed: Parsed,
) -> None:
    """Enter the motions, and the problems, of the statements (each with its `body`) of /MN. `bare` is the
    text without the marks of continued lines; `frames` are those of the poses, by name."""
    statements = []
    for piece in pieces:
        if _REMARK.fullmatch(piece["body"]) is None:
            tree = understood("fanuc/tp", "statement", bare, *piece.span("body"))
            statements.append((source.line(piece.start()), " ".join(piece["body"].split()), tree))
    flow = _Flow(source, frames, parsed, [tree for _, _, tree in statements if tree is not None])
    for line, written, tree in statements:
        if tree is None:
            flow.not_derived(line, written)
        else:
            flow.go(line, written, tree)


class _Flow:
    """`first` as of `Motion`; `active`: the numbers that UFRAME_NUM and UTOOL_NUM may have, none where the
    program has not set them yet."""

    def __init__(
        self, source: Source, frames: Mapping[str, FrameNumbers], parsed: Parsed, trees: Sequence[Tree[Token]]
    ) -> None:
        self.facts, self.frames, self.parsed = source.facts, frames, parsed
        self.first = True
        self.numbers: dict[str, set[str]] = {"UFRAME_NUM": set(), "UTOOL_NUM": set()}
        for tree in trees:
            for statement in tree.find_data("frame_number"):
                which, number = map(str, statement.children)
                self.numbers[which].add(str(int(number)))
        self.active: dict[str, set[str]] = {which: set() for which in self.numbers}

    def not_derived(self, line: int, written: str) -> None:
        """A problem of a statement that the grammar does not derive, but of a macro that is harmless."""
        if not _WORDS.fullmatch(written):
            reason = next((sentence for words, sentence in _REASONS if re.match(words, written)), None)
            self._problem(line, f"{written} is not understood" if reason is None else f"{written}: {reason}")
        elif not self.facts.harmless(written):
            self._problem(
                line,
                f'{written}: this macro or instruction is not understood; --call "{written}" {_HARMLESS}',
            )

    def _problem(self, line: int, sentence: str) -> None:
        self.parsed.problems.append((line, sentence))

    def go(self, line: int, written: str, tree: Tree[Token]) -> None:
        for call in tree.find_data("call"):
            name = str(call.children[0])
            if not self.facts.harmless(name):
                self._problem(line, f"{written}: what {name} does is not known; --call {name} {_HARMLESS}")
        for statement in tree.children:
            assert isinstance(statement, Tree)
            if statement.data == "motion":
                self._motion(line, written, statement)
            elif statement.data == "frame_number":
                which, number = map(str, statement.children)
                self.active[which] = {str(int(number))}
            elif statement.data in _JOINS:
                self.first = True
                self.active = {which: set(numbers) for which, numbers in self.numbers.items()}

    def _motion(self, line: int, written: str, motion: Tree[Token]) -> None:
        linear = motion.children[0] != "J"
        for target in (child for child in motion.children if isinstance(child, Tree)):
            if target.data not in ("position", "register"):
                continue
            number = str(int(str(target.children[0])))
            name = f"P[{number}]" if target.data == "position" else f"PR[{number}]"
            if self.facts.leaves(number if target.data == "position" else name, name):
                self.parsed.motions.append(Motion(None, line, False, True))
            elif target.data == "register":
                self._problem(line, f"{written}: {_COMPUTED}")
            elif name in self.parsed.targets:
                self._require_frames(line, written, name)
                self.parsed.motions.append(Motion(name, line, linear, self.first))
            elif not self.parsed.speaks_of(line, name):
                self._problem(line, f"{name} is not in the listing")
            self.first = False
        self.first = any(True for _ in motion.find_data("skip"))

    def _require_frames(self, line: int, written: str, name: str) -> None:
        """A pose is in the frames that it states only while they are active."""
        if name not in self.frames:
            return
        for (which, active), number in zip(self.active.items(), self.frames[name], strict=True):
            if others := ", ".join(sorted(active - {number})):
                self._problem(
                    line,
                    f"{written}: {name} has {_KEY_OF[which]} : {number}, but {which} is, or may be, {others}"
                    f" here; set {which}={number} before this motion",
                )


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


def fanuc_literals(text: str) -> list[tuple[int, int]]:
    """The places of all entries `X = 1.000 mm, Y = …` of poses and joints."""
    bare = _REMARK_OR_TEXT.sub(lambda match: " " * len(match[0]), text)
    return [match.span() for match in _LITERAL.finditer(bare) if match[0].count("=") >= _AXES]


def fanuc_targets(source: Source) -> Parsed:
    """The targets, motions and problems of a listing."""
    return _Listing(source).read()


class _Listing:
    def __init__(self, source: Source) -> None:
        self.source, self.facts, self.parsed = source, source.facts, Parsed()
        self.bare = _CONTINUED.sub(lambda mark: "\n".ljust(len(mark[0])), source.text)
        self.frames: dict[str, FrameNumbers] = {}
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

    def _problem(self, pos: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(pos), sentence))

    def _pieces(self, kind: re.Pattern[str] | None, start: int, end: int) -> Iterator[re.Match[str]]:
        """The pieces of a part; a problem of each line that is in none."""
        pos, pieces = start, [] if kind is None else list(kind.finditer(self.source.text, start, end))
        for piece in [*pieces, None] if kind is not None else ():
            gap = self.source.text[pos : end if piece is None else piece.start()]
            for line in re.finditer(r"\S[^\n]*", gap):
                self._problem(pos + line.start(), "this line is not understood")
            if piece is not None:
                yield piece
                pos = piece.end()

    def _derived(self, rule: str, start: int, end: int) -> Tree[Token] | None:
        tree = understood("fanuc/tp", rule, self.bare, start, end)
        if tree is None:
            written = " ".join(self.bare[start:end].split())[:60]
            self._problem(start, f"{written}: this is not understood")
        return tree

    def _point(self, piece: re.Match[str]) -> None:
        pos = piece.start() + piece[0].index("P")
        tree = self._derived("point", pos, piece.end())
        if tree is None:
            return
        groups = [child for child in tree.children if isinstance(child, Tree)]
        name = f"P[{int(str(tree.children[0]))}]"
        if name in self.names:
            self._problem(pos, f"{name} is in the listing more than once")
            return
        self.names.add(name)
        left = self.facts.leaves(name[2:-1], name)
        for group in groups:
            entries = list(group.find_data("entry"))
            if len(entries) >= _AXES and (left or str(group.children[0])[2] == "1"):
                place_of = (entries[0].meta.start_pos, entries[-1].meta.end_pos)
                self.parsed.literals.append(LiteralSpan(*place_of, "left" if left else "target"))
        of_arm = [group for group in groups if str(group.children[0])[2] == "1"]
        if not left and len(of_arm) != 1:
            self._problem(pos, f"{name} has no group 1, or more than one")
        elif not left:
            self._add(name, pos, of_arm[0])

    def _add(self, name: str, pos: int, group: Tree[Token]) -> None:
        """Enter the position of group 1."""
        entries = [
            [token for token in entry.children if isinstance(token, Token)]
            for entry in group.find_data("entry")
        ]
        values = {str(key): shown for key, shown, _ in entries}
        units = {str(key): str(unit) for key, _, unit in entries}
        if any("*" in shown for shown in values.values()):
            self._problem(pos, f"{name} is not taught")
        elif len(values) < len(entries):
            self._problem(pos, f"{name} has a value twice")
        elif not all(abs(float(shown)) < _FARTHEST for shown in values.values()):
            self._problem(pos, f"{name} has a value that no position has")
        elif "J1" in values:
            self._add_joints(name, pos, values, units)
        else:
            self._add_pose(name, pos, values, units, group)

    def _add_joints(self, name: str, pos: int, values: dict[str, Token], units: dict[str, str]) -> None:
        keys = [f"J{i}" for i in range(1, self.source.robot.n + 1)]
        if [key for key in values if key[0] != "E"] != keys or any(units[key] != "deg" for key in keys):
            self._problem(pos, f"the joints of {name} are not those of the robot")
            return
        robot = self.source.robot
        pendant = Pendant(robot, self.facts.j3)
        shown = np.array([float(values[key]) for key in keys])

        def write(new: Matrix) -> list[Edit]:
            written = pendant.counted(new)
            return [self._edit(values[key], value) for key, value in zip(keys, written.tolist(), strict=True)]

        joints = pendant.between_links(shown)
        self.parsed.targets[name] = JointTarget(name, self.source.line(pos), joints, write)

    def _add_pose(
        self, name: str, pos: int, values: dict[str, Token], units: dict[str, str], group: Tree[Token]
    ) -> None:
        user, tool, *configuration = (child for child in group.children[1:] if isinstance(child, Token))
        keys = [key for key in values if key[0] != "E"]
        orderly = keys == list(_POSE) and [units[key] for key in keys] == ["mm"] * 3 + ["deg"] * 3
        if not orderly or not configuration:
            self._problem(pos, f"{name} is not understood: UF, UT, CONFIG, X to R are required")
            return
        if any(float(values[key]) for key in values if key[0] == "E"):
            self._problem(pos, f"{name} has positions of external axes, which may carry the robot")
            return
        in_flange = self._known_pose(name, pos, "--tool", tool)
        in_world = self._known_pose(name, pos, "--frame", user)
        if in_flange is None or in_world is None:
            return
        self.frames[name] = FrameNumbers(str(int(user)), str(int(tool)))
        written, stated_turns = configuration
        letters = " ".join(re.findall(r"[A-Z]", written))
        turns = tuple(int(turn) for turn in stated_turns.split(","))

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            new = [*pose[:3, 3].tolist(), *orientation(pose[:3, :3]).roll_pitch_yaw]
            edits = [self._edit(values[key], value) for key, value in zip(_POSE, new, strict=True)]
            if branch is None or is_fanuc_configuration(letters, turns, branch, joints):
                return edits
            word, now = fanuc_configuration(branch, joints)
            return [*edits, Edit(*span(written), word), Edit(*span(stated_turns), ", ".join(map(str, now)))]

        self.parsed.targets[name] = PoseTarget(
            name,
            self.source.line(pos),
            from_rpy([float(values[key]) for key in _POSE]),
            in_flange,
            in_world,
            lambda branch, joints: is_fanuc_configuration(letters, turns, branch, joints),
            f"{letters}, {stated_turns}",
            write,
        )

    def _known_pose(
        self, name: str, pos: int, option: Literal["--tool", "--frame"], number: Token
    ) -> Matrix | None:
        """The tool frame or user frame of a position; None where that is a problem."""
        word, pose = "tool frame" if option == "--tool" else "user frame", None
        if number != "F":
            pose_of = self.facts.tool if option == "--tool" else self.facts.frame
            pose = pose_of(str(int(number)), NULL if int(number) == 0 else None)
        if pose is None:
            request = "" if number == "F" else f"; {self.facts.require(option, str(number), 'X,Y,Z,W,P,R')}"
            self._problem(pos, f"{name}: {word} {number} is not known{request}")
        return pose

    def _edit(self, shown: Token, value: float) -> Edit:
        """A number in the room of the old one and of the blanks before it."""
        if abs(float(shown) - value) <= 0.5 * 10.0**-_DECIMALS:
            return Edit(*span(shown), str(shown))
        end, text = span(shown)[1], f"{value + 0.0:.{_DECIMALS}f}"
        blank = re.search(r"[ \t]*\Z", self.source.text[max(0, span(shown)[0] - _ROOM) : span(shown)[0]])
        start = span(shown)[0] - (0 if blank is None else len(blank[0]))
        return Edit(start, end, text.rjust(end - start))


TP = Language(
    "TP",
    fanuc_targets,
    r"^/MN[^\n]*\n",
    "    :  !",
    from_rpy,
    "X,Y,Z,W,P,R",
    fanuc_literals,
    case_sensitive=True,
    remark_width=32,
)
