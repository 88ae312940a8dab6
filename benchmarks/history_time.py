"""How long it takes to add results to a history, to ask it for one arm, and for the drift of all of them.

    python benchmarks/history_time.py [--results 2500] [--arms 200] [--db URL] [--times 3]

Copies of the result of the demo's good run, for other arms and dates, are read and added as
`zerobeam history add` does, a hundred in a transaction: the offsets of each arm walk (seed 0), every tenth
arm jumps once, every fourth changes its instrument once. Then arms are drawn at random (seed 0) and asked
for, and `zerobeam history drift` is run. CPU times (user and system, processes of its own included) are those
that count where other programs run beside it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import resource
import subprocess
import sys
import tempfile
import time
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np

from zerobeam.analysis.analyse import analyse
from zerobeam.experiments.demos import demo_runs
from zerobeam.experiments.history.database import open_history
from zerobeam.experiments.history.store import add, events, find_arm, results
from zerobeam.experiments.history.stored_result import read_entry
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.words.sentences import to_json

_AT_ONCE = 100
_ASKED = 200


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--results", type=int, default=2500)
    parser.add_argument("--arms", type=int, default=200)
    parser.add_argument("--db", default=None)
    parser.add_argument("--times", type=int, default=3)
    asked = parser.parse_args()
    run = read_run(next(demo.path for demo in demo_runs() if demo.name == "good"))
    answer = to_json(analyse(run, ess=100.0).result)
    sha256, first = answer["inputs"]["sha256"], '"to be stated"'
    answer["inputs"]["header"]["provenance"] = "to be stated"
    at_first, covariance = answer["without_prior"]["values"], np.array(answer["without_prior"]["covariance"])
    walks = np.random.default_rng(0)
    states = np.tile(at_first, (asked.arms, 1))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "result.json"
        address = asked.db or f"{folder}/history.sqlite"
        history = open_history(address, create=True)
        seconds, of_cpu, waiting = 0.0, 0.0, []
        for number in range(asked.results):
            arm, turn = number % asked.arms, number // asked.arms
            when = datetime(2000, 1, 1) + timedelta(days=90 * turn)
            changed = arm % 4 == 0 and turn > arm % 11
            stated = {"serial": f"arm {arm}", "when": when.isoformat(), "psd": "old" if changed else "new"}
            states[arm] += 0.01 * walks.normal(size=len(at_first))
            states[arm, 1] += 0.5 if arm % 10 == 3 and turn == 5 else 0.0
            answer["without_prior"]["values"] = walks.multivariate_normal(states[arm], covariance).tolist()
            text = dumps(answer)
            new = hashlib.sha256(json.dumps(stated).encode()).hexdigest()
            file.write_text(text.replace(first, json.dumps(stated)).replace(sha256, new), encoding="utf-8")
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
        for _ in range(asked.times):
            before = _of_children()
            subprocess.run(
                [Path(sys.executable).with_name("zerobeam"), "history", "drift", "--db", address],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                check=True,
            )
            print(f"the drift of all arms: {_of_children() - before:.1f} s of CPU")


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


if __name__ == "__main__":
    main()
