"""Biases of instruments: what is comparable, dense matrices, coverage, false alarms, power."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drifting_arms import COVARIANCE, NAMES, seen_by, walked
from scipy import stats

from zerobeam.analysis.drift.drift import ALARM, MEDIAN, SPREAD, drift
from zerobeam.analysis.drift.instrument_biases import (
    Bias,
    Instruments,
    MeasuredArm,
    bias_information,
    change_at,
    comparable_groups,
    connected,
    instrument_biases,
)
from zerobeam.analysis.drift.smoother import Observation, Series, series_of
from zerobeam.model.arrays import Matrix

BIAS = {"B": (0.0, 0.06)}  # three standard uncertainties of a result
STEADY = (0.005, 0.005)


def measured(
    series: Series, instruments: str, biases: dict[str, tuple[float, float]] | None = None
) -> MeasuredArm:
    """An arm by instruments of one letter each; a dot is a result that states none."""
    names = [name.replace(".", "") for name in instruments]
    return MeasuredArm(drift(seen_by(series, names, biases or {})), tuple(names))


def arms_of(
    orders: list[str], biases: dict[str, tuple[float, float]] | None = None, seed: int = 0
) -> list[MeasuredArm]:
    random = np.random.default_rng(seed)
    return [measured(walked(random, STEADY, len(own)), own, biases) for own in orders]


def groups(found: Instruments) -> dict[str, tuple[tuple[str, ...], ...]]:
    return {own.offset: own.groups for own in found.comparable}


def named(found: Instruments) -> list[tuple[str, str]]:
    return [(own.instrument, own.offset) for own in found.biases if own.alarm]


def test_a_bias_is_found_and_its_size_is_right() -> None:
    found = instrument_biases(arms_of(["ABABAB", "ABBAAB"], BIAS))
    assert named(found) == [("B", "delta3")]
    (odd,) = [own for own in found.biases if own.alarm]
    assert odd.against == ("A",)
    assert odd.interval95[0] < 0.06 < odd.interval95[1]
    assert odd.estimate == pytest.approx(0.06, abs=4 * odd.std)
    assert odd.p_value < ALARM


def test_of_three_the_odd_one_is_named() -> None:
    found = instrument_biases(arms_of(["ABCABC", "BCACBA"], BIAS))
    assert named(found) == [("B", "delta3")]
    rest = [own for own in found.biases if own.offset == "delta3" and own.instrument != "B"]
    assert [own.against for own in rest] == [("C",), ("A",)]  # without the biased one


@pytest.mark.long
def test_the_odd_one_is_named_though_it_has_few_results() -> None:
    """By the contrasts alone the others of this fleet are named: each is far from a mean with C in it."""
    found = instrument_biases(simulated(14, 4.0, arms=4, results=7)[0], seed=14)
    assert named(found) == [("C", "delta3")]


@pytest.mark.parametrize(
    ("orders", "expected"),
    [
        (["AAAAAA", "AAAAAA"], (("A",),)),  # one instrument measured everything
        (["AAAAAA", "BBBBBB"], (("A",), ("B",))),  # each arm by one
        (["AAABBB"], (("A",), ("B",))),  # one change: a jump would look the same
        (["AAABBB", "AAAAAA"], (("A",), ("B",))),
        (["AAABBB", "CCCDDD"], (("A",), ("B",), ("C",), ("D",))),
        (["AA..BB"], (("A",), ("B",))),
    ],
)
@pytest.mark.one_in(2)
def test_what_is_confounded_is_not_determined(
    orders: list[str], expected: tuple[tuple[str, ...], ...]
) -> None:
    found = instrument_biases(arms_of(orders, BIAS))
    assert found.biases == ()
    assert set(groups(found).values()) == {expected}


def test_new_zeros_at_the_change_of_instrument_leave_nothing_to_compare() -> None:
    random = np.random.default_rng(1)
    arms = []
    for _ in range(2):
        series = replace(walked(random, STEADY, 4), reset=(1,))
        arms.append(measured(series, "AABB", BIAS))
    found = instrument_biases(arms)
    assert found.biases == ()
    assert set(groups(found).values()) == {(("A",), ("B",))}
    elsewhere = [measured(replace(own.drift.series, reset=(0,)), "AABB") for own in arms]
    assert instrument_biases(elsewhere).biases != ()


def test_what_changes_connect_twice_is_comparable() -> None:
    assert comparable_groups([("A", "B"), ("B", "A")]) == (("A", "B"),)
    assert comparable_groups([("A", "B"), ("B", "C"), ("C", "A")]) == (("A", "B", "C"),)
    assert comparable_groups([("A", "B"), ("B", "C")]) == ()
    twice = [("A", "B"), ("B", "A"), ("B", "C"), ("C", "D"), ("D", "C")]
    assert comparable_groups(twice) == (("A", "B"), ("C", "D"))


def dense_information(series: Series, rate: Matrix, design: Matrix) -> tuple[Matrix, Matrix]:
    """By the covariance of the data: walks from a start of which nothing is known (a huge variance)."""
    count, size = len(series.observations), len(series.names)
    at = np.array([own.at for own in series.observations])
    state = np.kron(np.minimum(at[:, None], at), np.diag(rate**2)) + np.kron(
        np.ones((count, count)), 1e4 * np.eye(size)
    )
    rows = [
        t * size + series.names.index(name) for t, own in enumerate(series.observations) for name in own.names
    ]
    covariance, begin = state[np.ix_(rows, rows)], 0
    for own in series.observations:
        end = begin + len(own.names)
        covariance[begin:end, begin:end] += own.covariance + own.shared
        begin = end
    y = np.concatenate([own.values for own in series.observations])
    e = design.reshape(count * size, -1)[rows]
    inverse = np.linalg.inv(covariance)
    return e.T @ inverse @ e, e.T @ inverse @ y


def test_the_information_is_that_of_dense_matrices() -> None:
    random = np.random.default_rng(3)
    own = walked(random, (0.05, 0.02), 5)
    part = own.observations[1]
    one = Observation(part.at, NAMES[:1], part.values[:1], part.covariance[:1, :1], np.zeros((1, 1)))
    series = series_of(
        [one if k == 1 else own.observations[k] for k in range(5)], dict.fromkeys(NAMES, "deg")
    )
    design = np.zeros((5, 2, 2))
    design[[1, 3], 0, 0] = design[[1, 3], 1, 1] = 1.0
    rates = np.array([[0.05, 0.02], [0.3, 0.001]])
    matrix, vector = bias_information(series, rates, np.zeros((4, 2), dtype=bool), design)
    for k, rate in enumerate(rates):
        exact = dense_information(series, rate, design)
        np.testing.assert_allclose(matrix[k], exact[0], rtol=2e-3, atol=2)
        np.testing.assert_allclose(vector[k], exact[1], rtol=2e-3, atol=2)


@pytest.mark.parametrize("orders", [["ABA", "BCB", "DD"], ["ABCAB", "DEDE"], ["AB", "CD", "BA"]])
def test_directions_without_information_are_those_that_no_change_connects(orders: list[str]) -> None:
    """The rank of the information of all arms, against the graph of the changes."""
    names = sorted(set("".join(orders)))
    total = np.zeros((2 * len(names), 2 * len(names)))
    for own, order in zip(arms_of(orders), orders, strict=True):
        series = own.drift.series
        design = np.zeros((len(order), 2, 2, len(names)))
        for t, name in enumerate(order):
            design[t, [0, 1], [0, 1], names.index(name)] = 1.0
        none = np.zeros((len(order) - 1, 2), dtype=bool)
        total += bias_information(series, np.array([[0.01, 0.02]]), none, design.reshape(len(order), 2, -1))[
            0
        ][0]
    pairs = [pair for order in orders for pair in pairwise(order) if pair[0] != pair[1]]
    joined = connected(pairs)
    lone = set(names).difference(*joined)
    values = np.linalg.eigvalsh(total)
    assert int((values < 1e-6 * values[-1]).sum()) == 2 * (len(joined) + len(lone))


def test_a_jump_at_a_change_of_instrument_says_so() -> None:
    found = measured(walked(np.random.default_rng(2), STEADY, 8), "AAAABBBB", {"B": (0.0, 0.4)})
    (jump,) = found.drift.jumps
    assert change_at(found.drift.series, found.instruments, jump.place, jump.offset) == ("A", "B")
    assert change_at(found.drift.series, "AAAAAAAA", jump.place, jump.offset) is None


@pytest.mark.long
def test_a_jump_of_one_arm_at_a_change_is_not_taken_for_a_bias() -> None:
    random = np.random.default_rng(9)
    arms = [measured(walked(random, STEADY, 6), "AAABBB") for _ in range(2)]
    collided = {"B": (0.5, 0.0)}  # on this arm alone
    arms.append(measured(walked(random, STEADY, 6), "AAABBB", collided))
    assert arms[-1].drift.jumps != ()
    assert named(instrument_biases(arms)) == []


def test_a_bias_that_raises_jumps_on_all_arms_is_found() -> None:
    random = np.random.default_rng(10)
    arms = [measured(walked(random, STEADY, 6), "AAABBB", {"B": (0.0, 0.4)}) for _ in range(2)]
    assert all(own.drift.jumps for own in arms)
    assert named(instrument_biases(arms)) == [("B", "delta3")]


def simulated(
    number: int, size_u: float, *, arms: int = 5, results: int = 8
) -> tuple[list[MeasuredArm], Matrix]:
    """A fleet of random walks by three instruments; C is biased along delta3 by so many u."""
    random = np.random.default_rng([31, number])
    bias = np.array([0.0, size_u * np.sqrt(COVARIANCE[1, 1])])
    found = []
    for _ in range(arms):
        rates = MEDIAN * np.exp(SPREAD * random.normal(size=2))
        order = "".join(random.choice(list("ABC"), size=results))
        found.append(measured(walked(random, rates, results), order, {"C": (bias[0], bias[1])}))
    return found, bias


def as_if_none_walked(arms: list[MeasuredArm]) -> tuple[float, float]:
    """The wrong model: results of C less those before them, as if arms did not walk."""
    apart = []
    for own in arms:
        for t in range(1, len(own.instruments)):
            if (own.instruments[t] == "C") and own.instruments[t - 1] != "C":
                values = [one.values[1] for one in own.drift.series.observations]
                apart.append((values[t] - values[t - 1], COVARIANCE[1, 1] * 2))
    size = sum(one for one, _ in apart) / max(len(apart), 1)
    half = 1.96 * np.sqrt(sum(one for _, one in apart)) / max(len(apart), 1)
    return size - half, size + half


def judged(fleets: int, size_u: float, *, arms: int = 5, results: int = 8) -> tuple[int, int, int, int]:
    """Intervals that hold (of C's bias of delta3), alarms of any, C alone named, intervals of the control."""
    held, alarms, right, wrong = 0, 0, 0, 0
    for number in range(fleets):
        fleet, bias = simulated(number, size_u, arms=arms, results=results)
        found = instrument_biases(fleet, seed=number)
        (own,) = [one for one in found.biases if (one.instrument, one.offset) == ("C", "delta3")]
        held += own.interval95[0] <= bias[1] <= own.interval95[1]
        alarms += bool(named(found))
        right += named(found) == [("C", "delta3")]
        low, high = as_if_none_walked(fleet)
        wrong += low <= bias[1] <= high
    return held, alarms, right, wrong


@pytest.mark.long
def test_some_intervals_hold_without_an_alarm() -> None:
    held, alarms, _, _ = judged(2, 0.0, arms=3, results=5)
    assert held >= 1  # of 2: none with a chance of 0.0025
    assert alarms <= 1  # two with a chance of 1e-4


@pytest.mark.long
def test_intervals_hold_and_false_alarms_are_as_stated() -> None:
    fleets = 150
    held, alarms, _, wrong = judged(fleets, 0.0, arms=4, results=7)
    assert stats.binomtest(held, fleets, 0.95).pvalue > 0.001, held
    assert stats.binomtest(alarms, fleets, ALARM, alternative="greater").pvalue > 0.001, alarms
    assert stats.binomtest(wrong, fleets, 0.95).pvalue < 1e-6, wrong


@pytest.mark.long
def test_a_bias_of_several_u_is_found_with_the_right_interval() -> None:
    fleets = 60
    held, _, right, _ = judged(fleets, 4.0, arms=4, results=7)
    assert stats.binomtest(held, fleets, 0.95).pvalue > 0.001, held
    assert right > 0.8 * fleets, right


@pytest.mark.long
def test_p_values_are_uniform_without_a_bias() -> None:
    single = []
    for number in range(150):
        random = np.random.default_rng([41, number])
        arms = [
            measured(walked(random, MEDIAN * np.exp(SPREAD * random.normal(size=2)), 6), "ABABAB")
            for _ in range(2)
        ]
        found: tuple[Bias, ...] = instrument_biases(arms, seed=number).biases
        # Adjusted ones cut off at 1: those of single tests by estimate and u are near enough normal.
        own = found[int(random.integers(len(found)))]
        single.append(2 * stats.norm.sf(abs(own.estimate) / own.std))
    assert stats.kstest(single, "uniform").pvalue > 0.001
