"""The arm at one recorded posture, in symbols: its links as they are, its joints where they truly are."""

from __future__ import annotations

import casadi as ca

from ..kinematics.robot import Robot
from .geometry import Geometry


class Posture:
    """Recorded positions `q` (n,), `arm` (a,) joint offsets and geometry parameters, and what follows: the
    `robot` with its links moved, and the true joint positions `theta` (n,)."""

    def __init__(self, robot: Robot, geometry: Geometry, arm: ca.SX | None = None) -> None:
        n = robot.n
        self.q = ca.SX.sym("q", n)
        self.arm = ca.SX.sym("arm", n + len(geometry.names)) if arm is None else arm
        self.robot = geometry.moved(robot, self.arm[n:])
        recorded = geometry.recorded_symbols(robot, self.q)
        self.theta = self.q + geometry.bent(robot, self.arm, recorded)

    @property
    def pose(self) -> tuple[ca.SX, ca.SX]:
        """The flange's rotation and translation in the base frame."""
        return self.robot.flange_pose(self.theta)
