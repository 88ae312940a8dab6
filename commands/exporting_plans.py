"""`zerobeam export plan`: a plan as a program for a controller, a table, or a sheet for a person."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from .console import out
from .options import Force, J3Origin, PlanFile

if TYPE_CHECKING:
    from ..model.files.plan import Plan

Kind = Literal["rapid", "urscript", "krl", "fanuc", "robodk", "ros", "csv", "pdf"]


def export_plan(
    kind: Annotated[
        Kind,
        typer.Argument(
            help="rapid (ABB), urscript (Universal Robots), krl (KUKA), fanuc, robodk (Python), ros"
            " (JointTrajectory), csv; pdf: a sheet for the person at the robot.",
            show_default=False,
        ),
    ],
    plan: PlanFile,
    file: Annotated[
        Path, typer.Option("-o", "--out", help="File to write; krl writes a .dat too.", show_default=False)
    ],
    speed: Annotated[float, typer.Option(help="Speed of the fastest joint, degrees a second.")] = 10.0,
    zone: Annotated[
        float,
        typer.Option(
            help="Rounding of intermediate postures: mm (rapid, urscript, robodk), percent (krl, fanuc)."
        ),
    ] = 0.0,
    tool: Annotated[
        str | None,
        typer.Option(
            help="Tool of the controller: a name (rapid), a number (krl, fanuc).", show_default=False
        ),
    ] = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="fanuc, robodk, csv, pdf: what the pendant counts joint 3 from, if not as the robot file"
            " states.",
            show_default=False,
        ),
    ] = None,
    register: Annotated[
        int | None,
        typer.Option(help="fanuc: first position register for the joints (1).", show_default=False),
    ] = None,
    listener: Annotated[
        str | None,
        typer.Option(help="urscript: HOST:PORT that the joints are sent to as well.", show_default=False),
    ] = None,
    force: Force = False,
) -> None:
    """A plan as a program that goes to each posture, waits until the beam is centred, records the joints.

    zerobeam import reads what it recorded. The command refuses a robot of another vendor.
    """
    from ..experiments.exporters.programs.steps import Motion
    from ..experiments.exporters.programs.written import write_program
    from ..model.files.plan import read_plan
    from ..model.files.robot_file import robot_path

    motion, planned = Motion(speed, zone, tool, j3, register, listener), read_plan(plan)
    read = [plan, robot_path(planned.header.robot, plan.parent)]
    if kind == "pdf":
        motion.refuse("pdf", "speed", "zone", "tool", "register", "listener")
        _write_sheet(planned, file, j3, force, read)
        return
    files, notes = write_program(kind, planned, motion, file, force=force, keep=read)
    for note in notes:
        out.print(f"note: {note}", markup=False, soft_wrap=True)
    for path in files:
        out.print(f"Written to {path}", markup=False, soft_wrap=True)


def _write_sheet(
    planned: Plan, file: Path, j3: J3Origin | None, force: bool, read: list[Path | None]
) -> None:
    """The operator's sheet of a plan."""
    from ..analysis.observability.aim import aim_plan
    from ..experiments.plans.constraints import check_plan, require_constraints
    from ..model.files.whole_file import refuse_existing, write_whole
    from ..reports.plan.operator_sheet import operator_sheet

    refuse_existing(file, force=force, keep=read)
    require_constraints(planned)
    turned = aim_plan(planned)
    write_whole(file, operator_sheet(turned, check_plan(planned, turned), j3), force=force)
    out.print(f"Written to {file}", markup=False, soft_wrap=True)
