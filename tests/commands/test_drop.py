"""`analyse --drop` and `report --drop`: rows are named as people count them, and what is advised works."""

import json
import os
import re

import pytest
from command_line import zerobeam
from mistyped_row import HEADER, MISTYPED

from zerobeam.model.files.run import read_run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drop")
    (folder / "header.yaml").write_text(HEADER, encoding="utf-8")
    (folder / "shots.csv").write_text(MISTYPED, encoding="utf-8")
    files = [folder / "shots.csv", "--header", folder / "header.yaml", "--target", "psd"]
    assert zerobeam("import", "csv", "--units", "deg", *files, "-o", folder / "run.jsonl").status == 0
    return folder


def text_of(answer):
    return " ".join(answer.out.split())


@pytest.fixture(scope="module")
def advised(folder):
    return zerobeam("analyse", folder / "run.jsonl")


def test_a_row_is_named_as_people_count_it_with_the_command(advised, folder):
    text = text_of(advised)
    assert advised.status == 1
    assert "Without measurement 4 (row 5 of shots.csv) the residuals are" in text
    assert "Compare measurement 4 (row 5 of shots.csv) with the original record." in text
    assert "--drop" not in text.partition("zerobeam analyse")[0]  # the command below says how
    unbroken = "".join(advised.out.replace("\\\n", "").split())
    assert f"zerobeamanalyse{folder.as_posix()}/run.jsonl--drop4" in unbroken


@pytest.mark.parametrize("which", ["4", "shots.csv:5", "some/where/shots.csv:5", "run.jsonl:6"])
def test_a_measurement_is_named_by_its_number_or_its_row(which, folder):
    assert list(read_run(folder / "run.jsonl").numbers_of([which])) == [4]


@pytest.mark.long
def test_what_is_advised_leaves_the_measurement_out(folder):
    answer = zerobeam("analyse", folder / "run.jsonl", "--drop", "shots.csv:5", "--ess", "100", "--json")
    assert answer.status == 0, answer.err
    result = json.loads(answer.out)
    assert result["verdict"] == "pass"
    assert [row["shot"] for row in result["shots"]] == [0, 1, 2, 3, 5, 6, 7, 8]
    assert result["inputs"]["header"]["provenance"]["without measurements"] == "4"


def test_a_run_without_it_is_saved_and_what_is_printed_then_works_where_one_stands(folder, monkeypatch):
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    answer = zerobeam("analyse", "../run.jsonl", "--drop", "4", "--ess", "100", "--save", "../right.jsonl")
    assert answer.status == 0, answer.err
    assert len(read_run(folder / "right.jsonl").shots) == 8
    assert "Left out by a person: measurement 4 of run.jsonl" in text_of(answer)
    (command,) = re.findall(r"zerobeam (export rapid \S+ -o \S+)", text_of(answer))
    assert zerobeam(*command.split()).status == 0
    assert os.path.exists("offsets.mod")


@pytest.mark.long
def test_a_run_without_it_is_saved_by_the_command_that_is_printed(folder, monkeypatch):
    monkeypatch.chdir(folder)
    answer = zerobeam("analyse", "run.jsonl", "--drop", "4", "--ess", "100")
    assert "solution.run.write" not in answer.out
    command = "zerobeam analyse run.jsonl --drop 4 --save run-refit.jsonl"
    assert command in answer.out
    saved = zerobeam(*command.split()[1:], "--ess", "100")
    assert "zerobeam export rapid run-refit.jsonl -o" in saved.out
    assert "--save run-refit-2.jsonl" in zerobeam("analyse", "run.jsonl", "--drop", "4", "--ess", "100").out


def test_a_measurement_that_is_not_there_is_refused(folder):
    for which in ("77", "shots.csv:77", "x", ""):
        answer = zerobeam("analyse", folder / "run.jsonl", "--drop", which)
        assert answer.status == 2
        assert "a number (0 to 8), or FILE:LINE such as shots.csv:1" in answer.err
    assert zerobeam("analyse", folder / "run.jsonl", "--save", folder / "x.jsonl").status == 2


@pytest.mark.long
def test_a_report_without_it(folder):
    answer = zerobeam(
        "report", folder / "run.jsonl", "--drop", "4,5", "--ess", "100", "-o", folder / "report"
    )
    assert answer.status in (0, 1)
    result = json.loads((folder / "report" / "result.json").read_text("utf-8"))
    assert len(result["shots"]) == 7
