"""How the arm's setpoint goes to its goal: within the speeds and accelerations of the joints."""

from __future__ import annotations

import numpy as np

from ...model.arrays import Matrix


class Drive:
    """A setpoint on its way in steps of `step` seconds; all (n,) are rad, rad/s, rad/s^2.

    `top` and `acceleration` are what the joints can do. Every joint accelerates to its speed and brakes as
    late as it can: k steps of braking, the last of one step's speed change, go k (k + 1) / 2 a step^2 far.
    """

    def __init__(self, at: Matrix, top: Matrix, acceleration: Matrix, step: float) -> None:
        self.at, self.goal = at.copy(), at.copy()
        self._top, self._acceleration, self._step = top, acceleration, step
        self._velocity = np.zeros_like(at)
        self._limits = (top, acceleration)
        self._resting = False

    @property
    def standing(self) -> bool:
        return not self._velocity.any()

    @property
    def arrived(self) -> bool:
        return self.standing and bool((self.at == self.goal).all())

    def go(self, goal: Matrix, share: float) -> None:
        """All joints in step, on a line in joint space, the slowest at `share` of its top speed."""
        way = np.abs(goal - self.at)
        parts = np.divide(1.0, way, out=np.full_like(way, 1e300), where=way > 0)
        self.goal, self._resting = goal.copy(), False
        self._limits = (way * (share * self._top * parts).min(), way * (self._acceleration * parts).min())

    def follow(self, goal: Matrix, speed: float) -> None:
        """Each joint for itself, at `speed` rad/s at the most."""
        self.goal, self._resting = goal.copy(), False
        self._limits = (np.minimum(self._top, speed), self._acceleration)

    def rest(self) -> None:
        """Brake, and stay there: the goal is forgotten."""
        self._resting = True

    def advance(self, held: bool) -> None:
        """One step; `held` brakes on the way, and the goal stays what it is."""
        if self.standing and (held or self._resting or self.arrived):
            return
        speed, acceleration = self._limits
        step = self._step
        change = np.maximum(acceleration * step, 1e-300)  # a joint that has no way to go has none
        way = self.goal - self.at
        steps = np.sqrt(0.25 + 2 * np.abs(way) / (change * step)) - 0.5
        wanted = np.sign(way) * np.minimum(np.minimum(speed, steps * change), np.abs(way) / step)
        if held or self._resting:
            wanted = np.zeros_like(way)
        reached = np.abs(wanted - self._velocity) <= change
        velocity = np.where(reached, wanted, self._velocity + np.sign(wanted - self._velocity) * change)
        landed = reached & (wanted == way / step)
        self.at = np.where(landed, self.goal, self.at + velocity * step)
        self._velocity = np.where(landed, 0.0, velocity)
