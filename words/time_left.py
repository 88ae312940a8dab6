"""How long something under way will take: by the rate at which it advances now, a stall included."""

from __future__ import annotations

from typing import NamedTuple

_LEAST_SHARE = 0.02  # before, nothing can be said
_WINDOW = 1 / 3  # of the time passed: the rate is that of the latest part
_SHORT = 3.0  # seconds without an advance that are no stall


class Left(NamedTuple):
    """Seconds until the end; `at_least` where nothing has advanced for longer than it usually takes, so that
    the rate is known to be no higher."""

    seconds: float
    at_least: bool


class TimeLeft:
    """The shares of the whole that were done at which times (seconds, of any clock)."""

    def __init__(self, now: float, share: float = 0.0) -> None:
        self._done: list[tuple[float, float]] = [(now, share)]

    def advanced(self, now: float, share: float) -> None:
        """The share that is done now; what is not more than before is no advance."""
        if share > self._done[-1][1]:
            self._done.append((now, share))

    def left(self, now: float) -> Left | None:
        """None where too little is done to say."""
        began, first = self._done[0]
        last, share = self._done[-1]
        if share - first < _LEAST_SHARE or share >= 1.0:
            return None
        since = now - _WINDOW * (now - began)
        # The advances of the window, and the one before it: a stall alone would have no rate.
        before = max((i for i, (at, _) in enumerate(self._done) if at <= since), default=0)
        before = min(before, len(self._done) - 2)
        at, done = self._done[before]
        usual = (last - at) / (len(self._done) - 1 - before)
        seconds = (1.0 - share) * (now - at) / (share - done)
        return Left(seconds, now - last > max(_SHORT, 2 * usual))


def left_words(left: Left | None) -> str:
    """`about 12 s left`, `at least 3 min left`; "" where nothing can be said."""
    if left is None:
        return ""
    how = "at least" if left.at_least else "about"
    seconds = max(1, round(left.seconds))
    time = f"{seconds} s" if seconds < 120 else f"{round(seconds / 60)} min"
    return f"{how} {time} left"
