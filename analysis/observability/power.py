"""What a run of these measurements could notice: the power of the test of its residuals against wrong models.

A wrong model moves the whitened residuals by b. The fit takes up what its parameters can: it leaves M b, and
moves what has a tolerance by -C A' b, with the Jacobian A by the scaled parameters, C = (A'A + I)^-1 and
M = I - A C A'. Their squares together are the noncentrality of the chi-squared of residuals and tolerances
(`LikelihoodFit.against_noise`); the power is the probability that it is beyond what chance leaves (JCGM 106
speaks of a consumer's risk: 1 less than that). The other tests of a misfit notice more: it is a lower bound.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy

from ...model.arrays import Index, Mask, Matrix
from ...model.likelihood.parameters import Parameter
from ...model.likelihood.problem import Problem
from ..status import LACK_OF_FIT

WrongModel = Literal["tool", "jump", "backlash", "noise"]

NOTICED = 0.8  # power from which on a wrong model counts as noticed
HARMLESS = (
    1.0  # error of an offset, in its standard uncertainty, below which a wrong model need not be noticed
)
_SPLITS = 8  # random halves that exchanges begin with
_MORE = 1e-9  # relative: less is no improvement
TOOL_MM, JUMP_DEG, BACKLASH_DEG, NOISE_TIMES = 1.0, 0.2, 0.03, 3.0


@dataclass(frozen=True)
class DetectionPower:
    """A run notices a `wrong` model of this `size` (mm, deg, or 1: times the stated) with a `probability`.

    "tool": a point of the tool is off by that, in the direction that does most harm of those that are not
    noticed, or is noticed least; "jump": the zero of `joint` (from 1), chosen likewise, jumps halfway;
    "backlash": every joint is off by that, one way or the other; "noise": the readings scatter so many times
    as much. `off_u` is the error that it makes of an offset, in its standard uncertainty, the largest of all.
    """

    wrong: WrongModel
    size: float
    unit: str
    probability: float
    off_u: float
    joint: int | None = None

    @property
    def noticed(self) -> bool:
        """Whether a run notices it with a probability that is enough."""
        return self.probability >= NOTICED

    @property
    def dangerous(self) -> bool:
        """Whether a run may pass with offsets that it makes wrong."""
        return not self.noticed and self.off_u >= HARMLESS


def powers(problem: Problem, x: Matrix, rank: int) -> tuple[DetectionPower, ...]:
    """Of measurements that hit, at x (p,); `rank` numbers are taken up by the fit.

    None where the noise is estimated, or no number is left: nothing is tested then, and nothing noticed.
    """
    dof = problem.data_size - rank
    if not problem.noise.known or dof <= 0:
        return ()
    return tuple(_powers(_Biases(problem, x), dof))


def halves(problem: Problem, x: Matrix) -> tuple[Index, Index]:
    """The measurements in two halves: a jump of a joint's zero between them is noticed most, of the joint of
    which it is noticed least."""
    second = np.arange(problem.shots) >= problem.shots // 2
    revolute = _revolute(problem)
    if problem.shots < 3 or not revolute:
        return np.flatnonzero(~second), np.flatnonzero(second)
    biases = _Biases(problem, x)
    jumps = biases.by_joints[:, :, revolute]
    u = np.einsum("nda,ndj->jna", biases.roots, jumps)
    form = u @ biases.taken @ u.transpose(0, 2, 1)  # (n, N, N): noncentrality of biases, by measurements
    each = np.arange(problem.shots)
    form[:, each, each] += (jumps**2).sum(axis=1).T
    rng, ends = np.random.default_rng(0), []
    for _ in range(_SPLITS):
        second = rng.permutation(second)
        ends.append(_exchanged(form, second))
    return max(ends, key=lambda end: end[0])[1]


def _exchanged(form: Matrix, second: Mask) -> tuple[float, tuple[Index, Index]]:
    """The halves, two measurements exchanged as long as that raises the least of the sums over the second."""
    while True:
        first, chosen = np.flatnonzero(~second), np.flatnonzero(second)
        rows = form[:, :, chosen].sum(axis=2)
        total, alone = rows[:, chosen].sum(axis=1), np.diagonal(form, axis1=1, axis2=2)
        gain = (alone + 2 * rows)[:, first, None] + (alone - 2 * rows)[:, None, chosen]
        after = (total[:, None, None] + gain - 2 * form[:, first[:, None], chosen]).min(axis=0)
        enter, leave = np.unravel_index(int(np.argmax(after)), after.shape)
        if after[enter, leave] <= total.min() * (1 + _MORE):
            return float(total.min()), (first, chosen)
        second = second.copy()
        second[first[enter]], second[chosen[leave]] = True, False


class _Biases:
    """What a fit makes of biases b of the whitened residuals, by u = A'b (f, k) and the squares b'b (k,)."""

    def __init__(self, problem: Problem, x: Matrix) -> None:
        self.problem, parameters = problem, problem.parameters
        whitened = problem.whiten(x)
        jacobian = whitened.jacobian
        self.columns = jacobian[:, parameters.free]
        gram = self.columns.T @ self.columns
        self.covariance = np.linalg.inv(gram + np.eye(len(gram)))
        at = parameters.among_free[problem.tolerated]
        # |M b|^2 and the squares of what has a tolerance: b'b + u' Q u.
        self.taken = self.covariance @ gram @ self.covariance - 2 * self.covariance
        self.taken += self.covariance[:, at] @ self.covariance[at]
        offsets = parameters.group("offset")[parameters.free]
        self.into = self.covariance[offsets] / np.sqrt(np.diag(self.covariance)[offsets])[:, None]
        _, shot_jacobians = problem.linearise(x)
        by_joints = np.linalg.solve(whitened.factor, problem.by_joints(shot_jacobians))
        # (N, d, n) of each measurement by its joints, rad or mm; (N, d, f) of it by the parameters.
        self.by_joints = by_joints * np.sqrt(problem.weights)[:, None, None]
        self.roots = problem.roots(whitened)
        tool = [parameters.index(item.name) for item in parameters.items if _shifts(item)]
        self.by_tool = jacobian[:, tool] / parameters.prior_std[tool]

    def squares(self, square: Matrix, u: Matrix) -> Matrix:
        """(k,) the noncentralities of biases."""
        return np.asarray(np.maximum(square + (u * (self.taken @ u)).sum(axis=0), 0.0))

    def off(self, u: Matrix) -> Matrix:
        """(k,) the largest error of an offset by biases, in its u."""
        return np.asarray(np.abs(self.into @ u).max(axis=0, initial=0.0))


def _revolute(problem: Problem) -> list[int]:
    return [i for i, joint in enumerate(problem.robot.joints) if joint.kind == "revolute"]


def _shifts(item: Parameter) -> bool:
    return item.group == "tool" and item.tolerated and item.unit == "mm" and not item.held


def _powers(biases: _Biases, dof: int) -> Iterator[DetectionPower]:
    limit = float(scipy.special.chdtri(dof, LACK_OF_FIT))
    if biases.by_tool.shape[1]:
        yield _of_tool(biases, dof, limit)
    revolute = _revolute(biases.problem)
    if revolute:
        yield _of_jump(biases, revolute, dof, limit)
        yield _of_backlash(biases, revolute, dof, limit)
    yield _of_noise(biases, dof, limit)


def _of_tool(biases: _Biases, dof: int, limit: float) -> DetectionPower:
    moved = biases.by_tool * TOOL_MM
    u = biases.columns.T @ moved
    # Directions by how much they are noticed.
    _, directions = np.linalg.eigh(moved.T @ moved + u.T @ biases.taken @ u)
    moved, u = moved @ directions, u @ directions
    squares, off = biases.squares((moved**2).sum(axis=0), u), biases.off(u)
    cases = [
        DetectionPower("tool", TOOL_MM, "mm", _of_square(limit, dof, square), error)
        for square, error in zip(squares.tolist(), off.tolist(), strict=True)
    ]
    return _most_harmful(cases)


def _most_harmful(cases: Sequence[DetectionPower]) -> DetectionPower:
    """The case that does most harm of those that are not noticed; where all are, the one noticed least."""
    unnoticed = [case for case in cases if not case.noticed]
    if unnoticed:
        return max(unnoticed, key=lambda case: case.off_u)
    return min(cases, key=lambda case: case.probability)


def _of_jump(biases: _Biases, revolute: list[int], dof: int, limit: float) -> DetectionPower:
    second = slice(biases.problem.shots // 2, None)
    jumps = biases.by_joints[second][:, :, revolute] * np.radians(JUMP_DEG)
    u = np.einsum("nda,ndj->aj", biases.roots[second], jumps)
    squares, off = biases.squares((jumps**2).sum(axis=(0, 1)), u), biases.off(u)
    cases = [
        DetectionPower("jump", JUMP_DEG, "deg", _of_square(limit, dof, square), error, joint + 1)
        for square, error, joint in zip(squares.tolist(), off.tolist(), revolute, strict=True)
    ]
    return _most_harmful(cases)


def _of_backlash(biases: _Biases, revolute: list[int], dof: int, limit: float) -> DetectionPower:
    """One way or the other in each measurement: over all ways the noncentrality has a mean and a variance."""
    each = biases.by_joints[:, :, revolute] * np.radians(BACKLASH_DEG)
    us = np.einsum("nda,ndj->naj", biases.roots, each)
    apart = np.einsum("ndi,ndj->nij", each, each)
    through = us.transpose(0, 2, 1) @ (biases.taken @ us)
    spread = biases.taken @ np.einsum("nai,nbi->ab", us, us)
    mean = float(np.trace(apart + through, axis1=1, axis2=2).sum())
    square = float((apart * (apart + 2 * through)).sum() + np.trace(spread @ spread))
    worst = float(np.sqrt(((biases.into @ us) ** 2).sum(axis=(0, 2))).max(initial=0.0))
    probability = _of_moments(limit, dof + mean, 2 * dof + 4 * mean + 2 * square)
    return DetectionPower("backlash", BACKLASH_DEG, "deg", probability, worst)


def _of_noise(biases: _Biases, dof: int, limit: float) -> DetectionPower:
    problem = biases.problem
    gram = np.einsum("nda,ndb->ab", biases.roots, biases.roots)
    readings, through = problem.shots * problem.tool.residual_size, gram @ biases.taken
    # The form of the readings' errors has these sums of its eigenvalues and of their squares.
    first = readings + float(np.trace(through))
    second = readings + float(2 * np.trace(through) + (through * through.T).sum())
    variances = np.maximum((biases.into @ gram * biases.into).sum(axis=1), 0.0)
    worst = float(np.sqrt((NOISE_TIMES**2 - 1) * variances).max(initial=0.0))
    more = NOISE_TIMES**2 - 1
    variance = 2 * (dof + 2 * more * first + more**2 * second)
    probability = _of_moments(limit, dof + more * first, variance)
    return DetectionPower("noise", NOISE_TIMES, "1", probability, worst)


def _of_square(limit: float, dof: int, square: float) -> float:
    """The probability that a chi-squared of this noncentrality is beyond a limit."""
    return float(1 - scipy.special.chndtr(limit, dof, square))


def _of_moments(limit: float, mean: float, variance: float) -> float:
    """The probability that a sum of squares of this mean and variance is beyond a limit, as a scaled
    chi-squared (Satterthwaite 1946)."""
    scale = variance / (2 * mean)
    return float(scipy.special.chdtrc(mean / scale, limit / scale))
