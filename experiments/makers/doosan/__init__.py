"""Doosan: DRL programs."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..line_marks import line_mark
from ..maker import Maker, PlanProgram, PointNames, ProgramFiles, Reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ..line_language import LineLanguage
    from ..options import ProgramMotion
    from ..recordings import Imported, ImportJob


def _drl_program(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .drl_language import drl_program

    return {file: drl_program(plan, motion)}


def _read_drl(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Doosan: the pendant's log of a plan's program, or joint positions (posj) of a DRL program."""
    from ..joint_text import import_program_log, is_program_log
    from ..taught_positions import import_taught
    from .drl_language import DRL

    if points is None and is_program_log(job):
        return import_program_log(job, source="DRL")
    note = "Doosan posj, degrees, joint 1 first"
    return import_taught(DRL, job, points=points, vendor="doosan", note=note)


def _drl() -> "LineLanguage":
    from .drl_language import DRL

    return DRL


MAKER = Maker(
    "Doosan",
    "doosan",
    r"doosan|[maeh]\d{4}s?",
    program=(PlanProgram("drl", "DRL (Doosan)", ("zb_plan.drl",), _drl_program, ("speed", "tool")),),
    read=(
        Reader(
            "drl",
            _read_drl,
            "Logs of a plan's program, or DRL files (.drl).",
            marks=(line_mark(r"\bposj[ \t]*\(", "its joint positions (posj), as of DRL", _drl),),
            program_log=True,
        ),
    ),
    correct=(ProgramFiles("DRL", ".drl (Doosan)", (".drl",), _drl),),
)
