"""Programs of a plan by kind, and their files, of which none exists before."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal, get_args

from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.files.robot_file import Vendor
from ....model.files.whole_file import refuse_existing, write_whole
from ....model.kinematics.pendant import Pendant
from ...plans.constraints import require_constraints
from ..vendors import require_vendor
from .fanuc_program import fanuc_program
from .krl_program import krl_program
from .posture_table import csv_table
from .rapid_program import rapid_program
from .robodk_program import robodk_program
from .steps import Motion
from .trajectory import ros_trajectories
from .urscript_program import urscript_program

ProgramKind = Literal["rapid", "urscript", "krl", "fanuc", "robodk", "ros", "csv"]

_TEXTS: Mapping[ProgramKind, Callable[[Plan, Motion, str], str]] = {
    "rapid": rapid_program,
    "urscript": urscript_program,
    "fanuc": fanuc_program,
    "robodk": robodk_program,
    "ros": ros_trajectories,
    "csv": csv_table,
}
_VENDORS: Mapping[ProgramKind, Vendor] = {
    "rapid": "abb",
    "urscript": "universal-robots",
    "krl": "kuka",
    "fanuc": "fanuc",
}


def program_texts(kind: ProgramKind, plan: Plan, motion: Motion, file: Path) -> dict[Path, str]:
    """The files of a program and their texts: one, but two for KRL.

    BadInput for a robot of another vendor, joints that the language cannot hold, options that it has no place
    for, and a name that the controller does not allow.
    """
    if kind not in get_args(ProgramKind):
        raise BadInput("unknown kind of program", found=kind, allowed=", ".join(get_args(ProgramKind)))
    if kind == "krl":
        if file.suffix.lower() != ".src":
            raise BadInput("a KRL program is a .src and a .dat", found=file.name, allowed="-o NAME.src")
        source, data = krl_program(plan, motion, file.stem)
        return {file: source, file.with_suffix(".dat"): data}
    return {file: _TEXTS[kind](plan, motion, file.stem)}


def write_program(
    kind: ProgramKind,
    plan: Plan,
    motion: Motion,
    file: Path,
    *,
    force: bool = False,
    keep: Sequence[Path | None] = (),
) -> tuple[list[Path], list[str]]:
    """Write a plan as a program; the files, and sentences that a person must see.

    With `force` other files are replaced, but none of those to `keep`. BadInput for a plan that breaks its
    constraints.
    """
    require_constraints(plan)
    texts = program_texts(kind, plan, motion, file)
    for path in texts:
        refuse_existing(path, force=force, keep=keep)
    for path, text in texts.items():
        write_whole(path, text, force=force)
    vendor = _VENDORS.get(kind)
    note = None if vendor is None else require_vendor(plan.robot, vendor, f"a program in {kind}")
    return list(texts), [*plan.warnings, *([] if note is None else [note]), *_counting(kind, plan, motion)]


def _counting(kind: ProgramKind, plan: Plan, motion: Motion) -> list[str]:
    """A sentence on how joints are counted in the file, where a reader could take them for something else."""
    if kind == "ros":
        ground = plan.robot.conventions.joint3 == "ground"
        return ["joint 3 is counted from link 2, as URDF and the drivers of ROS do"] if ground else []
    pendant = Pendant(plan.robot, motion.j3)
    sentence = pendant.sentence if kind == "csv" else pendant.counting
    return [] if sentence is None else [sentence]
