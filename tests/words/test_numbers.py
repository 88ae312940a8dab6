"""The one place where numbers are rounded."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zerobeam.words import numbers
from zerobeam.words.numbers import Left, TimeLeft, left_words


@pytest.mark.parametrize(
    ("std", "digits", "written"),
    [
        (0.0123, 3, "0.012"),
        (0.0996, 2, "0.10"),
        (0.00949, 4, "0.0095"),
        (1.0, 1, "1.0"),
        (0.994, 2, "0.99"),
        (0.995001, 1, "1.0"),
        (23.4, 0, "23"),
        (134.0, -1, "130"),
        (99.6, -1, "100"),
    ],
)
def test_a_standard_deviation_has_two_significant_digits(std: float, digits: int, written: str) -> None:
    assert numbers.decimals(std) == digits
    assert numbers.spread(std) == written


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_a_spread_that_is_none_is_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="positive and finite"):
        numbers.decimals(bad)


def test_an_estimate_is_rounded_by_its_uncertainty() -> None:
    assert numbers.estimate(-0.51234, 0.0283, "deg") == "\u22120.512°"
    assert numbers.estimate(1210.3249, 0.214, "mm") == "1210.32\u00a0mm"
    assert numbers.estimate(1234.5, 134.0) == "1230"
    assert numbers.interval((-0.567, -0.4569), 0.028, "deg") == "\u22120.567 to \u22120.457°"


def test_a_zero_has_no_sign_and_no_ascii_minus_is_left() -> None:
    assert numbers.estimate(-0.0001, 0.01) == "0.000"
    assert numbers.fixed(-0.0, 2) == "0.00"
    assert numbers.exact(-0.0, "deg") == "0°"
    assert numbers.exact(-2.5, "mm") == "\u22122.5\u00a0mm"


def test_very_small_and_very_large_numbers_are_written_in_powers_of_ten() -> None:
    assert numbers.spread(1.26e-12) == "1.3e\u221212"
    assert numbers.estimate(-4.56789e9, 1.2e6) == "\u22124.5679e9"
    assert numbers.significant(1.234e-11) == "1.23e\u221211"


@pytest.mark.parametrize(
    ("value", "written"),
    [
        (0.9531, "0.953"),
        (31.62, "31.6"),
        (12345.6, "12346"),
        (0.0, "0"),
        (0.000123456, "0.000123"),
        (9.999, "10.0"),
    ],
)
def test_significant_digits(value: float, written: str) -> None:
    assert numbers.significant(value) == written


@pytest.mark.parametrize(
    ("p", "written"),
    [(0.0, "below 0.001"), (0.0123, "0.012"), (0.437, "0.44"), (0.9812, "0.981"), (1.0, "above 0.999")],
)
def test_p_values(p: float, written: str) -> None:
    assert numbers.p_value(p) == written


def test_what_is_no_probability_and_no_number_is_refused() -> None:
    with pytest.raises(ValueError, match="0 to 1"):
        numbers.p_value(1.2)
    with pytest.raises(ValueError, match="finite"):
        numbers.fixed(math.nan, 2)


@given(
    value=st.floats(-1e6, 1e6),
    std=st.floats(1e-7, 1e5),
)
def test_rounding_never_moves_an_estimate_by_more_than_a_twentieth_of_its_std(
    value: float, std: float
) -> None:
    written = float(numbers.estimate(value, std).replace("\u2212", "-"))
    assert abs(written - value) <= 0.0501 * std + 1e-9 * abs(value)


def test_no_p_value_is_called_zero() -> None:
    assert numbers.p_words(0.0) == "p < 1e-6"
    assert numbers.p_words(0.0123) == "p = 0.01"
    assert numbers.p_words(0.0123, 2) == "p = 0.012"


def test_a_steady_advance_is_known_to_the_second() -> None:
    time_left = TimeLeft(100.0)
    assert time_left.left(100.0) is None
    for second in range(1, 21):
        time_left.advanced(100.0 + second, second / 100)
    left = time_left.left(120.0)
    assert left is not None
    assert left.seconds == pytest.approx(80.0)
    assert not left.at_least


def test_what_stands_still_takes_at_least_as_long_as_it_has_stood() -> None:
    """99 % in ten seconds, then nothing for three minutes: by the mean rate 2 s would be left."""
    time_left = TimeLeft(0.0)
    for second in range(1, 11):
        time_left.advanced(float(second), 0.099 * second)
    before = 0.0
    for now in (15.0, 30.0, 60.0, 190.0):
        left = time_left.left(now)
        assert left is not None
        assert left.at_least
        assert left.seconds > before
        before = left.seconds
    # The last advance was 0.099, and nothing came for 180 s: at that rate 0.01 takes 18 s.
    assert before == pytest.approx(0.01 * 181 / 0.099)


def test_a_slow_end_is_seen_by_the_rate_of_now() -> None:
    """80 % in eight seconds, then 1 % in ten: the mean rate over all would say 10 s."""
    time_left = TimeLeft(0.0)
    for second in range(1, 9):
        time_left.advanced(float(second), 0.1 * second)
    for step in range(1, 6):
        time_left.advanced(8.0 + 10 * step, 0.8 + 0.01 * step)
    left = time_left.left(58.0)
    assert left is not None
    assert left.seconds == pytest.approx(150.0, rel=0.05)


@pytest.mark.parametrize(
    ("left", "words"),
    [
        (None, ""),
        (Left(0.2, False), "about 1 s left"),
        (Left(119.0, False), "about 119 s left"),
        (Left(200.0, True), "at least 3 min left"),
    ],
    ids=str,
)
def test_in_words(left: Left | None, words: str) -> None:
    assert left_words(left) == words
