"""Techman: TMscript programs."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramTemplate, taught_reader

_PROGRAM = ProgramTemplate("techman", "a TMscript program", "JPP", quote=lambda text: text.replace('"', ""))
_FORMAT = TaughtFormat(
    "TMscript",
    "TMscript files (.tms, .txt).",
    "Techman: joints in TMscript, as a person wrote them into a plan's program.",
    ((r"\bJPP\b|^[ \t]*float\[\][ \t]+\w+[ \t]*=[ \t]*\{", "its joints (JPP, float[]), as of TMscript"),),
)
MAKER = Maker(
    "Techman",
    "techman",
    r"techman|tm ?\d+[sx]?|tm ?\d+[sx]? \d{3,4}",
    program=(PlanProgram("tmscript", "TMscript (Techman)", ("zb_plan.tms",), _PROGRAM, ("speed", "tool")),),
    read=(taught_reader("tmscript", _FORMAT),),
)
