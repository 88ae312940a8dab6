"""`zerobeam import`: runs from recorded files that people have."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..model.errors import BadInput
from .console import out, progress
from .options import Force, HeaderFile, NewRunFile

if TYPE_CHECKING:
    from ..experiments.importers import Imported

imports = typer.Typer(help="Make a run from recorded files that people have.", no_args_is_help=True)


AngleUnit = Literal["deg", "rad"]
LengthUnit = Literal["mm", "m"]
ClockUnit = Literal["s", "ms", "us", "ns"]
J3Origin = Literal["ground", "link"]
KnownLog = Literal["ur", "egm", "robodk"]

_TargetEach = Annotated[
    list[str],
    typer.Option(help="Target of a file: once for each file, in their order.", show_default=False),
]
_Targets = Annotated[
    list[str] | None,
    typer.Option(
        help="Target of a file: once for each file, in their order, unless the files name them.",
        show_default=False,
    ),
]
_StillDeg = Annotated[
    float, typer.Option(help="Dwell: each joint within so many degrees.", show_default=False)
]
_StillSeconds = Annotated[
    float, typer.Option(help="Dwell: for at least so many seconds.", show_default=False)
]
_StillMm = Annotated[
    float | None, typer.Option(help="Dwell: each prismatic joint within so many mm.", show_default=False)
]
_MarkerColumn = Annotated[
    str | None,
    typer.Option(help="Only dwells in which this column becomes other than 0.", show_default=False),
]
_PointNames = Annotated[
    str | None,
    typer.Option(help="Points to use, by name: a,b,c (default: all).", show_default=False),
]


@imports.command("csv")
def import_csv(
    files: Annotated[list[Path], typer.Argument(help="CSV files, one posture a row.", show_default=False)],
    header: HeaderFile,
    units: Annotated[AngleUnit, typer.Option(help="Unit of the angles.", show_default=False)],
    file: NewRunFile,
    target: _Targets = None,
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
            help="Columns of joint 1, 2, …: a,b,c by name (with --header-row) or number, from 1.",
            show_default=False,
        ),
    ] = None,
    delimiter: Annotated[str, typer.Option(help="Delimiter between two values.")] = ",",
    decimal: Annotated[str, typer.Option(help="Decimal sign: . or ,")] = ".",
    j3: Annotated[J3Origin, typer.Option(help="Joint 3 is counted from; FANUC: ground.")] = "link",
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
    still_mm: _StillMm = None,
    marker_column: _MarkerColumn = None,
    small_angles: Annotated[
        bool,
        typer.Option(
            "--small-angles",
            help="The angles are degrees indeed, although all are as small as radians would be.",
        ),
    ] = False,
    force: Force = False,
) -> None:
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from ..experiments import importers

    if (still_deg is None) != (still_s is None) or (still_mm is not None and still_deg is None):
        raise BadInput(
            "a dwell needs a tolerance and a time", remedy="state both --still-deg and --still-s, or neither"
        )
    still = None
    if still_deg is not None and still_s is not None:
        still = importers.Stillness(still_deg, still_s, still_mm)
    layout = importers.CsvLayout(
        units,
        header_row,
        _named(columns),
        delimiter,
        lengths,
        decimal,
        target_column,
        shot_column,
        _named(spot_columns),
        time_column,
        time_units,
        marker_column,
        j3,
        small_angles=small_angles,
    )
    with progress("import") as tell:
        imported = importers.import_csv(files, target or [], layout, header, file, still=still, progress=tell)
        _write(imported, file, force, [header, *files], tell)
    _tell(imported, file)


@imports.command("ros")
def import_ros(
    files: Annotated[
        list[Path], typer.Argument(help="ROS 1 or 2 bags: .bag, .mcap, .db3 or folder.", show_default=False)
    ],
    header: HeaderFile,
    file: NewRunFile,
    still_deg: _StillDeg,
    still_s: _StillSeconds,
    still_mm: _StillMm = None,
    target: _Targets = None,
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
) -> None:
    """Joint states in ROS bags: a measurement is where the arm dwells (at a marker, if stated)."""
    from ..experiments import importers

    imported = importers.import_ros(
        files,
        target or [],
        header,
        file,
        still=importers.Stillness(still_deg, still_s, still_mm),
        columns=_named(columns),
        topic=topic,
        marker_topic=marker_topic,
    )
    _write_imported(imported, file, force, [header, *files])


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
    header: HeaderFile,
    target: _TargetEach,
    file: NewRunFile,
    still_deg: _StillDeg,
    still_s: _StillSeconds,
    still_mm: _StillMm = None,
    delimiter: Annotated[
        str | None,
        typer.Option(help="Delimiter between two values, if not the usual one.", show_default=False),
    ] = None,
    marker_column: _MarkerColumn = None,
    force: Force = False,
) -> None:
    """Logs over time of a known layout: a measurement is where the arm dwells. Other logs: import csv."""
    from ..experiments import importers

    with progress("import") as tell:
        imported = importers.import_log(
            kind,
            files,
            target,
            header,
            file,
            still=importers.Stillness(still_deg, still_s, still_mm),
            delimiter=delimiter,
            marker_column=marker_column,
            progress=tell,
        )
        _write(imported, file, force, [header, *files], tell)
    _tell(imported, file)


@imports.command("fanuc")
def import_fanuc(
    files: Annotated[list[Path], typer.Argument(help="TP programs as text (.ls).", show_default=False)],
    header: HeaderFile,
    target: _TargetEach,
    file: NewRunFile,
    j3: Annotated[
        J3Origin,
        typer.Option(help="What joint 3 is counted from; on the pendant: ground.", show_default=False),
    ],
    points: _PointNames = None,
    force: Force = False,
) -> None:
    """Positions of TP programs that were taught with the beam on the target, in joint representation."""
    from ..experiments import importers

    imported = importers.import_fanuc(files, target, header, file, j3=j3, points=_named(points))
    _write_imported(imported, file, force, [header, *files])


@imports.command("kuka")
def import_kuka(
    files: Annotated[list[Path], typer.Argument(help="Data lists (.dat).", show_default=False)],
    header: HeaderFile,
    target: _TargetEach,
    file: NewRunFile,
    points: _PointNames = None,
    force: Force = False,
) -> None:
    """Axis positions (AXIS, E6AXIS) that were taught with the beam on the target."""
    from ..experiments import importers

    imported = importers.import_kuka(files, target, header, file, points=_named(points))
    _write_imported(imported, file, force, [header, *files])


def _named(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",")]


def _write_imported(imported: Imported, file: Path, force: bool, read: list[Path]) -> None:
    _write(imported, file, force, read, lambda stage, share: None)
    _tell(imported, file)


def _write(
    imported: Imported, file: Path, force: bool, read: list[Path], tell: Callable[[str, float], None]
) -> None:
    """Write the run; with `force` over another file, but none of those that were `read`."""
    from ..model.files.robot_file import robot_path
    from ..model.files.run import write_run
    from ..model.files.whole_file import refuse_existing

    refuse_existing(file, force=force, keep=[*read, robot_path(imported.header.robot, file.parent)])

    tell("writing", 0.7)
    write_run(file, imported.header, imported.shots, force=force)
    tell("writing", 1.0)


def _tell(imported: Imported, file: Path) -> None:
    for line in imported.understood:
        out.print(line, markup=False)
    out.print(f"{len(imported.shots)} measurements written to {file}", soft_wrap=True, markup=False)


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
    """A robot file of one very UR arm: nominal rows and its factory calibration."""
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
