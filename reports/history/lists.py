"""The arms of a history and the results of one, as tables, rows of CSV and JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from typing import Any

from ...experiments.history.store import Arm, Event, StoredResult
from ...words import numbers
from ...words.result_json import one_line
from ...words.wording import clipped, counted, label, shown
from ..style.blocks import Cell, Table, row_of, table_of

SCHEMA = "zerobeam/history/1"
_NONE = "none"


def day(when: datetime | None) -> str:
    """The date of a time, with hours and minutes (UTC) where they are stated."""
    if when is None:
        return _NONE
    return when.strftime("%Y-%m-%d" if (when.hour, when.minute) == (0, 0) else "%Y-%m-%d %H:%M")


def utc(when: datetime) -> str:
    """For programs: ISO 8601 with the zone."""
    return when.replace(tzinfo=UTC).isoformat()


def arms_table(arms: Sequence[Arm]) -> Table:
    """Every arm with its last result."""
    heads = ("arm", "model", "results", "last", "verdict")
    columns = [(head, "right" if head == "results" else "left") for head in heads]
    rows = [
        row_of(
            clipped(own.serial, 30),
            clipped(own.model, 24),
            str(own.results),
            day(own.last),
            _verdict(own.verdict),
            tone="" if own.verdict in ("pass", None) else "weak",
        )
        for own in arms
    ]
    return table_of(f"{counted(len(arms), 'arm')}, by serial number", columns, rows)


def results_table(results: Sequence[StoredResult]) -> Table:
    """The results of an arm in the order of time: an offset a column."""
    names = offset_names(results)
    columns = [("date", "left"), ("verdict", "left"), *((label(name), "right") for name in names)]
    rows = [
        row_of(
            day(own.measured_at),
            _verdict(own.verdict),
            *(_offset(own, name) for name in names),
            tone="" if own.verdict == "pass" else "weak",
        )
        for own in results
    ]
    return table_of(f"{counted(len(results), 'result')}, ± standard uncertainty", columns, rows)


def offset_names(results: Iterable[StoredResult]) -> list[str]:
    """The offsets that any of the results estimates, joint 1 first."""
    found = {row["name"]: None for own in results for row in own.offsets if not row["held"]}
    return sorted(found, key=lambda name: (len(name), name))


def events_table(events: Sequence[Event]) -> Table | None:
    """The logged events; None where there is none."""
    rows = [row_of(day(own.at), own.what, shown(own.note)) for own in events]
    columns = [("date", "left"), ("event", "left"), ("note", "left")]
    return table_of("Events", columns, rows) if rows else None


def result_json(own: StoredResult) -> dict[str, Any]:
    """A result for programs."""
    return {
        "sha256": own.sha256,
        "serial": own.serial,
        "model": own.model,
        "measured_at": utc(own.measured_at),
        "instrument": own.instrument or None,
        "operator": own.operator or None,
        "run": own.run,
        "shots": own.shots,
        "verdict": own.verdict,
        "zerobeam": own.made_by,
        "document_sha256": own.document_sha256,
        "offsets": own.offsets,
        "without_prior": own.without_prior,
    }


def history_text(results: Iterable[StoredResult], events: Iterable[Event] | None = None) -> Iterator[str]:
    """Results, and events where they are given, as JSON in pieces: a line each."""
    yield f'{{\n "schema": "{SCHEMA}",\n "results": '
    yield from _listed(map(result_json, results))
    if events is not None:
        yield ',\n "events": '
        yield from _listed(map(event_json, events))
    yield "\n}\n"


def _listed(rows: Iterable[dict[str, Any]]) -> Iterator[str]:
    between = "[\n  "
    for row in rows:
        yield between + one_line(row)
        between = ",\n  "
    yield "[]" if between[0] == "[" else "\n ]"


def event_json(own: Event) -> dict[str, Any]:
    """An event for programs."""
    return {
        "serial": own.serial,
        "model": own.model,
        "at": utc(own.at),
        "what": own.what,
        "note": own.note or None,
    }


def offset_rows(results: Iterable[StoredResult]) -> Iterator[dict[str, object]]:
    """A row for each result and offset."""
    for own in results:
        for row in own.offsets:
            low, high = row["interval95"] or (None, None)
            yield {
                "serial": own.serial,
                "model": own.model,
                "measured_at": utc(own.measured_at),
                "instrument": own.instrument or None,
                "operator": own.operator or None,
                "run": own.run,
                "sha256": own.sha256,
                "verdict": own.verdict,
                "offset": row["name"],
                "unit": row["unit"],
                "status": row["status"],
                "estimate": row["estimate"],
                "std": row["std"],
                "low95": low,
                "high95": high,
            }


def _verdict(verdict: str | None) -> str:
    return _NONE if verdict is None else verdict


def _offset(own: StoredResult, name: str) -> str | Cell:
    for row in own.offsets:
        if row["name"] != name:
            continue
        if row["status"] in ("held", "unidentifiable"):
            return Cell(row["status"], mark=row["status"])
        text = f"{numbers.estimate(row['estimate'], row['std'])} ± {numbers.spread(row['std'], row['unit'])}"
        return Cell(text, mark="" if row["status"] == "identified" else row["status"])
    return "not given"
