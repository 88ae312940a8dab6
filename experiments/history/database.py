"""A history's database: an SQLite file or PostgreSQL, opened, migrated, copied.

A transaction that writes takes SQLite's lock when it begins, so that two writers wait for each other and
neither fails halfway; readers see the state at their beginning (write-ahead log). A process that is killed
leaves the database as before its transaction.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import platformdirs
import sqlalchemy as sa
from sqlalchemy.exc import DBAPIError, SQLAlchemyError
from sqlalchemy.pool import NullPool

from ...model.errors import BadInput, missing_extra
from ...model.paths.confinement import require_within
from . import tables

VARIABLE = "ZEROBEAM_HISTORY"
_BUSY_S = 60  # how long a writer waits for another
_ROWS = 500  # that are copied at once
_MIGRATIONS = Path(__file__).parent / "migrations"
_LOCK = 0x7A65726F  # PostgreSQL: of the session that migrates


@dataclass(frozen=True, eq=False)
class Database:
    """An open history; `name` is what messages call it (without a password)."""

    engine: sa.Engine
    name: str

    @contextmanager
    def reading(self) -> Iterator[sa.Connection]:
        """A transaction that reads."""
        with self._told(), self.engine.connect() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[sa.Connection]:
        """A transaction that writes: whole, or not at all."""
        with self._told(), self.engine.execution_options(writes=True).begin() as connection:
            yield connection

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except DBAPIError as error:
            raise self.unusable(error) from error

    def unusable(self, error: SQLAlchemyError) -> BadInput:
        """The error of the database as a message."""
        reason = str(getattr(error, "orig", None) or error).strip().splitlines()
        return BadInput(
            "the history cannot be used",
            found=f"{self.name}: {reason[0] if reason else type(error).__name__}",
            allowed="an SQLite file, or postgresql://user@host/database",
            remedy=f"state the database by --db or {VARIABLE}",
        )


def open_history(url: str | None = None, *, create: bool = False) -> Database:
    """The history at `url` (or ZEROBEAM_HISTORY, or the SQLite file of this user), its schema up to date.

    With `create` a history that is not there is made; one of an earlier version is always migrated. Raises
    BadInput where there is none, where it is of a newer schema, or no database of ours.
    """
    made = _engine(url or os.environ.get(VARIABLE) or str(default_file()), create)
    with made._told():
        _bring_up(made, create)
    return made


def default_file() -> Path:
    """Where the history is if nobody says otherwise."""
    return Path(platformdirs.user_data_path("zerobeam")) / "history.sqlite"


def back_up(source: Database, file: Path, *, force: bool = False) -> int:
    """Copy everything into a new SQLite file, whole or not at all; returns the number of results.

    Raises BadInput where the file exists, unless `force`d.
    """
    if file.exists() and not force:
        raise BadInput("the file exists", file=file, remedy="name another, or replace it with --force")
    try:
        folder = file.resolve().parent
        number, beside = tempfile.mkstemp(prefix=".zerobeam-new-", suffix=".sqlite", dir=folder)
        os.close(number)
    except OSError as error:
        raise BadInput(f"the file cannot be written: {error.strerror}", file=file) from error
    try:
        target = _engine(beside, True, journal="DELETE")
        with target._told():
            _bring_up(target, True)
        copied = _copy(source, target)
        target.engine.dispose()
        os.replace(beside, file)
    finally:
        Path(beside).unlink(missing_ok=True)
    return copied


def restore(file: Path, target: Database) -> int:
    """Copy a backup into an empty history, whole or not at all; returns the number of results."""
    if not file.is_file():
        raise BadInput("there is no such file", file=file)
    source = _engine(str(file), False, journal=None)
    with source._told():
        _bring_up(source, False)
    with target.reading() as connection:
        held = connection.scalar(sa.select(sa.func.count()).select_from(tables.arm))
    if held:
        raise BadInput(
            "the history is not empty: a backup is restored into an empty one",
            found=f"{held} arms in {target.name}",
            remedy="name a new database by --db",
        )
    return _copy(source, target)


def _copy(source: Database, target: Database) -> int:
    with source.reading() as old, target.writing() as new:
        if old.dialect.name == "postgresql":
            old.execute(sa.text("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ, READ ONLY"))
        for table in tables.metadata.sorted_tables:
            rows = old.execution_options(yield_per=_ROWS).execute(sa.select(table)).mappings()
            for part in rows.partitions(_ROWS):
                new.execute(sa.insert(table), [dict(row) for row in part])
        count = new.scalar(sa.select(sa.func.count()).select_from(tables.result))
    return int(count or 0)


def _engine(stated: str, create: bool, journal: str | None = "WAL") -> Database:
    if "://" not in stated:
        return _sqlite(Path(stated), create, journal)
    try:
        url = sa.make_url(stated)
    except SQLAlchemyError:
        raise _no_url("what is stated is no URL of a database") from None
    if url.get_backend_name() == "sqlite":
        if not url.database:
            raise _no_url("an SQLite history is a file")
        return _sqlite(Path(url.database), create, journal)
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


def _sqlite(file: Path, create: bool, journal: str | None) -> Database:
    require_within(file)
    if create:
        try:
            file.resolve().parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(f"the history cannot be written: {error.strerror}", file=file) from error
    elif not file.is_file():
        raise BadInput(
            "there is no history here yet",
            found=str(file),
            remedy="zerobeam history add RESULT makes one; --db names another",
        )
    engine = sa.create_engine(
        sa.URL.create("sqlite", database=str(file)), poolclass=NullPool, connect_args={"timeout": _BUSY_S}
    )

    @sa.event.listens_for(engine, "connect")
    def _set_up(connection: Any, _: object) -> None:
        connection.isolation_level = None  # transactions begin below, not when Python's module thinks fit
        connection.execute("PRAGMA foreign_keys = ON")
        connection.execute("PRAGMA synchronous = FULL")
        if journal is not None and connection.execute("PRAGMA journal_mode").fetchone()[0] != journal.lower():
            connection.execute(f"PRAGMA journal_mode = {journal}")

    @sa.event.listens_for(engine, "begin")
    def _begin(connection: sa.Connection) -> None:
        writes = connection.get_execution_options().get("writes")
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return Database(engine, str(file))


def _bring_up(made: Database, create: bool) -> None:
    """Make the schema that of this version; BadInput where that cannot be."""
    with made.engine.connect() as connection:
        found = _revision(connection)
    if found == tables.REVISION:
        return
    if found is None and not create:
        raise BadInput(
            "there is no history in this database",
            found=made.name,
            remedy="zerobeam history add RESULT makes one; --db names another",
        )
    from alembic import command
    from alembic.config import Config
    from alembic.script import ScriptDirectory
    from alembic.util import CommandError

    config = Config()
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    scripts = ScriptDirectory.from_config(config)
    with made.writing() as connection:
        if connection.dialect.name == "postgresql":
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_LOCK)))
        found = _revision(connection)  # another process may have been first
        try:
            if found is not None:
                scripts.get_revision(found)
        except CommandError:
            raise BadInput(
                "the history was made by a newer version of zerobeam",
                found=f"schema {found} in {made.name}",
                allowed=f"schema {tables.REVISION} or earlier",
                remedy="update zerobeam, here too",
            ) from None
        if found is None and (foreign := sa.inspect(connection).get_table_names()):
            raise BadInput(
                "the database holds other things",
                found=f"{', '.join(sorted(foreign)[:3])} in {made.name}",
                allowed="an empty database, or a history",
                remedy="name another by --db",
            )
        if found != tables.REVISION:
            config.attributes["connection"] = connection
            command.upgrade(config, "head")


def _revision(connection: sa.Connection) -> str | None:
    if not sa.inspect(connection).has_table("alembic_version"):
        return None
    found = connection.scalar(sa.text("SELECT version_num FROM alembic_version"))
    return None if found is None else str(found)
