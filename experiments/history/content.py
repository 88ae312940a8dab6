"""What a history counts with: offsets, their covariance, what they do to the TCP; checked as it is read.

The same of a result.json that is added and of a row of the database, either of which may be damaged.
Whatever is wrong raises one of `DAMAGED`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Any, get_args

import numpy as np

from ...analysis.status import Status, Verdict, known
from ...model.arrays import Matrix

DAMAGED = (KeyError, TypeError, ValueError, AttributeError, ArithmeticError)

_OFFSET = ("name", "unit", "status", "held", "estimate", "std", "interval95")


def parsed(text: str) -> Any:
    """Plain JSON; ValueError for NaN and infinity. The checks of `parse_json` would take most of the time of
    adding; what a history counts with is checked on its own."""

    def refuse(word: str) -> None:
        raise ValueError(f"{word} is no number")

    try:
        return json.loads(text, parse_constant=refuse)
    except RecursionError:
        raise ValueError("the values are nested too deeply") from None


def checked_text(value: object) -> str:
    """The same text, one that can be written."""
    if not isinstance(value, str):
        raise TypeError(f"{value!r} is no text")
    value.encode()
    return value


def checked_verdict(value: object) -> str:
    """The same verdict."""
    if value not in get_args(Verdict):
        raise ValueError(f"verdict {value!r}")
    return str(value)


def checked_moment(value: object) -> datetime:
    """A time of the database: PostgreSQL has it as such, SQLite as text."""
    found = value if isinstance(value, datetime) else datetime.fromisoformat(checked_text(value))
    if found.tzinfo is not None:
        raise ValueError(f"{found} has a zone")
    return found


def checked_offset(row: Mapping[str, Any]) -> dict[str, Any]:
    """The row of an offset, without other keys."""
    kept = {key: row[key] for key in _OFFSET}
    name = checked_text(kept["name"])
    checked_text(kept["unit"])
    if kept["status"] not in get_args(Status) or not isinstance(kept["held"], bool):
        raise ValueError(f"status {kept['status']!r} of {name}")
    if kept["status"] == "unidentifiable" and (kept["estimate"], kept["std"]) != (None, None):
        raise ValueError(f"{name} is unidentifiable, yet it has a number")
    if known(kept["status"]) and not 0 < _number(kept["std"]) < math.inf:
        raise ValueError(f"the std of {name} is not a number above 0")
    interval = kept["interval95"]
    if interval is not None and len(interval) != 2:
        raise ValueError(f"the interval of {name} has not two ends")
    if known(kept["status"]) and (kept["estimate"] is None or interval is None):
        raise ValueError(f"{name} is {kept['status']}, yet it lacks a number")
    numbers = [own for own in (kept["estimate"], *(interval or ())) if own is not None]
    if not all(math.isfinite(_number(own)) for own in numbers):
        raise ValueError(f"a number of {name} is not finite")
    return kept


def checked_without_prior(
    own: Mapping[str, Any] | None, offsets: Sequence[Mapping[str, Any]]
) -> dict[str, Any] | None:
    """The same, if its shapes are right and all of it is determined."""
    if own is None:
        return None
    size, shared = len(own["names"]), len(own["geometry"])
    allowed = {row["name"] for row in offsets if known(row["status"])}
    sizes = {size, len(own["values"]), len(own["units"]), len(set(own["names"]))}
    if not size or len(sizes) > 1 or not set(own["names"]) <= allowed:
        raise ValueError("without_prior names what is not determined, or not all of it has a value")
    covariance = _numbers(own["covariance"], (size, size), "without_prior.covariance")
    if not np.linalg.eigvalsh(covariance + covariance.T).min() > 0:
        raise ValueError("without_prior.covariance is none of these offsets")
    _numbers(own["values"], (size,), "without_prior.values")
    _numbers(own["by_geometry"] or [[]] * size, (size, shared), "without_prior.by_geometry")
    if own["dof"] is not None and not 0 <= _number(own["dof"]) < math.inf:
        raise ValueError("without_prior.dof is no number of degrees of freedom")
    return dict(own)


def checked_sensitivity(own: Any, offsets: Sequence[Mapping[str, Any]]) -> list[list[float]] | None:
    """The same, if it is a number for each two of the offsets."""
    if own is not None:
        _numbers(own, (len(offsets), len(offsets)), "accuracy.sensitivity_mm2")
    return own  # type: ignore[no-any-return]


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _numbers(rows: Any, shape: tuple[int, ...], what: str) -> Matrix:
    found = np.array(rows)
    if found.shape != shape or found.dtype.kind not in "if" or not np.isfinite(found).all():
        raise ValueError(f"{what} has not a finite number for each offset")
    return np.asarray(found, float)
