"""A camera's rotations have a noise of their own: how many mm go with a degree may be stated wrongly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pose_runs import CAMERA, pose_header, pose_run, postures

from zerobeam.analysis.diagnostics.predicted_run import predict_run
from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.solution import Solution, solve
from zerobeam.model.files.run import Run
from zerobeam.model.instruments.pose import PoseStation
from zerobeam.model.likelihood.problem import Problem

TRUE_DEG, MEASURED, JOINT_DEG = 0.09, 14, 0.001


def halves(stated_deg: float, scale: str) -> tuple[Run, Run]:
    """A run of few poses and one of many more, both with the rotation's noise as `stated_deg`."""
    camera = {**CAMERA, "sigma_mm": 0.02}
    true = pose_header(instruments={"cam": {**camera, "sigma_deg": TRUE_DEG}}, noise={"joint_deg": JOINT_DEG})
    run = pose_run(postures(54, range(1, 7), 1), {"delta2": 0.1, "delta3": -0.1}, own=true, seed=1)
    stated = pose_header(
        instruments={"cam": {**camera, "sigma_deg": stated_deg}},
        noise={"joint_deg": JOINT_DEG, "scale": scale},
    )
    run = replace(run, header=stated)
    first = replace(run, shots=run.shots[:MEASURED], lines=run.lines[:MEASURED])
    return first, replace(run, shots=run.shots[MEASURED:], lines=run.lines[MEASURED:])


def held_out_mm(stated_deg: float, scale: str) -> tuple[Solution, float]:
    first, second = halves(stated_deg, scale)
    solution = solve_run(Problem.from_run(first), first.header)
    rms = predict_run(solution, second).rms_mm
    assert rms is not None
    return solution, rms


def with_one_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """Position and rotation of a pose with one factor, as it was."""
    key, reading = PoseStation.key.fget, PoseStation.reading
    assert key is not None

    def relative(self, *given):
        numbers = reading(self, *given)
        numbers[-3:] = self.sigma_rad / self.sigma_mm
        return numbers

    monkeypatch.setattr(PoseStation, "noises", property(lambda self: super(PoseStation, self).noises))
    monkeypatch.setattr(PoseStation, "layout", property(lambda self: super(PoseStation, self).layout))
    monkeypatch.setattr(PoseStation, "key", property(lambda self: b"one factor" + key(self)))
    monkeypatch.setattr(PoseStation, "reading", relative)


@pytest.mark.parametrize("times", [1 / 3, pytest.param(3.0, marks=pytest.mark.long)])
def test_the_factor_of_the_rotation_is_found(times: float) -> None:
    first, _ = halves(TRUE_DEG * times, "separate")
    solution = solve(Problem.from_run(first), starts=0)
    row = solution["noise.cam.rotation"]
    assert row.status == "identified"
    assert row.estimate is not None
    assert row.std is not None
    assert abs(np.log(row.estimate * times)) < 2 * row.std / row.estimate


@pytest.mark.long
def test_a_wrong_statement_of_degrees_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    _, right = held_out_mm(TRUE_DEG, "separate")
    for times in (1 / 3, 3.0):
        assert held_out_mm(TRUE_DEG * times, "separate")[1] == pytest.approx(right, rel=0.02)
    # Controls: as stated, and with one factor for both.
    assert held_out_mm(TRUE_DEG / 3, "known")[1] > 1.1 * right
    with_one_factor(monkeypatch)
    assert held_out_mm(TRUE_DEG / 3, "separate")[1] > 1.1 * right


def test_the_noises_of_a_pose() -> None:
    first, _ = halves(TRUE_DEG, "separate")
    problem = Problem.from_run(first)
    assert problem.noise.factors == ("joint", "cam", "cam.rotation")
    np.testing.assert_allclose(problem.noise.readings, [0.02, np.radians(TRUE_DEG)])
