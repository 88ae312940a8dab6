"""`zerobeam export program`: a whole program for the arm whose offsets a run determines."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .exporting import AllowDisplaced, Allowed, AllowWeak, ExportFile, Made, Unvalidated, Without, export_made
from .options import Force, J3Origin, Json, RunFile

if TYPE_CHECKING:
    from ..experiments.exporters.calibration import Calibration
    from ..model.files.run import Run


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
    call: Annotated[
        list[str] | None,
        typer.Option(
            help="This routine of another file moves no arm, changes no frame, tool or target. Repeatable.",
            metavar="NAME",
            show_default=False,
        ),
    ] = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="fanuc: what joint 3 is counted from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    unvalidated: Unvalidated = False,
    without: Without = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Entering the offsets at the controller corrects all programs at once; this corrects one program, for
    controllers where that is not possible.

    The targets change, for the arm to reach what the program means; all else stays as it was. A program with
    a statement that is not understood is refused, by line. Targets that were taught on this very arm hold its
    offsets already: do not correct them.
    """
    from ..experiments.exporters.user_programs.filtered import Choices, files_of, filtered, language_of

    language_of(program)
    choices = Choices(tool or (), frame or (), leave or (), near, j3, call or ())

    def made(recorded: Run, judged: Calibration) -> Made:
        done = filtered(recorded.robot, judged, program, file, choices)
        return done.files, done.said

    allowed = Allowed(allow_weak, allow_displaced, unvalidated, holds="links")
    export_made(run, file, allowed, without, force, as_json, made, files_of(program))
