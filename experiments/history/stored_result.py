"""A result as a history keeps it: of a result.json, of a run that is solved here, of a row of the database.

What a history counts with (offsets, their covariance, what they do to the TCP) is checked as it is read, for
either may be damaged. Whatever is wrong raises one of `DAMAGED`.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, cast, get_args

import numpy as np
from pydantic import AfterValidator

from ...analysis.answer.answer_message import Grade, May
from ...analysis.answer.result import Result, parse_result
from ...analysis.covariance import OffsetsWithoutPrior
from ...analysis.row import ParameterRow
from ...analysis.status import Verdict, has_numbers
from ...model.arrays import Matrix
from ...model.errors import BadInput, UnsoundResult
from ...model.parsing.reading import LARGEST_RECORDING, read_text
from ...model.records import if_any, internal, it, or_null, read, record
from ...words.provenance import (
    DATE,
    KEYS,
    OPERATOR,
    SERIAL,
    by_plain_key,
    first_entry,
    instrument,
    provenance_entry,
)

Moment = Annotated[
    datetime,
    AfterValidator(lambda when: when.astimezone(UTC).replace(tzinfo=None) if when.tzinfo else when),
]
What = Literal["collision", "motor", "mastering", "other"]
_ROWS: Any = tuple[ParameterRow, ...]
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


def checked_offsets(content: object) -> tuple[ParameterRow, ...]:
    """The rows of offsets, as JSON or as records, with all that the status of each promises."""
    offsets = tuple(content) if isinstance(content, tuple) else read(_ROWS, content)
    try:
        for offset in offsets:
            offset.require_whole()
    except UnsoundResult as error:
        raise ValueError(str(error)) from None
    return offsets


def checked_without_prior(
    content: str | OffsetsWithoutPrior | None, offsets: Sequence[ParameterRow]
) -> OffsetsWithoutPrior | None:
    """The same, if its shapes are right and all of it is determined."""
    if content is None:
        return None
    free = read(OffsetsWithoutPrior, content) if isinstance(content, str) else content
    size, shared = len(free.names), len(free.geometry)
    allowed = {offset.name for offset in offsets if has_numbers(offset.status)}
    sizes = {size, len(free.values), len(free.units), len(set(free.names))}
    if not size or len(sizes) > 1 or not set(free.names) <= allowed:
        raise ValueError("without_prior names what is not determined, or not all of it has a value")
    covariance = _numbers(free.covariance, (size, size), "without_prior.covariance")
    try:
        np.linalg.cholesky(covariance + covariance.T)
    except np.linalg.LinAlgError:
        raise ValueError("without_prior.covariance is none of these offsets") from None
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


RESULT_FILE = "result.json"

# The arm (serial number, model) whose result a run has already, by the hash of the run; None without one.
Held = Callable[[str], tuple[str, str] | None]


@dataclass(frozen=True)
class Entry(StoredResult):
    """A result, ready to be added; `text` is the whole result.json."""

    vendor: str | None
    text: str


def files_of(paths: Sequence[Path]) -> Iterator[Path]:
    """The files, and of a folder every result.json in it and below."""
    for path in paths:
        if path.is_dir():
            yield from sorted(path.rglob(RESULT_FILE))
        else:
            yield path


def is_run(path: Path) -> bool:
    """Whether the file is a run, that has to be solved."""
    return path.suffix != ".json"


def read_entry(
    path: Path,
    held: Held,
    *,
    serial: str | None = None,
    when: str | None = None,
    seed: int = 0,
) -> Entry | None:
    """The entry of a result file, or of a run solved as `analyse` does; `serial` and `when` where the
    provenance states none. None for a run whose result is there: it is not solved again. BadInput says what
    is wrong."""
    if is_run(path):
        from ...analysis.analyse import analyse
        from ...model.files.run import read_run
        from ...model.records import dumps
        from ...words.sentences import to_json

        run = read_run(path)
        origin = _origin(run.header.provenance, path, serial, when)
        if held(run.sha256) == (origin.serial, run.robot.name):
            return None
        text = dumps(to_json(analyse(run, seed=seed).result))
    else:
        text = read_text(path, LARGEST_RECORDING)[0]
    return entry_of(text, path, serial, when)


def entry_of(text: str, path: Path, serial: str | None = None, when: str | None = None) -> Entry:
    """The entry of the text of a result.json; `serial` and `when` as of `read_entry`."""
    try:
        parsed(text)
        result = parse_result(text)
        origin = _origin(result.inputs.provenance, path, serial, when)
        return _entry(result, text, origin)
    except DAMAGED as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=str(error),
            allowed="a result.json of schema zerobeam/result/1, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


@dataclass(frozen=True)
class _Origin:
    serial: str
    measured_at: datetime
    operator: str
    provenance: Mapping[str, object]


def _origin(provenance: Mapping[str, object], path: Path, serial: str | None, when: str | None) -> _Origin:
    provenance = by_plain_key(provenance)
    serial = first_entry(provenance, KEYS[SERIAL]) or serial
    when = first_entry(provenance, KEYS[DATE]) or when
    for value, what, key in (
        (serial, "serial number of the arm", "serial"),
        (when, "date of the measurements", "when"),
    ):
        if not value:
            raise BadInput(
                f"the {what} is not stated",
                found=f"no provenance.{key}",
                remedy=f"state provenance.{key} in the header of the run, or add it with --{key}",
                file=path,
            )
    assert serial is not None
    assert when is not None
    return _Origin(serial, moment(when, path), provenance_entry(provenance, KEYS[OPERATOR]), provenance)


def _entry(result: Result, text: str, origin: _Origin) -> Entry:
    """ValueError where the result is not a whole one."""
    inputs = result.inputs
    if not re.fullmatch("[0-9a-f]{64}", inputs.sha256):
        raise ValueError("inputs.sha256 is no SHA-256")
    offsets = checked_offsets(
        tuple(
            ParameterRow(row.name, row.unit, row.status, row.estimate, row.std, row.interval95)
            for row in result.offsets
        )
    )
    if result.accuracy is None:
        raise ValueError("accuracy: Field required")
    sensitivity = result.accuracy.sensitivity_mm2
    return Entry(
        sha256=inputs.sha256,
        serial=origin.serial,
        model=_text(inputs.robot),
        vendor=None if inputs.vendor is None else _text(inputs.vendor),
        measured_at=origin.measured_at,
        instrument=instrument(origin.provenance, inputs.instruments.values()),
        operator=origin.operator,
        run=_text(inputs.run),
        shots=inputs.shots,
        verdict=result.verdict,
        offsets=offsets,
        without_prior=checked_without_prior(result.without_prior, offsets)
        if result.fits.likelihood.converged
        else None,
        sensitivity_mm2=checked_sensitivity(sensitivity and [list(row) for row in sensitivity], offsets),
        made_by=_text(inputs.versions["zerobeam"]),
        document_sha256=hashlib.sha256(text.encode()).hexdigest(),
        text=text,
    )


def _text(value: str) -> str:
    """The same text; ValueError where half a surrogate pair was read, which cannot be written."""
    if "\ufffd" in value:
        raise ValueError(f"{value!r} is no text")
    return value


def moment(text: str, path: Path | None = None) -> datetime:
    """A date or a time (ISO 8601) as UTC without a zone; one without a zone is taken as UTC."""
    try:
        time = datetime.fromisoformat(text)
        return time.astimezone(UTC).replace(tzinfo=None) if time.tzinfo else time
    except (ValueError, OverflowError):
        raise BadInput(
            "the date cannot be read",
            found=text,
            allowed="a date (2026-03-31) or a time (2026-03-31T14:05:00+02:00) as in ISO 8601",
            file=path,
        ) from None
