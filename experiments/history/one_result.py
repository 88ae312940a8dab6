"""One result of an arm: which one is meant, and whether the history still holds it as it was added."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from ...model.errors import BadInput
from .content import DAMAGED
from .database import Database
from .entry import entry_of, moment
from .store import StoredResult, documents

_SHORT = 12  # digits of a hash that a person is shown


def choose(results: Sequence[StoredResult], run: str | None = None, date: str | None = None) -> StoredResult:
    """The result of the run whose SHA-256 begins with `run`, or of this date or time, or else the last one.
    BadInput where there is none, or more than one; `results` are of one arm, in the order of time."""
    if run is not None and date is not None:
        raise BadInput("--run and --date exclude each other", allowed="one of them, or neither: the last")
    if not results:
        raise BadInput("the arm has no result in the history", remedy="zerobeam history add adds them")
    if run is not None:
        found = [own for own in results if run and own.sha256.startswith(run.lower())]
    elif date is not None:
        asked, whole_day = moment(date), len(date) <= len("2026-03-31")
        found = [
            own
            for own in results
            if own.measured_at == asked or (whole_day and own.measured_at.date() == asked.date())
        ]
    else:
        found = [own for own in results if own.measured_at == results[-1].measured_at]
    if len(found) == 1:
        return found[0]
    given = run if run is not None else date if date is not None else "the last one"
    if not found:
        raise BadInput(
            "the arm has no such result",
            found=given,
            allowed=f"one of {_named(results[-5:])}",
            remedy="zerobeam history show SERIAL --json has all of them",
        )
    raise BadInput(
        "several results of the arm are meant",
        found=f"{given}: {_named(found[:5])}",
        remedy="state which one by --run",
    )


def _named(results: Sequence[StoredResult]) -> str:
    return ", ".join(f"{own.sha256[:_SHORT]} ({own.measured_at:%Y-%m-%d})" for own in results)


def whole_answer(history: Database, own: StoredResult) -> dict[str, Any]:
    """The whole result.json of a result. BadInput where the history was altered: where that is not the text
    that was added, or says otherwise than the row of the result."""
    try:
        ((_, text),) = documents(history, [own.sha256])
        entry = entry_of(text, Path(own.run), own.serial, own.measured_at.isoformat())
    except (*DAMAGED, zlib.error, BadInput):
        raise _altered(own, "its document is missing or damaged") from None
    kept = (field.name for field in fields(StoredResult))
    differing = [name for name in kept if getattr(entry, name) != getattr(own, name)]
    if differing:
        raise _altered(own, f"its row and its document differ in {', '.join(differing)}")
    answer: dict[str, Any] = json.loads(text)
    return answer


def _altered(own: StoredResult, what: str) -> BadInput:
    return BadInput(
        "the history was altered",
        found=f"result of run {own.sha256[:_SHORT]}…: {what}",
        remedy="restore a backup (zerobeam history restore), or add its result.json anew with --replace",
    )
