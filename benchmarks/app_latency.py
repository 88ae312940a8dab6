"""How long the app takes to start and to answer a change of a plan, and what it promises.

python benchmarks/app_latency.py
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from typing import Any

import numpy as np

from zerobeam.model.robot import Matrix

POSTURES = {12: 100.0, 100: 300.0}  # and the promised ms
REPEATS = 21
ZEROBEAM = [sys.executable, "-c", "from zerobeam.cli import main; main()"]
HEADER = {
    "schema": "zerobeam/plan/1",
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": [900, 0, 0], "sigma_mm": 50}},
}


def postures(count: int) -> Matrix:
    """(count, 6) degrees, at a fixed seed; `check` turns them onto the target."""
    rng = np.random.default_rng(0)
    spread = np.array([15.0, 12.0, 12.0, 30.0, 15.0, 30.0])
    drawn: Matrix = rng.uniform(-spread, spread, size=(count, 6))
    return drawn


def ask(address: str, plan: dict[str, Any]) -> float:
    """ms from the question to the whole answer."""
    body = json.dumps({"plan": plan, "scene": True}).encode()
    request = urllib.request.Request(f"{address}api/check", body, {"X-Zerobeam": "1"})
    begun = time.perf_counter()
    with urllib.request.urlopen(request) as answer:
        answer.read()
    return 1000 * (time.perf_counter() - begun)


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        command = [*ZEROBEAM, "app", "--port", "0", "--no-open", "--dir", folder]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout is not None
                address = process.stdout.readline().removeprefix("The app: ").strip()
                print(f"start: {time.perf_counter() - begun:.2f} s (promised: 2 s)")
                for count, promised in POSTURES.items():
                    rows = postures(count).tolist()
                    times = []
                    for i in range(REPEATS):
                        rows[0][0] += 0.1  # a joint is dragged
                        times.append(ask(address, HEADER | {"postures_deg": rows}))
                        if i == 0:
                            print(f"{count} postures: the first answer {times.pop():.0f} ms")
                    median, most = statistics.median(times), max(times)
                    print(
                        f"{count} postures: median {median:.0f} ms, at most {most:.0f} ms ({promised:g} ms)"
                    )
            finally:
                process.terminate()


if __name__ == "__main__":
    main()
