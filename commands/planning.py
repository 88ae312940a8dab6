"""The commands plan and verify: where to measure, before a calibration and after it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer

from ..experiments.command_options import VerifyOptions
from ..experiments.measuring_options import PlanOptions
from ..model.errors import BadInput
from ..model.options import Option, argument, options_of
from .console import progress, show_answer
from .judging import exit_status_of_plan
from .shared_options import Cluster, Force, Full, Json, Picture, RunFile

PlanKind = Literal["x", "y", "optimal", "verify"]
_PLAN = {"candidates": 0.6, "choice": 0.3, "check": 0.1}
# Options of an optimal plan, and of a pattern alone.
_CONSTRAINTS = ("facing", "acceptance_deg", "beam_mm", "margin_deg", "obstacles")
_OF_PATTERNS = ("distance_mm", "height_mm", "width_mm", "roll_deg")


def plan(
    context: typer.Context,
    kind: Annotated[
        PlanKind, argument("x or y: the paper's patterns; optimal; verify: the acceptance test of a RUN.")
    ],
    file: Annotated[Path, Option("Plan file to write (.yaml).", "-o --out")],
    run: Annotated[Path | None, argument("verify: run file (.jsonl) of the calibration.")] = None,
    *,
    options: PlanOptions,
    force: Force = False,
    as_json: Json = False,
    full: Full = False,
    picture: Picture = None,
    cluster: Cluster,
) -> None:
    """Make a plan: the paper's X- or Y-Pattern, the best of many candidate postures, or to verify a run."""
    header = options.header_file
    if kind == "verify":
        if run is None or header is not None or options.target is not None:
            raise BadInput(
                "plan verify takes a run, and no --header or --target",
                remedy="zerobeam plan verify RUN -o PLAN: robot, tool and target are those of the run",
            )
        _plan_verify(run, file, options.shots, options.tolerance, force, as_json)
    if run is not None or header is None:
        raise BadInput(
            f"plan {kind} takes --header" + (", and no run" if run is not None else ""),
            found=str(run) if run is not None else "no --header",
            remedy=f"zerobeam plan {kind} --header HEADER --target X,Y,Z -o PLAN",
        )
    _require_of_kind(context, kind, options)
    from ..experiments.plans.make import PlanRequest, make_plan
    from ..model.files.measurements import read_header
    from ..model.files.plan import is_plan, read_plan
    from ..model.files.robot_file import robot_path
    from ..model.files.run import header_of_run
    from ..model.files.whole_file import refuse_existing
    from ..reports.plan.check_page import proposal_page

    if header.suffix == ".jsonl":
        shared_header = header_of_run(header)
    else:
        shared_header = read_plan(header).header if is_plan(header) else read_header(header)
    refuse_existing(
        file, force=force, keep=[header, options.obstacles, robot_path(shared_header.robot, header.parent)]
    )
    request = PlanRequest.of(kind, shared_header, header.parent, options)
    with cluster.opened(), progress("plan", _PLAN) as tell:
        try:
            made = make_plan(request, file, tell, force=force)
        except BadInput as error:
            raise error.renamed({one.name: one.flag for one in options_of(PlanOptions)}) from error
    if picture is not None and made.file is not None:
        from ..analysis.observability.aim import aim_plan
        from ..experiments.plans.constraints import check_plan
        from ..reports.plan.plan_page import write_plan_page

        turned = aim_plan(read_plan(made.file))
        write_plan_page(picture, turned, check_plan(turned.plan, turned))
    picture = None if made.file is None else picture
    show_answer(as_json, made, lambda: proposal_page(made, full=full), plan=made.file, picture=picture)
    # No plan within the tolerance is an answer, as a weak verdict is.
    raise typer.Exit(1 if made.checked is None else exit_status_of_plan(made.checked))


def _require_of_kind(context: typer.Context, kind: PlanKind, options: PlanOptions) -> None:
    """BadInput for a constraint that is stated for a pattern, and a pattern's line for an optimal plan."""
    for one in options_of(PlanOptions):
        source = context.get_parameter_source(one.name)
        if source is None or source.name == "DEFAULT":
            continue
        if kind != "optimal" and one.name in _CONSTRAINTS:
            raise BadInput(
                f"plan {kind} does not choose its postures: it takes no {one.flag}",
                remedy="leave it out; the key `constraints` of the plan file has it judged",
            )
        if kind == "optimal" and one.name in _OF_PATTERNS:
            raise BadInput(f"plan optimal has no line: it takes no {one.flag}", remedy="zerobeam plan x or y")


def verify(
    run: RunFile,
    new: Annotated[Path, argument("Run file (.jsonl) of the corrected robot.")],
    *,
    options: VerifyOptions,
    folder: Annotated[Path | None, Option("Folder for the report.", "-o --out")] = None,
    as_json: Json = False,
) -> None:
    """Acceptance test: is the corrected robot what its calibration predicts? Status 1 unless it passes."""
    from ..experiments.acceptance_files import accepted
    from ..model.records import to_json
    from ..reports.acceptance_page import acceptance_page

    if folder is not None:
        from ..reports.acceptance_page import ACCEPTANCE, write_acceptance_report
        from ..reports.output.whole_folder import check_target

        check_target(folder, ACCEPTANCE)
    verified = accepted(run, new, _enough(options.tolerance))
    if folder is not None:
        write_acceptance_report(folder, verified)
    page = None if folder is None else folder / "verification.html"
    show_answer(as_json, to_json(verified), lambda: acceptance_page(verified).brief, report=page)
    raise typer.Exit(0 if verified.verdict == "pass" else 1)


def _plan_verify(
    run: Path, file: Path, shots: int | None, tolerance: float | None, force: bool, as_json: bool
) -> NoReturn:
    """Write the plan of the acceptance test, and say what it would notice."""
    from ..experiments.acceptance_files import write_acceptance_plan
    from ..model.records import to_json
    from ..reports.acceptance_page import acceptance_plan_page

    made = write_acceptance_plan(run, file, shots, _enough(tolerance), force=force)
    show_answer(as_json, to_json(made), lambda: acceptance_plan_page(made, made.vendor), plan=file)
    raise typer.Exit(0 if made.enough else 1)


def _enough(tolerance: float | None) -> float | None:
    if tolerance is not None and not 0 < tolerance <= 1e6:
        raise BadInput("--tolerance is out of range", found=f"{tolerance:g}", allowed="a number above 0")
    return tolerance
