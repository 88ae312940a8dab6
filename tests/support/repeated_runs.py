"""Repeated runs made up for the tests of `compare`: with any scatter, and as files of simulated shots."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cells import TABLE_2, simulated

from zerobeam.analysis.repeatability.repeats import Repeat
from zerobeam.experiments.studies.table2 import EXPERIMENTS, OFFSETS
from zerobeam.model.files.plan import Plan
from zerobeam.model.files.run import write_run

NAMES = tuple(OFFSETS)
# Of three offsets, deg^2: stds of 0.05, 0.02 and 0.01 degrees, the first two going together.
COVARIANCE = np.array([[25.0, 8.0, 1.0], [8.0, 4.0, 0.5], [1.0, 0.5, 1.0]]) * 1e-4


def repeat(value: Sequence[float], covariance: Any = COVARIANCE, **changes: Any) -> Repeat:
    """One run of the first offsets of the arm, as if its shots had told `value`, deg."""
    size = len(value)
    stated = {
        "name": "run",
        "sha256": None,
        "robot": "arm",
        "shots": 10,
        "names": NAMES[:size],
        "units": ("deg",) * size,
        "held": ("delta1",),
        "status": ("identified",) * size,
        "value": np.array(value, dtype=float),
        "covariance": covariance,
        "by_geometry": np.zeros((size, 0)),
        "joint": covariance is not None,
    }
    return Repeat(**{**stated, **changes})


def repeats(values: np.ndarray, **changes: Any) -> list[Repeat]:
    return [repeat(value, name=f"run {k}", **changes) for k, value in enumerate(values, start=1)]


def drawn(count: int, seed: int) -> np.ndarray:
    """(count, 3) deg, scattered about 1 as COVARIANCE has it."""
    normal = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(1 + normal @ np.linalg.cholesky(COVARIANCE).T)


def table_file(folder: Path, rows: Any = EXPERIMENTS, names: Sequence[str] = OFFSETS) -> Path:
    """Table 2 of the paper, or another one, as people would type it."""
    text = io.StringIO()
    writer = csv.writer(text)
    writer.writerow(["run", *(f"{name}_deg" for name in names)])
    writer.writerows([f"experiment {k}", *map(repr, map(float, row))] for k, row in enumerate(rows, start=1))
    path = folder / "table2.csv"
    path.write_text(text.getvalue(), encoding="utf-8")
    return path


def run_files(folder: Path, plan: Plan, truths: Sequence[dict[str, float]], seed: int = 0) -> list[Path]:
    """Simulated runs of one plan, each with the offsets of Table 2 changed as stated."""
    paths = []
    for k, truth in enumerate(truths):
        _, run = simulated(plan, {**TABLE_2, **truth}, seed + k)
        paths.append(folder / f"run{k + 1}.jsonl")
        write_run(paths[-1], plan.header, run.shots)
    return paths
