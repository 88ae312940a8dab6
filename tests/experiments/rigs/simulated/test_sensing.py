"""The simulated sensors: currents of a PSD, pictures of the camera, and their noise."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy import stats

from zerobeam.experiments.rigs.simulated.sensing import (
    ELECTRONS,
    SLOPE,
    PictureScene,
    SimulatedPsd,
    caught,
    harmonic_measures,
    render,
)
from zerobeam.experiments.sensors.camera import Camera
from zerobeam.experiments.sensors.psd import Psd, PsdKind

SIZE = 20.0
KINDS: tuple[PsdKind, ...] = ("duo-lateral", "tetra-lateral")
QUIET = 1e-15  # mm of noise: none


def device(
    kind: PsdKind = "duo-lateral",
    *,
    noise: float = QUIET,
    saturation: float = 10.0,
    beam: float = 0.8,
    nonlinearity: float = 0.0,
    ambient: float = 0.0,
    resolution: float = 0.0,
) -> SimulatedPsd:
    psd = Psd(SIZE, kind, 200.0, noise, saturation, np.zeros((2, 3)), None, 0.0)
    return SimulatedPsd(psd, beam, nonlinearity, ambient, resolution)


def currents(
    own: SimulatedPsd, *hit: float, share: float = 1.0, samples: int = 1, seed: int = 0
) -> np.ndarray:
    return own.currents(np.array(hit) if hit else None, share, samples, np.random.default_rng(seed))


def reading(own: SimulatedPsd, *hit: float, share: float = 1.0) -> np.ndarray:
    return own.psd.position(currents(own, *hit, share=share))[0]


def hits(count: int) -> np.ndarray:
    """Where all of the beam is on the face: 7.5 of its stds from an edge or more."""
    return np.random.default_rng(3).uniform(-7, 7, (count, 2))


def test_a_truncated_beam_against_numerical_integration() -> None:
    """Within the face, across an edge, across a corner, beside it: 400 x 400 Gauss-Legendre nodes."""
    size, beam = 10.0, 4.0
    nodes, weights = leggauss(400)
    x, y = np.meshgrid(nodes * size / 2, nodes * size / 2, indexing="ij")
    for hit in ([0.3, -0.2], [4.5, 1.0], [-5.5, 4.9], [-9.0, 0.0], [0.0, 12.0]):
        density = 2 / (np.pi * beam**2) * np.exp(-2 * ((x - hit[0]) ** 2 + (y - hit[1]) ** 2) / beam**2)
        light = np.outer(weights, weights) * (size / 2) ** 2 * density
        share, spot = caught(np.array(hit), beam, size)
        assert share == pytest.approx(light.sum(), rel=1e-9)
        np.testing.assert_allclose(spot, [(light * x).sum(), (light * y).sum()] / light.sum(), atol=1e-9)


def test_a_beam_far_off_leaves_no_light() -> None:
    for far in (30.0, 300.0, 3e6):
        share, spot = caught(np.array([far, -far]), 1.0, SIZE)
        assert 0 <= share < 1e-300
        assert (np.abs(spot) <= SIZE / 2).all()
        assert spot[0] > 0.99 * SIZE / 2 > 0 > spot[1]


def test_a_beam_across_an_edge_is_weak_and_read_at_its_centroid() -> None:
    own = device(beam=2.0)
    row = currents(own, SIZE / 2, 0.0)
    assert own.psd.light(row)[0] == pytest.approx(0.5)
    # Half a normal of std beam / 2 = 1 mm: its mean is sqrt(2 / pi) from the edge.
    np.testing.assert_allclose(own.psd.position(row)[0], [SIZE / 2 - np.sqrt(2 / np.pi), 0.0], atol=1e-9)


def series(x: float, y: float) -> float:
    """Harmonic measure of the edge x = 1: cos(a y) sinh(a (x + 1)) / sinh(2 a), a = k pi / 2, k odd."""
    k = np.arange(1, 2001, 2)
    a = k * np.pi / 2
    rise = np.exp(a * (x - 1)) * (1 - np.exp(-2 * a * (x + 1))) / (1 - np.exp(-4 * a))
    return float((4 / (k * np.pi) * (-1.0) ** (k // 2) * np.cos(a * y) * rise).sum())


def test_harmonic_measures_against_the_fourier_series() -> None:
    """Up to 0.02 half sizes from an edge: the series' 1001st term is below exp(-2000 pi 0.01) = 1e-27."""
    for x, y in np.random.default_rng(4).uniform(-0.98, 0.98, (300, 2)):
        np.testing.assert_allclose(
            harmonic_measures(np.array([x, y])),
            [series(x, y), series(-x, y), series(y, x), series(-y, x)],
            atol=1e-11,
        )


def test_harmonic_measures_that_are_known() -> None:
    np.testing.assert_allclose(harmonic_measures(np.zeros(2)), 0.25, atol=1e-15)
    # On a diagonal the two edges at its end are alike, and so are the other two.
    for u in (-0.7, 0.2, 0.9):
        right, left, top, bottom = harmonic_measures(np.array([u, u]))
        assert right == pytest.approx(top, abs=1e-12)
        assert left == pytest.approx(bottom, abs=1e-12)
    # On an edge all of the current is that edge's.
    for i, end in enumerate(([1, 0], [-1, 0.3], [0, 1], [-0.6, 1], [0.3, -1])):
        edge = (0, 1, 2, 2, 3)[i]
        np.testing.assert_allclose(harmonic_measures(np.array(end, float)), np.eye(4)[edge], atol=1e-12)


def test_a_duo_lateral_psd_is_linear() -> None:
    own = device()
    for hit in hits(50):
        np.testing.assert_allclose(reading(own, *hit), hit, atol=1e-12)
        assert own.psd.light(currents(own, *hit, share=0.4))[0] == pytest.approx(0.4)


@pytest.mark.parametrize("kind", KINDS)
def test_nonlinearity_grows_with_the_cube(kind: PsdKind) -> None:
    bent, straight = device(kind, nonlinearity=0.02), device(kind)
    for hit in hits(20):
        u = hit / (SIZE / 2)
        np.testing.assert_allclose(
            reading(bent, *hit), reading(straight, *(u - 0.02 * u**3) * SIZE / 2), atol=1e-12
        )
    duo = device(nonlinearity=0.02)
    assert reading(duo, 0.75 * SIZE / 2, 0.0)[0] == pytest.approx((0.75 - 0.02 * 0.75**3) * SIZE / 2)


def test_a_tetra_lateral_psd_is_right_near_its_centre_alone() -> None:
    """The relative error is of second order: twice as far off, four times as large. Far out it is gross."""
    own = device("tetra-lateral")
    errors = [reading(own, u * SIZE / 2, 0.0)[0] / (u * SIZE / 2) - 1 for u in (0.005, 0.01, 0.02)]
    np.testing.assert_allclose(np.divide(errors[1:], errors[:-1]), 4.0, rtol=1e-3)
    assert abs(errors[0]) < 1e-4
    assert reading(own, 0.7 * SIZE / 2, 0.0)[0] < 0.9 * 0.7 * SIZE / 2
    # The rule of the other kind is wrong at the centre already.
    duo = device()
    assert duo.psd.position(currents(own, 0.1, 0.0))[0, 0] > 1.5 * 0.1


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("share", [1.0, 0.2])
def test_noise_is_as_stated_and_grows_as_light_falls(kind: PsdKind, share: float) -> None:
    own = device(kind, noise=2e-3)
    positions = own.psd.position(currents(own, 0.0, 0.0, share=share, samples=20_000))
    low, high = np.sqrt(stats.chi2.ppf([0.0005, 0.9995], 20_000) / 20_000)
    for std in positions.std(axis=0, mean=np.zeros((1, 2))) * share / 2e-3:
        assert low < std < high
    assert np.abs(positions.mean(axis=0)).max() < 4 * 2e-3 / share / np.sqrt(20_000)
    # The two directions and successive samples have nothing to do with each other: 4 / sqrt(20,000).
    assert abs(np.corrcoef(positions.T)[0, 1]) < 4 / np.sqrt(20_000)
    assert abs(np.corrcoef(positions[1:, 0], positions[:-1, 0])[0, 1]) < 4 / np.sqrt(19_999)


@pytest.mark.parametrize("kind", KINDS)
def test_the_reading_goes_in_steps(kind: PsdKind) -> None:
    """Of the stated size at most, and never off by more than half of it (but for the pair's rounded sum)."""
    step = 0.001
    coarse, fine = device(kind, resolution=step), device(kind)
    x = np.linspace(-0.005, 0.005, 201)
    read = np.array([reading(coarse, at, 0.0)[0] for at in x])
    # The sum of a pair is right to two steps of a current, in a reading of 5 steps.
    slack = 5 * step * 2 * (step / 2 / coarse.psd.reach) / 0.5
    assert np.abs(read - x).max() < step / 2 + slack
    assert np.abs(read - x).max() > step / 5
    halves = read / (step / 2)
    assert np.abs(halves - np.round(halves)).max() < slack / (step / 2)
    steps = np.diff(read)
    assert (steps > -slack).all()
    assert steps.max() < step + slack
    assert (np.abs(steps) < slack).sum() > 150
    assert np.abs([reading(fine, at, 0.0)[0] - at for at in x]).max() < 1e-8


def test_ambient_light_pulls_to_the_centre_until_it_is_subtracted() -> None:
    own = device(ambient=0.25)
    dark = currents(own, share=0.0)
    assert own.psd.light(dark)[0] == pytest.approx(0.25)
    for hit in hits(10):
        row = currents(own, *hit)
        np.testing.assert_allclose(own.psd.position(row)[0], hit / 1.25, atol=1e-12)
        np.testing.assert_allclose(own.psd.position(row - dark)[0], hit, atol=1e-12)
    np.testing.assert_allclose(own.psd.position(dark), 0.0, atol=1e-12)


def test_ambient_light_on_a_tetra_lateral_psd() -> None:
    """Near the centre the same share; taken off, the reading is that in the dark wherever the spot is."""
    own, alone = device("tetra-lateral", ambient=0.25), device("tetra-lateral")
    dark = currents(own, share=0.0)
    assert own.psd.light(dark)[0] == pytest.approx(0.25)
    assert reading(own, 0.01, 0.0)[0] == pytest.approx(0.01 / 1.25, rel=1e-5)
    for hit in hits(10):
        corrected = own.psd.position(currents(own, *hit) - dark)[0]
        np.testing.assert_allclose(corrected, reading(alone, *hit), atol=1e-12)
        assert np.abs(reading(own, *hit) - corrected).max() > 0.01


def test_no_beam_and_no_light_is_no_position() -> None:
    own = device()
    np.testing.assert_allclose(currents(own), 0.0, atol=1e-15)
    exact = dataclasses.replace(own, psd=dataclasses.replace(own.psd, noise=0.0))
    assert np.isnan(exact.psd.position(currents(exact))).all()
    assert np.isnan(exact.psd.position(currents(exact, 1.0, 2.0, share=0.0))).all()


def test_saturation_is_flagged_and_misleads() -> None:
    """At u = 0.6 an electrode of two layers has 0.8 of the light, more than 0.7; at 0.3 it has 0.65."""
    for resolution in (0.0, 0.01):
        own = device(saturation=0.7, resolution=resolution)
        row = currents(own, 0.6 * SIZE / 2, 0.0)
        assert own.psd.saturated(row).all()
        assert row.max() == 0.7
        assert abs(own.psd.position(row)[0, 0] - 0.6 * SIZE / 2) > 0.1
        assert not own.psd.saturated(currents(own, 0.3 * SIZE / 2, 0.0)).any()
        assert not own.psd.saturated(currents(own, 0.6 * SIZE / 2, 0.0, share=0.8)).any()


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
