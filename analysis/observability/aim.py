"""Postures turned onto their targets: the measurements that hit by the model.

A plan's postures only roughly point at the target; the servo turns the wrist until the beam hits.
A run's measurements hit but for noise and misfit. In both cases what the data determine is a property of
measurements that hit, so identifiability is judged there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.files.plan import Plan
from ...model.instruments.kind import Target, TargetEntry
from ...model.kernel import one_blas_thread
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem

_ITERATIONS = 60
_LARGEST_STEP = 0.2  # rad (or as a share of a metre for prismatic joints): keeps Newton's steps local
HIT_MM = 1e-6
_WRIST = 3  # joints
_JITTER = 2.0  # of a joint's noise
_NEAR = 0.02  # rad, or as a share of a metre


@dataclass(frozen=True, eq=False)
class Aimed:
    """`problem` has its shots turned onto their targets as far as they can be.

    `off_mm` (N,) is how far each shot was off before, `hit` (N,) whether it hits now, `ahead` (N,)
    whether the target lies before the laser: the model's beam is a whole line, the laser's is half of it.
    """

    problem: Problem
    off_mm: Matrix
    hit: Mask
    ahead: Mask


@dataclass(frozen=True, eq=False)
class AimedPlan:
    """A plan with its postures as the servo will leave them.

    `problem` has the postures as planned, `x` (p,) the values before any measurement: offsets 0, targets at
    their stated positions; `aimed` has the postures turned onto the targets there.
    """

    plan: Plan
    problem: Problem
    x: Matrix
    aimed: Aimed


def aim_plan(plan: Plan) -> AimedPlan:
    """Turn every posture of a plan onto its target; BadInput where the plan makes no problem."""
    with one_blas_thread():
        problem = Problem.from_plan(plan)
        x = problem.nominal()
        return AimedPlan(plan, problem, x, aim(problem, x, servo_joints(problem)))


def servo_joints(problem: Problem) -> Matrix:
    """(N, n) weights of the joints that a servo turns at each shot: the last three where a beam reads, else
    all."""
    weights = np.ones((problem.shots, problem.robot.n))
    weights[problem.by_beam, :-_WRIST] = 0.0
    return weights


def moving_joints(problem: Problem) -> Matrix:
    """(n,) weights by which recorded shots may be moved: each joint's variance over the shots, rad² or m².

    A joint that the shots keep exactly constant stays exactly constant, so that no gauge is broken.
    """
    spread = np.ptp(problem.joints, axis=0)
    return np.where(spread > 0, np.var(problem.joints / joint_scale(problem), axis=0), 0.0)


def at_rest(problem: Problem) -> Mask:
    """(n,) the joints that only the noise of their readings moves: over the shots they vary by no more than
    twice their stated noise (standard deviations).

    Noise alone varies by more in one of 400 runs of three measurements, in one of 10,000 of seven.
    """
    return np.asarray(problem.joints.std(axis=0) <= _JITTER * problem.noise.joint)


def at_one_position(aimed: Aimed, x: Matrix, rest: Mask, weights: Matrix) -> Aimed:
    """The shots (N,) with the joints `rest` (n,) at the mean of their positions, aimed again by the others.

    The jitter of an encoder says nothing of a posture, but would break a gauge that a joint at rest has. What
    the other joints cannot turn onto its target near by stays where it is: it does not hit.
    """
    joints = np.where(rest, aimed.problem.joints.mean(axis=0), aimed.problem.joints)
    again = aim(aimed.problem.moved(joints), x, np.where(rest, 0.0, weights))
    turned = np.abs(again.problem.joints - joints) / joint_scale(aimed.problem)
    near = turned.max(axis=1) <= _NEAR
    there = again.problem.moved(np.where(near[:, None], again.problem.joints, joints)).at_predicted(x)
    return Aimed(there, aimed.off_mm, again.hit & near, ahead(there, x))


def joint_scale(problem: Problem) -> Matrix:
    """(n,) a radian, or a metre in mm."""
    return np.array([1.0 if joint.kind == "revolute" else 1000.0 for joint in problem.robot.joints])


def aim(problem: Problem, x: Matrix, weights: Matrix) -> Aimed:
    """Turn every shot onto its target by the joints with a weight, (n,) or (N, n), at the parameters x: (p,),
    or (N, p) with own ones for every shot.

    Damped Gauss-Newton in the joints with the smallest weighted turn; the exact Jacobian of the residual. The
    weights are of turns in rad, or shifts in m.
    """

    def left(joints: Matrix, rows: Index | slice) -> tuple[Matrix, Matrix]:
        residual, jacobian = to_meet(problem, x, joints, rows)
        return residual, problem.by_joints(jacobian)

    turned = _turned(problem, left, weights)
    aimed = problem.moved(turned.joints)
    if problem.tool.reading_size:
        aimed = aimed.at_predicted(x)
    return Aimed(aimed, turned.first, turned.last < HIT_MM, ahead(aimed, x))


def brought(problem: Problem, x: Matrix, goals: Matrix) -> tuple[Problem, Mask]:
    """The shots with the point that the instrument measures brought to `goals` (N, 3) mm in the base frame by
    all joints, at the parameters x (p,), and (N,) whether it got there."""
    parts, n = problem.split(x), problem.robot.n
    placed = problem.functions.kernel("placed")

    def left(joints: Matrix, rows: Index | slice) -> tuple[Matrix, Matrix]:
        position, jacobian = placed(joints, parts.arm, problem.tool.point)
        return position - goals[rows], jacobian[:, :, :n]

    turned = _turned(problem, left, np.ones(n))
    return problem.moved(turned.joints), turned.last < HIT_MM


def brought_to_targets(
    problem: Problem, x: Matrix, entries: Mapping[str, TargetEntry], rng: np.random.Generator
) -> tuple[Problem, Mask]:
    """Shots from any joints, brought to where their instrument can measure at the parameters x (p,), and (N,)
    which of them got there; `entries` are what a header says of targets. A beam is turned by the wrist alone,
    a tip is brought there by all joints, what reads wherever the arm stands stays."""
    tool, targets = problem.tool, problem.split(x).targets
    joints, reached = problem.joints.copy(), np.ones(problem.shots, dtype=bool)
    for k in np.unique(problem.target_index).tolist():
        rows, entry = np.flatnonzero(problem.target_index == k), entries.get(problem.targets[k])
        goals = tool.goals(rng, len(rows), Target(targets[k], entry))
        if goals is not None:
            there, reached[rows] = brought(problem.select(rows), x, goals)
            joints[rows] = there.joints
    problem = problem.moved(joints)
    if not tool.met:
        return problem, reached
    aimed = aim(problem, x, servo_joints(problem))
    return aimed.problem, aimed.hit & reached


def one_turn(robot: Robot, lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """(n,) bounds to draw postures from: one turn of each joint that can do more, the one nearest to zero."""
    turn = np.array([np.pi if joint.kind == "revolute" else np.inf for joint in robot.joints])
    half = np.minimum((upper - lower) / 2, turn)
    middle = np.clip(0.0, lower + half, upper - half)
    return middle - half, middle + half


class _Turned(NamedTuple):
    """`joints` (N, n) turned; how large what was left (N,) was at `first`, and is at `last`."""

    joints: Matrix
    first: Matrix
    last: Matrix


def _turned(
    problem: Problem, left: Callable[[Matrix, Index | slice], tuple[Matrix, Matrix]], weights: Matrix
) -> _Turned:
    """The joints of every shot turned until nothing is `left`: of joints (m, n) and the rows that they are,
    what is left (m, d) and its Jacobian by them (m, d, n). `weights` (n,) or (N, n)."""
    if weights.ndim == 1:
        return _turned_by(problem, left, weights, np.arange(problem.shots))
    joints, off, smallest = problem.joints.copy(), np.zeros(problem.shots), np.zeros(problem.shots)
    alike, which = np.unique(weights, axis=0, return_inverse=True)
    for k, some in enumerate(alike):
        rows = np.flatnonzero(which.ravel() == k)
        joints[rows], off[rows], smallest[rows] = _turned_by(problem, left, some, rows)
    return _Turned(joints, off, smallest)


def _turned_by(
    problem: Problem,
    left: Callable[[Matrix, Index | slice], tuple[Matrix, Matrix]],
    weights: Matrix,
    rows: Index,
) -> _Turned:
    """The same of some `rows` (M,), by weights (n,)."""
    turned = np.flatnonzero(weights)
    scale = joint_scale(problem)[turned]
    weights = weights[turned] * scale**2
    joints = problem.joints[rows]
    residual, jacobian = left(joints, rows)
    off = np.linalg.norm(residual, axis=1)
    best, smallest = joints.copy(), off.copy()
    active = np.arange(len(rows))
    # Where no joint may be turned there is nothing to do.
    before_last_step = np.full(len(rows), np.inf if len(turned) else 0.0)
    for _ in range(_ITERATIONS):
        # One step more than the hit needs: an exact gauge shows as one only where the residual is rounding.
        going_on = before_last_step[active] >= HIT_MM * 1e-3
        active, residual, jacobian = active[going_on], residual[going_on], jacobian[going_on]
        if len(active) == 0:
            break
        before_last_step[active] = smallest[active]
        by_joints = jacobian[:, :, turned]
        gram = (by_joints * weights) @ by_joints.transpose(0, 2, 1)
        damping = 1e-12 * np.trace(gram, axis1=1, axis2=2) + 1e-30
        gram += damping[:, None, None] * np.eye(gram.shape[1])
        step = -(
            weights * (by_joints.transpose(0, 2, 1) @ np.linalg.solve(gram, residual[:, :, None]))[:, :, 0]
        )
        largest = np.abs(step / scale).max(axis=1)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]
        joints[active[:, None], turned] += step
        residual, jacobian = left(joints[active], rows[active])
        size = np.linalg.norm(residual, axis=1)
        better = size < smallest[active]
        nearer = active[better]
        best[nearer], smallest[nearer] = joints[nearer], size[better]
    return _Turned(best, off, smallest)


def to_meet(problem: Problem, x: Matrix, joints: Matrix, rows: Index | slice) -> tuple[Matrix, Matrix]:
    """Residuals and Jacobians of what the joints are turned to bring to zero; 0 of what reads anywhere."""
    residual, jacobian = problem.linearise(x, joints, rows)
    if problem.met.all():
        return residual, jacobian
    met = problem.met[rows]
    return residual * met, jacobian * met[:, :, None]


def ahead(problem: Problem, x: Matrix) -> Mask:
    """(N,) whether each shot's target lies before the laser; True where no beam reads."""
    return np.asarray(~((beam_lengths(problem, x)[0] < 0) & problem.by_beam))


def beam_lengths(problem: Problem, x: Matrix) -> tuple[Matrix, Matrix]:
    """(N,) mm along each beam to the point nearest to its target, and (N, 3) the beams' directions."""
    origin, direction = problem.beams(x)
    targets = problem.split(np.broadcast_to(x, (problem.shots, x.shape[-1]))).targets
    targets_of_shots = targets[np.arange(problem.shots), problem.target_index]
    return np.asarray(((targets_of_shots - origin) * direction).sum(axis=1)), direction
