"""Positions of TP listings and position registers (FANUC), with frames of SYSFRAME.VA."""

from __future__ import annotations

import re

from ...model.kinematics.orientation import from_rpy
from .position import NUMBER, Active, BackupReading, SourceFile, What, pose_of

_M = re.MULTILINE
_POINT = re.compile(r"^[ \t]*P\[[ \t]*(?P<number>\d+)[^\]\n]*\][ \t]*\{(?P<block>[^{}]*)\}[ \t]*;", _M)
_GROUP = re.compile(r"\bGP(\d+)[ \t]*:")
_TURNS = r"-?\d+[ \t]*,[ \t]*-?\d+[ \t]*,[ \t]*-?\d+"
_CONFIGURED = re.compile(rf"(?:CONFIG[ \t]*:[ \t]*'|Config:[ \t]*)([A-Z ]*[A-Z])[ \t]*,[ \t]*({_TURNS})")
_VALUE = re.compile(rf"\b([XYZWPR]|[JE]\d|EXT\d)[ \t]*[=:][ \t]*(\*+|{NUMBER})(?:[ \t]*(deg|mm))?")
_FRAMES = re.compile(r"UF[ \t]*:[ \t]*(\d+|F)[ \t]*,[ \t]*UT[ \t]*:[ \t]*(\d+|F)")
_ENTRY = re.compile(r"^[ \t]*\[(\d+),(\d+)\][ \t]*=(?:[ \t]*'[^'\n]*')?", _M)
_VARIABLE = re.compile(r"^\[\*\w+\*\](\$\w+)[^\n]*", _M)
_STATEMENT = re.compile(r"^[ \t]*\d*[ \t]*:(?P<body>(?:[^;\n]|\n[ \t]*:)*);", _M)
_GOAL = re.compile(r"\bP(R?)\[\s*(?:GP\d+\s*:\s*)?(\d+)?[^\]]*\]")
_OFFSET = re.compile(r"\b(?:Tool_)?Offset(?:\s*,\s*PR\[\s*(?:GP\d+:)?(\d+)?[^\]]*\])?", re.IGNORECASE)
_RUN_TIME = re.compile(r"\b(?:UFRAME|UTOOL)\[.*?\]\s*=|\$MNU(?:FRAME|TOOL)\b.*?=|\bRTCP\b|\bCOORD\b")
_JUMP = re.compile(r"\s*(?:LBL|JMP|IF|SELECT|FOR|ENDFOR|ELSE|ENDIF|SKIP)\b|.*\bJMP\b")
_ASSIGNED = re.compile(r"\s*P(R?)\[\s*(?:GP1\s*:\s*)?(\d+)?[^\]]*\]\s*=")


def read_fanuc(reading: BackupReading) -> None:
    """Frames, registers and listings of a backup."""
    for file in reading.files:
        if _VARIABLE.search(file.text):
            _variables(file, reading)
        elif re.search(r"^/(?:PROG|POS)\b", file.text, _M):
            _listing(file, reading)


def _variables(file: SourceFile, reading: BackupReading) -> None:
    """$MNUFRAME, $MNUTOOL and $POSREG of group 1, $SCR_GRP[1].$ROBOT_ID."""
    if (model := re.search(r"\$SCR_GRP\[1\]\.\$ROBOT_ID[^=\n]*=\s*'([^'\n]*)'", file.text)) is not None:
        reading.model = (file, file.line(model.start()), model[1].strip())
    parts = list(_VARIABLE.finditer(file.text))
    for part, end in zip(parts, [*(each.start() for each in parts[1:]), len(file.text)], strict=False):
        heads = list(_ENTRY.finditer(file.text, part.end(), end))
        for head, stop in zip(heads, [*(each.start() for each in heads[1:]), end], strict=False):
            taught = head[1] == "1" and "Uninitialized" not in file.text[head.start() : stop]
            if taught and part[1] == "$POSREG":
                _position(file, f"PR[{head[2]}]", f"PR[{head[2]}]", head.start(1), head.end(), stop, reading)
            elif taught and part[1] in ("$MNUFRAME", "$MNUTOOL"):
                values = {key: text for key, text, _ in _VALUE.findall(file.text[head.end() : stop])}
                known = set("XYZWPR") <= set(values) and "*" not in "".join(values.values())
                pose = pose_of(from_rpy, [float(values[key]) for key in "XYZWPR"]) if known else None
                what: What = "tool" if part[1] == "$MNUTOOL" else "frame"
                reading.frame(file, head.start(), what, head[2], pose)


def _listing(file: SourceFile, reading: BackupReading) -> None:
    parts = {match[1]: match for match in re.finditer(r"^/(MN|POS|END)\b", file.text, _M)}
    if list(parts) != ["MN", "POS", "END"]:
        return reading.unread(file, 0, "this is no whole listing: /MN, /POS and /END are its parts")
    at, end = parts["POS"].end(), parts["END"].start()
    for point in [*_POINT.finditer(file.text, at, end), None]:
        gap = file.text[at : end if point is None else point.start()]
        if gap.strip():
            reading.unread(file, at + len(gap) - len(gap.lstrip()), "this position is not understood")
        if point is not None:
            label, at = f"P[{int(point['number'])}]", point.end()
            groups = [*_GROUP.finditer(file.text, *point.span("block"))]
            stops = [*(group.start() for group in groups[1:]), point.end("block")]
            if [group[1] for group in groups[:1]] != ["1"]:
                reading.unread(file, point.start("number"), f"{label} has no group 1", label)
                continue
            name = f"{file.name}:{label}"
            _position(file, name, label, point.start("number"), groups[0].end(), stops[0], reading)
            for group, stop in zip(groups[1:], stops[1:], strict=True):
                sentence = f"{label} has group {group[1]}, which must not carry the arm or the work: it stays"
                if len(_VALUE.findall(file.text[group.end() : stop])) == 1:
                    reading.doubt(file, group.start(), "group", sentence)
                else:
                    reading.refuse(file, group.start(), f"{label} has group {group[1]} of several axes")
    return _program(file, parts["MN"].end(), parts["POS"].start(), reading)


def _position(
    file: SourceFile, name: str, label: str, pos: int, start: int, stop: int, reading: BackupReading
) -> None:
    fields, register = list(_VALUE.finditer(file.text, start, stop)), label[:2] == "PR"
    spans = {match[1]: match.span(2) for match in fields if match[1][0] != "E"}
    taught = bool(fields) and not any("*" in match[2] for match in fields)
    # A register that holds no joints is of no interest to who looks for joints.
    unread = None if register and not any(match[1][0] == "J" for match in fields) else label
    if not taught or len({match[1] for match in fields}) < len(fields):
        return reading.unread(file, pos, f"{label} is not taught, or states a value twice", unread)
    external = [float(match[2]) for match in fields if match[1][0] == "E"]
    units = {match[3] for match in fields if match[1] in spans}
    if list(spans) == [f"J{i}" for i in range(1, len(spans) + 1)] and units == {"deg"}:
        axes = range(len(spans))
        return reading.add(
            file, pos, name, label, [*spans.values()], axes=axes, external=external, register=register
        )
    configured, frames = _CONFIGURED.search(file.text, start, stop), _FRAMES.search(file.text, start, stop)
    if list(spans) != list("XYZWPR") or configured is None:
        return reading.unread(file, pos, f"{label} is not understood", unread)
    numbers = (
        [None if each == "F" else str(int(each)) for each in frames.groups()] if frames else [None, None]
    )
    configuration = configured.span(1), configured.span(2)
    return reading.add(
        file,
        pos,
        name,
        label,
        [*spans.values()],
        configuration,
        external=external,
        register=register,
        frame=numbers[0],
        tool=numbers[1],
    )


def _program(file: SourceFile, start: int, end: int, reading: BackupReading) -> None:
    statements, active = list(_STATEMENT.finditer(file.text, start, end)), Active()
    for statement in statements:
        active.jumps |= _JUMP.match(statement["body"]) is not None
        if (put := re.match(r"\s*(UFRAME_NUM|UTOOL_NUM)\s*=\s*(\d+)?", statement["body"])) is not None:
            active.set("frame" if put[1] == "UFRAME_NUM" else "tool", statement.start(), put[2])
    for statement in statements:
        body, pos = statement["body"], statement.start("body")
        if re.match(r"\s*(?:!|//|--)", body):
            continue
        if (run_time := _RUN_TIME.search(body)) is not None:
            reading.refuse(file, pos, f"{run_time[0]}: tools, frames or work are moved when the program runs")
        if re.match(r"\s*[JLCAS]\s+P(?:R?)\[", body):
            _motion(file, pos, body, reading, active)
        elif (assigned := _ASSIGNED.match(body)) is not None:
            label = f"P{assigned[1]}[{assigned[2] or '…'}]"
            reading.overwrites(file, pos, label if assigned[1] else f"{file.name}:{label}", label)


def _motion(file: SourceFile, pos: int, body: str, reading: BackupReading, active: Active) -> None:
    goals: list[str] = []
    for goal in _GOAL.finditer(_OFFSET.sub("", body)):
        label = f"P{goal[1]}[{int(goal[2])}]" if goal[2] else goal[0]
        if not goal[2]:
            reading.computed(file, pos, label)
        elif re.search(r"\bINC\b", body):
            reading.refuse(file, pos, f"INC: {label} is a step, not a place")
        else:
            goals.append(label if goal[1] else f"{file.name}:{label}")
    for offset in _OFFSET.finditer(body):
        reading.added |= {f"PR[{offset[1]}]"}
        axes: What = "tool" if offset[0].lower().startswith("tool") else "frame"
        sentence = " ".join(offset[0].split())
        reading.doubt(file, pos, "relative", sentence, goals[-1] if goals else None, None, axes)
    if re.search(r"\bVOFFSET\b|\bVR\[", body):
        reading.computed(file, pos, "an offset by a camera")
    reading.moves(file, pos, goals, active.at("tool", pos), active.at("frame", pos))
