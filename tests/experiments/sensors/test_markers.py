"""What is found in pictures: how good the centroid is, what is light or noise, which two are the LEDs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from zerobeam.experiments.rigs.simulated import simulator
from zerobeam.experiments.rigs.simulated.simulator import ELECTRONS, PictureScene, render
from zerobeam.experiments.sensors import markers
from zerobeam.experiments.sensors.detectors import Camera
from zerobeam.experiments.sensors.markers import (
    Blob,
    NoPair,
    Pair,
    blobs,
    is_black,
    marker_pair,
    spot_between,
)

ROOM: dict[str, Any] = {"exposure": 1.0, "ambient": 20.0, "noise": 2.0, "psf": 1.2}
# Two LEDs 60 mm apart at 0.7 m: 68 px, each 2.1 px wide and some 110 grey values high.
LEDS = np.array([[-30.0, 20, 700], [30, 25, 700]])
LED_LIGHT, LED_SIZE = 1500.0, 1.5


def camera(width: int = 640, height: int = 480) -> Camera:
    middle = ((width - 1) / 2, (height - 1) / 2)
    return Camera(width, height, (800.0, 800.0), middle, (0.0,) * 5, np.eye(4))


SMALL = camera(160, 120)


def picture(
    points: np.ndarray, seed: int = 0, view: Camera = SMALL, light: Any = LED_LIGHT, **room: Any
) -> np.ndarray:
    points = np.array(points, dtype=float).reshape(-1, 3)
    brightness = np.broadcast_to(np.asarray(light, dtype=float), len(points))
    scene = PictureScene(points, brightness, np.full(len(points), LED_SIZE))
    return render(view, scene, rng=np.random.default_rng(seed), **{**ROOM, **room})


def at(blob: Blob) -> np.ndarray:
    return np.array([blob.x, blob.y])


def centroid_variance(light: float, sigma: float, room: dict[str, Any]) -> float:
    """px² on each axis, of a centroid weighed by a Gaussian as wide as the blob.

    Twice the weighed first moment over the weighed sum, which is light / 2. Background noise v gives
    4 v ∫ w² x² = 2 π v σ⁴, shot noise of the blob itself
    4 / ELECTRONS ∫ w² x² I = 4 light σ² / (9 ELECTRONS).
    """
    v = room["noise"] ** 2 + room["ambient"] / ELECTRONS + 1 / 12
    return (2 * np.pi * v * sigma**4 + 4 * light * sigma**2 / (9 * ELECTRONS)) / (light / 2) ** 2


@pytest.fixture
def level(monkeypatch):
    """A background without a slope."""
    monkeypatch.setattr(simulator, "SLOPE", 0.0)


def shifted_errors(find: Any, count: int = 300, **room: Any) -> tuple[np.ndarray, np.ndarray]:
    """Errors (count, 2) px of what `find` finds, and the true positions' shifts (count, 2) within a pixel."""
    rng = np.random.default_rng(5)
    view = camera(64, 64)
    errors, shifts = [], []
    for seed in range(count):
        true = 31.5 + rng.uniform(-1, 1, 2)
        point = [*((true - view.centre) * 700 / 800), 700.0]
        errors.append(find(picture([point], seed, view, **room)) - true)
        shifts.append(true % 1)
    return np.array(errors), np.array(shifts)


def bias_and_scatter(errors: np.ndarray, shifts: np.ndarray, variance: float) -> tuple[float, float]:
    """Bias in standard deviations of its own (the worst of six), and mean square error over `variance`.

    The bias of each axis: constant, and once over a pixel as sine and cosine of the shift, which is how
    pixels pull; each of these means over N has the variance / N, times 1, 1/2 and 1/2.
    """
    waves = (np.ones_like(shifts), np.sin(2 * np.pi * shifts), np.cos(2 * np.pi * shifts))
    own = variance / len(errors)
    means = [(errors * wave).mean(axis=0) / np.sqrt(own * (wave**2).mean()) for wave in waves]
    return float(np.abs(means).max()), float((errors**2).mean() / variance)


@pytest.mark.usefixtures("level")
def test_the_centroid_is_as_good_as_the_noise_allows():
    """Below 0.05 px rms at moderate noise, without bias over shifts within a pixel."""
    light = LED_LIGHT / 0.49
    variance = centroid_variance(light, np.hypot(800 * LED_SIZE / 700, 1.2), ROOM)
    assert np.sqrt(variance) < 0.02
    errors, shifts = shifted_errors(lambda image: at(blobs(image)[0]))
    bias, scatter = bias_and_scatter(errors, shifts, variance)
    # The pixels widen the blob and the weights are not quite as wide: a fifth more is allowed for that.
    low, high = stats.chi2.ppf([0.0005, 0.9995], errors.size) / errors.size
    assert low < scatter < 1.2 * high
    assert bias < 3.5 * np.sqrt(1.2)
    assert np.sqrt(scatter * variance) < 0.05


@pytest.mark.usefixtures("level")
@pytest.mark.long
def test_a_faint_light_is_without_bias_too():
    """Its peak is some 30 grey values: no less true for standing little above the threshold."""
    light = 400.0 / 0.49
    variance = centroid_variance(light, np.hypot(800 * LED_SIZE / 700, 1.2), ROOM)
    errors, shifts = shifted_errors(lambda image: at(blobs(image)[0]), light=400.0)
    bias, scatter = bias_and_scatter(errors, shifts, variance)
    assert scatter < 1.5
    assert bias < 3.5 * np.sqrt(1.5)


@pytest.mark.long
def test_what_a_sloping_background_does():
    """It draws the centroid by 2 s ∫ w x² / (light / 2) = 8 π s σ⁴ / light: 0.01 px in a picture 64 px wide.

    In a whole picture the slope s is a tenth of that.
    """
    light, sigma = LED_LIGHT / 0.49, np.hypot(800 * LED_SIZE / 700, 1.2)
    errors, _ = shifted_errors(lambda image: at(blobs(image)[0]))
    slope = ROOM["ambient"] * simulator.SLOPE / 63
    drawn = 8 * np.pi * slope * sigma**4 / light
    assert 0.009 < drawn < 0.011
    own = np.sqrt(1.2 * centroid_variance(light, sigma, ROOM) / len(errors))
    np.testing.assert_allclose(errors.mean(axis=0), drawn, rtol=0.2, atol=3.5 * own)


def test_the_brightest_pixel_would_be_seen_to_be_biased():
    """Control: the same measures for a finder that pixels pull."""

    def brightest(image: np.ndarray) -> np.ndarray:
        row, column = np.unravel_index(np.argmax(image), image.shape)
        return np.array([column, row], dtype=float)

    variance = centroid_variance(LED_LIGHT / 0.49, np.hypot(800 * LED_SIZE / 700, 1.2), ROOM)
    bias, scatter = bias_and_scatter(*shifted_errors(brightest), variance)
    assert bias > 50
    assert scatter > 100


@pytest.mark.parametrize("room", [(0.0, 0.5), (0.0, 2.0), (1.0, 2.0), (20.0, 2.0), (150.0, 3.0)])
@pytest.mark.one_in(3)
def test_noise_is_no_light(room):
    """Ten whole pictures of each room, black and bright: not one light in three million pixels."""
    ambient, noise = room
    for seed in range(10):
        assert blobs(picture([], seed, camera(), ambient=ambient, noise=noise)) == []


def test_noise_would_be_taken_for_light_at_half_the_threshold(monkeypatch):
    """Control: at three standard deviations the same pictures are full of lights."""
    monkeypatch.setattr(markers, "_FACTOR", 3.0)
    monkeypatch.setattr(markers, "_SMALLEST", 1)
    assert len(blobs(picture([], 0, camera()))) > 10


def test_a_light_below_the_threshold_is_not_found_and_one_above_it_is():
    """Threshold: 6 × 2.2 = 13 and some grey values. Peaks of 8 and of 32, forty pictures of each."""
    width = 2 * np.pi * np.hypot(800 * LED_SIZE / 700, 1.2) ** 2
    for peak, found in ((8.0, 0), (32.0, 1)):
        seen = [len(blobs(picture(LEDS[:1], seed, light=peak * width * 0.49))) for seed in range(40)]
        assert seen == [found] * 40


def test_a_hot_pixel_and_a_lamp_are_no_markers():
    image = picture(LEDS)
    image[5, 5] = image[60, 100] = 255
    image[105:, 120:] = 250
    found = blobs(image)
    assert len(found) == 2
    np.testing.assert_allclose(marker_pair(found).pixels, SMALL.project(LEDS), atol=0.1)


def test_what_a_blob_says_of_its_light():
    image = picture(LEDS, light=[1500.0, 700.0])
    bright, faint = blobs(image)
    distance = np.linalg.norm(LEDS, axis=1) / 1000
    for blob, brightness, far in zip((bright, faint), (1500.0, 700.0), distance, strict=True):
        light = brightness / far**2
        # Some 300 pixels of noise 2.2 in the window, and what the ring of 100 says of each: √(300 + 900).
        assert blob.light == pytest.approx(light, abs=4 * 2.2 * np.sqrt(1200))
        assert blob.saturated == 0.0
        assert not blob.cut
    assert bright.area > faint.area > 10


def test_saturated_leds_are_found_and_said_to_be_saturated():
    found = blobs(picture(LEDS, light=12e3))
    pair = marker_pair(found)
    np.testing.assert_allclose(pair.pixels, SMALL.project(LEDS), atol=0.1)
    assert all(0.2 < blob.saturated < 1 for blob in found)


def test_black_pictures():
    assert is_black(np.zeros((480, 640), dtype=np.uint8))
    assert is_black(picture([], ambient=0.0, noise=2.0))  # a covered lens
    assert not is_black(picture([]))
    assert not is_black(picture(LEDS, ambient=0.0))  # a dark room
    assert not is_black(np.full((480, 640), 255, dtype=np.uint8))


def test_without_two_lights_there_is_no_pair():
    assert marker_pair(blobs(picture([]))) == NoPair("no light in the picture", 0)
    occluded = marker_pair(blobs(picture(LEDS[:1])), SMALL.project(LEDS))
    assert occluded == NoPair("only one light in the picture", 1)


def test_which_marker_is_the_first():
    """By the expected direction, wherever the pair is in the picture; without it the left one."""
    found = blobs(picture(LEDS))
    left, right = sorted(found, key=lambda blob: blob.x)
    elsewhere = SMALL.project(LEDS) + np.array([40, -25])
    assert marker_pair(found, elsewhere) == Pair(left, right)
    assert marker_pair(found, elsewhere[::-1]) == Pair(right, left)
    assert marker_pair(found[::-1]) == Pair(left, right)


def test_two_lights_that_are_not_as_expected_are_no_pair():
    """A marker is hidden, a reflection of the other is there: not alike, too close, in another direction."""
    expected = SMALL.project(LEDS)
    faint = blobs(picture(LEDS, light=[1500.0, 500.0]))
    assert marker_pair(faint) == NoPair("no two lights are alike", 2)
    why = NoPair("no two lights are alike and as far apart as expected", 2)
    assert marker_pair(faint, expected) == why
    for reflection in ([10.0, 25.0, 700.0], [-27.0, -30.0, 700.0]):
        found = blobs(picture(np.array([LEDS[0], reflection])))
        assert isinstance(marker_pair(found), Pair)  # alone they could be the markers
        assert marker_pair(found, expected) == why
    # Markers that should not be in front of the camera at all.
    assert marker_pair(blobs(picture(LEDS)), np.full((2, 2), np.nan)) == why


def test_a_reflection_beside_the_leds():
    expected = SMALL.project(LEDS)
    reflection = [[-15.0, -32.0, 700.0]]
    three = np.vstack([LEDS, reflection])
    # As bright as they are: only the expectation tells them apart.
    found = blobs(picture(three))
    assert marker_pair(found) == NoPair("more than one pair of lights could be the markers", 3)
    np.testing.assert_allclose(marker_pair(found, expected).pixels, expected, atol=0.1)
    # Fainter: their likeness tells as well.
    found = blobs(picture(three, light=[1500.0, 1500.0, 500.0]))
    np.testing.assert_allclose(marker_pair(found).pixels, expected, atol=0.1)
    # A mirror image of both, as bright as they are: nothing tells.
    four = np.vstack([LEDS, LEDS - [0.0, 45.0, 0.0]])
    found = blobs(picture(four))
    assert marker_pair(found, expected) == NoPair("more than one pair of lights could be the markers", 4)


def test_an_led_cut_off_by_the_edge():
    """The centroid of what is left is pixels off; it is said to be cut, and no pair is made of it."""
    view = SMALL
    beyond = LEDS + np.array([(view.width - 0.3 - view.project(LEDS)[1, 0]) * 700 / 800, 0, 0])
    true = view.project(beyond)
    found = blobs(picture(beyond, light=3000.0))
    left, right = sorted(found, key=lambda blob: blob.x)
    assert [left.cut, right.cut] == [False, True]
    assert abs(right.x - true[1, 0]) > 0.5
    for expected in (None, true):
        assert marker_pair(found, expected) == NoPair("a marker is cut off by the edge of the picture", 2)
    # Control: were it not for that, the pair would be taken.
    assert isinstance(marker_pair([left, replace(left, x=right.x, y=right.y)], true), Pair)
    # A reflection as bright as the markers is not taken instead of the one that is cut.
    with_reflection = blobs(picture(np.vstack([beyond, [[-30.0, -30.0, 700.0]]]), light=3000.0))
    assert marker_pair(with_reflection) == NoPair("more than one pair of lights could be the markers", 3)


def test_the_edge_cuts_on_all_four_sides():
    view = SMALL
    near, far = [(3, 60), (156, 60), (80, 3), (80, 116)], [(80, 60), (14, 14), (145, 105)]
    for x, y in near + far:
        point = [*((np.array([x, y]) - view.centre) * 700 / 800), 700.0]
        (blob,) = blobs(picture([point]))
        assert blob.cut == ((x, y) in near)


def test_the_difference_of_two_pictures_is_the_spot():
    """LEDs and ambient light cancel; what is left is the spot alone, as true as if it were alone."""
    spot = np.array([[5.0, -10, 700]])
    for seed in range(20):
        dark = picture(LEDS, 2 * seed, ambient=60.0)
        lit = picture(np.vstack([LEDS, spot]), 2 * seed + 1, ambient=60.0, light=[1500.0, 1500.0, 900.0])
        (found,) = spot_between(dark, lit)
        # The noise of two pictures, and 900 instead of 1500: 0.05 px.
        np.testing.assert_allclose(at(found), SMALL.project(spot)[0], atol=0.25)
        assert len(blobs(lit)) == 3  # control: the picture itself has three lights
        assert spot_between(lit, dark) == []


def test_a_reflection_of_the_spot_is_seen_beside_it():
    spots = np.array([[5.0, -10, 700], [-40, -30, 700]])
    dark, lit = picture([], 1), picture(spots, 2, light=[900.0, 400.0])
    found = spot_between(dark, lit)
    np.testing.assert_allclose([at(blob) for blob in found], SMALL.project(spots), atol=0.5)


def test_no_spot_in_the_difference_of_noise():
    for seed in range(20):
        one, other = picture(LEDS, 2 * seed, camera()), picture(LEDS, 2 * seed + 1, camera())
        assert spot_between(one, other) == []


def test_a_spot_on_a_saturated_led_is_not_seen():
    """Where the picture is full the difference cannot tell."""
    dark = picture(LEDS, 1, light=60e3)
    lit = picture(np.vstack([LEDS, LEDS[:1]]), 2, light=[60e3, 60e3, 100.0])
    assert spot_between(dark, lit) == []
