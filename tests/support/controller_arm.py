"""An arm as its controller computes with it, without the kinematics that are tested.

Forward kinematics by products of 4 × 4 matrices, inverse kinematics by damped least squares from many
starts at once. Degrees and millimetres.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from zerobeam.model.arrays import Matrix
from zerobeam.model.kinematics.robot import Robot

_STARTS, _STEPS = 100, 60
_EXACT = 1e-6  # mm, and 1e-6 / _LENGTH rad
_LENGTH = 300.0  # mm that count as one radian


@dataclass(frozen=True)
class ControllerArm:
    """Six revolute joints: fixed transforms (6, 4, 4), each followed by a rotation about its unit axis (6,
    3), the `flange` (4, 4) behind them, and `offsets` (6,) degrees that the true arm adds to each commanded
    joint."""

    fixed: Matrix
    axes: Matrix
    flange: Matrix
    offsets: Matrix

    @classmethod
    def of(cls, robot: Robot, offsets: Matrix | None = None) -> ControllerArm:
        """Of the numbers of a robot file, up to what the controller calls the flange."""
        flange = robot.flange.copy()
        if robot.name == "irb1600":  # that of the paper ends at the wrist's centre
            flange[:3, 3] += 65.0 * flange[:3, 2]
        return cls(
            np.array([joint.fixed for joint in robot.joints]),
            np.array([joint.axis for joint in robot.joints]),
            flange,
            np.zeros(6) if offsets is None else offsets,
        )

    @cached_property
    def _crosses(self) -> Matrix:
        x, y, z = self.axes.T
        zero = np.zeros_like(x)
        return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)

    def frames(self, joints: Matrix) -> Matrix:
        """(7, N, 4, 4): behind each joint of (N, 6), then the flange."""
        angles = np.radians(np.atleast_2d(joints) + self.offsets)
        pose, frames = np.broadcast_to(np.eye(4), (len(angles), 4, 4)), []
        for fixed, cross, angle in zip(self.fixed, self._crosses, angles.T, strict=True):
            turn = np.zeros((len(angles), 4, 4))
            turn[:, 3, 3] = 1
            turn[:, :3, :3] = (
                np.eye(3)
                + np.sin(angle)[:, None, None] * cross
                + (1 - np.cos(angle))[:, None, None] * cross @ cross
            )
            pose = pose @ fixed @ turn
            frames.append(pose)
        return np.array([*frames, pose @ self.flange])

    def fk(self, joints: Matrix, unit: str) -> Matrix:
        """(4, 4) pose of the flange in the base frame at joints (6,), as of `Robot`; in degrees alone."""
        assert unit == "deg"
        return np.asarray(self.frames(joints)[-1, 0])

    def _step(self, joints: Matrix, pose: Matrix) -> tuple[Matrix, Matrix]:
        """Errors (N, 6) in mm, and steps (N, 6) in degrees."""
        frames = self.frames(joints)
        axes = np.einsum("jnab,jb->nja", frames[:6, :, :3, :3], self.axes)
        arms = frames[6][:, None, :3, 3] - frames[:6, :, :3, 3].transpose(1, 0, 2)
        jacobian = np.concatenate([np.cross(axes, arms), _LENGTH * axes], axis=2).transpose(0, 2, 1)
        left = pose[:3, :3] @ frames[6][:, :3, :3].transpose(0, 2, 1)
        errors = np.concatenate([pose[:3, 3] - frames[6][:, :3, 3], _LENGTH * _rotation(left)], axis=1)
        normal = jacobian.transpose(0, 2, 1) @ jacobian
        normal += (0.5e-3 * (errors**2).sum(axis=1) + 1e-9)[:, None, None] * np.eye(6)
        steps = np.linalg.solve(normal, jacobian.transpose(0, 2, 1) @ errors[:, :, None])[:, :, 0]
        return errors, np.degrees(steps)

    def climbed(self, pose: Matrix, starts: Matrix) -> Matrix:
        """Of starts (N, 6) those that reach the pose of the flange, where they do: (M, 6)."""
        joints, errors = np.atleast_2d(starts).astype(float), np.full((1, 6), np.inf)
        for _ in range(_STEPS):
            errors, steps = self._step(joints, pose)
            if (np.abs(errors).max(axis=1) < _EXACT).all():
                break
            joints = joints + np.clip(steps, -30, 30)
        return np.asarray(joints[np.abs(errors).max(axis=1) < _EXACT])

    def solutions(self, pose: Matrix, seed: int = 0) -> Matrix:
        """(M, 6) different joints that reach a pose of the flange, each within ±180 degrees."""
        starts = np.random.default_rng(seed).uniform(-180, 180, (_STARTS, 6))
        different: list[Matrix] = []
        for row in (self.climbed(pose, starts) + 180) % 360 - 180:
            if all(np.abs((row - other + 180) % 360 - 180).max() > 1e-3 for other in different):
                different.append(row)
        return np.array(different).reshape(-1, 6)

    def nearest(self, pose: Matrix, near: Matrix) -> Matrix | None:
        """The joints of a pose of the flange that are nearest to others, whole turns included."""
        rows = self.solutions(pose)
        if not len(rows):
            return None
        rows = rows + 360 * np.round((near - rows) / 360)
        return np.asarray(rows[np.argmin(np.linalg.norm(rows - near, axis=1))])

    def straight(self, pose: Matrix, start: Matrix) -> Matrix | None:
        """The joints at the end of a straight line of the flange from the joints `start`; None where it
        does not get there."""
        begin, joints = self.fk(start, "deg"), start
        for share in np.linspace(0, 1, 51)[1:]:
            arrived = self.climbed(on_line(begin, pose, share), joints)
            if not len(arrived) or np.abs(arrived[0] - joints).max() > 60:
                return None
            joints = arrived[0]
        return joints


def on_line(begin: Matrix, end: Matrix, share: float) -> Matrix:
    """(4, 4) between two poses: on the straight line, turned about one axis."""
    turn = _rotation((end[:3, :3] @ begin[:3, :3].T)[None])[0]
    pose = np.eye(4)
    pose[:3, :3] = _rotated(share * turn) @ begin[:3, :3]
    pose[:3, 3] = (1 - share) * begin[:3, 3] + share * end[:3, 3]
    return pose


def _rotation(matrices: Matrix) -> Matrix:
    """(N, 3) rotation vectors of (N, 3, 3)."""
    m = matrices
    twice = np.stack([m[:, 2, 1] - m[:, 1, 2], m[:, 0, 2] - m[:, 2, 0], m[:, 1, 0] - m[:, 0, 1]], axis=1)
    sine = np.linalg.norm(twice, axis=1)
    angle = np.arctan2(sine, np.trace(m, axis1=1, axis2=2) - 1)
    return np.asarray(twice * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-12), 0.5)[:, None])


def _rotated(vector: Matrix) -> Matrix:
    """(3, 3) of a rotation vector."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross)
