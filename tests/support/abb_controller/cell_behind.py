"""The simulated cell behind a controller that moves its arm little by little."""

import copy

import numpy as np

from zerobeam.experiments.rigs.abb.rws_client import require_six_axes
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan


class CellBehind(SimulatedRig):
    """The cell of a plan, whose arm, laser and clock are the controller's; its sensors see it as it is now.

    The same seed draws the same truth as for the simulated rig. It knows of no measurements: the beam's
    wander is drawn again with each new posture, and a PSD whose face is turned towards the laser is so while
    the laser is off.
    """

    def __init__(self, plan: Plan, cell: CellFile, seed: int) -> None:
        if cell.faults:
            raise BadInput(
                "the faults of a cell are tied to measurements, of which a controller knows nothing",
                found=", ".join(fault.kind for fault in cell.faults),
                remedy="take `faults` out of the cell file, or run it by --rig simulated",
            )
        super().__init__(plan, cell, seed)
        robot = plan.robot
        require_six_axes(robot, "the simulated IRC5", "run this plan by --rig simulated")
        self.robot, self.acceleration = robot, cell.arm.acceleration_deg_s2 / robot.display
        self.top_speed = np.array([joint.speed or 1.0 for joint in robot.joints])  # as the simulated arm's
        self._arm.begin(self._rng, np.clip(np.zeros(robot.n), robot.lower, robot.upper))
        self._driven: Matrix | None = None

    def drive(self, joints: Matrix, seconds: float) -> None:
        """The arm's counts go to the joints (n,) at that time of the controller's clock."""
        self._time = seconds
        if joints is not self._driven:  # a drive at rest gives the very same, 250 times a second
            self._driven = joints
            self._arm.move(joints)

    def counts(self) -> Matrix:
        """(n,) by the encoders, rad."""
        return self._arm.read()

    def sent(self, joints: Matrix) -> None:
        """The arm is to go there: if that is another posture, the beam wanders."""
        if np.abs(joints - self.counts()).max() > self._arm.redraw:
            self._wander = self._rng.normal(size=2) * self._parts.wander

    def switch(self, on: bool) -> None:
        """The laser."""
        if on and not self._on:
            self._turn_face()
        self._on = on

    def before(self, target: str) -> SimulatedRig:
        """The cell at this moment, before that target's PSD: for its `currents` and its `image`,
        which take longer than the arm can wait."""
        if target not in self.psds:
            raise BadInput("there is no such PSD", found=target, allowed=", ".join(self.psds))
        self._target = target
        if not self._on:
            self._turn_face()
        still = copy.copy(self)
        still._arm = copy.copy(self._arm)
        return still
