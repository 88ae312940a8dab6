"""Techman: TMscript programs."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.joint_lists import TMSCRIPT
    from .tmscript_program import tmscript_program

    return LineParts(TMSCRIPT, lambda plan, motion, file: tmscript_program(plan, motion))


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Techman: joints in TMscript, as a person wrote them into a plan's program.",
)
MAKER = Maker(
    "Techman",
    "techman",
    r"techman|tm ?\d+[sx]?|tm ?\d+[sx]? \d{3,4}",
    program=(
        PlanProgram("tmscript", "TMscript (Techman)", ("zb_plan.tms",), _FORMAT.program, ("speed", "tool")),
    ),
    read=(
        Reader(
            "tmscript",
            _READ,
            "TMscript files (.tms, .txt).",
            marks=(
                _FORMAT.mark(
                    r"\bJPP\b|^[ \t]*float\[\][ \t]+\w+[ \t]*=[ \t]*\{",
                    "its joints (JPP, float[]), as of TMscript",
                ),
            ),
        ),
    ),
)
