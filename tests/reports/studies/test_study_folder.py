"""A study as people see it: every number as in its answer, controls in plain sight, nothing made up."""

from __future__ import annotations

import csv
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
from example_geometry_study import geometry_study
from example_studies import FORBIDDEN, agreeing, cell_study, disagreeing, hostile, typed
from made_once import made_once
from pages import Page, assert_fetches_nothing
from study_text import cells, tables_of, text_of, texts_of, words

from zerobeam.analysis.status import UnsoundResult
from zerobeam.model.errors import BadInput
from zerobeam.reports.output import whole_folder
from zerobeam.reports.output.html import html
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.studies.coverage_page import comparison
from zerobeam.reports.studies.kinds import STUDIES, study_of, study_page
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_folder import check_target, write_study
from zerobeam.reports.style.canvas import Picture
from zerobeam.words.wording import label

Json = dict[str, Any]
Refused = Callable[..., BadInput]

SHARES = "Share of intervals that hold the truth, in %, with its"
ANSWERS = {"agreeing": agreeing, "disagreeing": disagreeing, "hostile": hostile}
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


@functools.cache
def drawn_of(name: str) -> dict[str, Picture]:
    answer = typed(ANSWERS[name]())
    return made_once(f"figures of a study {name}", lambda: study_of(answer).pictures(answer))


def draw_once(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    drawn = drawn_of(name)  # by what draws them, before that is replaced
    study = dataclasses.replace(STUDIES["coverage"], drawn=lambda _: [*drawn.values()])
    monkeypatch.setitem(STUDIES, "coverage", study)


@pytest.fixture
def drawn_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures are drawn once for all tests of the folder, which are about its files."""
    draw_once(monkeypatch, "agreeing")


def page_of(answer: Json, drawn: dict[str, Picture] | None = None) -> str:
    return html(study_page(typed(answer)), drawn or {}, "study")


def everything(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*")}


def number(text: str) -> float:
    return float(text.replace("\u2212", "-").removesuffix("°").removesuffix("\u00a0mm"))


# ── the same numbers everywhere ───────────────────────────────────────────────────────────────


def told_shares(plan: Json) -> Iterator[tuple[str, list[Json] | None]]:
    """The rows of a plan's table of coverage: a name, and the shares (None: a heading, or not determined)."""
    for estimator in plan["estimators"]:
        yield estimator["name"], None
        for row in estimator["parameters"]:
            yield label(row["name"]), row["coverage"] or None


def disagreements(page: str, answer: Json) -> list[str]:
    """Cells of the tables of coverage in a page that are not what the answer says, rounded."""
    tables = [
        table for table in re.findall(r"<table\b.*?</table>", page, re.S) if "with its 95 % bin" in table
    ]
    assert len(tables) == len(answer["plans"])
    found = []
    for table, plan in zip(tables, answer["plans"], strict=True):
        for cells_of_row, (name, entries) in zip(Page(table).rows[1:], told_shares(plan), strict=True):
            assert cells_of_row[0] == name
            if entries is None:
                continue
            for cell, entry in zip(cells_of_row[1:], entries, strict=True):
                printed = re.fullmatch(r"([\d.]+) \(([\d.]+) to ([\d.]+)\)", cell)
                assert printed, cell
                wanted = (entry["share"], entry["low"], entry["high"])
                # One decimal of a per cent is what 1000 data sets can tell.
                if any(
                    abs(float(text) - 100 * value) > 0.051
                    for text, value in zip(printed.groups(), wanted, strict=True)
                ):
                    found.append(f"{name}: {cell}")
    return found


@pytest.mark.parametrize("answer", [agreeing, disagreeing])
def test_every_share_of_the_page_is_that_of_the_answer(answer: Callable[[], Json]) -> None:
    assert disagreements(page_of(answer()), answer()) == []


def test_a_share_that_is_not_that_of_the_answer_is_caught() -> None:
    other = agreeing()
    other["plans"][1]["estimators"][2]["parameters"][3]["coverage"][2]["share"] += 0.002
    found = disagreements(page_of(agreeing()), other)
    assert len(found) == 1
    assert found[0].startswith("J5 (δ5): ")


def test_bias_and_rmse_are_rounded_by_their_own_uncertainty() -> None:
    answer = agreeing()
    tables = re.findall(r"<table\b.*?</table>", page_of(answer), re.S)
    rows = Page(next(table for table in tables if "Bias and root" in table)).rows
    for cells_of_row, row in zip(rows[2:7], answer["plans"][0]["estimators"][0]["parameters"], strict=True):
        bias, mcse, rmse, predicted = (number(cell) for cell in cells_of_row[1:])
        about = row["rmse"] / (2 * 1000) ** 0.5
        assert abs(bias - row["bias"]) <= 0.05 * row["bias_mcse"]
        assert abs(mcse - row["bias_mcse"]) <= 0.05 * row["bias_mcse"]
        assert abs(rmse - row["rmse"]) <= 0.05 * about
        assert abs(predicted - row["predicted_std"]) <= 0.05 * about


@pytest.mark.parametrize("name", ["agreeing", pytest.param("disagreeing", marks=pytest.mark.long)])
def test_every_cell_and_sentence_of_the_page_is_in_the_pdf(name: str) -> None:
    view = study_page(typed(ANSWERS[name]()))
    reader = pypdf.PdfReader(io.BytesIO(pdf(view, {})))  # figures take most of the time to read
    text = text_of(reader).replace(" ", "")
    compared = comparison(typed(ANSWERS[name]()).plans)
    assert "Above 1 the midpoint fit is the worse." in compared
    for said in [*cells(view), view.verdict.sentence, compared, *view.notes]:
        assert re.sub(r"\s", "", said) in text, said
    titles = [entry["/Title"] for entry in reader.outline if not isinstance(entry, list)]
    assert titles[:3] == ["All plans", "How it was done", "Plan good"]
    assert reader.trailer["/Root"]["/MarkInfo"]["/Marked"]


def test_the_tables_in_csv_say_what_the_answer_says(tmp_path: Path, drawn_before: None) -> None:
    answer = agreeing()
    paths = write_study(tmp_path / "out", typed(answer))
    assert json.loads(paths.study.read_text(encoding="utf-8")) == answer
    coverage, rank = paths.tables
    assert (coverage.name, rank.name) == ("coverage.csv", "ranks.csv")
    shares = list(csv.DictReader(io.StringIO(coverage.read_text(encoding="utf-8"))))
    assert len(shares) == 3 * 5 * 5 * 4
    wanted = [
        entry or {"level": level}
        for plan in answer["plans"]
        for estimator in plan["estimators"]
        for row in estimator["parameters"]
        for level, entry in zip(answer["settings"]["levels"], row["coverage"] or [None] * 4, strict=True)
    ]
    for row, entry in zip(shares, wanted, strict=True):
        assert float(row["level"]) == entry["level"]
        assert row["held"] == str(entry.get("held", ""))
        assert row["high"] == str(entry.get("high", ""))
    ranks = list(csv.DictReader(io.StringIO(rank.read_text(encoding="utf-8"))))
    assert len(ranks) == 3 * 2 * 5 * 20
    assert sum(int(row["count"]) for row in ranks) == 3 * 2 * 5 * 1000


# ── what must be seen ─────────────────────────────────────────────────────────────────────────


def test_controls_stand_outside_in_the_figure_and_estimators_do_not() -> None:
    """A share beyond its panel is written as a number, and only such a one."""
    for i, plan in enumerate(agreeing()["plans"], start=1):
        text = words(drawn_of("agreeing")[f"coverage_{i}"].svg)
        written = re.findall(r"\d+\.\d", text)
        far = [
            f"{100 * entry['share']:.1f}"
            for estimator in plan["estimators"]
            for row in estimator["parameters"]
            for entry in row["coverage"]
            if abs(entry["share"] - entry["level"])
            > 6 * (entry["level"] * (1 - entry["level"]) / 1000) ** 0.5
        ]
        assert sorted(written) == sorted(far)
        controls = [
            entry
            for estimator in plan["estimators"]
            if estimator["control"]
            for row in estimator["parameters"]
            for entry in row["coverage"]
        ]
        assert len(far) == len(controls) >= 36
        assert drawn_of("agreeing")[f"coverage_{i}"].alt.count("control: fails, as it must") == 2


def test_each_estimator_says_in_words_whether_it_agrees() -> None:
    overview = Page(re.findall(r"<table\b.*?</table>", page_of(disagreeing()), re.S)[0]).rows[1:]
    told = [row[1] for row in overview if not row[0].startswith("Plan ")]
    control = "control: fails, as it must"
    fine = ["agrees", "agrees", "agrees", control, control]
    assert told == [*fine, "agrees", "does not agree", "agrees", control, control, *fine]
    assert "Does not agree." in " ".join(Page(page_of(disagreeing())).text)


def test_a_control_that_passes_is_no_agreement() -> None:
    answer = agreeing()
    answer["plans"][0]["estimators"][3]["agrees"] = True
    text = " ".join(Page(page_of(answer)).text)
    assert "control: passes, but must not" in text
    assert "control: passes, but must not" not in " ".join(Page(page_of(agreeing())).text)


def test_the_overview_names_the_parameter_that_is_farthest_off() -> None:
    answer = agreeing()
    entry = answer["plans"][0]["estimators"][0]["parameters"][3]["coverage"][1]
    entry |= {"share": 0.871, "held": 871}
    rows = Page(re.findall(r"<table\b.*?</table>", page_of(answer), re.S)[0]).rows
    assert rows[2][0] == "likelihood"
    assert rows[2][3] == "J5 (δ5): 87.1"


def test_truths_that_were_not_met_are_said() -> None:
    page = page_of(agreeing())
    assert page.count("3 (others drawn in their place)") == 1


# ── what must not be said ─────────────────────────────────────────────────────────────────────


def made_up() -> Json:
    """A study that gives numbers for what a data set cannot tell."""
    answer = agreeing()
    for estimator in answer["plans"][2]["estimators"]:
        row = estimator["parameters"][0]
        row |= dict.fromkeys(("bias", "bias_mcse", "rmse", "predicted_std"), FORBIDDEN)
        if not estimator["control"]:
            other = estimator["parameters"][1]["coverage"]
            row["coverage"] = [
                {**entry, "share": 0.12345, "low": 0.12345, "high": 0.12345} for entry in other
            ]
    return answer


@pytest.mark.parametrize("name", ["agreeing", pytest.param("disagreeing", marks=pytest.mark.long)])
def test_an_undetermined_parameter_has_no_number(name: str) -> None:
    """Of the third plan, whose figures are the first ones of a study of this plan alone."""
    answer = ANSWERS[name]()
    answer["plans"] = answer["plans"][2:]
    view = study_page(typed(answer))
    drawn = {f"{kind}_1": drawn_of(name)[f"{kind}_3"] for kind in ("coverage", "ranks")}
    tables = [table for start in (SHARES, "Bias and root") for table in tables_of(view, start)]
    assert len(tables) == 2
    told = [row for table in tables for row in texts_of(table)]
    # In coverage all estimators but the pseudo-inverse, in accuracy every one.
    assert [row[1:] for row in told if row[0] == "J2 (δ2)"].count([NOT_DETERMINED]) == 4 + 5
    printed = text_of(pypdf.PdfReader(io.BytesIO(pdf(view, drawn))))
    seen = [" ".join(Page(page_of(answer)).text), printed]
    seen += [words(picture.svg) + picture.alt for picture in drawn_of(name).values()]
    assert sum(text.count(NOT_DETERMINED) for text in seen) > 20
    for text in seen:
        assert f"{FORBIDDEN:.2f}" not in text
        assert "12.3" not in text


def test_a_control_may_show_that_its_claim_is_wrong() -> None:
    """The pseudo-inverse claims to know the offset that no data tell; its intervals never hold the truth."""
    rows = tables_of(study_page(typed(agreeing())), SHARES)[2].rows
    claimed = [row.cells for row in rows if row.cells[0].text == "J2 (δ2)"][-1]
    assert [float(cell.text.split(" ")[0]) < 1 for cell in claimed[1:]] == [True] * 4


@pytest.mark.parametrize("estimator", [0, 1, 2])
def test_a_study_with_made_up_numbers_cannot_be_made(estimator: int) -> None:
    answer = agreeing()
    own = answer["plans"][2]["estimators"]
    own[estimator] = made_up()["plans"][2]["estimators"][estimator]
    with pytest.raises(UnsoundResult, match=f"'delta2 of {own[estimator]['name']}' is unidentifiable"):
        typed(answer)


# ── one file, no network, names as text ───────────────────────────────────────────────────────


@pytest.mark.parametrize(
    "name", ["agreeing", *(pytest.param(name, marks=pytest.mark.long) for name in ("disagreeing", "hostile"))]
)
def test_the_page_is_one_well_formed_file_that_fetches_nothing(name: str) -> None:
    text = page_of(ANSWERS[name](), drawn_of(name))
    page = Page(text)
    text.encode()
    assert_fetches_nothing(page)
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels == [1, 2, 2, *([2, 3, 3] * 3), 2]
    figures = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    assert len(figures) == 7
    assert all(attributes["aria-label"] for attributes in figures)
    used = re.findall(r'\bid="([^"]+)"', text)
    assert len(used) == len(set(used)) > 0


def test_hostile_names_are_shown_as_they_are_and_do_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw_once(monkeypatch, "hostile")
    paths = write_study(str(tmp_path / "out"), typed(hostile()))  # a name as a string will do
    assert everything(tmp_path / "out") == WHOLE
    page = paths.html.read_text(encoding="utf-8")
    assert "<script" not in page
    assert "alert(&#39;x&#39;)" in page
    assert "{{ 7*7 }}" in page
    assert "\x00" not in page
    assert "\u202e" not in page
    text = text_of(pypdf.PdfReader(paths.pdf))
    assert '#import "/etc/passwd": *; $x^2$ *bold* `raw` @cite <label>' in text
    assert "root:" not in text
    assert "\\U0001f3af target" in text
    for table in paths.tables:
        assert "\u202e" not in table.read_text(encoding="utf-8")


@pytest.mark.browser
def test_chromium_opens_it_without_a_word_or_a_request(tmp_path: Path) -> None:
    file = tmp_path / "study.html"
    file.write_text(page_of(hostile(), drawn_of("hostile")), encoding="utf-8")
    with chromium().opened(file) as tab:
        assert "How it was done" in tab.text
        assert tab.console == []
        assert tab.asked == []


@pytest.mark.browser
def test_the_widest_tables_fit_on_paper(tmp_path: Path) -> None:
    paths = write_study(tmp_path / "out", geometry_study())
    with chromium().opened(paths.html, PAPER) as tab:
        assert tab.overflow() == 0


# ── whole or not at all ───────────────────────────────────────────────────────────────────────


def test_all_files_are_there_and_nothing_else(tmp_path: Path, drawn_before: None) -> None:
    paths = write_study(tmp_path / "a" / "out", typed(agreeing()))
    assert everything(tmp_path / "a" / "out") == WHOLE
    assert {path.name for path in (tmp_path / "a").iterdir()} == {"out"}
    assert paths.pdf.read_bytes().startswith(b"%PDF")
    assert paths.html.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert len(paths.figures) == 7
    assert all(path.exists() for path in paths.figures)


def test_a_study_of_ours_is_replaced_and_a_fault_leaves_it_as_it_was(
    tmp_path: Path, drawn_before: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    write_study(out, typed(agreeing()))
    (out / ".DS_Store").write_bytes(b"")
    write_study(out, typed(disagreeing()))
    assert everything(out) == WHOLE
    before = (out / "study.html").read_bytes()
    assert b"Does not agree." in before

    endless = agreeing()
    endless["plans"][0]["estimators"][0]["parameters"][0]["bias"] = float("nan")
    with pytest.raises(ValueError, match="JSON"):
        write_study(out, typed(endless))

    def full(*_: object) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("zerobeam.reports.output.whole_folder.pdf", full)
    with pytest.raises(BadInput, match="No space left"):
        write_study(out, typed(agreeing()))
    assert (out / "study.html").read_bytes() == before
    assert {path.name for path in tmp_path.iterdir()} == {"out"}


def test_an_interruption_leaves_nothing(
    tmp_path: Path, drawn_before: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(whole_folder, "_swap", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_study(tmp_path / "a" / "out", typed(agreeing()))
    assert everything(tmp_path) == set()


def test_what_is_not_a_study_of_ours_is_refused_and_left_alone(tmp_path: Path, refused: Refused) -> None:
    file = tmp_path / "file"
    file.write_text("mine")
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.tex").write_text("mine")
    alike = tmp_path / "alike"
    alike.mkdir()
    (alike / "study.json").write_text('{"schema": "someone/else/1"}')
    report = tmp_path / "report"
    report.mkdir()
    (report / "result.json").write_text('{"schema": "zerobeam/result/1"}')
    for folder, why in (
        (file, "is a file"),
        (other, "thesis.tex"),
        (alike, "not written by zerobeam"),
        (report, "result.json"),
    ):
        assert why in str(refused(check_target, folder))
        assert why in str(refused(write_study, folder, typed(agreeing())))
    assert everything(tmp_path) == {
        "file", "other", "other/thesis.tex", "alike", "alike/study.json", "report", "report/result.json"
    }  # fmt: skip
    check_target(tmp_path / "absent")


def test_of_a_study_only_its_own_files_are_replaced(tmp_path: Path, refused: Refused) -> None:
    """A table that another study would have here is somebody's own."""
    (tmp_path / "study.json").write_text('{"schema": "zerobeam/study/1", "study": "table2"}')
    for name in STUDIES["table2"].tables:
        (tmp_path / name).write_text("before")
    own = tmp_path / "parameters.csv"
    own.write_text("mine")
    assert own.name in STUDIES["cell"].tables
    for answer in (cell_study(), agreeing()):
        assert own.name in str(refused(check_target, tmp_path))
        assert own.name in str(refused(write_study, tmp_path, typed(answer)))
    assert own.read_text() == "mine"
    own.unlink()
    write_study(tmp_path, typed(cell_study()))
    assert {path.name for path in tmp_path.glob("*.csv")} == {"parameters.csv", "time.csv", "plans.csv"}


@pytest.mark.parametrize("named", ['"another"', "null", "[1]", '{"a": 1}'])
def test_of_a_study_that_is_not_known_no_table_is_replaced(
    tmp_path: Path, refused: Refused, named: str
) -> None:
    (tmp_path / "study.json").write_text(f'{{"schema": "zerobeam/study/1", "study": {named}}}')
    check_target(tmp_path)
    (tmp_path / "coverage.csv").write_text("mine")
    assert "coverage.csv" in str(refused(check_target, tmp_path))


def test_an_answer_of_no_known_study_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one of coverage, cell, table2"):
        write_study(tmp_path / "a" / "out", dataclasses.replace(typed(cell_study()), study="another"))
    assert everything(tmp_path) == set()
