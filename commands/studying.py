"""`zerobeam study`: studies over simulated runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from .console import out, print_json, progress, stoppable
from .options import Camera, Json, Seed

studies = typer.Typer(
    help="Does zerobeam hold what it promises? Studies over simulated runs.", no_args_is_help=True
)

StudyFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)]


@studies.command("coverage")
def study_coverage(
    folder: StudyFolder,
    data_sets: Annotated[int, typer.Option(min=100, help="Simulated runs of each plan.")] = 1000,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Do the intervals hold the truth as often as they promise? Simulated runs, solved again, tell."""
    from ..experiments.coverage import coverage_study

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
    from ..experiments.cell_study import cell_study

    _study(folder, as_json, lambda told: cell_study(runs, seed, told, camera=camera))


@studies.command("table2")
def study_table2(
    folder: StudyFolder,
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """What joint noise would make three runs scatter as those of the paper's Table 2 did?"""
    from ..experiments.table2 import table2_study

    _study(folder, as_json, lambda told: table2_study(seed, told))


def _study(
    folder: Path, as_json: bool, studied: Callable[[Callable[[str, float], None]], dict[str, Any]]
) -> NoReturn:
    """Carry a study out, write it, print it; the status says whether it agrees."""
    from ..reports.study_page import check_target, write_study
    from ..reports.study_terminal import print_study

    check_target(folder)
    with stoppable(), progress("study") as told:
        answer = studied(told)
        told("writing", 1.0)
        paths = write_study(folder, answer)
    if as_json:
        print_json(answer)
    else:
        print_study(out, answer)
        out.print(f"Study: {paths.html}", soft_wrap=True, markup=False)
    raise typer.Exit(0 if answer["agrees"] else 1)
