"""Languages of which joints alone are read: SLIM (Nachi), TMscript (Techman), joint lists (Franka)."""

from __future__ import annotations

import re
from collections.abc import Callable

from .position import NUMBER, BackupReading, JointLanguage, SourceFile, numbers_in

_I, _M = re.IGNORECASE, re.MULTILINE
_VALUES = rf"(?P<values>[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER})+)[ \t]*"
_SIX = rf"(?P<values>[ \t]*{NUMBER}(?:[ \t]*,[ \t]*{NUMBER}){{5}})(?![\w.])"
_ANY_SIX = re.compile(rf"(?<![\w.])(?<![-+]){_SIX}")
_ANY_LIST = re.compile(r"(?<=\()(?P<values>[^()\n]*(?:,[^()\n]*){5,})(?=\))")
_SLIM = re.compile(rf"^[ \t]*MOVEX[^()\n]*\bM1J[ \t]*,[ \t]*[PL][ \t]*,[ \t]*\({_VALUES}\)[^()\n]*$", _I | _M)
_LIST = re.compile(rf"^[ \t]*(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*\[{_VALUES}\][ \t\r]*$", _M)
_FLOATS = re.compile(
    rf"^[ \t]*float\[\][ \t]+(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*\{{{_VALUES}\}}[ \t\r]*$", _M
)
_CALL = re.compile(
    rf'\b(?P<word>PTP|Line|Change\w+)[ \t]*\((?:[ \t]*"(?P<how>[^"\n]*)"[ \t]*,)?[ \t]*\{{?{_SIX}'
)
_BY_JOINTS = re.compile(r'\bPTP[ \t]*\([ \t]*"JPP"[ \t]*,[ \t]*(\w+)')
_POSTURE = re.compile(r"zb_[pmv]\d", _I)


def _lists(
    file: SourceFile,
    entry: re.Pattern[str],
    reading: BackupReading,
    in_joints: Callable[[re.Match[str]], bool] = lambda _: True,
) -> set[int]:
    """Where the values of each entry begin; its joints, or poses, are added."""
    starts = set()
    for match in entry.finditer(file.bare):
        spans = numbers_in(match["values"], match.start("values"))
        starts.add(spans[0][0])
        label = match.groupdict().get("name") or f"line {file.line(spans[0][0])}"
        axes = range(len(spans)) if in_joints(match) else None
        if not (match.groupdict().get("word") or "").startswith("Change"):
            reading.add(file, spans[0][0], f"{file.name}:{label}", label, spans, axes=axes)
    return starts


def _rest(file: SourceFile, every: re.Pattern[str], starts: set[int], reading: BackupReading) -> None:
    """All that looks like a position has to be one."""
    for match in every.finditer(file.bare):
        start = match.start("values") + len(match["values"]) - len(match["values"].lstrip())
        if start not in starts:
            reading.unread(file, start, "this position is not understood")


def _read_slim(reading: BackupReading) -> None:
    for file in reading.files:
        _rest(file, _ANY_LIST, _lists(file, _SLIM, reading), reading)


def _read_joint_list(reading: BackupReading) -> None:
    for file in reading.files:
        _rest(file, _ANY_SIX, _lists(file, _LIST, reading), reading)


def _read_tmscript(reading: BackupReading) -> None:
    for file in reading.files:
        moved = set(_BY_JOINTS.findall(file.text))

        def named(match: re.Match[str], moved: set[str] = moved) -> bool:
            return match["name"] in moved or _POSTURE.match(match["name"]) is not None

        def called(match: re.Match[str], file: SourceFile = file) -> bool:
            return match["word"] == "PTP" and file.text[slice(*match.span("how"))] == "JPP"

        starts = _lists(file, _FLOATS, reading, named) | _lists(file, _CALL, reading, called)
        _rest(file, _ANY_SIX, starts, reading)


SLIM = JointLanguage("SLIM", "nachi", (".slim",), _read_slim, remark=r"'[^\n]*")
TMSCRIPT = JointLanguage("TMscript", "techman", (".tms",), _read_tmscript, remark=r"//[^\n]*|/\*[\s\S]*?\*/")
JOINT_LIST = JointLanguage(
    "joint list", "franka", (".py", ".txt"), _read_joint_list, remark=r"#[^\n]*", unit="rad"
)
