"""`zerobeam export program`: a whole program for the arm whose offsets a run determines."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .console import EXIT_STATUS, out, print_json
from .exporting import AllowDisplaced, AllowWeak, ExportFile, Unvalidated, Without
from .options import Force, J3Origin, Json, RunFile


def export_program(
    run: RunFile,
    program: Annotated[
        Path,
        typer.Argument(
            help="Program: .mod (RAPID), .src or .dat (KRL, both together), .ls (FANUC), .script (URScript).",
            show_default=False,
        ),
    ],
    file: ExportFile,
    tool: Annotated[
        list[str] | None,
        typer.Option(
            help="Pose of a tool that the program does not state, [NAME=]X,Y,Z,… in the language's own form."
            " Repeatable.",
            metavar="POSE",
            show_default=False,
        ),
    ] = None,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            help="The same of a work object, base or user frame. Repeatable.",
            metavar="POSE",
            show_default=False,
        ),
    ] = None,
    near: Annotated[
        str | None,
        typer.Option(
            help="Joints J1,J2,… in degrees near which Cartesian targets without a configuration are.",
            show_default=False,
        ),
    ] = None,
    leave: Annotated[
        list[str] | None,
        typer.Option(
            help="Leave this target as it is (taught on this very arm). Repeatable.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(help="fanuc: what joint 3 is counted from; on the pendant: ground.", show_default=False),
    ] = None,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    unvalidated: Unvalidated = False,
    without: Without = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """A whole program with corrected targets, for the arm to reach what it means; all else stays as it was.

    A program with motions that are not understood is refused, by line. Targets that were taught on this very
    arm hold its offsets already: do not correct them.
    """
    from ..experiments.exporters.calibration import calibration
    from ..experiments.exporters.offsets_data import document
    from ..experiments.exporters.user_programs.filtered import Choices, files_of, filtered, language_of
    from ..model.files.robot_file import robot_path
    from ..model.files.run import read_run
    from ..model.files.whole_file import refuse_existing, write_whole

    language_of(program)
    recorded = read_run(run)
    read = [run, *files_of(program), robot_path(recorded.header.robot, run.parent)]
    refuse_existing(file, force=force, keep=read)
    judged = calibration(
        recorded,
        allow_weak=allow_weak,
        allow_displaced=allow_displaced,
        unvalidated=unvalidated,
        without=without or (),
        holds="links",
    )
    choices = Choices(tool or (), frame or (), leave or (), near, j3)
    done = filtered(recorded.robot, judged, program, file, choices)
    for path in done.files:
        refuse_existing(path, force=force, keep=read)
    for path, content in done.files.items():
        write_whole(path, content, force=force)
    if as_json:
        print_json(document(judged))
    else:
        for line in [*judged.head, *done.said]:
            out.print(line, markup=False, soft_wrap=True)
        for path in done.files:
            out.print(f"Written to {path}", markup=False, soft_wrap=True)
    if judged.misfit:
        raise typer.Exit(EXIT_STATUS["misfit"])
