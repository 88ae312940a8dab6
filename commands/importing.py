"""`zerobeam import`: runs from recorded files that people have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..model.errors import BadInput
from .console import out, progress
from .options import DryRun, Force, J3Origin, MeasuredPlan, NewRunFile, SharedHeader

if TYPE_CHECKING:
    from ..experiments.importers import Imported, Stillness
    from ..model.files.plan import Plan

imports = typer.Typer(help="Make a run from recorded files that people have.", no_args_is_help=True)


AngleUnit = Literal["deg", "rad", "pulse"]
LengthUnit = Literal["mm", "m"]
ClockUnit = Literal["s", "ms", "us", "ns"]
KnownLog = Literal["ur", "egm", "robodk"]

Targets = Annotated[
    list[str] | None,
    typer.Option(
        help="Target of a file: once for each file, in their order, unless the files name them.",
        show_default=False,
    ),
]
StillDeg = Annotated[
    float | None, typer.Option(help="Dwell: each joint within so many degrees.", show_default=False)
]
StillSeconds = Annotated[
    float | None, typer.Option(help="Dwell: for at least so many seconds.", show_default=False)
]
StillMm = Annotated[
    float | None, typer.Option(help="Dwell: each prismatic joint within so many mm.", show_default=False)
]
Decimal = Annotated[str, typer.Option(help="Decimal sign: . or ,")]
MarkerColumn = Annotated[
    str | None,
    typer.Option(help="Only dwells in which this column becomes other than 0.", show_default=False),
]


@imports.command("csv")
def import_csv(
    files: Annotated[list[Path], typer.Argument(help="CSV files, one posture a row.", show_default=False)],
    units: Annotated[AngleUnit, typer.Option(help="Unit of the angles.", show_default=False)],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    target_column: Annotated[
        str | None, typer.Option(help="Column with each row's target, instead.", show_default=False)
    ] = None,
    lengths: Annotated[
        LengthUnit | None, typer.Option(help="Unit of prismatic joints.", show_default=False)
    ] = None,
    header_row: Annotated[
        bool, typer.Option("--header-row", help="The first row names the columns.")
    ] = False,
    columns: Annotated[
        str | None,
        typer.Option(
            help="Columns of joint 1, 2, …: a,b,c by name (with --header-row) or number, from 1; or"
            " A1=j1,A2=j2,… in any order.",
            show_default=False,
        ),
    ] = None,
    delimiter: Annotated[
        str | None,
        typer.Option(help="Delimiter between two values; found if not stated.", show_default=False),
    ] = None,
    decimal: Decimal = ".",
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="What joint 3 is counted from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    spot_columns: Annotated[
        str | None, typer.Option(help="Columns of spot_mm: dx,dy in mm.", show_default=False)
    ] = None,
    shot_column: Annotated[
        str | None, typer.Option(help="Column of the measurement numbers.", show_default=False)
    ] = None,
    time_column: Annotated[str | None, typer.Option(help="Column of times.", show_default=False)] = None,
    time_units: Annotated[
        ClockUnit | None, typer.Option(help="Unit of the times.", show_default=False)
    ] = None,
    still_deg: Annotated[
        float | None,
        typer.Option(
            help="A measurement is where the arm dwells: each joint within so many degrees, …",
            show_default=False,
        ),
    ] = None,
    still_s: Annotated[
        float | None, typer.Option(help="… for at least so many seconds.", show_default=False)
    ] = None,
    still_mm: StillMm = None,
    marker_column: MarkerColumn = None,
    small_angles: Annotated[
        bool,
        typer.Option(
            "--small-angles",
            help="The angles are in degrees, although all are as small as radians would be.",
        ),
    ] = False,
    reversed_joints: Annotated[
        str | None,
        typer.Option(
            "--reversed", help="Joints recorded with the other sign: j2,j5,… or names.", show_default=False
        ),
    ] = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from ..experiments import importers

    still = stillness(still_deg, still_s, still_mm)
    layout = importers.CsvLayout(
        units,
        header_row,
        as_names(columns),
        delimiter,
        lengths,
        decimal,
        target_column,
        shot_column,
        as_names(spot_columns),
        time_column,
        time_units,
        marker_column,
        j3,
        small_angles=small_angles,
        reversed_joints=as_names(reversed_joints) or (),
    )
    with progress("import") as tell:
        imported = importers.import_csv(
            files, target or [], layout, stated(header, plan), file, still=still, progress=tell
        )
        _write(imported, file, force, dry_run, read_of(header, plan, files), tell)
    _tell(imported, file, dry_run)


@imports.command("ros")
def import_ros(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="ROS 1 or 2 bags (.bag, .mcap, .db3 or folder), or joint states in text (.yaml).",
            show_default=False,
        ),
    ],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    still_mm: StillMm = None,
    target: Targets = None,
    columns: Annotated[
        str | None,
        typer.Option(
            help="Names of joint 1, 2, … in the messages: a,b,c (default: the robot's own).",
            show_default=False,
        ),
    ] = None,
    topic: Annotated[
        str | None, typer.Option(help="Topic of the arm, if there are several.", show_default=False)
    ] = None,
    marker_topic: Annotated[
        str | None,
        typer.Option(
            help="Only dwells at a message on this topic; a std_msgs/String names the target.",
            show_default=False,
        ),
    ] = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """Joint states: in ROS bags a measurement is where the arm dwells (at a marker, if stated).

    In the text of ros2 topic echo each message is one.
    """
    from ..experiments import importers

    named, known = as_names(columns), stated(header, plan)
    if all(name.suffix.lower() in (".yaml", ".yml", ".txt") for name in files):
        _refuse_for_text(still_deg, still_s, still_mm, topic, marker_topic)
        imported = importers.import_joint_states(files, target or [], known, file, columns=named)
    else:
        imported = importers.import_ros(
            files,
            target or [],
            known,
            file,
            still=require_stillness(still_deg, still_s, still_mm),
            columns=named,
            topic=topic,
            marker_topic=marker_topic,
        )
    write_imported(imported, file, force, dry_run, read_of(header, plan, files))


def _refuse_for_text(*options: object) -> None:
    if any(option is not None for option in options):
        raise BadInput(
            "joint states in text have no times: each message is a measurement",
            remedy="leave out --still-deg, --still-s, --still-mm, --topic and --marker-topic",
        )


@imports.command("log")
def import_log(
    kind: Annotated[
        KnownLog,
        typer.Argument(
            help="ur: RTDE recording; egm: ABB EGM log of abb_libegm; robodk: MonitorJoints.",
            show_default=False,
        ),
    ],
    files: Annotated[list[Path], typer.Argument(help="Logs as CSV files.", show_default=False)],
    file: NewRunFile,
    header: SharedHeader = None,
    plan: MeasuredPlan = None,
    target: Targets = None,
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    still_mm: StillMm = None,
    delimiter: Annotated[
        str | None,
        typer.Option(help="Delimiter between two values, if not the usual one.", show_default=False),
    ] = None,
    decimal: Decimal = ".",
    marker_column: MarkerColumn = None,
    j3: Annotated[
        J3Origin | None,
        typer.Option(
            help="What joint 3 is counted from, if not as the robot file states.", show_default=False
        ),
    ] = None,
    force: Force = False,
    dry_run: DryRun = False,
) -> None:
    """Logs over time of a known layout: a measurement is where the arm dwells. Other logs: import csv."""
    from ..experiments import importers

    with progress("import") as tell:
        imported = importers.import_log(
            kind,
            files,
            target or [],
            stated(header, plan),
            file,
            still=require_stillness(still_deg, still_s, still_mm),
            delimiter=delimiter,
            decimal=decimal,
            marker_column=marker_column,
            j3=j3,
            progress=tell,
        )
        _write(imported, file, force, dry_run, read_of(header, plan, files), tell)
    _tell(imported, file, dry_run)


def stated(header: Path | None, plan: Path | None) -> Path | Plan:
    """The header file, or the plan that was measured; BadInput unless one of the two is stated."""
    from ..model.files.plan import read_plan

    if plan is not None and header is None:
        return read_plan(plan)
    if header is not None and plan is None:
        return header
    raise BadInput(
        "both --header and --plan are stated" if header else "neither --header nor --plan is stated",
        allowed="--plan PLAN for the measurements of a plan; else --header HEADER and --target NAME",
    )


def stillness(deg: float | None, seconds: float | None, mm: float | None) -> Stillness | None:
    """What counts as a dwell, if it is stated."""
    from ..experiments.importers import Stillness

    if deg is not None and seconds is not None:
        return Stillness(deg, seconds, mm)
    if deg is None and seconds is None and mm is None:
        return None
    raise BadInput(
        "a dwell needs a tolerance and a time", remedy="state both --still-deg and --still-s, or neither"
    )


def require_stillness(deg: float | None, seconds: float | None, mm: float | None) -> Stillness:
    """What counts as a dwell; BadInput where it is not stated."""
    found = stillness(deg, seconds, mm)
    if found is None:
        raise BadInput(
            "a recording over time needs to know what a dwell is",
            remedy="state --still-deg and --still-s",
        )
    return found


def as_names(text: str | None) -> list[str] | None:
    """Names that are separated by commas."""
    return None if text is None else [name.strip() for name in text.split(",")]


def read_of(header: Path | None, plan: Path | None, files: list[Path]) -> list[Path]:
    """The files that an import reads: it never writes over them."""
    from ..experiments.importers import matching

    stated = [path for path in (header, plan) if path is not None]
    return [*stated, *(path for file in files for path in matching(file))]


def write_imported(imported: Imported, file: Path, force: bool, dry_run: bool, read: list[Path]) -> None:
    """Write the run, and say how the files were understood."""
    _write(imported, file, force, dry_run, read, lambda stage, share: None)
    _tell(imported, file, dry_run)


def _write(
    imported: Imported,
    file: Path,
    force: bool,
    dry_run: bool,
    read: list[Path],
    tell: Callable[[str, float], None],
) -> None:
    """Write the run; with `force` over another file, but none of those that were `read`. A dry run refuses
    the same and writes nothing."""
    from ..model.files.robot_file import robot_path
    from ..model.files.run import write_run
    from ..model.files.whole_file import refuse_existing

    refuse_existing(file, force=force, keep=[*read, robot_path(imported.header.robot, file.parent)])

    if dry_run:
        return
    tell("writing", 0.7)
    write_run(file, imported.header, imported.shots, force=force)
    tell("writing", 1.0)


def _tell(imported: Imported, file: Path, dry_run: bool) -> None:
    for line in imported.understood:
        out.print(line, soft_wrap=True, markup=False)
    done = "dry run: nothing was written to" if dry_run else f"{len(imported.shots)} measurements written to"
    out.print(f"{done} {file}", soft_wrap=True, markup=False)


@imports.command("ur-calibration")
def import_ur_calibration(
    calibration: Annotated[
        Path,
        typer.Argument(
            help="calibration.conf of the controller, or the YAML of ROS's ur_calibration.",
            show_default=False,
        ),
    ],
    robot: Annotated[
        str, typer.Option(help="The nominal arm: ur3e, ur5e, ur10e, ur16e, ur20.", show_default=False)
    ],
    file: Annotated[
        Path, typer.Option("-o", "--out", help="Robot file to write (.yaml).", show_default=False)
    ],
) -> None:
    """A robot file of an individual UR arm: nominal rows and its factory calibration."""
    from ..experiments.exporters.calibrated_ur import calibrated_text
    from ..experiments.importers.ur_calibration import read_ur_calibration
    from ..model.files.whole_file import refuse_existing, write_whole

    refuse_existing(file)
    arm = read_ur_calibration(calibration, robot)
    write_whole(file, calibrated_text(arm, calibration))
    rms, most = arm.apart_mm
    out.print(
        f"The flange is {rms:.2f} mm (rms, up to {most:.2f} mm) from that of the nominal {robot}.",
        soft_wrap=True,
    )
    out.print(f"Robot file: {file}", soft_wrap=True, markup=False)
