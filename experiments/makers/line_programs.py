"""A program in a language of lines (line_language): its targets, motions, and what forbids to correct it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from lark import Token, Tree

from ...model.arrays import Matrix
from ...model.kinematics.branches import Branch
from ...model.kinematics.pendant import Pendant
from .line_language import FOLLOW, LineLanguage, is_a_pose, tokens
from .program_parts import (
    NULL,
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
)

_FEWEST = 6  # numbers of a position
_FARTHEST = 1e8  # mm, degrees or pulses: no position has more
_IN_BASE = "base"  # the frame of positions in the base frame
_KINDS = ("only_joints", "only_pose")
_HARMLESS = "states that it moves no arm and changes no tool, frame or position"


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
                words = self.language.computed.items()
                why = (reason for pattern, reason in words if re.search(pattern, written, re.IGNORECASE))
                self._problem(begin, f"{written}: {next(why, 'this is not understood')}")
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
            if tree.data in FOLLOW:
                joints_follow, words = FOLLOW[tree.data], ""
            elif tree.data in ("in_base", "in_frame"):
                within = tree.data
            elif tree.data == "configuration":
                words = " ".join(tokens(tree, "CONFIGURATION"))
            elif tree.data in frames and self.language.framed:
                frames[tree.data] = self._frame_name(begin, tree)
            elif tree.data == "definition":
                self._define(tree)
            elif tree.data in ("position", "entry"):
                name = tokens(tree, "NAME")[0]
                if tree.data == "entry" and joints_follow is None:
                    self._problem(begin, f"{written}: nothing says whether these are joints or a pose")
                    continue
                is_pose = is_a_pose(tree, joints_follow)
                if is_pose is None and len(tokens(tree, "VALUE")) < _FEWEST:  # an array of something else
                    continue
                configuration = " ".join(tokens(tree, "CONFIGURATION")) or words
                framed: tuple[str | None, str | None] | None = None
                if self.language.framed:
                    framed = frames["tool"], {"in_base": _IN_BASE, "in_frame": frames["frame"]}.get(within)
                for frame in tree.find_data("frame"):
                    framed = None, self._frame_name(begin, frame)
                position = _Position(
                    self.source.line(begin),
                    tuple(tokens(tree, "VALUE")),
                    is_pose,
                    configuration,
                    framed,
                    tuple(tokens(tree, "CONFIGURATION")),
                )
                self._named(begin, str(name), span(name)[0], position)

    def _named(self, begin: int, name: str, pos: int, position: _Position) -> None:
        key = self._key(name)
        name = self.source.written(key)
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
        name, father = (self._key(str(word)) for word in tokens(tree, "WORD"))
        values = tokens(tree, "VALUE")
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
            name = self._key(str(tokens(tree, "WORD")[0]))
            self.facts.has("--tool" if tree.data == "tool" else "--frame", name)
            return name
        values = tokens(poses[0], "VALUE")
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
                routine = self._key(str(tokens(tree, "WORD")[0]))
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
            words = [word for part in tree.find_data("reached_as") for word in tokens(part, "CONFIGURATION")]
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
            self.routine = self._key(str(tokens(tree, "WORD")[0]))
            self.active = self._at_begin(self.routine)
            self.sure, self.first, self.steady = set(), True, True
        elif tree.data == "join":
            self._joined(self.settings.get(self.routine, {}))
        for call in (each for each in tree.iter_subtrees() if each.data == "call"):
            self._call(begin, written, str(tokens(call, "WORD")[0]))

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
        elif not self.facts.harmless(key, called := self.source.written(key)):
            self._problem(begin, f"{written}: what {called} does is not known; --call {called} {_HARMLESS}")

    def _motion(self, begin: int, written: str, at: Tree[Token], reached_as: str, *, linear: bool) -> None:
        line = self.source.line(begin)
        names = tokens(at, "NAME")
        if names:
            key = self._key(str(names[0]))
            name = self.source.written(key)
            self.known.add(span(names[0])[0])
            if key in self.left or self.facts.leaves(key, name):
                self.parsed.motions.append(Motion(None, line, False, True))
                self.first = True
                return
            if key not in self.positions:
                if not self.parsed.speaks_of(line, name):
                    self._problem(begin, f"{name} has no value in this file (--leave {name}?)")
                self.first = True
                return
            position = self._of_kind(begin, written, at, key)
            if position is None:
                self.first = True
                return
        else:
            values = tuple(tokens(at, "VALUE"))
            name = self.source.key_at(span(values[0])[0], self.parsed.targets)
            words = tuple(tokens(at, "CONFIGURATION"))
            is_pose = bool(list(at.find_data("pose")))
            position = _Position(line, values, is_pose, " ".join(words), words=words)
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
        tool = self._known_pose(begin, name, "tool", self.used[name][0])
        frame = self._known_pose(begin, name, "frame", self.used[name][1])
        if tool is None or frame is None:
            return False

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
            tool,
            frame,
            None,
            position.configuration,
            write,
            matching=matching,
            turns=self.language.turns,
            words=words,
            words_mean=self.language.words_mean,
        )
        return True

    def _known_pose(
        self, begin: int, target: str, which: Literal["tool", "frame"], name: str | None
    ) -> Matrix | None:
        """The pose of the tool or frame of a target; None where that is a problem."""
        if name is None:
            self._problem(
                begin,
                f"{target}: which {which} is active here is not known; set it in a line before the motion",
            )
            return None
        pose_of = self.facts.tool if which == "tool" else self.facts.frame
        pose = pose_of(name, self._pose_of(which, name))
        if pose is None:
            lacking = f"{which} {name} is not known" if name else f"the program does not set the {which}"
            option: Literal["--tool", "--frame"] = "--tool" if which == "tool" else "--frame"
            request = self.facts.require(option, name, self.language.form)
            self._problem(begin, f"{target}: {lacking}; {request}")
        return pose

    def _pose_of(self, which: str, name: str) -> Matrix | None:
        """The pose of a tool or frame that the program itself states; the null ones of the language too."""
        if which == "frame" and (name in self.language.base_frames or name == _IN_BASE):
            return NULL
        return NULL if which == "tool" and name in self.language.flange_tools else self.declared.get(name)

    def _rest(self) -> None:
        """Names of positions that are used otherwise, and positions that no motion uses."""
        for begin, _, tree in self.trees:
            for name in tokens(tree, "NAME"):
                key = self._key(str(name))
                if key in self.positions and span(name)[0] not in self.known:
                    self.parsed.changed(self.source.line(begin), self.source.written(key))
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


def for_correction(language: LineLanguage | Language) -> Language:
    """What `zerobeam export program` needs of a language."""
    if isinstance(language, Language):
        return language
    return Language(
        language.name,
        lambda source: LineProgram(language, source).read(),
        language.head,
        language.comment,
        language.pose,
        language.form,
        language.literals,
        language.case_sensitive,
        remark_width=language.remark_width,
        by_joint2=True,
        remark_end=language.comment_end,
        marked=language.marked,
        with_data=language.with_data,
    )
