"""The statements of a TP program (FANUC): its motions, and in which frames they are."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from lark import Token, Tree

from .grammar import understood
from .parts import Motion, Parsed, Source

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
_STATED = {"UFRAME_NUM": "UF", "UTOOL_NUM": "UT"}
_JOINS = ("label", "block", "jump", "leaving")  # what follows them is reached from elsewhere too


class Frames(NamedTuple):
    """The numbers of the frames that a pose states."""

    user: str
    tool: str


def read_statements(
    source: Source,
    bare: str,
    pieces: Sequence[re.Match[str]],
    frames: Mapping[str, Frames],
    parsed: Parsed,
) -> None:
    """Enter the motions, and the problems, of the statements (each with its `body`) of /MN. `bare` is the
    text without the marks of continued lines; `frames` are those of the poses, by name."""
    statements = []
    for piece in pieces:
        if _REMARK.fullmatch(piece["body"]) is None:
            tree = understood("fanuc", "statement", bare, *piece.span("body"))
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
        self, source: Source, frames: Mapping[str, Frames], parsed: Parsed, trees: Sequence[Tree[Token]]
    ) -> None:
        self.stated, self.frames, self.parsed = source.stated, frames, parsed
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
            reason = next((said for words, said in _REASONS if re.match(words, written)), None)
            self._problem(line, f"{written} is not understood" if reason is None else f"{written}: {reason}")
        elif not self.stated.harmless(written):
            self._problem(
                line,
                f'{written}: this macro or instruction is not understood; --call "{written}" {_HARMLESS}',
            )

    def _problem(self, line: int, sentence: str) -> None:
        self.parsed.problems.append((line, sentence))

    def go(self, line: int, written: str, tree: Tree[Token]) -> None:
        for call in tree.find_data("call"):
            name = str(call.children[0])
            if not self.stated.harmless(name):
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
        for place in (child for child in motion.children if isinstance(child, Tree)):
            if place.data not in ("position", "register"):
                continue
            number = str(int(str(place.children[0])))
            name = f"P[{number}]" if place.data == "position" else f"PR[{number}]"
            if self.stated.leaves(number if place.data == "position" else name, name):
                self.parsed.motions.append(Motion(None, line, False, True))
            elif place.data == "register":
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
                    f"{written}: {name} has {_STATED[which]} : {number}, but {which} is, or may be, {others}"
                    f" here; set {which}={number} before this motion",
                )
