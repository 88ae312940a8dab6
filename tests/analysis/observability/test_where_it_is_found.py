"""Why the last joint is not determined follows from where a reflector is, not from how well it is stated."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cells import irb1600, run_of

from zerobeam.analysis.observability.causes import OnAxis, ToolRotation
from zerobeam.analysis.observability.identifiability import identify
from zerobeam.analysis.solution import solve
from zerobeam.experiments.simulate import Truth, simulated_shots
from zerobeam.model.files.header import Header
from zerobeam.model.files.plan import Plan, planned
from zerobeam.model.likelihood.problem import Problem

COUNT = 20


def plan_with(guess_mm: float, sigma_mm: float) -> Plan:
    """A tracker with a reflector that is thought to be so far off the axis of joint 6."""
    tracker: dict[str, Any] = {
        "kind": "tracker",
        "frame": "free",
        "guess_mm": [2500, 500, 600],
        "sigma_mm": 0.05,
        "reflectors": {"R": {"guess_mm": [guess_mm, 0.0, 100.0], "sigma_mm": sigma_mm}},
    }
    own = Header.model_validate(
        {
            "robot": "irb1600",
            "geometry": "exact",
            "instruments": {"trk": tracker},
            "noise": {"joint_deg": 0.005},
        }
    )
    shifts = np.random.default_rng(0).uniform(-50, 50, (COUNT, 6))
    joints = np.add([20, 10, -10, 30, 50, 20], shifts)
    nowhere = (None,) * COUNT
    return Plan(own, irb1600(), planned(joints, nowhere), nowhere, Path("plan.yaml"), "0" * 64, ())


@pytest.mark.parametrize(("off_mm", "cause"), [(16.0, ToolRotation), (0.1, OnAxis)])
def test_of_a_plan_it_is_where_it_is_thought_to_be(off_mm: float, cause: type) -> None:
    problem = Problem.from_plan(plan_with(off_mm, 500.0))
    found = identify(problem, problem.nominal())
    assert found.status[problem.parameters.index("delta6")] == "unidentifiable"
    (direction,) = [each for each in found.facts.null_space if "delta6" in each.combination]
    assert isinstance(direction.cause, cause)


@pytest.mark.parametrize(
    ("guess_mm", "sigma_mm", "off_mm", "cause"),
    [
        (0.0, 500.0, 16.0, ToolRotation),
        (16.0, 500.0, 0.1, OnAxis),
        pytest.param(0.0, 500.0, 0.1, OnAxis, marks=pytest.mark.long),
        pytest.param(0.0, 0.5, 0.4, OnAxis, marks=pytest.mark.long),
    ],
)
def test_of_a_run_it_is_where_it_is_found(
    guess_mm: float, sigma_mm: float, off_mm: float, cause: type
) -> None:
    plan = plan_with(guess_mm, sigma_mm)
    truth = Truth.with_values(plan, {"trk.R.x": off_mm, "trk.x": 2500.0, "trk.y": 500.0, "trk.z": 600.0})
    shots = simulated_shots(truth, np.random.default_rng(0))
    row = solve(Problem.from_run(run_of(plan.header, shots)), starts=0)["delta6"]
    assert row.status == "unidentifiable"
    assert row.estimate is None
    assert isinstance(row.cause, cause)
