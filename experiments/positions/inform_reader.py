"""Positions of INFORM jobs (Yaskawa), with user frames of UFRAME.CND."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import NUMBER, BackupReading, SourceFile, Span, numbers_in, pose_of

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
_BUSER = re.compile(rf"^/{{3,4}}BUSER[ \t]+({NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}})[ \t]*\r?$", _I | _M)


def read_inform(reading: BackupReading) -> None:
    """User frames and jobs of a backup."""
    for file in reading.files:
        if file.suffix == ".cnd":
            for frame in _FRAME.finditer(file.text):
                pose = _BUSER.search(frame[2])
                numbers = [] if pose is None else [float(each) for each in pose[1].split(",")]
                reading.frame(
                    file,
                    frame.start(),
                    "frame",
                    str(int(frame[1])),
                    pose_of(from_rpy, numbers) if numbers else None,
                )
        else:
            _job(file, reading)


def _job(file: SourceFile, reading: BackupReading) -> None:
    parts = {(match[1] or "END").upper(): match for match in _PART.finditer(file.bare)}
    counts = _COUNTS.search(file.bare)
    if list(parts) != ["POS", "INST", "END"] or counts is None:
        return reading.unread(file, 0, "this is no whole job: //POS, ///NPOS, //INST and END are its parts")
    counted = _positions(file, parts["POS"].end(), parts["INST"].start(), reading)
    if counted != (int(counts[1]), int(counts[2])):
        reading.unread(
            file, counts.start(), f"///NPOS states {counts[1]} C and {counts[2]} P; there are {counted}"
        )
    for line in re.finditer(r"[^\n]+", file.bare[: parts["END"].start()]):
        if line.start() > parts["INST"].end():
            _statement(file, line, reading)
    return None


def _positions(file: SourceFile, start: int, end: int, reading: BackupReading) -> tuple[int, int]:
    """Their numbers, of C and of P."""
    state: dict[str, str] = {}
    configuration: list[Span] = []
    counts = {"C": 0, "P": 0}
    for line in re.finditer(r"[^\r\n]+", file.bare[:end]):
        if line.start() < start or not line[0].strip():
            continue
        section, entry = _SECTION.fullmatch(line[0]), _ENTRY.fullmatch(line[0])
        if section is not None:
            word = section[1].upper()
            state[word] = section[2].upper()
            if word in ("PULSE", "RECTAN", "ANGLE"):
                state["FORM"] = word
            elif word == "RCONF":
                configuration = numbers_in(section[2], line.start() + section.start(2))[:6]
        elif entry is None:
            reading.unread(file, line.start(), "this position is not understood")
        elif entry["name"].upper() in counts:
            counts[entry["name"].upper()] += 1
            _position(file, line.start(), entry, state, configuration, reading)
        elif any(float(each) for each in entry["values"].split(",")):
            label = f"{entry['name']}{entry['number']}"
            if entry["name"][0] in "bB":
                reading.refuse(file, line.start(), f"{label}: a base axis carries the arm")
            else:
                sentence = f"{label} is of a station, which must not carry the arm: it stays"
                reading.doubt(file, line.start(), "group", sentence)
    return counts["C"], counts["P"]


def _position(
    file: SourceFile,
    pos: int,
    entry: re.Match[str],
    state: dict[str, str],
    configuration: list[Span],
    reading: BackupReading,
) -> None:
    variable, label = entry["name"].upper() == "P", f"{entry['name']}{entry['number']}"
    name = f"{entry['name'].upper()}{int(entry['number'])}"
    name = name if variable else f"{file.name}:{name}"
    spans, form = numbers_in(entry["values"], pos + entry.start("values")), state.get("FORM")
    if form == "PULSE" and len(spans) == 6:
        return reading.add(file, pos, name, label, spans, axes=range(6), register=variable)
    postype, tool = state.get("POSTYPE"), state.get("TOOL", "")
    frame = {"ROBOT": "base", "BASE": "base", "USER": state.get("USER", "")}.get(postype or "", "")
    if form != "RECTAN" or len(spans) != 6 or not frame or not tool.isdecimal() or len(configuration) < 6:
        what = f"///{form or '?'}, ///POSTYPE {postype}, {len(spans)} numbers"
        return reading.unread(file, pos, f"{label} is not understood ({what})", label)
    if file.text[slice(*configuration[2])] != "0":
        return reading.unread(
            file, pos, f"{label} is behind axis S: what is its upper arm is not published", label
        )
    frame = frame if frame == "base" else str(int(frame)) if frame.isdecimal() else "?"
    return reading.add(
        file,
        pos,
        name,
        label,
        spans,
        configuration,
        register=variable,
        tool=str(int(tool)),
        frame=frame,
    )


def _statement(file: SourceFile, line: re.Match[str], reading: BackupReading) -> None:
    text, pos = line[0], line.start()
    if (group := re.match(r"///GROUP\d+\s+(.*)", text, _I)) is not None and re.search(r"RB[2-9]", group[1]):
        reading.refuse(file, pos, "the job moves another arm as well, or alone")
    if text.lstrip().startswith("/"):
        return None
    if _RUN_TIME.match(text):
        reading.refuse(file, pos, f"{text.split()[0]}: tools or frames are set when the program runs")
    words = [(match[1].upper(), match[2]) for match in _WORD.finditer(text)]
    names = [_name(file, kind, number) for kind, number in words]
    if (move := _MOVE.match(text)) is not None:
        if move[1]:
            reading.added |= {name for name in names if name}
            return reading.doubt(file, pos, "relative", "IMOV is a step from where the arm is")
        if None in names:
            reading.computed(file, pos, text.strip())
        return reading.moves(file, pos, [name for name in names if name])
    if re.match(r"\s*SFTON\b", text, _I):
        reading.added |= {name for name in names if name}
        return reading.doubt(file, pos, "relative", "SFTON shifts the positions that follow")
    if _STORES.match(text) and names:
        label = f"{words[0][0]}{words[0][1]}"
        if names[0] is None:
            reading.refuse(file, pos, f"{label}: which position is overwritten is not known before it runs")
        else:
            reading.overwrites(file, pos, names[0], label)
        return None
    for name, (kind, number) in zip(names, words, strict=True):
        if name is not None and not re.match(r"\s*REFP\b", text, _I):
            reading.doubt(file, pos, "call", f"{kind}{number} is used by this statement")
    return None


def _name(file: SourceFile, kind: str, number: str) -> str | None:
    """None where a variable says which one it is."""
    if not number.isdecimal():
        return None
    return f"P{int(number)}" if kind == "P" else f"{file.name}:{kind}{int(number)}"
