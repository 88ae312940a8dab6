"""Nachi: SLIM programs of joint positions."""

import re

from ..maker import Maker, PlanProgram, TaughtFormat, TaughtPoint
from ..manifest import ProgramTemplate, ToolName, taught_reader

_LABELLED = re.compile(
    r"""^[ \t]*(?:REM[ \t]*"|')(zb_[pv][\d_]+)\b[^\n]*\n[ \t]*MOVEX\b""", re.MULTILINE | re.IGNORECASE
)


def _named(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a program, those of a plan's program by the names in its remarks."""
    from ....model.errors import BadInput
    from ....model.parsing.reading import line_numbers
    from ..taught_positions import named_by_remarks

    if not re.search(r"^[ \t]*END\s*\Z", text, re.MULTILINE | re.IGNORECASE):
        raise BadInput("the program has no end", allowed="END in its last line", remedy="save it again")
    line_of = line_numbers(text)
    labels = [(match[1].lower(), f"line {line_of(match.end())}") for match in _LABELLED.finditer(text)]
    if not labels and "zerobeam plan" not in text:
        return list(points)
    return named_by_remarks(points, labels, [point.name for point in points], "slim")


_PROGRAM = ProgramTemplate(
    "nachi",
    "a SLIM program",
    "M1J",
    tool=ToolName(r"\d{1,2}", "the number of a tool", "1 to 32", "1"),
    quote=lambda text: text.replace('"', ""),
    newline="\r\n",
)
_FORMAT = TaughtFormat(
    "SLIM",
    "Programs as text (NAME.001).",
    "Nachi: joint positions (MOVEX … M1J) of a program that was taught, or modified in a plan's program.",
    ((r"\bM1J\b", "its joint positions (M1J), as of a SLIM program"),),
    named=_named,
    digits=3,
)
MAKER = Maker(
    "Nachi",
    "nachi",
    r"nachi|mz ?\d+\w*",
    program=(PlanProgram("slim", "SLIM (Nachi)", ("zb_plan.slim",), _PROGRAM, ("speed", "tool")),),
    read=(taught_reader("slim", _FORMAT),),
)
