"""The types of arrays and of progress that all rooms share, equality by value, the normal quantile."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from statistics import NormalDist
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PlainSerializer, PlainValidator, WithJsonSchema

Matrix = NDArray[np.float64]
# The same in a document: rows of numbers.
ListedMatrix = Annotated[
    Matrix,
    PlainValidator(np.array),
    PlainSerializer(lambda matrix: matrix.tolist()),
    WithJsonSchema({"type": "array"}),
]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]
Progress = Callable[[str, float], None]  # the stage, and its share of the whole that is done, 0 to 1
ShareDone = Callable[[float], None]  # the share of the whole that is done, 0 to 1


class ByValue:
    """A dataclass that equals another of its class whose compared fields are equal, arrays by their numbers.

    Equal ones have the same hash. It is declared with `eq=False`.

    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False)
    ... class Line(ByValue):
    ...     name: str
    ...     points: Matrix
    >>> Line("a", np.zeros(2)) == Line("a", np.zeros(2)), Line("a", np.zeros(2)) == Line("a", np.ones(2))
    (True, False)
    """

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return self is other or all(
            _equal(one, two) for one, two in zip(_values(self), _values(other), strict=True)
        )

    def __hash__(self) -> int:
        return hash((type(self), *(value for value in _values(self) if isinstance(value, str))))


def _values(thing: Any) -> list[Any]:
    return [getattr(thing, field.name) for field in fields(thing) if field.compare]


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=True)
    if isinstance(one, tuple) and isinstance(other, tuple):
        return len(one) == len(other) and all(map(_equal, one, other))
    return bool(one == other)


def normal_half_width(level: float = 0.95) -> float:
    """Half width of a normal distribution's central interval that holds `level`, in standard uncertainties.

    >>> round(normal_half_width(), 6), round(normal_half_width(0.6827), 3)
    (1.959964, 1.0)
    """
    return NormalDist().inv_cdf((1 + level) / 2)


NORMAL_95 = normal_half_width()
