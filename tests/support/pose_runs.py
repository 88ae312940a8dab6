"""Runs of a camera that measures poses, in postures that vary all joints or only some."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from cells import run_of

from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.files.robot_file import load_robot
from zerobeam.model.files.run import Run

CAMERA = {
    "kind": "pose",
    "frame": "free",
    "guess_mm": [1500.0, 500.0, 600.0],
    "sigma_mm": 0.1,
    "sigma_deg": 0.03,
    "mount": {},
}
REST_DEG = (30.0, -90.0, 60.0, -80.0, -70.0, 20.0)


def postures(count: int, moving: Sequence[int], seed: int = 0, range_deg: float = 40.0) -> np.ndarray:
    """(count, 6) degrees about `REST_DEG`; the `moving` joints (1, 2, …) vary by up to `range_deg`."""
    joints = np.tile(REST_DEG, (count, 1))
    at = [joint - 1 for joint in moving]
    joints[:, at] += np.random.default_rng(seed).uniform(-range_deg, range_deg, (count, len(at)))
    return joints


def pose_header(geometry: Any = "exact", **more: Any) -> Header:
    content: dict[str, Any] = {
        "robot": "ur5e",
        "instruments": {"cam": CAMERA},
        "noise": {"joint_deg": 0.01},
        "geometry": geometry,
        **more,
    }
    if geometry is None:
        del content["geometry"]
    return Header.model_validate(content)


def pose_run(
    joints_deg: np.ndarray,
    values: Mapping[str, float] | None = None,
    *,
    own: Header | None = None,
    seed: int = 0,
) -> Run:
    """The run of these postures by an arm with the true `values` (deg, mm), the camera turned and mounted."""
    own = own or pose_header()
    robot = load_robot("ur5e", Path("."))
    nowhere = (None,) * len(joints_deg)
    plan = Plan(own, robot, planned(joints_deg, nowhere), nowhere, Path("p"), "0" * 64, ())
    placed = {"cam.x": 1500.0, "cam.y": 500.0, "cam.z": 600.0, "cam.rz": 40.0, "cam.mount.z": 80.0}
    truth = Truth.with_values(plan, {**placed, **(values or {})})
    return run_of(own, simulated_shots(truth, np.random.default_rng(seed)), robot)
