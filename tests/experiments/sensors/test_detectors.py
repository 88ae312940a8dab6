"""tests/experiments/sensors/test_detectors.py."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from zerobeam.experiments.sensors.detectors import GAIN, Camera, Psd, PsdKind

DUO = Psd(20.0, "duo-lateral", 200.0, 5e-4, 2.0, np.array([[-35.0, 0, 0], [35, 0, 0]]), None, 0.0)
TETRA = dataclasses.replace(DUO, kind="tetra-lateral")


def directions(count: int) -> np.ndarray:
    drawn = np.random.default_rng(1).normal(size=(count, 3))
    return drawn / np.linalg.norm(drawn, axis=1)[:, None]


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_the_frame_is_right_handed_and_faces_the_beam(turn: float) -> None:
    psd = dataclasses.replace(DUO, turn=turn)
    for direction in directions(50):
        frame = psd.frame(direction)
        np.testing.assert_allclose(frame.T @ frame, np.eye(3), atol=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        np.testing.assert_allclose(frame[:, 2], -direction, atol=1e-12)


def test_a_fixed_psd_keeps_its_frame_under_every_beam() -> None:
    normal = np.array([0.0, 0.6, 0.8])
    psd = dataclasses.replace(DUO, normal=normal)
    frames = np.array([psd.frame(direction) for direction in directions(5)])
    assert (frames == frames[0]).all()
    np.testing.assert_allclose(frames[0], np.array([[1, 0, 0], [0, 0.8, -0.6], [0, 0.6, 0.8]]).T, atol=1e-12)


def test_the_default_x_axis() -> None:
    """The base's x axis as far as it lies across z; its y axis where z is within 20 degrees of x."""
    for degrees, side in ((90.0, 0), (21.0, 0), (19.0, 1), (0.0, 1), (161.0, 1), (159.0, 0)):
        z = np.array([np.cos(np.radians(degrees)), 0.0, np.sin(np.radians(degrees))])
        x = DUO.frame(-z)[:, 0]
        assert x[side] > 0.3
        # Nothing of it along the third direction, across both z and the side that was chosen.
        assert abs(x @ np.cross(z, np.eye(3)[side])) < 1e-12


def test_a_turn_carries_x_towards_y() -> None:
    direction = directions(1)[0]
    plain, turned = DUO.frame(direction), dataclasses.replace(DUO, turn=np.radians(30)).frame(direction)
    np.testing.assert_allclose(
        turned[:, 0], np.cos(np.radians(30)) * plain[:, 0] + 0.5 * plain[:, 1], atol=1e-12
    )


def test_a_worked_example_of_each_kind() -> None:
    """Duo-lateral: all of the light in each pair. Tetra-lateral: shared by the four."""
    currents = np.array([0.6, 0.4, 0.45, 0.55])
    assert DUO.light(currents) == pytest.approx(1.0)
    np.testing.assert_allclose(DUO.position(currents), [2.0, -1.0])
    assert TETRA.light(currents / 2) == pytest.approx(1.0)
    np.testing.assert_allclose(TETRA.position(currents / 2), np.array([2.0, -1.0]) * GAIN["tetra-lateral"])


@pytest.mark.parametrize("kind", ["duo-lateral", "tetra-lateral"])
def test_the_position_does_not_depend_on_the_light(kind: PsdKind) -> None:
    psd = dataclasses.replace(DUO, kind=kind)
    currents = np.random.default_rng(2).uniform(0.1, 1.0, (7, 3, 4))
    assert psd.light(currents).shape == (7, 3)
    np.testing.assert_allclose(psd.position(0.3 * currents), psd.position(currents), atol=1e-12)
    np.testing.assert_allclose(psd.light(0.3 * currents), 0.3 * psd.light(currents))


def test_without_light_there_is_no_position() -> None:
    """Dark, dark with an offset below 0, one pair dark, and a sample that did not arrive."""
    currents = np.array(
        [[0.0, 0, 0, 0], [-1e-5, -1e-5, 1e-6, -2e-6], [0, 0, 0.3, 0.2], [np.nan] * 4, [0.3, 0.2, 0.2, 0.3]]
    )
    known = np.isfinite(DUO.position(currents))
    assert known.tolist() == [[False] * 2, [False] * 2, [False, True], [False] * 2, [True] * 2]


def test_a_saturated_sample() -> None:
    currents = np.array(
        [[1.9, 0.1, 1, 1], [2.0, 0.1, 1, 1], [1, 1, 0.1, 2.0 * (1 - 1e-12)], [np.nan] * 4, [1, 1, 1, 1.999]]
    )
    assert DUO.saturated(currents).tolist() == [False, True, True, False, False]


def test_the_gain_of_a_tetra_lateral_psd() -> None:
    """By the series of its derivative at the centre: the two currents sum to a half there."""
    m = np.arange(12)
    slope = 2 * ((-1.0) ** m / np.sinh((2 * m + 1) * np.pi / 2)).sum()
    assert GAIN["tetra-lateral"] == pytest.approx(0.5 / slope, rel=1e-14)


BARREL = (-0.35, 0.15, -1e-3, 2e-3, -0.03)
PINCUSHION = (0.4, 0.2, 2e-3, -1e-3, 0.05)
PLAIN = (0.0, 0.0, 0.0, 0.0, 0.0)


def camera(distortion: tuple[float, float, float, float, float] = PLAIN, **other: Any) -> Camera:
    """Some 65 degrees wide, so that the distortions above are strong: tens of pixels at the corners."""
    known: dict[str, Any] = {
        "width": 640,
        "height": 480,
        "focal": (500.0, 510.0),
        "centre": (322.0, 238.0),
        "mount": np.eye(4),
    }
    return Camera(**{**known, **other}, distortion=distortion)


def all_over(view: Camera) -> np.ndarray:
    """Pixels over the whole picture, its outermost edges with it."""
    x, y = np.meshgrid(np.linspace(-0.5, view.width - 0.5, 41), np.linspace(-0.5, view.height - 0.5, 31))
    return np.column_stack([x.ravel(), y.ravel()])


def points_in_front(count: int = 50, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(300, 1500, count)
    return np.column_stack([rng.uniform(-0.6, 0.6, (count, 2)) * depth[:, None], depth])


def plain_pixel(view: Camera, point: np.ndarray) -> tuple[float, float]:
    """The formulas of OpenCV's documentation, a point at a time."""
    k1, k2, p1, p2, k3 = view.distortion
    x, y = point[0] / point[2], point[1] / point[2]
    r = np.sqrt(x**2 + y**2)
    factor = 1 + k1 * r**2 + k2 * r**4 + k3 * r**6
    return (
        view.focal[0] * (x * factor + 2 * p1 * x * y + p2 * (r**2 + 2 * x**2)) + view.centre[0],
        view.focal[1] * (y * factor + p1 * (r**2 + 2 * y**2) + 2 * p2 * x * y) + view.centre[1],
    )


@pytest.mark.parametrize("distortion", [PLAIN, BARREL, PINCUSHION])
def test_projection_is_the_plain_formula(distortion):
    view, points = camera(distortion), points_in_front()
    plain = np.array([plain_pixel(view, point) for point in points])
    np.testing.assert_allclose(view.project(points), plain, rtol=0, atol=1e-10)


def test_known_pixels():
    view = camera()
    points = np.array([[0.0, 0, 700], [100, 0, 1000], [0, 100, 1000], [-200, -100, 500]])
    expected = [[322, 238], [372, 238], [322, 289], [122, 136]]
    np.testing.assert_allclose(view.project(points), expected, atol=1e-12)
    # One factor at a time at x = y = 0.5, r² = 0.5.
    aside = np.array([[500.0, 500, 1000]])
    for factors, x, y in (
        ((0.1, 0, 0, 0, 0), 0.5 * 1.05, 0.5 * 1.05),
        ((0, 0.1, 0, 0, 0), 0.5 * 1.025, 0.5 * 1.025),
        ((0, 0, 0.1, 0, 0), 0.5 + 0.05, 0.5 + 0.1),
        ((0, 0, 0, 0.1, 0), 0.5 + 0.1, 0.5 + 0.05),
        ((0, 0, 0, 0, 0.1), 0.5 * 1.0125, 0.5 * 1.0125),
    ):
        np.testing.assert_allclose(camera(factors).project(aside), [[500 * x + 322, 510 * y + 238]])


def test_points_are_seen_from_where_the_camera_is_mounted():
    """A camera 100 mm along the flange's x that looks along it, its right along the flange's y."""
    mount = np.array([[0.0, 0, 1, 100], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    seen = camera(mount=mount).from_flange(np.array([[600.0, 20, 30], [100, 0, 0]]))
    np.testing.assert_array_equal(seen, [[20, 30, 500], [0, 0, 0]])


def test_a_point_not_in_front_has_no_image():
    view = camera(BARREL)
    points = np.array([[0.0, 0, 0], [10, 10, 0], [10, 10, -500], [10, 10, 500]])
    assert np.isnan(view.project(points)).all(axis=1).tolist() == [True, True, True, False]
    assert np.isnan(view.project_jacobian(points)).all(axis=(1, 2)).tolist() == [True, True, True, False]


def test_a_point_beyond_the_distortion_is_not_put_into_the_picture():
    """With k1 = -0.3 the distorted radius turns back at r² = 1/0.9, and is 0 again at r² = 1/0.3."""
    view = camera((-0.3, 0.0, 0.0, 0.0, 0.0))
    slope = np.sqrt([0.99 / 0.9, 1.01 / 0.9, 1 / 0.3])
    points = np.column_stack([slope, np.zeros(3), np.ones(3)])
    assert np.isnan(view.project(points)).any(axis=1).tolist() == [False, True, True]
    np.testing.assert_allclose(plain_pixel(view, points[2]), view.centre, atol=1e-9)


@pytest.mark.parametrize("distortion", [PLAIN, BARREL, PINCUSHION])
def test_jacobian_is_the_derivative(distortion):
    view, points, step = camera(distortion), points_in_front(), 0.01
    differences = np.empty((len(points), 2, 3))
    for axis, along in enumerate(np.eye(3) * step):
        differences[:, :, axis] = (view.project(points + along) - view.project(points - along)) / (2 * step)
    # Differences: rounding 1e-13 × 500 px / 0.01 mm, and (0.01 mm / 300 mm)² of the derivative.
    np.testing.assert_allclose(view.project_jacobian(points), differences, rtol=1e-7, atol=1e-8)


def test_jacobian_without_one_factor_is_another():
    """Control: each factor counts in the derivative far above the tolerance of the test above."""
    points = points_in_front()
    whole = camera(BARREL).project_jacobian(points)
    for factor in range(5):
        without = tuple(0.0 if i == factor else value for i, value in enumerate(BARREL))
        assert np.abs(camera(without).project_jacobian(points) - whole).max() > 1e-4


@pytest.mark.parametrize("distortion", [PLAIN, BARREL, PINCUSHION])
def test_rays_lead_to_their_pixels(distortion):
    view = camera(distortion)
    pixels = all_over(view)
    rays = view.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1)
    assert (rays[:, 2] > 0).all()
    np.testing.assert_allclose(view.project(rays * 800), pixels, rtol=0, atol=1e-9)
    points = points_in_front()
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(view.rays(view.project(points)), directions, rtol=0, atol=1e-11)
    # Strong means strong: without the distortion the same rays are tens of pixels off.
    if distortion != PLAIN:
        assert np.abs(camera().project(rays) - pixels).max() > 30


def test_a_pixel_that_nothing_projects_to_has_no_ray():
    """With k1 = -0.3 nothing is seen farther than r = (2/3) / √0.9 from the centre."""
    view = camera((-0.3, 0.0, 0.0, 0.0, 0.0))
    edge = 2 / 3 / np.sqrt(0.9)
    out = np.array([0.5, 0.9, 0.999, 1.001, 1.1, 3.0]) * edge
    for direction in ([1.0, 0.0], [0.6, 0.8], [-0.6, 0.8]):
        rays = view.rays(out[:, None] * direction * view.focal + view.centre)
        assert np.isnan(rays).any(axis=1).tolist() == [False, False, False, True, True, True]
        np.testing.assert_allclose(
            view.project(rays[:3]), out[:3, None] * direction * view.focal + view.centre, rtol=0, atol=1e-9
        )
    assert np.isnan(view.rays(np.array([[np.nan, 0.0]]))).all()


def test_no_points_at_all():
    view = camera(BARREL)
    assert view.project(np.empty((0, 3))).shape == (0, 2)
    assert view.project_jacobian(np.empty((0, 3))).shape == (0, 2, 3)
    assert view.rays(np.empty((0, 2))).shape == (0, 3)
