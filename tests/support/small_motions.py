"""Runs of a tracker whose joints vary by some degrees, or not at all: two halves of one set."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run

CENTRE_DEG = (20.0, 10.0, -10.0, 30.0, 50.0, 20.0, 10.0)
TRACKER = {
    "kind": "tracker",
    "frame": "free",
    "guess_mm": [2500.0, 500.0, 600.0],
    "sigma_mm": 0.05,
    "reflectors": {"R": {"guess_mm": [60.0, 0.0, 80.0]}},
}


def halves(
    robot: str = "irb1600",
    *,
    at_rest: Sequence[int] = (1,),
    half_deg: float = 5.0,
    count: int = 40,
    geometry: Any = "exact",
    seed: int = 0,
) -> tuple[Run, Run]:
    """Two runs of `count` points each by one arm: offsets of about half a degree; geometry, reflector and
    frame off as the header allows. The joints `at_rest` (1, 2, …) never move."""
    rng, arm = np.random.default_rng(seed), load_robot(robot, Path("."))
    content: dict[str, Any] = {"robot": robot, "instruments": {"trk": TRACKER}, "noise": {"joint_deg": 0.005}}
    if geometry is not None:
        content["geometry"] = geometry
    own = Header.model_validate(content)
    still = np.isin(np.arange(arm.n), [joint - 1 for joint in at_rest])
    centre = np.array(CENTRE_DEG[: arm.n])
    q = centre + np.where(still, 0.0, rng.uniform(-half_deg, half_deg, (2 * count, arm.n)))
    lines = (None,) * len(q)
    plan = Plan(own, arm, planned(q, lines), lines, Path("plan.yaml"), "0" * 64, ())
    shots = [
        shot.model_copy(
            update={"joints_deg": tuple(np.where(still, centre, shot.joints_deg).tolist()), "shot": i // 2}
        )
        for i, shot in enumerate(simulated_shots(Truth.drawn(plan, rng, 0.5), rng))
    ]
    return (
        Run.of_shots(own, arm, shots[::2], "fitted"),
        Run.of_shots(own, arm, shots[1::2], "held out"),
    )
