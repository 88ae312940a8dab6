"""What is asked of a history: results and events added, arms and results found."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, get_args

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from ...analysis.answer.answer_message import Message
from ...analysis.answer.result import Result, parse_result
from ...model.errors import BadInput
from ...model.parsing.reading import LARGEST_RECORDING, did_you_mean
from ...model.records import to_json
from ...words.message import read_message
from .database import Database, arm, document, event, result
from .stored_result import (
    DAMAGED,
    Arm,
    Entry,
    Event,
    StoredResult,
    What,
    checked_moment,
    checked_offsets,
    checked_sensitivity,
    checked_text,
    checked_verdict,
    checked_without_prior,
    entry_of,
    moment,
    parsed,
)

Outcome = Literal["added", "replaced", "already there", "refused"]

# Hears of a result or an event that cannot be read.
Damaged = Callable[[BadInput], None]

_ANEW = ", or add its result.json anew with --replace"
_SHORT = 12  # digits of a hash that a person is shown
_LEVEL = 1  # of the compression: the higher ones take most of the time of adding
_ROW = (
    *("sha256", "serial", "model", "measured_at", "instrument", "operator", "run", "shots", "verdict"),
    *("made_by", "document_sha256"),
)
_SAME = ("serial", "model", "verdict")  # of two results that are one, besides their numbers
_DIGITS = 1e-9  # to which numbers agree: another order of the same sums gives another 15th digit
_ASKED_AT_ONCE = 500
Values = dict[str, Any]  # of a row of a table, by its columns


def add(history: Database, entries: Sequence[Entry], *, replace: bool = False) -> list[Outcome]:
    """Add results in one transaction, each once by the hash of its run; what became of each.

    `already there`: a result with the same verdict, and the same offsets to nine digits. `refused`: another
    result of that run is there, made otherwise or for another arm; with `replace` this one takes its place,
    unless it is of another arm. So is a row or a document mended that was damaged.
    """
    rows = [_row(entry) for entry in entries]
    with history.writing() as connection:
        held = _held(connection, [row["sha256"] for row in rows])
        added = _inserted_all(connection, {entry.sha256: entry for entry in reversed(entries)}, rows, held)
        outcomes: list[Outcome] = []
        for entry, row in zip(entries, rows, strict=True):
            if entry.sha256 in added:
                added.remove(entry.sha256)
                held[entry.sha256] = row
                outcomes.append("added")
            else:
                outcomes.append(_add_again(connection, entry, row, held, replace))
    return outcomes


def _row(entry: Entry) -> Values:
    return {
        **{name: getattr(entry, name) for name in _ROW},
        "added_at": datetime.now(UTC).replace(tzinfo=None, microsecond=0),
        "offsets": json.dumps(to_json(entry.offsets)),
        "without_prior": entry.without_prior and json.dumps(to_json(entry.without_prior)),
        "sensitivity_mm2": entry.sensitivity_mm2 and json.dumps(entry.sensitivity_mm2),
    }


def _content(entry: Entry) -> bytes:
    return zlib.compress(entry.text.encode(), _LEVEL)


def _inserted_all(
    connection: sa.Connection,
    entries: dict[str, Entry],
    rows: Sequence[Values],
    held: dict[str, Values],
) -> set[str]:
    """Insert the first row of each run that is not `held`; the runs whose row was inserted.

    What another writer inserted in between is `held` afterwards. Rows are in the order of their keys, so that
    no two writers wait for each other's.
    """
    new = {row["sha256"]: row for row in reversed(rows) if row["sha256"] not in held}
    first_entries = [entries[sha256] for sha256 in sorted(new)]
    named = {(one.serial, one.model): one.vendor for one in reversed(first_entries)}
    _inserted(
        connection,
        arm,
        [{"serial": key[0], "model": key[1], "vendor": vendor} for key, vendor in sorted(named.items())],
    )
    added = {
        sha256 for (sha256,) in _inserted(connection, result, [new[one.sha256] for one in first_entries])
    }
    held.update(_held(connection, sorted(set(new) - added)))
    texts = [{"sha256": one.sha256, "content": _content(one)} for one in first_entries if one.sha256 in added]
    if texts:
        connection.execute(sa.insert(document), texts)
    return added


def _add_again(
    connection: sa.Connection,
    entry: Entry,
    row: Values,
    held: dict[str, Values],
    replace: bool,
) -> Outcome:
    """Of a run that has a result."""
    here = held[entry.sha256]
    same = _is_same(here, row)
    if same and not replace:
        return "already there"
    if not replace or (here["serial"], here["model"]) != (entry.serial, entry.model):
        return "refused"
    connection.execute(sa.update(result).where(result.c.sha256 == entry.sha256).values(row))
    content = {"content": _content(entry)}
    connection.execute(sa.update(document).where(document.c.sha256 == entry.sha256).values(content))
    held[entry.sha256] = row
    return "already there" if same else "replaced"


def _is_same(one: Values, other: Values) -> bool:
    """Whether two rows of a run are of one result."""
    if any(one[name] != other[name] for name in _SAME):
        return False
    numbers = ("offsets", "without_prior")
    if all(one[name] == other[name] for name in numbers):
        return True
    try:
        # Of one scale are the numbers of an offset, and those of a matrix.
        groups = [
            [*parsed(row["offsets"]), *parsed(row["without_prior"] or "{}").items()] for row in (one, other)
        ]
        return len(groups[0]) == len(groups[1]) and all(map(_agree, *groups))
    except DAMAGED:
        return False


def _agree(one: Any, other: Any) -> bool:
    """Whether two values are the same but for digits of their numbers behind the ninth of the largest."""
    numbers: list[float] = []
    others: list[float] = []
    if _without_numbers(one, numbers) != _without_numbers(other, others):
        return False
    largest = max(map(abs, numbers + others), default=0.0)
    return all(abs(a - b) <= _DIGITS * largest for a, b in zip(numbers, others, strict=True))


def _without_numbers(value: Any, numbers: list[float]) -> Any:
    """The value with zeros for its numbers, which are appended to `numbers`."""
    match value:
        case bool():
            return value
        case int() | float():
            numbers.append(float(value))
            return 0
        case list() | tuple():
            return [_without_numbers(one, numbers) for one in value]
        case dict():
            return {key: _without_numbers(value[key], numbers) for key in sorted(value)}
    return value


def _held(connection: sa.Connection, runs: Sequence[str]) -> dict[str, Values]:
    """What says which result each of the runs has in the history, of those that have one."""
    compared = (*_SAME, "offsets", "without_prior")
    query = sa.select(result.c.sha256, *(result.c[name] for name in compared))
    held: dict[str, Values] = {}
    for start in range(0, len(runs), _ASKED_AT_ONCE):
        part = query.where(result.c.sha256.in_(runs[start : start + _ASKED_AT_ONCE]))
        held.update((row["sha256"], dict(row)) for row in connection.execute(part).mappings())
    return held


def arm_of(history: Database, sha256: str) -> tuple[str, str] | None:
    """The arm that a run has a result of, by the hash of the run."""
    with history.reading() as connection:
        row = connection.execute(
            sa.select(result.c.serial, result.c.model).where(result.c.sha256 == sha256)
        ).first()
    return None if row is None else (row.serial, row.model)


def add_event(history: Database, happening: Event) -> bool:
    """Log an event; False where the same one is there already."""
    try:
        checked_text(happening.note)
    except UnicodeEncodeError:
        raise BadInput("the note is no text", found=ascii(happening.note), allowed="UTF-8") from None
    if happening.what not in get_args(What):
        raise BadInput(
            "there is no event of this kind", found=happening.what, allowed=", ".join(get_args(What))
        )
    with history.writing() as connection:
        return bool(_inserted(connection, event, [asdict(happening)]))


def _inserted(connection: sa.Connection, table: sa.Table, rows: list[Values]) -> list[Any]:
    """Insert rows; the keys of those whose key was not there already."""
    if not rows:
        return []
    insert: Any = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}[connection.dialect.name]
    # What comes back says so: the number of rows does not with every driver.
    made = insert(table).on_conflict_do_nothing().returning(*table.primary_key)
    return list(connection.execute(made, rows).all())


def refuse(error: BadInput) -> None:
    """A damaged result or event: an error."""
    raise error


def arms(history: Database, damaged: Damaged = refuse) -> list[Arm]:
    """All arms by serial number, with the verdict of the last result of each; `damaged` as of `results`."""
    at = sa.type_coerce(result.c.measured_at, sa.String).label("at")
    query = sa.select(arm, result.c.sha256, result.c.verdict, at).outerjoin(
        result, (arm.c.serial == result.c.serial) & (arm.c.model == result.c.model)
    )
    by_arm: dict[tuple[str, str], list[Any]] = {}
    with history.reading() as connection:
        for row in connection.execute(query.order_by(result.c.measured_at, result.c.sha256.desc())):
            by_arm.setdefault((row.serial, row.model), []).append(row)
    named = (rows for rows in by_arm.values() if _is_named(history, rows[0], damaged))
    every = [_arm(history, rows, damaged) for rows in named]
    return sorted(every, key=lambda row: (row.serial, row.model))  # a database sorts by rules of its own


def _is_named(history: Database, row: Any, damaged: Damaged) -> bool:
    """Whether the arm of a row has a name; `damaged` hears of one that has none."""
    try:
        checked_text(row.serial)
        checked_text(row.model)
    except DAMAGED as error:
        damaged(_damage(history, (row.serial, row.model), "the name of an arm", error))
        return False
    return True


def _arm(history: Database, rows: Sequence[Any], damaged: Damaged) -> Arm:
    """Of an arm with a row for each of its results, the last one last; one row without results."""
    last, of = rows[-1], (rows[0].serial, rows[0].model, rows[0].vendor)
    if last.sha256 is None:
        return Arm(*of, 0, None, None, None)
    try:
        first, until = checked_moment(rows[0].at), checked_moment(last.at)
        return Arm(*of, len(rows), first, until, checked_verdict(last.verdict), checked_text(last.sha256))
    except DAMAGED:
        stored = list(results(history, of[:2], damaged))
    if not stored:
        return Arm(*of, 0, None, None, None)
    first, newest = stored[0].measured_at, stored[-1]
    return Arm(*of, len(stored), first, newest.measured_at, newest.verdict, newest.sha256)


def find_arm(history: Database, serial: str, model: str | None = None) -> tuple[str, str]:
    """Serial number and model of the one arm that is meant; BadInput where there is none, or several."""
    with history.reading() as connection:
        models = connection.scalars(sa.select(arm.c.model).where(arm.c.serial == serial)).all()
        if model is not None:
            models = [name for name in models if name == model]
        if len(models) == 1:
            return serial, str(models[0])
        serials = connection.scalars(sa.select(arm.c.serial).distinct()).all() if not models else []
    if models:
        raise BadInput(
            "several arms have this serial number",
            found=f"{serial}: {', '.join(sorted(map(str, models)))}",
            remedy="state which one by --model",
        )
    raise BadInput(
        "there is no such arm in the history",
        found=serial if model is None else f"{serial}, {model}",
        remedy=did_you_mean(serial, [str(serial) for serial in serials])
        or "zerobeam history list names them",
    )


def results(
    history: Database, of: tuple[str, str] | None = None, damaged: Damaged = refuse
) -> Iterator[StoredResult]:
    """The results of an arm (serial number, model), or of all, in the order of arm and time: those of one arm
    at a time are in memory. `damaged` hears of those that cannot be read."""
    columns = [result.c[name] for name in _ROW if name != "measured_at"]
    columns += [result.c[name] for name in ("offsets", "without_prior", "sensitivity_mm2")]
    # As the database has it: where SQLAlchemy cannot read a date, no row of the query could be read.
    query = sa.select(*columns, sa.type_coerce(result.c.measured_at, sa.String).label("measured_at"))
    query = query.order_by(result.c.measured_at, result.c.sha256)
    with history.reading() as connection:
        every = [of] if of is not None else []
        if of is None:
            rows = connection.execute(sa.select(arm.c.serial, arm.c.model))
            every = [(row.serial, row.model) for row in rows if _is_named(history, row, damaged)]
        every.sort()  # a database sorts by rules of its own
        for serial, model in every:
            for row in connection.execute(query.where(result.c.serial == serial, result.c.model == model)):
                try:
                    stored = _stored(row._asdict())
                except DAMAGED as error:
                    which = f"run {str(row.run)!r}, SHA-256 {str(row.sha256)[:_SHORT]}…"
                    damaged(_damage(history, (serial, model), f"the result of {which}", error, _ANEW))
                    continue
                yield stored


def _stored(row: Mapping[str, Any]) -> StoredResult:
    """One of `DAMAGED` where the row is not as it was added."""
    offsets = checked_offsets(row["offsets"])
    sensitivity = None if row["sensitivity_mm2"] is None else parsed(row["sensitivity_mm2"])
    texts: dict[str, Any] = {
        name: checked_text(row[name]) for name in _ROW if name not in ("measured_at", "shots", "verdict")
    }
    return StoredResult(
        **texts,
        measured_at=checked_moment(row["measured_at"]),
        shots=int(row["shots"]),
        verdict=checked_verdict(row["verdict"]),
        offsets=offsets,
        without_prior=checked_without_prior(row["without_prior"], offsets),
        sensitivity_mm2=checked_sensitivity(sensitivity, offsets),
    )


def _damage(
    history: Database, of: tuple[str, str], what: str, error: Exception, remedy: str = ""
) -> BadInput:
    return BadInput(
        f"the history is damaged: {what} cannot be read",
        found=f"arm {', '.join(map(str, of))} in {history.name}: {type(error).__name__}: {error}",
        remedy=f"restore a backup of the database{remedy}",
    )


def events(history: Database, of: tuple[str, str] | None = None, damaged: Damaged = refuse) -> list[Event]:
    """The events of an arm, or of all, in the order of time. `damaged` hears of those that cannot be read."""
    query = sa.select(
        *(event.c[name] for name in ("serial", "model", "what", "note")),
        sa.type_coerce(event.c.at, sa.String).label("at"),
    )
    if of is not None:
        query = query.where(event.c.serial == of[0], event.c.model == of[1])
    happenings = []
    with history.reading() as connection:
        for row in connection.execute(query):
            if not _is_named(history, row, damaged):
                continue
            try:
                if row.what not in get_args(What):
                    raise ValueError(f"there is no event {row.what!r}")
                note = checked_text(row.note)
                happenings.append(Event(row.serial, row.model, checked_moment(row.at), row.what, note))
            except DAMAGED as error:
                which = f"the event {row.what!r} of {row.at!r}"
                damaged(_damage(history, (row.serial, row.model), which, error))
    return sorted(happenings, key=lambda each: (each.serial, each.model, each.at, each.what, each.note))


def documents(history: Database, sha256: Iterable[str]) -> Iterator[tuple[str, str]]:
    """The hash of a run and the whole text of its result.json, for each of the hashes that is there. One of
    `DAMAGED` or zlib's error for a document that is not as it was added."""
    with history.reading() as connection:
        for run in sha256:
            content = connection.scalar(sa.select(document.c.content).where(document.c.sha256 == run))
            if content is not None:
                yield run, zlib.decompressobj().decompress(content, LARGEST_RECORDING).decode()


def message_of(history: Database, sha256: str | None) -> Message | None:
    """What the result of a run says, and may be used for, by its result.json; None where that is missing or
    damaged."""
    try:
        ((_, text),) = documents(history, [] if sha256 is None else [sha256])
        return read_message(parse_result(text))
    except (*DAMAGED, zlib.error):
        return None


def choose(results: Sequence[StoredResult], run: str | None = None, date: str | None = None) -> StoredResult:
    """The result of the run whose SHA-256 begins with `run`, or of this date or time, or else the last one.
    BadInput where there is none, or more than one; `results` are of one arm, in the order of time."""
    if run is not None and date is not None:
        raise BadInput("--run and --date exclude each other", allowed="one of them, or neither: the last")
    if not results:
        raise BadInput("the arm has no result in the history", remedy="zerobeam history add adds them")
    if run is not None:
        meant = [result for result in results if run and result.sha256.startswith(run.lower())]
    elif date is not None:
        moment_meant, whole_day = moment(date), len(date) <= len("2026-03-31")
        meant = [
            result
            for result in results
            if result.measured_at == moment_meant
            or (whole_day and result.measured_at.date() == moment_meant.date())
        ]
    else:
        meant = [result for result in results if result.measured_at == results[-1].measured_at]
    if len(meant) == 1:
        return meant[0]
    description = run if run is not None else date if date is not None else "the last one"
    if not meant:
        raise BadInput(
            "the arm has no such result",
            found=description,
            allowed=f"one of {_named(results[-5:])}",
            remedy="zerobeam history show SERIAL --json has all of them",
        )
    raise BadInput(
        "several results of the arm are meant",
        found=f"{description}: {_named(meant[:5])}",
        remedy="state which one by --run",
    )


def _named(results: Sequence[StoredResult]) -> str:
    return ", ".join(f"{result.sha256[:_SHORT]} ({result.measured_at:%Y-%m-%d})" for result in results)


def whole_answer(history: Database, stored: StoredResult) -> Result:
    """The whole result. BadInput where the history was altered: where that is not the text
    that was added, or says otherwise than the row of the result."""
    try:
        ((_, text),) = documents(history, [stored.sha256])
        entry = entry_of(text, Path(stored.run), stored.serial, stored.measured_at.isoformat())
    except (*DAMAGED, zlib.error, BadInput):
        raise _altered(stored, "its document is missing or damaged") from None
    kept = (field.name for field in fields(StoredResult))
    differing = [name for name in kept if getattr(entry, name) != getattr(stored, name)]
    if differing:
        raise _altered(stored, f"its row and its document differ in {', '.join(differing)}")
    return parse_result(text)


def _altered(stored: StoredResult, what: str) -> BadInput:
    return BadInput(
        "the history was altered",
        found=f"result of run {stored.sha256[:_SHORT]}…: {what}",
        remedy="restore a backup of the database, or add its result.json anew with --replace",
    )
