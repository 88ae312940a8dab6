"""Doosan: DRL programs."""

from ..line_format import LineFormat, LineParts


def _parts() -> LineParts:
    from ...positions.position_languages import DRL
    from .drl_program import drl_program

    return LineParts(DRL, lambda plan, motion, file: drl_program(plan, motion))


_FORMAT = LineFormat(
    _parts,
    ("drl", "DRL (Doosan)", ("zb_plan.drl",), ("speed", "tool")),
    "Logs of a plan's program, or DRL files (.drl).",
    "Doosan: the pendant's log of a plan's program, or joint positions (posj) of a DRL program.",
    (r"\bposj[ \t]*\(", "its joint positions (posj), as of DRL"),
    log="DRL",
)
MAKER = _FORMAT.maker("Doosan", "doosan", r"doosan|[maeh]\d{4}s?")
