"""Results and events in a history: each once, none lost, whoever adds them."""

import json
import random
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from child import ZEROBEAM, child
from histories import a_result, adding, as_misfit, postgresql, write_result

from zerobeam.analysis.row import ParameterRow
from zerobeam.experiments.history import store
from zerobeam.experiments.history.arm_history import arm_drift
from zerobeam.experiments.history.database import Database, document, open_history
from zerobeam.experiments.history.store import (
    add,
    add_event,
    arms,
    documents,
    events,
    find_arm,
    result_of,
    results,
    whole_answer,
)
from zerobeam.experiments.history.stored_result import Entry, Event, read_entry
from zerobeam.model.errors import BadInput
from zerobeam.model.files.run import LEFT_OUT, MADE_OF
from zerobeam.model.records import to_json


def entry(folder: Path, answer: dict[str, Any], **how: Any) -> Entry:
    found = read_entry(write_result(folder / "one.json", answer), lambda sha256: None, **how)
    assert found is not None
    return found


@pytest.fixture
def history(tmp_path: Path) -> Iterator[Database]:
    made = open_history(str(tmp_path / "history.sqlite"), create=True)
    yield made
    made.engine.dispose()


def test_what_was_simulated_is_known_of_documents_with_a_mark_behind_them_and_without(
    history: Database, tmp_path: Path
) -> None:
    """A document that tells no more than its row ends so; one that was added before has no such end."""
    for day, stated in ((1, {}), (2, {"origin": "simulated"})):
        add(history, [entry(tmp_path, a_result(when=f"2026-01-0{day}", **stated))])
    read = list(results(history))
    assert [one.simulated for one in read] == [False, True]
    assert all(json.loads(text) for _, text in documents(history, [one.sha256 for one in read]))
    with history.engine.begin() as connection:
        packed = dict(connection.execute(sa.select(document.c.sha256, document.c.content)).all())
        assert [packed[one.sha256].endswith(store._NO_MORE) for one in read] == [True, False]
        for one in read:
            before = {"content": packed[one.sha256].removesuffix(store._NO_MORE)}
            connection.execute(sa.update(document).where(document.c.sha256 == one.sha256).values(before))
    assert list(results(history)) == read


def test_a_result_comes_back_as_it_was(history: Database, tmp_path: Path) -> None:
    answer = a_result("A-1", "2026-03-31T14:05:00+02:00", psd="Hamamatsu 17", who="J. Doe")
    assert add(history, [entry(tmp_path, answer)]) == ["added"]
    (found,) = results(history)
    assert (found.serial, found.model, found.instrument, found.operator) == (
        *("A-1", "irb1600"),
        *("Hamamatsu 17", "J. Doe"),
    )
    assert found.measured_at.isoformat() == "2026-03-31T12:05:00"
    assert to_json(found.without_prior) == answer["without_prior"]
    assert [row.estimate for row in found.offsets] == [
        row["estimate"] for row in answer["parameters"] if row["group"] == "offset"
    ]
    ((sha256, text),) = documents(history, [answer["inputs"]["sha256"]])
    assert (sha256, json.loads(text)) == (answer["inputs"]["sha256"], answer)
    assert result_of(history, sha256) == ("A-1", "irb1600", found.measured_at)


def test_a_result_is_added_once(history: Database, tmp_path: Path) -> None:
    answer = a_result()
    again = a_result()
    again["posterior"]["seconds"] += 1.0  # made again: the same answer took another time
    other = a_result()
    other["parameters"][1]["estimate"] += 1.0
    elsewhere = entry(tmp_path, a_result(None), serial="A-1")
    moved = entry(tmp_path, a_result(None), serial="A-2")
    first, same, differs = (entry(tmp_path, own) for own in (answer, again, other))
    assert add(history, [first, same, differs]) == ["added", "already there", "refused"]
    assert add(history, [elsewhere, moved]) == ["added", "refused"]
    assert [arm.serial for arm in arms(history)] == ["A-1"]
    assert add(history, [differs, moved], replace=True) == ["replaced", "refused"]
    assert [own.offsets[1].estimate for own in results(history)].count(
        other["parameters"][1]["estimate"]
    ) == 1
    ((_, text),) = documents(history, [first.sha256])
    assert json.loads(text) == other


def scaled(answer: dict[str, Any], factor: float) -> dict[str, Any]:
    """The result with all numbers that a history counts with times this."""
    for row in answer["parameters"]:
        for key in ("estimate", "std"):
            row[key] = None if row[key] is None else row[key] * factor
        row["interval95"] = row["interval95"] and [end * factor for end in row["interval95"]]
    alone = answer["without_prior"]
    alone["values"] = [value * factor for value in alone["values"]]
    alone["covariance"] = [[value * factor for value in row] for row in alone["covariance"]]
    return answer


def test_another_fifteenth_digit_is_no_other_result(history: Database, tmp_path: Path) -> None:
    """As another order of the same sums gives it: with a compiler or without, on another processor."""
    first = a_result()
    first["without_prior"]["covariance"][0][1] = first["without_prior"]["covariance"][1][0] = 1e-19
    last_digits, nearly, status = scaled(a_result(), 1 + 4e-15), scaled(a_result(), 1 + 1e-7), a_result()
    last_digits["without_prior"]["covariance"][0][1] = -1e-19
    last_digits["without_prior"]["covariance"][1][0] = -1e-19
    nearly["without_prior"]["covariance"] = first["without_prior"]["covariance"]
    status["parameters"][1]["prior_std"] = 3.0
    covariance = a_result()
    covariance["without_prior"]["covariance"][0][0] *= 1 + 1e-7
    read = [entry(tmp_path, own) for own in (first, last_digits, nearly, status, covariance)]
    assert add(history, read) == ["added", "already there", *["refused"] * 3]
    ((_, text),) = documents(history, [read[0].sha256])
    assert json.loads(text) == first


def test_measurements_that_two_results_are_of_count_once(history: Database, tmp_path: Path) -> None:
    """A run without a bad measurement is kept beside the whole one: one of them has a part in the drift."""
    whole, later = a_result(when="2026-03-31"), a_result(when="2026-06-30")
    of = f"run.jsonl (SHA-256 {whole['inputs']['sha256']})"
    without = a_result(when="2026-03-31", **{LEFT_OUT: "4", MADE_OF: of})
    same_day = a_result(when="2026-03-31T15:00", who="J. Doe")
    every = [entry(tmp_path, one) for one in (whole, without, same_day, later)]
    assert set(add(history, every)) == {"added"}
    arm = ("A-1", "irb1600")
    drift = arm_drift(arm, list(results(history, arm)), [], 0.5)
    (left,) = drift.left_out
    assert (left.result.sha256, left.reason) == (
        whole["inputs"]["sha256"],
        "its run counts without some measurements",
    )
    assert len(drift.used) == 3
    # What does not count itself takes no other's part.
    misfit = entry(tmp_path, as_misfit(without))
    assert add(history, [misfit], replace=True) == ["replaced"]
    drift = arm_drift(arm, list(results(history, arm)), [], 0.5)
    assert [one.result.sha256 for one in drift.left_out] == [without["inputs"]["sha256"]]
    for stored in results(history, arm):
        assert whole_answer(history, stored).inputs.sha256 == stored.sha256


def test_of_results_of_one_time_the_gravest_stands_for_the_last(history: Database, tmp_path: Path) -> None:
    answers = [a_result(when="2025-03-01", who=who) for who in "ABCD"]
    answers[1] = as_misfit(answers[1])
    add(history, [entry(tmp_path, answer) for answer in answers])
    assert [one.verdict for one in arms(history)] == ["misfit"]
    assert [one.verdict for one in results(history, ("A-1", "irb1600"))] == [*["pass"] * 3, "misfit"]


def test_a_result_that_determines_nothing_is_said_not_to(history: Database, tmp_path: Path) -> None:
    """It was to be added again, which changed nothing."""
    add(history, [entry(tmp_path, a_result(when="2025-03-01"))])
    (stored,) = results(history)
    unknown = ParameterRow("delta2", "deg", "unidentifiable", None, None, None)
    nothing = replace(stored, offsets=(unknown,), without_prior=None, sensitivity_mm2=None)
    drift = arm_drift(("A-1", "irb1600"), [nothing], [], 0.5)
    assert [one.reason for one in drift.left_out] == ["it determines no offset"]


def test_a_simulated_result_is_the_last_where_there_is_no_other(history: Database, tmp_path: Path) -> None:
    simulated = a_result(when="2026-01-01", origin="simulated")
    add(history, [entry(tmp_path, simulated)])
    assert [(one.simulated, one.results) for one in arms(history)] == [(True, 1)]
    add(history, [entry(tmp_path, as_misfit(a_result(when="2025-01-01")))])
    (arm,) = arms(history)
    assert (arm.simulated, arm.verdict, arm.results, f"{arm.last:%Y}") == (False, "misfit", 2, "2025")


def test_results_that_state_one_time_have_no_order(history: Database, tmp_path: Path) -> None:
    """They were put in the order of the hashes of their runs, and a jump between two of one day was shown in
    one of its two directions, with a due date."""
    answers = [a_result(when="2025-01-15"), *(a_result(when="2025-03-01", who=who) for who in "ABCD")]
    for number, answer in enumerate(answers):
        answer["without_prior"]["values"][0] += 0.1 * number
    add(history, [entry(tmp_path, answer) for answer in answers])
    arm = ("A-1", "irb1600")
    drift = arm_drift(arm, list(results(history, arm)), [], 0.5)
    assert [one.measured_at.isoformat()[:10] for one in drift.used] == ["2025-01-15"]
    assert len(drift.left_out) == 4
    assert all("their order is not known" in one.reason for one in drift.left_out)
    assert (drift.jumps, drift.undecided, drift.due) == ((), (), None)
    assert drift.due_reason == "which result is the last is not known: several state its time"
    # What the reason says to do: the time of day is stated when they are added again.
    dated = [
        entry(tmp_path, answer, when=f"2025-03-01T{8 + hour:02}:00")
        for hour, answer in enumerate(answers[1:])
    ]
    assert add(history, dated) == ["refused"] * 4
    assert add(history, dated, replace=True) == ["replaced"] * 4
    drift = arm_drift(arm, list(results(history, arm)), [], 0.5)
    assert [one.sha256 for one in drift.used] == [answer["inputs"]["sha256"] for answer in answers]
    for stored in results(history, arm):
        assert whole_answer(history, stored).inputs.sha256 == stored.sha256


@pytest.mark.parametrize(
    ("stated", "how", "told"),
    [
        ("2026-01-31", {"serial": "OTHER"}, "another serial number than --serial"),
        ("2026-01-31", {"when": "2019-01-01"}, "another date than --when"),
        ("2026-01-31T08:00", {"when": "2026-01-31T09:00"}, "another date than --when"),
        ("2026-01-31T08:00", {"when": "2026-01-31"}, None),
        ("2026-01-31", {"serial": "A-1", "when": "2026-01-31T00:00:00Z"}, None),
    ],
)
def test_what_a_run_states_is_not_stated_otherwise(
    tmp_path: Path, stated: str, how: dict[str, str], told: str | None
) -> None:
    """--serial and --when were ignored, where the run states them, without a word."""
    if told is None:
        assert entry(tmp_path, a_result(when=stated), **how).measured_at.isoformat()[:16] in (
            "2026-01-31T00:00",
            "2026-01-31T08:00",
        )
        return
    with pytest.raises(BadInput, match=f"{told}[\\s\\S]*(OTHER|2019|09:00)"):
        entry(tmp_path, a_result(when=stated), **how)


def test_the_results_of_an_arm_are_in_the_order_of_time(history: Database, tmp_path: Path) -> None:
    given = [("B", "2026-02-01"), ("A", "2026-05-01"), ("A", "2025-05-01"), ("A", "2026-04-30T23:59:00")]
    add(history, [entry(tmp_path, a_result(*own)) for own in given])
    found = [(own.serial, own.measured_at.isoformat()[:10]) for own in results(history)]
    assert found == [("A", "2025-05-01"), ("A", "2026-04-30"), ("A", "2026-05-01"), ("B", "2026-02-01")]
    assert [own.serial for own in results(history, ("B", "irb1600"))] == ["B"]
    first, second = arms(history)
    assert (first.results, second.results) == (3, 1)
    assert (first.first, first.last) == tuple(own.measured_at for own in list(results(history))[0:3:2])


def test_the_last_result_is_the_last_of_the_order_of_time(history: Database, tmp_path: Path) -> None:
    for k in range(6):  # at one time, by the hash of the run
        add(history, [entry(tmp_path, a_result("A", "2026-05-01", operator=f"person {k}"))])
        (arm,) = arms(history)
        assert arm.sha256 == list(results(history))[-1].sha256


def test_what_is_not_determined_has_no_number(history: Database, tmp_path: Path) -> None:
    answer = a_result(demo="x-pattern")
    add(history, [entry(tmp_path, answer)])
    (found,) = results(history)
    lost = [row.name for row in found.offsets if row.status == "unidentifiable"]
    assert lost
    assert not set(lost) & set(found.without_prior.names)
    claimed = a_result(demo="x-pattern")
    next(row for row in claimed["parameters"] if row["name"] == lost[0])["estimate"] = 0.1
    with pytest.raises(BadInput, match="is unidentifiable, yet it has a value"):
        entry(tmp_path, claimed)
    claimed = a_result(demo="x-pattern")
    claimed["without_prior"]["names"][0] = lost[0]
    with pytest.raises(BadInput, match="cannot be determined"):
        entry(tmp_path, claimed)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (lambda own: own.pop("schema"), "schema"),
        (lambda own: own.update(verdict="fine"), "verdict"),
        (lambda own: own["inputs"].update(sha256="../x"), "SHA-256"),
        (lambda own: own["inputs"].update(robot=None), "inputs.robot"),
        (lambda own: own["without_prior"]["covariance"][0].pop(), "inhomogeneous"),
        (lambda own: own["without_prior"].update(covariance=[[0.0] * 5] * 5), "covariance"),
        (lambda own: own["parameters"][1].update(std=0.0), "has an empty std"),
        (lambda own: own["accuracy"].update(sensitivity_mm2=[[1.0]]), "sensitivity_mm2"),
        (lambda own: own["inputs"]["header"]["provenance"].pop("serial"), "--serial"),
        (lambda own: own["inputs"]["header"]["provenance"].pop("when"), "--when"),
        (lambda own: own["inputs"]["header"]["provenance"].update(when="31/3/26"), "ISO 8601"),
    ],
)
def test_a_bad_result_is_one_clear_error(tmp_path: Path, change: Any, told: str) -> None:
    answer = a_result()
    change(answer)
    with pytest.raises(BadInput, match=told) as caught:
        entry(tmp_path, answer)
    assert "one.json" in str(caught.value)


@pytest.mark.parametrize("bad", ["NaN", "Infinity", "1e999", "[" * 100_000])
def test_numbers_that_are_none_are_refused(tmp_path: Path, bad: str) -> None:
    answer = a_result()
    answer["without_prior"]["values"][0] = "HERE"
    file = write_result(tmp_path / "one.json", answer)
    file.write_text(file.read_text(encoding="utf-8").replace('"HERE"', bad), encoding="utf-8")
    with pytest.raises(BadInput, match="not a whole result"):
        read_entry(file, lambda sha256: None)


def test_an_older_result_without_the_covariance_is_kept(history: Database, tmp_path: Path) -> None:
    answer = a_result()
    del answer["without_prior"], answer["accuracy"]["sensitivity_mm2"]
    add(history, [entry(tmp_path, answer)])
    (found,) = results(history)
    assert found.without_prior is None
    assert found.sensitivity_mm2 is None


def test_arms_with_one_serial_number_are_told_apart(history: Database, tmp_path: Path) -> None:
    other = a_result("A-1", "2026-02-02")
    other["inputs"]["robot"] = "irb120"
    add(history, [entry(tmp_path, a_result("A-1")), entry(tmp_path, other)])
    assert find_arm(history, "A-1", "irb120") == ("A-1", "irb120")
    with pytest.raises(BadInput, match=r"irb120, irb1600[\s\S]*--model"):
        find_arm(history, "A-1")
    with pytest.raises(BadInput, match="did you mean 'A-1'"):
        find_arm(history, "A-11")


def test_events_are_logged_once(history: Database, tmp_path: Path) -> None:
    own = entry(tmp_path, a_result())
    add(history, [own])
    bump = Event("A-1", "irb1600", own.measured_at, "collision", "table 3")
    assert [add_event(history, bump), add_event(history, bump)] == [True, False]
    assert events(history) == [bump] == events(history, ("A-1", "irb1600"))


def at_once(write: Callable[..., None], given: Sequence[Any]) -> None:
    """`write` with each of the given, in threads."""
    writers = [threading.Thread(target=write, args=(one,)) for one in given]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()


def test_writers_at_once_wait_for_each_other(tmp_path: Path) -> None:
    url = str(tmp_path / "history.sqlite")
    open_history(url, create=True)
    mine = [entry(tmp_path, a_result("A", f"2026-01-{day:02}")) for day in range(1, 7)]
    outcomes: list[str] = []

    def write(history: Database) -> None:
        for one in mine:
            outcomes.extend(add(history, [one]))

    at_once(write, [open_history(url) for _ in range(3)])
    assert sorted(outcomes) == ["added"] * 6 + ["already there"] * 12
    assert len(list(results(open_history(url)))) == 6


def _killed_at_random(url: str, folder: Path, kills: int) -> None:
    """Processes that add the folder's results are killed; in the end each is there once."""
    chance, told = random.Random(5), set()
    for _ in range(kills):
        with child(adding(url, folder)) as process:
            told.update(process.stdout.readline().split()[:1])  # it has begun to write
            time.sleep(chance.uniform(0, 0.05))
            process.kill()
            told.update(line.split()[0] for line in process.stdout.read().splitlines() if line.endswith("d"))
        here = {own.run for own in results(open_history(url))}
        assert told <= here, "what was told as added is lost"
    for own in results(open_history(url)):
        ((_, text),) = documents(open_history(url), [own.sha256])
        assert json.loads(text)["inputs"]["sha256"] == own.sha256
    with child(adding(url, folder)) as process:
        process.communicate()
    here = [own.run for own in results(open_history(url))]
    assert sorted(here) == sorted(path.name for path in folder.iterdir())


def _files(folder: Path, count: int) -> Path:
    for number in range(count):
        answer = a_result(f"A-{number % 7}", f"2026-01-01T{number // 60:02}:{number % 60:02}")
        answer["inputs"]["run"] = f"{number:04}.json"
        write_result(folder / f"{number:04}.json", answer)
    return folder


@pytest.mark.long
def test_fifty_killed_processes_lose_nothing_and_add_nothing_twice(tmp_path: Path) -> None:
    _killed_at_random(str(tmp_path / "history.sqlite"), _files(tmp_path / "in", 1200), 50)


# zerobeam, killed when it is about to pack the result of this number: amid a transaction, whose results are
# inserted, and their texts are not.
KILLED = """
import itertools, os, signal, sys
from zerobeam.cli import main
from zerobeam.experiments.history import store
numbers, last, content = itertools.count(1), int(sys.argv.pop(1)), store._content
def until_killed(entry):
    if next(numbers) == last:
        os.kill(os.getpid(), signal.SIGKILL)
    return content(entry)
store._content = until_killed
main()
"""


@pytest.mark.long
def test_a_kill_amid_a_transaction_loses_nothing_and_adds_nothing_twice(tmp_path: Path) -> None:
    """The command adds a hundred at once: what is there afterwards is whole hundreds, each with its text."""
    url = str(tmp_path / "history.sqlite")
    files = sorted(_files(tmp_path / "in", 250).iterdir())
    add_all = ["history", "add", *map(str, files), "--db", url]
    for last, here in ((1, 0), (130, 100), (100, 100), (150, 200)):
        with child([sys.executable, "-c", KILLED, str(last), *add_all]) as process:
            process.communicate()
            assert process.returncode == -signal.SIGKILL
        kept = list(results(open_history(url)))
        assert sorted(own.run for own in kept) == [path.name for path in files[:here]]
        assert len(list(documents(open_history(url), [own.sha256 for own in kept]))) == here
    with child([*ZEROBEAM, *add_all]) as process:
        process.communicate()
        assert process.returncode == 0
    kept = list(results(open_history(url)))
    assert sorted(own.run for own in kept) == [path.name for path in files]
    for sha256, text in documents(open_history(url), [own.sha256 for own in kept]):
        assert json.loads(text)["inputs"]["sha256"] == sha256


def test_a_transaction_that_fails_leaves_nothing_of_it(
    history: Database, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = [entry(tmp_path, a_result("A", f"2026-01-{day:02}")) for day in range(1, 10)]
    assert add(history, every[:3]) == ["added"] * 3
    content = store._content

    def full(own: Entry) -> bytes:
        if own is every[7]:
            raise OSError("no space left")
        return content(own)

    with monkeypatch.context() as patched:
        patched.setattr(store, "_content", full)
        with pytest.raises(OSError, match="no space left"):
            add(history, every)
    assert [own.sha256 for own in results(history)] == [own.sha256 for own in every[:3]]
    assert add(history, every) == ["already there"] * 3 + ["added"] * 6
    assert len(list(documents(history, [own.sha256 for own in every]))) == 9


@pytest.mark.long
def test_two_processes_write_at_once(tmp_path: Path) -> None:
    url, folder = str(tmp_path / "history.sqlite"), _files(tmp_path / "in", 300)
    with child(adding(url, folder)) as one, child(adding(url, folder)) as other:
        told = [*one.communicate()[0].splitlines(), *other.communicate()[0].splitlines()]
    assert sum(line.endswith(" added") for line in told) == 300
    assert sum(line.endswith(" already there") for line in told) == 300
    assert len(list(results(open_history(url)))) == 300


@pytest.mark.long
def test_postgresql_keeps_what_sqlite_keeps(tmp_path: Path) -> None:
    files, sqlite = _files(tmp_path / "in", 60), open_history(str(tmp_path / "one.sqlite"), create=True)
    with postgresql() as url:
        with child(adding(url, files)) as one, child(adding(url, files)) as other:
            told = [*one.communicate()[0].splitlines(), *other.communicate()[0].splitlines()]
        assert sum(line.endswith(" added") for line in told) == 60
        server = open_history(url)
        with child(adding(str(tmp_path / "one.sqlite"), files)) as process:
            process.communicate()
        bump = Event("A-1", "irb1600", next(results(server)).measured_at, "collision", "")
        assert add_event(server, bump)
        assert not add_event(server, bump)
        add_event(sqlite, bump)
        assert list(results(server)) == list(results(sqlite))
        assert arms(server) == arms(sqlite)
        assert events(server) == events(sqlite)
        more = [entry(tmp_path, a_result(f"B-{n % 7}", f"2026-02-{n + 1:02}")) for n in range(28)]
        outcomes: list[str] = []

        def write(given: list[Entry]) -> None:
            own = open_history(url)
            outcomes.extend(add(own, given))
            own.engine.dispose()

        at_once(write, (more, more[::-1]) * 3)
        assert sorted(outcomes) == ["added"] * 28 + ["already there"] * 28 * 5
        assert len(list(documents(server, [own.sha256 for own in more]))) == 28
        server.engine.dispose()
