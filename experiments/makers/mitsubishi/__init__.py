"""Mitsubishi: MELFA-BASIC V and VI programs."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.position_languages import MELFA
    from .melfa_program import DIGITS, melfa_program

    return LineParts(MELFA, melfa_program, digits=DIGITS)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Mitsubishi: joint variables (J…) of a program saved as text, taught at the postures.",
)
MAKER = Maker(
    "Mitsubishi",
    "mitsubishi",
    r"mitsubishi|melfa|rv ?\d+\w*",
    program=(
        PlanProgram("melfa", "MELFA-BASIC (Mitsubishi)", ("ZB_PLAN.prg",), _FORMAT.program, ("speed",)),
    ),
    read=(
        Reader(
            "melfa",
            _READ,
            "Programs as text (.prg, .mb5).",
            marks=(
                _FORMAT.mark(
                    r"^[ \t]*(?:\d+[ \t]+)?J\w+[ \t]*=[ \t]*\(",
                    "its joint variables (J… = (…)), as of a MELFA-BASIC program",
                ),
            ),
        ),
    ),
)
