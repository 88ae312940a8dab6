"""How long it takes to add results to a history, and to ask it for one arm.

    python benchmarks/history_time.py [--results 100000] [--arms 500] [--db URL]

Copies of the result of the demo's good run, for other arms and dates, are read and added as
`zerobeam history add` does, a hundred in a transaction; then arms are drawn at random (seed 0) and asked for.
CPU times are of this process: those that count where other programs run beside it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import tempfile
import time
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from zerobeam.analysis.analyse import analyse
from zerobeam.experiments.demos import demo_runs
from zerobeam.experiments.history.database import open_history
from zerobeam.experiments.history.entry import read_entry
from zerobeam.experiments.history.store import add, events, find_arm, results
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json

_AT_ONCE = 100
_ASKED = 200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=int, default=100_000)
    parser.add_argument("--arms", type=int, default=500)
    parser.add_argument("--db", default=None)
    asked = parser.parse_args()
    run = read_run(next(demo.path for demo in demo_runs() if demo.name == "good"))
    answer = to_json(analyse(run, ess=100.0).result)
    sha256, first = answer["inputs"]["sha256"], '"to be stated"'
    answer["inputs"]["header"]["provenance"] = "to be stated"
    text = dumps(answer)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "result.json"
        history = open_history(asked.db or f"{folder}/history.sqlite", create=True)
        seconds, of_cpu, waiting = 0.0, 0.0, []
        for number in range(asked.results):
            when = datetime(2000, 1, 1) + timedelta(days=number // asked.arms)
            own = {"serial": f"arm {number % asked.arms}", "when": when.isoformat()}
            new = hashlib.sha256(json.dumps(own).encode()).hexdigest()
            file.write_text(text.replace(first, json.dumps(own)).replace(sha256, new), encoding="utf-8")
            began, cpu = time.perf_counter(), time.process_time()
            waiting.append(read_entry(file, lambda sha256: None))
            if len(waiting) == _AT_ONCE or number == asked.results - 1:
                add(history, waiting)
                waiting.clear()
            seconds += time.perf_counter() - began
            of_cpu += time.process_time() - cpu
        each, own_each = (1000 * own / asked.results for own in (seconds, of_cpu))
        print(f"{asked.results} results added in {seconds:.0f} s: {each:.2f} ms each, CPU {own_each:.2f} ms")
        random, took, of_cpu = np.random.default_rng(0), [], time.process_time()
        for arm in random.integers(asked.arms, size=_ASKED):
            began = time.perf_counter()
            found = find_arm(history, f"arm {arm}")
            count = len(list(results(history, found))) + len(events(history, found))
            took.append(1000 * (time.perf_counter() - began))
        mean = 1000 * (time.process_time() - of_cpu) / _ASKED
        print(f"an arm with {count} results: median {np.median(took):.1f} ms, mean {mean:.1f} ms of CPU")
        history.engine.dispose()


if __name__ == "__main__":
    main()
