"""`zerobeam import`: taught points of a controller, and what the programs of a plan have recorded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from .importing import (
    Decimal,
    MarkerColumn,
    StillDeg,
    StillSeconds,
    Targets,
    as_names,
    read_of,
    require_stillness,
    stated,
    write_imported,
)
from .options import DryRun, Force, J3Origin, MeasuredPlan, NewRunFile, SharedHeader

_PointNames = Annotated[
    str | None,
    typer.Option(help="Points to use, by name: a,b,c (default: all).", show_default=False),
]


def import_rapid(
    files: Annotated[
        list[Path],
        typer.Argument(help="Log of a plan's program, or modules with targets (.mod).", show_default=False),
    ],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    points: _PointNames = None,
    tool: Annotated[
        str | None,
        typer.Option(
            help="Read robtargets too, of this tool as seen from the flange: X,Y,Z,Q1,Q2,Q3,Q4.",
            show_default=False,
        ),
    ] = None,
    frame: Annotated[
        str | None,
        typer.Option(help="Their work object, if not wobj0: X,Y,Z,Q1,Q2,Q3,Q4.", show_default=False),
    ] = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """ABB: what a plan's program has recorded, or taught jointtargets and robtargets."""
    from ..experiments import importers

    known, names = stated(header, plan), target or []
    if points is None and importers.is_program_log(files):
        imported = importers.import_program_log(files, names, known, file, source="RAPID")
    else:
        imported = importers.import_rapid(
            files, names, known, file, points=as_names(points), tool=tool, frame=frame
        )
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


def import_kuka(
    files: Annotated[list[Path], typer.Argument(help="Data lists (.dat).", show_default=False)],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    points: _PointNames = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """KUKA: axis positions (AXIS, E6AXIS) of a data list, taught or recorded by a plan's program."""
    from ..experiments import importers

    known, names = stated(header, plan), target or []
    imported = importers.import_kuka(files, names, known, file, points=as_names(points))
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


def import_fanuc(
    files: Annotated[
        list[Path],
        typer.Argument(help="TP programs (.ls) or position registers (posreg.va).", show_default=False),
    ],
    file: NewRunFile,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="What joint 3 is counted from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    points: _PointNames = None,
    register: Annotated[
        int, typer.Option(help="With --plan: the first position register of its program.", min=1)
    ] = 1,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """FANUC: positions in joint representation, taught or recorded by a plan's program."""
    from ..experiments import importers

    imported = importers.import_fanuc(
        files, target or [], stated(header, plan), file, j3=j3, points=as_names(points), register=register
    )
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


def import_universal_robots(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="Logs of a plan's program, or RTDE recordings (.csv).",
            show_default=False,
        ),
    ],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    delimiter: Annotated[
        str | None,
        typer.Option(help="Delimiter of a recording, if not the usual one.", show_default=False),
    ] = None,
    decimal: Decimal = ".",
    marker_column: MarkerColumn = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """Universal Robots: what a plan's program has recorded, or RTDE recordings, by where the arm dwells."""
    from ..experiments import importers

    known, names = stated(header, plan), target or []
    if still_deg is None and still_s is None:
        imported = importers.import_program_log(files, names, known, file, source="URScript")
    else:
        imported = importers.import_log(
            "ur",
            files,
            names,
            known,
            file,
            still=require_stillness(still_deg, still_s, None),
            delimiter=delimiter,
            decimal=decimal,
            marker_column=marker_column,
        )
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


def import_robodk(
    files: Annotated[list[Path], typer.Argument(help="Log of a plan's program.", show_default=False)],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="What joint 3 is counted from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """RoboDK: what a plan's program has recorded. Logs of MonitorJoints: import log robodk."""
    from ..experiments import importers

    known = stated(header, plan)
    imported = importers.import_program_log(files, target or [], known, file, source="RoboDK", j3=j3)
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


COMMANDS: dict[str, Callable[..., None]] = {
    "rapid": import_rapid,
    "universal-robots": import_universal_robots,
    "krl": import_kuka,
    "kuka": import_kuka,
    "fanuc": import_fanuc,
    "robodk": import_robodk,
}
