"""Tool, base and motion before that may be active at each motion of a KRL module.

The values that each variable may have are followed along all ways through the routines, calls included:
"tool", "base", "data" (FDAT_ACT), "arm" (the motion that ended last), "tool 3" (TOOL_DATA[3]), "base 3".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from lark import Token, Tree

from ....model.arrays import Matrix
from ..program_parts import span
from .statements import KrlNames, pose_of, whole

Value = tuple[str, object]  # kind, which
Values = frozenset[Value]
State = dict[str, Values]  # a variable that is not here has the value that it had at the begin of the routine
Change = Callable[[State], State]


def entry(variable: str) -> Value:
    """The value at the begin of the routine."""
    return "entry", variable


def values(state: State, variable: str) -> Values:
    return state.get(variable, frozenset([entry(variable)]))


def assigned(state: State, variable: str, to: Iterable[Value]) -> State:
    return {**state, variable: frozenset(to)}


def joined(one: State | None, other: State) -> State:
    """The values that variables may have where two ways meet."""
    if one is None:
        return other
    return {name: values(one, name) | values(other, name) for name in one.keys() | other.keys()}


@dataclass(eq=False)
class FlowStep:
    """A statement of a routine: what it changes, which routine it calls, the steps that may follow, the
    motion that it is."""

    change: Change | None = None
    call: str | None = None
    motion: int | None = None
    after: list[int] = field(default_factory=list)


@dataclass(eq=False)
class Routine:
    """Steps; the first is its begin, the second its end. `open` to calls from other files."""

    name: str
    open: bool
    steps: list[FlowStep] = field(default_factory=lambda: [FlowStep(), FlowStep()])

    def add(self, step: FlowStep, before: Iterable[int]) -> int:
        self.steps.append(step)
        at = len(self.steps) - 1
        for each in before:
            self.steps[each].after.append(at)
        return at


class Flow:
    """The states before the motions of a program; `start` says what variables are when other files call."""

    def __init__(self, routines: dict[str, Routine], start: Callable[[str], Values]) -> None:
        self.routines, self.start = routines, start
        self._ends: dict[str, State | None] = dict.fromkeys(routines)
        self._before: dict[str, list[State | None]] = {}
        self._at = {
            step.motion: (name, at)
            for name, routine in routines.items()
            for at, step in enumerate(routine.steps)
            if step.motion is not None
        }
        going = True
        while going:
            going = False
            for name, routine in routines.items():
                self._before[name] = self._run(routine)
                end = self._before[name][1]
                if end != self._ends[name]:
                    self._ends[name], going = end, True
        self._call_sites()

    def before(self, motion: int) -> State | None:
        """Values of variables before a motion, but for those that are as they were at the begin;
        None where nothing leads to it."""
        name, at = self._at[motion]
        return self._before[name][at]

    def resolved(self, motion: int, to_resolve: Values) -> Values:
        """Values with those put in that the routine of a motion may begin with."""
        return self._with_entries(self._at[motion][0], to_resolve)

    def _run(self, routine: Routine) -> list[State | None]:
        before: list[State | None] = [None] * len(routine.steps)
        before[0] = {}
        work = [0]
        while work:
            at = work.pop()
            state = before[at]
            assert state is not None
            after = self._after(routine.steps[at], state)
            if after is None:
                continue
            for following in routine.steps[at].after:
                met = joined(before[following], after)
                if met != before[following]:
                    before[following] = met
                    work.append(following)
        return before

    def _after(self, step: FlowStep, state: State) -> State | None:
        if step.call is not None:
            end = self._ends[step.call]
            if end is None:
                return None
            return {**state, **{name: _substituted(at_end, state) for name, at_end in end.items()}}
        return state if step.change is None else step.change(state)

    def _call_sites(self) -> None:
        self._sites: dict[str, list[tuple[str, State]]] = {name: [] for name in self.routines}
        for name, routine in self.routines.items():
            for step, state in zip(routine.steps, self._before[name], strict=True):
                if step.call is not None and state is not None:
                    self._sites[step.call].append((name, state))

    def _with_entries(self, name: str, to_resolve: Values) -> Values:
        result: set[Value] = set()
        visited: set[tuple[str, Value]] = set()
        work = [(name, value) for value in to_resolve]
        while work:
            routine, value = work.pop()
            if (routine, value) in visited:
                continue
            visited.add((routine, value))
            if value[0] != "entry":
                result.add(value)
                continue
            variable = str(value[1])
            if self.routines[routine].open or not self._sites[routine]:
                result |= self.start(variable)
            for caller, state in self._sites[routine]:
                work += [(caller, each) for each in values(state, variable)]
        return frozenset(result)


def _substituted(at_end: Values, state: State) -> Values:
    result: set[Value] = set()
    for value in at_end:
        result |= values(state, str(value[1])) if value[0] == "entry" else {value}
    return frozenset(result)


NULL_FRAME: Value = ("null", 0)
SETTING = {
    *("set_tool", "set_base", "define_tool", "define_base", "bas_tool", "bas_base", "initialised"),
    *("data_of_frames", "apply_data", "perhaps_apply_data", "tool_of_data", "base_of_data"),
}


class ModuleFrames:
    """The frames that a module states: `poses` in numbers by place, `defined` for TOOL_DATA and BASE_DATA."""

    def __init__(self, names: KrlNames) -> None:
        self.names = names
        self.poses: dict[int, Matrix | None] = {}
        self.defined: dict[str, list[int]] = {}

    def change(self, tree: Tree[Token]) -> Change:
        kind = str(tree.data)
        word = "tool" if "tool" in kind else "base"
        if kind in ("set_tool", "set_base"):
            return self._to(word, self._frame(word, tree.children[0]))
        if kind in ("define_tool", "define_base"):
            number, aggregate = tree.children
            index, frame = whole(number), self._literal(word, aggregate)
            assert isinstance(aggregate, Tree)
            self.defined.setdefault(f"{word} {index}", []).append(span(aggregate)[0])
            return lambda state: assigned(state, f"{word} {index}", frame(state))
        if kind in ("bas_tool", "bas_base"):
            return self._to(word, self._numbered(word, whole(tree.children[0])))
        if kind in ("tool_of_data", "base_of_data"):
            data = self._data(tree.children[0])
            return self._to(word, lambda state: _of_data(state, word, data))
        if kind == "data_of_frames":
            data = self._data(tree.children[0])
            return lambda state: assigned(state, "data", [data])
        if kind == "initialised":
            after: Value = ("open", "after BAS(#INITMOV)")
            return lambda state: assigned(assigned(state, "tool", [after]), "base", [after])
        return lambda state: self._applied(state, perhaps=kind == "perhaps_apply_data")

    def _to(self, word: str, frame: Callable[[State], Values]) -> Change:
        return lambda state: assigned(state, word, frame(state))

    def _frame(self, word: str, part: Tree[Token] | Token) -> Callable[[State], Values]:
        assert isinstance(part, Tree)
        if part.data == "null":
            return lambda state: frozenset([NULL_FRAME])
        if part.data == "number":
            index = whole(part.children[0])
            return self._numbered(word, None if index == 0 else index)  # their first is 1
        if part.data == "literal":
            return self._literal(word, part.children[0])
        name = str(part.children[0]).lower()
        position = self.names.positions.get(name)
        if position is None:
            return lambda state: frozenset([("unknown", name)])
        return self._literal(word, position.aggregate)

    def _numbered(self, word: str, index: int | None) -> Callable[[State], Values]:
        self.names.has(word, index)
        return _of_number(word, index)

    def _literal(self, word: str, aggregate: Tree[Token] | Token) -> Callable[[State], Values]:
        assert isinstance(aggregate, Tree)
        pos, pose = span(aggregate)[0], pose_of(aggregate)
        if pose is None:
            self.names.problem(
                pos, f"this {word} is not stated in numbers as a whole (X, Y, Z, A, B, C), each once"
            )
        elif pos not in self.poses:
            self.names.claim(aggregate, "frame")
        self.poses[pos] = pose
        return lambda state: frozenset([("literal", pos)])

    def _data(self, part: Tree[Token] | Token) -> Value:
        if isinstance(part, Tree):
            return "numbers", self.names.data_of_frames(part)
        name = str(part).lower()
        return ("numbers", self.names.frames[name]) if name in self.names.frames else ("open", name)

    def _applied(self, state: State, *, perhaps: bool) -> State:
        result = state
        for word in ("tool", "base"):
            frames: set[Value] = set(values(state, word)) if perhaps else set()
            for data in values(state, "data"):
                frames |= _of_data(state, word, data)
            result = assigned(result, word, frames)
        return result


def _of_number(word: str, index: int | None) -> Callable[[State], Values]:
    """The frame of a number: 0 is the flange, or the base of the robot."""
    if index is None or index < 0:
        return lambda state: frozenset([("unknown", "a number that is none")])
    if index == 0:
        return lambda state: frozenset([NULL_FRAME])
    return lambda state: values(state, f"{word} {index}")


def _of_data(state: State, word: str, data: Value) -> Values:
    if data[0] == "numbers":
        numbers = data[1]
        assert isinstance(numbers, tuple)
        return _of_number(word, numbers[word == "base"])(state)
    if data[0] == "open":
        return frozenset([data])
    return frozenset([("unknown", "FDAT_ACT, which is not set before in this routine")])


def perhaps_kept(changes: tuple[Change, ...]) -> Change:
    """Changes for one motion alone: behind it they may hold or not."""

    def change(state: State) -> State:
        with_own = state
        for each in changes:
            with_own = each(with_own)
        return {name: values(state, name) | changed for name, changed in with_own.items()}

    return change


def nothing_known(state: State) -> State:
    nothing: Value = ("unknown", "nothing leads here")
    for variable in ("tool", "base", "data", "arm"):
        state = assigned(state, variable, [nothing])
    return state
