"""Centres of spheres from points and lengths: of exact lengths, whatever the place. Parts of planes."""

import numpy as np
import pytest

from zerobeam.model.instruments import tips
from zerobeam.model.instruments.kind import Target
from zerobeam.model.instruments.tips import patch, plane_normal, points_on, sphere_through

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


def test_the_outline_of_a_plane_has_room_about_the_feet_of_what_touched_it():
    """On z = 50, the points lifted off it: x from 0 to 10, y from 0 to 30, and 40 mm on each side."""
    touched = np.array([[0.0, 30, 70], [10, 0, 50], [4, 20, 20]])
    outline = patch(np.array([50.0, 0, 0]), np.array([0.0, 0, 1]), touched)
    np.testing.assert_allclose(outline[0], outline[-1])
    assert {tuple(np.round(corner, 9)) for corner in outline} == {
        (x, y, 50.0) for x in (-40.0, 50.0) for y in (-40.0, 70.0)
    }


def test_points_of_a_face_lie_on_it_within_its_radius_of_the_guess():
    """Its normal is turned by 10° and 5° from the stated one, its distance is 300 mm."""

    class Face:
        normal, guess_mm, radius_mm = (0.0, 0.0, 1.0), (100.0, 50.0, 280.0), 25.0

    numbers = np.array([300.0, np.radians(10), np.radians(5)])
    target = Target(numbers, Face())
    normal = plane_normal(target)
    assert np.linalg.norm(normal) == pytest.approx(1)
    tangents = np.sort(np.abs(normal[:2] / normal[2]))
    np.testing.assert_allclose(tangents, np.tan(np.radians([5, 10])), rtol=1e-12)
    points = points_on(target, np.random.default_rng(4), 500)
    np.testing.assert_allclose(points @ normal, 300, atol=1e-9)
    foot = np.array(Face.guess_mm) + (300 - normal @ Face.guess_mm) * normal
    lengths = np.linalg.norm(points - foot, axis=1)
    assert 24 < lengths.max() <= 25
