"""Steering a beam by the wrist: what is believed of arm and target, and steps that stay within the limits."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...analysis.observability.aim import aim, servo_joints
from ...interruption import obey
from ...model.arrays import Matrix
from ...model.kinematics.pendant import beyond_limits
from ...model.likelihood.problem import Problem
from .rig import MeasurementRefused, RefusalReason, Rig

FROM_BELOW = 0.05  # deg (mm): more than the the backlash of sound gears
_DAMPING = 1e-6  # of the largest eigenvalue: keeps a step across a singular direction short


@dataclass(frozen=True, eq=False)
class Belief:
    """Believed parameters for one measurement: `problem` (of that one measurement), offsets,
    tool and the target at `x` (p,), internal units."""

    problem: Problem
    x: Matrix

    @property
    def delta(self) -> Matrix:
        return self.problem.split(self.x).arm

    @property
    def tool(self) -> Matrix:
        return self.problem.split(self.x).tool

    @property
    def target(self) -> Matrix:
        """(3,) mm, base frame."""
        return np.asarray(self.problem.split(self.x).targets[self.problem.target_index[0]])

    @property
    def wrist(self) -> Matrix:
        """(n,) weights of the joints that the servo turns."""
        return np.asarray(servo_joints(self.problem)[0])

    def with_target(self, target: Matrix) -> Belief:
        """A copy with the target at (3,) mm."""
        x = self.x.copy()
        x[self.problem.parameters.block("target", int(self.problem.target_index[0]))] = target
        return replace(self, x=x)

    def call(self, name: str, joints: Matrix, *inputs: Matrix) -> list[Matrix]:
        """A function of the measurement at `joints` (n,) and the believed offsets, without the axis of
        rows."""
        outputs = self.problem.functions.kernel(name)(joints, self.delta, *inputs)
        return [np.asarray(value[0]) for value in outputs]

    def beam(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """Origin (3,) mm and direction (3,) of the beam, base frame."""
        origin, direction = self.call("beam", joints, self.tool)
        return origin, direction

    def spot(self, joints: Matrix, frame: Matrix) -> tuple[Matrix, Matrix]:
        """(2,) mm where the beam meets the face of the axes `frame` (3, 3), and (2, n) mm/rad (mm) how that
        moves by the joints."""
        point, _, by_joints = self.call("hit", joints, self.tool, self.target, frame[:, 2])
        return frame[:, :2].T @ (point - self.target), frame[:, :2].T @ by_joints

    def flange(self, joints: Matrix) -> tuple[Matrix, Matrix]:
        """Rotation (3, 3) and place (3,) mm of the flange in the base frame."""
        (places,) = self.problem.functions.kernel("place")(joints, self.delta, np.eye(4, 3, -1))
        return np.asarray((places[1:] - places[0]).T), np.asarray(places[0])

    def turned(self, joints: Matrix, vectors: Matrix) -> Matrix:
        """(..., 3) the directions `vectors` (..., 3) of the base frame as seen from the flange."""
        return np.asarray(vectors @ self.flange(joints)[0])

    def onto_target(self, joints: Matrix) -> Matrix | None:
        """(n,) the joints with the wrist turned onto the target; None where the limits do not allow it."""
        aimed = aim(self.problem.moved(joints[None]), self.x, self.wrist)
        after, robot = aimed.problem.joints[0], self.problem.robot
        inside = not beyond_limits(robot, after, 0.0).any()
        return after if aimed.hit[0] and aimed.ahead[0] and inside else None


def come_to(rig: Rig, belief: Belief, joints: Matrix) -> None:
    """Drive there so that every joint comes from below.

    The backlash of the gears is then taken up on the same side in every measurement: a part of the offsets,
    not a scatter (unidirectional approach, as ISO 9283 has it for its poses).
    """
    robot = belief.problem.robot
    for there in (np.maximum(joints - FROM_BELOW / robot.display, robot.lower), joints):
        obey()
        rig.move(there)


def step(belief: Belief, joints: Matrix, jacobian: Matrix, error: Matrix, largest: float) -> Matrix:
    """(n,) the joints after a damped step that takes `error` (2,) away, with the smallest rotation of the
    wrist.

    `jacobian` (2, n) is that of the error by the joints; no joint turns by more than `largest` (rad; of a
    prismatic one as a share of a metre). A joint at its limit is left there and the others do its part;
    MeasurementRefused where they cannot.
    """
    robot, weights = belief.problem.robot, belief.wrist.copy()
    scale = np.where(robot.display > 1, 1.0, 1000.0)
    while np.count_nonzero(weights) >= len(error):
        weighted = jacobian * (weights * scale**2)
        gram = weighted @ jacobian.T
        damped = gram + _DAMPING * np.linalg.eigvalsh(gram)[-1] * np.eye(2)
        turn = -weighted.T @ np.linalg.solve(damped, error)
        turn *= min(1.0, largest / max(float(np.abs(turn / scale).max()), 1e-300))
        after = joints + turn
        outside = (weights > 0) & beyond_limits(robot, after, 0.0)
        if not outside.any():
            return np.asarray(after)
        weights[outside] = 0.0
    raise MeasurementRefused(RefusalReason.LIMIT, "the wrist would have to go beyond a joint's limit")
