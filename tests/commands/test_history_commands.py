"""`zerobeam history`: what it adds, prints and refuses."""

import csv
import json
import re
from pathlib import Path
from unittest import mock

import pytest
from command_line import zerobeam
from exact_runs import demo_runs
from histories import a_result, as_misfit, write_result


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A history with two results of one arm, and the folder that they are from."""
    monkeypatch.setenv("ZEROBEAM_HISTORY", str(tmp_path / "history.sqlite"))
    for number, when in enumerate(("2025-01-31", "2026-01-31")):
        write_result(tmp_path / "in" / str(number) / "result.json", a_result("A-1", when, psd="17"))
    answer = zerobeam("history", "add", tmp_path / "in")
    assert (answer.status, answer.err) == (0, "")
    assert answer.out.startswith("2 added: ")
    return tmp_path


def test_what_was_added_is_listed_and_shown(kept: Path) -> None:
    listed = zerobeam("history", "list")
    assert listed.status == 0
    assert "A-1" in listed.out
    assert "2026-01-31" in listed.out
    found = zerobeam("history", "list", "--json").json
    assert [own["measured_at"] for own in found["results"]] == [
        "2025-01-31T00:00:00+00:00",
        "2026-01-31T00:00:00+00:00",
    ]
    assert found["results"][0]["instrument"] == "17"
    assert zerobeam("history", "event", "A-1", "--date", "2025-06-01", "--what", "motor").out == "logged\n"
    shown = zerobeam("history", "show", "A-1")
    assert "2025-01-31" in shown.out
    assert "motor" in shown.out
    # A result is a line, in 80 columns: what does not fit follows below, behind the date.
    rows = [line for line in shown.out.splitlines() if re.search(r"\d ± \d", line)]
    assert len(rows) == 4
    assert all(row.startswith("202") and len(row) <= 80 and row.endswith("°") for row in rows)
    assert sum(row.count("±") for row in rows) == 10
    plain = zerobeam("history", "show", "A-1", "--json").json
    assert plain["events"] == [
        {
            "serial": "A-1",
            "model": "irb1600",
            "at": "2025-06-01T00:00:00+00:00",
            "what": "motor",
            "note": None,
        }
    ]
    assert plain["results"] == found["results"]
    assert "no such arm" in zerobeam("history", "show", "A-2").refused()


def test_a_bad_file_is_named_and_the_others_are_added(kept: Path) -> None:
    write_result(kept / "more" / "good.json", a_result("B", "2026-02-01"))
    (kept / "more" / "bad.json").write_text("{")
    write_result(kept / "more" / "nameless.json", a_result(None))
    answer = zerobeam("history", "add", *sorted((kept / "more").iterdir()), kept / "none.json", kept / "in")
    assert answer.status == 2
    assert answer.out.startswith("1 added, 2 already there, 3 not added: ")
    for name in ("bad.json", "nameless.json", "none.json"):
        assert f"{name}: " in answer.err
    assert answer.err.count("error: ") == 3
    told = zerobeam("history", "add", kept / "more" / "nameless.json", "--serial", "C", "--json").json
    assert told == {"added": 1, "replaced": 0, "already_there": 0, "refused": 0, "failed": []}


def test_a_run_that_is_there_under_another_arm_is_told_so(kept: Path) -> None:
    """`--replace` was the advice, and gave the same error."""
    nameless = write_result(kept / "more" / "nameless.json", a_result(None))
    zerobeam("history", "add", nameless, "--serial", "C")
    for more in ((), ("--replace",)):
        told = zerobeam("history", "add", nameless, "--serial", "D", *more)
        said = " ".join(told.err.split())
        assert told.status == 2
        assert "under another arm: serial C" in said
        assert "for serial D" in said
        assert "--replace" not in said


@pytest.mark.long
def test_a_run_is_solved_as_analyse_does_and_only_once(kept: Path) -> None:
    lines = next(demo.path for demo in demo_runs() if demo.name == "good").read_text().splitlines()
    header = json.loads(lines[0])
    header["provenance"] = {"serial": "R", "when": "2026-03-01"}
    run = kept / "run.jsonl"
    run.write_text("\n".join([json.dumps(header), *lines[1:]]))
    assert zerobeam("history", "add", run).out.startswith("1 added")
    (stored,) = zerobeam("history", "show", "R", "--json").json["results"]
    own = zerobeam("analyse", run, "--json").json
    assert [row["estimate"] for row in stored["offsets"]] == [
        row["estimate"] for row in own["parameters"] if row["group"] == "offset"
    ]
    assert stored["without_prior"] == own["without_prior"]
    with mock.patch("zerobeam.analysis.analyse.analyse", side_effect=AssertionError("solved again")):
        assert zerobeam("history", "add", run).out.startswith("0 added, 1 already there")


def test_it_is_exported(kept: Path) -> None:
    table, plain = kept / "table.csv", kept / "all.json"
    assert zerobeam("history", "export", "-o", table).status == 0
    rows = list(csv.DictReader(table.read_text(encoding="utf-8").splitlines()))
    assert [row["offset"] for row in rows] == [f"delta{joint}" for joint in range(1, 7)] * 2
    assert rows[0]["status"] == "held"
    assert rows[0]["std"] == ""
    assert "exists" in zerobeam("history", "export", "-o", table).refused()
    assert zerobeam("history", "export", "A-1", "-o", plain).status == 0
    exported = json.loads(plain.read_text())
    assert len(exported["results"]) == 2
    assert exported == {**zerobeam("history", "list", "--json").json, "events": []}
    assert ".csv or .json" in zerobeam("history", "export", "-o", kept / "x.xls").refused()


def test_without_the_extra_it_says_how_to_install_it() -> None:
    with mock.patch("zerobeam.commands.history.find_spec", return_value=None):
        assert 'pip install "zerobeam[history]"' in zerobeam("history", "list").refused()


@pytest.mark.long
def test_drift_says_which_changes_are_real_and_what_was_logged(tmp_path: Path) -> None:
    db = tmp_path / "history.sqlite"
    for number in range(8):
        answer = a_result("A-1", f"202{number // 4}-{3 * (number % 4) + 1:02}-15")
        answer["without_prior"]["values"][1] += 1.0 if number > 4 else 0.0
        write_result(tmp_path / "in" / str(number) / "result.json", answer)
    misfit = as_misfit(a_result("A-1", "2022-06-01"))
    write_result(tmp_path / "in" / "misfit" / "result.json", misfit)
    zerobeam("history", "add", tmp_path / "in", "--db", db)
    zerobeam("history", "event", "A-1", "--date", "2021-03-01", "--what", "collision", "--db", db)
    (arm,) = zerobeam("history", "drift", "A-1", "--json", "--db", db).json["arms"]
    assert len(arm["used"]) == 8
    assert [own["reason"] for own in arm["left_out"]] == [
        "misfit: the model does not describe the measurements"
    ]
    (jump,) = arm["jumps"]
    assert jump["offset"] == "delta3"
    assert (jump["after"][:10], jump["before"][:10]) == ("2021-01-15", "2021-04-15")
    assert jump["interval95"][0] < 1 < jump["interval95"][1]
    assert [own["what"] for own in jump["events"]] == ["collision"]
    assert arm["due"]["date"] is not None
    told = zerobeam("history", "drift", "A-1", "--db", db)
    assert "collision" in told.out
    assert "Not counted: the result of 2022-06-01" in told.out
    assert "J3" in zerobeam("history", "drift", "--db", db).out


def test_no_due_date_without_what_it_depends_on(tmp_path: Path) -> None:
    db = tmp_path / "history.sqlite"
    for number in range(3):
        answer = a_result("X", f"2026-0{number + 1}-01", demo="x-pattern")
        write_result(tmp_path / "in" / str(number) / "result.json", answer)
    zerobeam("history", "add", tmp_path / "in", "--db", db)
    (arm,) = zerobeam("history", "drift", "X", "--json", "--db", db).json["arms"]
    assert arm["due"]["date"] is None
    assert "no accuracy" in arm["due"]["reason"]
    assert "delta2" not in [own["name"] for own in arm["offsets"]]


@pytest.mark.long
def test_an_arm_has_a_page(kept: Path) -> None:
    one = kept / "one"
    found = zerobeam("history", "report", "A-1", "-o", one, "--as-of", "2099-01-01", "--json").json
    assert (found["state"], found["as_of"]) == ("overdue", "2099-01-01")
    assert json.loads((one / "arm.json").read_text()) == found
    assert "no such arm" in zerobeam("history", "report", "A-2", "-o", kept / "two").refused()
    assert not (kept / "two").exists()
    assert "other things" in zerobeam("history", "report", "-o", one).refused()
    assert "ISO 8601" in zerobeam("history", "report", "-o", kept / "all", "--as-of", "today").refused()


@pytest.mark.long
def test_the_page_of_an_arm_is_the_same_among_those_of_all(kept: Path) -> None:
    one, all_arms = kept / "one", kept / "all"
    told = zerobeam("history", "report", "A-1", "-o", one, "--tolerance-mm", "0.4")
    assert told.status == 0
    assert "for a TCP error by the offsets alone within 0.4\u00a0mm" in told.out
    assert f"Report: {one / 'arm.html'}" in told.out
    assert zerobeam("history", "report", "-o", all_arms, "--tolerance-mm", "0.4").status == 0
    (inside,) = (all_arms / "arms").iterdir()
    for path in sorted(one.rglob("*.*")):  # the same page, alone and among all
        assert (inside / path.relative_to(one)).read_bytes() == path.read_bytes(), path
    answer = zerobeam("history", "report", "-o", all_arms, "--json").json
    assert answer["as_of"] == "2026-01-31"
    assert [own["serial"] for own in answer["arms"]] == ["A-1"]
