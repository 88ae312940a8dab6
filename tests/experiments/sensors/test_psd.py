from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from zerobeam.experiments.sensors.psd import GAIN, Psd, PsdKind

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
