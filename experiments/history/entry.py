"""A result as a history keeps it: from a result.json, or from a run that is solved here."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from ...model.errors import BadInput
from ...model.parsing.reading import LARGEST_RECORDING, read_text
from ...model.records import to_json
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
from .content import (
    DAMAGED,
    StoredResult,
    checked_offset,
    checked_sensitivity,
    checked_without_prior,
    parsed,
)

if TYPE_CHECKING:
    from ...analysis.answer.result import Result

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
    from ...analysis.answer.result import parse_result

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
    offsets = tuple(checked_offset(to_json(row)) for row in result.offsets)
    without_prior = None if result.without_prior is None else to_json(result.without_prior)
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
        without_prior=checked_without_prior(without_prior, offsets)
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
