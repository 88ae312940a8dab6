"""A camera's rotations have a noise of their own: how many mm go with a degree may be stated wrongly."""

from dataclasses import replace

import numpy as np
import pytest
from pose_runs import CAMERA, pose_header, pose_run, postures

from zerobeam.analysis.ladder import solve_run
from zerobeam.analysis.prediction import predict_run
from zerobeam.analysis.solution import solve
from zerobeam.model.files.run import Run
from zerobeam.model.instruments.pose import PoseStation
from zerobeam.model.likelihood.density import Density
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


def held_out_mm(stated_deg: float, scale: str) -> float:
    first, second = halves(stated_deg, scale)
    solution = solve_run(Problem.from_run(first), first.header)
    rms = predict_run(solution, second).rms_mm
    assert rms is not None
    return rms


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


@pytest.mark.one_in(2)
@pytest.mark.parametrize("scale", ["separate", "estimated"])
@pytest.mark.parametrize("times", [1 / 3, pytest.param(3.0, marks=pytest.mark.long)])
def test_the_factor_of_the_rotation_is_found(times: float, scale: str) -> None:
    first, _ = halves(TRUE_DEG * times, scale)
    solution = solve(Problem.from_run(first), starts=0)
    row = solution["noise.cam.rotation"]
    assert row.status == "identified"
    assert row.estimate is not None
    assert row.std is not None
    assert abs(np.log(row.estimate * times)) < 2 * row.std / row.estimate


@pytest.mark.long
@pytest.mark.parametrize("scale", ["separate", "estimated"])
def test_a_wrong_statement_of_degrees_costs_nothing(scale: str, monkeypatch: pytest.MonkeyPatch) -> None:
    right = held_out_mm(TRUE_DEG, scale)
    for times in (1 / 3, 3.0):
        assert held_out_mm(TRUE_DEG * times, scale) == pytest.approx(right, rel=0.02)
    # Controls: as stated, and with one factor for both.
    assert held_out_mm(TRUE_DEG / 3, "known") > 1.1 * right
    with_one_factor(monkeypatch)
    assert held_out_mm(TRUE_DEG / 3, scale) > 1.1 * right


@pytest.mark.parametrize(
    ("scale", "factors", "of_factor"),
    [
        ("separate", ("joint", "cam", "cam.rotation"), (0, 1, 2)),
        ("estimated", ("common", "cam.rotation"), (0, 0, 1)),
    ],
)
def test_the_noises_of_a_pose(scale: str, factors: tuple[str, ...], of_factor: tuple[int, ...]) -> None:
    first, _ = halves(TRUE_DEG, scale)
    problem = Problem.from_run(first)
    assert (problem.noise.factors, problem.noise.of_factor) == (factors, of_factor)
    x = problem.nominal()
    x[problem.parameters.index("noise.cam.rotation")] = np.log(3.0)
    variances = problem.variances(x) / problem.noise.variances
    np.testing.assert_allclose(variances, [1.0] * 7 + [9.0])
    np.testing.assert_allclose(problem.noise.readings, [0.02, np.radians(TRUE_DEG)])


@pytest.mark.parametrize("scale", ["separate", "estimated"])
def test_slopes_by_the_noise_factors(scale: str) -> None:
    """Against central differences; of `estimated` two noises have one factor."""
    first, _ = halves(TRUE_DEG / 3, scale)
    problem = Problem.from_run(first)
    density, free = Density(problem), np.flatnonzero(problem.parameters.free)
    x = problem.nominal()
    noise = np.flatnonzero(problem.parameters.group("noise"))
    x[noise] = np.linspace(0.2, 0.5, len(noise))
    gradient = density.slopes(x[None]).gradient[0]
    for column in noise:
        step = np.zeros(len(x))
        step[column] = 1e-4
        up, down = (density.log_posterior((x + sign * step)[None])[0] for sign in (1, -1))
        expected = (up - down) / 2e-4 * problem.parameters.prior_std[column]
        assert gradient[np.flatnonzero(free == column)[0]] == pytest.approx(expected, rel=1e-5)
