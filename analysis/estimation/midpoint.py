"""The paper's own fit (eq. 8): middles of beam pairs, minus the mean of all middles.

Its residuals are correlated and it has no noise model, so it comes as a point estimate next to the
likelihood; what its scatter is follows from the joints' noise by the sandwich. The cost does not see the
gap between two skew beams, and two beams always cost zero. For a probe each shot gives one point, and the
points of a target are compared with their mean.

N beams have N (N - 1) / 2 pairs, and a midpoint does not separate into a part of each: the sum over all pairs
has no closed form of sums over shots. Above 50,000 pairs a random sample of 20,000 takes their place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...model.arrays import Index, Matrix
from ...model.errors import UnsoundResult
from ...model.instruments.flange_tool import FlangeTool
from ...model.likelihood.problem import Problem
from ...model.records import internal, it, record
from .levenberg_marquardt import Minimised, least_squares, levenberg_marquardt, solve_rows

_PAIRS = 50_000  # of beams: all of them up to here, of more
_SAMPLE = 20_000  # at random
_SEED = 0
_TOLERANCE = (1e-14, 1e-9)  # of the cost, where the search ends: of all pairs, and of a sample
_PARALLEL = 1e-4  # rad: beams nearer to parallel than this have no middle that could be trusted


@record
class MidpointFit:
    """`x` (p,) of the parameters `names`, internal units, with the offsets and tool of the fit (targets: the
    mean middle). Cost and rms are None where no pair of beams has a middle; of what only the likelihood fit
    has, all is."""

    available: Annotated[bool, it("false where the cost is not defined for these data")]
    converged: Annotated[bool, it("whether it has an answer")]
    reason: Annotated[str, it("termination, in words")]
    iterations: Annotated[int, it("how many")]
    cost: Annotated[float | None, it("at the end")]
    rms_mm: Annotated[float | None, it("of the residuals in lengths (3-vectors), millimetres")]
    message: Annotated[str | None, it("what else is to be known, in words")]
    names: Annotated[tuple[str, ...], internal] = field(compare=False)
    x: Annotated[Matrix, internal] = field(compare=False)
    rms_before_mm: Annotated[None, it("not of this fit")] = None
    rms_deg: Annotated[None, it("not of this fit")] = None
    rms_before_deg: Annotated[None, it("not of this fit")] = None
    chi2: Annotated[None, it("not of this fit")] = None
    dof: Annotated[None, it("not of this fit")] = None
    p_value: Annotated[None, it("not of this fit")] = None
    noise_scale: Annotated[None, it("not of this fit")] = None
    other_basins: Annotated[int, it("not of this fit")] = 0

    def __post_init__(self) -> None:
        if not self.available and (self.cost is not None or self.rms_mm is not None):
            raise UnsoundResult("the midpoint fit is not available, yet it has numbers")


@dataclass(frozen=True, eq=False)
class MidpointFits(Minimised):
    """The fits of W data sets: `x` (W, p), `cost` (W,) and the (W, g, g) covariance of the free offsets and
    tool, scaled by their priors, in the order of `free` (p,). No prior enters this fit."""

    x: Matrix
    covariance: Matrix
    free: NDArray[np.bool_]
    cost: Matrix
    points: int


def fit_midpoint(problem: Problem) -> MidpointFit:
    """Minimise eq. 8 from zero offsets by Levenberg-Marquardt, each target with a mean of its own."""
    middles, message = _Middles.of(problem)
    names = problem.parameters.names
    if middles is None:
        start = problem.parameters.prior_mean
        return MidpointFit(False, False, "not defined", 0, None, None, message, names, start)
    fits = _fitted(middles, problem.joints[None])
    cost = float(fits.cost[0])
    rms = float(np.sqrt(2 * cost / fits.points))
    converged, iterations = bool(fits.converged[0]), int(fits.iterations[0])
    return MidpointFit(True, converged, fits.reason[0], iterations, cost, rms, message, names, fits.x[0])


def fit_midpoints(problem: Problem, joints: Matrix) -> MidpointFits:
    """The same for data sets that share all but the recorded `joints` (W, N, n).

    The covariance is the sandwich (J'J)^-1 J' M J (J'J)^-1 (White 1980), in which M is what the stated noise
    of the joints does to all middles: one shot has a part in many. Raises ValueError where no pair of beams
    has a middle.
    """
    middles, message = _Middles.of(problem)
    if middles is None:
        raise ValueError(message)
    return _fitted(middles, joints, with_covariance=True)


def _fitted(middles: _Middles, joints: Matrix, with_covariance: bool = False) -> MidpointFits:
    parameters = middles.problem.parameters
    scale = parameters.prior_std
    # The paper's cost has no priors: what is known to a tolerance, as a calibrated tool, is taken as stated.
    estimated = parameters.free & ~parameters.tolerated
    free = estimated & (parameters.group("offset") | parameters.group("tool"))

    def at(z: Matrix) -> Matrix:
        x = np.tile(parameters.prior_mean, (len(z), 1))
        x[:, free] += z * scale[free]
        return x

    def residual(z: Matrix, rows: Index) -> tuple[Matrix, Matrix]:
        points, jacobian, _ = middles.at(at(z), joints[rows])
        centred, by_z = middles.centred(points), middles.centred(jacobian[..., free] * scale[free])
        centred = centred.reshape(len(z), -1)
        return centred, by_z.reshape(*centred.shape, by_z.shape[-1])

    start, tolerance = np.zeros((len(joints), int(free.sum()))), _TOLERANCE[middles.sampled]
    minima = levenberg_marquardt(least_squares(residual), start, tolerance=tolerance)
    x = at(minima.x)
    points, _, by_shots = middles.at(x, joints)
    x[:, parameters.group("target")] = middles.means(points).reshape(len(x), -1)
    covariance = np.zeros((len(x), 0, 0))
    if with_covariance:
        _, jacobian = residual(minima.x, np.arange(len(x)))
        covariance = _sandwich(middles, jacobian, by_shots)
    converged = minima.converged & np.isfinite(covariance).all(axis=(1, 2))
    return MidpointFits(
        minima.iterations, converged, minima.reason, x, covariance, free, minima.cost, points.shape[1]
    )


def _sandwich(middles: _Middles, jacobian: Matrix, by_shots: Sequence[Matrix]) -> Matrix:
    """(W, g, g): to first order z moves by -(J'J)^-1 J' dr, and dr by the joints' noise of every shot."""
    problem = middles.problem
    count = len(jacobian)
    moved = np.zeros((count, problem.shots, problem.robot.n, *by_shots[0].shape[1:3]))  # (W, N, n, m, 3)
    rows = np.arange(by_shots[0].shape[1])
    for shots, by_shot in zip(middles.shots, by_shots, strict=True):
        # By the noise of one joint of one shot: the middles in which that shot has a part.
        moved[:, shots, :, rows] += by_shot.transpose(1, 0, 3, 2)
    by_noise = middles.centred(moved.transpose(0, 3, 4, 1, 2).reshape(count, len(rows), 3, -1))
    by_noise = by_noise.reshape(count, jacobian.shape[1], -1) * np.tile(problem.noise.joint, problem.shots)
    if not problem.tool.beam:
        # The ball does not sit quite at the centre of its socket: each tip is off by as much, any way.
        size = jacobian.shape[1]
        apart = middles.centred(np.eye(size).reshape(1, -1, 3, size)).reshape(1, size, size)
        apart = np.broadcast_to(apart * problem.noise.spot, (count, size, size))
        by_noise = np.concatenate([by_noise, apart], axis=2)
    transposed = jacobian.transpose(0, 2, 1)
    half = solve_rows(transposed @ jacobian, transposed @ by_noise)
    covariance: Matrix = half @ half.transpose(0, 2, 1)
    return covariance


class _Middles:
    """The points whose scatter eq. 8 measures: (W, m, 3) and their Jacobian (W, m, 3, p).

    `shots` names the shots of each point: two for the middle of a pair, one for a tip; `sampled` says that
    there are more pairs than these.
    """

    def __init__(self, problem: Problem, shots: tuple[Index, ...], sampled: bool = False) -> None:
        self.problem = problem
        self.shots = shots
        self.sampled = sampled
        self._target = problem.target_index[shots[0]]

    @classmethod
    def of(cls, problem: Problem) -> tuple[_Middles | None, str | None]:
        """The pairs that have a middle, and a sentence on those that have none."""
        if not isinstance(problem.tool, FlangeTool):
            return None, "the paper's fit is not defined for these instruments"
        if not problem.tool.beam:
            of = problem.tool.name
            note = f"a {of} has points, not beams: the scatter of the tip's positions is minimised"
            return cls(problem, (np.arange(problem.shots),)), note
        first, second, every = _pairs(problem)
        message = None
        if len(first) < every:
            message = (
                f"of the {every} pairs of beams {len(first)} are used, a random sample (seed {_SEED}); nearly"
                " parallel pairs dominate eq. 8, and another sample gives other estimates"
            )
        _, direction = problem.beams(problem.parameters.prior_mean)
        kept = np.linalg.norm(np.cross(direction[first], direction[second]), axis=1) > _PARALLEL
        if not kept.all():
            pairs, lost = len(kept), np.flatnonzero(~kept)
            i, j = (problem.shot_numbers[shots[lost[0]]] for shots in (first, second))
            parallel = (
                f"{len(lost)} of {pairs} pairs of beams are parallel and have no"
                f" middle (measurements {i} and {j}, for one): they are left out"
            )
            message = parallel if message is None else f"{message}; {parallel}"
        if not kept.any():
            return None, (message or "no target is seen from two measurements") + "; nothing is left to fit"
        return cls(problem, (first[kept], second[kept]), sampled=len(first) < every), message

    def at(self, x: Matrix, joints: Matrix) -> tuple[Matrix, Matrix, list[Matrix]]:
        """Points, their Jacobian by x (W, p), and (W, m, 3, n) by the joints of each of their shots."""
        problem = self.problem
        count, n, m = len(x), problem.robot.n, len(self._target)
        parts, parameters = problem.split(x), problem.parameters
        arm, tool = (np.repeat(part, m, axis=0) for part in (parts.arm, parts.tool))
        turned = [joints[:, shots].reshape(count * m, n) for shots in self.shots]
        if len(turned) == 2:
            middle = problem.functions.kernel("midpoint")
            points, by_unknowns, *by_shots = middle(*turned, arm, tool)
        else:
            tip = tool if tool.shape[1] else np.tile(problem.tool.point, (count * m, 1))
            points, by = problem.functions.kernel("placed")(*turned, arm, tip)
            by_unknowns = by if tool.shape[1] else by[:, :, : arm.shape[1]]
            by_shots = [by_unknowns[:, :, parameters.block("offset")]]
        jacobian = np.zeros((count, m, 3, len(parameters)))
        by_unknowns = by_unknowns.reshape(count, m, 3, -1)
        jacobian[..., parameters.arm] = by_unknowns[..., : arm.shape[1]]
        jacobian[..., parameters.block("tool")] = by_unknowns[..., arm.shape[1] :]
        return points.reshape(count, m, 3), jacobian, [by.reshape(count, m, 3, n) for by in by_shots]

    def means(self, values: Matrix) -> Matrix:
        """(W, K, ...) means over the points of each target (zero for a target without any)."""
        result = np.zeros((len(values), len(self.problem.targets), *values.shape[2:]))
        for k in range(len(self.problem.targets)):
            mine = self._target == k
            if mine.any():
                result[:, k] = (values if mine.all() else values[:, mine]).mean(axis=1)
        return result

    def centred(self, values: Matrix) -> Matrix:
        means = self.means(values)
        return np.asarray(values - (means if means.shape[1] == 1 else means[:, self._target]))


def _pairs(problem: Problem) -> tuple[Index, Index, int]:
    """The two shots of each pair of beams at one target, all or a random sample of them, and how many pairs
    there are."""
    order = np.argsort(problem.target_index, kind="stable")
    of = problem.target_index[order]
    later = np.searchsorted(of, of, side="right") - 1 - np.arange(len(of))  # shots with which each has a pair
    end = np.cumsum(later)
    every = int(end[-1]) if len(end) else 0
    if every <= _PAIRS:
        chosen = np.arange(every)
    else:
        chosen = np.sort(np.random.default_rng(_SEED).choice(every, _SAMPLE, replace=False, shuffle=False))
    first = np.searchsorted(end, chosen, side="right")
    second = first + 1 + chosen - (end - later)[first]
    return order[first], order[second], every
