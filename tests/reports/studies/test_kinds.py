"""The studies `cell` and `table2` as people see them; what holds for the page of any study."""

from __future__ import annotations

import csv
import dataclasses
import functools
import io
import re
from pathlib import Path
from typing import Any

import pypdf
import pytest
from command_line import WIDTH
from example_studies import FORBIDDEN, cell_study, hostile_cell, hostile_table2, table2_study, typed
from golden_files import assert_golden
from pages import Page, assert_fetches_nothing
from study_text import cells, printed, tables_of, text_of, texts_of, words

from zerobeam.analysis.status import UnsoundResult
from zerobeam.reports.output.html import html
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.studies.kinds import study_of, study_page
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_folder import write_study
from zerobeam.reports.style.blocks import (
    Block,
    Facts,
    FigureBlock,
    Paragraph,
    section_of,
    table_of,
)
from zerobeam.reports.style.blocks import (
    Page as View,
)
from zerobeam.reports.style.canvas import Picture

Json = dict[str, Any]

CLEAN = {"cell": cell_study, "table2": table2_study}
HOSTILE = {"cell": hostile_cell, "table2": hostile_table2}
ANSWERS = {**CLEAN, **{f"hostile {name}": made for name, made in HOSTILE.items()}}
# The numbers that a study claims of one parameter.
CLAIMS = {
    "cell": ("bias", "bias_mcse", "rmse", "predicted_std", "coverage"),
    "table2": ("predicted_std", "alone_deg", "simulated_std", "simulated"),
}


@functools.cache
def drawn_of(name: str) -> dict[str, Picture]:
    answer = ANSWERS[name]()
    return study_of(typed(answer)).pictures(typed(answer))


@functools.cache
def pdf_of(name: str) -> pypdf.PdfReader:
    # Without figures, whose text is slow to read; the tests that write a whole study have them.
    drawn = drawn_of(name) if name.startswith("hostile") else {}
    return pypdf.PdfReader(io.BytesIO(pdf(study_page(typed(ANSWERS[name]())), drawn)))


def blocks(view: View) -> list[Block]:
    return [block for section in view.sections for block in section.all]


# ── the same numbers everywhere ───────────────────────────────────────────────────────────────


def is_rounded(text: str, value: float) -> bool:
    """Whether `text`, a number perhaps with its unit, is `value` rounded to the place where it ends."""
    number = re.sub(r"(°|\u00a0s|\u00a0mm)$", "", text).replace("\u2212", "-")
    place = 10.0 ** -len(number.partition(".")[2])
    return abs(float(number) - value) <= 0.5000001 * place


def untrue(rows: list[list[str]], wanted: list[list[float | None]]) -> list[str]:
    """Texts of a table's rows that do not hold the numbers of the answer, `a (b to c)` being three."""
    found = []
    for (name, *texts), values in zip(rows, wanted, strict=True):
        told = [part for text in texts for part in re.split(r" \(| to ", text.rstrip(")"))]
        if None in values:
            assert told[values.index(None) :] == [NOT_DETERMINED]
            values = values[: values.index(None)]
            told = told[: len(values)]
        assert len(told) == len(values), told
        found += [
            f"{name}: {text}" for text, value in zip(told, values, strict=True) if not is_rounded(text, value)
        ]
    return found


def cell_untruths(view: View, answer: Json) -> list[str]:
    parameters: list[list[float | None]] = []
    for plan in answer["plans"]:
        parameters.append([])
        for row in plan["parameters"]:
            share = row["coverage"]
            parameters.append(
                [
                    *(100 * share[key] for key in ("share", "low", "high")),
                    *(row[key] for key in ("bias", "bias_mcse", "rmse", "predicted_std")),
                ]
                if share
                else [None]
            )
    (table,) = tables_of(view, "Share of intervals that hold the truth, in %, with its")
    # Of a row that heads a plan the name alone: the rest are its words.
    rows = [row if "δ" in row[0] else row[:1] for row in texts_of(table)]
    found = untrue(rows, parameters)
    phases = ("move", "search", "servo", "settle", "total")
    (table,) = tables_of(view, "Mean time")
    times = [plan["seconds"] for plan in answer["plans"]]
    found += untrue(
        texts_of(table), [[*(told[key]["mean"] for key in phases), told["total"]["max"]] for told in times]
    )
    (table,) = tables_of(view, "Runs, and")
    rows = texts_of(table)
    for row in rows:
        assert (row[7] == "not adaptive") == (row[0] != "adaptive")
        if row[0] != "adaptive":
            del row[7]
    runs = []
    for plan in answer["plans"]:
        used, saved = plan["shots_used"], [plan["saved"]] if plan["saved"] else []
        counts = [plan[key] for key in ("runs", "failed", "refused", "contradicted")]
        runs.append([*counts, used["mean"], used["min"], used["max"], *saved, plan["computing_s"]])
    return found + untrue(rows, runs)


def table2_untruths(view: View, answer: Json) -> list[str]:
    found = []
    for table, plan in zip(tables_of(view, "Plan "), answer["plans"], strict=True):
        wanted: list[list[float | None]] = []
        for row in plan["parameters"]:
            paper = [row[key] for key in ("paper_std", "low", "high")]
            if row["status"] == "unidentifiable":
                wanted.append([*paper, None])
                continue
            ends = [row["simulated"][key] for key in ("q2_5", "q97_5")]
            wanted.append([*paper, row["predicted_std"], row["simulated_std"], *ends, row["alone_deg"]])
        found += untrue(texts_of(table), wanted)
    (table,) = tables_of(view, "Joint offsets of three runs")
    paper = answer["paper"]
    rows = [*paper["experiments"], paper["printed_mean"], paper["mean"], paper["printed_std"], paper["std"]]
    found += untrue(texts_of(table), rows)
    (table,) = tables_of(view, "Standard deviation of one joint reading")
    told = texts_of(table)
    for row in told:
        assert row.pop() == "agrees"
        row[3] = row[3].replace("below 0.001", "0.001")
    keys = ("joint_deg", "low", "high", "p_value")
    return found + untrue(told, [[plan[key] for key in keys] for plan in answer["plans"]])


UNTRUTHS = {"cell": cell_untruths, "table2": table2_untruths}


@pytest.mark.parametrize("name", CLEAN)
def test_every_number_of_the_tables_is_that_of_the_answer(name: str) -> None:
    assert UNTRUTHS[name](study_page(typed(CLEAN[name]())), CLEAN[name]()) == []


@pytest.mark.parametrize(
    ("name", "change", "caught"),
    [
        ("cell", lambda plan: plan["parameters"][1]["coverage"].update(low=0.5), "J3 (δ3): 94.3"),
        ("cell", lambda plan: plan["seconds"]["servo"].update(mean=90.0), "y-pattern: 92.4\u00a0s"),
        ("cell", lambda plan: plan.update(refused=4), "y-pattern: 3"),
        ("table2", lambda plan: plan["parameters"][4].update(alone_deg=0.0005), "J6 (δ6): 0.00040°"),
        ("table2", lambda plan: plan["parameters"][0]["simulated"].update(q2_5=0.004), "J2 (δ2): 0.0037"),
        ("table2", lambda plan: plan.update(joint_deg=0.012), "y-pattern: 0.0112°"),
    ],
)
def test_a_number_that_is_not_that_of_the_answer_is_caught(name: str, change: Any, caught: str) -> None:
    answer = CLEAN[name]()
    change(answer["plans"][0])
    assert UNTRUTHS[name](study_page(typed(CLEAN[name]())), answer) == [caught]


@pytest.mark.parametrize("name", CLEAN)
def test_every_cell_and_sentence_of_the_page_is_in_the_pdf(name: str) -> None:
    view = study_page(typed(CLEAN[name]()))
    text = text_of(pdf_of(name)).replace(" ", "")
    said = [*cells(view), view.verdict.sentence, *view.notes]
    said += [block.text for block in blocks(view) if isinstance(block, Paragraph)]
    said += [text for block in blocks(view) if isinstance(block, Facts) for _, text in block.rows]
    for words_of_it in said:
        assert re.sub(r"\s", "", words_of_it) in text, words_of_it
    titles = [entry["/Title"] for entry in pdf_of(name).outline if not isinstance(entry, list)]
    assert titles == [section.title for section in view.sections if section.level == 1]


def tables_in(folder: Path) -> dict[str, list[dict[str, str]]]:
    return {
        path.name: list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
        for path in folder.glob("*.csv")
    }


def as_text(value: object) -> str:
    return "" if value is None else str(value)


def test_the_plain_tables_of_the_cell_say_what_the_answer_says(tmp_path: Path) -> None:
    answer = cell_study()
    paths = write_study(tmp_path / "out", typed(answer))
    tables = tables_in(tmp_path / "out")
    assert set(tables) == {path.name for path in paths.tables} == {"parameters.csv", "time.csv", "plans.csv"}
    assert {path.name for path in paths.figures} == {"coverage.svg", "time.svg"}
    rows = [(plan, row) for plan in answer["plans"] for row in plan["parameters"]]
    for told, (plan, row) in zip(tables["parameters.csv"], rows, strict=True):
        assert (told["plan"], told["parameter"], told["status"]) == (plan["name"], row["name"], row["status"])
        assert told["held"] == as_text((row["coverage"] or {}).get("held"))
        assert [told[key] for key in CLAIMS["cell"][:4]] == [as_text(row[key]) for key in CLAIMS["cell"][:4]]
    means = {(row["plan"], row["phase"]): float(row["mean_s"]) for row in tables["time.csv"]}
    assert means == {
        (plan["name"], phase): told["mean"]
        for plan in answer["plans"]
        for phase, told in plan["seconds"].items()
    }
    for told, plan in zip(tables["plans.csv"], answer["plans"], strict=True):
        assert told["spot_mm"] == str(plan["noise"]["spot_mm"])
        assert told["shots_mean"] == str(plan["shots_used"]["mean"])
        assert (told["saved"], told["within_limit"]) == (as_text(plan["saved"]), str(plan["within_limit"]))


def test_the_plain_tables_of_table_2_say_what_the_answer_says(tmp_path: Path) -> None:
    answer = table2_study()
    write_study(tmp_path / "out", typed(answer))
    tables = tables_in(tmp_path / "out")
    assert set(tables) == {"scatter.csv", "plans.csv", "paper.csv"}
    rows = [(plan, row) for plan in answer["plans"] for row in plan["parameters"]]
    for told, (plan, row) in zip(tables["scatter.csv"], rows, strict=True):
        assert (told["plan"], told["parameter"]) == (plan["name"], row["name"])
        keys = ("paper_std", "low", "high", "predicted_std", "alone_deg", "simulated_std")
        assert [told[key] for key in keys] == [as_text(row[key]) for key in keys]
        assert told["simulated_median"] == as_text((row["simulated"] or {}).get("median"))
    assert [row["joint_deg"] for row in tables["plans.csv"]] == [str(p["joint_deg"]) for p in answer["plans"]]
    assert [row["experiment_2"] for row in tables["paper.csv"]] == [
        str(value) for value in answer["paper"]["experiments"][1]
    ]


# ── what must be seen ─────────────────────────────────────────────────────────────────────────


@pytest.mark.parametrize("name", CLEAN)
def test_a_study_in_the_terminal(name: str) -> None:
    assert_golden(f"study_{name}.txt", printed(CLEAN[name]()))


def test_a_run_beyond_the_limit_and_a_plan_without_a_result_are_said() -> None:
    (table,) = tables_of(study_page(typed(hostile_cell())), "Share of intervals that hold the truth, in %: ")
    rows = texts_of(table)
    assert rows[0][1:] == ["does not agree", NOT_DETERMINED, "not given", "not given", "not given"]
    assert rows[1][-2:] == ["402\u00a0s", "exceeded"]
    assert rows[2][-1] == "kept"
    assert rows[4][1] == "control: passes, but must not"
    page = " ".join(Page(html(study_page(typed(hostile_cell())), {}, "study")).text)
    told = "runs without a result: the beam is lost and <script>alert('x')</script>."
    assert page.count(told) == page.count("runs without a result") == 1


def test_a_simulated_set_that_is_not_as_predicted_and_one_without_a_result_are_said() -> None:
    (table,) = tables_of(study_page(typed(hostile_table2())), "Standard deviation of one joint reading")
    rows = texts_of(table)
    assert rows[0][1:] == [*["not given"] * 3, "no result"]
    assert rows[1][1:] == ["0.0214°", "0 to 0.037°", "0.002", "does not agree"]
    assert rows[2][-1] == "agrees"
    page = " ".join(Page(html(study_page(typed(hostile_table2())), {}, "study")).text)
    assert page.count("A run of the simulated set has no result.") == 1
    assert page.count("The simulated set: χ² 9.82 for 10 degrees of freedom, p 0.912.") == 2


def test_the_figure_of_the_time_says_each_mean_the_longest_and_the_limit() -> None:
    picture, text = drawn_of("cell")["time"], words(drawn_of("cell")["time"].svg)
    for plan in cell_study()["plans"]:
        total = plan["seconds"]["total"]
        told = f"{plan['name']}: {total['mean']:.0f}\u00a0s, longest {total['max']:.0f}\u00a0s"
        assert told in text
        assert told in picture.alt
    assert "360\u00a0s" in text
    # The plan without a result has no bar.
    assert words(drawn_of("hostile cell")["time"].svg).count("longest") == 4


def test_a_plan_without_a_result_does_not_widen_the_figure_of_the_shares() -> None:
    """The shares of the control lie beyond the panel, and are written there as numbers."""
    far = [f"{100 * row['coverage']['share']:.1f}" for row in cell_study()["plans"][4]["parameters"]]
    for name in ("cell", "hostile cell"):
        text = words(drawn_of(name)["coverage"].svg)
        assert sorted(re.findall(r"\d+\.\d", text)) == sorted(far)
    # Without runs there is still a figure, of bands alone.
    answer = cell_study()
    for plan in answer["plans"]:
        plan["failed"] = plan["runs"]
        for row in plan["parameters"]:
            row["coverage"] = None
    assert words(study_of(typed(answer)).pictures(typed(answer))["coverage"].svg).count(NOT_DETERMINED) == 25


def test_a_study_without_any_time_has_no_figure_of_it() -> None:
    answer = cell_study()
    for plan in answer["plans"]:
        plan["seconds"]["total"] = {"mean": None, "max": None}
    assert set(study_of(typed(answer)).pictures(typed(answer))) == {"coverage"}
    assert "Time against the limit" in html(study_page(typed(answer)), {}, "study")


def test_the_figure_of_the_scatter_writes_the_papers_numbers_for_every_plan() -> None:
    text = words(drawn_of("table2")["scatter"].svg)
    for told in ("0.080°", "0.041°", "0.022°", "0.066°", "0.0035°"):
        assert text.count(told) == 3
    assert text.count(NOT_DETERMINED) == 1
    assert "joint noise 0.0112°" in text


# ── what must not be said ─────────────────────────────────────────────────────────────────────

CLAIMED = [(name, key) for name, keys in CLAIMS.items() for key in keys]


def made_up(name: str, key: str) -> Json:
    """A study that gives one number for what the third or fourth plan cannot tell."""
    answer = CLEAN[name]()
    plan = next(plan for plan in answer["plans"] if plan["name"] == "x-pattern")
    entry = {"level": 0.95, "held": 5, "of": 9, "agrees": True}
    value: Any = {
        "coverage": {**entry, **dict.fromkeys(("share", "low", "high"), FORBIDDEN)},
        "simulated": dict.fromkeys(("q2_5", "median", "q97_5"), FORBIDDEN),
    }.get(key, FORBIDDEN)
    plan["parameters"][0][key] = value
    return answer


@pytest.mark.parametrize(("name", "key"), CLAIMED)
def test_a_study_with_a_made_up_number_cannot_be_made(name: str, key: str) -> None:
    answer = made_up(name, key)
    with pytest.raises(UnsoundResult, match=f"'delta2.*' is unidentifiable, yet it has a value as {key}"):
        typed(answer)
    answer["plans"] = [plan for plan in answer["plans"] if plan["name"] != "x-pattern"]
    typed(answer)


def test_only_a_control_may_claim_what_a_plan_does_not_determine() -> None:
    answer = made_up("cell", "bias")
    answer["plans"][3]["control"] = True
    claimed = typed(answer).plans[3]
    assert claimed.parameters[0].bias == FORBIDDEN
    with pytest.raises(UnsoundResult):
        dataclasses.replace(claimed, control=False)


def test_what_the_paper_states_is_no_claim() -> None:
    row = typed(table2_study()).plans[2].parameters[0]
    assert row.status == "unidentifiable"
    assert row.paper_std > 0


@pytest.mark.parametrize("name", CLEAN)
def test_an_undetermined_parameter_has_no_number(name: str) -> None:
    answer = CLEAN[name]()
    answer["plans"] = [plan for plan in answer["plans"] if plan["name"] == "x-pattern"]
    answer["plans"][0]["parameters"] = answer["plans"][0]["parameters"][:1]
    view, study = study_page(typed(answer)), study_of(typed(answer))
    (row,) = (row for table in tables_of(view, "") for row in texts_of(table) if row[0] == "J2 (δ2)")
    assert row[-1] == NOT_DETERMINED
    seen = [" ".join(Page(html(view, {}, "study")).text), printed(answer)]
    seen += [words(picture.svg) + picture.alt for picture in study.pictures(typed(answer)).values()]
    assert sum(text.count(NOT_DETERMINED) for text in seen) >= 2
    (told,) = study.tables["parameters.csv" if name == "cell" else "scatter.csv"](typed(answer))
    for own in CLAIMS[name]:
        assert all(told[column] is None for column in told if column.startswith(own))


# ── one file, no network, names as text ───────────────────────────────────────────────────────


@pytest.mark.parametrize("name", ANSWERS)
def test_the_page_is_one_well_formed_file_that_fetches_nothing(name: str) -> None:
    view = study_page(typed(ANSWERS[name]()))
    text = html(view, drawn_of(name), "study")
    page = Page(text)
    assert_fetches_nothing(page)
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels == [1, *(section.level + 1 for section in view.sections)]
    figures = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    shown = [block.name for block in blocks(view) if isinstance(block, FigureBlock)]
    assert sorted(shown) == sorted(drawn_of(name))
    assert len(figures) == len(shown)
    assert all(attributes["aria-label"] for attributes in figures)
    used = re.findall(r'\bid="([^"]+)"', text)
    assert len(used) == len(set(used)) > 0
    for table in study_of(typed(ANSWERS[name]())).tables:
        assert table in " ".join(page.text)


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_names_are_shown_as_they_are_and_do_nothing(name: str) -> None:
    answer = HOSTILE[name]()
    page = html(study_page(typed(answer)), drawn_of(f"hostile {name}"), "study")
    assert "<script" not in page
    assert "alert(&#39;x&#39;)" in page
    assert "{{ 7*7 }}" in page
    pdf = text_of(pdf_of(f"hostile {name}"))
    assert '#import "/etc/passwd": *; $x^2$ *bold* `raw` @cite <label>' in pdf
    assert "root:" not in pdf
    terminal = printed(answer)
    assert max(len(line) for line in terminal.splitlines()) <= WIDTH
    tables = str([list(rows(typed(answer))) for rows in study_of(typed(answer)).tables.values()])
    assert "<script>" in tables
    for text in (page, terminal):
        for letter in ("\x00", "\x1b", "\u202e"):
            assert letter not in text


# ── sections ──────────────────────────────────────────────────────────────────────────────────


def test_what_leads_up_to_the_first_figure_stays_with_the_heading_unless_it_is_a_table() -> None:
    words_of_it, figure = Paragraph("so"), FigureBlock("a")
    table = table_of("", [], [])
    kept = section_of("", words_of_it, None, figure, words_of_it, FigureBlock("b"))
    assert kept.lead == (words_of_it, figure)
    assert kept.blocks == (words_of_it, FigureBlock("b"))
    assert section_of("", words_of_it, table, figure).lead == ()
    assert section_of("", words_of_it).blocks == (words_of_it,)
