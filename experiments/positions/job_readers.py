"""Positions of jobs whose lines name their points: TP listings and registers (FANUC), INFORM (Yaskawa)."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import (
    AT_RUN_TIME,
    NUMBER,
    BackupReading,
    FileReading,
    Span,
    What,
    lines_in,
    numbers_in,
    pieces,
    pose_of,
    split_arguments,
    values_in,
)
from .script import LineProgram, PositionNames

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
_FANUC_RUN_TIME = r"\b(?:UFRAME|UTOOL)\[.*?\]\s*=|\$MNU(?:FRAME|TOOL)\b.*?=|\bRTCP\b|\bCOORD\b"
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
        if (run_time := re.search(_FANUC_RUN_TIME, text)) is not None:
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


_I = re.IGNORECASE
_PART = re.compile(r"^//(POS|INST)\b|^END[ \t\r]*$", _I | _M)
_COUNTS = re.compile(r"^///NPOS[ \t]+(\d+),\d+,\d+,(\d+)", _I | _M)
_VALUES = rf"{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})*"
_ENTRY = re.compile(
    rf"[ \t]*(?P<name>C|P|BC|BP|EC|EX)(?P<number>\d+)[ \t]*=[ \t]*(?P<values>{_VALUES})[ \t]*", _I
)
_SECTION = re.compile(r"///(\w+)[ \t]*([^\s]*(?:[ \t]*,[^\s]*)*)[ \t]*", _I)
_WORD = re.compile(r"(?<![\w#.])(L?P|L?C)[XY]?(\d{3,5}|\[[^\]]*\])(?!\w)", _I)
_MOVE = re.compile(r"\s*(?:\+[ \t]*)?S?(I?)MOV([JLCS])?\b", _I)
_STORES = re.compile(
    r"\s*(?:SETE?|GETS|GETPOS|CNVRT|MULMAT|INVMAT|ADD|SUB|MUL|DIV|CLEAR|INC|DEC|LOADV)\b", _I
)
_INFORM_RUN_TIME = re.compile(r"\s*(?:MFRAME|SETTOOL|CHANGE[ \t]+TOOL)\b", _I)
_FRAME = re.compile(r"^//UFRAME[ \t]+(\d+)\b(.*?)(?=^//UFRAME\b|\Z)", _I | _M | re.DOTALL)
_TOOL = re.compile(r"^//TOOL[ \t]+(\d+)[ \t]*\r?$(.*?)(?=^//TOOL\b|\Z)", _I | _M | re.DOTALL)
_POSE = re.compile(rf"{NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}}")
_BUSER = re.compile(rf"^/{{3,4}}BUSER[ \t]+({NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}})[ \t]*\r?$", _I | _M)


def read_inform(reading: BackupReading) -> None:
    """Tools, user frames and jobs of a backup.

    TOOL.CND as controllers write it (public backups of three cells on GitHub: SinaiAranda/motoman_sda20d_sys,
    lukelalondePZ/Komatsu-Press-Demo, lukelalondePZ/Fiberdome-GP88-Spindle-Cell): of each `//TOOL n` the lines
    of `///` (CRC, NAME), then X, Y, Z, Rx, Ry, Rz, and below that mass data.
    """
    for file in reading.files:
        if file.suffix != ".cnd":
            InformJob(file, reading).run()
            continue
        conditions = FileReading(file, reading)
        for frame in _FRAME.finditer(file.text):
            numbers = _BUSER.search(frame[2])
            pose = None if numbers is None else pose_of(from_rpy, values_in(numbers[1]))
            conditions.frame(frame.start(), "frame", str(int(frame[1])), pose)
        for tool in _TOOL.finditer(file.text):
            rows = (row.strip() for row in tool[2].splitlines())
            first = next((row for row in rows if row and not row.startswith("/")), "")
            pose = pose_of(from_rpy, values_in(first)) if _POSE.fullmatch(first) else None
            conditions.frame(tool.start(), "tool", str(int(tool[1])), pose)


class InformJob(FileReading):
    """A job: its positions, then its instructions."""

    def run(self) -> None:
        """Both parts, if it is whole."""
        bare = self.file.bare
        parts = {(match[1] or "END").upper(): match for match in _PART.finditer(bare)}
        counts = _COUNTS.search(bare)
        if list(parts) != ["POS", "INST", "END"] or counts is None:
            return self.unread(0, "this is no whole job: //POS, ///NPOS, //INST and END are its parts")
        counted = self._positions(parts["POS"].end(), parts["INST"].start())
        if counted != (int(counts[1]), int(counts[2])):
            sentence = f"///NPOS states {counts[1]} C and {counts[2]} P; there are {counted}"
            self.unread(counts.start(), sentence)
        start = bare.find("\n", parts["INST"].end())
        for pos, line in lines_in(bare, start, parts["END"].start(), r"[^\n]+"):
            self._statement(pos, line)
        return None

    def _positions(self, start: int, end: int) -> tuple[int, int]:
        """Their numbers, of C and of P."""
        state: dict[str, str] = {}
        configuration: list[Span] = []
        counts = {"C": 0, "P": 0}
        for pos, line in lines_in(self.file.bare, start, end):
            section, entry = _SECTION.fullmatch(line), _ENTRY.fullmatch(line)
            if section is not None:
                word = section[1].upper()
                state[word] = section[2].upper()
                if word in ("PULSE", "RECTAN", "ANGLE"):
                    state["FORM"] = word
                elif word == "RCONF":
                    configuration = numbers_in(section[2], pos + section.start(2))[:6]
            elif entry is None and line.strip():
                self.unread(pos, "this position is not understood")
            elif entry is None:
                continue
            elif entry["name"].upper() in counts:
                counts[entry["name"].upper()] += 1
                self._position(pos, entry, state, configuration)
            elif any(float(each) for each in entry["values"].split(",")):
                label = f"{entry['name']}{entry['number']}"
                station = f"{label} is of a station, which must not carry the arm: it stays"
                if entry["name"][0] in "bB":
                    self.refuse(pos, f"{label}: a base axis carries the arm")
                else:
                    self.doubt(pos, "group", station)
        return counts["C"], counts["P"]

    def _position(
        self, pos: int, entry: re.Match[str], state: dict[str, str], configuration: list[Span]
    ) -> None:
        label, kind = f"{entry['name']}{entry['number']}", entry["name"].upper()
        name, form = self._name(kind, entry["number"]) or label, state.get("FORM")
        spans = numbers_in(entry["values"], pos + entry.start("values"))
        if form == "PULSE" and len(spans) == 6:
            return self.add(pos, name, label, spans, axes=range(6), register=kind == "P")
        postype, tool = state.get("POSTYPE"), state.get("TOOL", "")
        frame = {"ROBOT": "base", "BASE": "base", "USER": state.get("USER", "")}.get(postype or "", "")
        if form != "RECTAN" or len(spans) != 6 or not frame or not tool.isdecimal() or len(configuration) < 6:
            what = f"///{form or '?'}, ///POSTYPE {postype}, {len(spans)} numbers"
            return self.unread(pos, f"{label} is not understood ({what})", label)
        if self.file.text[slice(*configuration[2])] != "0":
            sentence = f"{label} is behind axis S: what is its upper arm is not published"
            return self.unread(pos, sentence, label)
        tool, register = str(int(tool)), kind == "P"
        frame = str(int(frame)) if frame.isdecimal() else frame if frame == "base" else AT_RUN_TIME
        return self.add(pos, name, label, spans, configuration, register=register, tool=tool, frame=frame)

    def _statement(self, pos: int, text: str) -> None:
        if (group := re.match(r"///GROUP\d+\s+(.*)", text, _I)) and re.search(r"RB[2-9]", group[1]):
            self.refuse(pos, "the job moves another arm as well, or alone")
        if text.lstrip().startswith("/"):
            return None
        if _INFORM_RUN_TIME.match(text):
            self.refuse(pos, f"{text.split()[0]}: tools or frames are set when the program runs")
        words = [(match[1].upper(), match[2]) for match in _WORD.finditer(text)]
        names = [self._name(kind, number) for kind, number in words]
        stored = [name for name in names if name]
        if (move := _MOVE.match(text)) is not None:
            if move[1]:
                self.reading.added |= {*stored}
                return self.relative(pos, "IMOV is a step from where the arm is")
            if None in names:
                self.computed(pos, text.strip())
            return self.moves(pos, stored)
        if re.match(r"\s*SFTON\b", text, _I):
            self.reading.added |= {*stored}
            return self.relative(pos, "SFTON shifts the positions that follow")
        if _STORES.match(text) and names:
            label = f"{words[0][0]}{words[0][1]}"
            if names[0] is None:
                return self.refuse(pos, f"{label}: which position is overwritten is not known before it runs")
            return self.overwrites(pos, names[0], label)
        for name, (kind, number) in zip(names, words, strict=True):
            if name is not None and not re.match(r"\s*REFP\b", text, _I):
                self.doubt(pos, "call", f"{kind}{number} is used by this statement")
        return None

    def _name(self, kind: str, number: str) -> str | None:
        """None where a variable says which one it is."""
        if not number.isdecimal():
            return None
        return f"P{int(number)}" if kind == "P" else f"{self.file.name}:{kind}{int(number)}"
