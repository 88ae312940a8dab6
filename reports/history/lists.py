"""The arms of a history and the results of one, as tables, rows of CSV and JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from datetime import datetime

from ...analysis.answer.answer_message import Message
from ...analysis.status import Verdict
from ...experiments.history.content import Arm, Event, StoredResult
from ...experiments.history.documents import HISTORY_SCHEMA
from ...model.records import one_line, to_json
from ...words import numbers
from ...words.message import verdict_words
from ...words.wording import capital, clipped, counted, label, shown, status_words
from ..style.blocks import Cell, Table, row_of, table_of

_NONE = "none"
_MARKS: dict[Verdict, str] = {
    "misfit": "unvalidated",
    "degenerate": "unidentifiable",
    "weak": "weak",
    "pass": "identified",
}


def day(when: datetime | None) -> str:
    """The date of a time, with hours and minutes (UTC) where they are stated."""
    if when is None:
        return _NONE
    return when.strftime("%Y-%m-%d" if (when.hour, when.minute) == (0, 0) else "%Y-%m-%d %H:%M")


def arms_table(arms: Sequence[Arm], judged: Sequence[Message | None]) -> Table:
    """Every arm with its last result, and what that is worth."""
    heads = ("arm", "model", "results", "last", "verdict")
    rows = [
        row_of(
            clipped(arm.serial, 30),
            clipped(arm.model, 24),
            str(arm.results),
            day(arm.last),
            _NONE if arm.verdict is None else verdict_words(arm.verdict, worth),
            tone="" if arm.verdict is None else _tone(worth),
        )
        for arm, worth in zip(arms, judged, strict=True)
    ]
    return table_of(f"{counted(len(arms), 'arm')}, by serial number", heads, rows, "llrl")


def results_table(results: Sequence[StoredResult], judged: Sequence[Message | None]) -> Table:
    """The results of an arm in the order of time, and what each is worth: an offset a column."""
    names = offset_names(results)
    columns = ["date", "verdict", *(label(name) for name in names)]
    rows = [
        row_of(
            day(result.measured_at),
            verdict_words(result.verdict, worth),
            *(_offset(result, name) for name in names),
            tone=_tone(worth),
        )
        for result, worth in zip(results, judged, strict=True)
    ]
    return table_of(f"{counted(len(results), 'result')}, ± standard uncertainty", columns, rows, "llr")


def verdict_cell(verdict: Verdict, judged: Message | None) -> Cell:
    """The verdict of a stored result with its shape and colour, and what it is worth."""
    mark = _MARKS[verdict] if verdict != "pass" or _tone(judged) == "" else "weak"
    return Cell(capital(verdict_words(verdict, judged)), mark=mark)


def offset_names(results: Iterable[StoredResult]) -> list[str]:
    """The offsets that any of the results estimates, joint 1 first."""
    names = {row.name: None for result in results for row in result.offsets if not row.held}
    return sorted(names, key=lambda name: (len(name), name))


def events_table(events: Sequence[Event]) -> Table | None:
    """The logged events; None where there is none."""
    rows = [row_of(day(event.at), event.what, shown(event.note)) for event in events]
    columns = ["date", "event", "note"]
    return table_of("Events", columns, rows, "l") if rows else None


def history_text(
    results: Iterable[tuple[StoredResult, Message | None]], events: Iterable[Event] | None = None
) -> Iterator[str]:
    """Results with what they are worth, and events where they are given, as JSON in pieces: a line each."""
    yield f'{{\n "schema": "{HISTORY_SCHEMA}",\n "results": '
    yield from _listed(worth(*each) for each in results)
    if events is not None:
        yield ',\n "events": '
        yield from _listed(events)
    yield "\n}\n"


def worth(result: StoredResult, judged: Message | None) -> StoredResult:
    """The result with what it is worth, where that was read."""
    return result if judged is None else replace(result, grade=judged.grade, may=judged.may)


def _listed(rows: Iterable[StoredResult | Event]) -> Iterator[str]:
    between = "[\n  "
    for row in rows:
        yield between + one_line(to_json(row))
        between = ",\n  "
    yield "[]" if between[0] == "[" else "\n ]"


def offset_rows(results: Iterable[StoredResult]) -> Iterator[dict[str, object]]:
    """A row for each result and offset."""
    for result in results:
        for row in result.offsets:
            low, high = row.interval95 or (None, None)
            yield {
                "serial": result.serial,
                "model": result.model,
                "measured_at": to_json(result.measured_at),
                "instrument": result.instrument or None,
                "operator": result.operator or None,
                "run": result.run,
                "sha256": result.sha256,
                "verdict": result.verdict,
                "offset": row.name,
                "unit": row.unit,
                "status": row.status,
                "estimate": row.estimate,
                "std": row.std,
                "low95": low,
                "high95": high,
            }


def _tone(judged: Message | None) -> str:
    """Of a row: plain where the robot passed, and where no robot was measured."""
    return "" if judged is not None and judged.grade in ("pass", "held") else "weak"


def _offset(result: StoredResult, name: str) -> str | Cell:
    for row in result.offsets:
        if row.name != name:
            continue
        if row.status in ("held", "unidentifiable"):
            return Cell(status_words(row.status), mark=row.status)
        if row.estimate is None or row.std is None:
            break
        text = f"{numbers.estimate(row.estimate, row.std)} ± {numbers.spread(row.std, row.unit)}"
        return Cell(text, mark="" if row.status == "identified" else row.status)
    return "not given"
