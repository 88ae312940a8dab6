"""Collisions of an arm with itself, the floor and boxes, and lines that it blocks; the arm as capsules
around its skeleton."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...model.arrays import Index, Mask, Matrix
from ...model.files.plan import Box, Obstacles
from ...model.instruments.kind import Target, TargetEntry
from ...model.kinematics.robot import Robot
from ...model.likelihood.problem import Problem

_SAME_POINT = 1e-6
# Built-in arms have no link shorter than 6 mm. What is shorter is how a calibrated arm deviates: its axes,
# which nominally meet in a point, miss each other by some tenths.
_POINT_MM = 3.0
_DEFAULT_THICKNESS = 0.05  # of the stretched arm
_BESIDE = 2.0  # radii of the arm about what it carries
_MOUNT, _NEXT = 0.5, 0.9  # of an instrument's distance from what carries it, and from the body next to that
_TRIED = 8  # postures in which what moves with the flange stays where it is
_COLUMN = 3  # links that are the arm's own base: from the mounting face to the base frame, and on to joint 2


def floor_of(obstacles: Obstacles, robot: Robot) -> float | None:
    """Height of the floor in the base frame, mm; None where there is none. A robot file that does not state
    the mounting face has it at the origin of the base frame."""
    if obstacles.floor_mm == "mounting":
        return -(robot.conventions.below_base or 0.0)
    return obstacles.floor_mm


class InTheWay(NamedTuple):
    """Of lines (N,): whether a body of the arm blocks them; how far they are from the axis of the body that
    does, or would first, mm, how far they must be, and the number of the link that it is, 0 the base."""

    blocked: Mask
    apart: Matrix
    radius: Matrix
    link: Index


class Clearance:
    """Judges postures of one arm among `obstacles`; None: nothing is known of the cell. The arm's links have
    the radius that the obstacles state, else that of the robot file, else (`assumed`) 5 % of the stretched
    arm."""

    def __init__(self, problem: Problem, obstacles: Obstacles | None) -> None:
        self.cell_known = obstacles is not None
        obstacles = obstacles or Obstacles(floor_mm=None)
        self._kernel = problem.functions.kernel("skeleton")
        self._tool = problem.functions.kernel("beam")
        self._problem, self._obstacles = problem, obstacles
        # The base's column ends where joint 2 begins; it is not part of the stretched arm.
        nominal = _lengths(self._standing(np.zeros((1, problem.robot.n))))[0]
        radius = obstacles.thickness_mm or problem.robot.conventions.body_radius
        self.assumed = radius is None
        self._radius = radius or _DEFAULT_THICKNESS * float(nominal[_COLUMN:].sum())
        self._floor = floor_of(obstacles, problem.robot)

    def hits_itself(self, joints: Matrix) -> Mask:
        """(N,) True where two parts of the arm come nearer than their thickness.

        Parts with less arm between them than twice that may be built so near each other (a wrist of short
        links, each at a right angle to the next; an elbow with an offset): of these what is as far along the
        arm from the other part must not be within it, half their thickness.
        """
        points = self._standing(joints)
        lengths = _lengths(points)
        parts = np.where(lengths > _POINT_MM, lengths, 0.0)
        along = np.concatenate([np.zeros((len(joints), 1)), parts.cumsum(axis=1)], axis=1)
        links = _links(lengths)
        result = np.zeros(len(joints), dtype=bool)
        for a, first in enumerate(links):
            for second in links[a + 1 :]:
                between = along[:, second] - along[:, first + 1]
                # Parts that share a joint are bounded by its limits.
                short = np.where(
                    between > _SAME_POINT, np.maximum(4 * self._radius - between, 0.0) / 2, np.inf
                )
                left = np.minimum(lengths[:, first], lengths[:, second]) - short
                rows = np.flatnonzero(left > 0)
                p, cut = points[rows], short[rows, None]
                ahead = (p[:, first + 1] - p[:, first]) / lengths[rows, first, None]
                back = (p[:, second + 1] - p[:, second]) / lengths[rows, second, None]
                apart = segment_distance(
                    p[:, first],
                    p[:, first + 1] - cut * ahead,
                    p[:, second] + cut * back,
                    p[:, second + 1],
                )
                result[rows] |= apart < np.where(short[rows] > 0, 1.0, 2.0) * self._radius
        return result

    def hits_cell(self, joints: Matrix) -> Mask:
        """(N,) True where a moving link touches the floor or a box."""
        return self.hits_floor(joints) | self.hits_boxes(joints)

    def hits_floor(self, joints: Matrix) -> Mask:
        """(N,) True where a link that joint 2 or a later one moves touches the floor."""
        points = self._standing(joints)
        result = np.zeros(len(joints), dtype=bool)
        if self._floor is None:
            return result
        for i in _links(_lengths(points)):
            if i >= _COLUMN:
                lowest = np.minimum(points[:, i, 2], points[:, i + 1, 2])
                result |= lowest < self._floor + self._radius
        return result

    def hits_boxes(self, joints: Matrix) -> Mask:
        """(N,) True where a moving link touches a box, which may stand at the arm's own base."""
        points = self._standing(joints)
        result = np.zeros(len(joints), dtype=bool)
        links = _links(_lengths(points))
        # The first link above the mounting face is fixed to it, or the turret on it.
        fixed = [i for i in links if i < _COLUMN][:2] if links[:1] == [0] else links[:1]
        for box in self._obstacles.boxes:
            for i in links:
                if i >= _COLUMN or i not in fixed:
                    result |= meets_box(points[:, i], points[:, i + 1], box, self._radius)
        return result

    def beam_blocked(self, origins: Matrix, target: Matrix) -> Mask:
        """(N,) True where a box is between the laser (N, 3) and the target (3,).

        A box that contains the target is its support: it does not count.
        """
        result = np.zeros(len(origins), dtype=bool)
        ends = np.broadcast_to(target, origins.shape)
        for box in self._obstacles.boxes:
            if not meets_box(target[None], target[None], box, 1e-6)[0]:
                result |= meets_box(origins, ends, box, 0.0)
        return result

    def in_the_way(self, joints: Matrix, origins: Matrix, end: Matrix, *, beam: bool) -> InTheWay:
        """Which body of the arm is between a point that it carries (N, 3) and an `end` (3,) in the cell.

        The whole line is judged, from the point on. What is known of the bodies that begin with the point is
        that it is outside of them. A body that moves with the flange is no question of the posture to a
        `beam`, which moves with it too. To a line of sight it is, as is to both the body next to these, which
        shares a joint with them: within two radii of the point such a body is taken to be no thicker than
        `_MOUNT` and `_NEXT` of its distance from the point, so that a line that goes away from it is free.
        Further on, and all other bodies everywhere, have their whole radius.
        """
        points = self._standing(joints)
        ends = np.broadcast_to(end, origins.shape)
        length = np.linalg.norm(ends - origins, axis=1)
        share = np.minimum(_BESIDE * self._radius / np.maximum(length, _SAME_POINT), 1.0)
        further = origins + share[:, None] * (ends - origins)
        n, count = self._problem.robot.n, len(joints)
        spare, apart, radius = np.full((3, count), np.inf)
        link = np.zeros(count, dtype=np.int64)
        for i in _links(_lengths(points)):
            first, second = points[:, i], points[:, i + 1]
            beside, carries = self._carried[i] or self._carried[i + 1], self._carried[i : i + 2].all()
            if carries and beam:
                continue
            least = np.full(count, self._radius)
            lines = [(further if beside else origins, least)]
            if beside:
                start = segment_distance(first, second, origins, origins)
                lines.append((origins, np.minimum(least, (_MOUNT if carries else _NEXT) * start)))
            for begin, allowed in lines:
                distance = segment_distance(first, second, begin, ends)
                nearer = distance - allowed < spare
                spare = np.where(nearer, distance - allowed, spare)
                apart, radius = np.where(nearer, distance, apart), np.where(nearer, allowed, radius)
                link[nearer] = min(max(i - 1, 0), n)
        return InTheWay(spare < 0, apart, radius, link)

    @cached_property
    def _carried(self) -> Mask:
        """(n + 4,) which points of the skeleton stay where they are in the flange's frame, in any posture:
        those behind the last joint, and those on its axis."""
        joints = np.random.default_rng(0).uniform(-1.0, 1.0, (_TRIED, self._problem.robot.n))
        poses = self._problem.poses(self._problem.parameters.prior_mean, joints)
        offset = self._standing(joints) - poses[:, None, :3, 3]
        local = np.einsum("kpi,kij->kpj", offset, poses[:, :3, :3])
        return np.asarray(np.ptp(local, axis=0).max(axis=1) < _POINT_MM)

    def _standing(self, joints: Matrix) -> Matrix:
        """(N, n + 4, 3): the mounting face below the base frame, the skeleton and the TCP."""
        nominal = self._problem.split(self._problem.parameters.prior_mean)
        (skeleton,) = self._kernel(joints, nominal.arm)
        origin, _ = self._tool(joints, nominal.arm, nominal.tool)
        foot = np.zeros((len(joints), 1, 3))
        foot[:, 0, 2] = -(self._problem.robot.conventions.below_base or 0.0)
        return np.concatenate([foot, skeleton.transpose(0, 2, 1), origin[:, None, :]], axis=1)


def _lengths(points: Matrix) -> Matrix:
    """(N, n + 3) of the links between the points (N, n + 4, 3)."""
    return np.asarray(np.linalg.norm(np.diff(points, axis=1), axis=2))


def _links(lengths: Matrix) -> list[int]:
    """Links that are more than a point in some posture (a prismatic joint may be drawn in at zero)."""
    return [int(i) for i in np.flatnonzero(lengths.max(axis=0, initial=0.0) > _POINT_MM)]


def segment_distance(a: Matrix, b: Matrix, c: Matrix, d: Matrix) -> Matrix:
    """(N,) shortest distance between segments a-b and c-d, each (N, 3) (Ericson 2005, section 5.1.9)."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)
    uw, vw = (u * w).sum(1), (v * w).sum(1)
    tiny = np.finfo(float).tiny
    determinant = uu * vv - uv**2
    skew = determinant > 1e-12 * uu * vv
    s = np.where(skew, np.clip((uv * vw - vv * uw) / np.where(skew, determinant, 1.0), 0, 1), 0.0)
    t = np.clip((uv * s + vw) / np.maximum(vv, tiny), 0, 1)
    s = np.clip((uv * t - uw) / np.maximum(uu, tiny), 0, 1)
    return np.asarray(np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1))


def meets_box(a: Matrix, b: Matrix, box: Box, radius: float) -> Mask:
    """(N,) True where the segment a-b meets the box grown by `radius` (slabs; careful at the edges)."""
    low, high = np.array(box.min_mm) - radius, np.array(box.max_mm) + radius
    along = b - a
    flat = np.abs(along) < 1e-12
    step = np.where(flat, 1.0, along)
    near, far = (low - a) / step, (high - a) / step
    near, far = np.minimum(near, far), np.maximum(near, far)
    inside = (a >= low) & (a <= high)
    near = np.where(flat, np.where(inside, -np.inf, np.inf), near)
    far = np.where(flat, np.where(inside, np.inf, -np.inf), far)
    return np.asarray(np.maximum(near.max(axis=1), 0) <= np.minimum(far.min(axis=1), 1))


def blocked_lines(
    clearance: Clearance, problem: Problem, origins: Matrix, targets: Sequence[Target], rows: Index
) -> InTheWay:
    """Which body of the arm is in the way of the beam or the line of sight of the rows (m,) of a problem,
    from `origins` (N, 3) mm to its `targets`."""
    count, tool = len(rows), problem.tool
    result = InTheWay(
        np.zeros(count, dtype=bool), np.full(count, np.inf), np.zeros(count), np.zeros(count, dtype=int)
    )
    for k, end in ends_of_lines(problem, targets).items():
        there = np.flatnonzero(problem.target_index[rows] == k)
        some = rows[there]
        of_some = clearance.in_the_way(problem.joints[some], origins[some], end, beam=tool.beam)
        for whole, part in zip(result, of_some, strict=True):
            whole[there] = part
    return result


def ends_of_lines(problem: Problem, targets: Sequence[Target]) -> dict[int, Matrix]:
    """(3,) mm where the lines end that must be free, by the index of the target that they are to."""
    tool = problem.tool
    ends = ((k, t.numbers if tool.beam else tool.in_sight(t)) for k, t in enumerate(targets))
    return {k: end for k, end in ends if end is not None}


def arm_in_the_way(problem: Problem, x: Matrix, entries: Mapping[str, TargetEntry]) -> Mask:
    """(N,) in which aimed shots at x (p,) the arm blocks the beam or the line of sight; `entries` are what a
    header says of targets."""
    targets = [
        Target(each, entries.get(name))
        for each, name in zip(problem.split(x).targets, problem.targets, strict=True)
    ]
    origins, _ = problem.beams(x)
    rows = np.arange(problem.shots)
    return blocked_lines(Clearance(problem, None), problem, origins, targets, rows).blocked
