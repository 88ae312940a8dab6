"""Mitsubishi: MELFA-BASIC V and VI programs."""

from ..maker import Maker, PlanProgram, TaughtFormat
from ..manifest import ProgramName, ProgramTemplate, taught_reader

_NAME = ProgramName(
    r"[A-Za-z0-9]\w{0,15}", "program", "the controller", "letters, digits and _: at most 16 (ZB_PLAN.prg)"
)
_PROGRAM = ProgramTemplate("mitsubishi", "a MELFA-BASIC program", "a joint variable", name=_NAME)
_FORMAT = TaughtFormat(
    "MELFA-BASIC",
    "Programs as text (.prg, .mb5).",
    "Mitsubishi: joint variables (J…) of a program saved as text, taught at the postures.",
    (
        (
            r"^[ \t]*(?:\d+[ \t]+)?J\w+[ \t]*=[ \t]*\(",
            "its joint variables (J… = (…)), as of a MELFA-BASIC program",
        ),
    ),
    digits=2,
)
MAKER = Maker(
    "Mitsubishi",
    "mitsubishi",
    r"mitsubishi|melfa|rv ?\d+\w*",
    program=(PlanProgram("melfa", "MELFA-BASIC (Mitsubishi)", ("ZB_PLAN.prg",), _PROGRAM, ("speed",)),),
    read=(taught_reader("melfa", _FORMAT),),
)
