"""Numbers of a robot file that are probably in another unit, or mistyped: said as warnings, never changed."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence

LONGEST = 10_000.0  # mm: all links of an arm together; the largest arms have some 6 m
_SHORTEST = 50.0  # mm: all links together
ONE_TURN = 6.3  # rad, a little more than 2 pi
_SLOWEST = 20.0  # deg/s: some joint of any arm is faster
_NEAR_DEG = 10.0
_METRES = (0.05, 3.0)  # a link's length, if it was written in metres
_DIGITS = range(2, 9)  # that people write of pi
_BESIDE_DEG = 0.1  # so near to a right angle a twist is meant to be on it, if it has few decimals
_ROUNDED_DEG = 1.0  # a right angle rounded to two decimals, or more, is no further off
_ON_DEG = 1e-3
_FEW = 5  # decimals of an angle in rad
_SAME_RAD = 2e-8  # digits of a robot file, in degrees


class DoubtfulRobot(UserWarning):
    """A robot whose numbers are probably in another unit, or mistyped."""


def warn_of(name: str, doubts: Sequence[str]) -> None:
    """One warning for each doubt about the robot `name`."""
    for doubt in doubts:
        warnings.warn(f"robot {name}: {doubt}", DoubtfulRobot, stacklevel=2)


def doubtful_rows(
    lengths: Mapping[str, float],
    twists: Mapping[str, float],
    angles: Mapping[str, float],
    limits: Sequence[float],
    speeds: Sequence[float],
) -> tuple[str, ...]:
    """Sentences about Denavit-Hartenberg rows, as the file has them: mm and degrees.

    `lengths` (a, d), `twists` (alpha) and `angles` (theta, beta) by what a person calls them (`a_mm of joint
    2`); `limits` and `speeds` of the revolute joints alone.
    """
    doubts = [
        *_lengths(lengths),
        *(
            f"{called}: {value:.10g} looks like radians: {math.degrees(value):.6g} degrees?"
            for called, value in {**twists, **angles}.items()
            if _fraction_of_pi(value)
        ),
    ]
    if limits and any(limits) and max(map(abs, limits)) <= ONE_TURN:
        doubts.append(f"all limits are within ±{ONE_TURN} degrees, as limits in radians would be")
    if speeds and max(speeds) <= _SLOWEST:
        doubts.append(
            f"the fastest joint makes {max(speeds):.6g} degrees a second: are the speeds in radians a second?"
        )
    doubts += [
        f"{called}: {value:.10g} is near {_quarter(value):g} and is not: correct, or mistyped?"
        for called, value in twists.items()
        if _nearly_quarter(value) and not _fraction_of_pi(value) and not _rounded_degrees(value)
    ]
    doubts += [
        beside_right_angle(called, value)
        for called, value in {**twists, **angles}.items()
        if _rounded_degrees(value) and not _fraction_of_pi(value)
    ]
    return tuple(doubts)


def beside_right_angle(called: str, value: float) -> str:
    """That an angle, degrees, is no right angle, and which is near."""
    off = abs(value - _right(value))
    return f"{called}: {value:.10g}° is {off:.2g}° beside a right angle: was {_right(value):g}° meant?"


def too_long(lengths: Sequence[float], unit: str) -> tuple[str, ...]:
    """A sentence where the links together are longer than any arm; `unit` is that of the file."""
    whole = sum(map(abs, lengths))
    if whole <= LONGEST:
        return ()
    return (f"its links together are {whole / 1000:.3g} m long, beyond any real arm: lengths are in {unit}",)


def _lengths(lengths: Mapping[str, float]) -> list[str]:
    longest = max(lengths, key=lambda called: abs(lengths[called]), default=None)
    if longest is None or not lengths[longest]:
        return []
    if sum(map(abs, lengths.values())) < _SHORTEST and abs(lengths[longest]) < _METRES[1] * 2:
        return [
            f"its lengths look like metres: the largest is {longest}: {lengths[longest]:.10g};"
            f" in millimetres {1000 * lengths[longest]:.10g}?"
        ]
    return [
        f"{called}: {value:.10g} looks like metres: {1000 * value:.10g} mm?"
        for called, value in lengths.items()
        if _METRES[0] <= abs(value) < _METRES[1] and _round(value, 5) and not _round(value, 1)
    ]


def _round(value: float, decimals: int) -> bool:
    """Whether a person wrote it with so few decimals. Estimated lengths have many."""
    return value == round(value, decimals)


def _fraction_of_pi(value: float) -> bool:
    quarters = round(abs(value) / (math.pi / 4))
    if not 1 <= quarters <= 8:
        return False
    exact = quarters * math.pi / 4
    digits = _DIGITS if quarters % 2 == 0 else _DIGITS[1:]
    return any(abs(abs(value) - round(exact, d)) < 1e-10 for d in digits) or abs(abs(value) - exact) < 1e-8


def rounded_angle(called: str, rad: float) -> str | None:
    """A sentence where an angle of a URDF, rad (0 or more), is one to four right angles rounded or cut to so
    few digits that it is off by more than 0.001°, or is near that by few digits; None for any other. Angles
    that calibrations found have many digits."""
    quarters = round(rad / (math.pi / 2))
    exact = quarters * math.pi / 2
    off = math.degrees(abs(rad - exact))
    few = rad == round(rad, _FEW) or _rounding(math.radians(off))
    near = off < _BESIDE_DEG or (off < _ROUNDED_DEG and _fraction_of_pi(rad))
    if not 1 <= quarters <= 4 or off <= _ON_DEG or not few or not near:
        return None
    meant = f"{exact:.10g} rad ({math.degrees(exact):g}°)"
    return f"{called}: {rad:.10g} rad is {off:.2g}° beside a right angle: was {meant} meant?"


def is_rounded(rad: float) -> bool:
    """Whether an angle, rad, is one to four right angles rounded or cut to two to four decimals, and off by
    more than 0.001°: no arm is built so, and what its run determines is wrong by as much."""
    quarters = round(abs(rad) / (math.pi / 2))
    off = abs(abs(rad) - quarters * math.pi / 2)
    return 1 <= quarters <= 4 and math.degrees(off) > _ON_DEG and _rounding(off)


def _rounding(off: float) -> bool:
    """Whether an angle is as far from a right angle, rad, as a multiple of pi / 2 of few digits is."""
    scale = (10.0**digits for digits in (2, 3, 4))
    cut = (
        abs(k * math.pi / 2 - rounded(k * math.pi / 2 * by) / by)
        for by in scale
        for k in range(1, 5)
        for rounded in (math.floor, math.ceil)
    )
    return any(abs(off - each) < _SAME_RAD for each in cut)


def _quarter(value: float) -> float:
    """The nearest odd multiple of 90 degrees."""
    return 180.0 * math.floor(value / 180.0) + 90.0


def _right(value: float) -> float:
    """The nearest multiple of 90 degrees."""
    return 90.0 * round(value / 90.0)


def _rounded_degrees(value: float) -> bool:
    """Whether an angle, degrees, is beside a right angle by few decimals, or as pi / 2 of few digits is.
    Angles that calibrations found have many."""
    off = abs(value - _right(value))
    if not _ON_DEG < off < _BESIDE_DEG:
        return False
    return (bool(_right(value)) and _round(value, 3)) or _rounding(math.radians(off))


def _nearly_quarter(value: float) -> bool:
    """A twist off a right angle by some degrees, or by little and with few decimals: calibrated arms have
    twists of many decimals within half a degree of it."""
    off = abs(value - _quarter(value))
    return 1e-3 < off < _NEAR_DEG and (off > 0.5 or _round(value, 2))
