"""Denso: PacScript programs."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramName, ProgramTemplate, taught_reader

_NAME = ProgramName.word("program", "PacScript", 64, "zb_plan.pcs")
_PROGRAM = ProgramTemplate("denso", "a PacScript program", "J", name=_NAME)
_FORMAT = TaughtFormat(
    "PacScript",
    "Logs of a plan's program, or PacScript files (.pcs).",
    "Denso: the messages of a plan's program, or joint positions (J) of a PacScript program.",
    (
        (
            r"^[ \t]*[A-Za-z]\w*(?:\[\d+\])?[ \t]*=[ \t]*J[ \t]*\(",
            "its joint positions (… = J(…)), as of a PacScript program",
        ),
    ),
    log="PacScript",
)
MAKER = Maker(
    "Denso",
    "denso",
    r"denso|v[smp] ?\d+\w*|cobotta\w*",
    program=(PlanProgram("pacscript", "PacScript (Denso)", ("zb_plan.pcs",), _PROGRAM, ("speed",)),),
    read=(taught_reader("pacscript", _FORMAT),),
)
