"""Joint 3 counted from the ground and back (`pendant` owns the counting)."""

from __future__ import annotations

from ..robot import J3, Matrix, Robot
from .pendant import Pendant

__all__ = ["J3", "from_ground", "to_ground"]


def from_ground(joints: Matrix, robot: Robot) -> Matrix:
    """(…, n) degrees or rad with joint 3 from link 2, of joints that count it from the ground."""
    return Pendant(robot, "ground").between_links(joints)


def to_ground(joints: Matrix, robot: Robot) -> Matrix:
    """The same backwards."""
    return Pendant(robot, "ground").counted(joints)
