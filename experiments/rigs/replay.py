"""A recorded run as a rig: the procedure goes through it again, without an arm."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...analysis.observability.aim import servo_joints
from ...model.arrays import Matrix
from ...model.errors import BadInput, RigFault
from ...model.files.plan import Plan
from ...model.files.run import Run
from ...model.files.shot import Shot, ShotRules
from ...model.kinematics.robot import same_arm
from ...model.likelihood.problem import Problem
from ..procedure.steering import Belief
from ..sensors.detectors import Camera, Image, Psd

_SIZE = 200.0  # mm: a spot that was recorded is on it
_NOISE = 1e-6  # mm: a recorded spot is a mean already
SAME_POSTURE = 5.0  # deg (mm): joints that are not turned onto the target are as planned


class ReplayRig:
    """A rig that returns joints and spot of each measurement as they were recorded.

    BadInput for a run that is not of this plan: of another arm or tool, at other targets, in other postures.
    """

    steerable = False
    camera: Camera | None = None

    def __init__(self, plan: Plan, run: Run) -> None:
        if (
            not same_arm(run.robot, plan.robot)
            or run.header.instruments_stated() != plan.header.instruments_stated()
        ):
            raise BadInput(
                "the recording is not of this plan's robot and tool",
                found=f"{run.robot.name} with a {run.header.instrument.name}",
                allowed=f"{plan.robot.name} with the plan's {plan.header.instrument.name}",
                file=run.path,
                line=run.header_line,
            )
        if not run.header.instrument.columns:
            kind = run.header.instrument.name
            raise BadInput(f"a {kind}'s run cannot be replayed: it has no spots", file=run.path)
        self._name, self._display = run.path.name, plan.robot.display
        remedy = "replay it with the plan that it was made with"
        require_planned(plan, run, "the recording was not made with this plan", remedy)
        problem = Problem.from_plan(plan)
        self._shots = {shot.shot: shot for shot in run.shots}
        self._supposed = Belief(problem.select(np.array([0])), problem.nominal())
        self._on, self._time = False, 0.0
        self._shot = run.shots[0]
        # Each face looks at its beam: what was recorded is across the beam.
        psd = Psd(_SIZE, "duo-lateral", 1000.0, _NOISE, 10.0, np.zeros((2, 3)), None, 0.0)
        self.psds: Mapping[str, Psd] = dict.fromkeys(plan.target_names, psd)

    def provenance(self) -> dict[str, str | int | float]:
        """For the run's header."""
        return {"origin": "replayed", "recording": self._name}

    def now(self) -> float:
        return self._time

    def wait(self, seconds: float) -> None:
        pass  # what was waited for has been

    def begin(self, shot: int, target: str, last: Shot | None) -> None:
        if shot not in self._shots:
            raise RigFault(f"{self._name} has no measurement {shot}: the replay ends here")
        self._shot, self._on = self._shots[shot], False

    def move(self, joints: Matrix) -> None:
        if self._shot.time_s is not None:
            self._time = self._shot.time_s

    def joints(self) -> Matrix:
        return np.array(self._shot.joints_deg) / self._display

    def currents(self, samples: int) -> Matrix:
        if not self._on:
            return np.zeros((samples, 4))
        psd = self.psds[self._shot.met_target]
        x, y = self._on_face(psd) / (psd.size / 2)
        return np.tile(np.array([1 + x, 1 - x, 1 + y, 1 - y]) / 2, (samples, 1))

    def image(self) -> Image:
        raise RigFault("a recording has no camera")

    def laser(self, on: bool) -> None:
        self._on = on

    def stop(self) -> None:
        self._on = False

    def _on_face(self, psd: Psd) -> Matrix:
        """(2,) mm the beam on the face, from where the target was across the beam."""
        joints, belief = self.joints(), self._supposed
        _, _, across = belief.problem.tool.nominal_beam()
        _, direction = belief.beam(joints)
        axes = belief.turned(joints, psd.frame(direction)[:, :2].T) @ across
        return np.asarray(np.linalg.solve(-axes.T, np.array(self._shot.spot_mm or (0.0, 0.0))))


def require_planned(plan: Plan, run: Run, message: str, remedy: str, *, anywhere: bool = False) -> None:
    """BadInput for the first measurement that is not of the plan: by its number, its target and instrument,
    and with a laser by the joints that no servo turns, unless it may be `anywhere`."""
    kept = servo_joints(Problem.from_plan(plan))[0] == 0 if plan.header.only_beam else slice(0)
    rules = ShotRules(plan.header, plan.robot)
    planned_deg, count = plan.postures * plan.robot.display, len(plan.postures)
    for shot, line in zip(run.shots, run.lines, strict=True):
        number = shot.shot % count  # a closing measurement is in the posture of the first
        if shot.shot >= 2 * count:
            deviation, allowed = (
                f"measurement {shot.shot}",
                f"measurements 0 to {count - 1}, and closing measurements",
            )
        elif shot.target != plan.targets[number]:
            deviation = f"measurement {shot.shot} at target {shot.target}"
            allowed = f"target {plan.called[number]}, as the plan's posture {number}"
        elif (label := rules.label(shot.instrument)) != (planned := plan.measurements[number].instrument):
            deviation = f"measurement {shot.shot} of the instrument {label}"
            allowed = f"{planned}, as the plan's posture {number}"
        else:
            off = np.abs(shot.joints_deg - planned_deg[number])[kept]
            if anywhere or off.max(initial=0.0) <= SAME_POSTURE:
                continue
            deviation = (
                f"measurement {shot.shot}, whose joint {np.argmax(off) + 1} is {off.max():.1f} deg (mm) off"
            )
            allowed = f"the plan's posture {number}, but for the joints that the servo turns"
        raise BadInput(
            message,
            found=deviation,
            allowed=allowed,
            remedy=remedy,
            file=run.path,
            line=line,
        )
