"""Kawasaki: AS programs."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramName, ProgramTemplate


def _parts() -> LineParts:
    from ...positions.position_languages import AS

    return LineParts(AS, _PROGRAM)


_NAME = ProgramName(
    r"[A-Za-z]\w{0,14}", "program", "AS", "a letter, then letters, digits and _: at most 15 (zb_plan.as)"
)
_PROGRAM = ProgramTemplate("kawasaki", "an AS program", "a joint displacement value", name=_NAME)
_FORMAT = LineFormat(
    _parts,
    ("as", "AS (Kawasaki)", ("zb_plan.as",), ("speed", "zone", "tool")),
    "Saved AS files (.as, .pg).",
    "Kawasaki: joint displacement values (#name) of a saved file, taught or recorded by a plan's program.",
    (r"^[ \t]*\.(?:PROGRAM|JOINTS|TRANS)\b", "its lines .PROGRAM or .JOINTS, as of an AS file"),
)
MAKER = _FORMAT.maker("Kawasaki", "kawasaki", r"kawasaki|rs ?\d+\w*|bx ?\d+\w*|duaro\w*")
