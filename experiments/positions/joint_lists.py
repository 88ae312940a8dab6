"""Languages of which joints alone are read: SLIM (Nachi), TMscript (Techman), joint lists (Franka)."""

from __future__ import annotations

import re
from collections.abc import Callable

from .position import BackupReading, FileReading, JointLanguage, SourceFile
from .statement_text import NUMBER, is_computed, numbers_in

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
_LISTED = re.compile(
    r"^[ \t]*(?:float\[\][ \t]+)?(?P<name>[A-Za-z_]\w*)[ \t]*=[ \t]*"
    r"[\[{](?P<values>[^,=\n]*(?:,[^,=\n]*){5,})[\]}][ \t\r]*$",
    _M,
)
_CALL = re.compile(
    rf'\b(?P<word>PTP|Line|Change\w+)[ \t]*\((?:[ \t]*"(?P<how>[^"\n]*)"[ \t]*,)?[ \t]*\{{?{_SIX}'
)
_POSTURE = re.compile(r"zb_[pmv]\d", _I)


def _in_joints(file: SourceFile, entry: re.Match[str]) -> bool:
    """Whether an entry is joints: in TMscript where a motion, or its name in a plan's program, says so."""
    groups = entry.groupdict()
    if "word" in groups:
        return groups["word"] == "PTP" and file.text[slice(*entry.span("how"))] == "JPP"
    if entry.re is not _FLOATS:
        return True
    by_joints = rf'\bPTP[ \t]*\([ \t]*"JPP"[ \t]*,[ \t]*{entry["name"]}\b'
    return _POSTURE.match(entry["name"]) is not None or re.search(by_joints, file.text) is not None


def _read(every: re.Pattern[str], *entries: re.Pattern[str]) -> Callable[[BackupReading], None]:
    """Reads the values of entries; `every` text that looks like a position has to be one."""

    def read(reading: BackupReading) -> None:
        for file in reading.files:
            here, starts = FileReading(file, reading), set()
            for match in (match for entry in entries for match in entry.finditer(file.bare)):
                spans = numbers_in(match["values"], match.start("values"))
                at = spans[0][0]
                starts.add(at)
                label = match.groupdict().get("name") or here.inline(at)[1]
                axes = range(len(spans)) if _in_joints(file, match) else None
                if not (match.groupdict().get("word") or "").startswith("Change"):
                    here.add(at, f"{file.name}:{label}", label, spans, axes=axes)
            for match in _LISTED.finditer(file.bare):
                places = range(*match.span("values"))
                if starts.isdisjoint(places) and is_computed(match["values"]):
                    reading.made.append((file, file.line(places.start), match["name"]))
                    starts |= {*places}
            for match in every.finditer(file.bare):
                start = match.end("values") - len(match["values"].lstrip())
                if start not in starts:
                    here.unread(start, "this position is not understood")

    return read


SLIM = JointLanguage("SLIM", "nachi", (".slim",), _read(_ANY_LIST, _SLIM), remark=r"'[^\n]*")
TMSCRIPT = JointLanguage(
    "TMscript", "techman", (".tms",), _read(_ANY_SIX, _FLOATS, _CALL), remark=r"//[^\n]*|/\*[\s\S]*?\*/"
)
JOINT_LIST = JointLanguage(
    "joint list", "franka", (".py", ".txt"), _read(_ANY_SIX, _LIST), remark=r"#[^\n]*", unit="rad"
)
