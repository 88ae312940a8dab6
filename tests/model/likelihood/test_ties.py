"""Stated distances and angles between targets: their residuals, slopes and part in the density."""

from dataclasses import replace

import numpy as np
import pytest
from cells import irb1600
from measured_arms import CELLS, recorded
from plain_model import by_complex_steps

from zerobeam.model.instruments.frames import basis_across
from zerobeam.model.instruments.tips import normals_at
from zerobeam.model.likelihood.density import Density
from zerobeam.model.likelihood.parameters import Angle
from zerobeam.model.likelihood.problem import Problem

TOP, SIDE = (0.0, 0.6, 0.8), (1.0, 0.0, 0.0)
ANGLE = Angle(0, 1, np.radians(100.0), np.radians(0.01), (TOP, SIDE))


def plain_normal(plane, stated):
    b1, b2 = basis_across(np.array(stated))
    along = np.array(stated) + np.tan(plane[..., 1:2]) * b1 + np.tan(plane[..., 2:3]) * b2
    return along / np.sqrt((along**2).sum(axis=-1))[..., None]


def plain_miss(planes):
    """(...,) of d and tilts (..., 6) of both planes, by the arc cosine: complex if they are."""
    cosine = (plain_normal(planes[..., :3], TOP) * plain_normal(planes[..., 3:], SIDE)).sum(axis=-1)
    return (np.arccos(cosine) - ANGLE.rad) / ANGLE.sigma


@pytest.fixture
def planes():
    """(W, 6)"""
    return np.random.default_rng(2).normal(size=(4, 6)) * [100, 0.2, 0.2, 100, 0.2, 0.2]


def test_an_angle_and_its_slopes_are_exact(planes):
    residual, by_first, by_second = ANGLE.missed(planes[:, :3], planes[:, 3:])
    np.testing.assert_allclose(residual, plain_miss(planes), rtol=1e-11)
    for row, slopes in zip(planes, np.hstack([by_first, by_second]), strict=True):
        by_plane = by_complex_steps(lambda x: plain_miss(x)[..., None], row)[0]
        np.testing.assert_allclose(slopes, by_plane, rtol=0, atol=1e-9 / ANGLE.sigma)
    assert np.abs(np.hstack([by_first, by_second])[:, [1, 2, 4, 5]]).max() > 0.1 / ANGLE.sigma


def test_normals_in_numbers_are_those_of_the_model(planes):
    """Negative control: the derivative of another plane is another."""
    normals, slopes = normals_at(planes[:, :3], np.array(TOP))
    np.testing.assert_allclose(normals, plain_normal(planes[:, :3], TOP), rtol=1e-14)
    by_plane = [by_complex_steps(lambda x: plain_normal(x, TOP), row) for row in planes[:, :3]]
    np.testing.assert_allclose(slopes, by_plane, atol=1e-12)
    assert np.abs(slopes[0] - by_plane[1]).max() > 1e-3


def test_parallel_planes_have_no_direction_but_no_nan_either():
    same = Angle(0, 1, np.radians(1.0), 0.01, (TOP, TOP))
    every = same.missed(np.zeros((1, 3)), np.zeros((1, 3)))
    assert all(np.isfinite(part).all() for part in every)
    assert every.residual[0] == pytest.approx(-np.radians(1.0) / 0.01)


@pytest.fixture(scope="module")
def cube():
    cell = CELLS["cube"]
    arm = recorded(cell, 18, np.random.default_rng(4), exact=True, joint_deg=0.002)
    header = cell.header(geometry="exact", joint_deg=0.002)
    return Problem.of_measured(header, irb1600(), arm.joints, arm.measured)


def test_angles_are_rows_and_terms_of_the_density(cube):
    """Whitened rows against differences, and value and gradient against the same cube without its angles."""
    rng = np.random.default_rng(5)
    x = cube.nominal() + rng.normal(size=len(cube.parameters)) * np.radians(0.5) * cube.parameters.free
    free = cube.parameters.free
    rows, by_x = cube.tie_rows(x[None])
    assert rows.shape == (1, 3)
    for i in np.flatnonzero(free):
        step = np.zeros(len(x))
        step[i] = 1e-6
        (up, _), (down, _) = cube.tie_rows((x + step)[None]), cube.tie_rows((x - step)[None])
        np.testing.assert_allclose(by_x[0][:, i], (up - down)[0] / 2e-6, rtol=1e-6, atol=0.1)
    whitened = cube.whiten(x)
    np.testing.assert_array_equal(whitened.residual[-3:], rows[0])
    np.testing.assert_allclose(whitened.jacobian[-3:], by_x[0] * cube.parameters.prior_std, rtol=1e-12)

    loose = cube.without_targets([])
    assert loose.ties == cube.ties
    plain = cube.without_targets(["front"])
    assert [(tie.first, tie.second) for tie in plain.angles] == [(0, 1)]

    tied, alone = (Density(problem).slopes(x[None]) for problem in (cube, replace(cube, ties=())))
    np.testing.assert_allclose(tied.value - alone.value, -(rows**2).sum() / 2, rtol=1e-9)
    scaled = by_x[0][:, free] * cube.parameters.prior_std[free]
    np.testing.assert_allclose((tied.gradient - alone.gradient)[0], -rows[0] @ scaled, rtol=1e-8, atol=1e-3)
    np.testing.assert_allclose(
        (tied.information - alone.information)[0], scaled.T @ scaled, rtol=1e-6, atol=10
    )
