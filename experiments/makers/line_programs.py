"""Programs of which a statement is a line: positions, motions to them, tools, frames, what moves no arm.

A maker's grammar derives a line, by its rule `statement`, to one tree:

- `position`: a NAME and its `joints` or `pose`; `entry`: a NAME and `values`, which are joints or a pose by
  the last line `joints_follow` or `poses_follow`, and refused behind `nothing_follows`. Of a pose a
  CONFIGURATION is what tells the branches of the arm apart, in the language's own words; `configuration` is a
  line that states it for entries below.
- `motion`, `linear`: each `at` in it is a NAME, `joints` or a `pose`, and the arm goes there by joints or in
  a straight line (or an arc, if the language takes the orientation of every pose in it). With `only_joints`
  or `only_pose` in it a NAME must be such a position; that says it of `numbers`, a position whose declaration
  does not. A `tool` or `frame` in a motion is of this motion alone, as is a CONFIGURATION in `reached_as`.
- `tool`, `frame`: a WORD or a `pose`, from here on. `in_base`, `in_frame`: framed positions below are in the
  base frame, or in the frame that was set. In a position a `frame` is its own. `definition`: a tool or frame
  by a WORD, its `pose` in another one, the second WORD, defined before.
- `call`: a WORD, the routine. `routine`: a WORD, its begin.
- `join`: it is reached from elsewhere too, or leads there. `plain`: it moves no arm, and changes no position.

Numbers of joints and poses are VALUE. A NAME anywhere else is of what the program changes.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from string import ascii_lowercase, ascii_uppercase

import numpy as np
from lark import Token, Tree

from ...model.arrays import Matrix
from ...model.errors import BadInput, located
from ...model.kinematics.branches import Branch
from ...model.kinematics.pendant import Pendant
from ...model.kinematics.robot import PendantUnit, Robot
from .joint_text import require_same_plan
from .maker import blanked
from .program_parts import (
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
    number_edits,
    span,
    understood,
)
from .recordings import Imported, ImportJob, TaughtPoint, import_points

_CAPITALS = str.maketrans(ascii_lowercase, ascii_uppercase)
_FEWEST = 6  # numbers of a position
Statement = tuple[int, int, Tree[Token] | None]  # begin, end and derivation
_FARTHEST = 1e8  # mm, degrees or pulses: no position has more
_FOLLOW = {"joints_follow": True, "poses_follow": False, "nothing_follows": None}
_IN_BASE = "base"  # the frame of positions in the base frame
_KINDS = ("only_joints", "only_pose")
_HARMLESS = "states that it moves no arm and changes no tool, frame or position"
_POSTURE = re.compile(
    r"[#j]?zb_([pmv])(\d+)(?:_\d+)?", re.IGNORECASE
)  # of a plan's program: planned, measured, via
SIX_WITH_COMMAS = re.compile(rf"(?<![\w.])(?<![-+]){NUMBER}(?:\s*,\s*{NUMBER}){{5,}}(?![\w.])")
SIX_WITH_BLANKS = re.compile(rf"(?<![\w.])(?<![-+]){NUMBER}(?:[ \t]+{NUMBER}){{5,}}(?![\w.])")


def capitals(text: str) -> str:
    """The text in capitals, of the same length whatever its letters."""
    return text.translate(_CAPITALS)


@dataclass(frozen=True)
class LineLanguage:
    """A language of such programs.

    `grammar` is the file of its grammar; `remark` a pattern of its comments, `head` one of the lines behind
    which the remarks of a correction are put, each behind `comment`. Joints are in `unit`; a pose (4, 4) is
    that of the numbers of `form`, and back. Numbers are written to so many decimals. `literal` has all that
    looks like joints or a pose. Of `framed` positions tool and frame are those of the lines above them, else
    those of the motion. `flange_tools` and `base_frames` are the names of tools and frames that are none. An
    `indented` language has its blocks by indentation; behind a line that `opens` a block there is a brace.
    `matching` says of a configuration which joints (n,), degrees, have it, None where that is not known;
    without it the words are compared with each other.
    Where more than lines of code has positions, `read` has all statements, and `positions` the spans that
    `literal` has else. `words` are those of the configuration of joints (n,), degrees, in their order;
    without it they are not interpreted. `saved_decimals` are those that a controller saves, where they are
    fewer than `joint_decimals`. `derives` says what the grammar cannot of a line's tree.
    """

    name: str
    grammar: str
    remark: str
    head: str
    comment: str
    pose: Callable[[Sequence[float]], Matrix]
    numbers: Callable[[Matrix], Sequence[float]]
    form: str
    unit: PendantUnit = "deg"
    joint_decimals: int = 6
    pose_decimals: Sequence[int] = (4, 4, 4, 6, 6, 6)
    literal: re.Pattern[str] = SIX_WITH_COMMAS
    flange_tools: frozenset[str] = frozenset()
    base_frames: frozenset[str] = frozenset({""})
    framed: bool = False
    case_sensitive: bool = False
    shared: re.Pattern[str] | None = None
    turns: Callable[[Matrix], bool] | None = None
    remark_width: int | None = None
    indented: bool = False
    opens: re.Pattern[str] | None = None
    matching: Callable[[Robot, str], Callable[[Matrix], bool] | None] | None = None
    comment_end: str = ""
    read: Callable[[str], Iterator[Statement]] | None = None
    positions: Callable[[str], list[tuple[int, int]]] | None = None
    words: Callable[[Branch, Matrix], str] | None = None
    saved_decimals: int | None = None
    derives: Callable[[Tree[Token]], bool] | None = None

    def for_correction(self) -> Language:
        """What `zerobeam export program` needs of it."""
        return Language(
            self.name,
            lambda source: LineProgram(self, source).read(),
            self.head,
            self.comment,
            self.pose,
            self.form,
            self.literals,
            self.case_sensitive,
            remark_width=self.remark_width,
            by_joint2=True,
            remark_end=self.comment_end,
        )

    def literals(self, text: str) -> list[tuple[int, int]]:
        """The spans of all that looks like joints or a pose."""
        if self.positions is not None:
            return self.positions(text)
        return [match.span() for match in self.literal.finditer(blanked(text, self.remark))]

    def statements(self, text: str) -> Iterator[Statement]:
        """Each line that is not blank."""
        if self.read is not None:
            yield from self.read(text)
            return
        code = blanked(text, self.remark, strings=False)
        if not self.case_sensitive:  # the grammar is in capitals
            code = capitals(code)
        depth, routine, behind_head = 0, False, False  # in a routine; the line before is its head
        opened = False  # the line before opens a block
        for line in re.finditer(r"[^\r\n]+", code):
            if line[0].strip():
                tree = understood(self.grammar, "statement", code, *line.span())
                inner = None if tree is None else tree.children[0]
                if not isinstance(inner, Tree) or (self.derives is not None and not self.derives(inner)):
                    inner = None
                indent = len(line[0]) - len(line[0].lstrip())
                if self.indented and indent != depth:
                    main = routine and not indent
                    if main or not behind_head:
                        yield line.start(), line.start(), Tree("main" if main else "join", [])
                    depth, routine = indent, routine and not main
                behind_head = inner is not None and inner.data == "routine"
                if self.opens is not None:
                    if opened and not line[0].lstrip().startswith("{"):
                        inner = None
                    opened = bool(self.opens.search(line[0])) and not line[0].rstrip().endswith("{")
                if (
                    self.indented and behind_head and indent
                ):  # a routine in a block: when it is there is not known
                    inner, behind_head = None, False
                routine |= behind_head
                yield line.start(), line.end(), inner


@dataclass(frozen=True, eq=False)
class _Position:
    """Joints or a pose as the program has it, with the names of its tool and frame if it is of some: a tool
    of None is that of the motion."""

    line: int
    values: tuple[Token, ...]
    is_pose: bool | None  # None: the motion says it
    configuration: str
    frames: tuple[str | None, str | None] | None = None
    words: tuple[Token, ...] = ()

    @property
    def span(self) -> tuple[int, int]:
        return span(self.values[0])[0], span(self.values[-1])[1]

    @property
    def numbers(self) -> list[float]:
        return [float(value) for value in self.values]


def _tokens(tree: Tree[Token], kind: str) -> list[Token]:
    return [token for token in tree.scan_values(lambda token: isinstance(token, Token)) if token.type == kind]


def _is_pose(tree: Tree[Token], joints_follow: bool | None) -> bool | None:
    """Whether a position is a pose; None where nothing in its line or above says it."""
    if tree.data == "entry":
        return not joints_follow
    return None if list(tree.find_data("numbers")) else bool(list(tree.find_data("pose")))


class LineProgram:
    """One program. A name of tool or frame is None where what is active is not known, "" where the program
    has not set it."""

    def __init__(self, language: LineLanguage, source: Source) -> None:
        self.language, self.source, self.facts = language, source, source.facts
        self.parsed, self.pendant = Parsed(), Pendant(source.robot)
        self.positions: dict[str, _Position] = {}
        self.left: set[str] = set()
        self.known: set[int] = set()  # where the name of a position may be
        self.trees: list[tuple[int, str, Tree[Token]]] = []
        self.declared: dict[str, Matrix] = {}  # tools and frames that are written as a pose
        self.used: dict[str, tuple[str | None, str | None]] = {}
        self.first = True
        self.active: dict[str, str | None] = {"tool": "", "frame": ""}
        self.steady = True  # neither branch nor label since the routine began
        self.sure: set[str] = set()  # tool and frame that were set before
        self.main = (self.active, self.sure, self.steady)  # of the main program, around a routine in it
        self.settings: dict[str, dict[str, set[str]]] = {}  # of each routine
        self.routine = ""

    def read(self) -> Parsed:
        text = self.source.text
        for begin, end, tree in self.language.statements(text):
            written = " ".join(text[begin:end].split())[:60]
            if tree is None:
                self._problem(begin, f"{written}: this is not understood")
            else:
                self.trees.append((begin, written, tree))
        self._declare()
        self._collect_settings()
        for begin, written, tree in self.trees:
            self._go(begin, written, tree)
        self._rest()
        return self.parsed

    def _problem(self, pos: int, sentence: str) -> None:
        self.parsed.problems.append((self.source.line(pos), sentence))

    def _key(self, name: str) -> str:
        return name if self.language.case_sensitive else name.lower()

    # Positions

    def _declare(self) -> None:
        """All positions that have a name, with tool and frame where these are of the positions."""
        joints_follow, words = None, ""
        frames = {"tool": "", "frame": ""}
        within = ""  # the last line that says in what positions are
        for begin, written, tree in self.trees:
            if tree.data in _FOLLOW:
                joints_follow, words = _FOLLOW[tree.data], ""
            elif tree.data in ("in_base", "in_frame"):
                within = tree.data
            elif tree.data == "configuration":
                words = " ".join(_tokens(tree, "CONFIGURATION"))
            elif tree.data in frames and self.language.framed:
                frames[tree.data] = self._frame_name(begin, tree)
            elif tree.data == "definition":
                self._define(tree)
            elif tree.data in ("position", "entry"):
                name = _tokens(tree, "NAME")[0]
                if tree.data == "entry" and joints_follow is None:
                    self._problem(begin, f"{written}: nothing says whether these are joints or a pose")
                    continue
                is_pose = _is_pose(tree, joints_follow)
                if is_pose is None and len(_tokens(tree, "VALUE")) < _FEWEST:  # an array of something else
                    continue
                configuration = " ".join(_tokens(tree, "CONFIGURATION")) or words
                framed: tuple[str | None, str | None] | None = None
                if self.language.framed:
                    framed = frames["tool"], {"in_base": _IN_BASE, "in_frame": frames["frame"]}.get(within)
                for frame in tree.find_data("frame"):
                    framed = None, self._frame_name(begin, frame)
                position = _Position(
                    self.source.line(begin),
                    tuple(_tokens(tree, "VALUE")),
                    is_pose,
                    configuration,
                    framed,
                    tuple(_tokens(tree, "CONFIGURATION")),
                )
                self._named(begin, str(name), span(name)[0], position)

    def _named(self, begin: int, name: str, pos: int, position: _Position) -> None:
        key = self._key(name)
        self.known.add(pos)
        if self.facts.leaves(key, name):
            self.left.add(key)
            self.parsed.literals.append(LiteralSpan(*position.span, "left"))
        elif self.language.shared is not None and self.language.shared.fullmatch(name):
            self._problem(begin, f"{name} belongs to other programs too (--leave {name}?)")
        elif key in self.positions:
            self._problem(begin, f"{name} has a value more than once")
        else:
            self.positions[key] = position

    def _define(self, tree: Tree[Token]) -> None:
        name, father = (self._key(str(word)) for word in _tokens(tree, "WORD"))
        values = _tokens(tree, "VALUE")
        pose = self._pose(values)
        if name in self.declared:
            self._problem(span(values[0])[0], f"{name} has a value more than once")
        self.declared[name] = np.asarray(self.declared.get(father, NULL) @ pose)
        self.parsed.literals.append(LiteralSpan(span(values[0])[0], span(values[-1])[1], "frame"))

    def _pose(self, values: Sequence[Token]) -> Matrix:
        """The pose of a tool or frame; a problem where its numbers are of none."""
        numbers = [float(value) for value in values]
        if len(numbers) >= 6 and not any(numbers[6:]) and max(map(abs, numbers)) <= _FARTHEST:
            return self.language.pose(numbers[:6])
        self._problem(span(values[0])[0], "these numbers are not those of a tool or frame")
        return NULL

    def _frame_name(self, begin: int, tree: Tree[Token]) -> str:
        """The name of the tool or frame of a statement; one that is written as a pose is called by its
        place."""
        poses = list(tree.find_data("pose"))
        if not poses:
            name = self._key(str(_tokens(tree, "WORD")[0]))
            self.facts.has("--tool" if tree.data == "tool" else "--frame", name)
            return name
        values = _tokens(poses[0], "VALUE")
        name = f"in line {self.source.line(begin)}"
        if name not in self.declared:
            self.declared[name] = self._pose(values)
            self.parsed.literals.append(LiteralSpan(span(values[0])[0], span(values[-1])[1], "frame"))
        for other, pose in self.declared.items():  # the same pose is the same tool
            if np.allclose(pose, self.declared[name]):
                return other
        return name

    # Statements

    def _collect_settings(self) -> None:
        if self.language.framed:
            return
        routine = ""
        for begin, _, tree in self.trees:
            if tree.data == "main":
                routine = ""
            if tree.data == "routine":
                routine = self._key(str(_tokens(tree, "WORD")[0]))
                if routine in self.settings:
                    self._problem(begin, f"{routine} is defined twice")
            here = self.settings.setdefault(routine, {"tool": set(), "frame": set()})
            if tree.data in self.active:
                here[tree.data].add(self._frame_name(begin, tree))

    def _go(self, begin: int, written: str, tree: Tree[Token]) -> None:
        if tree.data in ("motion", "linear"):
            before = dict(self.active)
            for part in (each for each in tree.iter_subtrees() if each.data in before):
                self.active[part.data] = self._frame_name(begin, part)
            words = [word for part in tree.find_data("reached_as") for word in _tokens(part, "CONFIGURATION")]
            for at in tree.find_data("at"):
                self._motion(begin, written, at, " ".join(words), linear=tree.data == "linear")
            self.active = before
        elif tree.data in self.active and not self.language.framed:
            self.active[tree.data] = self._frame_name(begin, tree)
            if self.steady:
                self.sure.add(tree.data)
        elif tree.data == "main":
            self.routine, self.first = "", True
            self.active, self.sure, self.steady = self.main
        elif tree.data == "routine":
            if not self.routine:
                self.main = self.active, self.sure, self.steady
            self.routine = self._key(str(_tokens(tree, "WORD")[0]))
            self.active = self._at_begin(self.routine)
            self.sure, self.first, self.steady = set(), True, True
        elif tree.data == "join":
            self._joined(self.settings.get(self.routine, {}))
        for call in (each for each in tree.iter_subtrees() if each.data == "call"):
            self._call(begin, written, str(_tokens(call, "WORD")[0]))

    def _at_begin(self, routine: str) -> dict[str, str | None]:
        """What is active where a routine begins: where another one sets it, it may be called behind that."""
        others = [each for name, each in self.settings.items() if name != routine]
        return {which: None if any(each[which] for each in others) else "" for which in self.active}

    def _joined(self, settings: dict[str, set[str]]) -> None:
        """A tool that was set before all branches, and is set to no other, is still active."""
        self.first, self.steady = True, False
        for which, names in settings.items():
            if names and (len(names) > 1 or which not in self.sure):
                self.active[which] = None

    def _call(self, begin: int, written: str, name: str) -> None:
        key = self._key(name)
        if key in self.settings and key:
            self.first = True
            for which, names in self.settings[key].items():
                if names - {self.active[which]}:
                    self.active[which] = None
        elif not self.facts.harmless(key, name):
            self._problem(begin, f"{written}: what {name} does is not known; --call {name} {_HARMLESS}")

    def _motion(self, begin: int, written: str, at: Tree[Token], reached_as: str, *, linear: bool) -> None:
        line = self.source.line(begin)
        names = _tokens(at, "NAME")
        if names:
            key = self._key(str(names[0]))
            self.known.add(span(names[0])[0])
            if key in self.left or self.facts.leaves(key, str(names[0])):
                self.parsed.motions.append(Motion(None, line, False, True))
                self.first = True
                return
            if key not in self.positions:
                if not self.parsed.speaks_of(line, str(names[0])):
                    self._problem(begin, f"{names[0]} has no value in this file (--leave {names[0]}?)")
                self.first = True
                return
            name, position = self.source.written(key), self._of_kind(begin, written, at, key)
            if position is None:
                self.first = True
                return
        else:
            tokens = tuple(_tokens(at, "VALUE"))
            name = self.source.key_at(span(tokens[0])[0], self.parsed.targets)
            words = tuple(_tokens(at, "CONFIGURATION"))
            is_pose = bool(list(at.find_data("pose")))
            position = _Position(line, tokens, is_pose, " ".join(words), words=words)
        if self.language.matching is not None:
            position = replace(position, configuration=reached_as)
        if self._enter(begin, written, name, position):
            self.parsed.motions.append(Motion(name, line, linear, self.first))
            self.first = False
        else:
            self.first = True

    def _of_kind(self, begin: int, written: str, at: Tree[Token], key: str) -> _Position | None:
        """The position of a name, of the kind that the motion requires; None where it is of the other one."""
        position = self.positions[key]
        kinds = [each.data == "only_pose" for each in at.iter_subtrees() if each.data in _KINDS]
        if kinds and position.is_pose is None:
            position = self.positions[key] = replace(position, is_pose=kinds[0])
        if position.is_pose is None or (kinds and position.is_pose != kinds[0]):
            self._problem(begin, f"{written}: the motion takes {'a pose' if kinds[0] else 'joints'} alone")
            return None
        return position

    def _enter(self, begin: int, written: str, name: str, position: _Position) -> bool:
        """Enter the target of a motion; False where it is a problem."""
        tool, frame = position.frames or (None, self.active["frame"])
        frames = (self.active["tool"] if tool is None else tool, frame)
        if name in self.parsed.targets:
            if position.is_pose and frames != self.used[name]:
                self._problem(begin, f"{written}: {name} is used with different tools or frames")
            if getattr(self.parsed.targets[name], "configuration", "") != position.configuration:
                self._problem(begin, f"{written}: {name} is used with different configurations")
            return True
        values, count = position.numbers, 6 if position.is_pose else self.source.robot.n
        if len(values) < count or any(values[count:]):  # zeros may follow, of axes that there are not
            self._problem(begin, f"{name} has {len(values)} numbers, and not {count}")
            return False
        self.parsed.literals.append(LiteralSpan(*position.span, "target"))
        pulses = not position.is_pose and self.language.unit == "pulse"
        if max(map(abs, values)) > _FARTHEST or (pulses and any(value % 1 for value in values)):
            self._problem(begin, f"{name} has a number that no position has")
            return False
        self.used[name] = frames
        spans = [span(value) for value in position.values[:count]]
        if position.is_pose:
            return self._enter_pose(begin, name, position, spans)
        per_degree = self.pendant.per_degree(self.language.unit)
        decimals = [self.language.joint_decimals] * count

        def write(joints: Matrix) -> list[Edit]:
            numbers = self.pendant.counted(joints) * per_degree
            return number_edits(spans, self.source.text, numbers.tolist(), decimals)

        joints = self.pendant.between_links(np.array(values[:count]) / per_degree)
        self.parsed.targets[name] = JointTarget(name, position.line, joints, write)
        return True

    def _enter_pose(
        self, begin: int, name: str, position: _Position, spans: Sequence[tuple[int, int]]
    ) -> bool:
        if self.language.turns is not None and not position.configuration:
            self._problem(begin, f"{name} has no configuration")
            return False
        poses = []
        for option, which, known, frame in (
            ("--tool", "tool", self.facts.tool, self.used[name][0]),
            ("--frame", "frame", self.facts.frame, self.used[name][1]),
        ):
            if frame is None:
                self._problem(
                    begin,
                    f"{name}: which {which} is active here is not known; set it in a line before the motion",
                )
                return False
            pose = known(frame, self._pose_of(which, frame))
            if pose is None:
                of = f"{which} {frame} is not known" if frame else f"the program does not set the {which}"
                name_of = f"{frame}=" if frame else ""
                self._problem(begin, f"{name}: {of}; state {option} {name_of}{self.language.form}")
                return False
            poses.append(pose)

        words = self.language.words

        def write(pose: Matrix, branch: Branch | None, joints: Matrix) -> list[Edit]:
            numbers = self.language.numbers(pose)
            edits = number_edits(spans, self.source.text, numbers, self.language.pose_decimals)
            if words is not None and branch is not None and position.words:
                right = words(branch, joints).split()
                edits += [
                    Edit(*span(old), new)
                    for old, new in zip(position.words, right, strict=True)
                    if old != new
                ]
            return edits

        matching = None
        if self.language.matching is not None and position.configuration:
            matching = self.language.matching(self.source.robot, position.configuration)
            if matching is None:
                self._problem(
                    begin, f"{name}: it is not known which joints have the configuration of this motion"
                )
                return False
        self.parsed.targets[name] = PoseTarget(
            name,
            position.line,
            self.language.pose(position.numbers[:6]),
            poses[0],
            poses[1],
            None,
            position.configuration,
            write,
            matching=matching,
            turns=self.language.turns,
            words=words,
        )
        return True

    def _pose_of(self, which: str, name: str) -> Matrix | None:
        """The pose of a tool or frame that the program itself states; the null ones of the language too."""
        if which == "frame" and (name in self.language.base_frames or name == _IN_BASE):
            return NULL
        return NULL if which == "tool" and name in self.language.flange_tools else self.declared.get(name)

    def _rest(self) -> None:
        """Names of positions that are used otherwise, and positions that no motion uses."""
        for begin, _, tree in self.trees:
            for name in _tokens(tree, "NAME"):
                key = self._key(str(name))
                if key in self.positions and span(name)[0] not in self.known:
                    self.parsed.changed(self.source.line(begin), str(name))
        for key, position in self.positions.items():
            written = self.source.written(key)
            if written in self.parsed.targets or self.parsed.speaks_of(position.line, written):
                continue
            begin = position.span[0]
            if position.is_pose is None or (
                position.is_pose and (position.frames is None or position.frames[0] is None)
            ):
                self._problem(begin, f"{written} is not the target of a motion here (--leave {written}?)")
            else:
                self._enter(begin, written, written, position)


def taught_points(language: LineLanguage, text: str, robot: Robot, path: Path) -> list[TaughtPoint]:
    """All positions of a program, in its order: those that have a name, and those in motions ("line 12").

    Joints are degrees as the controller counts them. BadInput for what looks like joints or a pose and is
    not understood.
    """
    points, spans = [], set()
    joints_follow: bool | None = None
    per_degree = Pendant(robot).per_degree(language.unit)
    for begin, _, tree in language.statements(text):
        if tree is None:
            continue
        line = text.count("\n", 0, begin) + 1
        if tree.data in _FOLLOW:
            joints_follow = _FOLLOW[tree.data]
        kinds = ("position", "entry", "at", "tool", "frame", "definition")
        for part in (each for each in reversed([*tree.iter_subtrees()]) if each.data in kinds):
            values = _tokens(part, "VALUE")
            if not values:
                continue
            spans.add((span(values[0])[0], span(values[-1])[1]))
            if part.data in ("tool", "frame", "definition"):
                continue
            names = _tokens(part, "NAME")
            is_pose = _is_pose(part, joints_follow)
            if is_pose is None and _POSTURE.fullmatch(str(names[0])):
                is_pose = False
            numbers = np.array([float(value) for value in values])
            joints = None
            if is_pose is False:
                numbers[: robot.n] /= per_degree[: len(numbers)]
                joints = tuple(numbers.tolist())
            name = f"line {line}"
            if names:
                written = text[slice(*span(names[0]))]
                name = written if capitals(written) == capitals(names[0]) else str(names[0])
            points.append(TaughtPoint(name, joints, line))
    for begin, end in language.literals(text):
        if (begin, end) not in spans:
            raise BadInput(
                "a position of the program is not understood",
                found=" ".join(text[begin:end].split())[:60],
                remedy="save the program as text again, or import the positions as csv",
                file=path,
                line=text.count("\n", 0, begin) + 1,
            )
    return points


def import_taught(
    language: LineLanguage,
    job: ImportJob,
    *,
    points: Sequence[str] | None,
    vendor: str,
    note: str,
    named: Callable[[str, list[TaughtPoint]], list[TaughtPoint]] = lambda text, taught: taught,
) -> Imported:
    """Measurements at the positions of programs that were taught, or of a plan's program: what it recorded
    (zb_m0, zb_m1, …), or its postures (zb_p0, …) where they were taught again with the beam on the target.

    `named` gives the positions of a text these names, in a language whose positions have numbers. Postures
    that are still as the plan has them are left out; BadInput for the program of another plan.
    """

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        with located(path):
            for number, content in enumerate(text.split("\n"), start=1):
                with located(path, number):
                    require_same_plan(content, job)
        taught = named(text, taught_points(language, text, job.robot, path))
        ours = [(point, match) for point in taught if (match := _POSTURE.fullmatch(point.name))]
        if points is not None or not ours:
            return taught
        recorded = "m" if any(match[1] in "mM" for _, match in ours) else "p"
        numbers = {int(match[2]) for _, match in ours if match[1].lower() == recorded}
        missing = set(range(0 if job.plan is None else len(job.plan.postures))) - numbers
        if missing:  # a plan's program has all of them, whether they were recorded or not
            raise BadInput(
                "a posture of the plan is not in the file",
                found=f"no zb_{recorded}{min(missing)}",
                remedy="save or copy the whole file again; or name the positions to use (--points)",
            )
        measured = [
            point._replace(number=int(match[2]))
            for point, match in ours
            if match[1].lower() == recorded and not _as_planned(language, job, point, int(match[2]))
        ]
        if not measured:
            raise BadInput(
                "no measurements found: every position is still as the plan has it",
                file=path,
                remedy="record the positions at the controller with the beam on the centre, save the program"
                " there, and import the saved file",
            )
        return measured

    return import_points(job, parse, names=points, vendor=vendor, note=note)


def _as_planned(language: LineLanguage, job: ImportJob, point: TaughtPoint, number: int) -> bool:
    """Whether a posture of the plan's program is still as the plan has it, to the program's digits."""
    if job.plan is None or point.joints is None or not number < len(job.plan.postures):
        return False
    if len(point.joints) < job.robot.n:
        return False
    pendant = Pendant(job.robot)
    planned = pendant.counted(job.plan.postures[number] * job.robot.display)
    decimals = language.joint_decimals if language.saved_decimals is None else language.saved_decimals
    digits = 10.0**-decimals / np.abs(pendant.per_degree(language.unit))
    return bool((np.abs(np.array(point.joints[: job.robot.n]) - planned) <= digits).all())
