"""`zerobeam export`: the offsets of a run in the form in which they are applied."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .console import EXIT_STATUS, out, print_json
from .options import Force, J3Origin, Json, RunFile

if TYPE_CHECKING:
    from ..experiments.exporters.calibration import Calibration
    from ..experiments.exporters.corrected import Holds
    from ..model.files.run import Run

exports = typer.Typer(
    help="Write what a run determines in the form in which it is applied: only what is identifiable.",
    no_args_is_help=True,
)

ExportFile = Annotated[Path, typer.Option("-o", "--out", help="File to write.", show_default=False)]
AllowWeak = Annotated[
    bool, typer.Option("--allow-weak", help="Export weakly observable offsets too; the file marks them.")
]
AllowDisplaced = Annotated[
    bool,
    typer.Option("--allow-displaced", help="Export although a target seems to have moved; the file says so."),
]
Unvalidated = Annotated[
    bool,
    typer.Option(
        "--unvalidated",
        help="Export in spite of a misfit (the model does not describe the run); the file says so.",
    ),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        help="Exclude this parameter (delta4, link2.a): it counts as 0. Repeatable.",
        metavar="NAME",
        show_default=False,
    ),
]


Text = Callable[["Run", "Calibration"], str]
Made = tuple[Mapping[Path, str | bytes], Sequence[str]]  # the files, and what is said of them


@dataclass(frozen=True)
class Allowed:
    """What is exported although something speaks against it; `as_data`: the file states every status. `holds`
    is what the kind of file has room for."""

    weak: bool
    displaced: bool
    unvalidated: bool
    as_data: bool = False
    holds: Holds = "offsets"


def _format(name: str, *, as_data: bool = False, holds: Holds = "offsets") -> Callable[[Text], Text]:
    """Make a command, which its docstring describes, of a function that needs nothing else to be stated."""

    def command(text: Text) -> Text:
        def export(
            run: RunFile,
            file: ExportFile,
            allow_weak: AllowWeak = False,
            allow_displaced: AllowDisplaced = False,
            unvalidated: Unvalidated = False,
            without: Without = None,
            force: Force = False,
            as_json: Json = False,
        ) -> None:
            allowed = Allowed(allow_weak, allow_displaced, unvalidated, as_data, holds)
            _export(run, file, allowed, without, force, as_json, text)

        exports.command(name, help=text.__doc__)(export)
        return text

    return command


@_format("robot", holds="links")
def export_robot(recorded: Run, calibration: Calibration) -> str:
    """A corrected robot file: offsets, link lengths and angles in its Denavit-Hartenberg rows."""
    from ..experiments.exporters.robot_rows import robot_text

    return robot_text(recorded, calibration)


@_format("urdf", holds="links")
def export_urdf(recorded: Run, calibration: Calibration) -> str:
    """A corrected URDF: offsets, link lengths and angles in the origins of its joints."""
    from ..experiments.exporters.urdf_origins import urdf_text

    return urdf_text(recorded, calibration)


@exports.command("moc")
def export_moc(
    run: RunFile,
    file: ExportFile,
    against: Annotated[
        Path | None,
        typer.Option(help="The controller's MOC.cfg: write a diff against it.", show_default=False),
    ] = None,
    motor_sign: Annotated[
        str | None,
        typer.Option(
            help="1 if a reading rises with cal_offset (at a positive ratio), -1 if it falls; one, or one a"
            " joint: 1,-1,…",
            show_default=False,
        ),
    ] = None,
    ratio: Annotated[
        str | None,
        typer.Option(
            help="Motor turns for one turn of each joint: R1,R2,…, negative if in opposite directions.",
            show_default=False,
        ),
    ] = None,
    unit: Annotated[str, typer.Option(help="Mechanical unit: its motors are UNIT_1, UNIT_2, …")] = "rob1",
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    unvalidated: Unvalidated = False,
    without: Without = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """ABB: changes of the motors' calibration offsets, as a diff to look at. Nothing is applied."""
    from ..experiments.exporters.moc_offsets import Gears, moc_text

    def text(recorded: Run, calibration: Calibration) -> str:
        gears = Gears.stated(ratio, motor_sign, recorded.robot.n)
        return moc_text(calibration, gears, against, unit)

    allowed = Allowed(allow_weak, allow_displaced, unvalidated)
    _export(run, file, allowed, without, force, as_json, text, against)


@_format("rapid")
def export_rapid(_: Run, calibration: Calibration) -> str:
    """ABB: a RAPID module with functions that correct a jointtarget by the offsets."""
    from ..experiments.exporters.rapid_module import rapid_text

    return rapid_text(calibration)


@_format("ur")
def export_ur(recorded: Run, calibration: Calibration) -> str:
    """Universal Robots: a sheet for a person, how to set the zero of each joint. Nothing is applied."""
    from ..experiments.exporters.controller_sheets import ur_text

    return ur_text(recorded.robot, calibration)


@exports.command("ur-calibration")
def export_ur_calibration(
    run: RunFile,
    file: ExportFile,
    against: Annotated[
        Path | None,
        typer.Option(
            help="The arm's present calibration.yaml: its hash is kept, which ROS compares with the robot's.",
            show_default=False,
        ),
    ] = None,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    unvalidated: Unvalidated = False,
    without: Without = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Universal Robots: a corrected calibration.yaml for ROS, of offsets, link lengths and angles."""
    from ..experiments.exporters.ur_kinematics import ur_calibration_text

    def text(recorded: Run, calibration: Calibration) -> str:
        return ur_calibration_text(recorded, calibration, against)

    allowed = Allowed(allow_weak, allow_displaced, unvalidated, holds="links")
    _export(run, file, allowed, without, force, as_json, text, against)


@_format("kuka")
def export_kuka(recorded: Run, calibration: Calibration) -> str:
    """KUKA: a sheet for a person, the mastering offsets of the axes. Nothing is applied."""
    from ..experiments.exporters.controller_sheets import kuka_text

    return kuka_text(recorded.robot, calibration)


@exports.command("fanuc")
def export_fanuc(
    run: RunFile,
    file: ExportFile,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="What the pendant counts joint 3 from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    master_counts: Annotated[
        str | None, typer.Option(help="Present master counts: C1,C2,…", show_default=False)
    ] = None,
    pulses_per_degree: Annotated[
        str | None,
        typer.Option(help="$ENCSCALES of each joint: P1,P2,…, negative if they fall.", show_default=False),
    ] = None,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    unvalidated: Unvalidated = False,
    without: Without = None,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """FANUC: a sheet for a person, the new master counts. Nothing is applied."""
    from ..experiments.exporters.controller_sheets import FanucCounts, fanuc_text

    def text(recorded: Run, calibration: Calibration) -> str:
        counts = FanucCounts.stated(master_counts, pulses_per_degree, recorded.robot.n)
        return fanuc_text(recorded.robot, calibration, counts, j3)

    allowed = Allowed(allow_weak, allow_displaced, unvalidated)
    _export(run, file, allowed, without, force, as_json, text)


@_format("json", as_data=True, holds="all")
def export_json(_: Run, calibration: Calibration) -> str:
    """All parameters with uncertainty and covariance as JSON, for programs."""
    from ..experiments.exporters.offsets_data import json_text

    return json_text(calibration)


@_format("csv", as_data=True)
def export_csv(_: Run, calibration: Calibration) -> str:
    """The offsets with their uncertainty as a table, for spreadsheets."""
    from ..experiments.exporters.offsets_data import csv_text

    return csv_text(calibration)


def _export(
    run: Path,
    file: Path,
    allowed: Allowed,
    without: list[str] | None,
    force: bool,
    as_json: bool,
    text: Text,
    against: Path | None = None,
) -> None:
    """One file of the text that is made of a run and its calibration."""

    def made(recorded: Run, judged: Calibration) -> Made:
        return {file: text(recorded, judged)}, ()

    export_made(run, file, allowed, without, force, as_json, made, [against])


def export_made(
    run: Path,
    file: Path,
    allowed: Allowed,
    without: list[str] | None,
    force: bool,
    as_json: bool,
    made: Callable[[Run, Calibration], Made],
    read: Sequence[Path | None],
) -> None:
    """Judge a run, write what may be applied, say what was written; never over a file that is `read`."""
    from ..experiments.exporters.calibration import calibration
    from ..experiments.exporters.offsets_data import document
    from ..model.files.robot_file import robot_path
    from ..model.files.run import read_run
    from ..model.files.whole_file import refuse_existing, write_whole

    refuse_existing(file, force=force, keep=[run, *read])
    recorded = read_run(run)
    keep = [run, *read, robot_path(recorded.header.robot, run.parent)]
    refuse_existing(file, force=force, keep=keep)
    judged = calibration(
        recorded,
        allow_weak=allowed.weak,
        allow_displaced=allowed.displaced,
        unvalidated=allowed.unvalidated,
        as_data=allowed.as_data,
        without=without or (),
        holds=allowed.holds,
    )
    files, said = made(recorded, judged)
    for path in files:
        refuse_existing(path, force=force, keep=keep)
    for path, content in files.items():
        write_whole(path, content, force=force)
    if as_json:
        print_json(document(judged))
    else:
        for line in [*judged.head, *said, *(f"Written to {path}" for path in files)]:
            out.print(line, markup=False, soft_wrap=True)
    if judged.misfit:
        raise typer.Exit(EXIT_STATUS["misfit"])
