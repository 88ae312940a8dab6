"""A history whose rows are damaged: each is named with its arm, and the others are listed."""

import json
import random
import re
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from command_line import Answer, zerobeam
from histories import a_result, write_result

pytest.importorskip("cryptography")

WHENS = ("2025-01-31", "2025-07-31", "2026-01-31")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("plant")
    for serial in ("A-1", "B-2"):
        for number, when in enumerate(WHENS):
            write_result(folder / "in" / serial / f"{number}" / "result.json", a_result(serial, when))
    db = folder / "history.sqlite"
    assert zerobeam("history", "add", folder / "in", "--db", db).status == 0
    for serial in ("A-1", "B-2"):
        words = ("--date", "2025-03-01", "--what", "other", "--note", "door")
        assert zerobeam("history", "event", serial, *words, "--db", db).status == 0
    assert zerobeam("history", "key", folder / "plant.key").status == 0
    return folder


@pytest.fixture
def plant(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two arms with three results each, and an event."""
    folder = shutil.copytree(made, tmp_path / "plant")
    monkeypatch.setenv("ZEROBEAM_HISTORY", str(folder / "history.sqlite"))
    return folder


def damage(plant: Path, table: str, column: str, value: object) -> str:
    """Damage the second row of the arm A-1; the beginning of the hash of its run."""
    order = "measured_at" if table == "result" else "at"
    with closing(sqlite3.connect(plant / "history.sqlite")) as own, own:
        rows = own.execute(f"SELECT rowid, * FROM {table} WHERE serial = 'A-1' ORDER BY {order}").fetchall()
        row = rows[len(rows) // 2]
        own.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (value, row[0]))
    return str(row[1])[:12] if table == "result" else ""


def refused(answer: Answer) -> bool:
    """Whether it is one clear error, or went well."""
    assert answer.status in (0, 2), answer.err
    assert "Traceback" not in answer.err
    assert (answer.status == 2) == answer.err.startswith("error: ")
    return answer.status == 2


def text_of(column: str, value: object) -> object:
    """What is put into a column: of a dictionary, what the result has there with these changes."""
    if not isinstance(value, dict):
        return value
    if column == "without_prior":
        return json.dumps({**a_result()["without_prior"], **value}).replace("Infinity", "1e400")
    kept = ("name", "unit", "status", "held", "estimate", "std", "interval95")
    rows = [row for row in a_result()["parameters"] if row["group"] == "offset"]
    offsets = [{key: row[key] for key in kept} for row in rows]
    offsets[1].update(value)
    return json.dumps(offsets).replace("Infinity", "1e400")


RESULTS = [
    ("offsets", "[{"),
    ("offsets", "null"),
    ("offsets", "[" * 100_000),
    ("offsets", b"\xff\xfe"),
    ("offsets", '[{"name": "delta2"}]'),
    ("offsets", {"std": "wide"}),
    ("offsets", {"std": 0}),
    ("offsets", {"estimate": None}),
    ("offsets", {"interval95": [1.0]}),
    ("offsets", {"estimate": 10**400}),
    ("offsets", {"held": 1e400}),
    ("offsets", {"status": "unidentifiable"}),
    ("offsets", {"status": "excellent"}),
    ("offsets", {"name": 7}),
    ("offsets", {"unit": None}),
    ("without_prior", "NaN"),
    ("without_prior", "{}"),
    ("without_prior", {"dof": "many"}),
    ("without_prior", {"names": ["delta2"]}),
    ("without_prior", {"names": ["delta2"] * 5}),
    ("without_prior", {"covariance": [[1e400] * 5] * 5}),
    ("without_prior", {"values": ["1"] * 5}),
    ("without_prior", {"by_geometry": [1, 2]}),
    ("sensitivity_mm2", "[[1]]"),
    ("sensitivity_mm2", "[[1, 2], [3]]"),
    ("sensitivity_mm2", "7"),
    ("measured_at", "yesterday"),
    ("measured_at", "2026-02-30 00:00:00.000000"),
    ("measured_at", "0000-00-00 00:00:00"),
    ("measured_at", "9999-99-99 00:00:00"),
    ("measured_at", "2026-01-31T00:00:00+02:00"),
    ("measured_at", 20260131),
    ("measured_at", 1e400),
    ("verdict", "fine"),
    ("shots", "seven"),
    ("instrument", b"\xff"),
]


@pytest.mark.one_in(4)
@pytest.mark.parametrize(("column", "value"), RESULTS, ids=lambda own: str(own)[:40])
@pytest.mark.one_in(3)
def test_a_damaged_result_is_named_and_the_others_are_listed(plant: Path, column: str, value: object) -> None:
    run = damage(plant, "result", column, text_of(column, value))
    shown = zerobeam("history", "show", "A-1")
    assert refused(shown)
    for named in ("the history is damaged", "A-1", run):
        assert named in shown.err
    assert ("2025-01-31" in shown.out, "2026-01-31" in shown.out) == (True, True)
    listed = zerobeam("history", "list", "--json")
    assert refused(listed)
    dates = [(own["serial"], own["measured_at"][:10]) for own in listed.json["results"]]
    assert dates == [*(("A-1", when) for when in (WHENS[0], WHENS[2])), *(("B-2", when) for when in WHENS)]
    arms = zerobeam("history", "list")
    refused(arms)
    assert ("A-1" in arms.out, "B-2" in arms.out) == (True, True)
    assert zerobeam("history", "show", "B-2").status == 0


@pytest.mark.parametrize(
    ("column", "value"), [("offsets", "[{"), ("without_prior", "{}"), ("measured_at", "yesterday")]
)
def test_what_counts_with_all_results_is_refused_until_the_result_is_added_anew(
    plant: Path, column: str, value: object
) -> None:
    run = damage(plant, "result", column, value)
    for words in (
        ("drift", "A-1"),
        ("drift",),
        ("report", "A-1", "-o", plant / "page"),
        ("report", "-o", plant / "pages"),
        ("export", "-o", plant / "all.csv"),
        ("certify", "A-1", "--key", plant / "plant.key", "-o", plant / "signed"),
    ):
        answer = zerobeam("history", *words)
        assert refused(answer), words
        assert run in answer.err
    assert not {"page", "pages", "all.csv", "signed"} & {own.name for own in plant.iterdir()}
    assert not refused(zerobeam("history", "add", plant / "in", "--replace"))
    assert zerobeam("history", "show", "A-1").err == ""


@pytest.mark.parametrize(
    ("column", "value"), [("at", "spring"), ("at", 7), ("what", "flood"), ("note", b"\xff"), ("what", 7)]
)
@pytest.mark.one_in(3)
def test_a_damaged_event_is_named(plant: Path, column: str, value: object) -> None:
    damage(plant, "event", column, value)
    shown = zerobeam("history", "show", "A-1")
    assert refused(shown)
    assert "the history is damaged: the event" in shown.err
    assert "arm A-1" in shown.err
    assert all(when in shown.out for when in WHENS)
    for words in (("drift", "A-1"), ("drift",), ("report", "-o", plant / "pages")):
        assert refused(zerobeam("history", *words))
    assert not refused(zerobeam("history", "show", "B-2"))


EVERY_COMMAND = (
    ("list",),
    ("list", "--json"),
    ("show", "A-1"),
    ("drift", "A-1"),
    ("export", "-o", "all.csv", "--force"),
    ("export", "-o", "all.json", "--force"),
    ("certify", "A-1", "--key", "plant.key", "-o", "signed"),
)
SQL = re.compile(r"SELECT|INSERT|\[SQL|sqlalche|builtins|background on", re.IGNORECASE)


def every_command_is_clear(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The errors of all commands that read a history: clear ones, without SQL."""
    monkeypatch.chdir(folder)
    errors = []
    for words in EVERY_COMMAND:
        answer = zerobeam("history", *words)
        if refused(answer):
            errors.append(answer.err)
        assert not SQL.search(answer.err), answer.err
    return errors


STATEMENTS = {
    "serial": "UPDATE arm SET serial = x'fffe' WHERE serial = 'B-2'",
    "model": "UPDATE arm SET model = x'fffe' WHERE serial = 'B-2'",
    "event's serial": "UPDATE event SET serial = x'fffe' WHERE serial = 'B-2'",
    "document": "UPDATE document SET content = 7",
    "text document": "UPDATE document SET content = 'garbage'",
    "dates": "UPDATE result SET measured_at = 'garbage', added_at = 'garbage'",
    "no documents": "DROP TABLE document",
    "no events": "DROP TABLE event",
    "column": "ALTER TABLE result RENAME COLUMN offsets TO other",
    "undecodable": "UPDATE result SET operator = CAST(x'ff' AS TEXT)",
}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("statement", STATEMENTS.values(), ids=STATEMENTS)
@pytest.mark.one_in(3)
def test_no_damage_prints_a_statement(plant: Path, statement: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with closing(sqlite3.connect(plant / "history.sqlite")) as own, own:
        own.execute(statement)
    errors = every_command_is_clear(plant, monkeypatch)
    assert any(re.search("the history (is damaged|was altered)", error) for error in errors)


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.one_in(4)
def test_pages_with_flipped_bytes(plant: Path, seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    db, some = plant / "history.sqlite", random.Random(seed)
    with closing(sqlite3.connect(db)) as own:
        own.execute("PRAGMA wal_checkpoint(TRUNCATE)")
    content = bytearray(db.read_bytes())
    if seed % 2:
        start = 4096 * some.randrange(1, len(content) // 4096)
        content[start : start + 4096] = some.randbytes(4096)
    else:
        for _ in range(200):
            content[some.randrange(100, len(content))] ^= 1 << some.randrange(8)
    db.write_bytes(content)
    every_command_is_clear(plant, monkeypatch)


@pytest.mark.parametrize(
    "when", ["9999-12-31T23:59:59-10:00", "0001-01-01T00:00:00+10:00", "2026-02-30", "\udcff"]
)
def test_dates_that_there_are_not(plant: Path, when: str) -> None:
    write_result(plant / "undated.json", a_result("A-1", None))
    for words in (
        ("event", "A-1", "--what", "motor", "--date", when),
        ("report", "-o", plant / "page", "--as-of", when),
        ("add", plant / "undated.json", "--when", when),
    ):
        answer = zerobeam("history", *words)
        assert refused(answer)
        assert "the date cannot be read" in answer.err


@pytest.mark.parametrize(
    "damaged",
    [
        '{"schema"',
        "[]",
        "7",
        "[" * 100_000,
        '{"schema": 1e400}',
        '{"schema": "zerobeam/result/1"}',
        '{"schema": "zerobeam/result/1", "inputs": []}',
    ],
    ids=lambda own: own[:20],
)
def test_a_damaged_file_is_one_clear_error(plant: Path, damaged: str) -> None:
    (plant / "bad.json").write_text(damaged)
    answer = zerobeam("history", "add", plant / "bad.json", plant / "in")
    assert refused(answer)
    assert answer.err.count("error: ") == 1
    assert "6 already there, 1 not added" in answer.out
    pages = plant / "pages"
    pages.mkdir()
    (pages / "arm.json").write_text(damaged)
    assert "was not written by zerobeam" in zerobeam("history", "report", "A-1", "-o", pages).refused()


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("inputs", "shots"), 1e400),
        (("inputs", "header", "provenance"), 7),
        (("inputs", "vendor"), {}),
        (("inputs", "robot"), "\ud800"),
        (("parameters",), {}),
        (("parameters", 1, "estimate"), 10**400),
        (("parameters", 1, "interval95"), 7),
        (("without_prior", "dof"), "many"),
        (("accuracy", "sensitivity_mm2"), [[1e400] * 6] * 6),
        (("fits",), None),
    ],
)
def test_numbers_that_are_none_are_not_added(plant: Path, place: tuple[Any, ...], value: object) -> None:
    answer = a_result("C-3", "2026-01-31")
    within = answer
    for key in place[:-1]:
        within = within[key]
    within[place[-1]] = value
    text = json.dumps(answer).replace("Infinity", "1e400")
    (plant / "bad.json").write_text(text)
    told = zerobeam("history", "add", plant / "bad.json")
    assert refused(told)
    assert "bad.json: this is not a whole result of zerobeam" in told.err
