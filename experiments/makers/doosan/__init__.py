"""Doosan: DRL programs."""

from ..line_format import LineFormat, LineParts
from ..maker import Maker, PlanProgram, Reader


def _parts() -> LineParts:
    from ...positions.position_languages import DRL
    from .drl_program import drl_program

    return LineParts(DRL, lambda plan, motion, file: drl_program(plan, motion))


_FORMAT = LineFormat(_parts)
_READ = _FORMAT.reader(
    "Doosan: the pendant's log of a plan's program, or joint positions (posj) of a DRL program.",
    log="DRL",
)
MAKER = Maker(
    "Doosan",
    "doosan",
    r"doosan|[maeh]\d{4}s?",
    program=(PlanProgram("drl", "DRL (Doosan)", ("zb_plan.drl",), _FORMAT.program, ("speed", "tool")),),
    read=(
        Reader(
            "drl",
            _READ,
            "Logs of a plan's program, or DRL files (.drl).",
            marks=(_FORMAT.mark(r"\bposj[ \t]*\(", "its joint positions (posj), as of DRL"),),
            program_log=True,
        ),
    ),
)
