"""How long a person waits for an answer: whole processes of `check`, `analyse`, `report`, `plan optimal` and
`verify`, as ratios.

    python benchmarks/start_time.py
    python benchmarks/start_time.py --python /tmp/lean/bin/python    # and in another environment

The run is the built-in one of 7 measurements, the plan its postures; `plan optimal` is for 20 measurements,
`verify` is of a simulated calibration in these postures. All is warm: one round of each is not counted.
The yardstick is `python -c "import emcee, casadi"` in the same rounds: what a program that samples a
posterior with these libraries waits for before it begins. Medians; by the clock, and of all cores.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
from pathlib import Path

from growth import PROGRAM, used_by

from zerobeam.experiments.demos import demo_runs
from zerobeam.model.files.plan import write_plan
from zerobeam.model.files.run import read_run

YARDSTICK = "import emcee, casadi"


def plan_of(run: Path, file: Path) -> Path:
    """A plan file with the postures of a run."""
    recorded = read_run(run)
    shots = recorded.shots
    write_plan(file, recorded.header, [shot.joints_deg for shot in shots], [shot.target for shot in shots])
    return file


def acceptance_test(plan: Path, folder: Path) -> tuple[Path, Path]:
    """A simulated calibration in the postures of a plan, and its acceptance test."""
    calibration, test, tested = (folder / name for name in ("run.jsonl", "test.yaml", "tested.jsonl"))
    cell_file = folder / "cell.yaml"
    cell_file.write_text("schema: zerobeam/cell/1\narm: {offsets_deg: {delta2: -1.2}}\n", encoding="utf-8")
    cell = ["--cell", str(cell_file), "--no-camera", "--seed", "5"]
    for arguments in (
        ["run", str(plan), "-o", str(calibration), *cell],
        ["plan", "verify", str(calibration), "-o", str(test)],
        ["run", str(test), "-o", str(tested), "--arm", str(calibration), *cell],
    ):
        spent([sys.executable, "-c", PROGRAM, *arguments])
    return calibration, tested


def spent(command: list[str]) -> tuple[float, float]:
    """Seconds by the clock and of all cores of one process."""
    # As installed: modules are compiled to bytecode once.
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    clock, cores, _ = used_by(command, environment)
    return clock, cores


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--python", type=Path, action="append", default=[], help="of another environment")
    parser.add_argument("--repeat", type=int, default=5, help="processes counted of each (default 5)")
    asked = parser.parse_args()

    run = next(run.path for run in demo_runs() if run.name == "good")
    with tempfile.TemporaryDirectory() as folder:
        plan = plan_of(run, Path(folder) / "plan.yaml")
        calibration, tested = acceptance_test(plan, Path(folder))
        optimal = ["plan", "optimal", "--header", str(run), "--shots", "20", "--force"]
        commands = {
            "check": ["-c", PROGRAM, "check", str(plan)],
            "analyse": ["-c", PROGRAM, "analyse", str(run)],
            "report": ["-c", PROGRAM, "report", str(run), "-o", str(Path(folder) / "report")],
            "plan optimal": ["-c", PROGRAM, *optimal, "-o", str(Path(folder) / "optimal.yaml")],
            "verify": ["-c", PROGRAM, "verify", str(calibration), str(tested)],
        }
        pythons = [Path(sys.executable), *asked.python]
        rows = [("yardstick", [sys.executable, "-c", YARDSTICK])]
        rows += [
            (f"{name}, {python}" if asked.python else name, [str(python), *rest])
            for name, rest in commands.items()
            for python in pythons
        ]
        taken: dict[str, list[tuple[float, float]]] = {name: [] for name, _ in rows}
        for turn in range(asked.repeat + 1):
            for name, command in rows:
                seconds = spent(command)
                if turn:
                    taken[name].append(seconds)
    medians = {
        name: [statistics.median(column) for column in zip(*rows, strict=True)]
        for name, rows in taken.items()
    }
    width = max(map(len, medians))
    base = medians["yardstick"]
    for name, (clock, cores) in medians.items():
        row = f"{name:{width}s} {clock:6.2f} s, {clock / base[0]:4.2f} times the yardstick"
        print(f"{row}; of all cores {cores:6.2f} s, {cores / base[1]:4.2f} times")


if __name__ == "__main__":
    main()
