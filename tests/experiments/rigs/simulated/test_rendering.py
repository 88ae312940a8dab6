"""Pictures of the simulated camera: where the light falls, how much of it, and the noise."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from zerobeam.experiments.rigs.simulated.sensing import ELECTRONS, SLOPE, PictureScene, render
from zerobeam.experiments.sensors.camera import Camera

DARK: dict[str, Any] = {"exposure": 1.0, "ambient": 0.0, "noise": 0.0, "psf": 1.2}


def camera(width: int = 96, height: int = 64) -> Camera:
    middle = ((width - 1) / 2, (height - 1) / 2)
    return Camera(width, height, (800.0, 800.0), middle, (0.0,) * 5, np.eye(4))


def scene(*points: tuple[float, float, float], brightness: float = 2000.0, size: float = 0.0) -> PictureScene:
    count = len(points)
    return PictureScene(np.array(points).reshape(-1, 3), np.full(count, brightness), np.full(count, size))


def picture(lights: PictureScene, seed: int = 0, view: Camera | None = None, **other: Any) -> np.ndarray:
    return render(view or camera(), lights, rng=np.random.default_rng(seed), **{**DARK, **other})


def mean_picture(lights: PictureScene, count: int = 100, first: int = 0, **other: Any) -> np.ndarray:
    return np.mean([picture(lights, seed, **other) for seed in range(first, first + count)], axis=0)


def test_light_falls_where_the_point_projects_to_and_as_wide_as_stated():
    """A mean of 100 pictures over a background, which keeps the noise whole on both sides."""
    view, lights = camera(), scene((7.3, -4.1, 900.0), size=1.5)
    background = mean_picture(scene(), first=100, ambient=20.0, noise=1.0)
    image = mean_picture(lights, ambient=20.0, noise=1.0) - background
    rows, columns = np.mgrid[: view.height, : view.width]
    total = image.sum()
    expected = 2000 / (0.9**2 + (7.3**2 + 4.1**2) / 1e6)
    # Each mean has per pixel (1 + 20/40 + 1/12) / 100, the light (total / 40) / 100 on top.
    each = 2 * (1.0 + 20 * (1 + SLOPE) / ELECTRONS + 1 / 12) / 100
    assert abs(total - expected) < 4 * np.sqrt(each * image.size + total / ELECTRONS / 100)
    x, y = view.project(lights.points)[0]
    near = np.hypot(rows - y, columns - x) < 10
    weight = np.where(near, image, 0.0)
    sigma = np.hypot(800 * 1.5 / 900, 1.2)
    # Of a sum over π 10² pixels, x² is 10²/4 on average and (x² - sigma²)² some 10⁴/8.
    lever = np.sqrt(each * np.pi * 100 * 25) / expected
    assert abs((weight * columns).sum() / weight.sum() - x) < 4 * lever + 1e-3
    assert abs((weight * rows).sum() / weight.sum() - y) < 4 * lever + 1e-3
    spread = (weight * ((columns - x) ** 2 + (rows - y) ** 2)).sum() / weight.sum() / 2
    assert abs(spread - sigma**2 - 1 / 12) < 4 * np.sqrt(each * np.pi * 100 * 1250) / expected


def test_light_falls_with_the_square_of_the_distance_and_grows_with_exposure():
    peak = {}
    for distance, exposure in ((1000.0, 1.0), (2000.0, 1.0), (2000.0, 4.0)):
        image = mean_picture(scene((0.0, 0.0, distance)), 50, exposure=exposure, ambient=10.0)
        peak[distance, exposure] = image[28:36, 44:52].sum() - 64 * 10
    # 64 pixels of background and 2,000 (or 500) grey values of light, 50 pictures: 1.1 of noise.
    assert peak[1000, 1] / peak[2000, 1] == pytest.approx(4, rel=0.02)
    assert peak[1000, 1] == pytest.approx(peak[2000, 4], rel=0.01)


def test_noise_is_as_stated():
    """Variance of a pixel: read noise, shot noise and rounding, at two levels."""
    for ambient, noise in ((20.0, 2.0), (120.0, 1.0)):
        one, other = (picture(scene(), seed, ambient=ambient, noise=noise).astype(float) for seed in (1, 2))
        squares = ((one - other) ** 2).sum() / 2
        low, high = stats.chi2.ppf([0.0005, 0.9995], one.size)
        expected = noise**2 + ambient / ELECTRONS + 1 / 12
        assert low < squares / expected < high
        assert not low < squares / (noise**2 + 1 / 12) < high  # control: shot noise left out


def test_the_background_slopes_gently():
    image = mean_picture(scene(), 50, ambient=100.0)
    corners = [image[:4, :4].mean(), image[-4:, -4:].mean(), image[30:34, 46:50].mean()]
    assert corners == pytest.approx([100 * (1 - SLOPE), 100 * (1 + SLOPE), 100], abs=1.5)


def test_lights_behind_or_beside_are_not_drawn():
    nothing = picture(scene(), ambient=10.0, noise=1.0)
    aside = scene((0.0, 0.0, -1000.0), (500.0, 0.0, 1000.0), (0.0, -500.0, 1000.0), (0.0, 0.0, 0.0))
    np.testing.assert_array_equal(picture(aside, ambient=10.0, noise=1.0), nothing)
    assert (picture(scene((0.0, 0.0, 1000.0)), ambient=10.0, noise=1.0) != nothing).any()


@pytest.mark.parametrize("out", [-0.5, 0.8, 3.0])
def test_a_light_at_the_edge_is_cut_off(out):
    """What is in the picture is what a larger picture has there, wherever the centre is."""
    view = camera()
    wide = Camera(128, 64, view.focal, (view.centre[0] + 32, view.centre[1]), view.distortion, np.eye(4))
    x = (-out - view.centre[0]) / 800 * 1000
    lights = scene((x, 0.0, 1000.0), (0.0, 0.0, 1000.0))
    cut = mean_picture(lights, 40, ambient=10.0)
    whole = mean_picture(lights, 40, view=wide, ambient=10.0)[:, 32:]
    light = np.clip(cut - 10, 0, None)
    # The slope of the background differs between the two by a few tenths of a grey value.
    assert np.abs(cut - whole).max() < 1.0 + 5 * np.sqrt(2 * (light.max() + 10) / ELECTRONS / 40)
    assert light[:, 0].sum() > 20  # it is not left out


def test_a_bright_light_saturates():
    image = picture(scene((0.0, 0.0, 1000.0), brightness=1e4), ambient=10.0)
    assert image.dtype == np.uint8
    assert (image == 255).sum() > 9
    assert image[:, 0].max() < 30


def test_the_same_seed_makes_the_same_picture():
    lights = scene((1.0, 2.0, 900.0))
    one, same, other = (picture(lights, seed, ambient=10.0, noise=2.0) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert (one != other).mean() > 0.5
