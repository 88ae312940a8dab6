"""Mitsubishi: MELFA-BASIC V and VI programs."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramName, ProgramTemplate


def _parts() -> LineParts:
    from ...positions.position_languages import MELFA

    return LineParts(MELFA, _PROGRAM, digits=2)


_NAME = ProgramName(
    r"[A-Za-z0-9]\w{0,15}", "program", "the controller", "letters, digits and _: at most 16 (ZB_PLAN.prg)"
)
_PROGRAM = ProgramTemplate("mitsubishi", "a MELFA-BASIC program", "a joint variable", name=_NAME)
_FORMAT = LineFormat(
    _parts,
    ("melfa", "MELFA-BASIC (Mitsubishi)", ("ZB_PLAN.prg",), ("speed",)),
    "Programs as text (.prg, .mb5).",
    "Mitsubishi: joint variables (J…) of a program saved as text, taught at the postures.",
    (
        r"^[ \t]*(?:\d+[ \t]+)?J\w+[ \t]*=[ \t]*\(",
        "its joint variables (J… = (…)), as of a MELFA-BASIC program",
    ),
)
MAKER = _FORMAT.maker("Mitsubishi", "mitsubishi", r"mitsubishi|melfa|rv ?\d+\w*")
