"""The time left follows the rate of now: a stall makes it longer, never shorter."""

from __future__ import annotations

import pytest

from zerobeam.words.numbers import Left, TimeLeft, left_words


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
