"""How far the joints that aim a laser turn, by the plan: a joint beyond that was misread or mistyped."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from ....analysis.estimation.threads import one_blas_thread
from ....analysis.observability.aim import aim, servo_joints
from ....model.arrays import Matrix
from ....model.files.plan import Plan
from ....model.likelihood.problem import Problem
from ...procedure.session import near_nominal
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
    """

    def __init__(self, plan: Plan) -> None:
        self._plan, self._problem = plan, Problem.from_plan(plan)
        self._nominal = self._problem.nominal()
        parameters = near_nominal(self._problem, self._nominal).parameters
        off = np.diag(np.where(parameters.free, parameters.prior_std, 0.0))[parameters.free]
        # (2 s, p): each of s values higher by its standard deviation, then lower.
        self._off = self._nominal + np.stack([off, -off], axis=1).reshape(-1, len(parameters))
        self.joints = servo_joints(self._problem) > 0

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
        rows = self._problem.select(np.full(len(x), posture)).moved(np.tile(start, (len(x), 1)))
        with one_blas_thread():
            aimed = aim(rows, x, weights)
        return np.where((aimed.hit & aimed.ahead)[:, None], aimed.problem.joints - start, np.nan)
