"""A recorded run as a rig: the procedure goes through it again, shot by shot, without an arm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...model.errors import BadInput, RigFault
from ...model.plan import Plan
from ...model.problem import Problem
from ...model.robot import Matrix
from ...model.run import Run, Shot
from ..camera import Image
from ..psd import Psd
from ..steering import Belief

_SIZE = 200.0  # mm: a spot that was recorded is on it
_NOISE = 1e-6  # mm: a recorded spot is a mean already
_SAME_POSTURE = np.radians(5.0)  # joints that are not turned onto the target stand as planned


class ReplayRig:
    """It gives joints and spot of each shot as they were recorded; BadInput for a run of another arm."""

    steerable = False
    camera = None

    def __init__(self, plan: Plan, run: Run) -> None:
        if run.robot.n != plan.robot.n or run.header.tool != plan.header.tool:
            raise BadInput(
                "the recording is not of this plan's robot and tool",
                found=f"{run.robot.name} with a {run.header.tool.kind}",
                allowed=f"{plan.robot.name} with the plan's {plan.header.tool.kind}",
                file=run.path,
            )
        if run.header.tool.kind != "laser":
            raise BadInput("a probe's run cannot be replayed: it has no spots", file=run.path)
        self._plan, self._name = plan, run.path.name
        self._shots = {shot.shot: shot for shot in run.shots}
        self._problem = Problem.from_plan(plan)
        self._wrist = Belief(self._problem, self._problem.supposed()).wrist > 0
        self._on, self._time = False, 0.0
        self._shot = run.shots[0]
        # Each face looks at its beam: what was recorded is across the beam.
        psd = Psd(_SIZE, "duo-lateral", 1000.0, _NOISE, 10.0, np.zeros((2, 3)), None, 0.0)
        self.psds = dict.fromkeys(plan.target_names, psd)

    def provenance(self) -> dict[str, str | int | float]:
        """For the run's header."""
        return {"origin": "replayed", "recording": self._name}

    def now(self) -> float:
        return self._time

    def wait(self, seconds: float) -> None:
        pass  # what was waited for has been

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        if shot not in self._shots:
            raise RigFault(f"{self._name} has no shot {shot}: the replay ends here")
        recorded = self._shots[shot]
        if recorded.target != target:
            raise RigFault(f"{self._name}: shot {shot} is at {recorded.target}, the plan's at {target}")
        off = np.abs(self._read(recorded) - self._plan.postures[shot])[~self._wrist]
        if (
            off.size
            and float(np.radians(off * self._problem.robot.display[~self._wrist]).max()) > _SAME_POSTURE
        ):
            raise RigFault(f"{self._name}: shot {shot} was not made in the plan's posture {shot}")
        self._shot = recorded

    def move(self, joints: Matrix) -> None:
        if self._shot.time_s is not None:
            self._time = self._shot.time_s

    def joints(self) -> Matrix:
        return self._read(self._shot)

    def currents(self, samples: int) -> Matrix:
        if not self._on:
            return np.zeros((samples, 4))
        psd = self.psds[self._shot.target]
        x, y = self._on_face(psd) / (psd.size / 2)
        return np.tile(np.array([1 + x, 1 - x, 1 + y, 1 - y]) / 2, (samples, 1))

    def image(self) -> Image:
        raise RigFault("a recording has no camera")

    def laser(self, on: bool) -> None:
        self._on = on

    def stop(self) -> None:
        self._on = False

    def _read(self, shot: Shot) -> Matrix:
        return np.asarray(np.array(shot.joints_deg) / self._plan.robot.display)

    def _on_face(self, psd: Psd) -> Matrix:
        """(2,) mm the beam on the face, from where the target was across the beam."""
        joints = self.joints()
        one = replace(self._problem.select(np.array([0])), joints=joints[None])
        belief = Belief(one, self._problem.supposed())
        _, direction = belief.beam(joints)
        _, _, across = one.tool.nominal_beam()
        axes = belief.turned(joints, psd.frame(direction)[:, :2].T) @ across
        return np.asarray(np.linalg.solve(-axes.T, np.array(self._shot.spot_mm or (0.0, 0.0))))
