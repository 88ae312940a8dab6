"""The eight postures by which a six-axis arm with a spherical wrist reaches a pose, as vendors name them.

Three signs tell the postures apart, each changing at a singularity: whether the wrist's centre is in front of
axis 1 or behind it, in front of the lower arm (the line from axis 2 through axis 3) or behind it, and the
sign of joint 5.

- ABB, confdata [cf1, cf4, cf6, cfx]: quadrants (n from 90 n to 90 (n + 1) degrees) of joints 1, 4 and 6; cfx
  is 4 if behind axis 1, plus 2 if behind the lower arm, plus 1 if joint 5 is negative.
- KUKA, S: 1 if behind axis 1 (overhead), plus 2 if in front of the lower arm (A3 from about 0 degrees), plus
  4 if A5 is negative; higher bits say other things. T: bit i - 1 if axis i is negative.
- FANUC, CONFIG: F (flip) if J5 is positive, else N; U (up) in front of the lower arm, else D; T (toward) in
  front of axis 1, else B; then the turns of joints 1, 4 and 6: 0 from -180 to 180 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..arrays import Matrix
from .robot import Robot

_SLACK = 1e-3  # deg by which a joint may be beyond a quadrant, sign or turn that is stated for it
_SPHERICAL = 1e-3  # mm by which axes 4 to 6 may miss one point
_PARALLEL = 1e-6


class Branch(NamedTuple):
    """One of the eight postures."""

    behind: bool
    behind_arm: bool
    negative: bool


@dataclass(frozen=True)
class Branches:
    """The postures of an arm. Joints are degrees (n,).

    `up` is 1 where joint 1 turns counterclockwise as seen from above, as those of ABB and FANUC do, -1 where
    clockwise, as KUKA's, however the arm is mounted. The front is where the wrist's centre is at zero; with
    `by_joint2`, of an arm that stretches along axis 1 there, where joint 2 leads when it increases.
    """

    robot: Robot
    up: int
    by_joint2: bool = False

    @cached_property
    def exist(self) -> bool:
        """Whether it has six rotary joints, axes 2 and 3 parallel and across axis 1, a spherical wrist."""
        robot = self.robot
        if robot.n != 6 or any(joint.kind != "revolute" for joint in robot.joints):
            return False
        axes, points = self._lines(np.full(6, 20.0))
        if np.linalg.norm(np.cross(axes[1], axes[2])) > _PARALLEL or abs(axes[0] @ axes[1]) > _PARALLEL:
            return False
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        apart = [_distance(centre, points[i], axes[i]) for i in (3, 4, 5)]
        zero = self._signs(np.zeros(6))
        return max(apart) < _SPHERICAL and zero is not None

    def of(self, joints: Matrix) -> Branch:
        signs = self._signs(joints)
        assert signs is not None
        front, arm = signs
        return Branch(front < 0, arm < 0, bool(joints[4] < 0))

    def ahead(self, joints: Matrix) -> float:
        """How far, mm, the wrist's centre is from axis 1 in the direction in which joint 2 tilts a vertical
        arm."""
        axes, points = self._lines(joints)
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        return float((centre - points[0]) @ np.cross(axes[1], axes[0]))

    def _signs(self, joints: Matrix) -> tuple[float, float] | None:
        """How far, mm, the wrist's centre is in front of axis 1, and (scaled) of the lower arm."""
        start_axes, start = self._at_zero
        axes, points = self._lines(joints)
        up = start_axes[0] * self.up
        front = np.cross(start_axes[1], up)
        centre = _meeting(start[3], start_axes[3], start[4], start_axes[4])
        ahead = float((centre - start[0]) @ front)
        if self.by_joint2 and abs(ahead) < 1.0:
            ahead = float((centre - start[1]) @ up)
        if not np.isfinite(ahead) or abs(ahead) < 1.0:
            return None
        # Axis 2 is carried by joint 1, and so is the front.
        sense = np.sign(ahead)
        across = sense * axes[1]  # up × front
        front = np.cross(across, up)
        across = np.cross(up, front)
        centre = _meeting(points[3], axes[3], points[4], axes[4])
        lower = points[2] - points[1]
        return float((centre - points[0]) @ front), float(across @ np.cross(lower, centre - points[2]))

    @cached_property
    def _at_zero(self) -> tuple[Matrix, Matrix]:
        return self._lines(np.zeros(6))

    def _lines(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """(n, 3) unit axes and (n, 3) points on them, mm, base frame."""
        axes, points = self._function(np.radians(joints))
        return axes.full().T, points.full().T[1:-1]

    @cached_property
    def _function(self) -> ca.Function:
        theta = ca.SX.sym("theta", self.robot.n)
        outputs = [ca.densify(self.robot.axes(theta)), ca.densify(self.robot.skeleton(theta))]
        return ca.Function("lines", [theta], outputs, ["theta"], ["axes", "points"])


def abb_configuration(branch: Branch, joints: Matrix) -> tuple[int, int, int, int]:
    """[cf1, cf4, cf6, cfx] of joints (6,), degrees."""
    cf1, cf4, cf6 = (int(np.floor(round(float(joints[i]), 6) / 90)) for i in (0, 3, 5))
    return cf1, cf4, cf6, 4 * branch.behind + 2 * branch.behind_arm + branch.negative


def is_abb_configuration(confdata: tuple[float, ...], branch: Branch, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated confdata."""
    return confdata[3] == abb_configuration(branch, joints)[3] and all(
        90 * quadrant - _SLACK <= joints[i] <= 90 * (quadrant + 1) + _SLACK
        for quadrant, i in zip(confdata[:3], (0, 3, 5), strict=True)
    )


def kuka_status(branch: Branch) -> int:
    """Bits 0 to 2 of S."""
    return branch.behind + 2 * (not branch.behind_arm) + 4 * branch.negative


def kuka_turn(joints: Matrix) -> int:
    """T of joints (6,), degrees."""
    return sum(1 << i for i, value in enumerate(joints.tolist()) if round(value, 6) < 0)


def is_kuka_turn(turns: int, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated T."""
    return all(
        value < _SLACK if turns >> i & 1 else value > -_SLACK for i, value in enumerate(joints.tolist())
    )


def fanuc_configuration(branch: Branch, joints: Matrix) -> tuple[str, tuple[int, int, int]]:
    """The letters, and the turns of joints 1, 4 and 6; joints (6,) are degrees."""
    letters = (
        "N" if branch.negative else "F",
        "D" if branch.behind_arm else "U",
        "B" if branch.behind else "T",
    )
    one, four, six = (int(np.floor((round(float(joints[i]), 6) + 180) / 360)) for i in (0, 3, 5))
    return " ".join(letters), (one, four, six)


def is_fanuc_configuration(letters: str, turns: tuple[int, ...], branch: Branch, joints: Matrix) -> bool:
    """Whether joints (6,), degrees, have the stated CONFIG."""
    return letters == fanuc_configuration(branch, joints)[0] and all(
        360 * turn - 180 - _SLACK <= joints[i] <= 360 * turn + 180 + _SLACK
        for turn, i in zip(turns, (0, 3, 5), strict=True)
    )


def _meeting(one: Matrix, along: Matrix, other: Matrix, across: Matrix) -> Matrix:
    """The point of the first line that is nearest to the second one."""
    cross = np.cross(along, across)
    if cross @ cross < _PARALLEL:
        return np.full(3, np.nan)
    return np.asarray(one + along * (np.cross(other - one, across) @ cross) / (cross @ cross))


def _distance(point: Matrix, on: Matrix, along: Matrix) -> float:
    return float(np.linalg.norm(np.cross(point - on, along)))
