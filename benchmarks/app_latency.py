"""How long the app takes to start, to show its page and to answer a change of a plan, and what it promises.

python benchmarks/app_latency.py

By the server alone: from the question to the whole answer. In the browser (headless Chromium, where there
is one): from the input event of a slider to the new number in the table, and to the first paint of the page.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.model.arrays import Matrix

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from chromium import BROWSERS, Tab, chromium

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
    root, _, token = address.partition("?token=")
    headers = {"X-Zerobeam": "1", "Authorization": f"Bearer {token}"}
    request = urllib.request.Request(f"{root}api/check", body, headers)
    begun = time.perf_counter()
    with urllib.request.urlopen(request) as answer:
        answer.read()
    return 1000 * (time.perf_counter() - begun)


_DRAG = """new Promise((then) => {
  const slider = document.querySelector('.joint input[type=range]');
  const table = document.querySelector('.determined');
  const begun = performance.now();
  slider.value = Number(slider.value) + 0.1;
  slider.dispatchEvent(new Event('input', {bubbles: true}));
  const watched = new MutationObserver(() => {
    if (table.getAttribute('aria-busy') !== 'false') return;
    watched.disconnect();
    then(performance.now() - begun);
  });
  watched.observe(table, {attributes: true, childList: true, subtree: true});
})"""
_PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
_READY = "document.querySelector('.determined tbody tr') && !document.querySelector('.determined.pending')"
_WEIGHT = "performance.getEntriesByType('resource').reduce((sum, one) => sum + one.decodedBodySize, 0)"


def until(tab: Tab, expression: str) -> Any:
    """What a JavaScript expression comes to, once it is neither null nor false."""
    while (found := tab.value(expression)) in (None, False):
        time.sleep(0.05)
    return found


def in_browser(address: str, folder: Path) -> None:
    """Print what a person waits for."""
    for count, promised in POSTURES.items():
        content = HEADER | {"postures_deg": postures(count).tolist()}
        (folder / f"{count}.yaml").write_text(json.dumps(content), encoding="utf-8")
        with chromium().opened(f"{address}#/job/./plan/{count}.yaml") as tab:
            paint = until(tab, _PAINT)
            until(tab, _READY)
            times = [float(tab.value(_DRAG)) for _ in range(REPEATS)][1:]
            weight = tab.value(_WEIGHT)
        print(f"in the browser: first paint {paint:.0f} ms (promised: 1000 ms), {weight / 1e6:.2f} MB")
        print(
            f"in the browser, {count} postures: from slider to number median"
            f" {statistics.median(times):.0f} ms, at most {max(times):.0f} ms ({promised:g} ms)"
        )


def main() -> None:
    """Print the table."""
    load = ", ".join(f"{own:.2f}" for own in os.getloadavg())
    print(f"{os.cpu_count()} processors, load {load}")
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
                if any(shutil.which(name) for name in BROWSERS):
                    in_browser(address, Path(folder))
            finally:
                process.terminate()


if __name__ == "__main__":
    main()
