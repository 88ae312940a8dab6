"""The simulated arm: the difference between the controller's counts and the true joints."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ....model.arrays import Matrix
from ....model.kinematics.robot import Robot

# Top speeds where the robot file states none.
_TOP_SPEED = {"revolute": 1.0, "prismatic": 1000.0}  # rad/s, mm/s


@dataclass(eq=False)
class SimulatedArm:
    """An arm whose true joints differ from their counts by offset, backlash and a static error.

    The controller drives its count to the commanded position, to the nearest step of the encoder; then

        link = count + offset + error - backlash / 2 * direction of the joint's last motion,

    which is the run's model (true = recorded + delta) where error and backlash are 0. The error of each
    joint, of std `repeatability`, is friction, gravity and cables: it stays while the arm moves little, so
    that a servo can take it out, and is drawn again once the arm has travelled more than `redraw`.

    All (n,) are rad or mm (a second, a second squared): `offsets`, `backlash` (full width), `resolution` of
    the encoders (0: none), `repeatability`, `acceleration`. `speed` is a share of the joints' top speeds.
    `redraw` is rad: the travel of the joint that goes farthest, summed over motions, a mm for a degree.
    """

    robot: Robot
    offsets: Matrix
    backlash: Matrix
    resolution: Matrix
    repeatability: Matrix
    speed: float
    acceleration: Matrix
    redraw: float = np.radians(2.0)
    _rng: np.random.Generator = field(init=False, repr=False)
    _count: Matrix = field(init=False, repr=False)
    _direction: Matrix = field(init=False, repr=False)
    _error: Matrix = field(init=False, repr=False)
    _travel: float = field(init=False, repr=False)

    def begin(self, rng: np.random.Generator, at: Matrix) -> None:
        """Be at the joints `at` (n,), come from below, with a new static error.

        What follows depends on `rng` and `at` alone, not on what was before: a resumed run repeats it.
        """
        self._rng, self._count = rng, self._steps(at)
        self._direction = np.ones(self.robot.n)
        self._settle()

    def move(self, joints: Matrix) -> float:
        """Go to the joints (n,) as the controller counts, whatever their limits; the seconds it takes."""
        count = self._steps(joints)
        way = count - self._count
        self._count = count
        self._direction = np.where(way == 0, self._direction, np.sign(way))
        self._travel += float(np.radians(np.abs(way) * self.robot.display).max())
        if self._travel > self.redraw:
            self._settle()
        return self.duration(way)

    def read(self) -> Matrix:
        """(n,) the counts: where the controller takes the joints to be."""
        return self._count.copy()

    def link(self) -> Matrix:
        """(n,) where the joints truly are."""
        return self._count + self.offsets + self._error - self.backlash / 2 * self._direction

    def duration(self, way: Matrix) -> float:
        """Seconds for the way (n,): the slowest joint sets it, the others keep step.

        Trapezoidal profile of top speed v and acceleration a: D / v + v / a, or 2 sqrt(D / a) where the way
        D < v^2 / a is too short to reach v (Siciliano et al., Robotics, section 4.2.1).
        """
        top = self.speed * np.array([joint.speed or _TOP_SPEED[joint.kind] for joint in self.robot.joints])
        distance, acceleration = np.abs(way), self.acceleration
        trapezoid = distance / top + top / acceleration
        triangle = 2 * np.sqrt(distance / acceleration)
        return float(np.where(distance < top**2 / acceleration, triangle, trapezoid).max())

    def _steps(self, joints: Matrix) -> Matrix:
        """The joints (n,) to the nearest step of their encoders."""
        step = np.where(self.resolution > 0, self.resolution, 1.0)
        return np.where(self.resolution > 0, step * np.round(joints / step), joints)

    def _settle(self) -> None:
        self._error = self.repeatability * self._rng.normal(size=self.robot.n)
        self._travel = 0.0


def geometry_errors(robot: Robot, errors: Mapping[int, Matrix]) -> Robot:
    """The robot with links that deviate from nominal geometry.

    `errors` has small transforms (4, 4) by the index (from 0) of the joint behind the link; each goes after
    the link's fixed transform: it is stated in that joint's frame.
    """
    joints = list(robot.joints)
    for i, error in errors.items():
        joints[i] = replace(joints[i], fixed=joints[i].fixed @ error)
    return replace(robot, joints=tuple(joints))
