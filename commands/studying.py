"""`zerobeam study`: studies over simulated runs."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from ..model.errors import WorkersLost
from .console import err, out, print_json, progress, say
from .options import Camera, Json, Scheduler, Seed, Workers, cluster_of

if TYPE_CHECKING:
    from ..experiments.studies.answer import StudyAnswer
    from ..model.arrays import Progress

studies = typer.Typer(
    help="Studies over simulated runs: coverage, and the effect of each setting.", no_args_is_help=True
)

Cluster = AbstractContextManager[object]

StudyFolder = Annotated[Path, typer.Option("-o", "--out", help="Folder for the study.", show_default=False)]


@studies.command("coverage")
def study_coverage(
    folder: StudyFolder,
    data_sets: Annotated[int, typer.Option(min=100, help="Simulated runs of each plan.")] = 1000,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Coverage of the intervals: simulated runs with known offsets, solved again."""
    from ..experiments.studies.coverage import coverage_study

    cluster = cluster_of(workers, scheduler)
    _study(folder, as_json, cluster, lambda tell, store: coverage_study(data_sets, seed, tell, store=store))


@studies.command("cell")
def study_cell(
    folder: StudyFolder,
    runs: Annotated[int, typer.Option(min=20, help="Simulated runs of each plan.")] = 200,
    camera: Camera = True,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Coverage through the whole chain: runs in the simulated cell, from plan to offsets."""
    from ..experiments.studies.cell import cell_study

    cluster = cluster_of(workers, scheduler)

    def studied(tell: Progress, store: Path) -> StudyAnswer:
        return cell_study(runs, seed, tell, camera=camera, store=store)

    _study(folder, as_json, cluster, studied)


@studies.command("geometry")
def study_geometry(
    folder: StudyFolder,
    arms: Annotated[int, typer.Option(min=20, help="Simulated arms for each plan.")] = 200,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Coverage for arms that deviate from nominal geometry: taken as nominal against estimated."""
    from ..experiments.studies.geometry import geometry_study

    cluster = cluster_of(workers, scheduler)
    _study(folder, as_json, cluster, lambda tell, store: geometry_study(arms, seed, tell, store=store))


@studies.command("drift")
def study_drift(
    folder: StudyFolder,
    arms: Annotated[int, typer.Option(min=20, help="Simulated arms.")] = 500,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """Intervals, false alarms and power of `history drift`: arms with known walks and jumps."""
    from ..experiments.studies.drift import drift_study

    cluster = cluster_of(workers, scheduler)
    _study(folder, as_json, cluster, lambda tell, store: drift_study(arms, seed, tell, store=store))


@studies.command("table2")
def study_table2(
    folder: StudyFolder,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """What joint noise would make three runs scatter as those of the paper's Table 2?"""
    from ..experiments.studies.table2 import table2_study

    cluster = cluster_of(workers, scheduler)
    _study(folder, as_json, cluster, lambda tell, store: table2_study(seed, tell, store=store))


Runs = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=100_000,
        help="Simulated runs of each case, instead of the file's; 0: prediction only.",
        show_default=False,
    ),
]


def _built_in(name: str, question: str) -> None:
    """Make a command of a study file that comes with the package."""

    def study(
        folder: StudyFolder,
        runs: Runs = None,
        seed: Seed = 0,
        as_json: Json = False,
        workers: Workers = None,
        scheduler: Scheduler = None,
    ) -> None:
        from ..experiments.studies.sweeps.study_file import built_in_study

        _sweep(built_in_study(name), folder, runs, seed, as_json, cluster_of(workers, scheduler))

    studies.command(name, help=question)(study)


_built_in("patterns", "X-Pattern, Y-Pattern or optimal plan, with the PSD at many positions in the cell?")
_built_in("noise", "How precise must joint and spot readings be?")
_built_in("shots", "How many measurements are enough?")
_built_in("cost", "The paper's midpoint cost, or the likelihood?")
_built_in("tool", "Must the tool be calibrated first?")
_built_in("psd-position", "Where to place the PSD?")
_built_in("robots", "Does the method work on other arms?")


@studies.command("file")
def study_file(
    file: Annotated[Path, typer.Argument(help="Study file (.yaml).", show_default=False)],
    folder: StudyFolder,
    runs: Runs = None,
    seed: Seed = 0,
    as_json: Json = False,
    workers: Workers = None,
    scheduler: Scheduler = None,
) -> None:
    """A study of your own, from a file: the settings, and what changes from case to case."""
    _sweep(file, folder, runs, seed, as_json, cluster_of(workers, scheduler))


def _sweep(
    file: Path, folder: Path, runs: int | None, seed: int, as_json: bool, cluster: Cluster
) -> NoReturn:
    from ..experiments.studies.sweeps.study_file import read_study
    from ..experiments.studies.sweeps.sweep import sweep

    study = read_study(file, runs)
    _study(folder, as_json, cluster, lambda tell, store: sweep(study, seed, tell, store=store))


def _study(
    folder: Path,
    as_json: bool,
    cluster: Cluster,
    studied: Callable[[Progress, Path], StudyAnswer],
) -> NoReturn:
    """Carry a study out, write it, print it; the exit status says whether it agrees.

    Finished cases are kept next to the folder, which is written whole or not at all, to go on with; once the
    study is written they are no longer needed.
    """
    from ..experiments.studies.answer import to_json
    from ..reports.studies.study_folder import check_target, write_study
    from ..reports.studies.study_terminal import print_study

    store = Path(f"{folder.resolve()}.cases.jsonl")
    check_target(folder)
    try:
        with cluster, progress("study") as tell:
            answer = studied(tell, store)
            tell("writing", 1.0)
            paths = write_study(folder, answer)
    except (KeyboardInterrupt, WorkersLost):
        if store.exists():
            say(f"The finished cases are kept in {store}: the same command goes on with them.", to=err)
        raise
    store.unlink(missing_ok=True)
    if as_json:
        print_json(to_json(answer))
    else:
        print_study(out, answer)
        say(f"Study: {paths.html}")
    raise typer.Exit(0 if answer.agrees else 1)
