"""Techman: TMscript programs."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramTemplate


def _parts() -> LineParts:
    from ...positions.joint_lists import TMSCRIPT

    return LineParts(TMSCRIPT, _PROGRAM)


_PROGRAM = ProgramTemplate("techman", "a TMscript program", "JPP", quote=lambda text: text.replace('"', ""))
_FORMAT = LineFormat(
    _parts,
    ("tmscript", "TMscript (Techman)", ("zb_plan.tms",), ("speed", "tool")),
    "TMscript files (.tms, .txt).",
    "Techman: joints in TMscript, as a person wrote them into a plan's program.",
    (r"\bJPP\b|^[ \t]*float\[\][ \t]+\w+[ \t]*=[ \t]*\{", "its joints (JPP, float[]), as of TMscript"),
)
MAKER = _FORMAT.maker("Techman", "techman", r"techman|tm ?\d+[sx]?|tm ?\d+[sx]? \d{3,4}")
