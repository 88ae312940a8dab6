from itertools import combinations

import numpy as np
import pytest

from zerobeam.analysis.design.exact_design import _best_pair, _cuts, exchange_pairs

OFFSETS = np.array([True, True, True, False, False])


def roots_of(seed, count=30):
    rng = np.random.default_rng(seed)
    return 3.0 * rng.normal(size=(count, 2, 5)) * rng.uniform(0.2, 2, (count, 1, 1))


def information(roots, rows):
    chosen = roots[list(rows)].reshape(-1, 5)
    return np.eye(5) + chosen.T @ chosen


def largest_variance(roots, rows):
    return np.linalg.eigvalsh(np.linalg.inv(information(roots, rows))[:3, :3])[-1]


@pytest.mark.parametrize("seed", range(6))
def test_no_exchange_of_two_improves_the_choice(seed):
    roots = roots_of(seed)
    value, rows = exchange_pairs(roots, OFFSETS, np.arange(5), np.random.default_rng(seed))
    assert len(set(rows.tolist())) == 5
    assert value == pytest.approx(largest_variance(roots, rows))
    for places in combinations(range(5), 2):
        kept = np.delete(rows, places)
        free = np.setdiff1d(np.arange(30), kept)
        others = [largest_variance(roots, [*kept, *pair]) for pair in combinations(free, 2)]
        assert min(others) >= value * (1 - 1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_the_best_of_all_pairs_is_found(seed):
    roots = roots_of(seed)
    start = information(roots, [0, 1])
    cuts, least = _cuts(information(roots, [0, 1, 2, 3]), OFFSETS, 3)
    found, value = _best_pair(roots[4:], OFFSETS, start, cuts, least)
    best, pair = min((largest_variance(roots, [0, 1, *pair]), pair) for pair in combinations(range(4, 30), 2))
    assert best < 1 / least
    assert 1 / value == pytest.approx(best)
    assert tuple(sorted(found + 4)) == pair
    # Above the best there is none.
    assert _best_pair(roots[4:], OFFSETS, start, cuts, value) == (None, value)


def test_a_cut_bounds_every_design_and_is_tight_at_its_own():
    roots = roots_of(7)
    rng = np.random.default_rng(0)
    own = information(roots, range(4))
    cuts, least = _cuts(own, OFFSETS, 3)
    assert (cuts[0] @ own @ cuts[0]) == pytest.approx(least)
    bounds, true = [], []
    for _ in range(200):
        other = information(roots, rng.choice(30, 4, replace=False))
        bounds.append(np.einsum("cf,fg,cg->c", cuts, other, cuts).min())
        true.append(1 / np.linalg.eigvalsh(np.linalg.inv(other)[:3, :3])[-1])
    assert (np.array(true) <= np.array(bounds) * (1 + 1e-12)).all()
    # Negative control: a vector that is shorter on the offsets bounds nothing.
    assert 0.9**2 * (cuts[0] @ own @ cuts[0]) < least * 0.99


def test_one_shot_has_no_pair():
    roots = roots_of(8)
    value, rows = exchange_pairs(roots, OFFSETS, np.array([3]), np.random.default_rng(0))
    assert rows.tolist() == [3]
    assert value == pytest.approx(largest_variance(roots, [3]))
