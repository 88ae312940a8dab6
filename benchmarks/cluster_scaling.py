"""What does a piece of work cost on a Dask cluster, and how do studies and batches grow with its workers?

Local workers, with certificates. Costs are time of cores, which other users of the machine change little: of
this process, in which client and scheduler are, and of the workers. Short pieces travel together in parcels,
so the overhead is that of a piece that does nothing, and that of a parcel on its way alone. The rate of
parcels is what one client and one scheduler can do, whatever the number of workers. What 1,000 workers would
do follows from it by the time of a real piece, and is printed as what it is: an estimate on paper. The
study's answers on one worker and on two are compared, to the byte.

    .venv/bin/python benchmarks/cluster_scaling.py
"""

from __future__ import annotations

import argparse
import json
import operator
import os
import tempfile
import time
from contextlib import closing
from dataclasses import asdict, astuple, dataclass
from pathlib import Path

import psutil
from batch_time import write_runs

from zerobeam.experiments.batch import PATTERN, run_files
from zerobeam.experiments.cluster import PARCEL_BYTES, PARCELS_A_SECOND, Traffic, cluster
from zerobeam.experiments.command_options import BatchSettings
from zerobeam.experiments.processes import side_by_side
from zerobeam.experiments.studies.cases import Engine
from zerobeam.experiments.studies.coverage import StudiedPlan, studied, studied_plans
from zerobeam.reports.carried_out import batch

MANY = 1000  # workers on paper


class Cores:
    """Core seconds since it was made: of this process (client and scheduler), and of its workers."""

    def __init__(self) -> None:
        self._before = self._now()

    def spent(self) -> tuple[float, float]:
        own, workers = (now - then for now, then in zip(self._now(), self._before, strict=True))
        return own, workers

    def _now(self) -> tuple[float, float]:
        times = [child.cpu_times() for child in psutil.Process().children(recursive=True)]
        return time.process_time(), sum(one.user + one.system for one in times)


def idle(seconds: float) -> tuple[float, float]:
    """Core seconds a second without any work."""
    with cluster(workers=1):
        time.sleep(1.0)
        cores = Cores()
        time.sleep(seconds)
        own, workers = cores.spent()
    return own / seconds, workers / seconds


def empty_pieces(count: int) -> tuple[float, tuple[float, float]]:
    """Seconds and core seconds of a piece that does nothing, after the first few."""
    with cluster(workers=1), closing(side_by_side(operator.neg, range(count + 100))) as answers:
        for _ in range(100):
            next(answers)
        began, cores = time.perf_counter(), Cores()
        done = sum(1 for _ in answers)
        own, workers = cores.spent()
        return (time.perf_counter() - began) / done, (own / done, workers / done)


def lone_parcels(count: int) -> tuple[float, tuple[float, float]]:
    """The same of a parcel with one piece, each sent when the one before has come."""
    with cluster(workers=1):
        for _ in side_by_side(operator.neg, range(20)):
            pass
        began, cores = time.perf_counter(), Cores()
        for number in range(count):
            for _ in side_by_side(operator.neg, [number]):
                pass
        own, workers = cores.spent()
        return (time.perf_counter() - began) / count, (own / count, workers / count)


@dataclass(frozen=True)
class Done:
    """A study: its answer, seconds to start the workers, seconds and core seconds, what it sent."""

    answer: str
    started: float
    spent: float
    own: float
    workers: float
    traffic: Traffic


def study(plans: list[StudiedPlan], workers: int, data_sets: int) -> Done:
    began = time.perf_counter()
    with cluster(workers=workers) as traffic:
        studied(plans, 100 * workers, Engine(1))  # imports and kernels of each worker
        started = time.perf_counter() - began
        before = astuple(traffic)
        began, cores = time.perf_counter(), Cores()
        answers = studied(plans, data_sets, Engine(0))
        spent = time.perf_counter() - began
        own, of_workers = cores.spent()
    sent = Traffic(*(now - then for now, then in zip(astuple(traffic), before, strict=True)))
    answer = json.dumps([asdict(answer) for answer in answers])
    return Done(answer, started, spent, own, of_workers, sent)


def solved_batch(folder: Path, out: Path) -> tuple[float, float, float, Traffic]:
    """Seconds until all runs are solved and written, core seconds of client and worker, what was sent."""
    ended: list[tuple[float, float, float]] = []

    def told(stage: str, share: float) -> None:
        if share == 1.0 and not ended:
            ended.append((time.perf_counter() - began, *cores.spent()))

    settings = BatchSettings(seed=0, ess=1000.0, sampling="never", report=False)
    files = run_files([folder], PATTERN, out)
    with cluster(workers=1) as traffic:
        began, cores = time.perf_counter(), Cores()
        batch(files, out, settings, told)
        return *ended[0], traffic


def on_paper(what: str, piece_s: float, client_s: float, parcel_s: float, traffic: Traffic) -> None:
    """How many workers one client keeps busy if each piece costs it `client_s` of a core, and of that
    `parcel_s` for its parcel; with so many workers, parcels hold more pieces."""
    sent, received = (size / max(traffic.pieces, 1) for size in (traffic.sent, traffic.received))
    together = max(1, min(int(max(1.0, MANY / PARCELS_A_SECOND) / piece_s), int(PARCEL_BYTES / sent)))
    each_s = max(client_s - parcel_s, 0.0) + parcel_s / together
    busy = min(MANY, piece_s / each_s)
    print(
        f"{what}, on paper: a piece is {piece_s:.2f} core s of a worker, and in parcels of {together}"
        f" {1000 * each_s:.1f} core ms of client and scheduler, which keep {busy:,.0f} of {MANY:,} workers"
        f" busy; then {busy / piece_s * (sent + received) / 1e6:.0f} MB a second pass"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data-sets", type=int, default=2000, help="of the first plan of the study")
    parser.add_argument("--runs", type=int, default=160, help="of the batch")
    parser.add_argument("--pieces", type=int, default=10_000, help="that do nothing")
    asked = parser.parse_args()
    print(f"{os.cpu_count()} cores, load of the machine {os.getloadavg()[0]:.1f}")
    rest, worker = idle(5.0)
    print(f"nothing to do: client and scheduler {rest:.1%} of a core, a worker {worker:.1%}")
    piece_s, (own, worker) = empty_pieces(asked.pieces)
    print(
        f"a piece that does nothing: {1000 * piece_s:.2f} ms, {1 / piece_s:,.0f} a second; core time of"
        f" client and scheduler {1000 * own:.2f} ms, of the worker {1000 * worker:.2f} ms"
    )
    alone_s, (parcel, worker) = lone_parcels(max(asked.pieces // 100, 10))
    print(
        f"a parcel alone: {1000 * alone_s:.1f} ms to and fro; core time of client and scheduler"
        f" {1000 * parcel:.1f} ms, of the worker {1000 * worker:.1f} ms"
    )
    plans = studied_plans(0)[:1]
    found = {workers: study(plans, workers, asked.data_sets) for workers in (1, 2)}
    for workers, done in found.items():
        pieces = done.traffic.pieces
        print(
            f"coverage, {workers} worker(s): {done.spent:.1f} s for {pieces} pieces (start"
            f" {done.started:.1f} s), {pieces / done.spent:.2f} a second; core time of a piece:"
            f" {1000 * done.workers / pieces:.0f} ms of the workers, {1000 * done.own / pieces:.1f} ms of"
            f" client and scheduler ({done.own / (done.own + done.workers):.1%});"
            f" sent {done.traffic.sent / pieces / 1e3:.1f} kB a piece, received"
            f" {done.traffic.received / pieces / 1e3:.1f} kB; load {os.getloadavg()[0]:.1f}"
        )
    one, two = found[1], found[2]
    print(f"scaling of 2 against 1: {one.spent / two.spent:.2f}; same bytes: {one.answer == two.answer}")
    with tempfile.TemporaryDirectory() as aside:
        write_runs(Path(aside) / "runs", asked.runs)
        spent, own, worker, traffic = solved_batch(Path(aside) / "runs", Path(aside) / "batch")
    pieces = max(traffic.pieces, 1)
    print(
        f"batch, 1 worker: {asked.runs} runs in {spent:.1f} s, {pieces} pieces; core time of a"
        f" piece: {1000 * worker / pieces:.0f} ms of the worker, {1000 * own / pieces:.0f} ms of client,"
        f" scheduler and writing; sent {traffic.sent / pieces / 1e3:.1f} kB a piece, received"
        f" {traffic.received / pieces / 1e3:.1f} kB; load {os.getloadavg()[0]:.1f}"
    )
    for what, of_worker, of_client, clock, sent in (
        ("coverage", one.workers, one.own, one.spent, one.traffic),
        ("batch", worker, own, spent, traffic),
    ):
        count = max(sent.pieces, 1)
        on_paper(what, of_worker / count, (of_client - rest * clock) / count, parcel, sent)


if __name__ == "__main__":
    main()
