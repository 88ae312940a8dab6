"""Yaskawa: INFORM jobs, a sheet for the home position."""

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..maker import Maker, PlanProgram, TaughtFormat, TaughtPoint
from ..manifest import ProgramName, ProgramTemplate, ToolName, sheet_file, taught_reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ...command_options import ProgramMotion


_LABELLED = re.compile(
    r"^[ \t]*'(zb_(?:p\d+|v\d+_\d+))\b[^\n]*\n[ \t]*MOVJ (C\d+)", re.MULTILINE | re.IGNORECASE
)


def _named(text: str, points: list[TaughtPoint]) -> list[TaughtPoint]:
    """The positions of a job, those of a plan's program by the names in its remarks."""
    from ..taught_positions import named_by_remarks

    labels = [(match[1].lower(), match[2].upper()) for match in _LABELLED.finditer(text)]
    if not labels and "zerobeam plan" not in text:
        return points
    points = [point._replace(name=point.name.upper()) for point in points]
    return named_by_remarks(points, labels, sorted({point.name for point in points}), "inform")


def _pulses(plan: "Plan", motion: "ProgramMotion") -> Mapping[str, object]:
    from ....model.kinematics.pendant import Pendant

    return {"per_degree": Pendant(plan.robot).per_degree("pulse").tolist()}


_NAME = ProgramName(
    r"[A-Za-z][\w-]{0,7}", "job", "INFORM", "a letter, then letters, digits, _ and -: at most 8 (ZB_PLAN.JBI)"
)
_PROGRAM = ProgramTemplate(
    "yaskawa",
    "an INFORM job",
    "a job's position",
    name=_NAME,
    tool=ToolName(r"\d{1,2}", "the number of a tool file", "0 to 63", "0"),
    newline="\r\n",
    more=_pulses,
)
_FORMAT = TaughtFormat(
    "INFORM",
    "Saved jobs (.JBI).",
    "Yaskawa: positions in pulses of a saved job, taught, or modified in a plan's program.",
    ((r"^/JOB\b", "its line /JOB, as of an INFORM job"),),
    named=_named,
    digits=0,
)
_SHEET = "Yaskawa: a sheet for a person, where each axis has its home position. Nothing is applied."
MAKER = Maker(
    "Yaskawa",
    "yaskawa",
    r"motoman|yaskawa|gp ?\d+\w*",
    offsets=(sheet_file("yaskawa", _SHEET),),
    live="yaskawa://HOST",
    program=(PlanProgram("inform", "INFORM (Yaskawa)", ("ZB_PLAN.JBI",), _PROGRAM, ("speed", "tool")),),
    read=(taught_reader("inform", _FORMAT),),
)
