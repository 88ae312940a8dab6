"""`zerobeam study`: studies over simulated runs."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from ..model.errors import WorkersLost
from ..model.options import Option, Seed, argument, arguments, options_of
from ..model.parsing.reading import real_path
from .console import err, progress, say, show_answer
from .shared_options import Cluster, Json, with_options

if TYPE_CHECKING:
    from ..experiments.studies.answer import StudyAnswer
    from ..experiments.studies.cases import Engine

studies = typer.Typer(
    help="Studies over simulated runs: coverage, and the effect of each setting.", no_args_is_help=True
)

Study = Callable[["Engine"], "StudyAnswer"]
Settings = Callable[..., Study]

Camera = Annotated[bool, Option("Find the PSD in pictures, or by the beam alone.", "--camera/--no-camera")]
StudyFolder = Annotated[Path, Option("Folder for the study.", "-o --out")]


def _carry_out(
    settings: Callable[[], Study], folder: Path, *, seed: Seed = 0, as_json: Json = False, cluster: Cluster
) -> NoReturn:
    """Carry a study out, write it, print it; the exit status says whether it agrees.

    Its options are those of every study. Finished cases are kept next to the folder, which is written whole
    or not at all, to go on with; once the study is written they are no longer needed.
    """
    from ..experiments.studies.cases import Engine, any_kept
    from ..reports.output.whole_folder import check_target
    from ..reports.studies.study_pages import study_kind, study_page, write_study

    work, study = cluster.opened(), settings()
    store = Path(f"{real_path(folder)}.cases.jsonl")
    check_target(folder, study_kind(folder))
    try:
        with work, progress("study") as tell:
            began = time.perf_counter()
            answer = study(Engine(seed, tell, store))
            answer = replace(answer, seconds=time.perf_counter() - began)
            tell("writing", 1.0)
            paths = write_study(folder, answer)
    except (KeyboardInterrupt, WorkersLost):
        if any_kept(store):
            say(f"The finished cases are kept in {store}: the same command goes on with them.", to=err)
        raise
    store.unlink(missing_ok=True)
    show_answer(as_json, answer, lambda: study_page(answer).brief, study=paths.html)
    raise typer.Exit(0 if answer.agrees else 1)


def _command(name: str, about: str | None = None) -> Callable[[Settings], Settings]:
    """Make a command of a function that returns the study with the settings that are its options."""

    def made(settings: Settings) -> Settings:
        def command(folder: StudyFolder, **typed: Any) -> None:
            chosen = {one.name: typed.pop(one.name) for one in options_of(settings)}
            _carry_out(partial(settings, **chosen), folder, **arguments(_carry_out, typed))

        studies.command(name, help=about or settings.__doc__)(with_options(command, settings, _carry_out))
        return settings

    return made


@_command("coverage")
def study_coverage(
    data_sets: Annotated[int, Option("Simulated runs of each plan.", least=100)] = 1000,
) -> Study:
    """Coverage of the intervals: simulated runs with known offsets, solved again."""
    from ..experiments.studies.coverage import coverage_study

    return partial(coverage_study, data_sets)


@_command("cell")
def study_cell(
    runs: Annotated[int, Option("Simulated runs of each plan.", least=20)] = 200, camera: Camera = True
) -> Study:
    """Coverage through the whole chain: runs in the simulated cell, from plan to offsets."""
    from ..experiments.studies.cell import cell_study

    return partial(cell_study, runs, camera=camera)


@_command("geometry")
def study_geometry(arms: Annotated[int, Option("Simulated arms for each plan.", least=20)] = 200) -> Study:
    """Coverage for arms that deviate from nominal geometry: taken as nominal against estimated."""
    from ..experiments.studies.geometry_coverage import geometry_study

    return partial(geometry_study, arms)


@_command("drift")
def study_drift(arms: Annotated[int, Option("Simulated arms.", least=20)] = 500) -> Study:
    """Intervals, false alarms and power of `history drift`: arms with known walks and jumps."""
    from ..experiments.studies.drift_coverage import drift_study

    return partial(drift_study, arms)


@_command("wrong-models")
def study_wrong_models(
    arms: Annotated[int, Option("Simulated arms for each scenario.", least=2)] = 40,
) -> Study:
    """What an answer says when something is wrong: verdicts, errors and causes of many wrong models."""
    from ..experiments.studies.wrong_models import wrong_models_study

    return partial(wrong_models_study, arms)


@_command("instruments")
def study_instruments(
    setups: Annotated[Path | None, Option("Setups file (.yaml) of your own instruments.")] = None,
) -> Study:
    """Which instrument, and how many measurements? u and TCP error against number, time and cost."""
    from ..experiments.studies.instrument_choice import instruments_study

    return partial(instruments_study, setups)


@_command("table2")
def study_table2() -> Study:
    """What joint noise would make three runs scatter as those of the paper's Table 2?"""
    from ..experiments.studies.table2 import table2_study

    return table2_study


Runs = Annotated[
    int | None,
    Option("Simulated runs of each case, instead of the file's; 0: prediction only.", least=0, most=100_000),
]


def _built_in(name: str, question: str) -> None:
    """Make a command of a study file that comes with the package."""

    @_command(name, question)
    def study(runs: Runs = None) -> Study:
        from ..experiments.studies.sweeps.study_file import built_in_study

        return _sweep(built_in_study(name), runs)


_built_in("patterns", "X-Pattern, Y-Pattern or optimal plan, and which Y-Pattern of 576?")
_built_in("noise", "How precise must joint and spot readings be?")
_built_in("shots", "How many measurements are enough?")
_built_in("cost", "The paper's midpoint cost, or the likelihood?")
_built_in("tool", "Must the tool be calibrated first?")
_built_in("psd-position", "Where to place the PSD?")
_built_in("robots", "Does the method work on other arms?")


@_command("file")
def study_file(file: Annotated[Path, argument("Study file (.yaml).")], runs: Runs = None) -> Study:
    """A study of your own, from a file: the settings, and what changes from case to case."""
    return _sweep(file, runs)


def _sweep(file: Path, runs: int | None) -> Study:
    from ..experiments.studies.sweeps.study_file import read_study
    from ..experiments.studies.sweeps.sweep import sweep

    return partial(sweep, read_study(file, runs))
