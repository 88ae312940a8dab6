"""The smoother against a dense normal distribution of all states, and scores against brute force."""

from dataclasses import astuple, replace

import numpy as np
import pytest

from zerobeam.analysis.drift import smoother
from zerobeam.analysis.drift.smoother import Filtered, Observation, Series, series_of, smooth
from zerobeam.model import kernel
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import UnsoundResult

NAMES = ("delta2", "delta3", "delta4")
UNITS = dict.fromkeys(NAMES, "deg")


def series(seed: int = 1, *, lost: tuple[tuple[int, int], ...] = ((0, 0), (3, 1))) -> Series:
    """Results at uneven times with full covariances; `lost` are result and offset that is not determined."""
    random = np.random.default_rng(seed)
    found, at = [], 0.0
    for t in range(6):
        at += random.uniform(0.1, 0.6)
        root = random.normal(size=(3, 3)) * 0.05
        covariance = root @ root.T + 1e-4 * np.eye(3)
        kept = [j for j in range(3) if (t, j) not in lost]
        own = covariance[np.ix_(kept, kept)]
        values = random.normal(size=len(kept)) * 0.2
        found.append(Observation(at, tuple(NAMES[j] for j in kept), values, own, np.zeros_like(own)))
    return series_of(found, UNITS)


def dense(own: Series, rates: Matrix, jumps: Matrix) -> tuple[Matrix, Matrix, float]:
    """Mean, covariance of all states and the restricted log-likelihood, by dense matrices."""
    count, size = len(own.observations), len(own.names)
    design, walks = [], []
    for t in range(count - 1):
        for j in range(size):
            if not jumps[t, j]:
                row = np.zeros((count, size))
                row[t + 1, j], row[t, j] = 1, -1
                design.append(row.ravel())
                walks.append(rates[j] ** 2 * own.gaps[t])
    steps, walk = np.array(design), np.diag(walks)
    observed = []
    for t, one in enumerate(own.observations):
        for name in one.names:
            row = np.zeros((count, size))
            row[t, own.names.index(name)] = 1
            observed.append(row.ravel())
    h, y = np.array(observed), np.concatenate([one.values for one in own.observations])
    noise = np.zeros((len(y), len(y)))
    at = 0
    for one in own.observations:
        m = len(one.names)
        noise[at : at + m, at : at + m] = one.covariance
        at += m
    precision = h.T @ np.linalg.inv(noise) @ h + steps.T @ np.linalg.inv(walk) @ steps
    covariance = np.linalg.inv(precision)
    vector = h.T @ np.linalg.inv(noise) @ y
    mean = covariance @ vector
    likelihood = (vector @ mean - np.linalg.slogdet(precision)[1] - np.log(walks).sum()) / 2
    return mean.reshape(count, size), covariance, float(likelihood)


@pytest.mark.parametrize("jump", [None, (2, 0), (4, 2)])
def test_it_is_the_dense_answer(jump: tuple[int, int] | None) -> None:
    own = series()
    jumps = np.zeros((5, 3), dtype=bool)
    if jump is not None:
        jumps[jump] = True
    rates = np.array([[0.05, 0.2, 0.1], [0.5, 0.01, 0.3]])
    found = smooth(own, rates, jumps)
    told = [dense(own, one, jumps) for one in rates]
    for k, (mean, covariance, _) in enumerate(told):
        np.testing.assert_allclose(found.mean[k], mean, rtol=1e-8, atol=1e-10)
        blocks = covariance.reshape(6, 3, 6, 3)
        for t in range(6):
            np.testing.assert_allclose(found.covariance[k, t], blocks[t, :, t], rtol=1e-7, atol=1e-12)
        for t in range(5):
            step = blocks[t, :, t] + blocks[t + 1, :, t + 1] - blocks[t, :, t + 1] - blocks[t + 1, :, t]
            np.testing.assert_allclose(found.step_variance[k, t], np.diag(step), rtol=1e-7)
    np.testing.assert_allclose(np.diff(found.log_likelihood), told[1][2] - told[0][2], rtol=1e-8)


def test_the_score_is_that_of_a_jump_that_is_fitted() -> None:
    own, rates = series(2), np.array([[0.05, 0.2, 0.1]])
    none = np.zeros((5, 3), dtype=bool)
    score, power_of = smooth(own, rates, none).jumps_after(range(5))
    for t, j in ((1, 0), (3, 2)):
        # A jump moves every later result: the log-likelihood over its size is a parabola.
        def shifted(size: float, t: int = t, j: int = j) -> float:
            moved = tuple(
                replace(one, values=one.values - size * (np.array(one.names) == NAMES[j])) if k > t else one
                for k, one in enumerate(own.observations)
            )
            extra = sum(
                -0.5 * float(one.values @ np.linalg.inv(one.covariance) @ one.values) for one in moved
            )
            at = replace(own, observations=moved)
            return float(smooth(at, rates, none).log_likelihood[0]) + extra

        low, middle, high = shifted(-1.0), shifted(0.0), shifted(1.0)
        power = 2 * middle - low - high
        best = (high - low) / 2 / power
        assert power_of[t, j, 0] == pytest.approx(power, rel=1e-6)
        assert score[t, j, 0] == pytest.approx(best * np.sqrt(power), rel=1e-6)


def test_what_a_result_does_not_determine_adds_nothing() -> None:
    own, jumps = series(), np.zeros((5, 3), dtype=bool)
    rates = np.array([[0.05, 0.2, 0.1]])
    matrix, vector = own.information()
    assert not matrix[0, 0].any()
    assert not matrix[0, :, 0].any()
    assert vector[0, 0] == 0
    sharper = smooth(series(lost=()), rates, jumps)
    assert (np.diagonal(smooth(own, rates, jumps).covariance[0, 0])[0]) > sharper.covariance[0, 0, 0, 0]


def test_numbers_and_names_have_to_go_together() -> None:
    with pytest.raises(UnsoundResult):
        Observation(0.0, NAMES, np.zeros(2), np.eye(3), np.zeros((3, 3)))


@pytest.mark.parametrize("rate", [1e-5, 1e-7, 1e-9, 1e-12])
def test_without_a_walk_a_jump_is_the_difference_of_two_means(rate: float) -> None:
    """However slow the walk is: the results before and after are averaged, N is the inverse of A⁻¹ + B⁻¹,
    and the score is the part of their difference that the other offsets do not explain."""
    own = series(lost=())
    information, vector = own.information()
    scores, powers = smooth(own, np.full((1, 3), rate), np.zeros((5, 3), dtype=bool)).jumps_after(range(5))
    for t in range(5):
        before, after = information[: t + 1].sum(axis=0), information[t + 1 :].sum(axis=0)
        precision = np.linalg.inv(np.linalg.inv(before) + np.linalg.inv(after))
        apart = np.linalg.solve(after, vector[t + 1 :].sum(axis=0))
        apart = apart - np.linalg.solve(before, vector[: t + 1].sum(axis=0))
        np.testing.assert_allclose(powers[t, :, 0], np.diag(precision), rtol=1e-3)
        score = precision @ apart / np.sqrt(np.diag(precision))
        np.testing.assert_allclose(scores[t, :, 0], score, rtol=1e-3, atol=1e-3)


@pytest.mark.skipif(kernel._compiler() is None, reason="no C compiler on this machine")
@pytest.mark.parametrize("rates", [1, 3, 256, 261])
@pytest.mark.parametrize("columns", [1, 4])
def test_the_compiled_filter_and_tests_are_those_of_numpy(
    monkeypatch: pytest.MonkeyPatch, rates: int, columns: int
) -> None:
    own, random = series(5), np.random.default_rng(5)
    jumps = np.zeros((5, 3), dtype=bool)
    jumps[2, 1] = True
    some = np.exp(random.normal(np.log(0.01), 1.5, size=(rates, 3)))
    vectors = np.tile(own.information()[1][:, :, None], columns) + np.arange(columns)

    def both() -> tuple[Filtered, tuple[Matrix, Matrix]]:
        tested = smooth(own, some, jumps).jumps_after([0, 1, 3, 4])
        return smoother.filtered(own, some, jumps, vectors), tested

    assert smoother._library() is not None
    compiled, tested = both()
    monkeypatch.setattr(smoother, "_library", lambda: None)
    plain, expected = both()
    for part, other in zip(astuple(compiled), astuple(plain), strict=True):
        np.testing.assert_allclose(part, other, rtol=1e-12, atol=1e-12 * np.abs(other).max())
    for part, other in zip(tested, expected, strict=True):
        np.testing.assert_allclose(part, other, rtol=1e-12, atol=1e-12)
    assert (expected[1] > 0).any()
