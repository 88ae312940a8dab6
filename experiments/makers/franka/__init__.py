"""Franka: joint lists in radians, out and back."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..maker import FormatMark, Maker, PlanProgram, PointNames, Reader, names_of

if TYPE_CHECKING:
    from ....model.files.plan import Plan
    from ..plan_programs import ProgramMotion
    from ..recordings import Imported, ImportJob, TaughtPoint


def _joint_list(plan: "Plan", motion: "ProgramMotion", file: Path) -> Mapping[Path, str]:
    from .joint_list import joint_list

    return {file: joint_list(plan, motion)}


def _read_joint_list(job: "ImportJob", points: PointNames = None) -> "Imported":
    """Franka: joints in radians, a line each (zb_m0 = [...]), as a program of libfranka recorded them."""
    from ..taught_positions import import_taught
    from .joint_list import JOINT_LIST

    note = "Franka joints, radians, joint 1 first"
    return import_taught(JOINT_LIST, job, points=names_of(points), vendor="franka", note=note)


def _points(text: str, path: Path) -> "Sequence[TaughtPoint]":
    from ..taught_positions import written_points
    from .joint_list import JOINT_LIST

    return written_points(JOINT_LIST, text, path)


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
                FormatMark(
                    r"^[ \t]*\w+[ \t]*=[ \t]*\[(?:[^,\]\n]+,){6}[^,\]\n]+\]",
                    "its lists of seven numbers",
                    _points,
                ),
            ),
        ),
    ),
)
