"""Options and arguments that several commands share."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..model.errors import BadInput
from ..model.options import Option, argument

if TYPE_CHECKING:
    from ..experiments.cluster import Traffic

Json = Annotated[bool, Option("Print JSON for programs, and nothing else.", "--json")]
Full = Annotated[bool, Option("Print the whole answer, not page one alone.", "--full")]
RunFile = Annotated[Path, argument("Run file (.jsonl).")]
PlanFile = Annotated[Path, argument("Plan file (.yaml).")]
NewRunFile = Annotated[Path, Option("Run file to write (.jsonl).", "-o --out")]
Force = Annotated[bool, Option("Replace the file if there is one of that name.", "--force --overwrite")]
Picture = Annotated[Path | None, Option("Write a page with the plan in 3D (.html).")]


@dataclass(frozen=True)
class Cluster:
    """Where the work is done, if not in this process."""

    workers: Annotated[
        int | None,
        Option("Use so many Dask workers on this machine.", least=1, most=256, metavar="N"),
    ] = None
    scheduler: Annotated[
        str | None,
        Option("Use the workers of the Dask scheduler at this address.", metavar="ADDRESS"),
    ] = None

    def opened(self) -> "AbstractContextManager[Traffic | None]":
        """The cluster; nothing where none is stated."""
        if self.workers is not None and self.scheduler is not None:
            raise BadInput(
                "--workers and --scheduler exclude each other",
                allowed="--workers for a cluster on this machine, --scheduler for one that is there",
            )
        if self.workers is None and self.scheduler is None:
            return nullcontext()
        from ..experiments.cluster import cluster

        return cluster(self.workers, self.scheduler)
