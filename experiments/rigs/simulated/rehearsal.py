"""The ports of a rehearsal of what is no beam: led to its target by hand, or read wherever the arm stands, it
needs neither servo nor sensors. Its measurements are simulated at once, in their own order."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from ....analysis.solution import Solution
from ....model.arrays import Matrix
from ....model.files.shot import Shot
from ...procedure.events import Listener
from ...procedure.ports import Ports, Reading
from ...simulate import Truth, simulated_shots

_STATES = 5  # times at most what is known so far is found out


class Rehearsal(Ports):
    """The ports and the order of the measurements of a simulated arm, with noise by `rng`."""

    def __init__(self, truth: Truth, rng: np.random.Generator, told: Listener) -> None:
        self.plan, self.problem, self.listener = truth.plan, truth.problem, told
        # What each measurement adds is told of a tool; a fit of many other readings takes too long for that.
        self.every = 1 if self.plan.header.only_tools else -(-len(self.plan.postures) // _STATES)
        self._shots = simulated_shots(truth, rng)

    def following(
        self, recorded: Sequence[Shot], refused: Collection[int], state: Solution | None
    ) -> int | None:
        """The next that is not recorded."""
        done = {shot.shot for shot in recorded}
        for shot in self._shots:
            if shot.shot not in done:
                self._shot = shot
                return shot.shot
        return None

    def joints(self) -> Matrix:
        return np.array(self._shot.joints_deg)

    def reading(self, number: int) -> Reading:
        return self._shot.readings

    def stop(self) -> None:
        """Nothing moves."""
