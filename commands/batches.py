"""`zerobeam batch`: many runs solved at once."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..model.errors import WorkersLost
from .console import err, out, print_json, progress
from .options import Json, Scheduler, Seed, Workers, asked_cluster

if TYPE_CHECKING:
    from ..analysis.analyse import Sampling


_SAMPLING: dict[bool | None, Sampling] = {None: "where needed", True: "always", False: "never"}


def batch(
    runs: Annotated[
        list[Path],
        typer.Argument(help="Run files (.jsonl), or folders of them.", metavar="RUN...", show_default=False),
    ],
    folder: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.", show_default=False)],
    pattern: Annotated[
        str, typer.Option("--glob", help="Which files of a folder are runs.", metavar="PATTERN")
    ] = "**/*.jsonl",
    report: Annotated[bool, typer.Option("--report", help="Write the report of each run, too.")] = False,
    posterior: Annotated[
        bool | None,
        typer.Option(
            "--posterior/--no-posterior",
            help="Sample the posterior of every run, or of none; by default where the curvature at the mode"
            " does not describe it.",
            show_default=False,
        ),
    ] = None,
    parquet: Annotated[bool, typer.Option("--parquet", help="Write the tables as Parquet, too.")] = False,
    as_json: Json = False,
    seed: Seed = 0,
    workers: Workers = None,
    scheduler: Scheduler = None,
    ess: Annotated[
        float,
        typer.Option(min=100, max=1e5, help="Effective sample size of the posteriors, for every parameter."),
    ] = 1000.0,
) -> None:
    """Solve many runs: results, reports if asked, tables, and one page over all."""
    from ..experiments.batch.rows import BatchSettings
    from ..experiments.batch.run_files import run_files
    from ..reports.batch.batch_folder import batch_json, require_parquet
    from ..reports.batch.batch_terminal import print_batch
    from ..reports.batch.carried_out import STORE, check_target
    from ..reports.batch.carried_out import batch as carry_out

    if parquet:
        require_parquet()
    check_target(folder)
    files = run_files(runs, pattern, folder)
    sampling = _SAMPLING[posterior]
    settings = BatchSettings(seed=seed, ess=ess, sampling=sampling, report=report)
    try:
        with asked_cluster(workers, scheduler), progress("batch") as tell:
            done = carry_out(files, folder, settings, tell, parquet=parquet)
    except (KeyboardInterrupt, WorkersLost):
        if (folder / STORE).exists():
            kept = f"The finished runs are kept in {folder}: the same command goes on with them."
            err.print(kept, markup=False, soft_wrap=True)
        raise
    if as_json:
        print_json(batch_json(done))
    else:
        print_batch(out, done)
        out.print(f"Page: {folder / 'batch.html'}", soft_wrap=True, markup=False)
    raise typer.Exit(0 if done.passed else 1)
