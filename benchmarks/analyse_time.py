"""How long `zerobeam analyse RUN` takes as a whole process, and where the time goes.

For each run it prints the wall time of the command as a person starts it (the first time, in which
C may be compiled, apart from the rest), then one more process with marks around the imports and around
the functions named in STAGES.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SEED = 1

# What counts as a stage: functions as `zerobeam.analysis.analyse` calls them by name.
STAGES = {
    "fit": ["solve_run", "fit_midpoint"],
    "sampling": ["sample_posterior"],
    "diagnostics": ["shot_results", "placement_result", "entered", "accuracy", "budget", "scene", "diagnose"],
    "outlook": ["_outlook"],
}

# Runs in a process of its own: marks around imports and stages, then the command as ever.
# What a stage imports late is counted as import, not as stage.
MARKED = """
import builtins, functools, importlib, json, sys, time
stages, run, seed = json.loads(sys.argv[1]), sys.argv[2], sys.argv[3]
spent = dict.fromkeys(["imports", *stages], 0.0)
plain_import, importing = builtins.__import__, False
def timed_import(*args, **kwargs):
    global importing
    if importing:
        return plain_import(*args, **kwargs)
    importing, start = True, time.perf_counter()
    try:
        return plain_import(*args, **kwargs)
    finally:
        importing = False
        spent["imports"] += time.perf_counter() - start
builtins.__import__ = timed_import
def marked(stage, function):
    @functools.wraps(function)
    def timed(*args, **kwargs):
        start = time.perf_counter() - spent["imports"]
        try:
            return function(*args, **kwargs)
        finally:
            spent[stage] += time.perf_counter() - spent["imports"] - start
    return timed
import zerobeam.analysis.analyse
module = sys.modules["zerobeam.analysis.analyse"]
for stage, names in stages.items():
    for name in names:
        setattr(module, name, marked(stage, getattr(module, name)))
from zerobeam.cli import main
sys.argv = ["zerobeam", "analyse", run, "--json", "--seed", seed]
try:
    main()
finally:
    print("stages:" + json.dumps(spent), file=sys.stderr)
"""


def run_process(command: list[str]) -> tuple[float, subprocess.CompletedProcess[str]]:
    """Wall time in s of one whole process; any verdict is well, a fault ends the benchmark."""
    start = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - start
    if done.returncode not in (0, 1):  # 0 and 1 are verdicts, 2 and 3 faults
        sys.exit(f"{' '.join(command[-5:])} ended with {done.returncode}:\n{done.stderr[-2000:]}")
    return seconds, done


def measure(title: str, run: Path, repeat: int) -> None:
    plain = [
        str(Path(sys.executable).with_name("zerobeam")),
        "analyse",
        str(run),
        "--json",
        "--seed",
        str(SEED),
    ]
    first, done = run_process(plain)
    later = [run_process(plain)[0] for _ in range(repeat)]

    marked = [sys.executable, "-c", MARKED, json.dumps(STAGES), str(run), str(SEED)]
    total, split = run_process(marked)
    parts = json.loads(split.stderr.rpartition("stages:")[2].splitlines()[0])
    parts["the rest"] = total - sum(parts.values())

    print(f"{title}: {len(json.loads(done.stdout)['shots'])} shots")
    print(f"  whole process   first {first:.2f} s, then {statistics.median(later):.2f} s", end="")
    print(f" (median of {repeat}, {min(later):.2f} to {max(later):.2f})")
    print(f"  one more, split {total:.2f} s: ", end="")
    print(", ".join(f"{name} {seconds:.2f} s ({seconds / total:.0%})" for name, seconds in parts.items()))


# Arms that were measured by a ball at the flange, along z of the tip, mm, in two sockets 50 mm apart.
BALLS: dict[str, tuple[str, str, str, float]] = {
    "panda_1": ("panda.urdf", "panda_link0", "panda_hand_tcp", 32),
    "panda_2": ("panda.urdf", "panda_link0", "panda_hand_tcp", 32),
    "kuka_14": ("iiwa14.urdf", "base_link", "tool0", 40),
    "dinova_1": ("gen3lite.urdf", "kinova_base_link", "end_effector_link", 180),
}
BEYOND_LIMITS = "dinova_1"  # its joint 6 really went beyond the limits of the URDF


def ball_run(data: Path, arm: str, folder: Path, geometry: str | None = "exact") -> Path:
    """A run file of the recordings of an arm, the TCP free; `geometry` None: as arms typically deviate."""
    urdf, base, tip, along = BALLS[arm]
    postures = {
        f"{file.parent.name}_{file.stem}": [[float(v) for v in row] for row in csv.reader(file.open())]
        for file in sorted(data.glob(f"mukca/{arm}/*/hole_*.csv"))
    }
    places = sorted({target.rpartition("_hole_")[0] for target in postures})
    header = {
        "schema": "zerobeam/run/1",
        "robot": {"urdf": str(data / "mukca/urdf" / urdf), "base": base, "tip": tip},
        "tool": {"kind": "probe", "calibrated": False, "point_mm": [0, 0, along]},
        "noise": {"joint_deg": 0.01, "spot_mm": 0.5},
        "limits": "warn" if arm == BEYOND_LIMITS else "error",
        "distances": [
            {"between": [f"{place}_hole_0", f"{place}_hole_1"], "mm": 50, "sigma_mm": 0.1} for place in places
        ],
        **({} if geometry is None else {"geometry": geometry}),
    }
    rows = [(target, joints) for target, several in postures.items() for joints in several]
    degrees = 57.29577951308232
    lines = [json.dumps(header)]
    for shot, (target, joints) in enumerate(rows):
        lines.append(
            json.dumps({"shot": shot, "target": target, "joints_deg": [angle * degrees for angle in joints]})
        )
    run = folder / f"{arm}.jsonl"
    run.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return run


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", nargs="*", type=Path, help="run files (default: built-in, and panda_2)")
    parser.add_argument("--repeat", type=int, default=3, help="processes timed after the first (default 3)")
    asked = parser.parse_args()

    if asked.run:
        for run in asked.run:
            measure(run.name, run, asked.repeat)
        return
    for run in sorted((ROOT / "experiments" / "demos").glob("*.jsonl")):
        measure(run.name, run, asked.repeat)
    data = Path(os.environ.get("ZEROBEAM_SHARED_DATA", ROOT.parent / "shared" / "data")).resolve()
    if (data / "mukca" / "panda_2").is_dir():
        with tempfile.TemporaryDirectory() as folder:
            measure("panda_2", ball_run(data, "panda_2", Path(folder)), asked.repeat)
    else:
        print(f"panda_2 left out: there is no mukca/panda_2 in {data}")


if __name__ == "__main__":
    main()
