"""Which of a run's own postures verify its calibration best: known to be reachable, and free of obstacles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...model.arrays import Matrix
from ...model.files.header import Header
from ..solution import Solution
from .acceptance_test import POWER, EnteredOffset, Prediction, entered_offsets

FEWEST = 3
MOST = 12
_MOST_CANDIDATES = 60  # spread over the run: more are as good


@dataclass(frozen=True, eq=False)
class VerificationPlan:
    """The chosen measurements of the run by their index (`rows`), the `joints` (N, n) rad or mm that the
    corrected robot reads there, and the power of the test, offset by offset."""

    rows: tuple[int, ...]
    joints: Matrix
    targets: tuple[str, ...]
    offsets: tuple[EnteredOffset, ...]

    @property
    def enough(self) -> bool:
        return all(own.power >= POWER for own in self.offsets)


def choose(
    solution: Solution,
    header: Header,
    entered: tuple[str, ...],
    tolerance: Mapping[str, float],
    shots: int | None = None,
) -> VerificationPlan:
    """As few postures as give the test its power (or `shots` of them), one after the other: each the one that
    raises the weakest offset most."""
    problem = solution.problem
    candidates = np.unique(np.linspace(0, problem.shots - 1, _MOST_CANDIDATES).round().astype(int)).tolist()
    applied = np.zeros(problem.robot.n)
    for j, item in enumerate(problem.parameters.items[problem.parameters.block("offset")]):
        if item.name in entered:
            applied[j] = solution.fit.x[problem.parameters.index(item.name)]

    def planned(rows: list[int]) -> tuple[Matrix, tuple[str, ...], tuple[EnteredOffset, ...]]:
        joints = problem.joints[rows] + applied
        targets = tuple(problem.targets[problem.target_index[row]] for row in rows)
        prediction = Prediction(solution, header, joints, targets, None, entered)
        found = prediction.shifted({})
        return joints, targets, entered_offsets(prediction, found, solution, tolerance)

    def score(rows: list[int]) -> tuple[float, float]:
        powers = [own.power for own in planned(rows)[2]]
        return min(powers), sum(powers)

    most = min(shots or MOST, problem.shots)
    rows = list(_farthest(problem.joints[candidates], candidates, min(FEWEST, most)))
    while len(rows) < most:
        if shots is None and score(rows)[0] >= POWER:
            break
        rest = [row for row in candidates if row not in rows]
        if not rest:
            break
        rows.append(max(rest, key=lambda row: score([*rows, row])))
    joints, targets, offsets = planned(sorted(rows))
    return VerificationPlan(tuple(sorted(rows)), joints, targets, offsets)


def _farthest(joints: Matrix, rows: list[int], count: int) -> list[int]:
    """Postures far from one another: the first two apart most, then always the one farthest from all."""
    apart = np.linalg.norm(joints[:, None] - joints[None], axis=2)
    first = divmod(int(apart.argmax()), len(rows))
    chosen = list(first) if len(rows) > 1 else [0]
    while len(chosen) < count:
        chosen.append(int(apart[:, chosen].min(axis=1).argmax()))
    return [rows[i] for i in dict.fromkeys(chosen)]
