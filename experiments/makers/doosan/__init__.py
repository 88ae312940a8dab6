"""Doosan: DRL programs."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramTemplate, taught_reader

_PROGRAM = ProgramTemplate("doosan", "a DRL program", "posj", quote=lambda text: text.replace('"', ""))
_FORMAT = TaughtFormat(
    "DRL",
    "Logs of a plan's program, or DRL files (.drl).",
    "Doosan: the pendant's log of a plan's program, or joint positions (posj) of a DRL program.",
    ((r"\bposj[ \t]*\(", "its joint positions (posj), as of DRL"),),
    log="DRL",
)
MAKER = Maker(
    "Doosan",
    "doosan",
    r"doosan|[maeh]\d{4}s?",
    program=(PlanProgram("drl", "DRL (Doosan)", ("zb_plan.drl",), _PROGRAM, ("speed", "tool")),),
    read=(taught_reader("drl", _FORMAT),),
)
