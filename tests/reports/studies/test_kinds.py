"""The folder of a study: its files, in a browser and on paper; output/test_whole_folder.py has the rest."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from chromium import PAPER, chromium
from example_studies import agreeing, cell_study, disagreeing, geometry_study, hostile, typed
from made_once import made_once

from zerobeam.model.errors import BadInput, UnsoundResult
from zerobeam.reports.output.html import html
from zerobeam.reports.output.whole_folder import check_target
from zerobeam.reports.studies.kinds import STUDIES, study_kind, study_of, study_page, write_study

Json = dict[str, Any]
Refused = Callable[..., BadInput]

WHOLE = {
    "study.html",
    "study.pdf",
    "study.json",
    "coverage.csv",
    "ranks.csv",
    "figures",
    "figures/accuracy.svg",
    *(f"figures/{kind}_{plan}.svg" for kind in ("coverage", "ranks") for plan in (1, 2, 3)),
}


@pytest.mark.browser
@pytest.mark.long
def test_chromium_opens_it_without_a_word_or_a_request(tmp_path: Path) -> None:
    file = tmp_path / "study.html"
    answer = typed(hostile())
    drawn = made_once("figures of a study hostile", lambda: study_of(answer).pictures(answer))
    file.write_text(html(study_page(answer), drawn, "study"), encoding="utf-8")
    with chromium().opened(file) as tab:
        assert "How it was done" in tab.text
        assert tab.console == []
        assert tab.asked == []


@pytest.mark.browser
@pytest.mark.long
def test_the_widest_tables_fit_on_paper(tmp_path: Path) -> None:
    paths = write_study(tmp_path / "out", geometry_study())
    with chromium().opened(paths.html, PAPER) as tab:
        assert tab.overflow() == 0


@pytest.mark.long
def test_all_files_are_there_over_those_of_before_and_stay_when_a_number_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The figures are drawn once: this is about the files."""
    answer, out = typed(agreeing()), tmp_path / "a" / "out"
    drawn = made_once("figures of a study agreeing", lambda: study_of(answer).pictures(answer))
    study = dataclasses.replace(STUDIES["coverage"], drawn=lambda _: [*drawn.values()])
    monkeypatch.setitem(STUDIES, "coverage", study)
    for of in (typed(disagreeing()), answer):
        paths = write_study(str(out), of)  # a name as a string will do
    endless = agreeing()
    endless["plans"][0]["estimators"][0]["parameters"][0]["bias"] = float("nan")
    with pytest.raises(UnsoundResult, match=r"parameters\[0\].bias is nan"):
        write_study(out, typed(endless))
    assert json.loads(paths.result.read_text(encoding="utf-8")) == agreeing()
    assert {str(path.relative_to(out)) for path in out.rglob("*")} == WHOLE
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"out"}
    assert paths.pdf.read_bytes().startswith(b"%PDF")
    assert paths.html.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert len(paths.figures) == 7
    assert all(path.exists() for path in paths.figures)


def test_of_a_study_only_its_own_files_are_replaced(
    tmp_path: Path, refused: Refused, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table that another study would have here is somebody's own. The figures are drawn once."""
    cell = typed(cell_study())
    drawn = made_once("figures of a study cell", lambda: study_of(cell).pictures(cell))
    for name, figures in (("cell", [*drawn.values()]), ("coverage", [])):
        study = dataclasses.replace(STUDIES[name], drawn=lambda _, figures=figures: figures)
        monkeypatch.setitem(STUDIES, name, study)
    (tmp_path / "study.json").write_text('{"schema": "zerobeam/study/1", "study": "table2"}')
    for name in STUDIES["table2"].tables:
        (tmp_path / name).write_text("before")
    table = tmp_path / "parameters.csv"
    table.write_text("mine")
    assert table.name in STUDIES["cell"].tables
    for answer in (cell_study(), agreeing()):
        assert table.name in str(refused(check_target, tmp_path, study_kind(tmp_path)))
        assert table.name in str(refused(write_study, tmp_path, typed(answer)))
    assert table.read_text() == "mine"
    table.unlink()
    write_study(tmp_path, cell)
    assert {path.name for path in tmp_path.glob("*.csv")} == {"parameters.csv", "time.csv", "plans.csv"}


@pytest.mark.parametrize("named", ['"another"', "null", "[1]", '{"a": 1}'])
def test_of_a_study_that_is_not_known_no_table_is_replaced(
    tmp_path: Path, refused: Refused, named: str
) -> None:
    (tmp_path / "study.json").write_text(f'{{"schema": "zerobeam/study/1", "study": {named}}}')
    check_target(tmp_path, study_kind(tmp_path))
    check_target(tmp_path / "absent", study_kind(tmp_path / "absent"))
    (tmp_path / "coverage.csv").write_text("mine")
    assert "coverage.csv" in str(refused(check_target, tmp_path, study_kind(tmp_path)))


def test_an_answer_of_no_known_study_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one of coverage, cell, table2"):
        write_study(tmp_path / "a" / "out", dataclasses.replace(typed(cell_study()), study="another"))
    assert list(tmp_path.iterdir()) == []
