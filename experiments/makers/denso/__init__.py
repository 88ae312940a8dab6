"""Denso: PacScript programs."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramName, ProgramTemplate


def _parts() -> LineParts:
    from ...positions.position_languages import PACSCRIPT

    return LineParts(PACSCRIPT, _PROGRAM)


_NAME = ProgramName(
    r"[A-Za-z]\w{0,63}",
    "program",
    "PacScript",
    "a letter, then letters, digits and _: at most 64 (zb_plan.pcs)",
)
_PROGRAM = ProgramTemplate("denso", "a PacScript program", "J", name=_NAME)
_FORMAT = LineFormat(
    _parts,
    ("pacscript", "PacScript (Denso)", ("zb_plan.pcs",), ("speed",)),
    "Logs of a plan's program, or PacScript files (.pcs).",
    "Denso: the messages of a plan's program, or joint positions (J) of a PacScript program.",
    (
        r"^[ \t]*[A-Za-z]\w*(?:\[\d+\])?[ \t]*=[ \t]*J[ \t]*\(",
        "its joint positions (… = J(…)), as of a PacScript program",
    ),
    log="PacScript",
)
MAKER = _FORMAT.maker("Denso", "denso", r"denso|v[smp] ?\d+\w*|cobotta\w*")
