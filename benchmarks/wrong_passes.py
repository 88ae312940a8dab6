"""How many passes are wrong where something changed while it was measured: the table of docs/diagnosis.md.

Arms as real ones are, by the tests' own simulator (links, gravity, harmonics, mounting), each with one
change: the zero of a joint jumps halfway or drifts, the target moves halfway, one reading is off. A pass is
wrong where an offset of J2 to J5 is off by more than 4 u, for the arm as it is at the end.

    python benchmarks/wrong_passes.py --arms 400
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))
from cells import LASER, header, irb1600
from deviating_arms import Arms
from plan_requests import plan_request

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.observability.changes import repeats_differ
from zerobeam.experiments.plans.make import make_plan
from zerobeam.model.files.plan import Plan
from zerobeam.model.kernel import one_blas_thread
from zerobeam.model.likelihood.problem import Problem

TARGET = np.array([900.0, 0.0, 0.0])  # mm
PLANS = ((7, 2), (12, 2), (12, 4), (20, 2))  # measurements, of which are measured again
SIZES = {
    "jump": (0.06,),  # degrees; of larger ones few pass, smaller ones are within 4 u
    "drift": (0.08,),
    "moved target": (0.7, 1.5),  # mm
    "one reading": (4.0, 8.0),
}
WORST = 4.0  # of u


def recorded(
    arms: Arms, plan: Plan, what: str, size: float, rng: np.random.Generator
) -> tuple[Arms, np.ndarray, np.ndarray]:
    """The arms at the end, (A, S, n) their recorded joints, rad, and (A, S) which postures were reached."""
    count, shots = len(arms.offsets), len(plan.postures)
    joint, rows = rng.integers(1, 5, size=count), np.arange(count)
    way = rng.normal(size=(count, 3))
    way *= size / np.linalg.norm(way, axis=1)[:, None]
    which = rng.integers(0, shots, size=count)
    last, joints, hit = arms, [], []
    for shot in range(shots):
        share = {"jump": float(shot >= shots // 2), "drift": shot / (shots - 1)}.get(what, 0.0)
        offsets = arms.offsets.copy()
        offsets[rows, joint] += np.radians(size) * share
        last = replace(arms, offsets=offsets)
        target = np.zeros((count, 1, 3)) + TARGET
        if what == "moved target" and shot >= shots // 2:
            target += way[:, None]
        if what == "one reading":
            target[which == shot] += way[which == shot, None]
        q, reached = last.recorded(plan.postures[shot : shot + 1], target, rng)
        joints.append(q)
        hit.append(reached)
    return last, np.concatenate(joints, axis=1), np.concatenate(hit, axis=1)


def outcome(plan: Plan, what: str, size: float, count: int, seed: int) -> tuple[int, int]:
    """How many of the arms pass, and how many of these are wrong."""
    rng = np.random.default_rng(seed)
    arms, joints, hit = recorded(Arms.at_random(count, rng), plan, what, size, rng)
    passes = wrong = 0
    for k in range(count):
        rows = joints[k][hit[k]]
        problem = Problem.build(plan.header, irb1600(), rows, ["psd"] * len(rows))
        solution = solve_run(problem, plan.header)
        if solution.misfit is not None or repeats_differ(solution.problem, solution.fit.x) is not None:
            continue
        passes += 1
        z = (solution.fit.x[1:5] - arms.offsets[k, 1:5]) / solution.std[1:5]
        wrong += bool(np.abs(z).max() > WORST)
    return passes, wrong


def made(measurements: int, again: int) -> Plan:
    request = plan_request(header=header(LASER, target=None, geometry=None), shots=measurements, repeat=again)
    plan = make_plan(request, None, lambda stage, share: None).plan
    assert plan is not None
    return plan


def rows(arms: int, seed: int) -> Iterator[str]:
    yield f"| plan of an IRB 1600 | {' | '.join(SIZES)} |"
    yield f"| --- |{' --- |' * len(SIZES)}"
    for measurements, again in PLANS:
        plan, cells = made(measurements, again), []
        for what, sizes in SIZES.items():
            found = [(*outcome(plan, what, size, arms, seed), size) for size in sizes]
            print(f"{measurements} + {again}, {what}: {found}", file=sys.stderr, flush=True)
            passes, wrong, size = max(found, key=lambda one: one[1] / max(one[0], 1))
            unit = "°" if what in ("jump", "drift") else " mm"
            cells.append(f"{wrong} of {passes} ({size:g}{unit})")
        yield f"| {measurements}, the first {again} again | {' | '.join(cells)} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--arms", type=int, default=400, help="of each size")
    parser.add_argument("--seed", type=int, default=1)
    chosen = parser.parse_args()
    with one_blas_thread():
        for line in rows(chosen.arms, chosen.seed):
            print(line, flush=True)
