"""Franka: joint lists in radians, out and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ..line_marks import line_mark
from ..maker import Maker, PlanProgram, PointNames, Reader

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ..line_language import LineLanguage
    from ..options import ProgramMotion
    from ..recordings import Imported, ImportJob


def _joint_list(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .joint_list import joint_list

    return {file: joint_list(plan, motion)}


def _read_joint_list(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them."""
    from ..taught_positions import import_taught
    from .joint_list import JOINT_LIST

    note = "Franka joints, radians, joint 1 first"
    return import_taught(JOINT_LIST, job, points=points, vendor="franka", note=note)


def _language() -> "LineLanguage":
    from .joint_list import JOINT_LIST

    return JOINT_LIST


MAKER = Maker(
    "Franka",
    "franka",
    r"panda|franka|fr3",
    program=(PlanProgram("franka", "joint list (Franka)", ("zb_plan.py",), _joint_list, ("speed",)),),
    read=(
        Reader(
            "franka",
            _read_joint_list,
            "Joint lists (.txt, .py).",
            marks=(
                line_mark(
                    r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]",
                    "its lists of seven numbers",
                    _language,
                ),
            ),
        ),
    ),
)
