"""Mitsubishi: MELFA-BASIC V and VI programs."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.position_languages import MELFA
    from .melfa_program import DIGITS, melfa_program

    return LineParts(MELFA, melfa_program, digits=DIGITS)


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
