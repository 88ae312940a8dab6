"""Runs of a probe on an arm whose links deviate from nominal, precise enough to see it."""

from pathlib import Path
from typing import Any

import numpy as np
from cells import PROBE, TABLE_2, header, plan_of, run_of, simulated, varied_postures
from export_runs import saved

from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run
from zerobeam.model.kinematics.robot import Robot

LINKS = {"link2.a": 0.31, "link2.beta": 0.08, "link3.d": -0.2, "link4.alpha": 0.05, "link3.alpha": -0.1}
_PLACES = {
    "left": (800.0, 500.0, 300.0),
    "right": (850.0, -450.0, 350.0),
    "high": (900.0, 100.0, 800.0),
    "low": (700.0, 100.0, 100.0),
}


def geometry_run(
    folder: Path, robot: Any = "irb1600", values: dict[str, float] | None = None, **stated: Any
) -> Run:
    """40 measurements at four targets; `stated` of the header's geometry, links alone by default."""
    geometry = {"gravity": False, "harmonics": False, **stated}
    targets = {name: {"guess_mm": list(place), "sigma_mm": 50} for name, place in _PLACES.items()}
    own = header(
        PROBE, target=None, joint_deg=2e-4, spot_mm=2e-3, geometry=geometry, targets=targets, robot=robot
    )
    arm = load_robot(own.robot, folder)
    alone = header(PROBE, target=None, robot=robot)
    postures = [varied_postures(alone, arm, place, 10, 7 + k) for k, place in enumerate(_PLACES.values())]
    names = [name for name in _PLACES for _ in range(10)]
    plan = plan_of(own, np.concatenate(postures), names, arm)
    return saved(folder, own, simulated(plan, {**TABLE_2, **(LINKS if values is None else values)}, 1)[1])


def on(run: Run, robot: Robot) -> Run:
    """The same measurements of another robot."""
    return run_of(run.header, run.shots, robot)
