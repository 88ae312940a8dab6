"""Databases of a history: made, migrated, and refused where they are not ours or newer."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
import sqlalchemy as sa

from zerobeam.experiments.history import database as tables
from zerobeam.experiments.history.database import default_file, open_history
from zerobeam.model.errors import BadInput

# What the versions that made the tables by Alembic wrote: `.schema` of a history of theirs.
BY_ALEMBIC = """
CREATE TABLE alembic_version (
    version_num VARCHAR(32) NOT NULL, CONSTRAINT alembic_version_pkc PRIMARY KEY (version_num)
);
INSERT INTO alembic_version VALUES('0001');
CREATE TABLE arm (serial TEXT NOT NULL, model TEXT NOT NULL, vendor TEXT, PRIMARY KEY (serial, model));
CREATE TABLE document (
    sha256 VARCHAR(64) NOT NULL, content BLOB NOT NULL, PRIMARY KEY (sha256),
    FOREIGN KEY(sha256) REFERENCES result (sha256)
);
CREATE TABLE event (
    serial TEXT NOT NULL, model TEXT NOT NULL, at DATETIME NOT NULL, what VARCHAR(16) NOT NULL,
    note TEXT NOT NULL, PRIMARY KEY (serial, model, at, what, note),
    FOREIGN KEY(serial, model) REFERENCES arm (serial, model)
);
CREATE TABLE result (
    sha256 VARCHAR(64) NOT NULL, serial TEXT NOT NULL, model TEXT NOT NULL, measured_at DATETIME NOT NULL,
    added_at DATETIME NOT NULL, instrument TEXT NOT NULL, operator TEXT NOT NULL, run TEXT NOT NULL,
    shots INTEGER NOT NULL, verdict VARCHAR(16) NOT NULL, offsets TEXT NOT NULL, without_prior TEXT,
    sensitivity_mm2 TEXT, made_by TEXT NOT NULL, document_sha256 VARCHAR(64) NOT NULL, PRIMARY KEY (sha256),
    FOREIGN KEY(serial, model) REFERENCES arm (serial, model)
);
CREATE INDEX result_of_arm ON result (serial, model, measured_at);
"""


def _schema(file: Path) -> dict[str, str]:
    """The statements that make the tables of a database, without blanks."""
    with closing(sqlite3.connect(file)) as opened:
        rows = opened.execute("SELECT name, sql FROM sqlite_master WHERE sql IS NOT NULL").fetchall()
    return {name: "".join(str(sql).split()) for name, sql in rows}


def test_a_history_made_by_alembic_opens_unchanged_and_a_new_one_is_the_same(tmp_path: Path) -> None:
    old, new = tmp_path / "old.sqlite", tmp_path / "new" / "history.sqlite"
    with closing(sqlite3.connect(old)) as opened, opened:
        opened.executescript("PRAGMA journal_mode = WAL;" + BY_ALEMBIC)
        opened.execute("INSERT INTO arm VALUES ('A', 'irb1600', NULL)")
    before = old.read_bytes()
    with open_history(str(old)).reading() as connection:
        assert connection.scalar(sa.select(tables.arm.c.serial)) == "A"
    assert old.read_bytes() == before
    open_history(str(new), create=True).engine.dispose()
    assert _schema(new) == _schema(old)
    with closing(sqlite3.connect(new)) as opened:
        assert opened.execute("SELECT version_num FROM alembic_version").fetchall() == [("0001",)]


def test_a_newer_history_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "history.sqlite"
    open_history(str(file), create=True)
    with closing(sqlite3.connect(file)) as own, own:
        own.execute("UPDATE alembic_version SET version_num = '0999'")
    for create in (False, True):
        with pytest.raises(BadInput, match=r"newer version[\s\S]*0999[\s\S]*update zerobeam"):
            open_history(str(file), create=create)


def everything(folder: Path) -> dict[str, bytes]:
    """All files of a folder."""
    return {file.name: file.read_bytes() for file in folder.iterdir()}


FOREIGN = {
    "rollback journal": "CREATE TABLE stock (part TEXT)",
    "write-ahead log": "PRAGMA journal_mode = WAL; CREATE TABLE stock (part TEXT)",
    "another program's migrations": "CREATE TABLE alembic_version (version_num TEXT);"
    f"INSERT INTO alembic_version VALUES ('{tables.REVISION}'); CREATE TABLE stock (part TEXT)",
    "nothing": "",
}


@pytest.mark.parametrize("content", FOREIGN.values(), ids=FOREIGN)
@pytest.mark.parametrize("create", [False, True])
def test_what_is_no_history_is_not_touched(tmp_path: Path, content: str, create: bool) -> None:
    file = tmp_path / "other.sqlite"
    file.touch()
    with closing(sqlite3.connect(file)) as own:
        own.executescript(content)
    if create and not content:
        open_history(str(file), create=True)
        return
    before = everything(tmp_path)
    with pytest.raises(BadInput, match=r"holds other things[\s\S]*stock" if create else "no history in this"):
        open_history(str(file), create=create)
    assert everything(tmp_path) == before


@pytest.mark.parametrize("mode", ["WAL", "DELETE"])
def test_what_is_no_history_is_not_touched_while_another_program_has_it(tmp_path: Path, mode: str) -> None:
    """A write-ahead log that is not in the database yet, or a transaction that has written some pages."""
    file = tmp_path / "other.sqlite"
    with closing(sqlite3.connect(file, isolation_level=None)) as own:
        own.execute(f"PRAGMA journal_mode = {mode}")
        own.execute("CREATE TABLE stock (part TEXT)")
        own.execute("PRAGMA cache_size = 1")
        own.execute("BEGIN")
        own.executemany("INSERT INTO stock VALUES (?)", [("x" * 999,)] * 99)
        before = everything(tmp_path)
        assert len(before) == {"WAL": 3, "DELETE": 2}[mode]
        for create in (False, True):
            with pytest.raises(BadInput, match="other things" if create else "no history in this"):
                open_history(str(file), create=create)
        after = everything(tmp_path)
        own.execute("COMMIT")
        assert own.execute("SELECT count(*) FROM stock").fetchone() == (99,)
    before.pop("other.sqlite-shm", None)  # SQLite's readers have their places in it
    after.pop("other.sqlite-shm", None)
    assert after == before


@pytest.mark.parametrize("mode", ["WAL", "DELETE"])
def test_a_history_is_found_in_a_write_ahead_log_too(tmp_path: Path, mode: str) -> None:
    """As a process leaves it that is killed: what it has added is in the log alone."""
    file, copied = tmp_path / "history.sqlite", tmp_path / "copied.sqlite"
    made = open_history(str(file), create=True)
    made.engine.dispose()
    with closing(sqlite3.connect(file, isolation_level=None)) as own:
        own.execute(f"PRAGMA journal_mode = {mode}")
        own.execute("INSERT INTO arm VALUES ('A', 'irb1600', NULL)")
        for suffix in ("", "-wal"):
            if (beside := file.with_name(file.name + suffix)).exists():
                copied.with_name(copied.name + suffix).write_bytes(beside.read_bytes())
    with open_history(str(copied)).reading() as connection:
        assert connection.scalar(sa.select(tables.arm.c.serial)) == "A"


def test_what_is_no_history_is_refused_and_left_as_it_was(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="no history here yet"):
        open_history(str(tmp_path / "none.sqlite"))
    text = tmp_path / "text.sqlite"
    text.write_text("no database" * 200)
    with pytest.raises(BadInput, match="cannot be used"):
        open_history(str(text), create=True)
    assert text.read_text() == "no database" * 200
    assert not (tmp_path / "none.sqlite").exists()


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("mysql://plant/history", "mysql is no database for a history"),
        ("sqlite://", "an SQLite history is a file"),
        ("nonsense://", "no database for a history|no URL"),
        ("postgresql://plant:secret@127.0.0.1:1/history", "cannot be used"),
    ],
)
def test_a_database_that_cannot_be_used_is_one_clear_error(url: str, told: str) -> None:
    with pytest.raises(BadInput, match=told) as caught:
        open_history(url)
    assert "secret" not in str(caught.value)


def test_where_the_history_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stated = tmp_path / "stated.sqlite"
    monkeypatch.setenv(tables.VARIABLE, str(stated))
    assert open_history(create=True).name == str(stated)
    assert open_history(f"sqlite:///{stated}").name == str(stated)
    assert default_file().name == "history.sqlite"


def test_a_folder_is_no_history(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="this is a folder, not a file"):
        open_history(str(tmp_path), create=True)
