"""A result as a history keeps it: of a result.json, of a run that is solved here, of a row of the database.

What a history counts with (offsets, their covariance, what they do to the TCP) is checked by the record, for
files and rows may be damaged. Whatever is wrong raises one of `DAMAGED`.
"""

from __future__ import annotations

import hashlib
import json
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator

from ...analysis.answer.answer_message import Grade, May
from ...analysis.answer.result import Result, parse_result
from ...analysis.covariance import OffsetsWithoutPrior
from ...analysis.diagnostics.accuracy import Grid
from ...analysis.row import ParameterRow
from ...analysis.status import Verdict, has_numbers
from ...model.errors import BadInput, UnsoundResult
from ...model.files.header import by_plain_key
from ...model.parsing.reading import LARGEST_RECORDING, read_text
from ...model.records import if_any, internal, it, or_null, record
from ...words.provenance import (
    DATE,
    KEYS,
    OPERATOR,
    SERIAL,
    first_entry,
    instrument,
    is_simulated,
    made_of,
    provenance_entry,
)
from ...words.wording import shown

Moment = Annotated[
    datetime,
    AfterValidator(lambda when: when.astimezone(UTC).replace(tzinfo=None) if when.tzinfo else when),
]
What = Literal["collision", "motor", "mastering", "other"]
DAMAGED = (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, UnsoundResult, zlib.error)


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
    simulated: bool = False  # the last result


@record
class StoredResult:
    """A result in the history; `offsets`, `without_prior`, `sensitivity_mm2` as of its result.json.
    `grade` and `may` are what it is worth, where that was read.

    ValueError where an offset lacks what its status promises, or the matrices are not of these offsets.
    """

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
    sensitivity_mm2: Annotated[Grid | None, internal]
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
    simulated: Annotated[bool, it("whether its provenance says that it was simulated")] = field(
        default=False, kw_only=True
    )
    # The SHA-256 of the run that this one is without some of its measurements, where both may be of one time.
    made_of: Annotated[str | None, internal] = field(default=None, kw_only=True, compare=False)

    def __post_init__(self) -> None:
        for offset in self.offsets:
            offset.require_whole()
        if self.without_prior is not None:
            _require_of(self.without_prior, self.offsets)
        square: Any = self.sensitivity_mm2
        shape: tuple[int, ...] = (len(self.offsets),) * 2
        if square is not None and (np.shape(square) != shape or any(None in row for row in square)):
            raise ValueError("accuracy.sensitivity_mm2 has not a number for each two of the offsets")


def last_of(results: Sequence[StoredResult]) -> StoredResult:
    """The last of results in their order: a simulated one where there is no other."""
    return ([one for one in results if not one.simulated] or list(results))[-1]


def _require_of(free: OffsetsWithoutPrior, offsets: Sequence[ParameterRow]) -> None:
    """ValueError unless all of it is determined, and its shapes are right."""
    size, determined = len(free.names), {row.name for row in offsets if has_numbers(row.status)}
    if not size or len(set(free.names)) < size or not determined.issuperset(free.names):
        raise ValueError("without_prior names what is not determined")
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        "values": (free.values, (size,)),
        "units": (free.units, (size,)),
        "covariance": (free.covariance, (size, size)),
        "by_geometry": (free.by_geometry or [[]] * size, (size, len(free.geometry))),
    }
    for name, (numbers, shape) in shapes.items():
        if np.shape(numbers) != shape:
            raise ValueError(f"without_prior.{name} has not a value for each offset")
    if free.dof is not None and free.dof < 0:
        raise ValueError("without_prior.dof is no number of degrees of freedom")
    covariance = np.array(free.covariance)
    try:
        np.linalg.cholesky(covariance + covariance.T)
    except np.linalg.LinAlgError:
        raise ValueError("without_prior.covariance is none of these offsets") from None


@record
class Event:
    """What happened to an arm: `at` is UTC without a zone."""

    serial: Annotated[str, it("serial number of the arm")]
    model: Annotated[str, it("name of the robot")]
    at: Annotated[Moment, it("when, UTC")]
    what: Annotated[What, it("what happened")]
    note: Annotated[str, it("null where there is none"), or_null]


def parsed(text: str) -> Any:
    """Plain JSON; ValueError for NaN and infinity, which other readers let pass where any value may be."""

    def refuse(word: str) -> None:
        raise ValueError(f"{word} is no number")

    try:
        return json.loads(text, parse_constant=refuse)
    except RecursionError:
        raise ValueError("the values are nested too deeply") from None


RESULT_FILE = "result.json"

# Of the result that a run has already, by the hash of the run: serial number, model and time; None without.
Held = Callable[[str], tuple[str, str, datetime | None] | None]


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
    provenance states none, `when` also where it states the day alone. None for a run whose result is there:
    it is not solved again. BadInput says what is wrong: that the provenance states otherwise, too."""
    if is_run(path):
        from ...analysis.analyse import analyse
        from ...model.files.run import read_run
        from ...model.records import dumps
        from ...words.sentences import to_json

        run = read_run(path)
        number, at = _origin(run.header.provenance, path, serial, when)
        _require_agreed(number, at, serial, when, path)
        if held(run.sha256) == (number, run.robot.name, at):
            return None
        text = dumps(to_json(analyse(run, seed=seed).result))
    else:
        text = read_text(path, LARGEST_RECORDING)[0]
    entry = entry_of(text, path, serial, when)
    _require_agreed(entry.serial, entry.measured_at, serial, when, path)
    return entry


def _require_agreed(number: str, at: datetime, serial: str | None, when: str | None, path: Path) -> None:
    """BadInput where the provenance states another arm or date than `serial` and `when`."""
    for key, option, differs, value in (
        ("serial", serial, serial is not None and shown(serial) != shown(number), number),
        ("when", when, when is not None and not _agrees(when, at, path), f"{at.isoformat()} (UTC)"),
    ):
        if differs:
            raise BadInput(
                f"the run states another {'serial number' if key == 'serial' else 'date'} than --{key}",
                found=f"provenance.{key} {value}, --{key} {option}",
                allowed=f"--{key} where the provenance states none",
                remedy=f"add it without --{key}; or, where the run is wrong, put provenance.{key} right in"
                " the first line of a copy of the run, and add that one",
                file=path,
            )


def _agrees(when: str, at: datetime, path: Path) -> bool:
    """Whether a result of that time is of the time or the day `when`."""
    time = moment(when, path)
    return time == at or (is_day(when) and time.date() == at.date())


def entry_of(text: str, path: Path, serial: str | None = None, when: str | None = None) -> Entry:
    """The entry of the text of a result.json; `serial` and `when` as of `read_entry`."""
    try:
        parsed(text)
        result = parse_result(text)
        return _entry(result, text, *_origin(result.inputs.provenance, path, serial, when))
    except DAMAGED as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=str(error),
            allowed="a result.json of schema zerobeam/result/1, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


def _origin(
    provenance: Mapping[str, object], path: Path, serial: str | None, when: str | None
) -> tuple[str, datetime]:
    """The serial number of the arm, and when it was measured: what the provenance states, else `serial` and
    `when`, which may also state the time of day. BadInput where either is not stated."""
    plain = by_plain_key(provenance)
    entries = (
        (first_entry(plain, KEYS[SERIAL]) or serial, "serial number of the arm", "serial"),
        (first_entry(plain, KEYS[DATE]) or when, "date of the measurements", "when"),
    )
    for value, what, key in entries:
        if not value:
            raise BadInput(
                f"the {what} is not stated",
                found=f"no provenance.{key}",
                remedy=f"state provenance.{key} in the header of the run, or add it with --{key}",
                file=path,
            )
    (arm, *_), (date, *_) = entries
    at = moment(str(date), path)
    if when is not None and is_day(str(date)) and (time := moment(when, path)).date() == at.date():
        at = time
    return str(arm), at


def _entry(result: Result, text: str, serial: str, measured_at: datetime) -> Entry:
    """ValueError where the result is not a whole one."""
    inputs, provenance = result.inputs, by_plain_key(result.inputs.provenance)
    if not re.fullmatch("[0-9a-f]{64}", inputs.sha256):
        raise ValueError("inputs.sha256 is no SHA-256")
    if result.accuracy is None:
        raise ValueError("accuracy: Field required")
    rows = [(row.name, row.unit, row.status, row.estimate, row.std, row.interval95) for row in result.offsets]
    return Entry(
        sha256=inputs.sha256,
        serial=serial,
        model=_text(inputs.robot),
        vendor=None if inputs.vendor is None else _text(inputs.vendor),
        measured_at=measured_at,
        instrument=instrument(provenance, inputs.instruments.values()),
        operator=provenance_entry(provenance, KEYS[OPERATOR]),
        run=_text(inputs.run),
        shots=inputs.shots,
        verdict=result.verdict,
        offsets=tuple(ParameterRow(*row) for row in rows),
        without_prior=result.without_prior if result.fits.likelihood.converged else None,
        sensitivity_mm2=result.accuracy.sensitivity_mm2,
        made_by=_text(inputs.versions["zerobeam"]),
        document_sha256=hashlib.sha256(text.encode()).hexdigest(),
        text=text,
        made_of=made_of(inputs.provenance),
        simulated=is_simulated(inputs.provenance),
    )


def _text(value: str) -> str:
    """The same text; ValueError where half a surrogate pair was read, which cannot be written."""
    if "\ufffd" in value:
        raise ValueError(f"{value!r} is no text")
    return value


def is_day(text: str) -> bool:
    """Whether a date without a time of day is written."""
    return len(text) <= len("2026-03-31")


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
