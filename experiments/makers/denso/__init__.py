"""Denso: PacScript programs."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.position_languages import PACSCRIPT
    from .pacscript_program import pacscript_program

    return LineParts(PACSCRIPT, pacscript_program)


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
