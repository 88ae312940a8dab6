"""What a history counts with: offsets, their covariance, what they do to the TCP; checked as it is read.

The same of a result.json that is added and of a row of the database, either of which may be damaged.
Whatever is wrong raises one of `DAMAGED`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Annotated, Any, Literal, cast, get_args

import numpy as np
from pydantic import AfterValidator

from ...analysis.answer.answer_message import Grade, May
from ...analysis.covariance import OffsetsWithoutPrior
from ...analysis.row import ParameterRow
from ...analysis.status import Verdict, has_numbers
from ...model.arrays import Matrix
from ...model.errors import UnsoundResult
from ...model.records import if_any, internal, it, or_null, read, record

Moment = Annotated[
    datetime,
    AfterValidator(lambda when: when.astimezone(UTC).replace(tzinfo=None) if when.tzinfo else when),
]
What = Literal["collision", "motor", "mastering", "other"]
DAMAGED = (KeyError, TypeError, ValueError, AttributeError, ArithmeticError)


@dataclass(frozen=True)
class Arm:
    """An arm, and what the history has of it."""

    serial: str
    model: str
    vendor: str | None
    results: int
    first: datetime | None
    last: datetime | None
    verdict: Verdict | None
    sha256: str | None = None  # of the run of the last result


@record
class StoredResult:
    """A result in the history; `offsets`, `without_prior`, `sensitivity_mm2` as of its result.json.
    `grade` and `may` are what it is worth, where that was read."""

    sha256: Annotated[str, it("SHA-256 of the run")]
    serial: Annotated[str, it("serial number of the arm")]
    model: Annotated[str, it("name of the robot")]
    measured_at: Annotated[Moment, it("when the run was measured, UTC")]
    instrument: Annotated[str, it("null where the run does not state it"), or_null]
    operator: Annotated[str, it("null where the run does not state it"), or_null]
    run: Annotated[str, it("name of the run file")]
    shots: Annotated[int, it("number of measurements")]
    verdict: Annotated[Verdict, it("of the result")]
    made_by: Annotated[str, it("the version that made the result", name="zerobeam")]
    document_sha256: Annotated[str, it("SHA-256 of the whole result.json")]
    offsets: Annotated[tuple[ParameterRow, ...], it("rows as in the result; null what is not determined")]
    without_prior: Annotated[OffsetsWithoutPrior | None, it("as in the result")]
    sensitivity_mm2: Annotated[list[list[float]] | None, internal]
    grade: Annotated[
        Grade | None,
        it(
            "how the result is coloured (`message.grade`): a pass that nothing is to be entered by is"
            " `weak`, one of a simulated run `held`"
        ),
        if_any,
    ] = field(default=None, kw_only=True)
    may: Annotated[May | None, it("`message.may` of the result: `enter`, `certify`, `export`"), if_any] = (
        field(default=None, kw_only=True)
    )


@record
class Event:
    """What happened to an arm: `at` is UTC without a zone."""

    serial: Annotated[str, it("serial number of the arm")]
    model: Annotated[str, it("name of the robot")]
    at: Annotated[Moment, it("when, UTC")]
    what: Annotated[What, it("what happened")]
    note: Annotated[str, it("null where there is none"), or_null]


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


def checked_verdict(value: object) -> Verdict:
    """The same verdict."""
    if value not in get_args(Verdict):
        raise ValueError(f"verdict {value!r}")
    return cast(Verdict, value)


def checked_moment(value: object) -> datetime:
    """A time of the database: PostgreSQL has it as such, SQLite as text."""
    when = value if isinstance(value, datetime) else datetime.fromisoformat(checked_text(value))
    if when.tzinfo is not None:
        raise ValueError(f"{when} has a zone")
    return when


def checked_offset(row: object) -> ParameterRow:
    """The row of an offset, with all that its status promises."""
    offset = read(ParameterRow, row)
    try:
        offset.require_whole()
    except UnsoundResult as error:
        raise ValueError(str(error)) from None
    return offset


def checked_without_prior(
    content: Mapping[str, Any] | None, offsets: Sequence[ParameterRow]
) -> OffsetsWithoutPrior | None:
    """The same, if its shapes are right and all of it is determined."""
    if content is None:
        return None
    free = read(OffsetsWithoutPrior, content)
    size, shared = len(free.names), len(free.geometry)
    allowed = {offset.name for offset in offsets if has_numbers(offset.status)}
    sizes = {size, len(free.values), len(free.units), len(set(free.names))}
    if not size or len(sizes) > 1 or not set(free.names) <= allowed:
        raise ValueError("without_prior names what is not determined, or not all of it has a value")
    covariance = _numbers(free.covariance, (size, size), "without_prior.covariance")
    if not np.linalg.eigvalsh(covariance + covariance.T).min() > 0:
        raise ValueError("without_prior.covariance is none of these offsets")
    _numbers(free.values, (size,), "without_prior.values")
    _numbers(free.by_geometry or [[]] * size, (size, shared), "without_prior.by_geometry")
    if free.dof is not None and not 0 <= _number(free.dof) < math.inf:
        raise ValueError("without_prior.dof is no number of degrees of freedom")
    return free


def checked_sensitivity(matrix: Any, offsets: Sequence[ParameterRow]) -> list[list[float]] | None:
    """The same, if it is a number for each two of the offsets."""
    if matrix is not None:
        _numbers(matrix, (len(offsets), len(offsets)), "accuracy.sensitivity_mm2")
    return matrix  # type: ignore[no-any-return]


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(f"{value!r} is no number")
    return float(value)


def _numbers(rows: Any, shape: tuple[int, ...], what: str) -> Matrix:
    numbers = np.array(rows)
    if numbers.shape != shape or numbers.dtype.kind not in "if" or not np.isfinite(numbers).all():
        raise ValueError(f"{what} has not a finite number for each offset")
    return np.asarray(numbers, float)
