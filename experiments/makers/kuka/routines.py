"""The routines of a KRL module as steps: which may follow which, what each changes, its motions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from lark import Token, Tree

from .flow import SETTING, Change, FlowStep, ModuleFrames, Routine, assigned, nothing_known, perhaps_kept
from .statements import BUILT_IN, POSE, KrlNames, KrlStatement, fields

_IN_DATA_LIST = {"declaration", "value", "external", "signal", "enumeration"}
_QUIET = {"output", "load", "nothing", "assignment", "header", "interrupt", "home"}
_ENDS = {
    "endif": "if",
    "endfor": "for",
    "endwhile": "while",
    "endloop": "loop",
    "until": "repeat",
    "endswitch": "switch",
    "endspline": "spline",
}


class Move(NamedTuple):
    """A motion of the text to one target (of a circle there are two): PTP, or linear. `own` is what tool and
    base are for it alone."""

    word: str
    linear: bool
    target: Tree[Token] | Token
    pos: int
    changes: tuple[Change, ...]


@dataclass
class _OpenStructure:
    """A structure that is not closed yet: its steps that lead behind it."""

    kind: str
    pos: int
    begin: int
    leaving: list[int] = field(default_factory=list)
    complete: bool = False  # one of its branches is taken in any case


class Routines:
    """All of a module, and their motions in the order of the text."""

    def __init__(self, names: KrlNames) -> None:
        self.names = names
        self.routines: dict[str, Routine] = {}
        self.moves: list[Move] = []
        self.frames = ModuleFrames(names)
        self._frames: set[str] = set()  # routines that change a frame
        self._by_others: list[tuple[str, int]] = []  # routines that interrupts call

    def read(self, rows: list[KrlStatement]) -> None:
        for each in rows:
            if each.kind in ("routine", "function"):
                self._declare(each)
        routine: _Builder | None = None
        in_data_list = False
        for each in rows:
            if each.kind == "header":
                continue
            inside = routine is not None or in_data_list
            if each.kind == "end":
                words = ("ENDDAT",) if in_data_list else ("END", "ENDFCT")
                if not inside or each.tree.children[0] not in words:
                    self.names.problem(each.pos, "this END belongs to nothing")
                if routine is not None:
                    routine.finish()
                routine, in_data_list = None, False
            elif inside and each.kind in ("routine", "function", "data_list"):
                self.names.problem(each.pos, "the routine or data list above it has no END")
                return
            elif each.kind in ("routine", "function"):
                routine = _Builder(self, self.routines[each.names()[-1].lower()])
            elif each.kind == "data_list":
                in_data_list = True
            elif routine is not None:
                routine.read(each)
            elif not (in_data_list and each.kind in _IN_DATA_LIST):
                self.names.problem(each.pos, "this statement is in no routine")
        if routine is not None or in_data_list:
            self.names.problem(rows[-1].pos, "the program ends without END or ENDDAT")
        self._check_interrupts()

    def _declare(self, statement: KrlStatement) -> None:
        name = statement.names()[-1].lower()
        if name in self.routines or name.upper() in BUILT_IN | {"BAS"}:
            self.names.problem(statement.pos, f"the routine {self.names.source.written(name)} is there twice")
        for parameter in statement.tree.find_data("parameter"):
            if self.names.holds_position(str(parameter.children[0]).lower()):
                self.names.problem(
                    statement.pos, f"{parameter.children[0]} is a position, and a parameter of {name}"
                )
        public = any(isinstance(child, Tree) and child.data == "global_" for child in statement.tree.children)
        self.routines[name] = Routine(name, not self.routines or public)

    def _check_interrupts(self) -> None:
        for name, pos in self._by_others:
            if self.moves_or_frames(name, set()):
                self.names.problem(
                    pos, f"{self.names.source.written(name)} moves the arm or changes frames at any time"
                )

    def moves_or_frames(self, name: str, visited: set[str]) -> bool:
        """Whether a routine of the module does, or one that it calls."""
        if name in visited:
            return False
        visited.add(name)
        steps = self.routines[name].steps
        return name in self._frames or any(
            step.motion is not None or (step.call is not None and self.moves_or_frames(step.call, visited))
            for step in steps
        )


class _Builder:
    def __init__(self, module: Routines, routine: Routine) -> None:
        self.module, self.names, self.routine = module, module.names, routine
        self.last: list[int] = [0]
        self.stack: list[_OpenStructure] = []
        self.labels: dict[str, int] = {}
        self.jumps: list[tuple[int, str, int]] = []
        self.block: tuple[Change, ...] | None = None  # what the SPLINE block sets

    def finish(self) -> None:
        for each in self.stack:
            self.names.problem(each.pos, f"this {each.kind.upper()} is not closed")
        for at, name, jump in self.jumps:
            if name in self.labels:
                self.routine.steps[at].after.append(self.labels[name])
            else:
                self.names.problem(jump, f"the label {self.names.source.written(name)} is not in its routine")
        for at in self.last:
            self.routine.steps[at].after.append(1)

    def read(self, statement: KrlStatement) -> None:
        kind, tree = statement.kind, statement.tree
        if self.block is not None and kind not in ("to", "through", "interrupt", "endspline", "output"):
            self.names.problem(statement.pos, "this statement is not understood within a SPLINE block")
        if not self.last and kind not in ("label", "else", "case", "default", *_ENDS):
            # Nothing leads here: neither is it known what is active.
            self.last = [self._step(FlowStep(change=nothing_known), before=[0])]
        self._expressions(statement)
        if kind in ("to", "through", "spline", "endspline"):
            self._motion(statement)
        elif kind in SETTING:
            self.module._frames.add(self.routine.name)
            self._step(FlowStep(change=self.module.frames.change(tree)))
        elif kind in _STRUCTURES:
            self._structure(statement)
        elif kind in ("routine", "function", "data_list") or kind not in _KNOWN:
            self.names.problem(statement.pos, "this statement is not allowed here")

    def _step(self, step: FlowStep, before: Iterable[int] | None = None) -> int:
        at = self.routine.add(step, self.last if before is None else before)
        if before is None:
            self.last = [at]
        return at

    # Control flow

    def _structure(self, statement: KrlStatement) -> None:
        kind, pos = statement.kind, statement.pos
        if kind in ("if", "switch", "while", "for", "loop", "repeat"):
            self.stack.append(_OpenStructure(kind, pos, self._step(FlowStep())))
            if kind == "switch":
                self.last = []
        elif kind == "label":
            name = statement.names()[0].lower()
            if name in self.labels:
                self.names.problem(pos, f"the label {statement.names()[0]} is there twice")
            self.labels[name] = self._step(FlowStep())
        elif kind == "goto":
            self.jumps.append((self._step(FlowStep()), statement.names()[0].lower(), pos))
            self.last = []
        elif kind == "return":
            self.routine.steps[self._step(FlowStep())].after.append(1)
            self.last = []
        elif kind == "exit":
            loop = next((each for each in reversed(self.stack) if each.kind in _LOOPS), None)
            if loop is None:
                self.names.problem(pos, "EXIT is in no loop")
                return
            loop.leaving.append(self._step(FlowStep()))
            self.last = []
        else:
            self._close(kind, pos)

    def _close(self, kind: str, pos: int) -> None:
        """ELSE, CASE, DEFAULT and what ends a structure."""
        needed = _ENDS.get(kind, "if" if kind == "else" else "switch")
        if not self.stack or self.stack[-1].kind != needed:
            self.names.problem(pos, f"{kind.upper()} without {needed.upper()} before it")
            return
        open_one = self.stack[-1]
        if kind in ("else", "case", "default"):
            open_one.leaving += self.last
            open_one.complete |= kind != "case"
            self.last = [open_one.begin]
            self._step(FlowStep())
            return
        self.stack.pop()
        if needed in _LOOPS:
            end = self._step(FlowStep())
            self.routine.steps[end].after.append(open_one.begin)
            behind = {"loop": [], "repeat": [end]}.get(needed, [open_one.begin])
        else:
            behind = [*self.last, *([] if open_one.complete else [open_one.begin])]
        self.last = [*behind, *open_one.leaving]
        if self.last:
            self._step(FlowStep())

    # Motions

    def _motion(self, statement: KrlStatement) -> None:
        tree, kind, pos = statement.tree, statement.kind, statement.pos
        changes = tuple(
            self.module.frames.change(setting)
            for part in tree.find_data("with_")
            for setting in part.children
            if isinstance(setting, Tree) and setting.data in SETTING
        )
        if kind == "endspline":
            if self.block is None or not self.stack or self.stack[-1].kind != "spline":
                self.names.problem(pos, "ENDSPLINE without SPLINE before it")
                return
            self._step(FlowStep(change=perhaps_kept(self.block)))
            self.stack.pop()
            self.block = None
            return
        if kind == "spline":
            self.stack.append(_OpenStructure("spline", pos, self._step(FlowStep())))
            self.block = changes
            return
        word = str(tree.children[0])
        if self.block is not None and (changes or not word.startswith("S")):
            self.names.problem(pos, "this motion is not understood within a SPLINE block")
        if self.block is None and word == "SPL":
            self.names.problem(pos, "SPL is in no SPLINE block")
        changes = changes or self.block or ()
        for target in tree.children:
            if not isinstance(target, Tree) or target.data != "target":
                continue
            child = target.children[0]
            self.module.moves.append(Move(word, not word.endswith("PTP"), child, pos, changes))
            index = len(self.module.moves) - 1
            here = isinstance(child, Token) and child.type == "HERE"
            change = None if here else _arm_at(index)
            self._step(FlowStep(change=change, motion=index))
        if changes and self.block is None:
            self._step(FlowStep(change=perhaps_kept(changes)))

    # Expressions

    def _expressions(self, statement: KrlStatement) -> None:
        """KrlNames that are used, variables that are assigned, calls."""
        if statement.kind == "interrupt":
            self._interrupt(statement)
        for part in statement.tree.find_data("variable"):
            name = str(part.children[0]).lower()
            if self.names.holds_position(name) and statement.kind != "value":
                self.names.parsed.changed(
                    self.names.source.line(statement.pos), self.names.source.written(name)
                )
        if statement.kind in ("assignment", "for"):
            target = statement.tree.children[0]
            self._assigned(str(target.children[0] if isinstance(target, Tree) else target), statement.pos)
        if statement.kind == "home" and statement.names()[0].lower() not in self.names.positions:
            name = statement.names()[0]
            if not self.names.source.facts.leaves(name.lower(), name):
                self.names.problem(statement.pos, f"{name} has no value in these files (--leave {name}?)")
        for part in statement.tree.iter_subtrees():
            if part.data in ("data_of_path", "mode_of_data") and statement.kind != "header":
                self._of_path(part, statement.pos)
            if part.data == "load":
                for aggregate in part.find_data("aggregate"):
                    if set(fields(aggregate) or {}) & set(POSE):
                        self.names.claim(aggregate, "frame")
        if statement.kind != "interrupt":
            for call in statement.tree.find_data("call"):
                routine = self._called(call, statement.pos)
                if routine is not None and statement.kind in ("while", "for", "case"):
                    self.names.problem(
                        statement.pos, "a routine of the program in this condition is not understood"
                    )
                elif routine is not None:
                    self._step(FlowStep(call=routine))

    def _of_path(self, part: Tree[Token], pos: int) -> None:
        argument = part.children[0]
        if isinstance(argument, Tree):
            self.names.check_path(argument)
            return
        known = self.names.paths if part.data == "data_of_path" else self.names.frames
        if str(argument).lower() not in known and part.data == "data_of_path":
            self.names.problem(
                pos, f"{argument} has no value in these files, so that its ORI_TYP is not known"
            )

    def _assigned(self, name: str, pos: int) -> None:
        low = name.lower()
        if low not in self.names.scalars:
            self.names.problem(
                pos,
                f"{self.names.source.written(low)} is changed when the program runs, and is not declared here"
                " as INT, REAL, BOOL or CHAR",
            )

    def _called(self, call: Tree[Token], pos: int) -> str | None:
        """The routine of the module that is called; None for another, which is a problem unless it is known
        to be harmless."""
        name = str(call.children[0])
        low, written = name.lower(), self.names.source.written(name.lower())
        if low not in self.module.routines and name in BUILT_IN:
            return None
        for variable in call.find_data("variable"):
            argument = str(variable.children[0]).lower()
            if argument not in self.names.scalars and not self.names.holds_position(argument):
                shown = self.names.source.written(argument)
                self.names.problem(pos, f"{shown}, passed to {written}, is not declared here as a number")
        if low in self.module.routines:
            return low
        if not self.names.source.facts.harmless(low, written):
            self.names.problem(
                pos,
                f"{written} is a routine of another file, which may move the arm or change frames"
                f" (--call {written}, if it does not)",
            )
        return None

    def _interrupt(self, statement: KrlStatement) -> None:
        for action in statement.tree.children:
            if isinstance(action, Tree) and action.data == "assignment":
                target = action.children[0]
                assert isinstance(target, Tree)
                self._assigned(str(target.children[0]), statement.pos)
        for call in statement.tree.find_data("call"):
            name = self._called(call, statement.pos)
            if name is not None:
                self.module._by_others.append((name, statement.pos))


_LOOPS = {"while", "for", "loop", "repeat"}
_STRUCTURES = {
    *_LOOPS,
    *(set(_ENDS) - {"endspline"}),
    *("if", "else", "switch", "case", "default", "label", "goto", "return", "exit"),
}
_KNOWN = _QUIET | _IN_DATA_LIST | _STRUCTURES | SETTING | {"call", "data_of_path"}


def _arm_at(motion: int) -> Change:
    return lambda state: assigned(state, "arm", [("motion", motion)])
