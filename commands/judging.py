"""The commands that check plans, and that analyse, report, compare and batch runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..experiments.command_options import BatchSettings, CompareOptions
from ..experiments.demos import demo_runs
from ..model.errors import BadInput, WorkersLost
from ..model.options import AnalyseOptions, Option, argument
from .console import EXIT_STATUS, FAULT, err, out, print_json, progress, say, show_answer
from .shared_options import Cluster, Full, Json, Picture, PlanFile, RunFile

if TYPE_CHECKING:
    from ..analysis.analyse import Analysis
    from ..analysis.answer.result import Result
    from ..analysis.observability.check import Check
    from ..model.files.run import Run


# Stages with their parts of the time, for the bar.
_ANALYSE = {"fit": 0.25, "identifiability": 0.01, "posterior": 0.6, "diagnostics": 0.14}
_REPORT = {**_ANALYSE, "writing": 0.5}


def demo(
    folder: Annotated[Path, Option("Folder for the reports.", "-o --out")] = Path("zerobeam-demo"),
) -> None:
    """Analyse four built-in runs: varied postures, an X- and a Y-Pattern, an uncalibrated tool."""
    from ..model.files.run import read_run
    from ..reports.output.terminal import print_blocks
    from ..reports.output.whole_folder import check_target
    from ..reports.run.brief_page import side_by_side
    from ..reports.run.report import REPORT, write_report
    from ..words.message import message
    from ..words.wording import capital

    cases = demo_runs()
    for case in cases:
        check_target(folder / case.name, REPORT)
    answers = []
    for case in cases:
        with progress(case.title, _ANALYSE) as tell:
            analysis = _analysed(read_run(case.path), AnalyseOptions(), tell)
        write_report(folder / case.name, analysis.result, analysis.draws)
        answers.append(analysis.result)
    print_blocks(out, [side_by_side([case.title for case in cases], answers)])
    for case, answer in zip(cases, answers, strict=True):
        out.print(f"\n[bold]{capital(case.title)}[/bold], {case.about}.")
        say(message(answer).verdict)
        say(f"Report: {folder / case.name / 'report.html'}")


def check(plan: PlanFile, as_json: Json = False, full: Full = False, picture: Picture = None) -> None:
    """Predict which offsets a plan identifies, and how precisely, before any measurement."""
    from ..analysis.observability.aim import aim_plan
    from ..experiments.plans.constraints import check_plan
    from ..model.files.plan import read_plan
    from ..reports.plan.check_page import check_page

    planned = read_plan(plan)
    turned = aim_plan(planned)
    checked = check_plan(planned, turned)
    if picture is not None:
        from ..reports.plan.plan_page import write_plan_page

        write_plan_page(picture, turned, checked)
    typed = replace(checked, inputs=replace(checked.inputs, plan=plan.as_posix()))
    show_answer(as_json, checked, lambda: check_page(typed, full=full), picture=picture)
    raise typer.Exit(exit_status_of_plan(checked))


def analyse(
    run: RunFile,
    as_json: Json = False,
    full: Full = False,
    *,
    options: AnalyseOptions,
    save: Annotated[
        Path | None, Option("With --drop: write the run without them to this new file (.jsonl).")
    ] = None,
) -> None:
    """Estimate the offsets of a run, with their uncertainty and identifiability."""
    from ..reports.run.brief_page import brief_page, front_page

    recorded = _recorded(run, options.drop)
    if save is not None:
        if not options.drop:
            raise BadInput("--save without --drop: the run is in its file already", remedy="state --drop")
        recorded = recorded.saved(save)
    with progress("analyse", _ANALYSE) as tell:
        analysis = _analysed(recorded, options, tell)
    typed = _where_the_person_stands(analysis.result, save or run)
    show_answer(as_json, analysis.result, lambda: (brief_page if full else front_page)(typed))
    raise typer.Exit(exit_status_of(analysis))


def report(
    run: RunFile,
    folder: Annotated[Path, Option("Folder for the report.", "-o --out")],
    as_json: Json = False,
    full: Full = False,
    *,
    options: AnalyseOptions,
) -> None:
    """Write the report of a run: report.html, report.pdf, result.json, posterior.nc and the figures."""
    from ..reports.output.whole_folder import check_target
    from ..reports.run.brief_page import brief_page, front_page
    from ..reports.run.report import REPORT, write_report

    recorded = _recorded(run, options.drop)
    check_target(folder, REPORT)
    with progress("report", _REPORT) as tell:
        analysis = _analysed(recorded, options, tell)
        tell("writing", 0.0)
        paths = write_report(folder, analysis.result, analysis.draws)
        tell("writing", 1.0)
    typed = _where_the_person_stands(analysis.result, run)
    show_answer(
        as_json, analysis.result, lambda: (brief_page if full else front_page)(typed), report=paths.html
    )
    raise typer.Exit(exit_status_of(analysis))


def compare(
    runs: Annotated[
        list[Path],
        argument(
            "Run files (.jsonl) or results (.json), two at least; or one table of offsets (.csv).",
            metavar="RUN...",
        ),
    ],
    folder: Annotated[Path | None, Option("Folder for the comparison.", "-o --out")] = None,
    as_json: Json = False,
    *,
    options: CompareOptions,
) -> None:
    """Do repeated runs agree? Their scatter against the prediction, drift, and an outlying run."""
    from ..analysis.repeatability.compare import compare as compare_runs
    from ..reports.comparison_page import COMPARISON, comparison_page, write_comparison
    from ..reports.output.whole_folder import check_target

    if folder is not None:
        check_target(folder, COMPARISON)
    with progress("compare") as tell:
        comparison = compare_runs(runs, seed=options.seed, progress=tell)
        if folder is not None:
            tell("writing", 1.0)
            write_comparison(folder, comparison)
    page = None if folder is None else folder / "compare.html"
    show_answer(as_json, comparison, lambda: comparison_page(comparison).brief, comparison=page)
    if comparison.failed:
        raise typer.Exit(FAULT)
    raise typer.Exit(0 if comparison.verdict == "agrees" else 1)


def schema(
    name: Annotated[
        str | None,
        argument("Name of the schema, as plan, run-header, result or check."),
    ] = None,
) -> None:
    """Print the JSON Schema of a file (without a name: which there are)."""
    from ..experiments.schema import SCHEMA_NAMES, json_schema

    if name is None:
        say("\n".join(SCHEMA_NAMES))
        return
    if name not in SCHEMA_NAMES:
        raise BadInput("there is no schema of that name", found=name, allowed=", ".join(SCHEMA_NAMES))
    print_json(json_schema(name))


def _recorded(path: Path, drop: list[str] | None) -> Run:
    """The run of a file, without the measurements that are named."""
    from ..model.files.run import read_run

    run = read_run(path)
    return run.without(run.numbers_of(drop)) if drop else run


def _where_the_person_stands(result: Result, path: Path) -> Result:
    """The result with its run named as it was typed, so that printed commands work in this folder; a run that
    is in no file is named as one beside it."""
    from ..model.files.run import in_no_file

    typed = path.with_name(result.inputs.run) if in_no_file(result.inputs.run) else path
    return replace(result, inputs=replace(result.inputs, run=typed.as_posix()))


def _analysed(recorded: Run, options: AnalyseOptions, tell: Callable[[str, float], None]) -> Analysis:
    from ..analysis.analyse import analyse as judge

    held_out = _held_out(options.hold_out or [])
    return judge(
        recorded, seed=options.seed, ess=options.ess, robust=options.robust, held_out=held_out, progress=tell
    )


def _held_out(values: list[str]) -> list[str] | Run:
    """The names of placements, or the run of the one file among the values."""
    from ..model.files.run import is_run_name, read_run

    files = [value for value in values if is_run_name(value)]
    if not files:
        return values
    if len(values) > 1:
        raise BadInput(
            "a run can be held out alone only",
            found=", ".join(values),
            allowed="names of placements, or one run file (.jsonl)",
            remedy="state --hold-out FILE once, and analyse again for the others",
        )
    return read_run(files[0])


def exit_status_of_plan(check: Check) -> int:
    """By its verdict; 1 too where what is required is predicted not to be met."""
    return max(EXIT_STATUS[check.verdict], int(check.falls_short))


def exit_status_of(analysis: Analysis) -> int:
    """By its verdict; 1 too for a pass that something speaks against, so that nothing is to be entered, and
    for a robot that does not meet, or may not meet, what is required of it."""
    from ..words.case import RunCase
    from ..words.message import contradicted, message

    if not analysis.converged:
        return FAULT
    failed = contradicted(analysis.verdict, message(analysis.result))
    failed |= RunCase.of_result(analysis.result).falls_short
    return max(EXIT_STATUS[analysis.verdict], int(failed))


def batch(
    runs: Annotated[list[Path], argument("Run files (.jsonl), or folders of them.", metavar="RUN...")],
    folder: Annotated[Path, Option("Folder for the results.", "-o --out")],
    pattern: Annotated[
        str, Option("Which files of a folder are runs.", "--glob", metavar="PATTERN")
    ] = "**/*.jsonl",
    parquet: Annotated[bool, Option("Write the tables as Parquet, too.")] = False,
    as_json: Json = False,
    *,
    settings: BatchSettings,
    cluster: Cluster,
) -> None:
    """Solve many runs: results, reports if asked, tables, and one page over all."""
    from ..experiments.batch import run_files
    from ..experiments.studies.cases import any_kept
    from ..reports.batch_page import batch_page, require_parquet
    from ..reports.carried_out import STORE, check_target
    from ..reports.carried_out import batch as carry_out

    if parquet:
        require_parquet()
    check_target(folder)
    files = run_files(runs, pattern, folder)
    try:
        with cluster.opened(), progress("batch") as tell:
            done = carry_out(files, folder, settings, tell, parquet=parquet)
    except (KeyboardInterrupt, WorkersLost):
        if any_kept(folder / STORE):
            kept = f"The finished runs are kept in {folder}: the same command goes on with them."
            say(kept, to=err)
        raise
    show_answer(as_json, done, lambda: batch_page(done).brief, page=folder / "batch.html")
    raise typer.Exit(0 if done.passed else 1)
