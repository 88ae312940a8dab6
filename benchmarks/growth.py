"""How time and memory grow: with the measurements of a run, the joints of an arm, the runs of a comparison.

    python benchmarks/growth.py                                  # all, a quarter of an hour
    python benchmarks/growth.py --shots 7,200,2000 --joints "" --runs ""   # some
    python benchmarks/growth.py --plot docs/pictures/growth.svg

Each figure is one whole process of `zerobeam report`, `analyse` or `compare`, as a person starts it: seconds
by the clock, seconds of all cores, and the peak of its memory. Runs are simulated with fixed seeds: one
target, random postures, a calibrated laser on the built-in arm; for the joints a chain of random links with a
probe; for the runs 7 measurements each, of the same postures with other noise.
Kernels are compiled in a cache of their own: the first time that an arm is seen is a row of its own.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from zerobeam.experiments.plans.candidates import candidates
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import RUN_SCHEMA, Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import write_run
from zerobeam.model.likelihood.problem import Problem

SHOTS = (7, 20, 60, 200, 600, 2000, 6000, 20_000)
JOINTS = (6, 12, 18, 24, 30)
RUNS = (2, 10, 100, 1000)
SHOTS_OF_JOINTS = 60
SHOTS_OF_RUNS = 7
TABLE_2 = {"delta2": -1.2168, "delta3": -0.6931, "delta4": 0.1129, "delta5": 0.0053, "delta6": -0.0382}
PLACE = (950.0, 150.0, 100.0)
PROGRAM = "from zerobeam.cli import main; main()"


class Spent(NamedTuple):
    """What one process took: seconds by the clock and of all cores, and its peak of memory, MB."""

    what: str
    size: int
    clock: float
    cores: float
    memory: float


# A process counts the memory of the one that started it as its own: so that one is small.
_MEASURE = """
import os, subprocess, sys, time
began = time.perf_counter()
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
cores = used.ru_utime + used.ru_stime
print(time.perf_counter() - began, cores, used.ru_maxrss / 1024, os.waitstatus_to_exitcode(status))
"""


def used_by(command: Sequence[str], environment: Mapping[str, str]) -> tuple[float, float, float]:
    """Seconds by the clock and of all cores, and the peak of memory (MB), of one process. Any verdict is
    well."""
    small = [sys.executable, "-S", "-c", _MEASURE, *command]
    answer = subprocess.run(small, stdout=subprocess.PIPE, text=True, env=environment, check=True).stdout
    clock, cores, memory, status = answer.split()
    if status not in ("0", "1"):
        sys.exit(f"{' '.join(command)} ended with {status}")
    return float(clock), float(cores), float(memory)


def spent(what: str, size: int, cache: Path, *arguments: object) -> Spent:
    command = [sys.executable, "-c", PROGRAM, *map(str, arguments)]
    return Spent(what, size, *used_by(command, {**os.environ, "ZEROBEAM_CACHE": str(cache)}))


def header(robot: str, tool: dict[str, object], place: Sequence[float]) -> Header:
    targets = {"psd": {"guess_mm": [float(v) for v in place], "sigma_mm": 200.0}}
    noise = {"joint_deg": 0.01, "spot_mm": 0.05}
    return Header.model_validate(
        {"schema": RUN_SCHEMA, "robot": robot, "tool": tool, "noise": noise, "targets": targets}
    )


def write(
    path: Path, own: Header, place: Sequence[float], shots: int, truth: dict[str, float], runs: int = 1
) -> list[Path]:
    """A run of so many measurements in random postures that reach the target; or several of the same
    postures, numbered."""
    robot = load_robot(own.robot, path.parent)
    found = candidates(own, robot, np.array(place), shots, seed=1)
    names, lines = ("psd",) * shots, tuple(range(shots))
    plan = Plan(
        own, robot, planned(found.postures * robot.display, names), lines, Path("plan.yaml"), "0" * 64, ()
    )
    stated, rng = Truth.with_values(plan, truth), np.random.default_rng(2)
    files = [path] if runs == 1 else [path.with_stem(f"{path.stem}-{k}") for k in range(runs)]
    for file in files:
        write_run(file, own, simulated_shots(stated, rng))
    return files


def run_of_shots(path: Path, shots: int, runs: int = 1) -> list[Path]:
    tool: dict[str, object] = {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]}
    return write(path, header("irb1600", tool, PLACE), PLACE, shots, TABLE_2, runs)


def run_of_joints(path: Path, joints: int) -> None:
    """An arm of so many links, about 2 m long when stretched, and a probe."""
    rng = np.random.default_rng(joints)
    rows = [
        {
            "a_mm": round(float(rng.uniform(0.2, 1.0) * 1500 / joints), 3),
            "alpha_deg": float(rng.choice([-90, 0, 90])) if k % 2 else 90.0,
            "d_mm": round(float(rng.uniform(0.2, 1.0) * 1500 / joints), 3),
            "theta_deg": 0.0,
            "lower_deg": -120.0,
            "upper_deg": 120.0,
        }
        for k in range(joints)
    ]
    content = {
        "schema": "zerobeam/robot/1",
        "name": f"arm of {joints}",
        "convention": "standard",
        "joints": rows,
    }
    file = path.with_name(f"arm{joints}.yaml")
    file.write_text(json.dumps({**content, "joints": rows}), encoding="utf-8")
    tool: dict[str, object] = {"kind": "probe", "point_mm": [20.0, 10.0, 100.0]}
    # The target is where the tip is in one posture: so it is within reach.
    own, robot = header(file.name, tool, (0, 0, 0)), load_robot(file.name, path.parent)
    problem = Problem.build(own, robot, rng.uniform(-1, 1, (1, joints)), ["psd"])
    place = problem.beams(problem.parameters.prior_mean)[0][0]
    truth = {f"delta{j}": float(rng.normal() * 0.5) for j in range(2, joints + 1)}
    write(path, header(file.name, tool, place), place, SHOTS_OF_JOINTS, truth)


def measured(folder: Path, shots: Iterable[int], joints: Iterable[int], runs: Sequence[int]) -> list[Spent]:
    cache, rows = folder / "cache", []
    print(f"{'':44}  by the clock   all cores      memory", flush=True)

    def told(own: Spent, words: str) -> None:
        rows.append(own)
        print(f"{words:44} {own.clock:9.1f} s   {own.cores:9.1f} s   {own.memory:7.0f} MB", flush=True)

    for number, size in enumerate(shots):
        path = folder / f"shots{size}.jsonl"
        run_of_shots(path, size)
        if not number:
            first = spent("report, first", size, cache, "report", path, "-o", folder / "first", "--json")
            told(first, f"report, {size} measurements, first")
        own = spent("report", size, cache, "report", path, "-o", folder / f"report{size}", "--json")
        told(own, f"report, {size} measurements")
    for size in joints:
        path = folder / f"joints{size}.jsonl"
        run_of_joints(path, size)
        for what in ("analyse, first", "analyse"):
            own = spent(what, size, cache, "analyse", path, "--json")
            told(own, f"analyse, {size} joints{what.removeprefix('analyse')}")
    files = run_of_shots(folder / "runs.jsonl", SHOTS_OF_RUNS, max(runs)) if runs else []
    for size in runs:
        told(spent("compare", size, cache, "compare", *files[:size], "--json"), f"compare, {size} runs")
    return rows


def drawn(rows: Sequence[Spent]) -> str:
    """The figure: seconds and memory over the measurements, seconds over the joints and the runs."""
    from zerobeam.reports.style.canvas import new_figure, style, to_svg
    from zerobeam.reports.style.theme import light

    with style():
        figure = new_figure(5.0)
        (left, middle), (right, last) = figure.subplots(2, 2)
        for axes, what, of, words, along in (
            (left, "report", lambda own: own.cores, "report, core seconds", "measurements"),
            (middle, "report", lambda own: own.memory, "report, memory in MB", "measurements"),
            (right, "analyse", lambda own: own.cores, "analyse, core seconds", "joints"),
            (last, "compare", lambda own: own.cores, "compare, core seconds", "runs"),
        ):
            own = [row for row in rows if row.what == what]
            axes.plot(
                [row.size for row in own],
                [of(row) for row in own],
                "o-",
                color=light("identified"),
                markersize=4,
                linewidth=1.2,
            )
            axes.set_title(words, fontsize=9.5, loc="left")
            axes.set_xlabel(along)
            if along != "joints":
                ticks = [10, 100, 1000, 10_000][: 4 if along == "measurements" else 3]
                axes.set_xscale("log")
                axes.set_xticks(ticks, list(map(str, ticks)), fontsize=7.5)
                axes.set_xticks([], minor=True)
        first = [row for row in rows if row.what == "analyse, first"]
        right.plot(
            [row.size for row in first],
            [row.cores for row in first],
            "o--",
            color=light("weak"),
            markersize=4,
            linewidth=1.2,
            markerfacecolor="none",
            label="first time",
        )
        for axes in (left, middle, right, last):
            axes.set_ylim(0, 1.05 * axes.get_ylim()[1])
        if first:
            right.legend(loc="upper left", fontsize=8.5)
        return to_svg(figure, "growth")


def numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split(",") if part)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--shots", type=numbers, default=SHOTS, help="numbers of measurements, by commas")
    parser.add_argument("--joints", type=numbers, default=JOINTS, help="numbers of joints, by commas")
    parser.add_argument("--plot", type=Path, help="write the figure to this file (.svg)")
    parser.add_argument("--runs", type=numbers, default=RUNS, help="numbers of runs to compare, by commas")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = measured(Path(folder), asked.shots, asked.joints, asked.runs)
    if asked.plot is not None:
        asked.plot.write_text(drawn(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
