"""Shots of the simulated cell as far as the servo: arm at an initial posture, PSD aside of the beam."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from cells import good_plan

from zerobeam.experiments.procedure.rig import read_dark
from zerobeam.experiments.procedure.steering import Belief, Centred, Search, centre, come_to
from zerobeam.experiments.rigs.simulated.cell_file import CellFile
from zerobeam.experiments.rigs.simulated.simulator import SimulatedRig
from zerobeam.experiments.sensors.detectors import Psd
from zerobeam.model.arrays import Matrix
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem

# A cell without anything wrong: what a test adds is what it is about.
EXACT: dict[str, Any] = {
    "arm": {"offsets_deg": {}, "repeatability_deg": 0, "resolution_deg": 0},
    "laser": {"wander_mm": 0},
    "camera": {"misturned_deg": [0, 0, 0]},
    "misturned_deg": [0, 0, 0],
}


@cache
def plan() -> Plan:
    return good_plan(10)


@cache
def problem() -> Problem:
    return Problem.from_plan(plan())


class WatchedRig(SimulatedRig):
    """Keeps the moves that it is sent."""

    def __init__(self, plan: Plan, cell: CellFile, seed: int) -> None:
        super().__init__(plan, cell, seed)
        self.moves: list[Matrix] = []

    def move(self, joints: Matrix) -> None:
        self.moves.append(joints.copy())
        super().move(joints)

    def hit(self) -> Matrix:
        """(2,) mm where the beam truly is in the plane of the face."""
        hit, _ = self._light()
        assert hit is not None
        return hit

    def link(self) -> Matrix:
        return self._arm.link()

    def centre(self) -> Matrix:
        return self._centre()

    def face(self) -> Matrix:
        return self._face


@dataclass(eq=False)
class Start:
    rig: WatchedRig
    belief: Belief
    psd: Psd
    joints: Matrix
    dark: Matrix

    def search(self) -> Search:
        return Search(self.rig, self.belief, self.psd, self.joints, self.dark)

    def centred(self, frame: Matrix | None = None) -> Centred:
        """Stage 2 alone, from where the arm is."""
        self.rig.laser(True)
        known = self.psd.frame(self.belief.beam(self.joints)[1]) if frame is None else frame
        return centre(self.rig, self.belief, self.psd, self.joints, self.dark, known)

    def shot(self) -> tuple[Search, Centred]:
        """Both stages."""
        search = self.search()
        search.run()
        psd = self.psd
        return search, centre(self.rig, search.belief, psd, search.joints, self.dark, search.frame())


def start(
    off_mm: float = 0.0,
    seed: int = 0,
    *,
    posture: int | None = None,
    slant_deg: float | None = None,
    exact: bool = False,
    **cell: Any,
) -> Start:
    """The arm at a posture of the plan, the PSD `off_mm` from the supposed beam in a direction by the seed.

    `slant_deg` is the angle between the beam and the normal of the face; `cell` are parts of the cell file.
    """
    number = seed % 10 if posture is None else posture
    rng = np.random.default_rng([seed, 77])
    joints, belief = (
        plan().postures[number],
        Belief(problem().select(np.array([number])), problem().nominal()),
    )
    _, direction = belief.beam(joints)
    aside, tilt = (np.cross(direction, rng.normal(size=3)) for _ in range(2))
    aside, tilt = aside / np.linalg.norm(aside), tilt / np.linalg.norm(tilt)
    parts: dict[str, Any] = (
        {key: dict(value) for key, value in EXACT.items() if key != "misturned_deg"} if exact else {}
    )
    parts.setdefault("arm", {}).setdefault("offsets_deg", {})
    for key, value in cell.items():
        parts[key] = {**parts.get(key, {}), **value} if isinstance(value, dict) else value
    placed: dict[str, Any] = {"centre_mm": list(belief.target + off_mm * aside)}
    if exact:
        placed["misturned_deg"] = EXACT["misturned_deg"]
    if slant_deg is not None:
        slant = np.radians(slant_deg)
        placed["normal"] = list(np.sin(slant) * tilt - np.cos(slant) * direction)
    psd = parts.setdefault("psd", {})
    parts["psd"] = {**psd, "placed": {"psd": {**placed, **psd.get("placed", {})}}}
    rig = WatchedRig(plan(), CellFile.model_validate(parts), seed)
    rig.begin(number, "psd", None)
    come_to(rig, belief, joints)
    own = rig.psds["psd"]
    return Start(rig, belief, own, joints, read_dark(rig, own, 100))
