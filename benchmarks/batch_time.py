"""How long does `zerobeam batch` take for many runs, how much memory, and does it name the broken files?

The runs are simulated: seven good postures of the irb1600 for each arm with offsets of its own, in four
folders with equal names. One in a hundred files is broken in turn: no JSON, a header that is torn, a joint
beyond its limits, one posture seven times, nothing at all.

    .venv/bin/python benchmarks/batch_time.py --runs 2000
"""

from __future__ import annotations

import argparse
import csv
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from zerobeam.experiments.demos import demo_runs
from zerobeam.experiments.studies.data_sets import drawn
from zerobeam.model.files.run import header_text, read_run, shot_text
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem

SEED = 5
OFFSET_DEG = 0.5
ONE_IN = 100
START = "from zerobeam.cli import main; main()"


def write_runs(folder: Path, count: int) -> list[Path]:
    """So many run files, and the paths of those that are broken."""
    run = read_run(demo_runs()[0].path)
    problem, robot = Problem.from_run(run), run.robot
    spread = problem.parameters.prior_std.copy()
    spread[problem.parameters.group("offset")] = np.radians(OFFSET_DEG)
    data = drawn(problem, 2 * count, np.random.default_rng(SEED), spread)
    inside = ((data.joints > robot.lower) & (data.joints < robot.upper)).all(axis=(1, 2))
    chosen = np.flatnonzero(inside)[:count]
    if len(chosen) < count:
        raise SystemExit("too few simulated runs within the arm's limits")
    broken = []
    for k, row in enumerate(chosen):
        path = folder / f"line{k % 4}" / f"run{k // 4:05d}.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        header = run.header.model_copy(update={"provenance": {"serial": f"A{k:05d}"}})
        joints = np.degrees(data.joints[row])
        lines = [
            shot_text(Shot(shot=i, target="psd", joints_deg=tuple(own), spot_mm=tuple(spot)))
            for i, (own, spot) in enumerate(zip(joints, data.spots[row], strict=True))
        ]
        text = header_text(header) + "".join(lines)
        if k % ONE_IN == ONE_IN // 2:
            broken.append(path)
            text = spoilt(text, len(broken))
        path.write_text(text)
    return broken


def spoilt(text: str, number: int) -> str:
    """The text of a run, broken in one of five ways."""
    header, first, *rest = text.splitlines(keepends=True)
    match number % 5:
        case 0:
            return "not a run\n"
        case 1:
            return header[: len(header) // 2] + "\n" + "".join([first, *rest])
        case 2:
            return header + first.replace('"joints_deg":[', '"joints_deg":[999', 1) + "".join(rest)
        case 3:
            return header + "".join(first.replace('"shot":0', f'"shot":{i}') for i in range(7))
        case _:
            return ""


def of_children() -> float:
    """Seconds of cores that ended processes took."""
    times = os.times()
    return times.children_user + times.children_system


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("options", nargs="*", help="of `zerobeam batch`, behind --")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as aside:
        folder, out = Path(aside) / "runs", Path(aside) / "batch"
        broken = write_runs(folder, asked.runs)
        command = [sys.executable, "-c", START, "batch", str(folder), "-o", str(out), *asked.options]
        for what in ("solved", "again, all done"):
            before, began = of_children(), time.perf_counter()
            status = subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode
            spent, cores = time.perf_counter() - began, of_children() - before
            print(
                f"{asked.runs} runs {what}: {spent:.1f} s, {cores:.1f} s of cores, exit status {status};"
                f" load of the machine {os.getloadavg()[0]:.1f}"
            )
        largest = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
        print(f"the largest process: {largest:.0f} MB")
        rows = list(csv.DictReader((out / "runs.csv").read_text().splitlines()))
        print(f"outcomes: {dict(Counter(row['outcome'] for row in rows))}")
        named = {(out / row["file"]).resolve() for row in rows if row["outcome"] == "failed"}
        print(f"broken files: {len(broken)}, named: {len(named & {path.resolve() for path in broken})}")


if __name__ == "__main__":
    main()
