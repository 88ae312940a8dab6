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
    from .experiments.exporters.calibration import Calibration
    from .experiments.importers import Imported
    from .experiments.recording import Controller
    from .model.run import Run

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
exports = typer.Typer(
    help="Write the offsets of a run as people apply them: only what its shots tell.", no_args_is_help=True
)
app.add_typer(exports, name="export")

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


class ClockUnit(StrEnum):
    """Units that recorded times come in."""

    S = "s"
    MS = "ms"
    US = "us"
    NS = "ns"


class J3Origin(StrEnum):
    """What the third joint's angle is counted from."""

    GROUND = "ground"
    LINK = "link"


class KnownLog(StrEnum):
    """Logs over time whose layout is known."""

    UR = "ur"
    EGM = "egm"
    ROBODK = "robodk"


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
    ABB = "abb"


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
HeaderFile = Annotated[
    Path, typer.Option("--header", help="Header file (.yaml): robot, tool, noise.", show_default=False)
]
NewRunFile = Annotated[
    Path, typer.Option("-o", "--out", help="Run file to write (.jsonl).", show_default=False)
]
StudyFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)]
Camera = Annotated[
    bool, typer.Option("--camera/--no-camera", help="Find the PSD in pictures, or by the beam alone.")
]
ExportFile = Annotated[Path, typer.Option("-o", "--out", help="File to write.", show_default=False)]
AllowWeak = Annotated[
    bool, typer.Option("--allow-weak", help="Export weak offsets too; the file marks them.")
]
AllowDisplaced = Annotated[
    bool,
    typer.Option("--allow-displaced", help="Export although a target seems to have moved; the file says so."),
]
Without = Annotated[
    list[str] | None,
    typer.Option(
        help="Leave this offset out (delta4): it counts as 0. Repeatable.",
        metavar="NAME",
        show_default=False,
    ),
]


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
    header: HeaderFile,
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
    file: NewRunFile,
    rig: Annotated[RigName, typer.Option(help="What carries the plan out.")] = RigName.SIMULATED,
    cell: Annotated[
        Path | None, typer.Option(help="Cell file (.yaml) of the simulated rig.", show_default=False)
    ] = None,
    camera: Camera = True,
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
    host: Annotated[
        str | None, typer.Option(help="ABB: address of the controller.", show_default=False)
    ] = None,
    port: Annotated[int, typer.Option(min=1, max=65535, help="ABB: port of Robot Web Services.")] = 80,
    egm_port: Annotated[int, typer.Option(min=1, max=65535, help="ABB: own UDP port for EGM.")] = 6510,
    sensor_port: Annotated[
        int, typer.Option(min=1, max=65535, help="ABB: port of PSD and camera at the host.")
    ] = 6520,
    user: Annotated[
        str | None, typer.Option(help="ABB: user, else ZEROBEAM_ABB_USER.", show_default=False)
    ] = None,
    password: Annotated[
        str | None,
        typer.Option(help="ABB: password, else ZEROBEAM_ABB_PASSWORD or the keyring.", show_default=False),
    ] = None,
    speed: Annotated[float, typer.Option(help="ABB: share of the joints' top speeds.")] = 0.25,
    yes: Annotated[bool, typer.Option("--yes", help="ABB: move without asking first.")] = False,
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
        controller=_abb(host, port, egm_port, sensor_port, user, password, speed, yes)
        if rig is RigName.ABB
        else None,
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
def controller(
    plan: Annotated[
        Path | None,
        typer.Argument(
            help="Plan file (.yaml): robot, tool and targets. Default: an IRB1600 and one PSD.",
            show_default=False,
        ),
    ] = None,
    cell: Annotated[Path | None, typer.Option(help="Cell file (.yaml).", show_default=False)] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of Robot Web Services (0: any).")] = 8080,
    egm_port: Annotated[
        int, typer.Option(min=0, max=65535, help="UDP port of the client that EGM goes to (0: any).")
    ] = 6510,
    sensor_port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port of PSD and camera (0: any).")
    ] = 6520,
    bind: Annotated[str, typer.Option(help="Address to listen at.")] = "127.0.0.1",
    client: Annotated[str, typer.Option(help="Address of the client that EGM goes to.")] = "127.0.0.1",
    lost: Annotated[float, typer.Option(min=0, max=1, help="Share of EGM packets that are lost.")] = 0.0,
    late: Annotated[float, typer.Option(min=0, max=1, help="Share that comes 20 ms late.")] = 0.0,
    duplicated: Annotated[float, typer.Option(min=0, max=1, help="Share that comes twice.")] = 0.0,
    reordered: Annotated[float, typer.Option(min=0, max=1, help="Share that comes behind the next.")] = 0.0,
    seed: Seed = 0,
) -> None:
    """A simulated ABB IRC5 to learn and to test with: Robot Web Services and EGM. Ctrl-C ends it."""
    import threading

    from .experiments.controller.own_plan import own_plan
    from .experiments.controller.packet_line import PacketFaults
    from .experiments.controller.simulated_controller import SimulatedController
    from .experiments.rigs.cell_file import Cell, read_cell
    from .model.plan import read_plan

    planned = own_plan() if plan is None else read_plan(plan)
    stands = Cell() if cell is None else read_cell(cell)[0]
    faults = PacketFaults(lost=lost, late=late, duplicated=duplicated, reordered=reordered)
    with _stoppable():
        try:
            with SimulatedController(
                planned,
                stands,
                seed,
                port=port,
                egm_port=egm_port,
                sensor_port=sensor_port,
                bind=bind,
                client=client,
                packet_faults=faults,
            ) as simulated:
                out.print(f"Robot Web Services: {simulated.url}", soft_wrap=True, markup=False)
                out.print(f"EGM: to {client}, port {simulated.egm_port}", soft_wrap=True, markup=False)
                out.print(
                    f"PSD and camera: {bind}, port {simulated.sensor_port}", soft_wrap=True, markup=False
                )
                out.print("Ctrl-C ends it.")
                threading.Event().wait()
        except KeyboardInterrupt:
            raise typer.Exit(0) from None


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


_TargetEach = Annotated[
    list[str],
    typer.Option(help="Target of a file's shots: once for each file, in their order.", show_default=False),
]
_Targets = Annotated[
    list[str] | None,
    typer.Option(
        help="Target of a file's shots: once for each file, in their order, unless the files name them.",
        show_default=False,
    ),
]
_StillDeg = Annotated[
    float, typer.Option(help="At rest: each joint within so many degrees.", show_default=False)
]
_StillSeconds = Annotated[float, typer.Option(help="At rest: for at least so long.", show_default=False)]
_StillMm = Annotated[
    float | None, typer.Option(help="At rest: each prismatic joint within so many mm.", show_default=False)
]
_MarkerColumn = Annotated[
    str | None,
    typer.Option(help="Only stands in which this column becomes other than 0.", show_default=False),
]
_PointNames = Annotated[
    str | None,
    typer.Option(help="Points to use, by name: a,b,c (default: all).", show_default=False),
]


def _named(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",")]


def _write_imported(imported: Imported, file: Path) -> None:
    from .model.run import write_run

    for line in imported.understood:
        out.print(line, markup=False)
    write_run(file, imported.header, imported.shots)
    out.print(f"{len(imported.shots)} shots written to {file}", soft_wrap=True, markup=False)


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
    delimiter: Annotated[str, typer.Option(help="What stands between two numbers.")] = ",",
    decimal: Annotated[str, typer.Option(help="Decimal sign: . or ,")] = ".",
    j3: Annotated[J3Origin, typer.Option(help="Joint 3 is counted from; FANUC: ground.")] = J3Origin.LINK,
    spot_columns: Annotated[
        str | None, typer.Option(help="Columns of spot_mm: dx,dy in mm.", show_default=False)
    ] = None,
    shot_column: Annotated[
        str | None, typer.Option(help="Column of the shots' numbers.", show_default=False)
    ] = None,
    time_column: Annotated[str | None, typer.Option(help="Column of times.", show_default=False)] = None,
    time_units: Annotated[
        ClockUnit | None, typer.Option(help="Unit of the times.", show_default=False)
    ] = None,
    still_deg: Annotated[
        float | None,
        typer.Option(
            help="A shot is where the arm is at rest: each joint within so many degrees, …",
            show_default=False,
        ),
    ] = None,
    still_s: Annotated[
        float | None, typer.Option(help="… for at least so many seconds.", show_default=False)
    ] = None,
    still_mm: _StillMm = None,
    marker_column: _MarkerColumn = None,
) -> None:
    """Recorded joint positions in CSV files. Units and target names are stated, never guessed."""
    from .experiments import importers

    if (still_deg is None) != (still_s is None) or (still_mm is not None and still_deg is None):
        raise BadInput(
            "standing still is half stated", remedy="state both --still-deg and --still-s, or none"
        )
    still = None
    if still_deg is not None and still_s is not None:
        still = importers.Stillness(still_deg, still_s, still_mm)
    imported = importers.import_csv(
        files,
        target or [],
        units.value,
        header,
        file,
        header_row=header_row,
        columns=_named(columns),
        delimiter=delimiter,
        lengths=None if lengths is None else lengths.value,
        decimal=decimal,
        target_column=target_column,
        shot_column=shot_column,
        spot_columns=_named(spot_columns),
        time_column=time_column,
        time_units=None if time_units is None else time_units.value,
        marker_column=marker_column,
        j3=j3.value,
        still=still,
    )
    _write_imported(imported, file)


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
            help="Only stands at a message on this topic; a std_msgs/String names the target.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Joint states in ROS bags: a shot is where the arm is at rest (and a marker says so)."""
    from .experiments import importers

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
    _write_imported(imported, file)


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
        str | None, typer.Option(help="What stands between two values, if not as usual.", show_default=False)
    ] = None,
    marker_column: _MarkerColumn = None,
) -> None:
    """Logs over time of a known layout: a shot is where the arm is at rest. Other logs: import csv."""
    from .experiments import importers

    imported = importers.import_log(
        kind.value,
        files,
        target,
        header,
        file,
        still=importers.Stillness(still_deg, still_s, still_mm),
        delimiter=delimiter,
        marker_column=marker_column,
    )
    _write_imported(imported, file)


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
) -> None:
    """Positions of TP programs that were taught with the beam on the target, in joint representation."""
    from .experiments import importers

    _write_imported(
        importers.import_fanuc(files, target, header, file, j3=j3.value, points=_named(points)), file
    )


@imports.command("kuka")
def import_kuka(
    files: Annotated[list[Path], typer.Argument(help="Data lists (.dat).", show_default=False)],
    header: HeaderFile,
    target: _TargetEach,
    file: NewRunFile,
    points: _PointNames = None,
) -> None:
    """Axis positions (AXIS, E6AXIS) that were taught with the beam on the target."""
    from .experiments import importers

    _write_imported(importers.import_kuka(files, target, header, file, points=_named(points)), file)


@studies.command("coverage")
def study_coverage(
    folder: StudyFolder,
    data_sets: Annotated[int, typer.Option(min=100, help="Simulated runs of each plan.")] = 1000,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Do the intervals hold the truth as often as they promise? Simulated runs, solved again, tell."""
    from .experiments.coverage import coverage_study

    _study(folder, as_json, lambda told: coverage_study(data_sets, seed, told))


@studies.command("cell")
def study_cell(
    folder: StudyFolder,
    runs: Annotated[int, typer.Option(min=20, help="Simulated runs of each plan.")] = 200,
    camera: Camera = True,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Does the whole chain hold what it promises? Runs in the simulated cell, from plan to offsets, tell."""
    from .experiments.cell_study import cell_study

    _study(folder, as_json, lambda told: cell_study(runs, seed, told, camera=camera))


@studies.command("table2")
def study_table2(
    folder: StudyFolder,
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


@exports.command("urdf")
def export_urdf(
    run: RunFile,
    file: ExportFile,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    without: Without = None,
    as_json: Json = False,
) -> None:
    """A corrected copy of the run's URDF: the offsets in the origins of its joints."""
    from .experiments.exporters.urdf_origins import urdf_text

    _export(run, file, allow_weak, allow_displaced, without, as_json, urdf_text)


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
            help="Motor turns for one turn of each joint: R1,R2,…, negative if against each other.",
            show_default=False,
        ),
    ] = None,
    unit: Annotated[str, typer.Option(help="Mechanical unit: its motors are UNIT_1, UNIT_2, …")] = "rob1",
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    without: Without = None,
    as_json: Json = False,
) -> None:
    """ABB: changes of the motors' calibration offsets, as a diff to look at. Nothing is applied."""
    from .experiments.exporters.moc_offsets import Gears, moc_text

    def text(recorded: Run, calibration: Calibration) -> str:
        gears = Gears.stated(ratio, motor_sign, recorded.robot.n)
        return moc_text(calibration, gears, against, unit)

    _export(run, file, allow_weak, allow_displaced, without, as_json, text)


@exports.command("rapid")
def export_rapid(
    run: RunFile,
    file: ExportFile,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    without: Without = None,
    as_json: Json = False,
) -> None:
    """ABB: a RAPID module with functions that correct a jointtarget by the offsets."""
    from .experiments.exporters.rapid_module import rapid_text

    _export(
        run,
        file,
        allow_weak,
        allow_displaced,
        without,
        as_json,
        lambda _, calibration: rapid_text(calibration),
    )


@exports.command("json")
def export_json(
    run: RunFile,
    file: ExportFile,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    without: Without = None,
    as_json: Json = False,
) -> None:
    """The offsets with their uncertainty as JSON, for programs."""
    from .experiments.exporters.offsets_json import json_text

    _export(
        run,
        file,
        allow_weak,
        allow_displaced,
        without,
        as_json,
        lambda _, calibration: json_text(calibration),
    )


@exports.command("csv")
def export_csv(
    run: RunFile,
    file: ExportFile,
    allow_weak: AllowWeak = False,
    allow_displaced: AllowDisplaced = False,
    without: Without = None,
    as_json: Json = False,
) -> None:
    """The offsets with their uncertainty as a table, for spreadsheets."""
    from .experiments.exporters.offsets_csv import csv_text

    _export(
        run, file, allow_weak, allow_displaced, without, as_json, lambda _, calibration: csv_text(calibration)
    )


def _export(
    run: Path,
    file: Path,
    allow_weak: bool,
    allow_displaced: bool,
    without: list[str] | None,
    as_json: bool,
    text: Callable[[Run, Calibration], str],
) -> None:
    """Judge a run, write what may be applied, say what was written."""
    from .experiments.exporters.calibration import calibration
    from .experiments.exporters.offsets_json import document
    from .model.run import read_run
    from .model.whole_file import refuse_existing, write_whole

    refuse_existing(file)
    recorded = read_run(run)
    told = calibration(
        recorded, allow_weak=allow_weak, allow_displaced=allow_displaced, without=without or ()
    )
    write_whole(file, text(recorded, told))
    if as_json:
        _print_json(document(told))
        return
    for line in told.head:
        out.print(line, markup=False, soft_wrap=True)
    out.print(f"Written to {file}", markup=False, soft_wrap=True)


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


def _abb(
    host: str | None,
    port: int,
    egm_port: int,
    sensor_port: int,
    user: str | None,
    password: str | None,
    speed: float,
    yes: bool,
) -> Controller:
    """How the controller is reached and driven; a person is asked before the first motion."""
    import os

    from .experiments.controller.sensor_server import RemoteSensors
    from .experiments.recording import Controller
    from .experiments.rigs.abb import Caution
    from .experiments.rigs.abb_access import find_access

    def confirm(text: str) -> bool:
        return yes or typer.confirm(text, err=True)

    access = find_access(os.environ, host=host, port=port, user=user, password=password)
    caution = Caution(confirm, speed, egm_port)
    return Controller(access, RemoteSensors(access.address, sensor_port), caution)


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
