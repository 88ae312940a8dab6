"""Predictions for a plan: with fewer measurements, with the targets elsewhere, with one change."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...model.arrays import Matrix
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.problem import Problem, Whitened
from .aim import AimedPlan, aim, servo_joints

_DRAWS = 16
_CHANGE = {"revolute": 30.0, "prismatic": 100.0}  # degrees, mm
_WORTH_TELLING = 0.8  # a change that leaves more than this of the worst std is no advice


@dataclass(frozen=True)
class CurvePoint:
    """`worst_std` (deg; mm) of the offsets after the first `shots` shots, priors included."""

    shots: int
    worst_std: float


@dataclass(frozen=True)
class OverTarget:
    """The plan with its targets moved by random errors, by their stated sigma.

    `worst_std` is the largest predicted std (deg; mm) of each offset over the `draws`; `hit` the share
    of the shots that the servo can still turn onto the target.
    """

    draws: int
    hit: float
    worst_std: dict[str, float]


@dataclass(frozen=True)
class Advice:
    """The single change that lowers the worst predicted std (deg; mm) of the offsets most.

    Posture `posture` is turned by `change_deg` (in `unit`: mm for a prismatic joint) in joint `joint`
    (from 1) and aimed anew; `add` says whether as one more shot or in its place.
    """

    posture: int
    joint: int
    change_deg: float
    unit: str
    add: bool
    worst_std_before: float
    worst_std_after: float


def predicted_std(problem: Problem, x: Matrix) -> Matrix:
    """(f,) std of the free parameters scaled by their priors, priors included, at x (p,)."""
    return _stds(_information(problem, x))


def predicted_covariance(problem: Problem, x: Matrix) -> Matrix:
    """(f, f) of the free parameters scaled by their priors, priors included, at x (p,)."""
    return np.asarray(np.linalg.inv(_information(problem, x)))


def curve(problem: Problem, x: Matrix) -> tuple[CurvePoint, ...]:
    """The worst std of the offsets after the first 2, 3, … shots of aimed shots."""
    whitened = problem.whiten(x)
    roots = problem.roots(whitened)
    so_far = np.cumsum(roots.transpose(0, 2, 1) @ roots, axis=0) + _besides(problem, whitened)
    worst = _worst(problem, _stds(so_far[1:]))
    return tuple(CurvePoint(shots, float(std)) for shots, std in enumerate(worst, start=2))


def over_target(problem: Problem, x: Matrix, spread: Matrix) -> OverTarget | None:
    """The plan for targets drawn with std `spread` (p,), mm; None where none is spread."""
    if not spread.any():
        return None
    count = problem.shots
    there = x + spread * np.random.default_rng(1).normal(size=(_DRAWS, len(x)))
    every = problem.select(np.tile(np.arange(count), _DRAWS))
    aimed = aim(every, np.repeat(there, count, axis=0), servo_joints(every))
    largest = np.zeros(int(problem.parameters.free.sum()))
    for k, values in enumerate(there):
        hit = k * count + np.flatnonzero(aimed.hit[k * count : (k + 1) * count])
        largest = np.maximum(largest, predicted_std(aimed.problem.select(hit), values))
    names, stds = _offset_stds(problem, largest)
    return OverTarget(_DRAWS, float(aimed.hit.mean()), dict(zip(names, stds.tolist(), strict=True)))


def advice(problem: Problem, x: Matrix) -> Advice | None:
    """Try each joint before the servo's, each posture, both ways; None where no single change helps much.

    Judged on the exact information of the aimed shots; joints stay inside their limits.
    """
    robot, count = problem.robot, problem.shots
    servo = servo_joints(problem)
    moved = [np.flatnonzero(row == 0).tolist() or list(range(robot.n)) for row in servo]
    tries = [(i, j, sign) for i in range(count) for j, sign in product(moved[i], (1.0, -1.0))]
    rows = np.array([i for i, _, _ in tries])
    joints = problem.joints[rows].copy()
    for row, (_, j, sign) in enumerate(tries):
        joints[row, j] += sign * _CHANGE[robot.joints[j].kind] / robot.joints[j].display
    aimed = aim(problem.select(rows).moved(joints), x, servo[rows])
    turned = aimed.problem.joints
    inside = np.asarray(~beyond_limits(robot, turned, 0.0).any(axis=1))
    planned = _informations(problem, x)
    new = _informations(aimed.problem, x)
    total = _information(problem, x)
    before = float(_worst(problem, _stds(total)))
    replaced, added = (_worst(problem, _stds(total + new - old)) for old in (planned[rows], 0.0))
    best: Advice | None = None
    for row, (i, j, sign) in enumerate(tries):
        if not (aimed.hit[row] and aimed.ahead[row] and inside[row]):
            continue
        joint = robot.joints[j]
        for add in (False, True):
            after = float((added if add else replaced)[row])
            if best is None or after < best.worst_std_after * (0.95 if add and not best.add else 1.0):
                best = Advice(i, j + 1, sign * _CHANGE[joint.kind], joint.unit, add, before, after)
    return best if best is not None and best.worst_std_after < _WORTH_TELLING * before else None


def advised_joints(turned: AimedPlan, change: Advice) -> Matrix:
    """(n,) rad or mm: the posture that an advice suggests, aimed."""
    problem, x = turned.problem, turned.x
    at, joint = change.posture, problem.robot.joints[change.joint - 1]
    joints = np.where(turned.aimed.hit[at], turned.aimed.problem.joints[at], problem.joints[at])[None].copy()
    joints[0, change.joint - 1] += change.change_deg / joint.display
    aimed = aim(problem.select(np.array([at])).moved(joints), x, servo_joints(problem)[[at]])
    return np.asarray(aimed.problem.joints[0])


def _information(problem: Problem, x: Matrix) -> Matrix:
    """(f, f) of the scaled free parameters at x: Fisher's, with that of distances and priors."""
    jacobian = problem.whiten(x).jacobian[:, problem.parameters.free]
    return jacobian.T @ jacobian + np.eye(jacobian.shape[1])


def _besides(problem: Problem, whitened: Whitened) -> Matrix:
    """(f, f) the information of distances and priors."""
    rows = problem.shots * problem.tool.residual_size
    jacobian = whitened.jacobian[rows:, problem.parameters.free]
    return jacobian.T @ jacobian + np.eye(jacobian.shape[1])


def _stds(information: Matrix) -> Matrix:
    """(…, f) std by information (…, f, f)."""
    return np.asarray(np.sqrt(np.diagonal(np.linalg.inv(information), axis1=-2, axis2=-1)))


def _informations(problem: Problem, x: Matrix) -> Matrix:
    """(N, f, f) of each shot alone, without priors."""
    blocks = problem.roots(problem.whiten(x))
    return np.asarray(blocks.transpose(0, 2, 1) @ blocks)


def _offset_stds(problem: Problem, scaled: Matrix) -> tuple[list[str], Matrix]:
    """Names of the free offsets, and their std (deg; mm) (…, offsets) from those of all parameters (…, f)."""
    items = [item for item in problem.parameters.items if not item.held]
    offsets = [i for i, item in enumerate(items) if item.group == "offset"]
    units = np.array([items[i].prior_std * items[i].display for i in offsets])
    return [items[i].name for i in offsets], scaled[..., offsets] * units


def _worst(problem: Problem, scaled: Matrix) -> Matrix:
    """(…) the largest std (deg; mm) of the offsets, from those of the free parameters (…, f)."""
    return np.asarray(_offset_stds(problem, scaled)[1].max(axis=-1, initial=0.0))
