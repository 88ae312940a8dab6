"""Positions of TP listings and position registers (FANUC), with frames of SYSFRAME.VA."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import BackupReading, What, pose_of
from .position_names import PositionNames
from .script import LineProgram
from .statement_text import NUMBER, pieces, split_arguments

_M = re.MULTILINE
_POINT = re.compile(r"^[ \t]*P\[[ \t]*(?P<number>\d+)[^\]\n]*\][ \t]*\{(?P<block>[^{}]*)\}[ \t]*;", _M)
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_TURNS = r"-?\d+[ \t]*,[ \t]*-?\d+[ \t]*,[ \t]*-?\d+"
_CONFIGURED = re.compile(rf"(?:CONFIG[ \t]*:[ \t]*'|Config:[ \t]*)([A-Z ]*[A-Z])[ \t]*,[ \t]*({_TURNS})")
_VALUE = re.compile(rf"\b([XYZWPR]|[JE]\d|EXT\d)[ \t]*[=:][ \t]*(\*+|{NUMBER})(?:[ \t]*(deg|mm))?")
_FRAMES = re.compile(r"UF[ \t]*:[ \t]*(\d+|F)[ \t]*,[ \t]*UT[ \t]*:[ \t]*(\d+|F)")
_HEAD = re.compile(r"^\[\*\w+\*\](\$\w+)[^\n]*|^[ \t]*\[(\d+),(\d+)\][ \t]*=(?:[ \t]*'[^'\n]*')?", _M)
_STATEMENT = re.compile(r"^[ \t]*\d*[ \t]*:(?P<body>(?:[^;\n]|\n[ \t]*:)*);", _M)
_GOAL = re.compile(r"\bP(R?)\[\s*(?:GP\d+\s*:\s*)?(\d+)?[^\]]*\]")
_OFFSET = re.compile(r"\b(?:Tool_)?Offset(?:\s*,\s*PR\[\s*(?:GP\d+:)?(\d+)?[^\]]*\])?", re.IGNORECASE)
_RUN_TIME = r"\b(?:UFRAME|UTOOL)\[.*?\]\s*=|\$MNU(?:FRAME|TOOL)\b.*?=|\bRTCP\b|\bCOORD\b"
_JUMP = re.compile(r"\s*(?:LBL|JMP|IF|SELECT|FOR|ENDFOR|ELSE|ENDIF|SKIP)\b|.*\bJMP\b")
_ASSIGNED = re.compile(r"\s*P(R?)\[\s*(?:GP1\s*:\s*)?(\d+)?[^\]]*\]+\s*=")


def read_fanuc(reading: BackupReading) -> None:
    """Frames, registers and listings of a backup."""
    for file in reading.files:
        here = FanucFile(file, reading, PositionNames(_GOAL))
        if re.search(r"^\[\*\w+\*\]\$", file.text, _M):
            here.variables()
        elif re.search(r"^/(?:PROG|POS)\b", file.text, _M):
            here.listing()


class FanucFile(LineProgram):
    """A listing, or a file of variables."""

    jump = _JUMP

    def variables(self) -> None:
        """$MNUFRAME, $MNUTOOL and $POSREG of group 1, $SCR_GRP[1].$ROBOT_ID."""
        text = self.file.text
        if (model := re.search(r"\$SCR_GRP\[1\]\.\$ROBOT_ID[^=\n]*=\s*'([^'\n]*)'", text)) is not None:
            self.reading.model = (self.file, self.file.line(model.start()), model[1].strip())
        variable = ""
        for head, stop in pieces(_HEAD, text):
            taught = head[2] == "1" and "Uninitialized" not in text[head.start() : stop]
            variable = head[1] or variable
            if taught and variable == "$POSREG":
                self._position(f"PR[{head[3]}]", f"PR[{head[3]}]", head.start(2), head.end(), stop)
            elif taught and variable in ("$MNUFRAME", "$MNUTOOL"):
                fields = {each[1]: each[2] for each in _VALUE.finditer(text, head.end(), stop)}
                numbers = [float(fields[key]) for key in "XYZWPR" if fields.get(key, "*")[0] != "*"]
                what: What = "tool" if variable == "$MNUTOOL" else "frame"
                self.frame(head.start(), what, head[3], pose_of(from_rpy, numbers))

    def listing(self) -> None:
        """Positions and statements of a program."""
        text = self.file.text
        parts = {match[1]: match for match in re.finditer(r"^/(MN|POS|END)\b", text, _M)}
        if list(parts) != ["MN", "POS", "END"]:
            return self.unread(0, "this is no whole listing: /MN, /POS and /END are its parts")
        at, end = parts["POS"].end(), parts["END"].start()
        for point in [*_POINT.finditer(text, at, end), None]:
            gap = text[at : end if point is None else point.start()]
            if gap.strip():
                self.unread(at + len(gap) - len(gap.lstrip()), "this position is not understood")
            if point is not None:
                self._point(point)
                at = point.end()
        statements = _STATEMENT.finditer(text, parts["MN"].end(), parts["POS"].start())
        self.prepare([(each.start("body"), each["body"]) for each in statements])
        return self.run()

    def _point(self, point: re.Match[str]) -> None:
        """A position of all groups: of others than the first, one axis each, which stays."""
        label = f"P[{int(point['number'])}]"
        groups, pos = pieces(_GROUP, self.file.text, *point.span("block")), point.start("number")
        if not groups or groups[0][0][1] != "1":
            return self.unread(pos, f"{label} has no group 1", label)
        self._position(f"{self.file.name}:{label}", label, pos, groups[0][0].end(), groups[0][1])
        for group, stop in groups[1:]:
            sentence = f"{label} has group {group[1]}, which must not carry the arm or the work: it stays"
            if len(_VALUE.findall(self.file.text[group.end() : stop])) == 1:
                self.doubt(group.start(), "group", sentence)
            else:
                self.refuse(group.start(), f"{label} has group {group[1]} of several axes")
        return None

    def _position(self, name: str, label: str, pos: int, start: int, stop: int) -> None:
        text, register = self.file.text, label[:2] == "PR"
        fields = list(_VALUE.finditer(text, start, stop))
        spans = {match[1]: match.span(2) for match in fields if match[1][0] != "E"}
        taught = bool(fields) and not any("*" in match[2] for match in fields)
        # A register that holds no joints is of no interest to who looks for joints.
        unread = None if register and not any(match[1][0] == "J" for match in fields) else label
        if not taught or len({match[1] for match in fields}) < len(fields):
            return self.unread(pos, f"{label} is not taught, or states a value twice", unread)
        external = [float(match[2]) for match in fields if match[1][0] == "E"]
        units, places = {match[3] for match in fields if match[1] in spans}, [*spans.values()]
        if list(spans) == [f"J{i}" for i in range(1, len(spans) + 1)] and units == {"deg"}:
            axes = range(len(spans))
            return self.add(pos, name, label, places, axes=axes, external=external, register=register)
        configured, frames = _CONFIGURED.search(text, start, stop), _FRAMES.search(text, start, stop)
        if list(spans) != list("XYZWPR") or configured is None:
            return self.unread(pos, f"{label} is not understood", unread)
        numbers = frames.groups() if frames else ("F", "F")
        frame, tool = (None if number == "F" else str(int(number)) for number in numbers)
        words = configured.span(1), configured.span(2)
        return self.add(
            pos, name, label, places, words, external=external, register=register, frame=frame, tool=tool
        )

    def look(self, pos: int, text: str) -> None:
        if (put := re.match(r"\s*(UFRAME_NUM|UTOOL_NUM)\s*=\s*(\d+)?", text)) is not None:
            self.active.set("frame" if put[1] == "UFRAME_NUM" else "tool", pos, put[2])

    def statement(self, pos: int, text: str) -> None:
        if re.match(r"\s*(?:!|//|--)", text):
            return None
        if (run_time := re.search(_RUN_TIME, text)) is not None:
            self.refuse(pos, f"{run_time[0]}: tools, frames or work are moved when the program runs")
        if re.match(r"\s*[JLCAS]\s+P(?:R?)\[", text):
            return self._motion(pos, text)
        *_, (_, done) = split_arguments(text) if re.match(r"\s*IF\b", text) else [(0, text)]
        if (assigned := _ASSIGNED.match(done)) is not None:
            name = f"P{assigned[1]}[" + (f"{assigned[2]}]" if assigned[2] else "")
            label = assigned[0][:-1].strip()
            self.overwrites(pos, name if assigned[1] else f"{self.file.name}:{name}", label)
        return None

    def _motion(self, pos: int, body: str) -> None:
        goals: list[str] = []
        for goal in _GOAL.finditer(_OFFSET.sub("", body)):
            label = f"P{goal[1]}[{int(goal[2])}]" if goal[2] else goal[0]
            if not goal[2]:
                self.computed(pos, label)
            elif re.search(r"\bINC\b", body):
                self.refuse(pos, f"INC: {label} is a step, not a place")
            else:
                goals.append(label if goal[1] else f"{self.file.name}:{label}")
        for offset in _OFFSET.finditer(body):
            self.reading.added |= {f"PR[{offset[1]}]"}
            axes: What = "tool" if offset[0].lower().startswith("tool") else "frame"
            self.relative(pos, " ".join(offset[0].split()), goals[-1:], None, axes)
        if re.search(r"\bVOFFSET\b|\bVR\[", body):
            self.computed(pos, "an offset by a camera")
        self.goes(pos, goals)
