"""The motion of arm and targets that no reading notices: a null-space direction followed far enough to be
drawn.

One offset that the data leave open is changed, the recorded joints stay as they are, and whatever else has a
part in the direction (targets, a free tool, other offsets) is refitted until the instruments read what they
read before. So every place here fits the readings as well as any other: none is an estimate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.kernel import one_blas_thread
from ...model.likelihood.problem import Problem
from ...model.records import it, record
from ..observability.aim import aim, servo_joints
from ..observability.causes import NullDirection, worst_direction
from ..observability.check import Check, measured_shots
from ..observability.clearance import arm_in_the_way
from ..observability.gauges import information_root
from ..observability.remedies import carried_out
from ..solution import Solution
from ..status import Status
from .scene_data import Point, SceneShot, drawn_parameters, drawn_shots

_SHARES = (-1.0, -0.5, 0.0, 0.5, 1.0)  # of the amount, from one end of the motion to the other
_STEPS = 8  # from one share to the next
_REFITS = 20
_CONVERGED = 1e-12  # of the residuals, in their standard deviations
_UNNOTICED = 1.0  # sum of squared normalised residuals: half a unit of the log-likelihood
_TRIAL = {"revolute": np.radians(2.0), "prismatic": 20.0}
_LEAST = {"revolute": np.radians(10.0), "prismatic": 50.0}
_MOST = {"revolute": np.radians(45.0), "prismatic": 300.0}
_VISIBLE = 0.2  # of the size of the arm: the motion that is drawn
_HALVINGS = 12
_DRAWN = 3  # postures
_MARK = 90.0  # mm beside the flange's origin
_STILL = 1e-6  # mm, or of a rotation matrix
_DECIMALS = 2  # of millimetres


@record
class MovedPosture:
    """A posture at one place of the motion."""

    links: Annotated[
        tuple[Point, ...], it("points from the base over joints and flange to laser or tip, mm, base frame")
    ]
    mark: Annotated[
        Point, it("a point beside that of `links` which `marked` of the motion calls, moving with it, mm")
    ]
    beam_to: Annotated[Point | None, it("the point of the beam nearest to the target, or null")]
    sights: Annotated[tuple[tuple[Point, Point], ...], it("lines to what other instruments measure")]
    off_mm: Annotated[float, it("of the target: how far the reading would be from what was read, mm")]


@record
class MotionFrame:
    """One place of the motion: its `share` (−1 and 1 at the ends, 0 in the middle)."""

    share: Annotated[float, it("of the amount: −1 and 1 at the ends")]
    targets: Annotated[tuple[Point, ...], it("of targets and instruments, by `targets` of the motion, mm")]
    postures: Annotated[tuple[MovedPosture, ...], it("of measurements")]
    new: Annotated[tuple[MovedPosture, ...], it("of the postures that end it")]


@record
class NewPosture:
    """A posture of the remedy."""

    like: Annotated[int, it("the number of the measurement or posture that it is like")]
    joints: Annotated[tuple[float, ...], it("degrees, or millimetres of a prismatic joint, aimed")]
    units: Annotated[tuple[str, ...], it("of each")]
    off_mm: Annotated[
        float, it("how far the reading at either end of the motion would be from that in its middle, mm")
    ]


@record
class NullSpaceMotion:
    """A motion of arm and targets at the recorded joints that leaves the readings as they are."""

    offset: Annotated[str, it("the offset that is changed")]
    amount: Annotated[float, it("by how much at either end, degrees or millimetres")]
    unit: Annotated[str, it("`deg` or `mm`")]
    drawn: Annotated[
        float, it("how many times larger than by `amount` the frames show it: 1 where they show it as it is")
    ]
    off_mm: Annotated[
        float, it("how far beams or readings are from what was read at the ends, mm: the largest")
    ]
    noise_share: Annotated[
        float, it("the same in standard deviations: the root of the sum of the squared normalised residuals")
    ]
    moved: Annotated[
        tuple[str, ...], it("what else changes along it: offsets, targets, instruments, and a `tool`")
    ]
    direction: Annotated[int, it("which direction of the null space it follows, from 0")]
    targets: Annotated[tuple[str, ...], it("names of the targets and instruments that have a place")]
    marked: Annotated[
        Literal["flange", "axis"],
        it("the point that has the mark: the flange's, or, where that stays, the next joint's, on its axis"),
    ]
    shots: Annotated[tuple[int, ...], it("numbers of the measurements that are drawn")]
    like: Annotated[Literal["measurement", "posture"], it("what a number is of: a run's or a plan's")]
    frames: Annotated[tuple[MotionFrame, ...], it("from one end to the other")]
    new: Annotated[tuple[NewPosture, ...], it("postures that end it, of the remedy; empty where none does")]


@dataclass(frozen=True, eq=False)
class OpenShots:
    """Aimed measurements of a `problem` at x (p,) that leave an offset open: parameters of this `status` (p,)
    and the directions of their null space, of which the remedies call the shots by their `numbers`, those of
    what a shot is `like`."""

    problem: Problem
    x: Matrix
    status: Sequence[Status]
    null_space: Sequence[NullDirection]
    numbers: Sequence[int]
    like: Literal["measurement", "posture"]


def motion_of_run(solution: Solution) -> NullSpaceMotion | None:
    """Of a run of which an offset is unidentifiable; None where none is, or where nothing is known at all."""
    if (
        not solution.converged
        or solution.misfit is not None
        or not _open_offsets(solution.status, solution.problem)
    ):
        return None
    x = drawn_parameters(solution)
    with one_blas_thread():
        aimed = _aimed(solution.problem, x, solution.fit.weight)
    return null_motion(
        OpenShots(aimed, x, solution.status, solution.null_space, aimed.shot_numbers, "measurement")
    )


def _aimed(problem: Problem, x: Matrix, weight: float) -> Problem:
    """The shots that hit at x (p,): turned by the joints that vary, as for what is identifiable; where those
    are too few for what noise leaves, by those that a servo turns."""
    aimed, _, hit = information_root(problem, x, weight)
    again = aim(aimed, x, servo_joints(aimed))
    joints = np.where(hit[:, None], aimed.joints, again.problem.joints)
    return aimed.moved(joints).at_predicted(x).select(np.flatnonzero(hit | again.hit))


def motion_of_plan(check: Check) -> NullSpaceMotion | None:
    """Of a plan that leaves an offset unidentifiable; None where it leaves none."""
    shots, numbers = measured_shots(check)
    status = tuple(row.status for row in check.parameters)
    return null_motion(
        OpenShots(shots, check.aimed.x, status, check.identifiability.null_space, numbers, "posture")
    )


def null_motion(shots: OpenShots) -> NullSpaceMotion | None:
    """The motion along the first direction that leaves an offset open; None where none does, or where the
    readings notice any that could be drawn."""
    for lead in _open_offsets(shots.status, shots.problem):
        name = shots.problem.parameters.names[lead]
        direction = worst_direction(shots.null_space, name)
        if direction not in shots.null_space or direction.kind == "optima":
            continue
        with one_blas_thread():
            motion = _followed(shots, lead, direction)
        if motion is not None:
            return motion
    return None


def _open_offsets(status: Sequence[Status], problem: Problem) -> list[int]:
    block = problem.parameters.block("offset")
    return [i for i in range(block.start, block.stop) if status[i] == "unidentifiable"]


class MotionPath(NamedTuple):
    """Parameters (k, p) along the motion, which differ by `amount` (rad or mm) at either end from the middle,
    and by how much the readings are off there: `off_mm`, and `noise_share` in standard deviations."""

    xs: Matrix
    amount: float
    off_mm: float
    noise_share: float


def motion_path(
    problem: Problem, x: Matrix, lead: int, direction: NullDirection, amount: float
) -> MotionPath | None:
    """The parameters of the motion by at most the `amount` (rad or mm) of the offset in place `lead`, through
    x (p,), at which the shots of the `problem` hit: by the largest half, quarter, … of it that no reading
    notices. None where they notice any.

    What else moves is refitted from step to step by Gauss and Newton, with the least change of it in standard
    deviations of its prior."""
    others = _moving_along(problem, direction)
    others[lead] = False
    factor = problem.whiten(x).factor
    for halved in range(_HALVINGS):
        part = amount / 2**halved
        ends = [_refitted(problem, x, lead, others, sign * part, factor) for sign in (-1.0, 1.0)]
        share = max(end.noise_share for end in ends)
        if share <= np.sqrt(_UNNOTICED):
            down, up = ends
            xs = np.array([*down.xs[::-1], x, *up.xs])
            return MotionPath(xs, part, max(end.off_mm for end in ends), share)
    return None


def _moving_along(problem: Problem, direction: NullDirection) -> Mask:
    """(p,) what has a part in a direction: offsets by their names, of all else the whole target, frame or
    tool, since a coordinate that stays to first order does not stay at 45°."""
    parameters = problem.parameters
    named = {parameters.index(name) for name in (*direction.combination, *direction.slight)}
    groups = {(parameters.items[i].group, parameters.items[i].of) for i in named}
    moved = [
        i in named if item.group == "offset" else (item.group, item.of) in groups
        for i, item in enumerate(parameters.items)
    ]
    return np.array(moved) & parameters.untolerated & ~parameters.group("noise")


def _moved_along(problem: Problem, lead: int, direction: NullDirection) -> tuple[str, ...]:
    """What has a part in a direction beside the offset in place `lead`."""
    places = np.flatnonzero(_moving_along(problem, direction)).tolist()
    items = [problem.parameters.items[i] for i in places if i != lead]
    return tuple(dict.fromkeys(item.name if item.group == "offset" else item.of for item in items))


class _End(NamedTuple):
    """Parameters (2, p) half the way and at an end."""

    xs: Matrix
    off_mm: float
    noise_share: float


def _refitted(problem: Problem, x: Matrix, lead: int, others: Mask, amount: float, factor: Matrix) -> _End:
    std, at, xs = problem.parameters.prior_std[others], x.copy(), []
    step = np.zeros(len(std))
    whitened = problem.whiten(at, factor)
    for number in range(1, 2 * _STEPS + 1):
        at[lead] = x[lead] + amount * number / (2 * _STEPS)
        before = at[others]
        at[others] += step  # as in the step before
        for _ in range(_REFITS):
            whitened = problem.whiten(at, factor)
            change = np.linalg.lstsq(whitened.jacobian[:, others], -whitened.residual, rcond=1e-10)[0]
            at[others] += change * std
            if np.abs(whitened.jacobian[:, others] @ change).max(initial=0.0) < _CONVERGED:
                break
        step = at[others] - before
        if number % _STEPS == 0:
            xs.append(at.copy())
    whitened = problem.whiten(at, factor)
    off_mm = float(problem.length_mm(whitened.residual_mm).max())
    return _End(np.array(xs), off_mm, float(np.linalg.norm(whitened.residual)))


def _followed(shots: OpenShots, lead: int, direction: NullDirection) -> NullSpaceMotion | None:
    problem, x = shots.problem, shots.x
    amount = _amount(problem, x, lead, direction)
    path = motion_path(problem, x, lead, direction, amount)
    if path is None:
        return None
    item, drawn = problem.parameters.items[lead], amount / path.amount
    new, like = _new_postures(shots, direction)
    new_rows = np.zeros(0, dtype=np.int64)
    clear = np.zeros(0, dtype=np.int64) if new is None else np.flatnonzero(~arm_in_the_way(new, x, {}))
    if new is not None and len(clear):
        # The one that tells most: where the readings would be farthest off at the ends.
        off = [new.length_mm(new.linearise(end)[0])[clear] for end in (path.xs[0], path.xs[-1])]
        new_rows = clear[[np.min(off, axis=0).argmax()]]
    rows = _apart(problem, x, _DRAWN)
    of_new = None if new is None else new.select(new_rows)
    axis_of = None if _flange_moves(problem.select(rows), path) else min(lead + 1, problem.robot.n - 1)
    frames = list(_frames(shots, path, rows, of_new, drawn, axis_of))
    return NullSpaceMotion(
        offset=item.name,
        amount=path.amount * item.display,
        unit=item.unit,
        drawn=drawn,
        off_mm=path.off_mm,
        noise_share=path.noise_share,
        moved=_moved_along(problem, lead, direction),
        direction=list(shots.null_space).index(direction),
        targets=tuple(name for name, _ in _places(problem)),
        marked="flange" if axis_of is None else "axis",
        shots=tuple(int(shots.numbers[row]) for row in rows),
        like=shots.like,
        frames=tuple(frames),
        new=tuple(
            NewPosture(
                like=int(like[row]),
                joints=tuple((new.joints[row] * problem.robot.display).round(3).tolist()),
                units=tuple(joint.unit for joint in problem.robot.joints),
                off_mm=round(max(frame.new[k].off_mm for frame in frames), _DECIMALS),
            )
            for k, row in enumerate(new_rows.tolist())
            if new is not None
        ),
    )


def _amount(problem: Problem, x: Matrix, lead: int, direction: NullDirection) -> float:
    """How far the offset is changed for the motion to be seen, rad or mm."""
    kind = problem.robot.joints[lead].kind
    others = _moving_along(problem, direction)
    others[lead] = False
    trial = _refitted(problem, x, lead, others, _TRIAL[kind], problem.whiten(x).factor)
    rows = np.arange(min(problem.shots, _DRAWN))
    here, there = (
        np.array([shot.links for shot, *_ in drawn_shots(problem, at, rows)]) for at in (x, trial.xs[-1])
    )
    size = float(np.linalg.norm(np.ptp(here.reshape(-1, 3), axis=0)))
    moved = float(np.linalg.norm(there - here, axis=2).max())
    amount = float(np.clip(_VISIBLE * size / max(moved, 1e-9) * _TRIAL[kind], _LEAST[kind], _MOST[kind]))
    whole = np.radians(5.0) if kind == "revolute" else 10.0
    return float(round(amount / whole) * whole)


def _new_postures(shots: OpenShots, direction: NullDirection) -> tuple[Problem | None, tuple[int, ...]]:
    """The postures of the remedy, aimed, and of each the number of that which it is like."""
    tried = direction.tried
    if tried is None or tried.joint is None:
        return None, ()
    return carried_out(shots.problem, shots.x, tried, shots.numbers), tried.postures


def _apart(problem: Problem, x: Matrix, count: int) -> Index:
    """So many shots at most that are far from each other: the first, then always the farthest."""
    positions = problem.poses(x)[:, :3, 3]
    chosen = [0]
    for _ in range(min(count, problem.shots) - 1):
        away = np.linalg.norm(positions[:, None] - positions[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(away)))
    return np.array(sorted(set(chosen)), dtype=np.int64)


def _places(problem: Problem) -> list[tuple[str, Index]]:
    """Targets and stations by name, and where their coordinates are."""
    places = ((name, problem.parameters.place_of(name)) for name in problem.targets)
    return [(name, at) for name, at in places if (at >= 0).all()]


def _flange_moves(problem: Problem, path: MotionPath) -> bool:
    """Whether the flange moves or rotates; of offsets that rotate against each other it does not."""
    first, last = (problem.poses(path.xs[k]) for k in (0, -1))
    return bool(np.abs(last - first)[:, :3].max() > _STILL)


def _frames(
    shots: OpenShots,
    path: MotionPath,
    rows: Index,
    new: Problem | None,
    drawn: float,
    axis_of: int | None,
) -> Iterator[MotionFrame]:
    """`axis_of` (from 0) is the joint whose axis has the mark, None where the flange has it."""
    problem, middle = shots.problem, len(path.xs) // 2
    every = [_poses_at(problem.select(rows), x, axis_of) for x in path.xs]
    others = [[] if new is None else _poses_at(new, x, axis_of) for x in path.xs]
    places = [np.array([x[at] for _, at in _places(problem)]).reshape(-1, 3) for x in path.xs]
    for share, postures, of_new, targets in zip(_SHARES, every, others, places, strict=True):
        yield MotionFrame(
            share=share,
            targets=tuple(_rounded(places[middle] + drawn * (targets - places[middle]))),
            postures=tuple(
                _drawn_at(one, still, drawn) for one, still in zip(postures, every[middle], strict=True)
            ),
            new=tuple(
                _drawn_at(one, still, drawn) for one, still in zip(of_new, others[middle], strict=True)
            ),
        )


class _Pose(NamedTuple):
    """A shot, its mark, and how far its reading is off, mm."""

    shot: SceneShot
    mark: Matrix
    off_mm: float


def _poses_at(problem: Problem, x: Matrix, axis_of: int | None) -> list[_Pose]:
    rows, poses = np.arange(problem.shots), problem.poses(x)
    shots = [shot for shot, *_ in drawn_shots(problem, x, rows)]
    marks = poses[:, :3, 3] + _MARK * poses[:, :3, 0]
    if axis_of is not None:
        (axes,) = problem.functions.kernel("axes")(problem.joints, problem.split(x).arm)
        at = np.array([shot.links[axis_of + 1] for shot in shots])
        marks = at + _MARK * axes.reshape(-1, 3, problem.robot.n)[:, :, axis_of]
    off = problem.length_mm(problem.linearise(x)[0]).tolist()
    return [_Pose(*each) for each in zip(shots, marks, off, strict=True)]


def _drawn_at(one: _Pose, still: _Pose, drawn: float) -> MovedPosture:
    """A pose, as many times as `drawn` farther from where it is in the middle of the motion."""

    def farther(point: Sequence[float] | Matrix, middle: Sequence[float] | Matrix) -> Point:
        (moved,) = _rounded(np.array([middle]) + drawn * (np.array([point]) - np.array([middle])))
        return moved

    beam = None
    if one.shot.beam_to is not None and still.shot.beam_to is not None:
        beam = farther(one.shot.beam_to, still.shot.beam_to)
    return MovedPosture(
        links=tuple(farther(*pair) for pair in zip(one.shot.links, still.shot.links, strict=True)),
        mark=farther(one.mark, still.mark),
        beam_to=beam,
        sights=tuple(
            (farther(here[0], there[0]), farther(here[1], there[1]))
            for here, there in zip(one.shot.sights, still.shot.sights, strict=True)
        ),
        off_mm=round(drawn * one.off_mm, _DECIMALS),
    )


def _rounded(points: Matrix) -> list[Point]:
    return [(x, y, z) for x, y, z in (np.round(points, _DECIMALS) + 0.0).tolist()]
