"""KUKA: mastering, KRL."""

import re

from ..maker import Maker, PlanProgram, TaughtFormat, TaughtPoint
from ..manifest import ProgramName, ProgramTemplate, ToolName, sheet_file, taught_reader

# What the program of a plan records: the axes at posture n, and whether they are.
_MEASURED = re.compile(r"\bZB_M(\d{1,9})\b", re.IGNORECASE)
_DONE = re.compile(r"\bZB_D(\d{1,9})\s*=\s*TRUE\b", re.IGNORECASE)


def _recorded(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """Those of a data list of a plan's program that it has recorded, by their postures."""
    from ...positions.position import SourceFile
    from ...positions.position_languages import KRL

    if not _MEASURED.search(text):
        return points
    done = {match[1] for match in _DONE.finditer(SourceFile("", text, KRL.remark).bare)}
    named = [(point, _MEASURED.fullmatch(point.name)) for point in points]
    return [point._replace(number=int(match[1])) for point, match in named if match and match[1] in done]


_PROGRAM = ProgramTemplate(
    "kuka",
    "a KRL program",
    "a KRL AXIS",
    files=(".src", ".dat"),
    name=ProgramName.word("module", "KRL", 24, "zb_plan.src"),
    tool=ToolName(r"0*([1-9]|[1-5]\d|6[0-4])", "a tool number of KRL", "1 to 64"),
)
_FILES = ("zb_plan.src", "zb_plan.dat")
_FORMAT = TaughtFormat(
    "KRL",
    "Data lists (.dat).",
    "KUKA: axis positions (AXIS, E6AXIS) of a data list, taught or recorded by a plan's program.",
    (
        (
            r"^[ \t]*DEFDAT\b|\b\w+(?:\[\d+\])?\s*=\s*\{\s*(?:\w+\s*:)?\s*(?:A\d|X)\s",
            "its positions in KRL",
        ),
    ),
    recorded=_recorded,
    declared=True,
    note="KUKA axis positions, angles in degrees, A1 first, external axes ignored",
)
_SHEET = "KUKA: a sheet for a person, the mastering offsets of the axes. Nothing is applied."
MAKER = Maker(
    "KUKA",
    "kuka",
    r"kuka|kr ?\d+\w*|lbr|iiwa ?\d*",
    offsets=(sheet_file("kuka", _SHEET),),
    program=(PlanProgram("krl", "KRL (KUKA)", _FILES, _PROGRAM, ("speed", "zone", "tool")),),
    read=(taught_reader("krl", _FORMAT), taught_reader("kuka", _FORMAT, hidden=True)),
    live="kuka://HOST",
)
