"""Dask clusters, and what work on them is compared with."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import psutil  # Dask's own: import this module behind `pytest.importorskip("distributed")`
import pytest

from zerobeam.experiments.processes import side_by_side
from zerobeam.experiments.studies import coverage
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.coverage import StudiedPlan, coverage_study
from zerobeam.model.records import to_json


def answers(work: Callable[[Any], Any], jobs: Iterable[Any]) -> dict[int, Any]:
    with closing(side_by_side(work, jobs)) as found:
        return dict(found)


def study_bytes(plans: Sequence[StudiedPlan], data_sets: int = 200, **how: Any) -> str:
    """The answer of a small coverage study without its clock, as text."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(coverage, "studied_plans", lambda seed: plans)
        answer = to_json(coverage_study(data_sets, Engine(5, **how)))
    answer.pop("seconds")
    return json.dumps(answer)


@contextlib.contextmanager
def scheduler_elsewhere(place: Path, workers: int) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """A scheduler and workers as `dask scheduler` and `dask worker` start them: address, processes."""
    file = place / "scheduler.json"
    path = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": place}
    quiet["env"] = {**os.environ, "PYTHONPATH": path}  # workers import work of the tests
    dask = [sys.executable, "-m", "dask"]
    where = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    started = [subprocess.Popen([*dask, "scheduler", *where], **quiet)]
    try:
        limit = time.monotonic() + 60
        while not file.exists() or not file.read_text().rstrip().endswith("}"):
            assert time.monotonic() < limit
            time.sleep(0.2)
        address = json.loads(file.read_text())["address"]
        how = ["--nworkers", str(workers), "--nthreads", "1", "--no-dashboard"]
        started.append(subprocess.Popen([*dask, "worker", address, *how], **quiet))
        yield address, started
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in started:
            process.wait(60)


def local_workers(parent: int | None = None) -> list[psutil.Process]:
    """The worker processes of the local clusters of a process, this one by default."""
    found = []
    with contextlib.suppress(psutil.NoSuchProcess):
        for process in psutil.Process(parent).children(recursive=True):
            with contextlib.suppress(psutil.NoSuchProcess):
                if "spawn_main" in " ".join(process.cmdline()):
                    found.append(process)
    return found
