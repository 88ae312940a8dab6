"""Denso: PacScript programs."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.position_languages import PACSCRIPT
    from .pacscript_program import pacscript_program

    return LineParts(PACSCRIPT, pacscript_program)


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Denso: the messages of a plan's program, or joint positions (J) of a PacScript program.",
    log="PacScript",
)
MAKER = Maker(
    "Denso",
    "denso",
    r"denso|v[smp] ?\d+\w*|cobotta\w*",
    program=(PlanProgram("pacscript", "PacScript (Denso)", ("zb_plan.pcs",), _FORMAT.program, ("speed",)),),
    read=(
        Reader(
            "pacscript",
            _READ,
            "Logs of a plan's program, or PacScript files (.pcs).",
            marks=(
                _FORMAT.mark(
                    r"^[ \t]*[A-Za-z]\w*(?:\[\d+\])?[ \t]*=[ \t]*J[ \t]*\(",
                    "its joint positions (… = J(…)), as of a PacScript program",
                ),
            ),
            program_log=True,
        ),
    ),
)
