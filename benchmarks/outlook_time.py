"""How long does `check` take with its outlook, over that without, side by side? And how near is the U that is
predicted of better postures to that of `plan optimal`?

    python benchmarks/outlook_time.py                # 7, 12 and 20 measurements, five times each
"""

from __future__ import annotations

import argparse
import statistics
import time
from pathlib import Path

import numpy as np

from zerobeam.analysis.observability.outlook import COVERAGE
from zerobeam.experiments.measuring_options import PlanOptions
from zerobeam.experiments.plans.constraints import check_plan
from zerobeam.experiments.plans.make import PlanRequest, make_plan
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan

HEADER = {
    "robot": "irb1600",
    "tool": {"kind": "laser", "point_mm": [0, 0, 65], "direction": [1, 0, 0]},
    "noise": {"joint_deg": 0.01, "spot_mm": 0.05},
    "targets": {"psd": {"guess_mm": [900, 0, 0]}},
}


def planned(shots: int, candidates: int) -> Plan:
    options = PlanOptions(shots=shots, candidates=candidates)
    request = PlanRequest.of("optimal", Header.model_validate(HEADER), Path("."), options)
    plan = make_plan(request, None, lambda stage, share: None).plan
    assert plan is not None
    return plan


def seconds(plan: Plan, *, outlook: bool) -> float:
    began = time.perf_counter()
    check_plan(plan, outlook=outlook)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--shots", type=int, nargs="*", default=[7, 12, 20])
    parser.add_argument("--repeat", type=int, default=5)
    options = parser.parse_args()
    print("measurements  check, s  outlook, s  ratio  predicted U / that of plan optimal")
    for shots in options.shots:
        poor, good = planned(shots, 30), check_plan(planned(shots, 10_000), outlook=False)
        outlook = check_plan(poor).outlook
        assert outlook is not None
        pairs = [[seconds(poor, outlook=each) for each in (False, True)] for _ in range(options.repeat)]
        without, whole = (statistics.median(times) for times in zip(*pairs, strict=True))
        best = next((row for row in outlook.remedies if row.remedy == "postures"), outlook.now)
        std = {row.name: row.std for row in good.parameters}
        ratio = np.median([(best.U[name] or np.inf) / (COVERAGE * (std[name] or np.inf)) for name in best.U])
        print(f"{shots:12d}  {without:8.3f}  {whole - without:10.3f}  {whole / without:5.1f}  {ratio:.2f}")


if __name__ == "__main__":
    main()
