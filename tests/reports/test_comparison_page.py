"""The comparison as people see it: page, folder, figure, terminal."""

import csv
import functools
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pypdf
import pytest
from command_line import WIDTH
from exact_runs import demo_runs
from example_results import HOSTILE_NAMES
from histories import a_result, write_result
from pages import Page, assert_fetches_nothing
from repeated_runs import COVARIANCE, drawn, repeat, repeats, table_file
from rich.console import Console
from study_text import tables_of, texts_of

from zerobeam.analysis.answer.findings import FileWarning
from zerobeam.analysis.repeatability.compare import Comparison, compare
from zerobeam.experiments.studies.table2 import PRINTED_MEAN, PRINTED_STD
from zerobeam.model.errors import UnsoundResult
from zerobeam.reports.comparison_page import comparison_page, runs_picture, write_comparison
from zerobeam.reports.output.html import html
from zerobeam.reports.output.terminal import print_page
from zerobeam.reports.style import blocks
from zerobeam.reports.style.canvas import Picture
from zerobeam.words.sentences import to_json


@functools.cache
def answer(odd: float = 0.0) -> Comparison:
    """Five runs of three offsets, the fourth off by `odd` degrees in delta4."""
    values = drawn(5, seed=1)
    values[3, 2] += odd
    return Comparison.of_repeats("runs", repeats(values), 0)


def lost() -> Comparison:
    """Three runs, none of which determines delta3."""
    holes = np.full((3, 3), np.nan)
    values = drawn(3, seed=2)
    values[:, 1] = np.nan
    status = ("identified", "unidentifiable", "weak")
    return Comparison.of_repeats("runs", repeats(values, covariance=holes, status=status), 0)


def panels(svg: str) -> list[tuple[float, list[float]]]:
    """Of each panel its height and where its dots are in it (0 below, 1 above), from the drawing."""
    boxes = re.findall(
        r'<clipPath id="[^"]*">\s*<(?:\w+:)?rect x="[\d.]+" y="([\d.]+)" width="[\d.]+" height="([\d.]+)"',
        svg,
    )
    dots = [float(y) for y in re.findall(r'<(?:\w+:)?use [^>]*y="([\d.]+)" style="fill: #1b2126', svg)]
    found = []
    for y, height in {(float(y), float(height)) for y, height in boxes}:
        inside = [1 - (dot - y) / height for dot in dots if y <= dot <= y + height]
        found.append((height, inside))
    return found


def test_the_runs_fill_their_panels() -> None:
    """The mean of two runs has an interval by Student's t of one degree of freedom: a band 6 to 13 times as
    wide as the runs are apart does not set the scale."""
    values = np.array([[1.0, 1.0, 1.0], [1.2, 1.1, 1.04]])
    two = Comparison.of_repeats("runs", repeats(values, covariance=COVARIANCE / 1e4), 0)
    assert all(
        row.mean is not None and row.mean.interval95[1] > values[1, i] for i, row in enumerate(two.offsets)
    )
    picture = picture_of(two)
    assert "which reaches beyond a panel" in picture.title
    shown = panels(picture.svg)
    assert len(shown) == 3
    for _, at in shown:
        assert len(at) == 2
        assert max(at) - min(at) > 0.6
    assert "reaches beyond" not in picture_of(answer()).title


@pytest.mark.parametrize(("odd", "factor"), [(0.0, "0.55"), (5.0, "133")])
def test_factors_are_plain_numbers(odd: float, factor: str) -> None:
    view = comparison_page(answer(odd))
    assert f"scatter {factor} times as much as predicted" in view.verdict.sentence
    said = " ".join(texts for row in table(view, "Standard deviation over the runs") for texts in row)
    assert not re.search(r"\de[+−-]?\d", view.verdict.sentence.partition("(")[0] + said)


def picture_of(told: Comparison) -> Picture:
    picture = runs_picture(told)
    assert picture is not None
    return picture


def printed(told: Comparison) -> str:
    text = io.StringIO()
    print_page(
        Console(file=text, width=WIDTH, highlight=False, color_system=None), comparison_page(told).brief
    )
    return text.getvalue()


def table(view: blocks.Page, caption: str) -> list[list[str]]:
    (found,) = tables_of(view, caption)
    return texts_of(found)


def number(text: str) -> float:
    return float(re.sub(r"[°\u00a0].*$", "", text).replace("\u2212", "-"))


def test_table_2_is_shown_to_the_digits_of_the_paper(tmp_path: Path) -> None:
    rows = table(comparison_page(compare([table_file(tmp_path)])), "Mean over the runs")
    for (name, mean, _, std, _), printed_mean, printed_std in zip(
        rows, PRINTED_MEAN, PRINTED_STD, strict=True
    ):
        assert name.startswith("J")
        assert number(mean) == pytest.approx(printed_mean, abs=0.5001e-4)
        assert number(std) == pytest.approx(printed_std, abs=0.5001e-4)


def test_the_tables_say_what_the_answer_says() -> None:
    told = answer(odd=0.2)
    view = comparison_page(told)
    for row, own in zip(table(view, "Standard deviation"), told.offsets, strict=True):
        assert own.scatter is not None
        assert own.predicted_std is not None
        assert own.test is not None
        for text, value in zip(row[1:4], (own.scatter.std, own.predicted_std, own.test.ratio), strict=True):
            assert number(text) == pytest.approx(value, rel=0.06)
    assert [row[3] for row in table(view, "Each run against")][3] == "outlier, below 0.001"
    assert view.verdict.word == "Does not agree"
    assert comparison_page(answer()).verdict.word == "Agrees"
    assert not any("outlier" in row[3] for row in table(comparison_page(answer()), "Each run against"))


def test_what_is_assumed_is_not_shown_as_measured(tmp_path: Path) -> None:
    """Of runs, and of their results: the word and the reason of the report stand beside the judgement."""
    results = [write_result(tmp_path / f"{k}.json", a_result(when=f"2026-01-0{k}")) for k in (1, 2)]
    demos = [demo.path for demo in demo_runs() if demo.name in ("good", "x-pattern")]
    for told in (compare(results), compare(demos)):
        page, assumed = comparison_page(told), [own.name for own in told.offsets if own.assumed]
        assert assumed == ["delta6"]
        means = next(block for block in page.sections[0].all if isinstance(block, blocks.Table))
        assert [(row.cells[0].text, row.cells[0].mark) for row in means.rows][-2:] == [
            ("J5 (δ5)", ""),
            ("J6 (δ6), assumed", "assumed"),
        ]
        reasons = [note for note in page.notes if "mounted anew" in note]
        assert reasons
        assert all(": J6 (δ6) is assumed, as good as the laser's mounting: " in note for note in reasons)


def test_what_no_run_determines_is_shown_without_a_number() -> None:
    told = lost()
    view = comparison_page(told)
    assert view.verdict.word == "Not tested"
    assert table(view, "Mean over the runs")[1] == ["J3 (δ3)", "not compared"]
    assert table(view, "Drift")[1] == ["J3 (δ3)", "not determined"]
    assert {row[2] for row in table(view, "Offsets of each run")} == {"unidentifiable"}
    assert "δ3" not in picture_of(told).alt


@pytest.mark.long
def test_the_folder(tmp_path: Path) -> None:
    told, folder = answer(odd=0.2), tmp_path / "out"
    for name in (str(folder), folder):
        paths = write_comparison(name, told)
    assert json.loads(paths.result.read_text(encoding="utf-8")) == to_json(told)
    rows = list(csv.DictReader(io.StringIO(paths.tables[0].read_text(encoding="utf-8"))))
    assert len(rows) == 15
    assert float(rows[4]["estimate"]) == told.runs[4].offsets[0].estimate
    last = told.offsets[2].mean
    assert last is not None
    assert float(rows[14]["mean"]) == last.value
    page = Page(paths.html.read_text(encoding="utf-8"))
    assert_fetches_nothing(page)
    text = " ".join(" ".join(page.text).split())
    pdf = pypdf.PdfReader(paths.pdf)
    typeset = " ".join(" ".join(sheet.extract_text() for sheet in pdf.pages).split())
    for row in table(comparison_page(told), "Mean over the runs"):
        for cell in row:
            assert cell in text
            assert cell in typeset


def test_a_number_for_what_a_run_does_not_determine_cannot_be_made() -> None:
    own = lost().runs[0].offsets[1]
    for number in ({"estimate": 1.0}, {"std": 1.0}):
        with pytest.raises(UnsoundResult, match="delta3"):
            replace(own, **number)
    assert replace(own, status="weak", estimate=1.0).estimate == 1.0


def test_the_outlier_has_a_shape_and_a_word_besides_its_colour() -> None:
    odd, even = (picture_of(told) for told in (answer(odd=0.2), answer()))
    assert "The outlier is run 4" in odd.alt
    assert "diamond" in odd.title
    assert "outlier" not in even.alt + even.title
    assert "◆ outlier" in printed(answer(odd=0.2))
    nothing = Comparison.of_repeats("runs", [repeat(value) for value in drawn(1, seed=3)], 0)
    assert runs_picture(nothing) is None


@pytest.mark.parametrize("told", [answer(), answer(odd=0.2), lost()])
def test_no_line_is_wider_than_the_terminal(told: Comparison) -> None:
    assert max(len(line) for line in printed(told).splitlines()) <= WIDTH


def test_names_do_no_harm() -> None:
    told = answer(odd=0.2)
    runs = tuple(replace(run, name=name) for run, name in zip(told.runs, HOSTILE_NAMES, strict=False))
    warning = FileWarning("[bold red]beware[/bold red] \x1b[2J \u202e")
    runs = (replace(runs[0], findings=(warning,)), *runs[1:])
    told = replace(told, runs=runs, odd_run=runs[0].name)
    page = Page(html(comparison_page(told), {"runs": picture_of(told)}, "study"))
    assert_fetches_nothing(page)
    text = printed(told)
    assert "[bold red]beware[/bold red] \\x1b[2J" in text
    for letter in ("\x00", "\x1b", "\u202e"):
        assert letter not in text
        assert letter not in " ".join(page.text)
