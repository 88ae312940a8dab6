"""What holds for every study as people see it: one file, no network, nothing made up, names as text."""

import dataclasses
import functools
import io
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pypdf
import pytest
from chromium import PAPER, chromium
from command_line import WIDTH
from example_studies import (
    FORBIDDEN,
    agreeing,
    cell_study,
    disagreeing,
    geometry_study,
    hostile,
    hostile_cell,
    hostile_geometry,
    hostile_table2,
    table2_study,
    typed,
)
from example_sweeps import (
    hostile_lines,
    hostile_map,
    hostile_sweep,
    map_sweep,
    pattern_map_sweep,
    pattern_shots_sweep,
    patterns_sweep,
    shots_sweep,
)
from golden_files import assert_golden
from made_once import made_once
from pages import Page, assert_fetches_nothing
from study_text import cells, printed, tables_of, text_of, texts_of, words

from zerobeam.experiments.studies.answer import StudyAnswer
from zerobeam.model.errors import BadInput, UnsoundResult
from zerobeam.model.records import to_json
from zerobeam.reports.output.html import html
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.output.whole_folder import check_target
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_pages import STUDIES, study_kind, study_of, study_page, write_study
from zerobeam.reports.style.blocks import Block, Facts, FigureBlock, Paragraph, section_of, table_of
from zerobeam.reports.style.blocks import Page as View
from zerobeam.reports.style.canvas import Picture
from zerobeam.words.wording import csv_text

Json = dict[str, Any]

MADE: dict[str, Callable[[], Json | StudyAnswer]] = {
    "agreeing": agreeing,
    "disagreeing": disagreeing,
    "cell": cell_study,
    "table2": table2_study,
    "geometry": geometry_study,
    "sweep_patterns": patterns_sweep,
    "sweep_shots": shots_sweep,
    "sweep_pattern_shots": pattern_shots_sweep,
    "sweep_map": map_sweep,
    "sweep_pattern_map": pattern_map_sweep,
    "hostile": hostile,
    "hostile cell": hostile_cell,
    "hostile table2": hostile_table2,
    "hostile geometry": hostile_geometry,
    "hostile words": hostile_sweep,
    "hostile lines": hostile_lines,
    "hostile map": hostile_map,
}
GOLDEN = (
    *("agreeing", "disagreeing", "cell", "table2", "geometry"),
    *("sweep_patterns", "sweep_shots", "sweep_pattern_map"),
)
FIGURES = {
    "agreeing": {"accuracy", *(f"{kind}_{plan}" for kind in ("coverage", "ranks") for plan in (1, 2, 3))},
    "cell": {"coverage", "time"},
    "table2": {"scatter"},
    "geometry": {"uncertainty", "z", "coverage"},
    "sweep_patterns": {"lines"},
    "sweep_shots": {"lines"},
    "sweep_pattern_shots": {"lines"},
    "sweep_map": {"map"},
    "sweep_pattern_map": {"map", "ratio"},
}
# The numbers that a study claims of one parameter.
ERRORS = ("bias", "bias_mcse", "rmse", "predicted_std", "coverage")
CLAIMS = {
    "agreeing": ERRORS,
    "cell": ERRORS,
    "table2": ("predicted_std", "alone_deg", "simulated_std", "simulated"),
    "geometry": (*ERRORS, "z", "z_low", "z_high", "checked_std"),
}


@functools.cache
def answer_of(name: str) -> Any:
    return typed(MADE[name]())


@functools.cache
def drawn_of(name: str) -> dict[str, Picture]:
    answer = answer_of(name)
    return made_once(f"figures of a study {name}", lambda: study_of(answer).pictures(answer))


@pytest.mark.long
def test_a_plan_of_coverage_has_one_page() -> None:
    answer = answer_of("agreeing")
    document = pdf(study_of(answer).page(answer), drawn_of("agreeing"))
    pages = [" ".join(page.extract_text().split()) for page in pypdf.PdfReader(io.BytesIO(document)).pages]
    at = {
        plan.name: [i for i, text in enumerate(pages) if text.startswith(f"Plan {plan.name} Plan ")]
        for plan in answer.plans
    }
    starts = [number for numbers in at.values() for number in numbers]
    assert len(starts) == len(answer.plans)
    assert starts == list(range(starts[0], starts[0] + len(starts)))
    # The next begins with the comparison of the fits: the last plan has one page, too.
    assert pages[starts[-1] + 1].startswith("The midpoint fit against the likelihood fit")


def blocks(view: View) -> list[Block]:
    return [block for section in view.sections for block in section.all]


@pytest.mark.parametrize("name", GOLDEN)
@pytest.mark.one_in(3)
def test_a_study_in_the_terminal(name: str) -> None:
    assert_golden(f"study_{name}.txt", printed(answer_of(name)))


def test_the_standing_has_a_shape_and_a_word_besides_its_colour() -> None:
    plain, coloured = printed(disagreeing()), printed(disagreeing(), colours=True)
    assert "\x1b[" not in plain
    assert "\x1b[" in coloured
    assert plain.startswith("Does not agree. ")
    for mark in ("● agrees", "◆ does not agree", "■ control: fails,", "not determined: J2 (δ2)"):
        assert mark in " ".join(plain.split())
    assert "◆" not in printed(agreeing())


@pytest.mark.parametrize(
    "name",
    ["agreeing", "cell", "table2", "sweep_patterns", pytest.param("disagreeing", marks=pytest.mark.long)],
)
@pytest.mark.one_in(4)
def test_every_cell_and_sentence_of_the_page_is_in_the_pdf(name: str) -> None:
    view = study_page(answer_of(name))
    reader = pypdf.PdfReader(io.BytesIO(pdf(view, {})))  # figures take most of the time to read
    text = re.sub(r"\s", "", text_of(reader))
    texts = [*cells(view), view.verdict.sentence, *view.notes]
    texts += [block.text for block in blocks(view) if isinstance(block, Paragraph)]
    texts += [value for block in blocks(view) if isinstance(block, Facts) for _, value in block.rows]
    assert len(texts) > 80
    for words_of_it in texts:
        assert re.sub(r"\s", "", words_of_it) in text, words_of_it
    titles = [entry["/Title"] for entry in reader.outline if not isinstance(entry, list)]
    assert titles == [section.title for section in view.sections if section.level == 1]
    assert reader.trailer["/Root"]["/MarkInfo"]["/Marked"]


@pytest.mark.parametrize(("name", "of"), [("agreeing", "study coverage, seed 0."), ("sweep_map", ", seed ")])
def test_it_says_how_it_is_cited(name: str, of: str) -> None:
    facts = {
        key: text
        for block in blocks(study_page(answer_of(name)))
        if isinstance(block, Facts)
        for key, text in block.rows
    }
    citation = facts["To cite"]
    assert citation.startswith(
        f"The zerobeam contributors: zerobeam {answer_of(name).versions['zerobeam']}, "
    )
    assert of in citation
    assert "doi:10.1155/2014/769343" in citation


def unidentifiable(content: Json) -> Iterator[Json]:
    """The parameters that a plan does not determine, but of controls."""
    for plan in content["plans"]:
        for part in plan.get("estimators", [plan]):
            if not part.get("control"):
                yield from (row for row in part["parameters"] if row["status"] == "unidentifiable")


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, keys in CLAIMS.items() for key in keys])
@pytest.mark.one_in(3)
def test_a_study_with_a_made_up_number_cannot_be_made(name: str, key: str) -> None:
    content = to_json(answer_of(name))
    share = {"level": 0.95, "held": 5, "of": 9, "agrees": True}
    share |= dict.fromkeys(("share", "low", "high"), FORBIDDEN)
    rows = list(unidentifiable(content))
    assert rows
    for row in rows:
        before = row[key]
        row[key] = {
            "coverage": [share] if isinstance(before, list) else share,
            "simulated": dict.fromkeys(("q2_5", "median", "q97_5"), FORBIDDEN),
        }.get(key, FORBIDDEN)
        with pytest.raises(
            UnsoundResult, match=rf"'{row['name']}.*' is unidentifiable, yet it has a value as {key}"
        ):
            typed(content)
        row[key] = before
    typed(content)


def test_only_a_control_may_claim_what_a_plan_does_not_determine() -> None:
    content = cell_study()
    content["plans"][3]["parameters"][0]["bias"] = FORBIDDEN
    content["plans"][3]["control"] = True
    claimed = typed(content).plans[3]
    assert claimed.parameters[0].bias == FORBIDDEN
    with pytest.raises(UnsoundResult):
        dataclasses.replace(claimed, control=False)


@pytest.mark.parametrize(
    ("name", "table"),
    [
        ("agreeing", "coverage.csv"),
        ("cell", "parameters.csv"),
        ("table2", "scatter.csv"),
        ("geometry", "parameters.csv"),
    ],
)
@pytest.mark.one_in(2)
def test_an_undetermined_parameter_has_no_number(name: str, table: str) -> None:
    """Of a study of nothing else."""
    content = to_json(answer_of(name))
    content["plans"] = [plan for plan in content["plans"] if list(unidentifiable({"plans": [plan]}))]
    (plan,) = content["plans"]
    plan["estimators"] = [part for part in plan.get("estimators", []) if not part["control"]]
    for part in plan["estimators"] or [plan]:
        part["parameters"] = [row for row in part["parameters"] if row["status"] == "unidentifiable"]
    answer = typed(content)
    view, study = study_page(answer), study_of(answer)
    starts = ("Share of intervals that contain the true value, in %, with", "Bias and root", "Plan ")
    rows = [row for start in starts for one in tables_of(view, start) for row in texts_of(one)]
    rows = [row for row in rows if row[0].startswith("J")]
    assert len(rows) == {"agreeing": 6, "geometry": 2}.get(name, 1)
    assert all(row[-1] == NOT_DETERMINED for row in rows)
    texts = [" ".join(Page(html(view, {}, "study")).text), printed(answer)]
    texts += [words(picture.svg) + picture.alt for picture in study.pictures(answer).values()]
    assert sum(text.count(NOT_DETERMINED) for text in texts) >= 2
    for row in study.tables[table](answer):
        assert all(
            row[column] is None for column in row if column.startswith(("held", "share", *CLAIMS[name]))
        )


@pytest.mark.parametrize("name", [name for name in MADE if name != "disagreeing"])  # its figures take long
@pytest.mark.one_in(3)
def test_the_page_is_one_well_formed_file_that_fetches_nothing(name: str) -> None:
    view, drawn = study_page(answer_of(name)), drawn_of(name)
    assert set(drawn) == FIGURES.get(name, set(drawn))
    text = html(view, drawn, "study")
    text.encode()
    page = Page(text)
    assert_fetches_nothing(page)
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels == [1, *(section.level + 1 for section in view.sections)]
    figures = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    shown = [block.name for block in blocks(view) if isinstance(block, FigureBlock)]
    assert sorted(shown) == sorted(drawn)
    assert [bool(attributes["aria-label"]) for attributes in figures] == [True] * len(shown)
    ids = re.findall(r'\bid="([^"]+)"', text)
    assert len(ids) == len(set(ids)) > 0
    assert "<image" not in text
    for table in study_of(answer_of(name)).tables:
        assert table in " ".join(page.text)


@pytest.mark.parametrize("name", [name for name in MADE if name.startswith("hostile")])
@pytest.mark.at_length(r"^hostile")
def test_hostile_names_are_shown_as_they_are_and_do_nothing(name: str) -> None:
    answer, drawn = answer_of(name), drawn_of(name)
    view, study = study_page(answer), study_of(answer)
    page, terminal = html(view, drawn, "study"), printed(answer)
    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert pdf(view, drawn).startswith(b"%PDF")
    text = text_of(pypdf.PdfReader(io.BytesIO(pdf(view, {}))))  # without figures, whose text is slow to read
    assert "#import" in text
    assert "root:" not in text
    if name in ("hostile", "hostile cell", "hostile table2"):
        assert "alert(&#39;x&#39;)" in page
        assert "{{ 7*7 }}" in page
        assert '#import "/etc/passwd": *; $x^2$ *bold* `raw` @cite <label>' in text
    assert max(len(line) for line in terminal.splitlines()) <= WIDTH
    tables = "".join(csv_text(rows(answer)) for rows in study.tables.values())
    assert "<script>" in tables or name == "hostile map"
    for shown in (page, terminal, tables, *(picture.svg + picture.alt for picture in drawn.values())):
        for letter in ("\x00", "\x1b", "\u202e"):
            assert letter not in shown


def test_names_give_the_terminal_no_commands() -> None:
    content = hostile()
    content["notes"].append("[bold red]beware[/bold red] \x1b[2J")
    text = printed(content)
    assert "[bold red]beware[/bold red] \\x1b[2J" in text
    assert "\x1b" not in text


def test_what_leads_up_to_the_first_figure_stays_with_the_heading_unless_it_is_a_table() -> None:
    words_of_it, figure = Paragraph("so"), FigureBlock("a")
    table = table_of("", [], [])
    kept = section_of("", words_of_it, None, figure, words_of_it, FigureBlock("b"))
    assert kept.lead == (words_of_it, figure)
    assert kept.blocks == (words_of_it, FigureBlock("b"))
    assert section_of("", words_of_it, table, figure).lead == ()
    assert section_of("", words_of_it).blocks == (words_of_it,)


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
