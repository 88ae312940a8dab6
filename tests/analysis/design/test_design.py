from itertools import combinations

import numpy as np
import pytest
from scipy.optimize import linprog

from zerobeam.analysis.design import continuous_design as shares
from zerobeam.analysis.design import exact_design as module
from zerobeam.analysis.design.continuous_design import (
    Candidates,
    Shares,
    continuous,
    offset_covariance,
    variance,
)
from zerobeam.analysis.design.exact_design import _best_pair, _cuts, design, exchange_pairs

CRITERIA = ["A", "D", "E"]


def random_candidates(seed, count=12, rows=2, offsets=3, nuisance=2, size=3.0):
    rng = np.random.default_rng(seed)
    roots = size * rng.normal(size=(count, rows, offsets + nuisance)) * rng.uniform(0.2, 2, (count, 1, 1))
    return Candidates(roots, np.arange(offsets + nuisance) < offsets)


def value_of(candidates, rows, criterion):
    """The criterion of a choice, worked out without the module."""
    chosen = candidates.roots[list(rows)].reshape(-1, candidates.roots.shape[2])
    covariance = np.linalg.inv(np.eye(chosen.shape[1]) + chosen.T @ chosen)
    own = covariance[candidates.offsets][:, candidates.offsets]
    if criterion == "A":
        return np.mean(np.diag(own))
    eigenvalues = np.linalg.eigvalsh(own)
    if criterion == "soft":
        return float(np.linalg.norm(eigenvalues, shares.SOFT))
    return eigenvalues.max() if criterion == "E" else eigenvalues.prod() ** (1 / len(own))


def value_of_weights(candidates, weights, shots, criterion):
    roots = candidates.roots * np.sqrt(shots * weights)[:, None, None]
    return value_of(Candidates(roots, candidates.offsets), range(len(weights)), criterion)


def brute_force(candidates, shots, criterion):
    return min(
        (value_of(candidates, rows, criterion), rows) for rows in combinations(range(candidates.count), shots)
    )


def line(slope_matters, count=41):
    """Readings of a + b t at places t in [-1, 1], with little prior: roots (count, 1, 2)."""
    places = np.linspace(-1, 1, count)
    roots = 1e3 * np.stack([np.ones(count), places], axis=1)[:, None, :]
    return places, Candidates(roots, np.array([not slope_matters, True]))


@pytest.mark.parametrize("criterion", CRITERIA)
def test_shots_that_each_tell_one_offset_are_shared_out_evenly(criterion):
    roots = 50.0 * np.eye(4)[:, None, :]
    candidates = Candidates(np.concatenate([roots, 0.5 * roots]), np.ones(4, dtype=bool))
    found = continuous(candidates, (4,), criterion)
    np.testing.assert_allclose(found.weights, [0.25] * 4 + [0] * 4, atol=2e-3)
    best = design(candidates, (4,), criterion, seed=0)
    np.testing.assert_array_equal(best.rows, [0, 1, 2, 3])
    assert best.value == pytest.approx(1 / 2501)
    assert best.efficiency > 0.99


@pytest.mark.parametrize("criterion", CRITERIA)
def test_the_slope_of_a_line_is_read_at_its_ends(criterion):
    """c-optimal: half of the readings at each end, variance sigma^2 / (k 1^2); the height is nuisance."""
    _, candidates = line(slope_matters=True)
    found = continuous(candidates, (6,), criterion)
    np.testing.assert_allclose(found.weights[[0, -1]], 0.5, atol=2e-3)
    assert found.bound == pytest.approx(1e-6 / 6, rel=6e-3)
    assert found.bound <= 1e-6 / 6


def test_the_d_optimal_line_is_read_at_its_ends_too():
    """Both coefficients matter: D puts 1/2 at each end, generalised variance (sigma^2 / k)."""
    _, candidates = line(slope_matters=False)
    both = Candidates(candidates.roots, np.ones(2, dtype=bool))
    found = continuous(both, (6,), "D")
    np.testing.assert_allclose(found.weights[[0, -1]], 0.5, atol=2e-3)
    assert found.bound == pytest.approx(1e-6 / 6, rel=1e-3)


def test_different_readings_of_the_slope_are_those_furthest_out():
    places, candidates = line(slope_matters=True)
    chosen = design(candidates, (6,), "A", seed=0)
    assert sorted(np.abs(places[chosen.rows])) == pytest.approx([0.9, 0.9, 0.95, 0.95, 1, 1])
    assert 0.85 < chosen.efficiency < 1


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.one_in(4)
def test_all_choices_of_few(criterion, seed):
    candidates = random_candidates(seed)
    best, rows = brute_force(candidates, 3, criterion)
    chosen = design(candidates, (3,), criterion, seed=1)
    assert chosen.value == pytest.approx(best)
    assert tuple(chosen.rows) == rows
    assert chosen.bound <= best
    assert 0 < chosen.efficiency <= 1


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize(("seed", "size"), [(0, 3.0), (1, 3.0), (2, 3.0), (3, 0.3)])
@pytest.mark.one_in(3)
def test_no_weights_are_below_the_bound(criterion, seed, size):
    candidates = random_candidates(seed, count=40, size=size)  # with 0.3 the prior is a good part of it
    found = continuous(candidates, (5,), criterion)
    rng = np.random.default_rng(seed)
    values = [value_of_weights(candidates, found.weights, 5, criterion)]
    for share in (1.0, 0.3, 0.05):
        for _ in range(150):
            other = rng.dirichlet(np.full(40, share))
            values.append(value_of_weights(candidates, other, 5, criterion))
            mixed = 0.9 * found.weights + 0.1 * other
            values.append(value_of_weights(candidates, mixed, 5, criterion))
    assert min(values) >= found.bound
    # It is tight, too: the weights that were found attain it to within the stated gap.
    assert values[0] <= found.bound * (1 + 2 * (shares._GAP_E if criterion == "E" else shares._GAP))


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.one_in(4)
def test_a_bound_for_different_shots_is_closer_and_holds(criterion, seed):
    """Of a candidate that is better than all others by far only one can be taken."""
    candidates = random_candidates(seed)
    candidates.roots[3] *= 10
    best, _ = brute_force(candidates, 3, criterion)
    free = continuous(candidates, (3,), criterion)
    capped = continuous(candidates, (3,), criterion, most=1 / 3)
    assert free.bound * (1 - shares._GAP) <= capped.bound <= best
    if criterion == "E":
        assert capped.bound > 1.004 * free.bound  # twice the gap
        assert capped.weights.max() <= 1 / 3 * (1 + 1e-6)
        # Negative control: shares that three shots cannot have.
        assert continuous(candidates, (3,), criterion, most=1 / 12).bound > best


@pytest.mark.parametrize("shots", [1, 5, 11, 12])
def test_shares_are_capped(shots):
    weights = np.random.default_rng(shots).dirichlet(np.full(12, 0.2))
    limit = Shares(np.zeros(12, dtype=int), np.ones(1), 1 / shots)
    capped = limit.capped(weights)
    assert capped.sum() == pytest.approx(1)
    assert capped.max() <= 1 / shots * (1 + 1e-8)
    worth = np.random.default_rng(0).normal(size=12)
    assert capped @ worth <= limit.largest(worth) + 1e-12
    assert limit.largest(worth) == pytest.approx(np.sort(worth)[-shots:].mean())


@pytest.mark.parametrize("criterion", ["A", "D", "E"])
@pytest.mark.one_in(3)
def test_so_many_of_each_group_are_chosen(criterion):
    """The best of all choices of two of one group and one of the other; without groups there is a better."""
    roots = random_candidates(3).roots
    roots[::2] *= 0.3  # the better ones are of one group
    groups = np.arange(12) % 2
    offsets = random_candidates(3).offsets
    candidates = Candidates(roots, offsets, groups)
    every = [rows for rows in combinations(range(12), 3) if (groups[list(rows)] == 0).sum() == 2]
    best = min(value_of(candidates, rows, criterion) for rows in every)
    chosen = design(candidates, (2, 1), criterion, seed=0)
    assert sorted(groups[chosen.rows]) == [0, 0, 1]
    assert chosen.value == pytest.approx(best, rel=1e-6)
    assert chosen.bound <= best * (1 + 1e-9)
    assert chosen.bound > 0.4 * best
    free = design(Candidates(roots, offsets), (3,), criterion, seed=0)
    assert free.value < 0.9 * best


def test_a_slope_of_the_wrong_sign_is_caught():
    """Negative control: with the excess added, what is called a bound is above a real choice."""
    candidates = random_candidates(0)
    best, _ = brute_force(candidates, 3, "A")
    even = np.full(candidates.count, 1 / candidates.count)
    slope = shares._Slope(candidates, candidates.roots, even, 3, "A")
    gain = slope.gain(candidates.roots)
    excess = float(gain.max() - even @ gain)
    assert slope.bound(excess) <= best
    assert slope.bound(-excess) > best


@pytest.mark.parametrize("criterion", ["A", "D"])
def test_gains_are_slopes(criterion):
    candidates = random_candidates(4)
    weights = np.random.default_rng(0).dirichlet(np.ones(12))
    gain = shares._Slope(candidates, candidates.roots, weights, 4, criterion).gain(candidates.roots)
    step = 1e-6
    for i in range(12):
        nudge = step * np.eye(12)[i]
        ends = [value_of_weights(candidates, weights + s * nudge, 4, criterion) for s in (1, -1)]
        if criterion == "D":
            ends = list(np.log(ends))
        assert -(ends[0] - ends[1]) / (2 * step) == pytest.approx(gain[i], rel=1e-5)


def values_with(candidates, start, criterion):
    information = candidates.information(start)
    covariance = np.linalg.inv(information)
    return module.values_with(candidates, information, covariance, criterion)


@pytest.mark.parametrize("rows", [1, 2, 3])
@pytest.mark.parametrize("nuisance", [0, 3])
@pytest.mark.parametrize("criterion", CRITERIA)
def test_updates_equal_working_it_out_again(criterion, rows, nuisance):
    candidates = random_candidates(7, count=60, rows=rows, nuisance=nuisance)
    start = np.array([3, 14, 15])
    values = values_with(candidates, start, criterion)
    again = np.array([value_of(candidates, [*start, i], criterion) for i in range(60)])
    np.testing.assert_allclose(values, again, rtol=1e-9)


@pytest.mark.parametrize("nuisance", [0, 3])
@pytest.mark.parametrize("criterion", ["A", "D", "E", "soft"])
def test_none_that_would_improve_the_choice_is_passed_over(criterion, nuisance):
    candidates = random_candidates(9, count=200, rows=2, nuisance=nuisance)
    others, alike = np.array([3, 14, 15]), np.ones(200, dtype=bool)
    covariance = np.linalg.inv(candidates.information(others))
    after = np.array([value_of(candidates, [*others, i], criterion) for i in range(200)])
    for value in np.quantile(after, [0.05, 0.3, 0.9]):
        some = module._promising(candidates, others, alike, covariance, value, criterion)
        better = np.setdiff1d(np.flatnonzero(after < value), others)
        assert set(better) <= set(some)
        assert not np.isin(others, some).any()
    # What is to be reached beyond the best is out of reach for most.
    far = module._promising(candidates, others, alike, covariance, 0.9 * after.min(), criterion)
    assert len(far) < 160


def test_e_looks_at_the_promising_ones_of_many():
    candidates = random_candidates(8, count=400)
    start = np.array([1, 2, 3])
    values = values_with(candidates, start, "E")
    again = np.array([value_of(candidates, [*start, i], "E") for i in range(400)])
    looked_at = np.isfinite(values)
    assert looked_at.sum() == module._SCREENED
    np.testing.assert_allclose(values[looked_at], again[looked_at], rtol=1e-9)
    assert values.min() == pytest.approx(again.min())


def test_the_power_mean_is_a_little_above_the_largest():
    rng = np.random.default_rng(1)
    roots = rng.normal(size=(50, 5, 7)) * 10.0 ** rng.uniform(-4, 4, (50, 1, 1))
    covariances = roots @ roots.transpose(0, 2, 1)
    eigenvalues = np.linalg.eigvalsh(covariances)
    for power in (8, 32):
        mean = shares.power_mean(covariances, power)
        np.testing.assert_allclose(mean, (eigenvalues**power).sum(axis=1) ** (1 / power), rtol=1e-9)
        assert (mean >= eigenvalues[:, -1] * (1 - 1e-12)).all()
        assert (mean <= eigenvalues[:, -1] * 5 ** (1 / power) * (1 + 1e-12)).all()


def test_nuisance_is_eliminated_as_by_schur():
    candidates = random_candidates(9)
    information = candidates.information(np.array([0, 1, 2]))
    own, other = candidates.offsets, ~candidates.offsets
    across = information[np.ix_(own, other)]
    rest = np.linalg.inv(information[np.ix_(other, other)])
    schur = information[np.ix_(own, own)] - across @ rest @ across.T
    np.testing.assert_allclose(offset_covariance(candidates, information), np.linalg.inv(schur), rtol=1e-9)
    # Nuisance costs: were it known, the offsets would be known better.
    known = np.linalg.inv(information[np.ix_(own, own)])
    assert variance(offset_covariance(candidates, information), "A") > 1.01 * variance(known, "A")


@pytest.mark.parametrize("criterion", CRITERIA)
@pytest.mark.at_length(r"^E")
def test_the_seed_fixes_the_choice(criterion):
    candidates = random_candidates(10, count=200)
    one, two = (design(candidates, (6,), criterion, seed=5) for _ in range(2))
    np.testing.assert_array_equal(one.rows, two.rows)
    assert one.value == two.value
    assert len(set(one.rows)) == 6
    assert one.value == pytest.approx(value_of(candidates, one.rows, criterion))


@pytest.mark.parametrize("criterion", CRITERIA)
def test_no_exchange_improves_the_choice(criterion):
    candidates = random_candidates(11, count=900)  # more than the starts look at
    chosen = design(candidates, (5,), criterion, seed=0, starts=4)
    for place in range(5):
        others = np.delete(chosen.rows, place)
        values = values_with(candidates, others, criterion)
        values[others] = np.inf
        assert values.min() >= chosen.value * (1 - 1e-7)


@pytest.mark.parametrize("criterion", CRITERIA)
def test_all_of_the_candidates_can_be_asked_for(criterion):
    candidates = random_candidates(12, count=5)
    chosen = design(candidates, (5,), criterion, seed=0)
    np.testing.assert_array_equal(chosen.rows, np.arange(5))


def test_a_gauge_is_no_singular_case():
    """What no shot tells keeps its prior variance."""
    candidates = random_candidates(13)
    candidates.roots[:, :, 0] = 0.0
    chosen = design(candidates, (4,), "E", seed=0)
    assert chosen.value == pytest.approx(1.0)
    assert chosen.efficiency == pytest.approx(1.0, rel=1e-2)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.one_in(3)
def test_no_exchange_of_two_improves_the_choice(seed):
    candidates = random_candidates(seed, count=30)
    rng = np.random.default_rng(seed)
    value, rows = exchange_pairs(candidates.roots, candidates.offsets, np.arange(5), rng)
    assert len(set(rows.tolist())) == 5
    assert value == pytest.approx(value_of(candidates, rows, "E"))
    for places in combinations(range(5), 2):
        kept = np.delete(rows, places)
        free = np.setdiff1d(np.arange(30), kept)
        others = [value_of(candidates, [*kept, *pair], "E") for pair in combinations(free, 2)]
        assert min(others) >= value * (1 - 1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_the_best_of_all_pairs_is_found(seed):
    candidates = random_candidates(seed, count=30)
    rest, offsets = candidates.roots[4:], candidates.offsets
    start = candidates.information(np.arange(2))
    cuts, least = _cuts(candidates.information(np.arange(4)), offsets, 3)
    found, value = _best_pair(rest, offsets, start, cuts, least)
    best, pair = min(
        (value_of(candidates, [0, 1, *pair], "E"), pair) for pair in combinations(range(4, 30), 2)
    )
    assert best < 1 / least
    assert 1 / value == pytest.approx(best)
    assert tuple(sorted(found + 4)) == pair
    # Above the best there is none.
    assert _best_pair(rest, offsets, start, cuts, value) == (None, value)


def test_a_cut_bounds_every_design_and_is_tight_at_its_own():
    candidates, rng = random_candidates(7, count=30), np.random.default_rng(0)
    own = candidates.information(np.arange(4))
    cuts, least = _cuts(own, candidates.offsets, 3)
    assert (cuts[0] @ own @ cuts[0]) == pytest.approx(least)
    bounds, true = [], []
    for _ in range(200):
        other = candidates.information(rng.choice(30, 4, replace=False))
        bounds.append(np.einsum("cf,fg,cg->c", cuts, other, cuts).min())
        true.append(1 / np.linalg.eigvalsh(np.linalg.inv(other)[:3, :3])[-1])
    assert (np.array(true) <= np.array(bounds) * (1 + 1e-12)).all()
    # Negative control: a vector that is shorter on the offsets bounds nothing.
    assert 0.9**2 * (cuts[0] @ own @ cuts[0]) < least * 0.99


def test_one_shot_has_no_pair():
    candidates, rng = random_candidates(8, count=30), np.random.default_rng(0)
    value, rows = exchange_pairs(candidates.roots, candidates.offsets, np.array([3]), rng)
    assert rows.tolist() == [3]
    assert value == pytest.approx(value_of(candidates, [3], "E"))


@pytest.mark.one_in(3)
@pytest.mark.parametrize("shots", [7, 12, 16, 20, 30, 40])
def test_e_ends_with_a_bound_for_any_number_of_measurements(shots, monkeypatch):
    """Of 20 and more it never ended: the 12 most promising candidates joined again and again."""
    solved = []

    def counted(*arguments, **more):
        solved.append(linprog(*arguments, **more))
        assert len(solved) < 500, "the linear programs do not end"
        return solved[-1]

    monkeypatch.setattr("scipy.optimize.linprog", counted)
    candidates = random_candidates(0, count=100, offsets=4, nuisance=6)
    chosen = design(candidates, (shots,), "E", seed=0, starts=2)
    assert len(set(chosen.rows.tolist())) == shots
    assert chosen.converged
    assert chosen.value == pytest.approx(value_of(candidates, chosen.rows, "E"))
    assert chosen.efficiency >= (0.95 if shots >= 20 else 0.6)
    rng = np.random.default_rng(1)
    for _ in range(20):
        other = rng.choice(candidates.count, size=shots, replace=False)
        assert value_of(candidates, other, "E") >= chosen.bound


@pytest.mark.parametrize(("criterion", "steps"), [("A", "_ROUNDS"), ("E", "_CUTS")])
def test_a_bound_whose_steps_are_used_up_says_so_and_holds(criterion, steps, monkeypatch):
    candidates = random_candidates(0, count=100, offsets=4, nuisance=6)
    whole = continuous(candidates, (20,), criterion, most=1 / 20)
    monkeypatch.setattr(shares, steps, 2)
    monkeypatch.setattr(shares, "_INNER", 1)
    short = continuous(candidates, (20,), criterion, most=1 / 20)
    assert whole.converged
    assert not short.converged
    assert short.bound <= value_of_weights(candidates, whole.weights, 20, criterion)
    assert not design(candidates, (20,), criterion, seed=0, starts=1).converged
