"""What nothing is to be entered by is green nowhere: report, terminal, app, history, certificate."""

from __future__ import annotations

import functools
import json
from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from cells import run_of
from certificates import a_key
from command_line import zerobeam
from rich.console import Console

import zerobeam as zb
from zerobeam.analysis.answer.answer_message import May
from zerobeam.analysis.answer.findings import Finding, HeldOutMisfit, OtherBasins, Outlying
from zerobeam.analysis.answer.result import Result, parse_result
from zerobeam.app.server.answers.home import home
from zerobeam.app.server.answers.run_history import history
from zerobeam.app.server.folder import Folder
from zerobeam.experiments.demos import demo_runs
from zerobeam.model.files.header import Header
from zerobeam.model.files.run import read_run
from zerobeam.model.records import dumps
from zerobeam.reports.batch.carried_out import BatchRun, _row
from zerobeam.reports.output.terminal import VERDICT_STYLE, print_blocks, print_page
from zerobeam.reports.run.brief_page import brief_page, side_by_side
from zerobeam.reports.run.report import report_page
from zerobeam.words.judgement import judgement, read_judgement
from zerobeam.words.message import judged, message
from zerobeam.words.next_steps import next_steps
from zerobeam.words.sentences import to_json

pytest.importorskip("sqlalchemy")
pytest.importorskip("cryptography")

AGAINST: dict[str, Finding] = {
    "held-out run": HeldOutMisfit(("psd",), 0.4, 3.0, run="second.jsonl"),
    "held-out target": HeldOutMisfit(("left",), 0.4, 3.0),
    "other optima": OtherBasins(2),
    "outliers": Outlying((3,), robust=False),
}
READ_BACK = {"serial": "A-1", "when": "2026-01-31"}


@functools.cache
def passed() -> Result:
    """A pass of a robot that was measured."""
    run = read_run(demo_runs()[0].path)
    stated = {"provenance": READ_BACK, "geometry": "exact"}
    header = Header.model_validate(run.header.model_dump(exclude_unset=True, by_alias=True) | stated)
    return zb.analyse(run_of(header, run.shots), ess=100).result


def terminal(result: Result) -> str:
    """The grade of the colour in which a terminal begins."""
    text = StringIO()
    console = Console(file=text, force_terminal=True, color_system="standard", width=200)
    print_page(console, brief_page(result))
    begins = {
        grade: console.get_style(VERDICT_STYLE[grade]).render("Pass")[:-8] for grade in ("pass", "weak")
    }
    assert begins["pass"] != begins["weak"]
    return next((grade for grade, begin in begins.items() if text.getvalue().startswith(begin)), "?")


def page_of(folder: Path, serial: str | None, *db: object) -> str:
    """The page of an arm, or of all arms."""
    there = folder / ("fleet" if serial is None else "arm")
    arm = () if serial is None else (serial,)
    assert zerobeam("history", "report", *arm, "-o", there, *db).status == 0
    return (there / ("fleet.html" if serial is None else "arm.html")).read_text()


def compared(result: Result) -> str:
    """The verdict in a table of several results."""
    text = StringIO()
    print_blocks(Console(file=text, width=200), [side_by_side(["one"], [result])])
    return text.getvalue()


def told(folder: Path, result: Result) -> dict[str, str]:
    """What each reader says of a result: the report, the terminal, and those of its result.json."""
    (folder / "job").mkdir()
    (folder / "job" / "result.json").write_text(dumps(to_json(result)))
    db = ("--db", folder / "history.sqlite")
    assert zerobeam("history", "add", folder / "job" / "result.json", *db).status == 0
    key = a_key(folder)
    certified = zerobeam("history", "certify", "A-1", "--key", key, "-o", folder / "signed", *db)
    (calibration,) = home(Folder(folder)).calibrations
    (brief,) = history(Folder(folder)).results
    (row,) = zerobeam("history", "show", "A-1", "--json", *db).json["results"]
    (listed,) = zerobeam("history", "list", "--json", *db).json["results"]
    assert (row["grade"], row["may"]) == (listed["grade"], listed["may"])
    return {
        "report": report_page(result).verdict.key,
        "terminal": terminal(result),
        "home": calibration.state.kind,
        "home words": calibration.state.text,
        "app's list": str(brief.grade),
        "list": zerobeam("history", "list", *db).out,
        "show": zerobeam("history", "show", "A-1", *db).out,
        "json": row["grade"],
        "arm's page": page_of(folder, "A-1", *db),
        "all arms": page_of(folder, None, *db),
        "compared": compared(result),
        "certify": "" if certified.status == 0 else certified.refused(),
    }


@pytest.mark.parametrize("why", AGAINST)
@pytest.mark.one_in(4)
def test_what_speaks_against_a_pass_is_seen_by_every_reader(why: str, tmp_path: Path) -> None:
    result = replace(passed(), findings=(AGAINST[why],))
    assert message(result).may == May()
    assert next_steps(result, message(result)).enter == ()
    said = told(tmp_path, result)
    assert {said[name] for name in ("report", "terminal", "home", "app's list", "json")} == {"weak"}
    assert "enter nothing" in said["home words"]
    assert "pass, enter nothing" in said["list"]
    assert {"pass,", "enter", "nothing"} <= set(said["show"].split())  # in a narrow column
    assert "Pass, enter nothing" in said["arm's page"]
    assert "Pass, enter nothing" in said["all arms"]
    assert "pass, enter nothing" in said["compared"]
    assert "this result is not certified: something speaks against it" in said["certify"]


def test_a_pass_is_one_to_every_reader(tmp_path: Path) -> None:
    """The negative control."""
    result = replace(passed(), findings=())
    assert message(result).may == May(enter=True, certify=True, export=True)
    said = told(tmp_path, result)
    assert {said[name] for name in ("report", "terminal", "home", "app's list", "json")} == {"pass"}
    pages = said["arm's page"] + said["all arms"] + said["compared"]
    assert "enter nothing" not in said["list"] + said["show"] + said["home words"] + pages
    assert said["certify"] == ""


@pytest.mark.parametrize(("why", "outcome"), [(None, "pass"), ("outliers", "weak")])
def test_a_batch_counts_no_pass_that_nothing_is_to_be_entered_by(why: str | None, outcome: str) -> None:
    result = replace(passed(), findings=() if why is None else (AGAINST[why],))
    assert _row(BatchRun("one", "one.jsonl", read_run(demo_runs()[0].path)), result).outcome == outcome


@pytest.mark.parametrize("why", [None, *AGAINST])
def test_a_result_of_an_earlier_version_is_judged_by_what_it_says(why: str | None) -> None:
    result = replace(passed(), findings=() if why is None else (AGAINST[why],))
    answer = to_json(result)
    stated = read_judgement(parse_result(json.dumps(answer)))
    assert stated == judged(result)
    del answer["message"]["grade"], answer["message"]["may"]
    assert read_judgement(parse_result(json.dumps(answer))) == stated


@pytest.mark.parametrize(
    ("changed", "grade", "may"),
    [
        ({}, "pass", May(True, True, True)),
        ({"contradicted": True}, "weak", May()),
        ({"contradicted": True, "simulated": True}, "weak", May()),
        ({"simulated": True}, "held", May(False, True, True)),
        ({"determined": False}, "held", May()),
        ({"unmet": True}, "weak", May(True, True, True)),
        ({"vendor": "doosan"}, "pass", May(False, True, True)),
        ({"vendor": "universal-robots"}, "pass", May(True, True, True)),
        ({"vendor": "universal-robots", "robot": "ur5e"}, "pass", May(False, True, True)),
        ({"verdict": "weak"}, "weak", May(False, True, True)),
        ({"verdict": "misfit"}, "misfit", May()),
        ({"verdict": "weak", "converged": False}, "weak", May()),
    ],
)
def test_the_rule(changed, grade, may) -> None:
    usual = {"contradicted": False, "converged": True, "determined": True, "simulated": False, "unmet": False}
    case = {"verdict": "pass", "vendor": None, "robot": "arm.yaml", **usual, **changed}
    found = judgement(case.pop("verdict"), **case)
    assert (found.grade, found.may) == (grade, may)
