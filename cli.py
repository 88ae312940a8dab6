"""The command line: thin. Each command reads, calls one function and prints.

Exit status: 0 verdict pass; 1 weak or degenerate; 2 bad input or usage; 3 a fault of the rig or of the
program, or a failed fit.
"""

from __future__ import annotations

import json
import math
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console

from . import __version__
from .model.errors import BadInput, ZerobeamError

if TYPE_CHECKING:
    from .analysis.result import Draws, Result
    from .analysis.robust import Loss

EXIT_STATUS = {"pass": 0, "weak": 1, "degenerate": 1}
_FAULT = 3
_INTERRUPTED = 130

app = typer.Typer(
    name="zerobeam",
    help="Joint offsets of an industrial robot from laser shots at one point, and how sure one may be.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)
imports = typer.Typer(help="Make a run from recorded files that people have.", no_args_is_help=True)
app.add_typer(imports, name="import")
studies = typer.Typer(
    help="Does zerobeam hold what it promises? Studies over simulated runs.", no_args_is_help=True
)
app.add_typer(studies, name="study")

out = Console(highlight=False, soft_wrap=False)
err = Console(stderr=True, highlight=False)


class AngleUnit(StrEnum):
    """Units that angles come in."""

    DEG = "deg"
    RAD = "rad"


class LengthUnit(StrEnum):
    """Units that lengths come in."""

    MM = "mm"
    M = "m"


class PlanKind(StrEnum):
    """How a plan is made: the paper's two patterns, or the best of many candidates."""

    X = "x"
    Y = "y"
    OPTIMAL = "optimal"


class CriterionName(StrEnum):
    """What an optimal plan minimises: mean, generalised or largest variance of the offsets."""

    A = "A"
    D = "D"
    E = "E"


class LossName(StrEnum):
    """How a robust fit weighs a far miss."""

    HUBER = "huber"
    STUDENT = "student"


class RigName(StrEnum):
    """What can carry a plan out."""

    SIMULATED = "simulated"
    REPLAY = "replay"


Json = Annotated[bool, typer.Option("--json", help="Print the machine's answer (JSON) and nothing else.")]
Picture = Annotated[
    Path | None, typer.Option(help="Write a page with the plan in 3D (.html).", show_default=False)
]
Seed = Annotated[int, typer.Option(min=0, help="Seed of all that is random: the same seed, the same answer.")]
Ess = Annotated[float, typer.Option(min=100, help="Effective posterior draws asked of every parameter.")]
Robust = Annotated[
    LossName | None,
    typer.Option(
        help="Fit once more with this loss, which far misses pull less; names outliers.", show_default=False
    ),
]
HoldOut = Annotated[
    list[str] | None,
    typer.Option(
        help="Fit once more without this target and look how it does there; repeatable, * and ? match.",
        metavar="NAME",
        show_default=False,
    ),
]
RunFile = Annotated[Path, typer.Argument(help="Run file (.jsonl).", show_default=False)]
PlanFile = Annotated[Path, typer.Argument(help="Plan file (.yaml).", show_default=False)]


def _print_version(asked: bool) -> None:
    if asked:
        out.print(f"zerobeam {__version__}")
        raise typer.Exit


@app.callback()
def _zerobeam(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Joint offsets of an industrial robot from laser shots at one point, and how sure one may be."""


@app.command()
def demo(
    folder: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the reports.", show_default=True)
    ] = Path("zerobeam-demo"),
) -> None:
    """The main job on three built-in runs: a good one, an X-Pattern, an uncalibrated tool."""
    from .analysis.result_json import to_json
    from .experiments.demos import demo_runs
    from .model.run import read_run
    from .reports.folder import check_target, write_report
    from .reports.terminal import print_side_by_side, print_verdict

    cases = demo_runs()
    for case in cases:
        check_target(folder / case.name)
    answers = []
    for case in cases:
        with _progress(case.title) as told:
            result, draws = _analysed(read_run(case.path), 0, 1000.0, told)
        write_report(folder / case.name, result, draws)
        answers.append(to_json(result))
    print_side_by_side(out, [case.title for case in cases], answers)
    for case, answer in zip(cases, answers, strict=True):
        out.print(f"\n[bold]{case.title}[/bold]: {case.about}")
        print_verdict(out, answer)
        out.print(f"Report: {folder / case.name / 'report.html'}", soft_wrap=True)


@app.command()
def check(plan: PlanFile, as_json: Json = False, picture: Picture = None) -> None:
    """Will this plan work? The verdict before any shot."""
    from .analysis.check import check as judge
    from .analysis.check import check_json
    from .model.plan import read_plan
    from .reports.terminal import print_check

    planned = read_plan(plan)
    answer = check_json(judge(planned))
    if picture is not None:
        from .reports.plan_page import write_plan_page

        write_plan_page(picture, planned)
    if as_json:
        _print_json(answer)
    else:
        print_check(out, answer)
    raise typer.Exit(EXIT_STATUS[answer["verdict"]])


@app.command()
def analyse(
    run: RunFile,
    as_json: Json = False,
    seed: Seed = 0,
    ess: Ess = 1000.0,
    robust: Robust = None,
    hold_out: HoldOut = None,
) -> None:
    """What the offsets are, and how sure one may be."""
    from .analysis.result_json import to_json
    from .model.run import read_run
    from .reports.terminal import print_result

    recorded = read_run(run)
    with _progress("analyse") as told:
        result, _ = _analysed(recorded, seed, ess, told, robust, hold_out)
    answer = to_json(result)
    if as_json:
        _print_json(answer)
    else:
        print_result(out, answer)
    raise typer.Exit(_status(result))


@app.command()
def report(
    run: RunFile,
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the report.", show_default=False)],
    as_json: Json = False,
    seed: Seed = 0,
    ess: Ess = 1000.0,
    robust: Robust = None,
    hold_out: HoldOut = None,
) -> None:
    """The report of a run: report.html, report.pdf, result.json, posterior.nc and the figures."""
    from .analysis.result_json import to_json
    from .model.run import read_run
    from .reports.folder import check_target, write_report
    from .reports.terminal import print_result

    recorded = read_run(run)
    check_target(folder)
    with _progress("report") as told:
        result, draws = _analysed(recorded, seed, ess, told, robust, hold_out)
        told("writing", 0.0)
        paths = write_report(folder, result, draws)
        told("writing", 1.0)
    if as_json:
        _print_json(to_json(result))
    else:
        print_result(out, to_json(result))
        out.print(f"Report: {paths.html}", soft_wrap=True)
    raise typer.Exit(_status(result))


@app.command()
def plan(
    kind: Annotated[
        PlanKind, typer.Argument(help="x or y: the paper's patterns; optimal.", show_default=False)
    ],
    header: Annotated[
        Path, typer.Option(help="Header file (.yaml): robot, tool, noise.", show_default=False)
    ],
    target: Annotated[
        str, typer.Option(help="Where the target stands: X,Y,Z in mm, base frame.", show_default=False)
    ],
    file: Annotated[
        Path, typer.Option("-o", "--out", help="Plan file to write (.yaml).", show_default=False)
    ],
    shots: Annotated[int, typer.Option(min=2, help="Number of shots.")] = 7,
    candidates: Annotated[int, typer.Option(min=10, help="Postures to choose from.")] = 10_000,
    criterion: Annotated[
        CriterionName, typer.Option(help="What an optimal plan minimises.")
    ] = CriterionName.A,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Take the fewest shots that reach this std (deg; mm).", show_default=False),
    ] = None,
    max_shots: Annotated[int, typer.Option(min=2, help="With --tolerance: shots at the most.")] = 30,
    facing: Annotated[
        str, typer.Option(help="Outward normal of the target's face: X,Y,Z, or any.")
    ] = "0,0,1",
    acceptance: Annotated[
        float, typer.Option(help="Largest angle between beam and that normal, deg.")
    ] = 60.0,
    beam: Annotated[str, typer.Option(help="Shortest and longest beam, mm: MIN,MAX.")] = "200,2000",
    margin: Annotated[float, typer.Option(min=0, help="Kept to every joint limit, deg.")] = 5.0,
    obstacles: Annotated[
        Path | None, typer.Option(help="Obstacles file (.yaml): floor, boxes.", show_default=False)
    ] = None,
    seed: Seed = 0,
    as_json: Json = False,
    picture: Picture = None,
) -> None:
    """Make a plan: the paper's X- or Y-Pattern, or the best of many candidate postures."""
    from .experiments.obstacles import Obstacles, read_obstacles
    from .experiments.plan_making import Request, make_plan
    from .model.header import read_header
    from .model.plan import read_plan
    from .reports.terminal import print_proposal

    request = Request(
        kind=kind.value,
        header=read_header(header),
        header_folder=header.parent,
        target=_numbers(target, 3, "--target"),
        shots=shots,
        candidates=candidates,
        criterion=criterion.value,
        tolerance=tolerance,
        max_shots=max_shots,
        facing=None if facing == "any" else _numbers(facing, 3, "--facing"),
        acceptance_deg=acceptance,
        beam_mm=_numbers(beam, 2, "--beam"),
        margin_deg=margin,
        obstacles=Obstacles() if obstacles is None else read_obstacles(obstacles),
        seed=seed,
    )
    with _progress("plan") as told:
        made = make_plan(request, file, told)
    answer = made.as_json()
    if picture is not None and made.file is not None:
        from .reports.plan_page import write_plan_page

        write_plan_page(picture, read_plan(made.file))
    if as_json:
        _print_json(answer)
    else:
        print_proposal(out, answer)
        if made.file is not None:
            out.print(f"Plan: {made.file}", soft_wrap=True, markup=False)
    # No plan within the tolerance is an answer, as a weak verdict is.
    raise typer.Exit(1 if made.checked is None else EXIT_STATUS[made.checked["verdict"]])


@app.command()
def run(
    plan: PlanFile,
    file: Annotated[
        Path, typer.Option("-o", "--out", help="Run file to write (.jsonl).", show_default=False)
    ],
    rig: Annotated[RigName, typer.Option(help="What carries the plan out.")] = RigName.SIMULATED,
    cell: Annotated[
        Path | None, typer.Option(help="Cell file (.yaml) of the simulated rig.", show_default=False)
    ] = None,
    camera: Annotated[
        bool, typer.Option("--camera/--no-camera", help="Find the PSD in pictures, or by the beam alone.")
    ] = True,
    recorded: Annotated[
        Path | None, typer.Option(help="Run file that a replay gives back.", show_default=False)
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was stopped.")] = False,
    adaptive: Annotated[
        bool,
        typer.Option(
            "--adaptive", help="Choose the next posture by the shots so far; end when it is enough."
        ),
    ] = False,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="With --adaptive: the std that is enough (deg; mm). Default: the plan's.", show_default=False
        ),
    ] = None,
    closing: Annotated[
        bool,
        typer.Option("--closing", help="Shoot the first posture again at the end: has the PSD moved?"),
    ] = False,
    seed: Seed = 0,
    as_json: Json = False,
    json_lines: Annotated[
        bool, typer.Option("--json-lines", help="Print every event as a line of JSON as it happens.")
    ] = False,
) -> None:
    """Carry a plan out: bring the beam to the target from each posture, record, identify."""
    from .experiments.recording import Request, record
    from .model.plan import read_plan
    from .reports.live import live_view
    from .reports.terminal import print_carried

    if tolerance is not None and not adaptive:
        raise BadInput("--tolerance is for an adaptive run", remedy="add --adaptive, or leave it out")
    planned = read_plan(plan)
    enough = tolerance if tolerance is not None else planned.header.tolerance.offset_deg
    request = Request(
        rig=rig.value,
        seed=seed,
        cell=cell,
        camera=camera,
        recording=recorded,
        resume=resume,
        tolerance=enough if adaptive else None,
        closing=closing,
    )
    with _stoppable(), live_view(err) as seen:

        def told(event: dict[str, Any]) -> None:
            seen(event)
            if json_lines:
                sys.stdout.write(json.dumps(event, ensure_ascii=False, allow_nan=False) + "\n")
                sys.stdout.flush()

        try:
            answer = record(planned, file, request, told)
        except KeyboardInterrupt:
            err.print(
                f"stopped: what is recorded stays in {file}; --resume goes on with it",
                markup=False,
                soft_wrap=True,
            )
            raise typer.Exit(_INTERRUPTED) from None
    if as_json:
        _print_json(answer)
    elif not json_lines:
        print_carried(out, answer)
        out.print(f"Run: {file}", soft_wrap=True, markup=False)
    raise typer.Exit(EXIT_STATUS[answer["verdict"]])


@app.command()
def schema(
    name: Annotated[
        str | None,
        typer.Argument(
            help="run-header, run-shot, plan, header, robot, obstacles or cell.", show_default=False
        ),
    ] = None,
) -> None:
    """Print the JSON Schema of a file (without a name: which there are)."""
    from .experiments.schema import SCHEMA_NAMES, json_schema

    if name is None:
        out.print("\n".join(SCHEMA_NAMES))
        return
    if name not in SCHEMA_NAMES:
        raise BadInput("there is no schema of that name", found=name, allowed=", ".join(SCHEMA_NAMES))
    _print_json(json_schema(name))


@imports.command("csv")
def import_csv(
    files: Annotated[list[Path], typer.Argument(help="CSV files, one posture a row.", show_default=False)],
    header: Annotated[
        Path, typer.Option(help="Header file (.yaml): robot, tool, noise.", show_default=False)
    ],
    units: Annotated[AngleUnit, typer.Option(help="Unit of the angles.", show_default=False)],
    target: Annotated[
        list[str],
        typer.Option(
            help="Target of a file's shots: once for each file, in their order.", show_default=False
        ),
    ],
    file: Annotated[
        Path, typer.Option("-o", "--out", help="Run file to write (.jsonl).", show_default=False)
    ],
    lengths: Annotated[
        LengthUnit | None, typer.Option(help="Unit of prismatic joints.", show_default=False)
    ] = None,
    header_row: Annotated[
        bool, typer.Option("--header-row", help="The first row names the columns.")
    ] = False,
    columns: Annotated[
        str | None,
        typer.Option(
            help="Columns of joint 1, 2, …, by name: a,b,c (with --header-row).", show_default=False
        ),
    ] = None,
    delimiter: Annotated[str, typer.Option(help="What stands between two numbers.")] = ",",
) -> None:
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from .experiments import importers
    from .model.run import write_run

    imported = importers.import_csv(
        files,
        target,
        units.value,
        header,
        file,
        header_row=header_row,
        columns=None if columns is None else [name.strip() for name in columns.split(",")],
        delimiter=delimiter,
        lengths=None if lengths is None else lengths.value,
    )
    for line in imported.understood:
        out.print(line, markup=False)
    write_run(file, imported.header, imported.shots)
    out.print(f"{len(imported.shots)} shots written to {file}", soft_wrap=True, markup=False)


@studies.command("coverage")
def study_coverage(
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)],
    data_sets: Annotated[int, typer.Option(min=100, help="Simulated runs of each plan.")] = 1000,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Do the intervals hold the truth as often as they promise? Simulated runs, solved again, tell."""
    from .experiments.coverage import coverage_study

    _study(folder, as_json, lambda told: coverage_study(data_sets, seed, told))


@studies.command("cell")
def study_cell(
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)],
    runs: Annotated[int, typer.Option(min=20, help="Simulated runs of each plan.")] = 200,
    camera: Annotated[
        bool, typer.Option("--camera/--no-camera", help="Find the PSD in pictures, or by the beam alone.")
    ] = True,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Does the whole chain hold what it promises? Runs in the simulated cell, from plan to offsets, tell."""
    from .experiments.cell_study import cell_study

    _study(folder, as_json, lambda told: cell_study(runs, seed, told, camera=camera))


@studies.command("table2")
def study_table2(
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)],
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """What joint noise would make three runs scatter as those of the paper's Table 2 did?"""
    from .experiments.table2 import table2_study

    _study(folder, as_json, lambda told: table2_study(seed, told))


def _study(
    folder: Path, as_json: bool, studied: Callable[[Callable[[str, float], None]], dict[str, Any]]
) -> NoReturn:
    """Carry a study out, write it, print it; the status says whether it agrees."""
    from .reports.study_page import check_target, write_study
    from .reports.study_terminal import print_study

    check_target(folder)
    with _stoppable(), _progress("study") as told:
        answer = studied(told)
        told("writing", 1.0)
        paths = write_study(folder, answer)
    if as_json:
        _print_json(answer)
    else:
        print_study(out, answer)
        out.print(f"Study: {paths.html}", soft_wrap=True, markup=False)
    raise typer.Exit(0 if answer["agrees"] else 1)


def _numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """`count` finite numbers, separated by commas."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise BadInput(
            f"{option} is not understood",
            found=text,
            allowed=f"{count} numbers separated by commas",
        )
    return values


def _analysed(
    recorded: Any,
    seed: int,
    ess: float,
    told: Callable[[str, float], None],
    robust: LossName | None = None,
    held_out: list[str] | None = None,
) -> tuple[Result, Draws | None]:
    from .analysis.analyse import analyse as judge

    loss: Loss | None = None if robust is None else robust.value
    return judge(recorded, seed=seed, ess=ess, robust=loss, held_out=held_out or (), progress=told)


def _status(result: Result) -> int:
    return EXIT_STATUS[result.verdict] if result.likelihood.converged else _FAULT


def _print_json(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer, ensure_ascii=False, allow_nan=False, indent=1) + "\n")


@contextmanager
def _progress(title: str) -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error with the stage under way; silent when that is no terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(title, total=1.0)

        def told(stage: str, share: float) -> None:
            bar.update(task, description=f"{title}: {stage}", completed=share)

        yield told


@contextmanager
def _stoppable() -> Iterator[None]:
    """A request to end (SIGTERM) stops the motion as Ctrl-C does."""

    def stop(*_: Any) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _warn(message: Warning | str, *_: Any, **__: Any) -> None:
    err.print(f"note: {message}", markup=False, soft_wrap=True)


def main() -> NoReturn:
    """Entry point of the console script: every error that is the user's is one message, no traceback."""
    warnings.showwarning = _warn
    try:
        app(standalone_mode=True)
    except ZerobeamError as error:
        err.print(f"error: {error}", markup=False, soft_wrap=True)
        sys.exit(error.exit_status)
    except KeyboardInterrupt:
        err.print("stopped")
        sys.exit(_INTERRUPTED)
    except Exception:  # noqa: BLE001 - told in full, and the last thing that happens
        # Python's own status for this is 1, which is a verdict here.
        traceback.print_exc()
        err.print("error: this is a fault of zerobeam itself, please report it with the lines above")
        sys.exit(_FAULT)
    sys.exit(0)
