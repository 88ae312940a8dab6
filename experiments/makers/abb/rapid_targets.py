"""The targets of a RAPID module (ABB), and whether each of its statements is understood."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable

from lark import Token, Tree

from ....model.kinematics.orientation import from_quaternion
from ..maker import blanked
from ..program_parts import Language, Motion, Parsed, Source, span, understood
from .rapid_points import REMARK
from .rapid_positions import FRAMES, TARGETS, Node, Positions
from .rapid_statements import (
    Blocks,
    RapidStatement,
    rapid_literals,
    routine_head,
    statements,
    tokens,
    trees,
)

# Types of data that hold no position, tool or frame; those of the second list have components.
_PLAIN = {
    *("num", "dnum", "bool", "string", "byte", "rawbytes", "clock", "intnum", "iodev", "socketdev", "errnum"),
    *("tpnum", "switch", "signaldi", "signaldo", "signalai", "signalao", "signalgi", "signalgo"),
}
_RECORDS = {"speeddata", "zonedata", "stoppointdata", "loaddata"}
_PREDEFINED = {"reg1": "num", "reg2": "num", "reg3": "num", "reg4": "num", "reg5": "num", "clock1": "clock"}
# Of the language, so that --call cannot state them to be harmless.
_OTHER_MOTION = re.compile(
    r"Move(AbsJ|J|L|C)\w+|MoveExtJ|Trigg\w+|Search[LC]|Arc[LC]\w*|Disp[LC]\w*|Paint[LCJ]\w*|Spot[LJM]\w*"
    r"|Cap[LC]|Cont[LC]|EGM\w+|Ind[ACDR]Move|StepBwdPath|RestoPath|StorePath|ClearPath|PathRecMove\w+",
    re.IGNORECASE,
)
_SHIFTS = re.compile(
    r"PDisp(On|Set)|EOffs(On|Set)|Corr(Con|Write)|SoftAct|WorldAccLim|(Act|Dea?ct)Unit|Set(All)?DataVal"
    r"|SetSysData|WriteCfgData|(Start|Un)?Load|CallByVar|(Wait|Drop)WObj|SyncMoveOn|MoveRobotUnit",
    re.IGNORECASE,
)
_SHOWN = 60
_ZEROBEAM = re.compile(r"zb_(command|true|offset_deg)", re.IGNORECASE)
# Statements behind which the arm may be elsewhere than at the target of the motion above.
_BREAKING = {
    *("routine", "end", "error", "if", "elseif", "else", "while", "for", "test", "case", "label", "compact"),
    "jump",
}
_BOOLEAN = {"=", "<>", "<", ">", "<=", ">=", "AND", "OR", "XOR"}


def rapid_targets(source: Source) -> Parsed:
    """The targets and motions of a module; a problem of each statement that is not understood."""
    return _RapidModule(source).read()


class _RapidModule:
    def __init__(self, source: Source) -> None:
        self.source, self.bare, self.parsed = source, blanked(source.text, REMARK, strings=False), Parsed()
        self.positions = Positions(source, self.bare, self.parsed)
        self.records = set(_RECORDS)  # types with components that hold no position
        self.plain = set(_PLAIN)
        self.types = dict(_PREDEFINED)  # of the data of the module, then of the routine that is read
        self.local_types: dict[str, str] = {}
        self.harmless: list[Token] = []  # names of data that hold no position
        self.mentions: list[Token] = []  # names in expressions, in arguments, on the left of an assignment
        self.undeclared: list[tuple[Token, str]] = []  # problems of names, if no other problem is in the line
        self.routines: dict[str, str] = {}  # PROC, FUNC or TRAP, by name
        self.heads: dict[str, Token] = {}  # names of routines where they begin
        self.calls: dict[str, set[str]] = defaultdict(set)  # of routines by routines
        self.moving: set[str] = set()  # routines with motions
        self.routine = ""
        self.straight = False
        self.first_motion = 0  # of the routine
        self.handling = False  # in an error handler, from which RETRY and TRYNEXT lead anywhere

    def read(self) -> Parsed:
        rows, blocks = list(statements(self.bare)), Blocks()
        for row in rows:
            if row.tree is not None and row.tree.data == "routine":
                word, _, name = routine_head(row.tree)
                self.routines[name.lower()], self.heads[name.lower()] = word, name
        misplaced: list[tuple[int, str]] = []
        for row in rows:
            if row.tree is None:
                self._refuse(row)
                continue
            if not blocks.allow(row.tree):
                misplaced.append((self.source.line(row.start), f"{_short(row, self.bare)} cannot be here"))
            self._read(row.tree)
        if blocks.open:
            misplaced.append((self.source.line(len(self.bare)), f"{blocks.open[-1]} is missing"))
        self._together()
        if not self.parsed.problems:
            self.parsed.problems += misplaced[:1]
        return self.parsed

    def _problem(self, node: Node, sentence: str) -> None:
        self.positions.problem(span(node)[0], sentence)

    def _refuse(self, row: RapidStatement) -> None:
        self.positions.problem(row.start, f"{_short(row, self.bare)} is not understood")
        self.positions.claim(row.start, row.end, "left")
        self.straight = False

    def _read(self, tree: Tree[Token]) -> None:
        kind = str(tree.data)
        readers: dict[str, Callable[[Tree[Token]], None]] = {
            "motion": self._motion,
            "assignment": self._assignment,
            "call": self._called,
            "data": self._data,
            "record": self._type,
            "alias": self._type,
            "routine": self._routine,
            "compact": self._compact,
            "for": self._for,
            "connect": self._connect,
            "end": self._end,
            "error": self._error,
        }
        readers.get(kind, self._expressions)(tree)
        if kind in _BREAKING or (kind == "instruction" and tokens(tree)[0].lower() == "exitcycle"):
            self.straight = False

    # Types, data and routines

    def _type(self, tree: Tree[Token]) -> None:
        """A record or an alias: it holds a position where one of its types does."""
        names = [token for token in tokens(tree) if token.type == "NAME"]
        name, types = (names[0], names[1::2]) if tree.data == "record" else (names[1], names[:1])
        known = self.records | self.plain | {*TARGETS, *FRAMES}
        if name.lower() in known:
            self._problem(name, f"{name} is a type already")
        elif all(each.lower() in self.records | self.plain for each in types):
            plain = tree.data == "alias" and types[0].lower() in self.plain
            (self.plain if plain else self.records).add(name.lower())

    def _enter(self, name: Token, kind: str) -> None:
        """Data that hold no position."""
        self.harmless.append(name)
        (self.local_types if self.routine else self.types)[name.lower()] = kind

    def _data(self, tree: Tree[Token]) -> None:
        kind, name = [token for token in tokens(tree) if token.type == "NAME"][:2]
        rest = tree.children[tree.children.index(name) + 1 :]
        sizes = next(iter(trees(tree, "sizes")), None)
        value = next((each for each in rest if each is not sizes), None)
        self._expressions(tree)
        if kind.lower() not in self.plain | self.records:
            self.positions.declare(kind.lower(), name, None if sizes is None else sizes.children, value)
            return
        self._enter(name, kind.lower())
        start, end = span(tree)
        if self.positions.has_literals(start, end) and self.positions.left(name):
            self.positions.claim(start, end, "left")

    def _routine(self, tree: Tree[Token]) -> None:
        _, returned, name = routine_head(tree)
        self.routine, self.local_types = name.lower(), {}
        self.first_motion, self.handling = len(self.parsed.motions), False
        if _is_built_in(name):
            self._problem(name, f"{name} is an instruction or a function of the language already")
        if returned is not None and returned.lower() not in self.plain | self.records:
            self._problem(name, f"{name} returns a {returned}, which is computed when the program runs")
        for parameter in tree.find_data("parameter"):
            kind, parameter_name = tokens(parameter)[-2:]
            if kind.lower() in self.plain | self.records:
                self._enter(parameter_name, kind.lower())
            else:
                self._problem(
                    parameter_name,
                    f"the {kind} {parameter_name} that is passed is only known when the program runs",
                )

    def _end(self, tree: Tree[Token]) -> None:
        if str(tree.children[0]).upper() in ("ENDPROC", "ENDFUNC", "ENDTRAP"):
            self.routine, self.local_types, self.handling = "", {}, False

    def _error(self, tree: Tree[Token]) -> None:
        self.handling = True

    # Expressions and calls

    def _expressions(self, tree: Node) -> None:
        """Names and calls in a statement, or in a part of one."""
        if not isinstance(tree, Tree):
            return
        for part in tree.iter_subtrees():
            if part.data == "reference":
                self._reference(part)
            elif part.data == "function" and tokens(part)[0].type == "NAME":
                self._called(part)

    def _reference(self, tree: Tree[Token]) -> None:
        name = tokens(tree)[0]
        self.mentions.append(name)
        if trees(tree, "component") and self._type_of(name) not in self.records:
            self.undeclared.append(
                (
                    name,
                    f"{name} is not declared in this file with a type that holds no position, tool or frame",
                )
            )

    def _type_of(self, name: Token) -> str | None:
        return self.local_types.get(name.lower(), self.types.get(name.lower()))

    def _called(self, tree: Tree[Token]) -> None:
        """A routine with its arguments, none of which may hold a position."""
        name = tokens(tree)[0]
        low = name.lower()
        if tree.data == "call":
            for argument in tree.children[1:]:
                self._expressions(argument)
        in_file = low in self.routines
        if in_file:
            self.calls[self.routine].add(low)
            self._elsewhere()
        if not in_file and _ZEROBEAM.fullmatch(low):
            self._problem(name, f"{name}: the module of zerobeam export rapid would correct a second time")
        elif not in_file and _OTHER_MOTION.fullmatch(low):
            self._problem(name, f"{name} is a motion that is not understood")
        elif not in_file and _SHIFTS.fullmatch(low):
            self._problem(name, f"{name}: targets, tools and frames are then no longer what this file says")
        elif not in_file and not self.source.facts.harmless(low, name):
            self._problem(
                name,
                f"{name} is not a routine of this file, nor an instruction that is known here; state --call"
                f" {name} if it moves no arm and changes no frame, tool or target",
            )
        elif next(tree.find_data("aggregate"), None) is not None:
            self._problem(name, f"{name} is called with a value in brackets, which may be a position")

    def _elsewhere(self) -> None:
        """The arm may have moved to an unknown place."""
        self.straight = False
        if self.handling:
            self._retried()

    def _retried(self) -> None:
        """An error handler that moves the arm leads to any motion of its routine."""
        motions = self.parsed.motions
        motions[self.first_motion :] = [each._replace(first=True) for each in motions[self.first_motion :]]

    # Statements

    def _for(self, tree: Tree[Token]) -> None:
        self._enter(tokens(tree)[0], "num")
        self._expressions(tree)

    def _compact(self, tree: Tree[Token]) -> None:
        self._expressions(tree.children[0])
        self._read(trees(tree)[-1])

    def _connect(self, tree: Tree[Token]) -> None:
        self._expressions(tree)
        routine = tokens(tree)[0]
        if routine.lower() not in self.routines and not self.source.facts.harmless(routine.lower(), routine):
            self._problem(routine, f"{routine} is not a routine of this file (--call {routine}?)")

    def _assignment(self, tree: Tree[Token]) -> None:
        """To data that hold no position: declared here, or by the type of the value."""
        self._expressions(tree)
        name, value = tokens(trees(tree)[0])[0], tree.children[1]
        if self._type_of(name) is None and not _is_plain(value):
            self.undeclared.append(
                (name, f"{name} is not declared in this file: it may be a position, a tool or a frame")
            )

    def _motion(self, tree: Tree[Token]) -> None:
        for part in trees(tree, "speed", "zone"):
            self._expressions(part)
        word, tool = tokens(tree)[0], trees(tree, "tool")[0]
        options = [part.data for part in trees(tool)]
        if len(options) > len(set(options)):
            self._problem(word, f"{word} has an option twice")
        self.moving.add(self.routine)
        wobj = next((tokens(part)[0] for part in trees(tool, "object")), None)
        for part in trees(tree, "target"):
            self._moved(word, part.children[0], tokens(tool)[0], wobj)
        if self.handling:
            self._retried()

    def _moved(self, word: Token, target: Node, tool: Token, wobj: Token | None) -> None:
        joints, linear = word.type == "ABSJ", word.lower() in ("movel", "movec")
        twice = isinstance(target, Tree) and any(
            _ZEROBEAM.fullmatch(tokens(each)[0]) for each in target.find_data("function")
        )
        if twice:
            self._problem(target, "the module of zerobeam export rapid would correct a second time")
        names = self.positions.named(target, "jointtarget" if joints else "robtarget")
        line = self.source.line(span(target)[0])
        if names is None:
            self.parsed.motions.append(Motion(None, line, linear, not self.straight))
            return
        for name in names:
            first = not self.straight or len(names) > 1
            if joints or self.positions.use(name, tool, wobj):
                self.parsed.motions.append(Motion(name, line, linear, first))
        self.straight = len(names) == 1

    # All together

    def _together(self) -> None:
        """Problems that show when all statements are read."""
        positions, text = self.positions, self.source.text
        for name in self.harmless:
            if name.lower() in positions.names:
                self._problem(name, f"{name} is the name of a target, a tool or a frame too")
        for name in self.mentions:
            if name.lower() in positions.names:
                self.parsed.changed(self.source.line(span(name)[0]), str(name))
        for name, sentence in self.undeclared:
            if not self.parsed.speaks_of(self.source.line(span(name)[0])):
                self._problem(name, sentence)
        for low, word in self.routines.items():
            if word == "TRAP" and self._reached(low) & self.moving:
                self._problem(self.heads[low], f"the interrupt routine {low} moves the arm, at any moment")
        alone = re.search(r"\r(?![\r\n])", text)
        if alone is not None:
            positions.problem(alone.start(), "the line has a carriage return in it, which may end it")
        positions.finish()

    def _reached(self, routine: str) -> set[str]:
        """The routine and all that it calls."""
        reached, new = set(), {routine}
        while new:
            reached |= new
            new = {called for each in new for called in self.calls[each]} - reached
        return reached


def _short(row: RapidStatement, bare: str) -> str:
    text = " ".join(bare[row.start : row.end].split())
    return text if len(text) <= _SHOWN else text[: _SHOWN - 1] + "…"


def _is_plain(value: Node) -> bool:
    """Whether a value is a number, a text or true or false, by what it is written with."""
    if isinstance(value, Token):
        return True
    words = tokens(value)
    if value.data == "reference":
        return len(value.children) == 1 and words[0].upper() in ("TRUE", "FALSE")
    if value.data == "function":
        return words[0].type == "FUNCTION"
    if value.data == "term":
        return any(token.type == "NOT" for token in words) or _is_plain(value.children[-1])
    if value.data != "value":
        return False
    operators = {token.upper() for token in words if token.type in ("SIGN", "OPERATOR")}
    constants = any(token.type in ("UNSIGNED", "STRING") for token in words)
    return bool(operators & _BOOLEAN) or (constants and operators <= {"+", "-"})


def _is_built_in(name: str) -> bool:
    """Whether the grammar has an instruction or a function of this name."""
    for text in (f"{name};", f"RETURN {name}(0);"):
        tree = understood("abb/rapid", "statement", text, 0, len(text))
        if tree is not None and any(
            token.type in ("INSTRUCTION", "FUNCTION") for token in tree.scan_values(lambda _: True)
        ):
            return True
    return False


RAPID = Language(
    "RAPID",
    rapid_targets,
    r"^[ \t]*(?:LOCAL\s+)?MODULE\b[^\n]*\n",
    "  ! ",
    from_quaternion,
    "X,Y,Z,Q1,Q2,Q3,Q4",
    rapid_literals,
)
