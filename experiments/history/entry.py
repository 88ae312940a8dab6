"""A result as a history keeps it: from a result.json, or from a run that is solved here."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ...model.errors import BadInput
from ...model.files.reading import LARGEST_RECORDING, read_text
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
    StoredCovariance,
    StoredOffset,
    checked_offset,
    checked_sensitivity,
    checked_text,
    checked_verdict,
    checked_without_prior,
    parsed,
)

RESULT_FILE = "result.json"

# The arm (serial number, model) whose result a run has already, by the hash of the run; None without one.
Held = Callable[[str], tuple[str, str] | None]


@dataclass(frozen=True, eq=False)
class Entry:
    """A result, ready to be added. `offsets` are the rows of its offsets, `measured_at` is in UTC, without a
    zone; `text` is the whole result.json."""

    sha256: str
    serial: str
    model: str
    vendor: str | None
    measured_at: datetime
    instrument: str
    operator: str
    run: str
    shots: int
    verdict: str
    offsets: list[StoredOffset]
    without_prior: StoredCovariance | None
    sensitivity_mm2: list[list[float]] | None
    made_by: str
    text: str

    @property
    def document_sha256(self) -> str:
        """Of the whole result."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def files_of(given: Sequence[Path]) -> Iterator[Path]:
    """The files given, and of a folder every result.json in it and below."""
    for path in given:
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
        from ...words.result_json import dumps, to_json

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
    from ...analysis.result import RESULT_SCHEMA

    try:
        answer = parsed(text)
        if answer["schema"] != RESULT_SCHEMA:
            raise ValueError(f"schema {answer['schema']!r}")
        origin = _origin(answer["inputs"]["header"].get("provenance", {}), path, serial, when)
        return _entry(answer, text, origin)
    except DAMAGED as error:
        raise BadInput(
            "this is not a whole result of zerobeam",
            found=f"{type(error).__name__}: {error}",
            allowed=f"a result.json of schema {RESULT_SCHEMA}, or a run file (.jsonl)",
            remedy="make it again with zerobeam report or zerobeam analyse --json",
            file=path,
        ) from None


@dataclass(frozen=True)
class _Origin:
    serial: str
    measured_at: datetime
    operator: str
    provenance: Mapping[str, object]


def _origin(stated_by: Mapping[str, object], path: Path, serial: str | None, when: str | None) -> _Origin:
    own = by_plain_key(stated_by)
    serial = first_entry(own, KEYS[SERIAL]) or serial
    when = first_entry(own, KEYS[DATE]) or when
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
    return _Origin(serial, moment(when, path), provenance_entry(own, KEYS[OPERATOR]), own)


def _entry(answer: dict[str, Any], text: str, origin: _Origin) -> Entry:
    """One of `DAMAGED` where the answer is not a whole one."""
    inputs = answer["inputs"]
    if not re.fullmatch("[0-9a-f]{64}", inputs["sha256"]):
        raise ValueError("inputs.sha256 is no SHA-256")
    tool = "probe" if inputs["header"].get("tool", {}).get("kind") == "probe" else "laser"
    offsets = [checked_offset(row) for row in answer["parameters"] if row["group"] == "offset"]
    # A key that is not there: a result of before there was one.
    alone = checked_without_prior(answer.get("without_prior"), offsets)
    vendor = inputs.get("vendor")
    return Entry(
        sha256=inputs["sha256"],
        serial=origin.serial,
        model=checked_text(inputs["robot"]),
        vendor=None if vendor is None else checked_text(vendor),
        measured_at=origin.measured_at,
        instrument=instrument(origin.provenance, tool),
        operator=origin.operator,
        run=checked_text(inputs["run"]),
        shots=int(inputs["shots"]),
        verdict=checked_verdict(answer["verdict"]),
        offsets=offsets,
        without_prior=alone if answer["fits"]["likelihood"]["converged"] else None,
        sensitivity_mm2=checked_sensitivity(answer["accuracy"].get("sensitivity_mm2"), offsets),
        made_by=checked_text(inputs["versions"]["zerobeam"]),
        text=text,
    )


def moment(text: str, path: Path | None = None) -> datetime:
    """A date or a time (ISO 8601) as UTC without a zone; one without a zone is taken as UTC."""
    try:
        found = datetime.fromisoformat(text)
        return found.astimezone(UTC).replace(tzinfo=None) if found.tzinfo else found
    except (ValueError, OverflowError):
        raise BadInput(
            "the date cannot be read",
            found=text,
            allowed="a date (2026-03-31) or a time (2026-03-31T14:05:00+02:00) as in ISO 8601",
            file=path,
        ) from None
