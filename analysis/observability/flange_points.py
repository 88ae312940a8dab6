"""What positions of a point of the flange add to measurements, in postures that are measured anyway: by a
laser tracker or another instrument in the cell that reads three coordinates.

Nobody knows where the instrument stands, nor where on the flange its reflector is: nine unknowns without a
prior, so that of the twelve numbers of four positions three say something of the arm.
"""

from __future__ import annotations

from itertools import combinations
from math import comb
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Matrix
from ...model.instruments.proposal import ON_FLANGE
from ...model.likelihood.problem import Problem

POINTS = 4
SIGMA_MM = 0.03  # of a coordinate, as of a laser tracker at 3 m
_UNKNOWN = 9  # place (3) and rotation (3) of the instrument, place of the reflector on the flange (3)
_SETS = 3000  # of postures that are tried


class FlangePoints(NamedTuple):
    """`rows` (k,) of the shots in whose postures the positions are measured; `roots` (r, f) of their
    information on the scaled free parameters."""

    rows: Index
    roots: Matrix


def best_points(
    problem: Problem, x: Matrix, covariance: Matrix, counted: Index, among: Index, weight: float
) -> FlangePoints | None:
    """Four of the postures `among` (M,) those of the problem at x (p,), by which the variances of the
    parameters `counted`, scaled by their priors, become smallest beside measurements with this `covariance`
    (f, f); `weight` is 1 / noise scale². None of fewer postures."""
    if len(among) < POINTS:
        return None
    by_arm, by_rest = _whitened(problem, x, problem.joints[among], weight)
    sets = _sets(len(among))
    # What is left of the rows where the unknowns are eliminated.
    whole, _ = np.linalg.qr(by_rest[sets].reshape(len(sets), 3 * POINTS, _UNKNOWN), mode="complete")
    roots = whole[:, :, _UNKNOWN:].transpose(0, 2, 1) @ by_arm[sets].reshape(len(sets), 3 * POINTS, -1)
    gained = roots @ covariance
    inner = gained @ roots.transpose(0, 2, 1) + np.eye(roots.shape[1])
    less = gained[:, :, counted]
    gain = np.trace(np.linalg.solve(inner, less @ less.transpose(0, 2, 1)), axis1=1, axis2=2)
    best = int(np.argmax(gain))
    return FlangePoints(among[sets[best]], roots[best])


def _sets(count: int) -> Index:
    """(S, 4) sets of so many postures: all of them, or some at random."""
    if comb(count, POINTS) <= _SETS:
        return np.array(list(combinations(range(count), POINTS)))
    drawn = np.random.default_rng(0).random((_SETS, count))
    return np.asarray(np.sort(np.argsort(drawn, axis=1)[:, :POINTS], axis=1))


def _whitened(problem: Problem, x: Matrix, joints: Matrix, weight: float) -> tuple[Matrix, Matrix]:
    """(P, 3, f) positions at recorded `joints` (P, n) by the scaled free parameters, and (P, 3, 9) by the
    unknowns of instrument and reflector (metres and radians, about the middle), over the noise."""
    parameters = problem.parameters
    arm, free = parameters.arm, parameters.free[parameters.arm]
    position, jacobian = problem.functions.kernel("placed")(joints, x[arm], np.array(ON_FLANGE))
    by_joints = jacobian[:, :, parameters.block("offset")]  # an offset counts as the joint does
    noise = (by_joints * problem.noise.joint**2 / weight) @ by_joints.transpose(0, 2, 1)
    whitening = np.linalg.inv(np.linalg.cholesky(noise + SIGMA_MM**2 * np.eye(3)))
    by_arm = np.zeros((len(joints), 3, int(parameters.free.sum())))
    scaled = jacobian[:, :, : arm.stop] * parameters.prior_std[arm]
    by_arm[:, :, : int(free.sum())] = scaled[:, :, free]
    from_middle = (position - position.mean(axis=0)) / 1000
    turned = np.stack([np.cross(axis, from_middle) for axis in np.eye(3)], axis=2)
    shifted = np.broadcast_to(np.eye(3), turned.shape)
    by_rest = np.concatenate([shifted, turned, jacobian[:, :, arm.stop :]], axis=2)
    return whitening @ by_arm, whitening @ by_rest
