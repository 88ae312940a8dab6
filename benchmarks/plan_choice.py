"""How good and how fast is the choice of shots: by zerobeam, and by figaroh on the same candidates?

Prints the time of making the candidates, then for each criterion the time of the choice and its certified
efficiency, then figaroh's two D-optimal choices (`Detmax`, an exchange, and `SOCPOptimizer`, a continuous
design of which the k heaviest are taken) side by side with ours on growing sets of the same candidates.

figaroh has a good many dependencies: it gets an environment of its own.

    python3 -m venv /tmp/figaroh && /tmp/figaroh/bin/pip install figaroh
    .venv/bin/python benchmarks/plan_choice.py --figaroh /tmp/figaroh/bin/python
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from zerobeam.analysis.design.continuous_design import Candidates, offset_covariance, variance
from zerobeam.analysis.design.exact_design import design
from zerobeam.experiments.plans.candidates import CandidatePostures, candidates
from zerobeam.experiments.plans.optimal import Planner
from zerobeam.model.arrays import Index
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Obstacles
from zerobeam.model.files.robot_file import load_robot

SEED = 1
TARGET = (950.0, 150.0, 100.0)
SHOTS = 7
HEADER = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "calibrated": True, "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "geometry": "exact",
    "targets": {"psd": {"guess_mm": list(TARGET)}},
}

# Runs in figaroh's environment. Both classes take what they need as arguments: a dictionary of information
# matrices; nothing of pinocchio is asked of them. `Detmax` (1.0.2) leaves its `cur_set` empty and returns the
# criterion's history alone: the last set that it judged is its answer. What lasts too long is ended.
FIGAROH = """
import json, random, sys, time
import numpy as np
from figaroh.optimal.base_optimal_calibration import Detmax, SOCPOptimizer
matrices, shots, which = np.load(sys.argv[1]), int(sys.argv[2]), sys.argv[3]
pool = dict(enumerate(matrices))
start = time.perf_counter()
if which == "Detmax":
    class Kept(Detmax):
        def get_critD(self, rows):
            self.judged = list(rows)
            return super().get_critD(rows)
    random.seed(1)
    search = Kept(pool, shots)
    search.main_algo()
    rows = [int(i) for i in search.judged]
else:
    _, ranked = SOCPOptimizer(pool, {"NbSample": len(pool)}).solve()
    rows = [int(i) for i in list(ranked)[:shots]]
print("answer:" + json.dumps({"rows": rows, "seconds": time.perf_counter() - start}))
"""


def ours(found: Candidates) -> dict[str, float]:
    """Print our choice by each criterion; the seconds of each."""
    spent = {}
    for criterion in ("A", "D", "E"):
        start = time.perf_counter()
        chosen = design(found, [SHOTS], criterion, SEED)
        spent[criterion] = time.perf_counter() - start
        print(
            f"  {criterion}: {spent[criterion]:6.2f} s, certified efficiency {chosen.efficiency:.3f}"
            f" (continuous design of {chosen.support} postures)"
        )
    return spent


def theirs(python: Path, found: Candidates, which: str, limit: float) -> tuple[Index, float] | str:
    """figaroh's rows and its seconds, or why there are none."""
    matrices = found.roots.transpose(0, 2, 1) @ found.roots
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "matrices.npy"
        np.save(file, matrices)
        command = [str(python), "-W", "ignore", "-c", FIGAROH, str(file), str(SHOTS), which]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=limit)
        except subprocess.TimeoutExpired:
            return f"no answer within {limit:.0f} s"
    if done.returncode:
        return f"it failed: {done.stderr.strip().splitlines()[-1]}"
    answer = json.loads(done.stdout.rpartition("answer:")[2])
    return np.array(answer["rows"], dtype=np.int64), answer["seconds"]


def compare(python: Path, everything: Candidates, counts: list[int], limit: float) -> None:
    for count in counts:
        found = Candidates(everything.roots[:count], everything.offsets)
        # figaroh knows no nuisance: its D is of everything that is unknown, the target included. Ours is
        # asked for both, so that each is compared by the criterion that it was made for.
        whole = Candidates(found.roots, np.ones_like(found.offsets))
        asked = {"the offsets": found, "all unknowns, as figaroh": whole}
        best = {}
        print(f"\n{found.count} candidates, D-optimal {SHOTS}")
        for of, own in asked.items():
            start = time.perf_counter()
            chosen = design(own, [SHOTS], "D", SEED)
            best[of] = chosen.value, time.perf_counter() - start
            print(f"  zerobeam, for {of}: {best[of][1]:.2f} s, certified efficiency {chosen.efficiency:.3f}")
        for which in ("Detmax", "SOCPOptimizer"):
            answer = theirs(python, found, which, limit)
            if isinstance(answer, str):
                print(f"  figaroh {which}: {answer}")
                continue
            rows, seconds = answer
            print(f"  figaroh {which}: {seconds:.2f} s, postures {rows.tolist()}")
            for of, own in asked.items():
                # A posture that is chosen twice counts twice.
                value = variance(offset_covariance(own, own.information(rows)), "D")
                print(
                    f"    generalised variance of {of}: {value / best[of][0]:.3f} times ours,"
                    f" time {seconds / best[of][1]:.1f} times ours"
                )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--candidates", type=int, default=10_000)
    parser.add_argument("--figaroh", type=Path, help="the python of an environment with figaroh")
    parser.add_argument(
        "--limit", type=float, default=100.0, help="seconds for one choice of figaroh (default 100)"
    )
    asked = parser.parse_args()

    with threadpool_limits(limits=1, user_api="blas"):
        header, robot = Header.model_validate(HEADER), load_robot("irb1600", Path())
        start = time.perf_counter()
        postures: CandidatePostures = candidates(
            header, robot, np.array(TARGET), asked.candidates, obstacles=Obstacles(), seed=SEED
        )
        print(f"candidates: {time.perf_counter() - start:.2f} s; {postures.in_words()}")
        start = time.perf_counter()
        planner = Planner(header, robot, {"psd": np.array(TARGET)}, [postures])
        print(f"exact Jacobians: {time.perf_counter() - start:.2f} s")
        found = planner.candidates
        print(f"choice of {SHOTS} of {found.count}")
        ours(found)
        if asked.figaroh is None:
            print("figaroh left out: name the python of its environment by --figaroh")
            return
        counts = [c for c in (300, 1000, 3000) if c < found.count]
        compare(asked.figaroh, found, [*counts, found.count], asked.limit)


if __name__ == "__main__":
    main()
