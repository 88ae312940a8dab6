"""Candidate postures for a plan: reachable, in limits, seeing the target, hitting nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...analysis.observability.aim import aim, servo_joints
from ...model.arms.pendant import beyond_limits
from ...model.errors import BadInput
from ...model.files.header import Header
from ...model.problem import Problem
from ...model.robot import Matrix, Robot
from .obstacles import Clearance, Obstacles

Mask = NDArray[np.bool_]
Index = NDArray[np.int64]

_BATCH = 20_000
_MOST_DRAWN_PER_CANDIDATE = 60
_LEAST_DRAWN = 60_000
_SAMPLE = 2000  # postures by which the conditions are judged one by one, where too few satisfy all


@dataclass(frozen=True)
class View:
    """What a measurement must satisfy. Lengths mm, angles rad.

    `facing` is the outward normal of the PSD's face in the base frame (None: any side); `acceptance` the
    largest angle between beam and normal; `beam` the shortest and longest beam; `margin` is kept to every
    joint limit (rad; for prismatic joints as a share of a metre).
    """

    facing: tuple[float, float, float] | None = (0.0, 0.0, 1.0)
    acceptance: float = float(np.radians(60.0))
    beam: tuple[float, float] = (200.0, 2000.0)
    margin: float = float(np.radians(5.0))


@dataclass(frozen=True, eq=False)
class CandidatePostures:
    """`postures` (C, n) rad or mm, all aimed; `drawn` how many were tried, `removed` how many each
    constraint took, in the order in which they were judged: together they are all that were drawn. Where
    fewer than asked for are left, `alone` says what each constraint does by itself."""

    postures: Matrix
    drawn: int
    removed: dict[str, int]
    alone: Alone | None = None

    def in_words(self) -> str:
        """Which constraint removed how many, in words."""
        parts = [f"{count} {reason}" for reason, count in self.removed.items() if count]
        return f"{len(self.postures)} of {self.drawn} postures are left; " + ", ".join(
            parts or ["none removed"]
        )

    def reasons(self) -> str:
        """The same where too few are left: the decisive constraint first."""
        return self.in_words() if self.alone is None else f"{self.in_words()}. {self.alone.in_words()}"


@dataclass(frozen=True)
class Alone:
    """Of `aimed` postures that can be turned onto the target: how many each constraint `removes`, and how
    many would be left `without` it, if all others stay."""

    aimed: int
    removes: dict[str, int]
    without: dict[str, int]

    def in_words(self) -> str:
        """The constraint first without which most would be left; of the others that which removes most."""
        if not self.aimed:
            return "No posture can be turned onto the target: it is out of reach or out of sight"
        order = sorted(self.removes, key=lambda reason: (-self.without[reason], -self.removes[reason]))
        parts = [
            f"{self.removes[reason]} {reason} ({self.without[reason]} would be left without this condition)"
            for reason in order
            if self.removes[reason]
        ]
        return (
            f"Of {self.aimed} postures turned onto the target, judged by one condition alone: "
            + ", ".join(parts or ["none is removed"])
        )


def candidates(
    header: Header,
    robot: Robot,
    target: Matrix,
    count: int,
    *,
    view: View | None = None,
    obstacles: Obstacles | None = None,
    seed: int = 0,
    name: str = "psd",
    progress: Callable[[float], None] | None = None,
) -> CandidatePostures:
    """Draw postures evenly over the joint ranges, turn the wrist onto `target` (3,) mm, keep what is fit.

    A probe is brought to the target by all joints. Fewer than `count` may come back: drawing stops
    after a bounded number of tries. Raises BadInput for contradictory constraints.
    """
    view = view or View()
    _check(view, count)
    lower, upper, margin = _limits(robot, view)
    lowest, highest = _one_turn(robot, lower, upper)
    rng = np.random.default_rng(seed)
    problem = Problem.build(header, robot, np.zeros((_BATCH, robot.n)), [name] * _BATCH)
    x = problem.parameters.prior_mean.copy()
    x[problem.parameters.group("target")] = target
    clearance = None if obstacles is None else Clearance(problem, obstacles)
    removed: dict[str, int] = {}
    kept: list[Matrix] = []
    sample: Problem | None = None  # some postures of the first draw that can be turned onto the target
    drawn = found = 0
    most = max(_LEAST_DRAWN, _MOST_DRAWN_PER_CANDIDATE * count)
    while found < count and drawn < most:
        joints = rng.uniform(lowest, highest, size=(_BATCH, robot.n))
        drawn += _BATCH
        aimed = aim(problem.moved(joints), x, servo_joints(problem))
        if sample is None:
            sample = aimed.problem.select(np.flatnonzero(aimed.hit)[:_SAMPLE])
        left = _fit(aimed.problem, x, aimed.hit, margin, view, clearance, removed)
        kept.append(left)
        found += len(left)
        if progress is not None:
            progress(min(found / count, 1.0))
        if found == 0 and drawn >= _LEAST_DRAWN:
            break
    if found > count:
        removed["are more than asked for"] = found - count
    alone = None if found >= count or sample is None else _alone(sample, x, margin, view, clearance)
    return CandidatePostures(np.concatenate(kept)[:count], drawn, removed, alone)


def _fit(
    problem: Problem,
    x: Matrix,
    hit: Mask,
    margin: Matrix,
    view: View,
    clearance: Clearance | None,
    removed: dict[str, int],
) -> Matrix:
    """The joints of the measurements that satisfy everything; `removed` counts the others by their first
    fault."""
    unaimed = "cannot be turned onto the target (out of reach or out of sight)"
    removed[unaimed] = removed.get(unaimed, 0) + int((~hit).sum())
    left = np.flatnonzero(hit)
    for reason, fails in _conditions(problem, x, margin, view, clearance):
        # In this order: distances of links, which take the most time, only where all else is well.
        failed = fails(left) if len(left) else np.zeros(0, dtype=bool)
        removed[reason] = removed.get(reason, 0) + int(failed.sum())
        left = left[~failed]
    return problem.joints[left]


def _alone(problem: Problem, x: Matrix, margin: Matrix, view: View, clearance: Clearance | None) -> Alone:
    """What each condition does by itself to the postures of a problem, all turned onto the target."""
    rows = np.arange(problem.shots)
    failed = {
        reason: fails(rows) if len(rows) else np.zeros(0, dtype=bool)
        for reason, fails in _conditions(problem, x, margin, view, clearance)
    }
    faults = np.sum(list(failed.values()), axis=0)
    return Alone(
        len(rows),
        {reason: int(own.sum()) for reason, own in failed.items()},
        {reason: int((faults - own == 0).sum()) for reason, own in failed.items()},
    )


def _conditions(
    problem: Problem, x: Matrix, margin: Matrix, view: View, clearance: Clearance | None
) -> list[tuple[str, Callable[[Index], Mask]]]:
    """Each condition: what is said of the postures that fail it, and which of some rows do."""
    origin, direction = problem.beams(x)
    target, joints = problem.split(x).targets[0], problem.joints
    length = ((target - origin) * direction).sum(axis=1)
    laser = problem.tool.kind == "laser"
    conditions: list[tuple[str, Callable[[Index], Mask]]] = [
        (
            "come too near to a joint limit",
            lambda rows: np.asarray(beyond_limits(problem.robot, joints[rows], -margin).any(axis=1)),
        )
    ]
    if laser:
        shortest, longest = view.beam
        conditions += [
            ("have the target behind the laser", lambda rows: length[rows] <= 0),
            (
                "have too short or too long a beam",
                lambda rows: (length[rows] < shortest) | (length[rows] > longest),
            ),
        ]
    if laser and view.facing is not None:
        normal = np.array(view.facing) / np.linalg.norm(view.facing)
        conditions.append(
            (
                "meet the target's face from behind or at too flat an angle",
                lambda rows: np.asarray(-(direction[rows] @ normal) < np.cos(view.acceptance)),
            )
        )
    if clearance is not None:
        conditions += [
            ("make the arm hit itself", lambda rows: clearance.hits_itself(joints[rows])),
            ("make the arm hit the floor", lambda rows: clearance.hits_floor(joints[rows])),
            ("make the arm hit a box", lambda rows: clearance.hits_boxes(joints[rows])),
        ]
        if laser:
            conditions.append(
                ("have a box in the beam's way", lambda rows: clearance.beam_blocked(origin[rows], target))
            )
    return conditions


def _check(view: View, count: int) -> None:
    if count < 1:
        raise BadInput("no candidates are asked for", found=count, allowed="1 or more")
    shortest, longest = view.beam
    if not 0 <= shortest < longest:
        raise BadInput(
            "no beam is within the stated lengths",
            found=f"{shortest:g} to {longest:g} mm",
            allowed="a shortest beam of 0 or more and below the longest",
        )
    if view.facing is not None and not np.linalg.norm(view.facing) > 0:
        raise BadInput("the target's face has no direction", found=list(view.facing), allowed="not all 0")
    if not 0 < view.acceptance <= np.pi / 2:
        raise BadInput(
            "the target's acceptance angle cannot be used",
            found=f"{np.degrees(view.acceptance):g} deg",
            allowed="above 0 and up to 90 deg",
        )


def _limits(robot: Robot, view: View) -> tuple[Matrix, Matrix, Matrix]:
    """(n,) lower and upper limits with the margin kept, and the margin."""
    if not view.margin >= 0:
        raise BadInput("the margin to the joint limits is negative", found=f"{view.margin:g} rad")
    margin = np.array([view.margin * (1.0 if j.kind == "revolute" else 1000.0) for j in robot.joints])
    lower, upper = robot.lower + margin, robot.upper - margin
    for number, (joint, low, high) in enumerate(zip(robot.joints, lower, upper, strict=True), start=1):
        if low >= high:
            raise BadInput(
                f"the margin leaves nothing of the range of joint {number} ({joint.name})",
                found=f"{joint.lower * joint.display:.1f} to {joint.upper * joint.display:.1f} {joint.unit},"
                f" a margin of {margin[number - 1] * joint.display:.1f} {joint.unit}",
                allowed="a margin below half of every joint's range",
            )
    return lower, upper, margin


def _one_turn(robot: Robot, lower: Matrix, upper: Matrix) -> tuple[Matrix, Matrix]:
    """(n,) bounds to draw from: one turn of each joint that can do more, the one nearest to zero."""
    turn = np.array([np.pi if joint.kind == "revolute" else np.inf for joint in robot.joints])
    half = np.minimum((upper - lower) / 2, turn)
    middle = np.clip(0.0, lower + half, upper - half)
    return middle - half, middle + half
