"""A reflector with a wide sigma: why joint 6 is not determined follows from where it is found."""

from pathlib import Path

import numpy as np
import pytest
from cells import irb1600, run_of

from zerobeam.analysis.observability.causes import OnAxis, ToolRotation
from zerobeam.analysis.solution import solve
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan
from zerobeam.model.likelihood.problem import Problem

GUESS = [0.0, 0.0, 100.0]  # on the axis of joint 6


@pytest.mark.parametrize(("off_mm", "sigma_mm", "cause"), [(16.0, 500.0, ToolRotation), (0.0, 0.5, OnAxis)])
def test_the_cause_is_computed_from_where_the_reflector_is_found(off_mm, sigma_mm, cause):
    tracker = {"kind": "tracker", "frame": "free", "guess_mm": [2500, 500, 600], "sigma_mm": 0.05}
    reflectors = {"R": {"guess_mm": GUESS, "sigma_mm": sigma_mm}}
    own = Header.model_validate(
        {
            "robot": "irb1600",
            "geometry": "exact",
            "instruments": {"trk": {**tracker, "reflectors": reflectors}},
            "noise": {"joint_deg": 0.005},
        }
    )
    rng, count = np.random.default_rng(0), 20
    q = np.radians(np.add([20, 10, -10, 30, 50, 20], rng.uniform(-50, 50, (count, 6))))
    nowhere = (None,) * count
    plan = Plan(own, irb1600(), q, nowhere, nowhere, Path("plan.yaml"), "0" * 64, ())
    truth = Truth.with_values(plan, {"trk.R.x": off_mm, "trk.x": 2500.0, "trk.y": 500.0, "trk.z": 600.0})
    solution = solve(Problem.from_run(run_of(own, simulated_shots(truth, rng))), starts=0)
    assert solution["delta6"].status == "unidentifiable"
    assert isinstance(solution["delta6"].cause, cause)
