"""The study `geometry` as people see it."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_line import WIDTH
from example_geometry_study import geometry_study, hostile_geometry
from golden_files import assert_golden
from pages import Page, assert_fetches_nothing
from study_text import printed, tables_of, texts_of, words

from zerobeam.analysis.status import UnsoundResult
from zerobeam.experiments.studies.answer import to_json
from zerobeam.experiments.studies.geometry import GeometryEstimator
from zerobeam.reports.output.html import html
from zerobeam.reports.studies.kinds import study_of, study_page
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_folder import write_study


def test_in_the_terminal() -> None:
    assert_golden("study_geometry.txt", printed(geometry_study()))


def test_the_table_of_predictions_says_what_the_answer_says() -> None:
    (table,) = tables_of(study_page(geometry_study()), "Predicted u")
    assert texts_of(table) == [
        ["7, nominal", "0.3\u00a0mm, 0.1°", "0.0061 to 0.0089°", "0.021 to 0.083°", "0.011 to 0.031°"],
        ["12, nominal", "0.3\u00a0mm, 0.1°", "0.0052 to 0.0068°", "0.026 to 0.061°", "0.0066 to 0.015°"],
        [
            *("probe", "0.3\u00a0mm, 0.1°"),
            f"0.0029 to 0.0064°; 1 {NOT_DETERMINED}",
            f"0.024 to 0.12°; 1 {NOT_DETERMINED}",
            f"0.0043 to 0.017°; 1 {NOT_DETERMINED}",
        ],
    ]


def test_every_offset_of_every_way_has_its_share_and_z() -> None:
    answer = geometry_study()
    tables = tables_of(study_page(answer), "Share of intervals that hold the truth, in %, with")
    for table, plan in zip(tables, answer.plans, strict=True):
        told = [row for row in texts_of(table) if row[0].startswith("J")]
        rows = [row for own in plan.estimators for row in own.parameters]
        for text, row in zip(told, rows, strict=True):
            if row.coverage is None or row.z is None:
                assert text[1:] == [NOT_DETERMINED]
                continue
            assert abs(float(text[1].split(" ")[0]) - 100 * row.coverage.share) <= 0.5
            assert abs(float(text[2].split(" ")[0]) / row.z - 1) < 0.05
            assert float(text[7].rstrip("°")) == pytest.approx(row.checked_std, rel=0.05)


def test_the_figures() -> None:
    answer = geometry_study()
    drawn = study_of(answer).pictures(answer)
    assert set(drawn) == {"uncertainty", "z", "coverage"}
    assert "7 measurements: noise only 0.0061 to 0.0089°" in drawn["uncertainty"].alt
    assert drawn["z"].alt.count(NOT_DETERMINED) == 4
    assert words(drawn["z"].svg).count("nominal") >= 3
    assert NOT_DETERMINED in words(drawn["coverage"].svg)


def test_with_a_single_number_of_measurements_there_is_no_figure_over_them() -> None:
    answer = dataclasses.replace(geometry_study(), plans=geometry_study().plans[1:])
    assert set(study_of(answer).pictures(answer)) == {"z", "coverage"}
    html(study_page(answer), study_of(answer).pictures(answer), "study")


def test_the_folder(tmp_path: Path) -> None:
    answer = geometry_study()
    paths = write_study(tmp_path / "out", answer)
    assert paths.html.exists()
    assert paths.pdf.exists()
    (parameters,) = (path for path in paths.tables if path.name == "parameters.csv")
    told = list(csv.DictReader(parameters.read_text(encoding="utf-8").splitlines()))
    rows = [(plan, own, row) for plan in answer.plans for own in plan.estimators for row in own.parameters]
    for line, (plan, own, row) in zip(told, rows, strict=True):
        assert (line["plan"], line["geometry"], line["parameter"]) == (plan.name, own.name, row.name)
        assert line["z"] == ("" if row.z is None else str(row.z))
    (plans,) = (path for path in paths.tables if path.name == "plans.csv")
    told = list(csv.DictReader(plans.read_text(encoding="utf-8").splitlines()))
    assert [line["freed"] for line in told] == [
        "" if row.freed is None else str(row.freed) for plan in answer.plans for row in plan.checked
    ]
    write_study(tmp_path / "out", answer)  # its own folder is replaced


@pytest.mark.parametrize("answer", [geometry_study, hostile_geometry])
def test_one_page_that_fetches_nothing(answer: object) -> None:
    made = answer()  # type: ignore[operator]
    page = Page(html(study_page(made), study_of(made).pictures(made), "study"))
    assert_fetches_nothing(page)
    for table in study_of(made).tables:
        assert table in " ".join(page.text)
    assert max(len(line) for line in printed(made).splitlines()) <= WIDTH


def test_hostile_names_do_nothing(tmp_path: Path) -> None:
    made = hostile_geometry()
    page = html(study_page(made), study_of(made).pictures(made), "study")
    assert "<script" not in page
    assert "alert(&#39;x&#39;)" in page
    for text in (page, printed(made)):
        for letter in ("\x00", "\x1b", "\u202e"):
            assert letter not in text
    assert write_study(tmp_path / "out", made).pdf.exists()


def claims(own: GeometryEstimator) -> Iterator[str]:
    for key, value in {"z": 1.0, "checked_std": 0.01, "rmse": 0.01}.items():
        row = dataclasses.replace(own.parameters[-1], **{key: value})
        with pytest.raises(UnsoundResult, match=f"has a value as {key}"):
            dataclasses.replace(own, parameters=(*own.parameters[:-1], row))
        yield key


def test_what_a_plan_does_not_determine_has_no_number() -> None:
    probe = geometry_study().plans[-1]
    assert probe.estimators[0].parameters[-1].status == "unidentifiable"
    assert list(claims(probe.estimators[0])) == ["z", "checked_std", "rmse"]
    content = to_json(geometry_study())
    assert content["schema"] == "zerobeam/study/1"
    assert content["plans"][-1]["checked"][-1]["freed"] is None
