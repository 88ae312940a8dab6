"""The climb in C against the one in Python, which is the one that the other tests know."""

import numpy as np
import pytest
from cells import good_plan, header, plan_of
from fit_problems import KINDS, fit_problems

from zerobeam.analysis.estimation.climb import Climb, compiled_climb
from zerobeam.analysis.estimation.coordinates import flange_coordinates
from zerobeam.analysis.estimation.fit import start_at
from zerobeam.analysis.estimation.levenberg_marquardt import NOT_FINITE
from zerobeam.model import kernel
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.problem import Problem

needs_compiler = pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")


PLAIN = [case for case in KINDS if case not in ("separate noise", "all targets held")]


def climbs(problem, sets, rows=5, seed=1):
    """The climb in C and the one in Python of the same rows, and where they start, x (rows, p)."""
    rng = np.random.default_rng(seed)
    values = 1e-3 * rng.normal(size=(sets, *problem.joints.shape)) * (problem.robot.display > 1)
    spots = rng.normal(size=(sets, *problem.spots.shape)) * problem.noise.spot
    density = Density(problem, problem.joints + values, spots)
    of = rng.integers(sets, size=rows)
    one, two = Climb(density, of, rows), Climb(density, of, rows)
    one._compiled = compiled_climb(density, one.coordinates, compile=True)
    two._compiled = None
    z = 0.3 * rng.normal(size=(rows, density.size))
    return one, two, start_at(problem, z, density.joints[of])


@pytest.mark.one_in(3)
@needs_compiler
@pytest.mark.parametrize("case", PLAIN)
@pytest.mark.parametrize("sets", [1, 4])
@pytest.mark.at_length(r"^1-prismatic")
def test_the_same_slopes(case, sets):
    one, two, x = climbs(fit_problems()[case], sets)
    v = one.coordinates.from_parameters(x, one.of)
    every = np.arange(len(v))
    result, expected = one._compiled.slopes(v, one.of), two._model(v, every)
    for part, actual in zip(result, expected, strict=True):
        np.testing.assert_allclose(part, actual, rtol=0, atol=1e-12 * np.abs(actual).max())
    short = one._compiled.slopes(v, one.of, with_information=False)
    np.testing.assert_array_equal(short.gradient, result.gradient)
    assert short.curvature.shape == (0, v.shape[1], v.shape[1])
    if sets > 1:  # control: of another data set they are others
        other = one._compiled.slopes(v, (one.of + 1) % sets)
        assert np.abs(other.cost / result.cost - 1).min() > 1e-6


@needs_compiler
@pytest.mark.parametrize("case", PLAIN)
def test_the_same_way_up(case):
    one, two, x = climbs(fit_problems()[case], 4)
    v = one.coordinates.from_parameters(x, one.of)
    v[1] = np.nan
    inputs = v.copy()
    result, expected = one.up(v), two.up(v)
    np.testing.assert_array_equal(v, inputs)  # not written into
    assert result.reason == expected.reason
    assert result.reason[1] == NOT_FINITE
    np.testing.assert_array_equal(result.iterations, expected.iterations)
    np.testing.assert_array_equal(result.converged, expected.converged)
    assert result.converged.sum() == (0 if case == "prismatic, open probe" else 4)  # six tips: no mode
    sound = np.flatnonzero(result.converged)
    std = np.sqrt(np.diagonal(np.linalg.inv(expected.curvature[sound]), axis1=1, axis2=2))
    np.testing.assert_allclose((result.x - expected.x)[sound] / std, 0, atol=1e-6)
    np.testing.assert_allclose(result.cost[sound], expected.cost[sound], rtol=1e-9)


@needs_compiler
def test_too_few_steps_are_said():
    one, two, x = climbs(fit_problems()["two targets, open laser"], 1)
    v = one.coordinates.from_parameters(x, one.of)
    result, expected = one.up(v, 1), two.up(v, 1)
    assert result.reason == expected.reason == ["no convergence in 1 iterations"] * 5
    np.testing.assert_allclose(result.x, expected.x, rtol=0, atol=1e-12 * np.abs(expected.x).max())
    assert not result.converged.any()


@needs_compiler
@pytest.mark.parametrize("scale", ["known", "estimated", "separate"])
def test_what_is_not_plain_climbs_in_python(scale):
    density = Density(Problem.from_plan(plan_of(header(noise={"scale": scale}), good_plan(12).postures)))
    made = compiled_climb(density, flange_coordinates(density), compile=True)
    assert (made is not None) == (scale == "known")
    held = np.zeros((1, density.size), dtype=bool)
    assert Climb(density, None, 1, held)._compiled is None


def test_without_compiled_kernels_it_climbs_in_python():
    density = Density(fit_problems()["laser"])
    assert compiled_climb(density, flange_coordinates(density), compile=False) is None


@needs_compiler
@pytest.mark.parametrize("case", [case for case in PLAIN if case != "prismatic, open probe"])
@pytest.mark.parametrize("steps", [200, 1])
@pytest.mark.one_in(3)
def test_the_same_top(case, steps):
    """Newton's steps from the mode, and after a climb of one step: there some rows end in Python."""
    one, two, x = climbs(fit_problems()[case], 4, rows=20)
    v = one.coordinates.from_parameters(x, one.of)
    v[1] = np.nan
    result = two.up(v, steps)
    *_, whole = one._compiled.polish(result, one.of, 60, 1e-7, 1e-3, 1e-3, 3e-3)
    assert whole.sum() == 19 if steps == 200 else 0 < whole.sum() < 20
    top, expected = one.polished(result), two.polished(result)
    assert top.reason[1] == expected.reason[1] == NOT_FINITE
    assert np.isnan(top.covariance[1]).all()
    sound = np.flatnonzero(expected.converged)
    assert len(sound) == 19
    np.testing.assert_array_equal(top.converged, expected.converged)
    if steps == 200:
        np.testing.assert_array_equal(top.iterations, expected.iterations)
    std = np.sqrt(np.diagonal(expected.covariance[sound], axis1=1, axis2=2))
    np.testing.assert_allclose((top.v - expected.v)[sound] / std, 0, atol=1e-6)
    np.testing.assert_allclose(top.value[sound], expected.value[sound], rtol=1e-9)
    scale = std[:, :, None] * std[:, None, :]
    np.testing.assert_allclose((top.covariance - expected.covariance)[sound] / scale, 0, atol=1e-6)
    assert (top.gradient[sound] < 1e-4).all()
