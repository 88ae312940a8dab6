"""What is asked of a history: results and events added, arms and results found."""

from __future__ import annotations

import dataclasses
import json
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from types import GenericAlias
from typing import Annotated, Any, Literal, get_args

import sqlalchemy as sa
from pydantic import Field
from sqlalchemy.dialects import postgresql, sqlite

from ...analysis.answer.answer_message import Message
from ...analysis.answer.result import Result, parse_result
from ...analysis.covariance import OffsetsWithoutPrior
from ...analysis.row import ParameterRow
from ...analysis.status import Verdict
from ...model.errors import BadInput
from ...model.files.run import MADE_OF
from ...model.parsing.reading import LARGEST_RECORDING, did_you_mean
from ...model.records import read, to_json
from ...words.message import read_message
from ...words.provenance import is_simulated, made_of
from .database import Database, arm, document, event, result
from .stored_result import (
    DAMAGED,
    Arm,
    Entry,
    Event,
    StoredResult,
    What,
    entry_of,
    is_day,
    last_of,
    moment,
    parsed,
)

Outcome = Literal["added", "replaced", "already there", "refused"]

# Hears of a result or an event that cannot be read.
Damaged = Callable[[BadInput], None]

_ANEW = ", or add its result.json anew with --replace"
_SHORT = 12  # digits of a hash that a person is shown
_LEVEL = 1  # of the compression: the higher ones take most of the time of adding
_TEXTS = ("sha256", "serial", "model", "instrument", "operator", "run", "made_by", "document_sha256")
_Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
_PLAIN: Any = {**dict.fromkeys(_TEXTS, str), "shots": int, "verdict": Verdict}  # columns that are as they are
_IN_JSON: Any = {
    "offsets": tuple[ParameterRow, ...],
    "without_prior": OffsetsWithoutPrior | None,
    "sensitivity_mm2": tuple[tuple[_Number, ...], ...] | None,
}
_PLAIN_ROW: Any = GenericAlias(tuple, tuple(_PLAIN.values()))
_SAME = ("serial", "model", "verdict", "measured_at")  # of two results that are one, besides their numbers
# As the database has it: where SQLAlchemy cannot read a date, no row of a query could be read.
_AS_TEXT = sa.type_coerce(result.c.measured_at, sa.String).label("measured_at")
_DIGITS = 1e-9  # to which numbers agree: another order of the same sums gives another 15th digit
_VERDICT: Any = Verdict
# In the order of time; of several of one time the gravest stands for the last.
_GRAVITY = sa.case(
    {each: number for number, each in enumerate(get_args(Verdict))}, value=result.c.verdict, else_=-1
)
_ORDER = (result.c.measured_at, _GRAVITY, result.c.sha256)
Values = dict[str, Any]  # of a row of a table, by its columns


def add(history: Database, entries: Sequence[Entry], *, replace: bool = False) -> list[Outcome]:
    """Add results in one transaction, each once by the hash of its run; what became of each.

    `already there`: a result with the same time and verdict, and the same offsets to nine digits. `refused`:
    another result of that run is there, made otherwise, of another time or arm; with `replace` this one takes
    its place, unless it is of another arm. So is a row or a document mended that was damaged.
    """
    outcomes: dict[int, Outcome] = {}
    first = {entry.sha256: entry for entry in reversed(entries)}
    with history.writing() as connection:
        new = [entry for sha256, entry in first.items() if _held(connection, sha256) is None]
        vendors = {(entry.serial, entry.model): entry.vendor for entry in new}
        # In the order of their keys, so that no two writers wait for each other's.
        for (serial, model), vendor in sorted(vendors.items()):
            _inserted(connection, arm, {"serial": serial, "model": model, "vendor": vendor})
        for number in sorted(range(len(entries)), key=lambda k: entries[k].sha256):
            outcomes[number] = _added(connection, entries[number], replace)
    return [outcomes[number] for number in range(len(entries))]


def _added(connection: sa.Connection, entry: Entry, replace: bool) -> Outcome:
    row = {
        **{name: getattr(entry, name) for name in (*_PLAIN, "measured_at")},
        **{name: _json(getattr(entry, name)) for name in _IN_JSON},
        "added_at": datetime.now(UTC).replace(tzinfo=None, microsecond=0),
    }
    held = _held(connection, entry.sha256)
    if held is None and _inserted(connection, result, row):
        content = {"sha256": entry.sha256, "content": _content(entry)}
        connection.execute(sa.insert(document).values(content))
        return "added"
    held = held or _held(connection, entry.sha256)  # another writer was first
    same = held is not None and _is_same(held, row)
    if same and not replace:
        return "already there"
    if not replace or held is None or (held["serial"], held["model"]) != (entry.serial, entry.model):
        return "refused"
    connection.execute(sa.update(result).where(result.c.sha256 == entry.sha256).values(row))
    content = {"content": _content(entry)}
    connection.execute(sa.update(document).where(document.c.sha256 == entry.sha256).values(content))
    return "already there" if same else "replaced"


def _json(value: object) -> str | None:
    return None if value is None else json.dumps(to_json(value))


def _content(entry: Entry) -> bytes:
    text = entry.text.encode()
    return zlib.compress(text, _LEVEL) + (b"" if _has_more(text) else _NO_MORE)


def _held(connection: sa.Connection, sha256: str) -> Values | None:
    """What says which result a run has in the history; None where it has none."""
    names = ("serial", "model", "verdict", "offsets", "without_prior")
    query = sa.select(*(result.c[name] for name in names), _AS_TEXT)
    row = connection.execute(query.where(result.c.sha256 == sha256)).mappings().first()
    if row is None:
        return None
    try:
        return {**row, "measured_at": _moment_of(row["measured_at"])}
    except DAMAGED:
        return {**row, "measured_at": None}


def _is_same(one: Values, other: Values) -> bool:
    """Whether two rows of a run are of one result."""
    if any(one[name] != other[name] for name in _SAME):
        return False
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
    if isinstance(value, list | tuple):
        return [_without_numbers(one, numbers) for one in value]
    if isinstance(value, dict):
        return {key: _without_numbers(value[key], numbers) for key in sorted(value)}
    if isinstance(value, int | float) and not isinstance(value, bool):
        numbers.append(float(value))
        return 0
    return value


def result_of(history: Database, sha256: str) -> tuple[str, str, datetime | None] | None:
    """Serial number and model of the arm that a run has a result of, by the hash of the run, and its time,
    None where that is damaged."""
    with history.reading() as connection:
        held = _held(connection, sha256)
    return None if held is None else (held["serial"], held["model"], held["measured_at"])


def add_event(history: Database, happening: Event) -> bool:
    """Log an event; False where the same one is there already."""
    try:
        happening.note.encode()
    except UnicodeEncodeError:
        raise BadInput("the note is no text", found=ascii(happening.note), allowed="UTF-8") from None
    if happening.what not in get_args(What):
        raise BadInput(
            "there is no event of this kind", found=happening.what, allowed=", ".join(get_args(What))
        )
    with history.writing() as connection:
        return _inserted(connection, event, dataclasses.asdict(happening))


def _inserted(connection: sa.Connection, table: sa.Table, row: Values) -> bool:
    """Insert a row; False where its key was there already."""
    insert: Any = {"sqlite": sqlite.insert, "postgresql": postgresql.insert}[connection.dialect.name]
    # What comes back says so: the number of rows does not with every driver.
    made = insert(table).values(row).on_conflict_do_nothing().returning(*table.primary_key)
    return connection.execute(made).first() is not None


def refuse(error: BadInput) -> None:
    """A damaged result or event: an error."""
    raise error


def arms(history: Database, damaged: Damaged = refuse) -> list[Arm]:
    """All arms by serial number, with the verdict of the last result of each; `damaged` as of `results`."""
    of: Any = {"partition_by": (result.c.serial, result.c.model)}
    order = [each.desc() for each in _ORDER]
    at = (result.c.measured_at, sa.func.min(result.c.measured_at).over(**of))
    last = sa.select(
        *(result.c[name] for name in ("serial", "model", "sha256", "verdict")),
        *(
            sa.type_coerce(when, sa.String).label(name)
            for when, name in zip(at, ("last", "first"), strict=True)
        ),
        sa.func.count().over(**of).label("results"),
        sa.func.row_number().over(**of, order_by=order).label("place"),
    ).subquery()
    query = sa.select(arm, *(last.c[name] for name in ("sha256", "verdict", "last", "first", "results")))
    same = (arm.c.serial == last.c.serial) & (arm.c.model == last.c.model) & (last.c.place == 1)
    with history.reading() as connection:
        rows = connection.execute(query.outerjoin_from(arm, last, same)).all()
    every = [_arm(history, row, damaged) for row in rows if _is_named(history, row, damaged)]
    return sorted(every, key=lambda row: (row.serial, row.model))  # a database sorts by rules of its own


def _is_named(history: Database, row: Any, damaged: Damaged) -> bool:
    """Whether the arm of a row has a name; `damaged` hears of one that has none."""
    named = isinstance(row.serial, str) and isinstance(row.model, str)
    if not named:
        error = TypeError(f"{row.serial!r}, {row.model!r} is no text")
        damaged(_damage(history, (row.serial, row.model), "the name of an arm", error))
    return named


def _arm(history: Database, row: Any, damaged: Damaged) -> Arm:
    """Of an arm with its last result: a simulated one where it has no other."""
    of = (row.serial, row.model, row.vendor)
    if row.sha256 is None:
        return Arm(*of, 0, None, None, None)
    try:
        with history.reading() as connection:
            last, simulated = _last(connection, row)
        times = _moment_of(row.first), _moment_of(last.last)
        verdict: Verdict = read(_VERDICT, json.dumps(last.verdict))
        return Arm(*of, row.results, *times, verdict, last.sha256, simulated)
    except DAMAGED:
        stored = list(results(history, of[:2], damaged))
    if not stored:
        return Arm(*of, 0, None, None, None)
    first, newest = stored[0].measured_at, last_of(stored)
    return Arm(*of, len(stored), first, newest.measured_at, newest.verdict, newest.sha256, newest.simulated)


def _last(connection: sa.Connection, row: Any) -> tuple[Any, bool]:
    """The last result of an arm whose newest is that of `row`, and whether it is a simulated one. The newest
    are read first, and no more of them than it takes."""
    if not is_simulated(_provenance(connection, row.sha256)):
        return row, False
    when = sa.type_coerce(result.c.measured_at, sa.String).label("last")
    query = sa.select(result.c.sha256, result.c.verdict, when, _TAIL).outerjoin_from(result, document)
    query = query.where(result.c.serial == row.serial, result.c.model == row.model)
    for one in connection.execute(query.order_by(*(each.desc() for each in _ORDER))).all():
        if not is_simulated(_provenance(connection, one.sha256, one.tail)):
            return one, False
    return row, True


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
    query = sa.select(*(result.c[name] for name in (*_PLAIN, *_IN_JSON)), _AS_TEXT, _TAIL)
    query = query.outerjoin_from(result, document).order_by(*_ORDER)
    with history.reading() as connection:
        every = [of] if of is not None else []
        if of is None:
            rows = connection.execute(sa.select(arm.c.serial, arm.c.model))
            every = [(row.serial, row.model) for row in rows if _is_named(history, row, damaged)]
        every.sort()  # a database sorts by rules of its own
        for serial, model in every:
            of_arm = connection.execute(query.where(result.c.serial == serial, result.c.model == model)).all()
            for row in of_arm:
                try:
                    stored = _stored(row._asdict(), _provenance(connection, row.sha256, row.tail))
                except DAMAGED as error:
                    which = f"run {str(row.run)!r}, SHA-256 {str(row.sha256)[:_SHORT]}…"
                    damaged(_damage(history, (serial, model), f"the result of {which}", error, _ANEW))
                    continue
                yield stored


# What no row has of a provenance is read where the document has any of these. Most have none, and those that
# are added now end so, behind the compressed text.
_TOLD_BY_DOCUMENT = (b'"origin"', f'"{MADE_OF}"'.encode())
_NO_MORE = b"\0no more"
_TAIL = sa.func.substr(
    document.c.content, sa.func.length(document.c.content) + 1 - len(_NO_MORE), len(_NO_MORE)
).label("tail")


def _has_more(text: bytes) -> bool:
    return any(mark in text for mark in _TOLD_BY_DOCUMENT)


def _provenance(connection: sa.Connection, sha256: str, tail: bytes | None = None) -> dict[str, object]:
    """What a document says of its run's origin that no row has; nothing where that is damaged."""
    if tail is not None and bytes(tail) == _NO_MORE:
        return {}
    try:
        packed = _packed(connection, sha256)
        text = b"" if packed is None else _unpacked(packed)
        return dict(parsed(text.decode())["inputs"]["header"]["provenance"]) if _has_more(text) else {}
    except DAMAGED:
        return {}


def _stored(row: Values, provenance: Mapping[str, object]) -> StoredResult:
    """One of `DAMAGED` where the row is not as it was added."""
    plain: Any = read(_PLAIN_ROW, [row[name] for name in _PLAIN])
    in_json: Any = {name: read(kind, row[name]) for name, kind in _IN_JSON.items()}
    return StoredResult(
        **dict(zip(_PLAIN, plain, strict=True)),
        **in_json,
        measured_at=_moment_of(row["measured_at"]),
        made_of=made_of(provenance),
        simulated=is_simulated(provenance),
    )


def _moment_of(value: Any) -> datetime:
    """A time of the database: PostgreSQL has it as such, SQLite as text."""
    when = value if isinstance(value, datetime) else datetime.fromisoformat(value)
    if when.tzinfo is not None:
        raise ValueError(f"{when} has a zone")
    return when


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
                happenings.append(read(Event, {**row._mapping, "at": _moment_of(row.at).isoformat()}))
            except DAMAGED as error:
                which = f"the event {row.what!r} of {row.at!r}"
                damaged(_damage(history, (row.serial, row.model), which, error))
    return sorted(happenings, key=lambda each: (each.serial, each.model, each.at, each.what, each.note))


def documents(history: Database, sha256: Iterable[str]) -> Iterator[tuple[str, str]]:
    """The hash of a run and the whole text of its result.json, for each of the hashes that is there. One of
    `DAMAGED` for a document that is not as it was added."""
    with history.reading() as connection:
        for run in sha256:
            packed = _packed(connection, run)
            if packed is not None:
                yield run, _unpacked(packed).decode()


def _packed(connection: sa.Connection, sha256: str) -> bytes | None:
    packed: bytes | None = connection.scalar(sa.select(document.c.content).where(document.c.sha256 == sha256))
    return packed


def _unpacked(packed: bytes) -> bytes:
    """The whole result.json of a run; one of `DAMAGED` where it is not as it was added."""
    return zlib.decompressobj().decompress(packed, LARGEST_RECORDING)


def message_of(history: Database, sha256: str | None) -> Message | None:
    """What the result of a run says, and may be used for, by its result.json; None where that is missing or
    damaged."""
    try:
        ((_, text),) = documents(history, [] if sha256 is None else [sha256])
        return read_message(parse_result(text))
    except DAMAGED:
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
        when, whole_day = moment(date), is_day(date)
        times = ((result, result.measured_at) for result in results)
        meant = [result for result, at in times if at == when or (whole_day and at.date() == when.date())]
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
    what = "its document is missing or damaged"
    try:
        ((_, text),) = documents(history, [stored.sha256])
        entry = entry_of(text, Path(stored.run), stored.serial, stored.measured_at.isoformat())
        names = [field.name for field in dataclasses.fields(StoredResult) if field.compare]
        differing = [name for name in names if getattr(entry, name) != getattr(stored, name)]
        if not differing:
            return parse_result(text)
        what = f"its row and its document differ in {', '.join(differing)}"
    except (*DAMAGED, BadInput):
        pass
    raise BadInput(
        "the history was altered",
        found=f"result of run {stored.sha256[:_SHORT]}…: {what}",
        remedy="restore a backup of the database, or add its result.json anew with --replace",
    )
