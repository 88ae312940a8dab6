"""The one place where numbers are rounded."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zerobeam.words import numbers


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
