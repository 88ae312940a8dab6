"""Centres of spheres from points and lengths: of exact lengths, whatever the place."""

import numpy as np
import pytest

from zerobeam.model.instruments import tips
from zerobeam.model.instruments.tips import sphere_through

CENTRE = np.array([812.0, -140.0, 365.0])


def on_sphere(rng, count, radius, half_angle):
    """Points (count, 3) within a cap about -x."""
    z = rng.uniform(np.cos(half_angle), 1.0, count)
    around = rng.uniform(0, 2 * np.pi, count)
    across = np.sqrt(1 - z**2)
    directions = np.stack([-z, across * np.cos(around), across * np.sin(around)], axis=1)
    return CENTRE + radius * directions


@pytest.mark.parametrize("zero_free", [False, True])
@pytest.mark.parametrize(("radius", "half_angle"), [(20.0, 2.0), (300.0, 1.5), (1500.0, 0.6)])
def test_the_centre_of_exact_lengths(radius, half_angle, zero_free):
    points = on_sphere(np.random.default_rng(1), 12, radius, half_angle)
    lengths = np.linalg.norm(points - CENTRE, axis=1) + (1.5 if zero_free else 0.0)
    np.testing.assert_allclose(sphere_through(points, lengths, zero_free=zero_free), CENTRE, atol=1e-6)


def test_lengths_that_differ_are_met_each():
    rng = np.random.default_rng(2)
    points = CENTRE + rng.normal(scale=200.0, size=(9, 3))
    lengths = np.linalg.norm(points - CENTRE, axis=1)
    np.testing.assert_allclose(sphere_through(points, lengths, zero_free=False), CENTRE, atol=1e-6)


@pytest.mark.parametrize("zero_free", [False, True])
def test_the_linear_centre_needs_no_search(zero_free, monkeypatch):
    """|p - c|² = l² is linear in c and |c|²: of exact lengths the start is the centre itself."""
    monkeypatch.setattr(tips, "_climbed", lambda points, lengths, start, *, zero_free: (0.0, start))
    points = CENTRE + np.random.default_rng(3).normal(scale=200.0, size=(9, 3))
    lengths = np.linalg.norm(points - CENTRE, axis=1) + (1.5 if zero_free else 0.0)
    np.testing.assert_allclose(sphere_through(points, lengths, zero_free=zero_free), CENTRE, atol=1e-6)
