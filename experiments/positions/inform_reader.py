"""Positions of INFORM jobs (Yaskawa), with tools of TOOL.CND and user frames of UFRAME.CND."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import AT_RUN_TIME, BackupReading, FileReading, pose_of
from .statement_text import NUMBER, Span, lines_in, numbers_in, values_in

_I, _M = re.IGNORECASE, re.MULTILINE
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
_RUN_TIME = re.compile(r"\s*(?:MFRAME|SETTOOL|CHANGE[ \t]+TOOL)\b", _I)
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
        if _RUN_TIME.match(text):
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
