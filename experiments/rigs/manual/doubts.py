"""Doubts about typed joint values: limits, the unit, an earlier measurement, the plan, the aim."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from ....analysis.observability.aim import aim, servo_joints
from ....model.arrays import Matrix
from ....model.files.header import Header
from ....model.files.joint_values import beyond_limits
from ....model.files.plan import Plan
from ....model.files.shot import Shot
from ....model.kernel import one_blas_thread
from ....model.kinematics.pendant import Pendant, nearest_limit
from ....model.kinematics.plausible import ONE_TURN
from ....model.likelihood.problem import Problem
from ...procedure.beam_ports import near_nominal
from ..replay import SAME_POSTURE

_STDS = 3.0
_MOST_DEG = 45.0  # a joint that turned farther is questioned in any case


class Aiming:
    """The turns that bring the beam of a plan's postures onto their targets.

    A person turns the joints that aim (the last three) from the posture of the plan until the beam is on the
    target. A joint that aims may be read anywhere between the plan's value and that of the least turn of all
    three which does so by the model, and beyond as far as an arm and a target that are off need it: three
    standard deviations (offsets and tool by their priors, at most 1.5 deg; the target by its sigma, at most
    100 mm, as the automatic procedure aims), whichever two or three of the joints are used, and the 5 deg
    within which joints are those of a posture; by 45 deg at most.

    Of several instruments it is the beam `label`, and the postures at which that reads.
    """

    def __init__(self, plan: Plan, label: str) -> None:
        self._plan = plan
        at = [i for i, item in enumerate(plan.measurements) if item.instrument == label]
        self._row = {number: row for row, number in enumerate(at)}
        self._problem = Problem.of_measured(
            _alone(plan.header, label),
            plan.robot,
            plan.postures[at],
            [[plan.measurements[i]] for i in at],
            planned=True,
        )
        self._nominal = self._problem.nominal()
        parameters = near_nominal(self._problem, self._nominal).parameters
        off = np.diag(np.where(parameters.free, parameters.prior_std, 0.0))[parameters.free]
        # (2 s, p): each of s values higher by its standard deviation, then lower.
        self._off = self._nominal + np.stack([off, -off], axis=1).reshape(-1, len(parameters))
        self.joints = servo_joints(self._problem)[0] > 0

    def bounds(self, posture: int, joints: Matrix) -> tuple[Matrix, Matrix]:
        """(n,) lowest and highest values, deg or mm, of the joints that aim where `joints` (n,) are read."""
        display = self._plan.robot.display
        aiming = tuple(int(joint) for joint in np.flatnonzero(self.joints))
        planned = np.where(self.joints, self._plan.postures[posture], joints / display)
        (turn,) = self._turns(posture, planned, self._nominal[None], aiming)
        aimed = planned + np.nan_to_num(turn)
        needed = np.zeros(len(planned))
        for used in (aiming, *combinations(aiming, self._problem.tool.residual_size)):
            turns = np.abs(self._turns(posture, aimed, self._off, used)).reshape(-1, 2, len(planned))
            needed = np.fmax(needed, np.sqrt(np.nansum(turns.max(axis=1) ** 2, axis=0)))
        allowed = SAME_POSTURE + _STDS * needed * display
        allowed = np.where(display == 1, allowed, np.minimum(allowed, _MOST_DEG))
        ends = np.array([planned, aimed]) * display
        return ends.min(axis=0) - allowed, ends.max(axis=0) + allowed

    def _turns(self, posture: int, start: Matrix, x: Matrix, used: tuple[int, ...]) -> Matrix:
        """(N, n) rad or mm: how far the joints `used` turn from `start` (n,) until the beam is on the target,
        for the parameters x (N, p); NaN where it never is."""
        weights = np.zeros(len(start))
        weights[list(used)] = 1.0
        rows = self._problem.select(np.full(len(x), self._row[posture])).moved(np.tile(start, (len(x), 1)))
        with one_blas_thread():
            aimed = aim(rows, x, weights)
        return np.where((aimed.hit & aimed.ahead)[:, None], aimed.problem.joints - start, np.nan)


def _alone(header: Header, label: str) -> Header:
    """The header of that instrument alone: what is stated between others is not its own."""
    if len(header.labels) == 1:
        return header
    instruments = {name: entry for name, entry in header.instruments.items() if name == label}
    tool = header.tool if label not in header.instruments else None
    alone = {"instruments": instruments, "tool": tool, "held": None, "distances": (), "angles": ()}
    return header.model_copy(update=alone)


_SAME = 1e-4  # deg (mm): an arm that has moved is not read the same in every joint

Kind = Literal["limit", "radians", "repeated", "far"]


@dataclass(frozen=True)
class Doubt:
    """A doubt about a reading, with its sentence. A `limit` cannot be overruled."""

    kind: Kind
    sentence: str


class Judge:
    """Judges readings against a plan."""

    def __init__(self, plan: Plan, pendant: Pendant) -> None:
        self._plan, self._pendant = plan, pendant
        kinds, measured = plan.header.kinds, {item.instrument for item in plan.measurements}
        beams = {label: Aiming(plan, label) for label in measured if kinds[label].beam}
        self._aiming = [beams.get(item.instrument) for item in plan.measurements]
        self._planned = plan.postures * plan.robot.display
        self._turning = np.array([joint.kind == "revolute" for joint in plan.robot.joints])

    def doubt(self, number: int, joints: Matrix, shots: Sequence[Shot]) -> Doubt | None:
        """The first that speaks against `joints` (n,) deg or mm as measurement `number`, if anything does."""
        return (
            self._radians(joints)
            or self._limit(joints)
            or self._repeated(joints, shots)
            or self._far(number, joints)
            or self._beyond_aiming(number, joints)
        )

    def near(self, joints: Matrix, left: Collection[int]) -> int | None:
        """The posture of `left` whose joints these are, if they are one's alone; of one and its repeat it is
        the first."""
        new = [number for number in left if self._plan.repeated_by(number) not in left]
        fitting = [number for number in new if self._off(number, joints).max(initial=0.0) <= SAME_POSTURE]
        return fitting[0] if len(fitting) == 1 else None

    def _off(self, number: int, joints: Matrix) -> Matrix:
        """(n,) deg or mm that the joints differ from the posture; 0 for those that are turned."""
        posture = number % len(self._planned)
        off, aiming = np.abs(joints - self._planned[posture]), self._aiming[posture]
        return off if aiming is None else np.where(aiming.joints, 0.0, off)

    def _radians(self, joints: Matrix) -> Doubt | None:
        turning = joints[self._turning]
        if np.abs(turning).max(initial=0.0) > ONE_TURN or not turning.any():
            return None
        as_radians = np.where(self._turning, np.degrees(joints), joints)
        here, there = (
            min(self._off(each, values).max() for each in range(len(self._planned)))
            for values in (joints, as_radians)
        )
        if here <= SAME_POSTURE or there >= here:
            return None
        return Doubt("radians", f"all angles are within ±{ONE_TURN}: these look like radians")

    def _limit(self, joints: Matrix) -> Doubt | None:
        robot = self._plan.robot
        outside = np.flatnonzero(beyond_limits(robot, joints))
        if not outside.size:
            return None
        i = int(outside[0])
        limit, unit = nearest_limit(robot, joints / robot.display, i), robot.joints[i].unit
        counting = limit.counting and f" ({limit.counting})"
        sentence = (
            f"joint {i + 1} is at {limit.value:.6g} {unit}{counting}, beyond its limits {limit.lower:.6g} to"
            f" {limit.upper:.6g}"
        )
        return Doubt("limit", sentence)

    def _repeated(self, joints: Matrix, shots: Sequence[Shot]) -> Doubt | None:
        for shot in shots:
            if np.abs(joints - shot.joints_deg).max() < _SAME:
                return Doubt(
                    "repeated", f"the joint values are those of measurement {shot.shot}: has the arm moved?"
                )
        return None

    def _far(self, number: int, joints: Matrix) -> Doubt | None:
        off = self._off(number, joints)
        i = int(np.argmax(off))
        if off[i] <= SAME_POSTURE:
            return None
        unit = self._plan.robot.joints[i].unit
        at = float(self._pendant.counted(joints)[i])
        planned = float(self._pendant.counted(self._planned[number % len(self._planned)])[i])
        alone = (np.delete(off, i) <= SAME_POSTURE).all()
        return Doubt(
            "far",
            f"joint {i + 1} is at {at:.6g} {unit} and the plan has {planned:.6g}"
            f"{', the other joints are as planned: is it a typing error?' if alone else ''}",
        )

    def _beyond_aiming(self, number: int, joints: Matrix) -> Doubt | None:
        """Whether a joint that aims has turned farther than that needs."""
        posture = number % len(self._planned)
        aiming = self._aiming[posture]
        if aiming is None:
            return None
        lower, upper = aiming.bounds(posture, joints)
        excess = np.where(aiming.joints, np.maximum(lower - joints, joints - upper), -np.inf)
        i = int(np.argmax(excess))
        if excess[i] <= 0:
            return None
        unit = self._plan.robot.joints[i].unit
        # What the pendant counts joint 3 with (joint 2) is the same at both ends.
        at, planned = (float(self._pendant.counted(row)[i]) for row in (joints, self._planned[posture]))
        low, high = (float(end[i] + at - joints[i]) for end in (lower, upper))
        sentence = (
            f"joint {i + 1} is at {at:.6g} {unit} and the plan has {planned:.6g}: to aim the laser it"
            f" would be at {low:.0f} to {high:.0f} {unit}"
        )
        return Doubt("far", sentence)
