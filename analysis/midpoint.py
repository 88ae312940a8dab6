"""The paper's own fit (eq. 8): middles of beam pairs, minus the mean of all middles.

Its residuals are correlated and it has no noise model, so it comes as a point estimate next to the
likelihood. The cost does not see the gap between two skew beams, and two beams always cost zero.
For a probe each shot gives one point, and the points of a target are compared with their mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..model.constraint import midpoint_function
from ..model.kernel import Kernel
from ..model.problem import Index, Problem
from ..model.robot import Matrix
from .levenberg_marquardt import levenberg_marquardt

_PARALLEL = 1e-4  # rad: beams nearer to parallel than this have no middle that could be trusted


@dataclass(frozen=True, eq=False)
class MidpointFit:
    """`x` (p,) internal units with the offsets and tool of the fit (targets: the mean middle).

    `available` is False where no pair of beams has a middle; `rms` is over the 3-vectors, mm.
    """

    x: Matrix
    available: bool
    converged: bool
    reason: str
    iterations: int
    cost: float
    rms: float
    message: str | None


def fit_midpoint(problem: Problem) -> MidpointFit:
    """Minimise eq. 8 from zero offsets by Levenberg-Marquardt, each target with a mean of its own."""
    parameters = problem.parameters
    middles, message = _Middles.of(problem)
    if middles is None:
        return MidpointFit(
            parameters.prior_mean, False, False, "not defined", 0, float("nan"), float("nan"), message
        )
    scale = parameters.prior_std
    free = parameters.free & ~parameters.group("target")

    def residual(z: Matrix) -> tuple[Matrix, Matrix]:
        x = parameters.prior_mean.copy()
        x[free] += z * scale[free]
        points, jacobian = middles.at(x)
        centred, by_x = middles.centred(points), middles.centred(jacobian)
        return centred.reshape(-1), (by_x * scale).reshape(-1, len(parameters))[:, free]

    found = levenberg_marquardt(residual, np.zeros(int(free.sum())))
    x = parameters.prior_mean.copy()
    x[free] += found.x * scale[free]
    points, _ = middles.at(x)
    means = middles.means(points)
    x[parameters.group("target")] = means.reshape(-1)
    rms = float(np.sqrt(2 * found.cost / len(points)))
    return MidpointFit(x, True, found.converged, found.reason, found.iterations, found.cost, rms, message)


class _Middles:
    """The points whose scatter eq. 8 measures: (m, 3) and their Jacobian (m, 3, p)."""

    def __init__(self, problem: Problem, first: Index, second: Index) -> None:
        self._problem = problem
        self._first, self._second = first, second
        self._target = problem.target_index[self._first]
        self._pairs = Kernel(midpoint_function(problem.robot, problem.tool)) if len(second) else None
        self._placed = problem.functions.kernel("placed")

    @classmethod
    def of(cls, problem: Problem) -> tuple[_Middles | None, str | None]:
        """The pairs that have a middle, and a sentence on those that have none."""
        if problem.tool.kind == "probe":
            told = "a probe has points, not beams: the scatter of the tip's positions is minimised"
            return cls(problem, np.arange(problem.shots), np.zeros(0, dtype=int)), told
        origin_direction = problem.functions.kernel("beam")
        delta, _, tool = problem.split(problem.parameters.prior_mean)
        _, direction = origin_direction(problem.joints, delta, tool)
        kept: list[tuple[int, int]] = []
        parallel: list[tuple[int, int]] = []
        for i, j in combinations(range(problem.shots), 2):
            if problem.target_index[i] == problem.target_index[j]:
                sine = float(np.linalg.norm(np.cross(direction[i], direction[j])))
                (kept if sine > _PARALLEL else parallel).append((i, j))
        message = None
        if parallel:
            i, j = (problem.shot_numbers[s] for s in parallel[0])
            message = (
                f"{len(parallel)} of {len(parallel) + len(kept)} pairs of beams are parallel and have no"
                f" middle (shots {i} and {j}, for one): they are left out"
            )
        if not kept:
            return None, (message or "no target is seen by two shots") + "; nothing is left to fit"
        first, second = np.array(kept).T
        return cls(problem, first, second), message

    def at(self, x: Matrix) -> tuple[Matrix, Matrix]:
        problem = self._problem
        delta, _, tool = problem.split(x)
        n = problem.robot.n
        if self._pairs is not None:
            joints = problem.joints
            points, own = self._pairs(joints[self._first], joints[self._second], delta, tool)
        else:
            tip = tool if len(tool) else problem.tool.point
            points, by = self._placed(problem.joints[self._first], delta, tip)
            own = by if len(tool) else by[:, :, :n]
        jacobian = np.zeros((len(points), 3, len(problem.parameters)))
        jacobian[:, :, :n] = own[:, :, :n]
        jacobian[:, :, n + 3 * len(problem.targets) :] = own[:, :, n:]
        return points, jacobian

    def means(self, values: Matrix) -> Matrix:
        """(K, ...) means over the points of each target (zero for a target without any)."""
        result = np.zeros((len(self._problem.targets), *values.shape[1:]))
        for k in range(len(result)):
            mine = self._target == k
            if mine.any():
                result[k] = values[mine].mean(axis=0)
        return result

    def centred(self, values: Matrix) -> Matrix:
        return np.asarray(values - self.means(values)[self._target])
