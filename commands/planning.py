"""The commands plan and verify: where to measure, before a calibration and after it."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from ..model.errors import BadInput
from .console import EXIT_STATUS, out, print_json, print_picture, progress, say
from .options import Force, Json, Picture, RunFile, Scheduler, Seed, Workers, cluster_of

if TYPE_CHECKING:
    from ..experiments.plans.make import Portion


class PlanKind(StrEnum):
    """How a plan is made: the paper's two patterns, or the best of many candidates."""

    X = "x"
    Y = "y"
    OPTIMAL = "optimal"
    VERIFY = "verify"


class CriterionName(StrEnum):
    """What an optimal plan minimises: mean, generalised or largest variance of the offsets."""

    A = "A"
    D = "D"
    E = "E"


_FARTHEST = 1e6  # mm, as in files
_PLAN = {"candidates": 0.6, "choice": 0.3, "check": 0.1}
_OPTIONS = {
    "target": "--target",
    "measure": "--measure",
    "tolerance": "--tolerance",
    "facing": "--facing",
    "acceptance_deg": "--acceptance",
    "beam_mm": "--beam",
}
_CONSTRAINTS = ("facing", "acceptance", "beam", "margin", "obstacles")  # options of an optimal plan


def plan(
    context: typer.Context,
    kind: Annotated[
        PlanKind,
        typer.Argument(
            help="x or y: the paper's patterns; optimal; verify: the acceptance test of a RUN.",
            show_default=False,
        ),
    ],
    file: Annotated[
        Path, typer.Option("-o", "--out", help="Plan file to write (.yaml).", show_default=False)
    ],
    run: Annotated[
        Path | None, typer.Argument(help="verify: run file (.jsonl) of the calibration.", show_default=False)
    ] = None,
    header: Annotated[
        Path | None,
        typer.Option(
            help="Header file (.yaml): robot, tool, noise; or a run file (.jsonl). Not for verify.",
            show_default=False,
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            help="Position of the target: X,Y,Z in mm, base frame; default: the header's. Not for verify.",
            show_default=False,
        ),
    ] = None,
    shots: Annotated[
        int | None,
        typer.Option(
            min=2,
            max=10_000,
            help="Number of measurements. Default: 20 (x, y and geometry: exact 7; verify: as few as the test"
            " needs).",
            show_default=False,
        ),
    ] = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[@TARGET,…]=COUNT",
            help="optimal: how many measurements an instrument of the header makes (of which targets); for"
            " each of several.",
            show_default=False,
        ),
    ] = None,
    candidates: Annotated[
        int, typer.Option(min=10, max=1_000_000, help="Candidate postures to choose from.")
    ] = 10_000,
    criterion: Annotated[CriterionName, typer.Option(help="Criterion of an optimal plan.")] = CriterionName.A,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Take the fewest measurements that reach this standard uncertainty (deg; mm) and detect"
            " wrong models.",
            show_default=False,
        ),
    ] = None,
    max_shots: Annotated[
        int, typer.Option(min=2, max=10_000, help="With --tolerance: the most measurements.")
    ] = 30,
    facing: Annotated[
        str, typer.Option(help="Outward normal of the target's face: X,Y,Z, or any.")
    ] = "0,0,1",
    acceptance: Annotated[
        float, typer.Option(help="Largest angle between the beam and that normal, deg.")
    ] = 60.0,
    beam: Annotated[str, typer.Option(help="Shortest and longest beam, mm: MIN,MAX.")] = "200,2000",
    margin: Annotated[float, typer.Option(min=0, help="Distance kept from every joint limit, deg.")] = 5.0,
    distance: Annotated[
        float | None,
        typer.Option(
            help="x, y: of the middle of the pattern's line before the base's z axis, mm.", show_default=False
        ),
    ] = None,
    height: Annotated[
        float | None,
        typer.Option(help="x, y: of the pattern's line over the target, mm.", show_default=False),
    ] = None,
    width: Annotated[
        float | None,
        typer.Option(min=0, help="x, y: length of the pattern's line, mm.", show_default=False),
    ] = None,
    roll: Annotated[
        float | None,
        typer.Option(
            help="x, y: rotation of the flange about the beams, deg; 0: b1 along the line.",
            show_default=False,
        ),
    ] = None,
    obstacles: Annotated[
        Path | None, typer.Option(help="Obstacles file (.yaml): floor, boxes.", show_default=False)
    ] = None,
    seed: Seed = 0,
    force: Force = False,
    as_json: Json = False,
    picture: Picture = None,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Make a plan: the paper's X- or Y-Pattern, the best of many candidate postures, or to verify a run."""
    if kind is PlanKind.VERIFY:
        if run is None or header is not None or target is not None:
            raise BadInput(
                "plan verify takes a run, and no --header or --target",
                remedy="zerobeam plan verify RUN -o PLAN: robot, tool and target are those of the run",
            )
        _plan_verify(run, file, shots, tolerance, force, as_json)
    if run is not None or header is None:
        raise BadInput(
            f"plan {kind.value} takes --header" + (", and no run" if run is not None else ""),
            found=str(run) if run is not None else "no --header",
            remedy=f"zerobeam plan {kind.value} --header HEADER --target X,Y,Z -o PLAN",
        )
    line = {"distance": distance, "height": height, "width": width, "roll": roll}
    if kind is not PlanKind.OPTIMAL:
        _refuse_constraints(context, kind)
    elif of_pattern := [name for name, value in line.items() if value is not None]:
        raise BadInput(
            f"plan optimal has no line: it takes no --{of_pattern[0]}", remedy="zerobeam plan x or y"
        )
    from ..experiments.plans.make import PlanRequest, make_plan
    from ..experiments.plans.obstacles import read_obstacles
    from ..experiments.plans.patterns import Line
    from ..model.files.header_file import read_header
    from ..model.files.plan import is_plan, read_plan
    from ..model.files.plan_file import Obstacles
    from ..model.files.robot_file import robot_path
    from ..model.files.run import header_of_run
    from ..model.files.whole_file import refuse_existing
    from ..reports.terminal.answers import print_proposal

    if header.suffix == ".jsonl":
        shared_header = header_of_run(header)
    else:
        shared_header = read_plan(header).header if is_plan(header) else read_header(header)
    refuse_existing(
        file, force=force, keep=[header, obstacles, robot_path(shared_header.robot, header.parent)]
    )
    request = PlanRequest(
        kind="x" if kind is PlanKind.X else "y" if kind is PlanKind.Y else "optimal",
        header=shared_header,
        header_folder=header.parent,
        target=None if target is None else _numbers(target, 3, "--target"),
        shots=shots,
        measure=_measure(measure or []),
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
        line=Line(distance, height, width, None if roll is None else radians(roll)),
    )
    with cluster_of(workers, scheduler), progress("plan", _PLAN) as tell:
        try:
            made = make_plan(request, file, tell, force=force)
        except BadInput as error:
            raise error.renamed(_OPTIONS) from error
    if picture is not None and made.file is not None:
        from ..analysis.observability.aim import aim_plan
        from ..experiments.plans.constraints import check_plan
        from ..reports.plan.plan_page import write_plan_page

        turned = aim_plan(read_plan(made.file))
        write_plan_page(picture, turned, check_plan(turned.plan, turned))
    if as_json:
        print_json(made.as_json())
    else:
        print_proposal(out, made)
        if made.file is not None:
            say(f"Plan: {made.file}")
            print_picture(picture)
    # No plan within the tolerance is an answer, as a weak verdict is.
    raise typer.Exit(1 if made.checked is None else EXIT_STATUS[made.checked.verdict])


def _refuse_constraints(context: typer.Context, kind: PlanKind) -> None:
    """BadInput for a constraint of optimal plans that is stated for a pattern, which is not chosen by it."""
    for name in _CONSTRAINTS:
        source = context.get_parameter_source(name)
        if source is not None and source.name != "DEFAULT":
            raise BadInput(
                f"plan {kind.value} does not choose its postures: it takes no --{name}",
                remedy="leave it out; the key `constraints` of the plan file has it judged",
            )


def verify(
    run: RunFile,
    new: Annotated[
        Path, typer.Argument(help="Run file (.jsonl) of the corrected robot.", show_default=False)
    ],
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="The error of an offset that must be noticed (deg; mm). Default: the header's tolerance.",
            show_default=False,
        ),
    ] = None,
    folder: Annotated[
        Path | None, typer.Option("-o", "--out", help="Folder for the report.", show_default=False)
    ] = None,
    as_json: Json = False,
) -> None:
    """Acceptance test: is the corrected robot what its calibration predicts? Status 1 unless it passes."""
    from ..experiments.verification import acceptance_json, accepted
    from ..reports.terminal.acceptance import print_acceptance

    if folder is not None:
        from ..reports.verification.verification_folder import check_target, write_verification_report

        check_target(folder)
    verified = accepted(run, new, _enough(tolerance))
    if folder is not None:
        write_verification_report(folder, verified)
    if as_json:
        print_json(acceptance_json(verified))
    else:
        print_acceptance(out, verified)
        if folder is not None:
            say(f"Report: {folder / 'verification.html'}")
    raise typer.Exit(0 if verified.answer.verdict == "pass" else 1)


def _plan_verify(
    run: Path, file: Path, shots: int | None, tolerance: float | None, force: bool, as_json: bool
) -> NoReturn:
    """Write the plan of the acceptance test, and say what it would notice."""
    from ..experiments.verification import plan_json, write_verification
    from ..reports.terminal.acceptance import print_verification

    made = write_verification(run, file, shots, _enough(tolerance), force=force)
    if as_json:
        print_json(plan_json(made))
    else:
        print_verification(out, made.plan, made.vendor)
        say(f"Plan: {file}")
    raise typer.Exit(0 if made.plan.enough else 1)


def _enough(tolerance: float | None) -> float | None:
    if tolerance is not None and not 0 < tolerance <= 1e6:
        raise BadInput("--tolerance is out of range", found=f"{tolerance:g}", allowed="a number above 0")
    return tolerance


def _measure(texts: Sequence[str]) -> dict[str, Portion]:
    """NAME[@TARGET,…]=COUNT of each instrument."""
    from ..experiments.plans.make import Portion

    shares: dict[str, Portion] = {}
    for text in texts:
        name, _, count = text.rpartition("=")
        label, _, targets = name.partition("@")
        if not label or not count.isdecimal() or not 1 <= int(count) <= 10_000 or label in shares:
            raise BadInput(
                "--measure is not understood",
                found=text,
                allowed="NAME=COUNT or NAME@TARGET,…=COUNT, once for each instrument, COUNT from 1 to 10000",
            )
        shares[label] = Portion(int(count), tuple(part for part in targets.split(",") if part))
    return shares


def _numbers(text: str, count: int, option: str) -> tuple[float, ...]:
    """`count` finite numbers, separated by commas."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(-_FARTHEST <= value <= _FARTHEST for value in values):
        raise BadInput(
            f"{option} is not understood",
            found=text,
            allowed=f"{count} numbers up to {_FARTHEST:g} separated by commas",
        )
    return values
