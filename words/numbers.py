"""How numbers are written: rounded by their uncertainty, here and nowhere else.

An estimate has as many decimals as its standard deviation has when that is cut to two significant
digits (GUM 7.2.6). Minus is U+2212, and a unit never parts from its number at the end of a line.
"""

from __future__ import annotations

import math
from typing import NamedTuple

MINUS = "\u2212"
NO_BREAK = "\u00a0"

_UNITS = {"deg": "°", "mm": f"{NO_BREAK}mm"}
_MOST_DECIMALS = 8
_LARGEST = 1e7


def decimals(std: float) -> int:
    """Digits after the point that leave `std` two significant ones; negative means tens, hundreds.

    0.0123 → 3 (0.012), 0.0996 → 2 (0.10), 130 → -1.
    """
    if not (math.isfinite(std) and std > 0):
        raise ValueError(f"an uncertainty must be positive and finite, not {std}")
    return 1 - int(f"{std:.1e}".split("e")[1])


def fixed(value: float, digits: int) -> str:
    """`value` with `digits` decimals (negative: tens, hundreds), or in powers of ten if far off."""
    if not math.isfinite(value):
        raise ValueError(f"only finite numbers are written, not {value}")
    if digits > _MOST_DECIMALS or abs(value) >= _LARGEST:
        exponent = 0 if value == 0 else math.floor(math.log10(abs(value)))
        text = f"{value:.{max(digits + exponent, 0)}e}"
    else:
        text = f"{round(value, digits):.{max(digits, 0)}f}"
    if text.startswith("-"):
        # A zero has no sign, whatever was rounded away.
        text = MINUS + text[1:] if float(text) != 0 else text[1:]
    return text.replace("e-0", "e-").replace("e+0", "e").replace("e+", "e").replace("e-", f"e{MINUS}")


def spread(std: float, unit: str = "") -> str:
    """A standard deviation, to two significant digits."""
    return with_unit(fixed(std, decimals(std)), unit)


def estimate(value: float, std: float, unit: str = "") -> str:
    """An estimate, rounded by its standard deviation."""
    return with_unit(fixed(value, decimals(std)), unit)


def interval(bounds: tuple[float, float], std: float, unit: str = "") -> str:
    """`low to high`, rounded by the standard deviation; words, as a dash would read as a minus."""
    low, high = (fixed(bound, decimals(std)) for bound in bounds)
    return f"{low} to {with_unit(high, unit)}"


def significant(value: float, digits: int = 3, unit: str = "") -> str:
    """A number without an uncertainty of its own, to `digits` significant digits (whole from 1000 up)."""
    if value == 0:
        return with_unit("0", unit)
    exponent = int(f"{value:.{digits - 1}e}".split("e")[1])
    return with_unit(fixed(value, max(digits - 1 - exponent, 0)), unit)


def exact(value: float, unit: str = "") -> str:
    """A number that someone stated: as it was stated."""
    text = f"{value:.10g}"
    return with_unit(text.replace("-", MINUS) if value != 0 else "0", unit)


def p_value(p: float) -> str:
    """A probability; beyond 0.001 and 0.999 only the side is said."""
    if not 0 <= p <= 1:
        raise ValueError(f"a probability lies in 0 to 1, not at {p}")
    if p < 0.001:
        return "below 0.001"
    if p > 0.999:
        return "above 0.999"
    return f"{p:.3f}" if p < 0.1 or p > 0.9 else f"{p:.2f}"


def p_words(p: float, digits: int = 1) -> str:
    """A p-value with its sign, for a sentence; it is never called 0."""
    return "p < 1e-6" if p < 1e-6 else f"p = {p:.{digits}g}"


def times(factor: float) -> str:
    """A factor as people read it: 0.12, 1.5, 1,333."""
    if factor >= 100:
        return f"{factor:,.0f}"
    return f"{factor:.1f}" if factor >= 0.95 else significant(factor, 2)


def with_unit(text: str, unit: str) -> str:
    """`text` followed by its unit: ° close up, mm after a space that does not break."""
    return text if not unit else text + _UNITS.get(unit, f"{NO_BREAK}{unit}")


def percent(share: float, digits: int = 0) -> str:
    """A share or a probability: 0.954 is 95 %."""
    return f"{fixed(100 * share, digits)}{NO_BREAK}%"


def coverage(k: float) -> str:
    """The coverage factor of an expanded uncertainty U."""
    return f"k{NO_BREAK}={NO_BREAK}{fixed(k, 2).removesuffix('.00')}"


def symbol(unit: str) -> str:
    """A unit in the head of a column or on an axis: ° for degrees."""
    return _UNITS.get(unit, unit).strip(NO_BREAK)


def number_in(text: str) -> float:
    """The number of a text that is written here, as rounded; ValueError where it has none."""
    number = text.replace(MINUS, "-").rstrip("°m" + NO_BREAK)
    return float(number)


def unit_of(unit: str) -> str:
    """What follows a number in this unit; a noise factor is so many times the stated noise."""
    return "times" if unit == "1" else unit


def length_and_angle(mm: float, deg: float | None) -> str:
    """The size of residuals: a length, and of rotations an angle."""
    return significant(mm, unit="mm") + ("" if deg is None else f" and {significant(deg, unit='deg')}")


def or_words(value: float | None, words: str, unit: str = "", digits: int = 3) -> str:
    """A number as `significant`, or the words for what there is instead."""
    return words if value is None else significant(value, digits, unit)


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
