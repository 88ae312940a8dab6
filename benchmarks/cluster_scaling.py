"""What does a piece of work cost on a Dask cluster, and how do studies and batches grow with its workers?

Local workers, with certificates. The rate of empty pieces is what client, scheduler and one connection can
do: whatever the number of workers, no more pieces a second. What 1,000 workers would do follows from it by
the time of a real piece, and is printed as what it is: an estimate on paper. The study's answers on one
worker and on two are compared, to the byte.

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
from dataclasses import asdict, astuple
from pathlib import Path

from batch_time import write_runs

from zerobeam.experiments.batch.rows import BatchSettings
from zerobeam.experiments.batch.run_files import PATTERN, run_files
from zerobeam.experiments.cluster import cluster
from zerobeam.experiments.cluster_pieces import Traffic
from zerobeam.experiments.processes import side_by_side
from zerobeam.experiments.studies.coverage import StudiedPlan, studied, studied_plans
from zerobeam.reports.batch.carried_out import batch
from zerobeam.reports.batch.solving import TOGETHER

MANY = 1000  # workers on paper


def empty_pieces(count: int) -> float:
    """Pieces a second that do nothing, after the first few."""
    with cluster(workers=1), closing(side_by_side(operator.neg, range(count + 10))) as answers:
        for _ in range(10):
            next(answers)
        began = time.perf_counter()
        done = sum(1 for _ in answers)
        return done / (time.perf_counter() - began)


def study(plans: list[StudiedPlan], workers: int, data_sets: int) -> tuple[str, float, float, Traffic]:
    """The answer, seconds to start the workers, seconds of the study, what it sent."""
    began = time.perf_counter()
    with cluster(workers=workers) as traffic:
        studied(plans, 100 * workers, 1, lambda *_: None)  # imports and kernels of each worker
        started = time.perf_counter() - began
        before = astuple(traffic)
        began = time.perf_counter()
        answers = studied(plans, data_sets, 0, lambda *_: None)
        spent = time.perf_counter() - began
    own = Traffic(*(now - then for now, then in zip(astuple(traffic), before, strict=True)))
    return json.dumps([asdict(answer) for answer in answers]), started, spent, own


def solved_batch(folder: Path, out: Path) -> tuple[float, Traffic]:
    settings = BatchSettings(seed=0, ess=1000.0, sampling="never", report=False)
    files = run_files([folder], PATTERN, out)
    with cluster(workers=1) as traffic:
        began = time.perf_counter()
        batch(files, out, settings, lambda *_: None)
        return time.perf_counter() - began, traffic


def on_paper(what: str, piece_s: float, bytes_a_piece: float, rate: float) -> None:
    busy = min(MANY, rate * piece_s)
    print(
        f"{what}: {MANY:,} workers ask for {MANY / piece_s:,.0f} pieces of {piece_s:.2f} s a second; at"
        f" {rate:.0f} a second {busy:,.0f} are busy, and {rate * bytes_a_piece / 1e6:.1f} MB a second pass"
    )


def per_piece(traffic: Traffic) -> float:
    return (traffic.sent + traffic.received) / max(traffic.pieces, 1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data-sets", type=int, default=500, help="of the first plan of the study")
    parser.add_argument("--runs", type=int, default=160, help="of the batch")
    parser.add_argument("--pieces", type=int, default=1000, help="that do nothing")
    asked = parser.parse_args()
    print(f"{os.cpu_count()} cores, load of the machine {os.getloadavg()[0]:.1f}")
    rate = empty_pieces(asked.pieces)
    print(f"empty pieces: {rate:.0f} a second, {1000 / rate:.1f} ms each")
    plans = studied_plans(0)[:1]
    found = {workers: study(plans, workers, asked.data_sets) for workers in (1, 2)}
    for workers, (_, started, spent, own) in found.items():
        print(
            f"coverage, {workers} worker(s): {spent:.1f} s for {own.pieces} pieces (start {started:.1f} s),"
            f" sent {own.sent / 1e6:.2f} MB, received {own.received / 1e6:.2f} MB;"
            f" load {os.getloadavg()[0]:.1f}"
        )
    print(
        f"scaling of 2 against 1: {found[1][2] / found[2][2]:.2f}; same bytes: {found[1][0] == found[2][0]}"
    )
    with tempfile.TemporaryDirectory() as aside:
        write_runs(Path(aside) / "runs", asked.runs)
        spent, own = solved_batch(Path(aside) / "runs", Path(aside) / "batch")
    print(
        f"batch, 1 worker: {asked.runs} runs in {spent:.1f} s, {own.pieces} pieces of {TOGETHER}, sent"
        f" {own.sent / 1e6:.2f} MB, received {own.received / 1e6:.2f} MB; load {os.getloadavg()[0]:.1f}"
    )
    of_study = found[1][3]
    on_paper("coverage", found[1][2] / of_study.pieces, per_piece(of_study), rate)
    on_paper("batch", spent / max(own.pieces, 1), per_piece(own), rate)


if __name__ == "__main__":
    main()
