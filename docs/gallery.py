"""The reports of the gallery, made by the command line in a folder: built-in runs, a plan, repeats, a study.

python docs/gallery.py FOLDER
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

# One arm, so that its runs can be compared; the seeds of the runs are their noise.
CELL = """\
schema: zerobeam/cell/1
arm:
  offsets_deg: {delta2: -1.22, delta3: -0.69, delta4: 0.11, delta5: 0.01, delta6: -0.04}
"""
HEADER = """\
robot: irb1600
tool: {kind: laser, calibrated: true, point_mm: [0, 0, 65], direction: [1, 0, 0]}
noise: {joint_deg: 0.01, spot_mm: 0.05}
"""
MOVED = f"""\
{CELL}faults:
  - {{kind: psd-bump, shot: 10, shift_mm: [3, 0, 0]}}
"""
TRACKER = """\
robot: irb1600
instruments:
  leica:
    kind: tracker
    guess_mm: [3000, 500, 800]
    sigma_mm: {constant: 0.015, per_m: 0.006}
    reflectors: {R1: {guess_mm: [60, 0, 80]}, R2: {guess_mm: [-40, 50, 80]}}
noise: {joint_deg: 0.01}
"""
RUNS = ("monday", "tuesday", "wednesday")
COMMANDS = (
    "demo -o .",
    "plan optimal --header tracker.yaml --candidates 2000 -o tracker-plan.yaml --picture tracker.html",
    "plan optimal --header header.yaml --target 900,0,0 --candidates 2000 -o plan.yaml --picture plan.html",
    *(
        f"run plan.yaml --cell cell.yaml --seed {seed} --json -o {name}.jsonl"
        for seed, name in enumerate(RUNS, start=1)
    ),
    "run plan.yaml --cell moved.yaml --seed 4 --json -o moved.jsonl",
    "report moved.jsonl -o misfit",
    f"compare {' '.join(f'{name}.jsonl' for name in RUNS)} --json -o compare",
    "study instruments --json -o instruments",
    "study table2 --json -o table2",
    "study patterns --json -o patterns",
)
REPORTS = ("good", "x-pattern", "misfit", "uncalibrated")
FIGURES = {"misfit": "misses", "x-pattern": "null_motion"}
# What the page of the gallery may link to; the report of a demo has its folder's name.
PAGES = (
    *(f"{name}/report.{kind}" for name in REPORTS for kind in ("html", "pdf")),
    *(f"{name}/figures/{FIGURES.get(name, 'offsets')}.svg" for name in REPORTS),
    "instruments/figures/instruments.svg",
    "compare/figures/runs.svg",
    "table2/figures/scatter.svg",
    "plan.html",
    "tracker.html",
    "instruments/study.html",
    "compare/compare.html",
    "table2/study.html",
    "patterns/study.html",
)


def make(folder: Path) -> None:
    """Make all of it in an empty folder; RuntimeError where a command fails or a page is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cell.yaml").write_text(CELL, encoding="utf-8")
    (folder / "moved.yaml").write_text(MOVED, encoding="utf-8")
    (folder / "header.yaml").write_text(HEADER, encoding="utf-8")
    (folder / "tracker.yaml").write_text(TRACKER, encoding="utf-8")
    for command in COMMANDS:
        done = subprocess.run(
            [sys.executable, "-c", "from zerobeam.cli import main; main()", *command.split()],
            cwd=folder,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        # 1 is an answer: runs that do not agree, a study that does not.
        if done.returncode not in (0, 1):
            raise RuntimeError(f"zerobeam {command}\n{done.stderr}")
    missing = [page for page in PAGES if not (folder / page).is_file()]
    if missing:
        raise RuntimeError(f"not made: {', '.join(missing)}")


if __name__ == "__main__":
    make(Path(sys.argv[1]))
