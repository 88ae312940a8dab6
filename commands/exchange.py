"""`zerobeam import` and `export`: runs from recorded files that people have; offsets of a run in the form in
which they are applied, and plans."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from ..experiments.command_options import ExportOptions, ImportOptions, ProgramMotion
from ..experiments.makers.known_logs import known_logs, read_log
from ..experiments.makers.maker import (
    Holds,
    OffsetFile,
    Reader,
    all_have_a_place,
    in_order,
    makers,
    plan_programs,
)
from ..model.errors import BadInput, NotWritten
from ..model.options import Option, argument, arguments, options_of, parameters_of
from ..words.controllers import POSITIONS, no_offsets_words
from .console import EXIT_STATUS, out, print_json, progress, say
from .shared_options import (
    Command,
    Force,
    Json,
    NewRunFile,
    PlanFile,
    RunFile,
    of_typed,
    typer_parameters,
    with_options,
    with_parameters,
)

if TYPE_CHECKING:
    from ..experiments.makers.calibration import RobotCalibration
    from ..experiments.makers.import_jobs import Imported, ImportJob
    from ..model.files.plan import Plan
    from ..model.files.run import Run
    from ..model.options import J3

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


ExportFile = Annotated[Path, Option("File to write.", "-o --out")]
# As help lists them; those of other makers are behind.
_OFFSETS = ("robot", "urdf", "moc", "rapid", "ur", "ur-calibration", "kuka", "fanuc", "json", "csv")

# Of the files; notes.
Texts = tuple[Mapping[Path, str | bytes], Sequence[str]]


class _Exports(TyperGroup):
    """The group, which says of a maker without offset files what there is for its controllers."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        maker = next((each for each in makers() if each.vendor == args[0].lower()), None)
        if maker is not None and args[0].lower() not in self.commands:
            programs = POSITIONS.get(maker.vendor or "")
            raise BadInput(
                f"there is no file of offsets for controllers of {maker.name}:"
                f" {no_offsets_words(maker.vendor)}"
                if maker.takes != "offsets"
                else f"a file for {maker.name} has another name",
                found=f"export {args[0]}",
                allowed=", ".join(
                    [
                        *(f"export {kind.name}" for kind in maker.offsets),
                        *([f"positions keep, positions reach ({programs})"] if programs else []),
                        "export robot",
                        "export urdf",
                    ]
                ),
            )
        return super().resolve_command(ctx, args)


def exports() -> typer.Typer:
    """The commands of the group: one for each kind of offset file, and plans."""
    group = typer.Typer(
        cls=_Exports,
        help="Write what a run determines in the form in which it is applied: only what is identifiable.",
        no_args_is_help=True,
    )
    for kind in in_order([kind for maker in makers() for kind in maker.offsets], _OFFSETS):
        group.command(kind.name, help=kind.text.__doc__)(_offsets_command(kind))
    group.command("plan")(_plan_command())
    return group


def _offsets_command(kind: OffsetFile) -> Command:
    def export(run: RunFile, file: ExportFile, **typed: Any) -> None:
        choices = {one.name: one.value(typed.pop(one.name)) for one in options_of(kind.text)}

        def texts(recorded: "Run", calibration: "RobotCalibration") -> Texts:
            from ..model.files.whole_file import schema_line

            head = "" if kind.schema is None else schema_line(file, kind.schema)
            lack = kind.lacks(choices)
            notes = () if lack is None else (lack,)
            return {file: head + kind.text(recorded, calibration, **choices)}, notes

        read = [choice for choice in choices.values() if isinstance(choice, Path)]
        how = arguments(_export, typed)
        _export(run, file, texts, read, kind.holds, kind.no_place, as_data=kind.as_data, **how)

    return with_options(export, kind.text, _export)


def _export(
    run: Path,
    file: Path,
    texts: Callable[["Run", "RobotCalibration"], Texts],
    read: Sequence[Path],
    holds: Holds,
    no_place: Callable[["Run"], Collection[str]] = all_have_a_place,
    *,
    as_data: bool = False,
    options: ExportOptions,
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Judge a run, write what may be applied, say what was written; never over a file that is `read`.

    `holds`, `no_place` and `as_data` are those of the kind of file. Its options are those of every command
    that calls it.
    """
    from ..experiments.makers.calibration import calibration
    from ..model.files.robot_file import robot_path
    from ..model.files.run import read_run
    from ..model.files.whole_file import refuse_existing, write_whole
    from ..model.parsing.confinement import require_within
    from ..model.records import to_json

    require_within(file, hidden=True)
    if file.parent.exists():  # else it is made once all is judged
        refuse_existing(file, force=force, keep=[run, *read])
    recorded = read_run(run)
    hold_out, how = options.hold_out, {**vars(options)}
    del how["hold_out"]
    keep = [run, hold_out, *read, robot_path(recorded.header.robot, run.parent)]
    judged = calibration(
        recorded,
        **how,
        as_data=as_data,
        held_out=None if hold_out is None else read_run(hold_out),
        holds=holds,
        no_place=no_place(recorded),
    )
    files, notes = texts(recorded, judged)
    if not file.parent.exists():
        _make_folder(file.parent)
    for path in files:
        refuse_existing(path, force=force, keep=keep)
    for path, content in files.items():
        write_whole(path, content, force=force)
    if as_json:
        print_json(to_json(replace(judged, remarks=tuple(notes))))
    else:
        for line in judged.head:
            say(line)
        for line in [*notes, *(f"Written to {path}" for path in files)]:
            say(line)
    if judged.misfit:
        raise typer.Exit(EXIT_STATUS["misfit"])


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise NotWritten(f"the folder cannot be made: {error.strerror}", file=folder) from None


def _plan_command() -> Command:
    programs = [program for program, _ in plan_programs()]
    kinds = [*(program.name for program in programs), "pdf"]
    several = [program.name for program in programs if len(program.files) > 1]

    def export_plan(
        kind: Annotated[
            Literal[tuple(kinds)],  # type: ignore[valid-type]
            argument(
                f"{'; '.join(f'{program.name}: {program.label}' for program in programs)}; pdf: a sheet"
                " for the person at the robot."
            ),
        ],
        plan: PlanFile,
        file: Annotated[
            Path, Option(f"File to write; {' and '.join(several)} write others beside it.", "-o --out")
        ],
        *,
        motion: ProgramMotion,
        force: Force = False,
    ) -> None:
        """A plan as a program that goes to each posture, waits until the beam is centred, records the joints.

        zerobeam import reads what it recorded. The command refuses a robot of another vendor.
        """
        from ..experiments.makers.plan_programs import write_program
        from ..model.files.plan import read_plan
        from ..model.files.robot_file import robot_path

        planned = read_plan(plan)
        read = [plan, robot_path(planned.header.robot, plan.parent)]
        if kind == "pdf":
            motion.require_only("pdf", ("j3",))
            _write_sheet(planned, file, motion.j3, force, read)
            return
        files, notes = write_program(kind, planned, motion, file, force=force, keep=read)
        for note in notes:
            say(f"note: {note}")
        for path in files:
            say(f"Written to {path}")

    return with_options(export_plan)


def _write_sheet(planned: "Plan", file: Path, j3: "J3 | None", force: bool, read: list[Path | None]) -> None:
    """The operator's sheet of a plan."""
    from ..analysis.observability.aim import aim_plan
    from ..experiments.plans.constraints import check_plan, require_constraints
    from ..model.files.whole_file import refuse_existing, write_whole
    from ..reports.plan.operator_sheet import operator_sheet

    refuse_existing(file, force=force, keep=read)
    require_constraints(planned)
    turned = aim_plan(planned)
    write_whole(file, operator_sheet(turned, check_plan(planned, turned, outlook=False), j3), force=force)
    say(f"Written to {file}")
