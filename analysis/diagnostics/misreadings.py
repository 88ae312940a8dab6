"""Of a measurement that is wrong: which joint's value may be, and what was probably meant.

The error of one joint's value is one parameter more. With a normal prior of the standard deviation s, an
error whose estimate is v and whose information is G changes the evidence by
-(log(1 + s^2 G) + v^2 G / (1 + s^2 G)) / 2 beside what it gains in the residuals. A laser's measurement has
two numbers, and the errors of several joints may leave the same: then none of them is named alone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...model.arrays import Matrix
from ...model.likelihood.problem import Problem
from .hypotheses import HypothesisFit, suspect_fit
from .suspects import Linear, of_one_value

DECIDED = 20.0  # the ratio of the evidences from which one cause is named and not asked for
_SIZES = {"deg": (0.5, 5.0, 50.0), "mm": (1.0, 10.0, 100.0)}  # standard deviations of an error
_NEAR = 2.0  # standard uncertainties between what fits and what was probably meant
_CLEAR = 20.0  # standard uncertainties that a digit must be worth: chance would suit some digit more finely
_MOST_DECIMALS = 4  # more were calculated and not written by a person


@dataclass(frozen=True)
class Misreading:
    """One value that may be wrong: of `joint` (from 1), deg or mm by its `unit`.

    With `fitted`, whose standard uncertainty is `u`, in place of what was `recorded` the measurement agrees
    with the others. `meant` is the number that differs from what was recorded by one digit, two neighbouring
    digits exchanged or the sign, and that fits too; None where there is none, or it is not decided.
    """

    joint: int
    unit: str
    recorded: float
    fitted: float
    u: float
    meant: str | None = None


def misreadings(
    problem: Problem, x: Matrix, base: HypothesisFit, number: int, slack: float
) -> tuple[Misreading, ...]:
    """The joints of one measurement of which one wrong value explains it, the likeliest first: those whose
    evidence is 20 : 1 over the values as recorded, and within 20 : 1 of the best. Arguments as of
    `hypothesis_fits`."""
    at, linear = problem.shot_numbers.index(number), Linear(problem, x)
    fits = []
    for i, joint in enumerate(problem.robot.joints):
        unit = "deg" if joint.kind == "revolute" else "mm"
        display = float(problem.robot.display[i])
        widest = _SIZES[unit][-1]
        suspect = replace(of_one_value(problem, i, at), size=widest / display, unit=display)
        left = suspect_fit(linear, suspect)
        if not left.agrees(slack) or left.u > widest / 2:  # by its prior alone
            continue
        information = 1 / left.u**2 - 1 / widest**2
        evidence = max(
            replace(left, occam=_occam(left.amount, information, size)).log_evidence(base, slack > 1)
            for size in _SIZES[unit]
        )
        if evidence < np.log(DECIDED):
            continue
        recorded = round(float(problem.joints[at, i]) * display, 9)
        one = Misreading(i + 1, unit, recorded, recorded + left.amount, left.u)
        fits.append((evidence, replace(one, meant=meant(one))))
    fits.sort(key=lambda row: -row[0])
    return tuple(one for evidence, one in fits if evidence > fits[0][0] - np.log(DECIDED))


def _occam(value: float, information: float, size: float) -> float:
    wider = 1 + size**2 * information
    return float(np.log(wider) + value**2 * information / wider) / 2


def meant(one: Misreading) -> str | None:
    """The one number with a slip of one digit (or two exchanged, or the sign) that fits."""
    text = f"{one.recorded:.{_MOST_DECIMALS + 2}f}".rstrip("0").rstrip(".")
    if len(text.partition(".")[2]) > _MOST_DECIMALS:
        return None
    near = {
        slip
        for slip, worth in _slips(text)
        if worth >= _CLEAR * one.u and abs(float(slip) - one.fitted) <= _NEAR * one.u
    }
    return near.pop() if len(near) == 1 else None


def _slips(text: str) -> Iterator[tuple[str, float]]:
    """What a text may have been, and the least that such a slip changes of the number."""
    places = [i for i, character in enumerate(text) if character.isdigit()]
    point = text.find(".") if "." in text else len(text)
    yield text.removeprefix("-") if text.startswith("-") else f"-{text}", 2 * abs(float(text))
    for k, i in enumerate(places):
        worth = 10.0 ** (point - i - 1 if i < point else point - i)
        yield from (
            (f"{text[:i]}{digit}{text[i + 1 :]}", worth) for digit in "0123456789" if digit != text[i]
        )
        if k and text[i] != text[places[k - 1]]:
            before = places[k - 1]
            swapped = list(text)
            swapped[before], swapped[i] = text[i], text[before]
            yield "".join(swapped), 9 * worth
