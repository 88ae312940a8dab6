"""The simulated cell as at a pendant: programs move the arm, and a person centres the beam."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from cells import LASER, header, plan_of, varied_postures

from zerobeam.analysis.observability.aim import aim_plan
from zerobeam.experiments.plans.constraints import violations
from zerobeam.experiments.procedure.rig import read_dark
from zerobeam.experiments.procedure.steering import Belief, Search, centre
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan, read_plan, write_plan
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.shot import Shot
from zerobeam.model.likelihood.problem import Problem
from zerobeam.words.provenance import true_values

TRUTH = {"delta2": -0.9, "delta3": 0.6, "delta4": 0.4, "delta5": -0.7, "delta6": 0.5}
_SAMPLES = 50


def plan_for(folder: Path, robot: str, target: tuple[float, float, float], count: int = 12) -> Plan:
    """A plan of varied postures of a built-in robot, in which it is not in the way of its beam, through its
    file."""
    own, arm = header(LASER, target=target, robot=robot), load_robot(robot)
    for drawn in (count, 2 * count, 4 * count):
        made = plan_of(own, varied_postures(own, arm, target, drawn, 4), robot=arm)
        blocked = {each.posture for each in violations(aim_plan(made)) if each.condition == "arm"}
        clear = [i for i in range(drawn) if i not in blocked][:count]
        if len(clear) == count:
            break
    path = folder / "plan.yaml"
    postures = np.round(np.asarray(made.postures)[clear] * arm.display, 4)
    write_plan(path, own, postures, [made.targets[i] for i in clear])
    return read_plan(path)


class PendantArm:
    """The arm of a plan with true offsets. Joints are degrees (mm), lists, as controllers have them."""

    def __init__(
        self,
        plan: Plan,
        offsets: dict[str, float] = TRUTH,
        seed: int = 0,
        known: Mapping[str, float] | None = None,
    ) -> None:
        """`known` are the true values by name of an arm that was measured before, in place of `offsets`."""
        self.plan, self._display = plan, plan.robot.display
        cell: dict[str, Any] = {"camera": None}
        if known is None:
            cell["arm"] = {"offsets_deg": offsets}
        self._rig = SimulatedRig(plan, CellFile.model_validate(cell), seed, arm=known)
        self._begun: int | None = None
        self._last: Shot | None = None
        self.moves: list[list[float]] = []

    @property
    def truth(self) -> dict[str, float]:
        """The true offsets, links and tool by name, deg and mm."""
        return true_values(self._rig.provenance())

    def move(self, joints: Any) -> None:
        """Go there, as a program commands it."""
        row = [float(value) for value in joints]
        assert len(row) == self.plan.robot.n
        self._begin()
        self.moves.append(row)
        self._rig.move(np.array(row) / self._display)

    def joints(self) -> list[float]:
        """As the controller reads them."""
        self._begin()
        return [float(value) for value in self._rig.joints() * self._display]

    def centre(self) -> None:
        """What the person does at a pause: jog the wrist until the beam is on the PSD's centre."""
        assert self._begun is not None, "the program waits before it has moved"
        plan, number, rig = self.plan, self._begun, self._rig
        problem = Problem.from_plan(plan)
        belief = Belief(problem.select(np.array([number])), problem.nominal())
        psd = rig.psds[plan.targets[number]]
        rig.laser(False)
        joints: Matrix = rig.joints()
        search = Search(rig, belief, psd, joints, read_dark(rig, psd, _SAMPLES))
        search.run()
        dark = read_dark(rig, psd, _SAMPLES)
        rig.laser(True)
        centre(rig, search.belief, psd, search.joints, dark, search.frame(), lambda at: None)
        self._last = Shot(
            shot=number, target=plan.targets[number], joints_deg=tuple(self.joints()), time_s=rig.now()
        )
        self._begun = None

    def _begin(self) -> None:
        if self._begun is None and (self._last is None or self._last.shot + 1 < len(self.plan.postures)):
            self._begun = 0 if self._last is None else self._last.shot + 1
            self._rig.begin(self._begun, self.plan.targets[self._begun], self._last)
