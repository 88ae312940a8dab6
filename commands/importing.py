"""`zerobeam import`: runs from recorded files that people have."""

from collections.abc import Sequence
from dataclasses import is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from ..experiments.makers.format_options import ImportOptions
from ..experiments.makers.known_logs import known_logs, read_log
from ..experiments.makers.maker import Reader, makers
from ..model.errors import BadInput
from ..model.options import Option, argument, arguments, parameters_of
from .console import out, progress
from .formats import Command, of_typed, typer_parameters, with_options, with_parameters
from .shared_options import Force, NewRunFile

if TYPE_CHECKING:
    from ..experiments.makers.import_jobs import Imported, ImportJob
    from ..model.files.plan import Plan

# As help lists them; those of other makers are behind.
_READERS = (
    "csv",
    "points",
    "ros",
    "log",
    "ur-calibration",
    "rapid",
    "universal-robots",
    "krl",
    "kuka",
    "fanuc",
    "robodk",
)


def imports() -> typer.Typer:
    """The commands of the group: one for each kind of file that is read."""
    group = typer.Typer(help="Make a run from recorded files that people have.", no_args_is_help=True)
    readers = [reader for maker in makers() for reader in maker.read]
    commands = {reader.name: _reader_command(reader) for reader in [*readers, _reader_of_logs()]}
    commands["ur-calibration"] = with_options(import_ur_calibration)
    hidden = {reader.name for reader in readers if reader.hidden}
    for name in sorted(
        commands, key=lambda name: _READERS.index(name) if name in _READERS else len(_READERS)
    ):
        group.command(name, hidden=name in hidden)(commands[name])
    return group


def _reader_command(reader: Reader) -> Command:
    def import_files(
        files: Annotated[list[Path], argument(reader.files)],
        file: NewRunFile,
        *,
        of: ImportOptions,
        force: Force = False,
        **typed: Any,
    ) -> None:
        from ..experiments.makers.import_jobs import ImportJob

        with progress("import") as tell:
            job = ImportJob.begin(files, _header_or_plan(of.header, of.plan), file, of.target, tell)
            imported = reader.read(job, **arguments(reader.read, typed))
            read = [*(path for path in (of.header, of.plan) if path is not None), *job.paths]
            _write(imported, job, file, force, of.dry_run, read)
        for line in imported.understood:
            out.print(line, soft_wrap=True, markup=False)
        done = "dry run: nothing was" if of.dry_run else f"{len(imported.shots)} measurements"
        out.print(f"{done} written to {file}", soft_wrap=True, markup=False)

    import_files.__doc__ = reader.read.__doc__
    parameters = {each.name: each for one in (import_files, reader.read) for each in typer_parameters(one)}
    first, last = ([parameters.pop(name) for name in names] for names in (reader.first, ("force", "dry_run")))
    return with_parameters(of_typed(import_files), [*first, *parameters.values(), *last])


def _write(
    imported: "Imported", job: "ImportJob", file: Path, force: bool, dry_run: bool, read: Sequence[Path]
) -> None:
    """Write the run; with `force` over another file, but none of those that were `read`. A dry run refuses
    the same and writes nothing."""
    from ..model.files.robot_file import robot_path
    from ..model.files.run import write_run
    from ..model.files.whole_file import refuse_existing

    refuse_existing(file, force=force, keep=[*read, robot_path(imported.header.robot, file.parent)])
    if dry_run:
        return
    job.progress("writing", 0.7)
    write_run(file, imported.header, imported.shots, force=force)
    job.progress("writing", 1.0)


def _header_or_plan(header: Path | None, plan: Path | None) -> "Path | Plan":
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


def _reader_of_logs() -> Reader:
    layouts = {log.name: log.layout for log in known_logs()}

    def read(
        job: "ImportJob",
        kind: Annotated[
            Literal[tuple(layouts)],  # type: ignore[valid-type]
            argument("; ".join(f"{log.name}: {log.about}" for log in known_logs()) + "."),
        ],
        **options: object,
    ) -> "Imported":
        return read_log(job, layouts[kind], **options)  # type: ignore[arg-type]

    read.__doc__ = read_log.__doc__
    parameters = [*parameters_of(read), *parameters_of(read_log)]
    of_options = [one for one, hint in parameters if hasattr(hint, "__metadata__") or is_dataclass(hint)]
    with_parameters(read, [one.replace(kind=one.KEYWORD_ONLY) for one in of_options])
    return Reader("log", read, "Logs as CSV files.", first=("kind",))


def import_ur_calibration(
    calibration: Annotated[
        Path, argument("calibration.conf of the controller, or the YAML of ROS's ur_calibration.")
    ],
    robot: Annotated[str, Option("The nominal arm: ur3e, ur5e, ur10e, ur16e, ur20.")],
    file: Annotated[Path, Option("Robot file to write (.yaml).", "-o --out")],
) -> None:
    """A robot file of an individual UR arm: nominal rows and its factory calibration."""
    from ..experiments.makers.universal_robots.kinematics import calibrated_text, read_ur_calibration
    from ..model.files.whole_file import refuse_existing, schema_line, write_whole

    refuse_existing(file)
    arm = read_ur_calibration(calibration, robot)
    write_whole(file, schema_line(file, "robot") + calibrated_text(arm, calibration))
    rms, most = arm.apart_mm
    out.print(
        f"The flange is {rms:.2f} mm (rms, up to {most:.2f} mm) from that of the nominal {robot}.",
        soft_wrap=True,
    )
    out.print(f"Robot file: {file}", soft_wrap=True, markup=False)
