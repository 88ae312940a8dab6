"""Options and arguments that several commands share."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from ..model.errors import BadInput

if TYPE_CHECKING:
    from ..experiments.cluster import Traffic

J3Origin = Literal["ground", "link"]

Json = Annotated[bool, typer.Option("--json", help="Print JSON for programs, and nothing else.")]
Seed = Annotated[int, typer.Option(min=0, help="Random seed: the same seed gives the same answer.")]
RunFile = Annotated[Path, typer.Argument(help="Run file (.jsonl).", show_default=False)]
PlanFile = Annotated[Path, typer.Argument(help="Plan file (.yaml).", show_default=False)]
SharedHeader = Annotated[
    Path | None,
    typer.Option("--header", help="Header file (.yaml): robot, tool, noise.", show_default=False),
]
MeasuredPlan = Annotated[
    Path | None,
    typer.Option(
        "--plan", help="Plan that was measured, instead of --header and --target.", show_default=False
    ),
]
NewRunFile = Annotated[
    Path, typer.Option("-o", "--out", help="Run file to write (.jsonl).", show_default=False)
]
Force = Annotated[
    bool, typer.Option("--force", "--overwrite", help="Replace the file if there is one of that name.")
]
Camera = Annotated[
    bool, typer.Option("--camera/--no-camera", help="Find the PSD in pictures, or by the beam alone.")
]
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        min=1,
        max=256,
        help="Do the work in so many Dask workers on this machine.",
        metavar="N",
        show_default=False,
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        help="Do the work in the workers of the Dask scheduler at this address.",
        metavar="ADDRESS",
        show_default=False,
    ),
]
Picture = Annotated[
    Path | None, typer.Option(help="Write a page with the plan in 3D (.html).", show_default=False)
]
DryRun = Annotated[bool, typer.Option("--dry-run", help="Say what would be imported, and write nothing.")]


def cluster_of(workers: int | None, scheduler: str | None) -> AbstractContextManager[Traffic | None]:
    """The cluster that --workers or --scheduler ask for; nothing without them."""
    if workers is not None and scheduler is not None:
        raise BadInput(
            "--workers and --scheduler exclude each other",
            allowed="--workers for a cluster on this machine, --scheduler for one that is there",
        )
    if workers is None and scheduler is None:
        return nullcontext()
    from ..experiments.cluster import cluster

    return cluster(workers, scheduler)
