"""What the statements of a KRL module change of the tool and of the base that are active."""

from __future__ import annotations

from collections.abc import Callable

from lark import Token, Tree

from .....model.arrays import Matrix
from .flow import Change, State, Value, Values, assigned, values
from .statements import Names, pose_of, span, whole

NULL_FRAME: Value = ("null", 0)
SETTING = {
    *("set_tool", "set_base", "define_tool", "define_base", "bas_tool", "bas_base", "initialised"),
    *("data_of_frames", "apply_data", "perhaps_apply_data", "tool_of_data", "base_of_data"),
}


class Frames:
    """The frames that a module states: `poses` in numbers by place, `defined` for TOOL_DATA and BASE_DATA."""

    def __init__(self, names: Names) -> None:
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
            return self._to(word, lambda state: _of_data(state, self.names, word, data))
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
        place, pose = span(aggregate)[0], pose_of(aggregate)
        if pose is None:
            self.names.problem(
                place, f"this {word} is not stated in numbers as a whole (X, Y, Z, A, B, C), each once"
            )
        elif place not in self.poses:
            self.names.claim(aggregate, "frame")
        self.poses[place] = pose
        return lambda state: frozenset([("literal", place)])

    def _data(self, part: Tree[Token] | Token) -> Value:
        if isinstance(part, Tree):
            return "numbers", self.names.data_of_frames(part)
        name = str(part).lower()
        return ("numbers", self.names.frames[name]) if name in self.names.frames else ("open", name)

    def _applied(self, state: State, *, perhaps: bool) -> State:
        result = state
        for word in ("tool", "base"):
            found: set[Value] = set(values(state, word)) if perhaps else set()
            for data in values(state, "data"):
                found |= _of_data(state, self.names, word, data)
            result = assigned(result, word, found)
        return result


def _of_number(word: str, index: int | None) -> Callable[[State], Values]:
    """The frame of a number: 0 is the flange, or the base of the robot."""
    if index is None or index < 0:
        return lambda state: frozenset([("unknown", "a number that is none")])
    if index == 0:
        return lambda state: frozenset([NULL_FRAME])
    return lambda state: values(state, f"{word} {index}")


def _of_data(state: State, names: Names, word: str, data: Value) -> Values:
    if data[0] == "numbers":
        numbers = data[1]
        assert isinstance(numbers, tuple)
        return _of_number(word, numbers[word == "base"])(state)
    if data[0] == "open":
        return frozenset([data])
    return frozenset([("unknown", "FDAT_ACT, which is not set before in this routine")])


def perhaps_kept(own: tuple[Change, ...]) -> Change:
    """What holds for a motion alone is taken to hold behind it, or not."""

    def change(state: State) -> State:
        with_own = state
        for each in own:
            with_own = each(with_own)
        return {name: values(state, name) | found for name, found in with_own.items()}

    return change


def nothing_known(state: State) -> State:
    nothing: Value = ("unknown", "nothing leads here")
    for variable in ("tool", "base", "data", "arm"):
        state = assigned(state, variable, [nothing])
    return state
