"""Positions of PacScript and PAC programs (Denso): P(…), J(…), and variables that they set."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import WHAT, BackupReading, pose_of, what_of
from .position_names import SharedNames
from .script import Script
from .statement_text import NUMBER, Lines, numbers_in, parts_of, values_in

_I = re.IGNORECASE
_LIST = rf"{NUMBER}(?:\s*,\s*{NUMBER})*"
_PART = re.compile(r"^[ \t]*(?:Sub|Function|Program)\b", _I | re.MULTILINE)
_KINDS = re.compile(r"(?:Dim[ \t]+(.+?)[ \t]+As[ \t]+|Def)(Pos|Joint|Jnt)\w*\b(.*)", _I)
_DEFINED = rf"(Tool|Work)[ \t]+(\d+)[ \t]*,[ \t]*P?[ \t]*\(\s*({_LIST})\s*\)[ \t]*"
_CHANGED = re.compile(r"Change(Tool|Work)[ \t]+(\d+)?", _I)
_BY = r"(?P<goal>.*?)\s*,\s*(?P<by>P?\s*\([^()]*\)|[^,()]*)\s*"
_GOALS = {"move": slice(1, None), "approach": slice(1, 2), "archmove": slice(1), "drivea": slice(1)}
_OPTION = re.compile(r"(?:S|Speed|Accel|Decel|Time)\s*=.*|Next|If\b.*", _I)


def read_pacscript(reading: BackupReading) -> None:
    """P[n] and J[n] belong to all programs, other names to those of one file."""
    programs, shared = [], PacNames(PacProgram.word)
    for file in reading.files:
        names = PacNames(shared.word, shared.keys, file.name, shared.arrays)
        starts = [match.start() for match in _PART.finditer(file.bare)][1:]
        for start, end in zip([0, *starts], [*starts, len(file.bare)], strict=True):
            programs.append(PacProgram(file, reading, names))
            programs[-1].scan(start, end)
    for program in programs:
        program.run()


class PacNames(SharedNames):
    """P10 and P[10] are one, in all programs."""

    def plain(self, name: str) -> str:
        name = re.sub(r"([pj])0*(\d+)", r"\1[\2]", re.sub(r"\s", "", name).lower())
        return name if re.match(r"[pj]\[", name) else f"{self.scope}:{name}"


class PacProgram(Script):
    """A Sub or PROGRAM, with the names of its file."""

    literal = re.compile(rf"(?P<kind>[PJT])?\s*\(\s*(?P<numbers>{_LIST})\s*\)", _I)
    begin = re.compile(r"[PJT]\s*\(", _I)
    assign = re.compile(
        r"(?:Let\w*[ \t]+)?(?P<name>[PJ]\s*\[[^\]]*\]|[A-Z_]\w*)(?P<index>(?:\([^()]*\))?)\s*="
        r"\s*(?P<value>.*)",
        _I | re.DOTALL,
    )
    move = re.compile(r"(?:^|[ \t:])(?P<kind>Move|Approach|Depart|Draw|DriveA|ArchMove|Rotate)H?\b[ \t]*", _I)
    jump = re.compile(r"(?:If|Else\w*|For|Do|Loop|While|Select|Case|GoTo|\*\w+)\b", _I)
    refused = re.compile(rf"^(?!{_DEFINED}$)(?:Tool|Work)[ \t]+\w.*|^(?:SetBase|Base)[ \t]+\S.*", _I)
    word = re.compile(r"(?<![\w.\"'$])(?:[PJ]\s*\[[^\]]*\]|[A-Z_]\w*)(?!\w)", _I)
    shifts = (
        (re.compile(rf"Dev\s*\(\s*{_BY}\)", _I | re.DOTALL), "frame"),
        (re.compile(rf"DevH\s*\(\s*{_BY}\)", _I | re.DOTALL), "tool"),
        (re.compile(rf"(?P<goal>.+?)\s*(?P<sign>[-+])\s*(?P<by>P?\s*\(\s*{_LIST}\s*\))", _I), "frame"),
    )
    changed = False

    def is_joints(self, literal: re.Match[str]) -> bool | None:
        return literal["kind"].upper() == "J" if literal["kind"] else None

    def setting(self, pos: int, text: str) -> None:
        if (kinds := _KINDS.match(text)) is not None:
            for name in re.findall(r"[A-Z_]\w*", kinds[1] or kinds[3], _I):
                self.kinds[self.names.plain(name)] = {kinds[2].upper() != "POS"}
        if (assign := self.assign.fullmatch(text)) is not None:
            name = self.names.plain(assign["name"])
            self.kinds |= {name: {name[0] == "j"}} if re.match(r"[pj]\[", name) else {}
        if (made := re.fullmatch(_DEFINED, text, _I)) is not None:
            self.frame(pos, what_of(made[1]), made[2], pose_of(from_rpy, values_in(made[3])[:6]))
        if (change := _CHANGED.match(text)) is not None:
            self.active.set(what_of(change[1]), pos, change[2] and str(int(change[2])))
            self.changed = True
        if re.match(r"TakeArm\b", text, _I) and self.changed:  # what it changes is not published
            for what in WHAT:
                self.active.set(what, pos, None)

    def other(self, pos: int, text: str) -> None:
        if not _KINDS.match(text):
            super().other(pos, text)

    def add_literal(
        self, pos: int, literal: re.Match[str], key: str, label: str, *, joints: bool, register: bool = False
    ) -> None:
        spans = numbers_in(literal["numbers"], pos + literal.start("numbers"))
        if (literal["kind"] or "").upper() == "T" or (not joints and len(spans) > 7):
            return self.refuse(pos, f"{label}: this position is not understood")
        spans, figure = (spans, []) if joints else (spans[:6], spans[6:])
        return self.six(pos, key, label, spans, figure, joints=joints, register=register)

    def arguments(self, text: str, move: re.Match[str]) -> Lines:
        """Without path options (@P) and those of motion."""
        every = parts_of(text, move.end())
        parts = [(at, part, re.match(r"(?:@[ \t]*\w+[ \t]*)?", part)) for at, part in every]
        rest = [(at + skip.end(), part[skip.end() :].strip()) for at, part, skip in parts if skip]
        return [(at, part) for at, part in rest if part and not _OPTION.fullmatch(part)]

    def goals_of(self, move: re.Match[str], arguments: Lines) -> Lines:
        spline = [text.lower() for _, text in arguments[:1]] == ["s"]
        return [] if spline else arguments[_GOALS.get(move["kind"].lower(), slice(0))]

    def motion(self, pos: int, move: re.Match[str], arguments: Lines) -> None:
        kind, text = move["kind"].lower(), " ".join(part for _, part in arguments)
        names = [name for at, goal in self.goals_of(move, arguments) for name in self.goal(at, goal)]
        if kind in ("approach", "depart", "draw"):
            by = arguments[-1][1] if arguments else ""
            by = by.lstrip("Vv") if kind == "draw" else f"(0, 0, -{by})"
            self.step(pos, f"{move['kind']} {text}", by, names, "frame" if kind == "draw" else "tool")
        elif kind == "rotate" or not (names or kind == "move"):
            self.relative(pos, f"{move['kind']} is a step from where the arm is")
        elif not names:
            self.computed(pos, f"Move {text}")
        return self.goes(pos, names)
