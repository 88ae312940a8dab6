"""A history's database: an SQLite file or PostgreSQL, its tables, and how it is opened.

Keys are natural. Times are UTC without a zone.

A transaction that writes takes SQLite's lock when it begins, so that two writers wait for each other and
neither fails halfway; readers see the state at their beginning (write-ahead log). A process that is killed
leaves the database as before its transaction. A file that is no history is not changed: it is looked at
before it is opened.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import platformdirs
import sqlalchemy as sa
from sqlalchemy import Column, DateTime, ForeignKey, ForeignKeyConstraint, String, Text
from sqlalchemy.exc import SQLAlchemyError, StatementError
from sqlalchemy.pool import NullPool

from ...model.errors import BadInput, NotWritten, missing_extra
from ...model.parsing.confinement import require_within
from ...model.parsing.reading import real_path, require_regular

VARIABLE = "ZEROBEAM_HISTORY"
# The tables below. Another schema gets another number, and `_bring_up` a step that makes it of this one.
REVISION = "0001"
_BUSY_S = 60  # how long a writer waits for another
_LOCK = 0x7A65726F  # PostgreSQL: of the session that makes the tables

metadata = sa.MetaData()

arm = sa.Table(
    "arm",
    metadata,
    Column("serial", Text, primary_key=True),
    Column("model", Text, primary_key=True),  # the name of the robot
    Column("vendor", Text),
)

# `sha256` is of the run: a run has one result. JSON in text: `offsets` the rows of the result's parameters,
# `without_prior` and `sensitivity_mm2` as in the result (docs/files-results.md), null where it has none.
result = sa.Table(
    "result",
    metadata,
    Column("sha256", String(64), primary_key=True),
    Column("serial", Text, nullable=False),
    Column("model", Text, nullable=False),
    Column("measured_at", DateTime, nullable=False),
    Column("added_at", DateTime, nullable=False),
    Column("instrument", Text, nullable=False),
    Column("operator", Text, nullable=False),
    Column("run", Text, nullable=False),
    Column("shots", sa.Integer, nullable=False),
    Column("verdict", String(16), nullable=False),
    Column("offsets", Text, nullable=False),
    Column("without_prior", Text),
    Column("sensitivity_mm2", Text),
    Column("made_by", Text, nullable=False),  # the version of zerobeam
    Column("document_sha256", String(64), nullable=False),
    ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
    sa.Index("result_of_arm", "serial", "model", "measured_at"),
)

# The whole result.json, compressed (zlib): apart, so that no query of many results reads them.
document = sa.Table(
    "document",
    metadata,
    Column("sha256", String(64), ForeignKey("result.sha256"), primary_key=True),
    Column("content", sa.LargeBinary, nullable=False),
)

event = sa.Table(
    "event",
    metadata,
    Column("serial", Text, primary_key=True),
    Column("model", Text, primary_key=True),
    Column("at", DateTime, primary_key=True),
    Column("what", String(16), primary_key=True),
    Column("note", Text, primary_key=True),
    ForeignKeyConstraint(["serial", "model"], ["arm.serial", "arm.model"]),
)

# The revision, in the table in which Alembic kept it while it made the tables: histories of then are of now.
_revision = sa.Table(
    "alembic_version",
    sa.MetaData(),
    Column("version_num", String(32), nullable=False),
    sa.PrimaryKeyConstraint("version_num", name="alembic_version_pkc"),
)


@dataclass(frozen=True, eq=False)
class Database:
    """An open history; `name` is what messages call it (without a password)."""

    engine: sa.Engine
    name: str

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A transaction that reads."""
        with self._errors(), self.engine.connect() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A transaction that writes: whole, or not at all."""
        with self._errors(), self.engine.execution_options(writes=True).begin() as connection:
            yield connection

    @contextmanager
    def _errors(self) -> Iterator[None]:
        try:
            yield
        except StatementError as error:  # of the database, or of a value that no column of it has
            raise self.unusable(error) from error

    def unusable(self, error: SQLAlchemyError) -> BadInput:
        """The error of the database as a message."""
        cause = getattr(error, "orig", None)
        reason = str(cause or error).strip().splitlines()
        where = f"{self.name}: {reason[0][:200] if reason else type(error).__name__}"
        if _is_of_the_disk(cause):
            return NotWritten(
                "the history cannot be written",
                found=where,
                remedy="make room on the disk, or make the file and its folder writable",
            )
        if _is_damage(cause):
            return BadInput(
                "the history is damaged",
                found=where,
                remedy="restore a backup of the database",
            )
        return BadInput(
            "the history cannot be used",
            found=where,
            allowed="an SQLite file, or postgresql://user@host/database",
            remedy=f"state the database by --db or {VARIABLE}",
        )


_NOT_WRITABLE = ("SQLITE_READONLY", "SQLITE_CANTOPEN")


def _is_of_the_disk(error: BaseException | None) -> bool:
    """Whether SQLite or PostgreSQL (class 53: out of resources; 58: of the system) could not write."""
    name, state = getattr(error, "sqlite_errorname", None), getattr(error, "sqlstate", None)
    disk = ("SQLITE_FULL", "SQLITE_IOERR", *_NOT_WRITABLE)
    return str(name).startswith(disk) or str(state).startswith(("53", "58", "25006"))


def _is_damage(error: BaseException | None) -> bool:
    """Whether what is stored is not what was stored: pages, tables or values."""
    name = str(getattr(error, "sqlite_errorname", None))
    damaged = ("SQLITE_CORRUPT", "SQLITE_ERROR", "SQLITE_CONSTRAINT", "SQLITE_MISMATCH")
    return isinstance(error, (TypeError, ValueError)) or name.startswith(damaged) or "decode" in str(error)


def open_history(url: str | None = None, *, create: bool = False) -> Database:
    """The history at `url` (or ZEROBEAM_HISTORY, or the SQLite file of this user).

    With `create` a history that is not there is made. Raises BadInput where there is none, where it is of a
    newer schema, or no database of ours.
    """
    made = _engine(url or os.environ.get(VARIABLE) or str(default_file()), create)
    with made._errors():
        _bring_up(made, create)
    return made


def default_file() -> Path:
    """Where the history is if nobody says otherwise."""
    return Path(platformdirs.user_data_path("zerobeam")) / "history.sqlite"


def _engine(address: str, create: bool) -> Database:
    if "://" not in address:
        return _sqlite(Path(address), create)
    try:
        url = sa.make_url(address)
    except SQLAlchemyError:
        raise _no_url("what is stated is no URL of a database") from None
    if url.get_backend_name() == "sqlite":
        if not url.database:
            raise _no_url("an SQLite history is a file")
        return _sqlite(Path(url.database), create)
    if url.get_backend_name() != "postgresql":
        raise _no_url(f"{url.get_backend_name()} is no database for a history")
    try:
        engine = sa.create_engine(url.set(drivername="postgresql+psycopg"))
    except ModuleNotFoundError:
        raise missing_extra("a history in PostgreSQL", "postgres") from None
    return Database(engine, url.render_as_string(hide_password=True))


def _no_url(what: str) -> BadInput:
    return BadInput(
        what,
        allowed="the path of an SQLite file, or postgresql://user@host/database",
        remedy=f"state it by --db or {VARIABLE}",
    )


def _sqlite(file: Path, create: bool) -> Database:
    require_within(file)
    if create:
        try:
            real_path(file).parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise NotWritten(f"the history cannot be written: {error.strerror}", file=file) from error
        if file.exists():
            require_regular(file)
    elif not file.is_file():
        raise BadInput(
            "there is no history here yet",
            found=str(file),
            remedy="zerobeam history add RESULT makes one; --db names another",
        )

    def connected() -> sqlite3.Connection:
        connection = sqlite3.connect(file, timeout=_BUSY_S)
        connection.isolation_level = None  # transactions begin below, not when Python's module thinks fit
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA synchronous = FULL")
        if connection.execute("PRAGMA journal_mode").fetchone()[0] != "wal":
            connection.execute("PRAGMA journal_mode = WAL")
        return connection

    def connected_as_may_be() -> sqlite3.Connection:
        try:
            return connected()
        except sqlite3.OperationalError as error:
            # On a medium that cannot be written a log to read by cannot be made, and nobody else writes.
            if create or not str(error.sqlite_errorname).startswith(_NOT_WRITABLE):
                raise
        return sqlite3.connect(_address(file, _how_to_look(file)), uri=True, isolation_level=None)

    engine = sa.create_engine(
        sa.URL.create("sqlite", database=str(file)), poolclass=NullPool, creator=connected_as_may_be
    )

    @sa.event.listens_for(engine, "begin")
    def _begin(connection: sa.Connection) -> None:
        writes = connection.get_execution_options().get("writes")
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return Database(engine, str(file))


def _bring_up(made: Database, create: bool) -> None:
    """Make the tables of a new history; BadInput where there is none, or one of a newer version."""
    with _looking(made) as connection:
        if _is_history(connection, made.name, create):
            return
    with made.writing() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_LOCK)))
        if not _is_history(connection, made.name, create):  # another process may have been first
            metadata.create_all(connection)
            _revision.create(connection)
            connection.execute(sa.insert(_revision).values(version_num=REVISION))


@contextmanager
def _looking(made: Database) -> Iterator[sa.Connection]:
    """A connection that changes nothing, not even the files beside an SQLite file."""
    if made.engine.dialect.name != "sqlite":
        with made.engine.connect() as connection:
            yield connection
        return
    file = Path(str(made.engine.url.database))
    name = _address(file, _how_to_look(file)) if file.exists() else ":memory:"
    engine = sa.create_engine(
        "sqlite://", creator=lambda: sqlite3.connect(name, uri=True, timeout=_BUSY_S), poolclass=NullPool
    )
    with engine.connect() as connection:
        yield connection


def _address(file: Path, how: str) -> str:
    return f"{real_path(file).as_uri()}?{how}"


def _how_to_look(file: Path) -> str:
    """SQLite makes a write-ahead log to read a file that is in this mode, and undoes a transaction that was
    cut off; it does neither with an `immutable` file, which nobody may be writing to."""
    try:
        with file.open("rb") as opened:
            logged = opened.read(20)[18:] == b"\2\2"
    except OSError as error:
        raise BadInput(f"the history cannot be read: {error.strerror}", file=file) from error
    log, journal = (file.with_name(f"{file.name}{suffix}") for suffix in ("-wal", "-journal"))
    in_use = log.exists() and log.stat().st_size > 0
    return "immutable=1" if (logged and not in_use) or journal.exists() else "mode=ro"


def _is_history(connection: sa.Connection, name: str, create: bool) -> bool:
    """Whether a history is here; False for an empty database where one is to be made. BadInput where there is
    none, something else, or a history of a newer version."""
    names = set(sa.inspect(connection).get_table_names())
    if names >= {_revision.name, arm.name, result.name}:
        revision = connection.scalar(sa.select(_revision.c.version_num))
        if revision != REVISION:
            raise BadInput(
                "the history was made by a newer version of zerobeam",
                found=f"schema {revision} in {name}",
                allowed=f"schema {REVISION} or earlier",
                remedy="update zerobeam, here too",
            )
        return True
    if not create:
        raise BadInput(
            "there is no history in this database",
            found=name,
            remedy="zerobeam history add RESULT makes one; --db names another",
        )
    if names:
        raise BadInput(
            "the database holds other things",
            found=f"{', '.join(sorted(names)[:3])} in {name}",
            allowed="an empty database, or a history",
            remedy="name another by --db",
        )
    return False
