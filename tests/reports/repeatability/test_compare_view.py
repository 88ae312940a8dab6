"""The comparison as people see it: page, folder, figure, terminal."""

from __future__ import annotations

import copy
import csv
import functools
import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pypdf
import pytest
from command_line import WIDTH
from example_results import HOSTILE_NAMES
from pages import Page, assert_fetches_nothing
from repeated_runs import drawn, repeat, repeats, table_file
from rich.console import Console

from zerobeam.analysis.repeatability.compare import compare, compared
from zerobeam.analysis.status import UnsoundResult
from zerobeam.experiments.studies.table2 import PRINTED_MEAN, PRINTED_STD
from zerobeam.model.errors import BadInput
from zerobeam.reports.output.html import html
from zerobeam.reports.repeatability.compare_view import compare_pictures, compare_view, write_comparison
from zerobeam.reports.repeatability.terminal_compare import print_comparison

Json = dict[str, Any]


@functools.cache
def _answer(odd: float) -> Json:
    values = drawn(5, seed=1)
    values[3, 2] += odd
    return compared("runs", repeats(values), 0)


def answer(odd: float = 0.0) -> Json:
    """Five runs of three offsets, the fourth off by `odd` degrees in delta4."""
    return copy.deepcopy(_answer(odd))


def lost() -> Json:
    """Three runs, none of which tells delta3."""
    holes = np.full((3, 3), np.nan)
    values = drawn(3, seed=2)
    values[:, 1] = np.nan
    status = ("identified", "unidentifiable", "weak")
    return compared("runs", repeats(values, covariance=holes, status=status), 0)


def printed(told: Json) -> str:
    text = io.StringIO()
    print_comparison(Console(file=text, width=WIDTH, highlight=False, color_system=None), told)
    return text.getvalue()


def table(view: Json, caption: str) -> list[list[str]]:
    (found,) = [
        block
        for section in view.sections
        for block in section.all
        if block.kind == "table" and block.caption.startswith(caption)
    ]
    return [[cell.text for cell in row.cells] for row in found.rows]


def number(text: str) -> float:
    return float(re.sub(r"[°\u00a0].*$", "", text).replace("\u2212", "-"))


def test_table_2_is_shown_to_the_digits_of_the_paper(tmp_path: Path) -> None:
    rows = table(compare_view(compare([table_file(tmp_path)])), "Mean over the runs")
    for (name, mean, _, std, _), printed_mean, printed_std in zip(
        rows, PRINTED_MEAN, PRINTED_STD, strict=True
    ):
        assert name.startswith("δ")
        assert number(mean) == pytest.approx(printed_mean, abs=0.5001e-4)
        assert number(std) == pytest.approx(printed_std, abs=0.5001e-4)


def test_the_tables_say_what_the_answer_says() -> None:
    told = answer(odd=0.2)
    view = compare_view(told)
    for row, own in zip(table(view, "Standard deviation"), told["offsets"], strict=True):
        for text, key in zip(row[1:4], ("std", "predicted_std", "ratio"), strict=True):
            assert number(text) == pytest.approx(own[key], rel=0.06)
    assert [row[3] for row in table(view, "Each run against")][3] == "the odd one, p below 0.001"
    assert view.verdict.word == "Does not agree"
    assert compare_view(answer()).verdict.word == "Agrees"
    assert not any("odd" in row[3] for row in table(compare_view(answer()), "Each run against"))


def test_what_no_run_tells_is_shown_without_a_number() -> None:
    told = lost()
    view = compare_view(told)
    assert view.verdict.word == "Not tested"
    assert table(view, "Mean over the runs")[1] == ["δ3", "not compared"]
    assert table(view, "Drift")[1] == ["δ3", "cannot be told"]
    assert {row[2] for row in table(view, "Offsets of each run")} == {"not determined"}
    assert "δ3" not in compare_pictures(told)["runs"].alt


def test_the_folder(tmp_path: Path) -> None:
    told, folder = answer(odd=0.2), tmp_path / "out"
    for _ in range(2):
        paths = write_comparison(folder, told)
    assert json.loads(paths.compare.read_text(encoding="utf-8")) == told
    rows = list(csv.DictReader(io.StringIO(paths.table.read_text(encoding="utf-8"))))
    assert len(rows) == 15
    assert float(rows[4]["estimate"]) == told["runs"][4]["offsets"][0]["estimate"]
    assert float(rows[14]["mean"]) == told["offsets"][2]["mean"]
    page = Page(paths.html.read_text(encoding="utf-8"))
    assert_fetches_nothing(page)
    text = " ".join(" ".join(page.text).split())
    pdf = pypdf.PdfReader(paths.pdf)
    typeset = " ".join(" ".join(sheet.extract_text() for sheet in pdf.pages).split())
    for row in table(compare_view(told), "Mean over the runs"):
        for cell in row:
            assert cell in text
            assert cell in typeset
    foreign = tmp_path / "other"
    foreign.mkdir()
    (foreign / "mine.txt").write_text("mine")
    with pytest.raises(BadInput, match="holds other things"):
        write_comparison(foreign, told)


def test_a_number_for_what_a_run_cannot_tell_is_not_written(tmp_path: Path) -> None:
    told = lost()
    told["runs"][0]["offsets"][1]["estimate"] = 1.0
    with pytest.raises(UnsoundResult, match="delta3"):
        write_comparison(tmp_path / "out", told)
    assert not (tmp_path / "out").exists()


def test_the_odd_run_has_a_shape_and_a_word_besides_its_colour() -> None:
    odd, even = (compare_pictures(told)["runs"] for told in (answer(odd=0.2), answer()))
    assert "The odd one is run 4" in odd.alt
    assert "diamond" in odd.title
    assert "odd" not in even.alt + even.title
    assert "◆ the odd one" in printed(answer(odd=0.2))
    nothing = compared("runs", [repeat(value) for value in drawn(1, seed=3)], 0)
    assert compare_pictures(nothing) == {}


@pytest.mark.parametrize("told", [answer(), answer(odd=0.2), lost()])
def test_no_line_is_wider_than_the_terminal(told: Json) -> None:
    assert max(len(line) for line in printed(told).splitlines()) <= WIDTH


def test_names_do_no_harm() -> None:
    told = answer(odd=0.2)
    for run, name in zip(told["runs"], HOSTILE_NAMES, strict=False):
        run["name"] = name
    told["odd_run"] = told["runs"][0]["name"]
    told["notes"].append("[bold red]beware[/bold red] \x1b[2J \u202e")
    view, pictures = compare_view(told), compare_pictures(told)
    page = Page(html(view, pictures, "study"))
    assert_fetches_nothing(page)
    text = printed(told)
    assert "[bold red]beware[/bold red] \\x1b[2J" in text
    for letter in ("\x00", "\x1b", "\u202e"):
        assert letter not in text
        assert letter not in " ".join(page.text)
