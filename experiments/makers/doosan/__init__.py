"""Doosan: DRL programs."""

from ..line_format import LineFormat, LineParts
from ..program_template import ProgramTemplate


def _parts() -> LineParts:
    from ...positions.position_languages import DRL

    return LineParts(DRL, _PROGRAM)


_PROGRAM = ProgramTemplate("doosan", "a DRL program", "posj", quote=lambda text: text.replace('"', ""))
_FORMAT = LineFormat(
    _parts,
    ("drl", "DRL (Doosan)", ("zb_plan.drl",), ("speed", "tool")),
    "Logs of a plan's program, or DRL files (.drl).",
    "Doosan: the pendant's log of a plan's program, or joint positions (posj) of a DRL program.",
    (r"\bposj[ \t]*\(", "its joint positions (posj), as of DRL"),
    log="DRL",
)
MAKER = _FORMAT.maker("Doosan", "doosan", r"doosan|[maeh]\d{4}s?")
