"""Sweeps as people see them: figures and tables by the axes, every number the answer's, none made up."""

import csv
import functools
import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from example_sweeps import (
    geometry_sweep,
    long_sweep,
    map_sweep,
    pattern_map_sweep,
    pattern_shots_sweep,
    patterns_sweep,
    shots_sweep,
    with_parameter,
)
from pages import Page
from study_text import is_rounded, printed, tables_of, untrue, words

from zerobeam.experiments.studies.sweeps.grid_answer import CaseParameter, GridCase, GridStudy, RunErrors
from zerobeam.model.records import to_json
from zerobeam.reports.output.html import html
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_pages import (
    STUDIES,
    SWEEP,
    study_of,
    study_of_file,
    study_page,
    write_study,
)
from zerobeam.reports.studies.sweep_figures import figure_names, gap, rmse_interval, tolerance
from zerobeam.reports.style.blocks import Page as BlockPage
from zerobeam.reports.style.blocks import Row
from zerobeam.reports.style.canvas import Picture, log_ticks
from zerobeam.words import numbers

Json = dict[str, Any]

# By the form of the axes: words, numbers, words by numbers, numbers by numbers, words by both.
CLEAN = {
    "patterns": patterns_sweep,
    "shots": shots_sweep,
    "pattern_shots": pattern_shots_sweep,
    "map": map_sweep,
    "pattern_map": pattern_map_sweep,
}
SUMMARY, OFFSETS = "Verdict of each plan", "Predicted standard uncertainty u of each parameter"
ERRORS = ("runs", "rmse", "bias", "bias_std")
FITS = ("likelihood", "midpoint")


@functools.cache
def drawn_of(name: str) -> dict[str, Picture]:
    answer = CLEAN[name]()
    return study_of(answer).pictures(answer)


def texts(row: Row) -> list[str]:
    return [cell.text for cell in row.cells]


def test_an_answer_with_axes_and_cases_is_a_sweep_whatever_its_name() -> None:
    study = shots_sweep()
    for name in ("my own", "../../x", "coverage", "\x00"):
        named = replace(study, study=name)
        assert study_of(named) is study_of_file(to_json(named)) is SWEEP
    assert study_of_file({**to_json(study), "study": 3}) is SWEEP
    assert printed(replace(study, study="coverage")) == printed(study)
    assert study_of_file({"study": "coverage", "plans": []}) is STUDIES["coverage"]
    for answer in ({"study": "my own"}, {"study": "x", "axes": 3, "cases": []}, ["axes", "cases"], None):
        assert study_of_file(answer) is None


def expected(one: CaseParameter) -> list[float]:
    """The numbers of a row of the table of parameters."""
    values = [one.std] if one.std is not None else []
    if of := one.likelihood:
        values += [of.rmse, of.bias, *(100 * share for share in (of.held, of.held_low, of.held_high))]
    return values + ([one.midpoint.rmse] if one.midpoint else [])


def untruths(view: BlockPage, study: GridStudy) -> list[str]:
    """Numbers in the tables that are not those of the answer."""
    (offsets,), (summary,) = tables_of(view, OFFSETS), tables_of(view, SUMMARY)
    values: list[list[float | None]] = []
    for case in study.cases:
        if case.reason is None:
            values += [[], *(expected(one) or [None] for one in case.parameters)]
    rows = [texts(row)[:1] if texts(row)[0].startswith("case ") else texts(row) for row in offsets.rows]
    if len(rows) < len(values):
        assert "cases shown, all in offsets.csv" in offsets.caption
    wrong = untrue(rows, values[: len(rows)])
    for row, case in zip(summary.rows, study.cases, strict=True):
        std = re.search(r": (\d+\.\d+)°", " ".join(texts(row)[len(study.axes) :]))
        assert (std is None) == (case.worst_std is None)
        if std is not None and not is_rounded(std.group(1), case.worst_std or 0):
            wrong.append(std.group(1))
    return wrong


@pytest.mark.parametrize("name", CLEAN)
def test_every_number_of_the_tables_is_that_of_the_answer(name: str) -> None:
    assert untruths(study_page(CLEAN[name]()), CLEAN[name]()) == []


def test_a_number_that_is_not_that_of_the_answer_is_caught() -> None:
    study = patterns_sweep()
    first, second, *_ = study.cases[1].parameters
    assert first.std is not None
    assert second.likelihood is not None
    assert second.midpoint is not None
    share = replace(second.likelihood, held_high=second.likelihood.held_high - 0.1)
    midpoint = replace(second.midpoint, rmse=second.midpoint.rmse * 1.1)
    for other in (
        with_parameter(study, 1, 0, std=first.std * 1.5),
        with_parameter(study, 1, 1, likelihood=share),
        with_parameter(study, 1, 1, midpoint=midpoint),
    ):
        assert len(untruths(study_page(study), other)) == 1


def as_text(value: object) -> str:
    return "" if value is None else str(value)


def test_the_plain_tables_say_what_the_answer_says_and_the_folder_is_whole(tmp_path: Path) -> None:
    study = replace(pattern_shots_sweep(), study="../../x")
    answer = to_json(study)
    paths = write_study(tmp_path / "out", study)
    assert json.loads(paths.result.read_text(encoding="utf-8")) == answer
    assert {path.name for path in tmp_path.iterdir()} == {"out"}
    assert {path.name for path in paths.tables} == {"cases.csv", "offsets.csv"}
    assert [path.name for path in paths.figures] == ["lines.svg"]
    cases, offsets = (
        list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8")))) for path in paths.tables
    )
    axes = answer["axes"]
    every = [(i, case, row) for i, case in enumerate(answer["cases"], 1) for row in case["parameters"]]
    for row_read, (i, case, row) in zip(offsets, every, strict=True):
        assert row_read["case"] == str(i)
        assert row_read["axis1_plan.kind"] == axes[0]["values"][case["at"][0]]
        assert row_read["axis2_plan.shots"] == str(axes[1]["values"][case["at"][1]])
        assert (row_read["parameter"], row_read["status"], row_read["std"]) == (
            row["name"], row["status"], as_text(row["std"])
        )  # fmt: skip
        for fit in ("likelihood", "midpoint"):
            for key in ERRORS:
                assert row_read[f"{fit}_{key}"] == as_text((row[fit] or {}).get(key))
    for row_read, case in zip(cases, answer["cases"], strict=True):
        assert (row_read["verdict"], row_read["worst_std"]) == (case["verdict"], as_text(case["worst_std"]))
        assert row_read["not_determined"] == ("delta2" if case["verdict"] == "degenerate" else "")


def test_an_axis_whose_key_is_that_of_a_column_hides_nothing() -> None:
    study = patterns_sweep()
    study = replace(study, axes=(replace(study.axes[0], key="parameter"),))
    row = next(iter(SWEEP.tables["offsets.csv"](study)))
    assert (row["axis1_parameter"], row["parameter"]) == ("x-pattern", "delta2")


def test_the_interval_of_an_rmse_is_that_of_chi_squared() -> None:
    """χ² of 100 degrees of freedom: 74.222 and 129.561 (printed tables)."""
    low, high = rmse_interval(RunErrors(100, 2.0, 0.0, 0.2))
    assert low == pytest.approx(2 * (100 / 129.561) ** 0.5, rel=1e-5)
    assert high == pytest.approx(2 * (100 / 74.222) ** 0.5, rel=1e-5)


@pytest.mark.long
def test_a_gap_is_drawn_and_said_where_nothing_is_determined() -> None:
    # δ2 and δ3 at three shots, δ4 at three and four; beside the legend's own.
    lines = drawn_of("shots")["lines"]
    assert words(lines.svg).count(NOT_DETERMINED) == 3 + 1
    assert (
        "J4 (δ4) predicted u 0.036 at 5, 0.025 at 7, 0.015 at 14, 0.0098 at 30, not determined at 3, 4"
        in lines.alt
    )
    # Where all is determined there is no gap: in one of four panels alone, of which none has a number.
    assert words(drawn_of("pattern_shots")["lines"].svg).count(NOT_DETERMINED) == 1 + 1
    of_words = drawn_of("patterns")["lines"]
    assert words(of_words.svg).count(NOT_DETERMINED) == 1 + 1
    assert "no plan at ring" in of_words.alt
    grid = drawn_of("map")["map"]
    assert words(grid.svg).count("determined") == 1 + 1
    assert words(grid.svg).count("no plan") == 1
    assert "not determined in 1 of 12 cases; no plan in 2 of 12 cases" in grid.alt


def test_a_map_has_the_worst_std_of_every_case_that_tells_all() -> None:
    text = words(drawn_of("map")["map"].svg)
    row_read = {f"{case.worst_std:.2g}" for case in map_sweep().cases if case.worst_std is not None}
    assert len(row_read) > 3
    for std in row_read:
        assert re.search(rf"(?<![\d.]){re.escape(std)}(?![\d])", text), std


def test_the_summary_has_verdict_and_reason_in_words() -> None:
    study = patterns_sweep()
    likelihood = study.cases[1].parameters[1].likelihood
    assert likelihood is not None
    view = study_page(with_parameter(study, 1, 1, likelihood=replace(likelihood, agrees=False)))
    (table,) = tables_of(view, SUMMARY)
    assert [texts(row) for row in table.rows] == [
        ["x-pattern", "degenerate", "J2 (δ2): not determined", "yes"],
        ["y-pattern", "pass", "J6 (δ6): 0.087°", "no"],
        ["optimal", "pass", "J6 (δ6): 0.043°", "yes"],
        ["ring", "no plan", "", ""],
    ]
    assert table.caption.startswith("Verdict of each plan of 7 measurements, ")
    (offsets,) = tables_of(view, OFFSETS)
    marks = [row.cells[-2].mark for row in offsets.rows if texts(row)[0] == "J3 (δ3)"]
    assert marks == ["identified", "weak", "identified"]
    assert [row.cells[1].mark for row in table.rows] == [
        "unidentifiable", "identified", "identified", "held"
    ]  # fmt: skip
    page = " ".join(" ".join(Page(html(view, {}, "study")).text).split())
    assert "No plan for ring: only 3 of 400 candidates see the PSD." in page


def test_what_is_assumed_is_no_part_of_a_pass_and_is_said_to_be_that() -> None:
    study = with_parameter(patterns_sweep(), 1, 4, status="assumed", std=1.1)
    study = replace(study, cases=(study.cases[0], replace(study.cases[1], worst_std=1.1), *study.cases[2:]))
    view = study_page(study)
    (table,) = tables_of(view, SUMMARY)
    assert texts(table.rows[1]) == ["y-pattern", "pass", "J6 (δ6): 1.1°, assumed", "yes"]
    page = " ".join(Page(html(view, {}, "study")).text)
    assert "within the tolerance of 0.1°; what is assumed is no part of it" in page
    assert "assumed" not in " ".join(Page(html(study_page(patterns_sweep()), {}, "study")).text)


def test_without_simulated_runs_nothing_is_said_of_them() -> None:
    view = study_page(map_sweep())
    heads = [column.text for table in tables_of(view, "") for column in table.columns]
    assert "predicted u" in heads
    assert not {"RMSE", "runs agree", "midpoint RMSE"} & set(heads)
    assert "No runs were simulated." in " ".join(Page(html(view, {}, "study")).text)


def test_long_grids_are_cut_and_say_so() -> None:
    view = study_page(long_sweep(200))
    (summary,), (offsets,) = tables_of(view, SUMMARY), tables_of(view, OFFSETS)
    assert len(summary.rows) == 20
    assert summary.caption.endswith("(the 20 best of 200 cases shown, all in cases.csv)")
    shown = sum(texts(row)[0].startswith("case ") for row in offsets.rows)
    assert len(offsets.rows) <= 60
    assert offsets.caption.endswith(f"({shown} of 200 cases shown, all in offsets.csv)")
    assert sum(1 for _ in SWEEP.tables["cases.csv"](long_sweep(200))) == 200
    (whole,) = tables_of(study_page(long_sweep(60)), SUMMARY)
    assert len(whole.rows) == 60
    assert "shown" not in whole.caption


def test_more_axes_than_a_map_has_are_a_panel_each_and_cases_stand_beside() -> None:
    study = geometry_sweep()
    assert figure_names(study) == ["axes"]
    (picture,) = SWEEP.pictures(study).values()
    text = words(picture.svg)
    for axis in study.axes:
        assert axis.label in text
    # Nine cases do not determine δ2; in all others δ6 is the least certain: the figure is of it.
    assert "J6 (δ6)" in picture.title
    assert "not determined" not in text
    medians = [row.median for row in study.over_cases(0, 2) if row.name == "delta6"]
    assert f"{numbers.spread(medians[0], 'deg')} at 800" in picture.alt.replace("\u00a0", " ")
    view = study_page(study)
    (over,) = tables_of(view, "Predicted standard uncertainty u of each offset over the cases")
    rows = {texts(row)[0]: texts(row) for row in over.rows}
    assert rows["J2 (δ2)"][-1] == "in 9 of 72"
    (beside,) = tables_of(view, "Beside the grid")
    assert [texts(row)[:3] for row in beside.rows] == [
        ["X-Pattern", "degenerate", NOT_DETERMINED],
        ["optimal", "pass", "0.0077°"],
        ["a ring", "no plan", ""],
    ]
    (summary,) = tables_of(view, SUMMARY)
    best = [std for std in (case.worst_std for case in study.cases) if std is not None]
    assert is_rounded(texts(summary.rows[0])[-1].split()[-1].rstrip("°"), min(best))
    listed = list(SWEEP.tables["cases.csv"](study))
    assert [row["words"] for row in listed[-3:]] == ["X-Pattern", "optimal", "a ring"]
    assert {row["axis1_target.xyz_mm.z"] for row in listed[-3:]} == {None}


@pytest.mark.long
def test_an_offset_that_is_not_determined_is_counted_above_the_figure() -> None:
    study = geometry_sweep()
    cases = tuple(
        replace(case, parameters=case.parameters[:1], worst_std=case.parameters[0].std)
        if case.parameters
        else case
        for case in study.cases
    )
    (picture,) = SWEEP.pictures(replace(study, cases=cases)).values()
    assert "J2 (δ2)" in picture.title
    assert "not determined (cases)" in words(picture.svg)
    # At the farthest distance 9 of 24 cases do not determine it: they are part of the median.
    stds = sorted(case.parameters[0].std or 99 for case in cases if case.parameters and case.at[1] == 2)
    middle = (stds[len(stds) // 2 - 1] + stds[len(stds) // 2]) / 2
    assert f"{numbers.spread(middle, 'deg')} at 900" in picture.alt.replace("\u00a0", " ")


@pytest.mark.long
def test_a_study_of_words_alone_is_along_the_longest_axis() -> None:
    study = patterns_sweep()
    axes = tuple(replace(study.axes[0], values=tuple(values)) for values in ("xyz", "abcde"))
    cases = tuple(replace(study.cases[1], at=(i, j)) for i in range(3) for j in range(5))
    (picture,) = SWEEP.pictures(replace(study, axes=axes, cases=cases)).values()
    assert figure_names(study) == [picture.name] == ["lines"]
    text = words(picture.svg).split()
    assert [text.count(value) for value in "xbe"] == [1, 3, 3]  # a series above, a tick of each series
    assert words(SWEEP.pictures(long_sweep(200))["lines"].svg).count("plan ") < 30 * 2


def test_a_parameter_that_a_case_does_not_have_is_said_to_be_not_estimated() -> None:
    case = shots_sweep().cases[0]
    one = case.parameters[0]
    assert [gap(case, None), gap(case, one), gap(case, replace(one, status="held"))] == [
        "not estimated", NOT_DETERMINED, "held"
    ]  # fmt: skip
    assert gap(GridCase((0,), "it", reason="far"), None) == "no plan"


def test_a_scale_is_of_the_parameters_unit_in_every_panel_of_a_row() -> None:
    """A length that one of two series does not have: that one's panel stands first and has the numbers."""
    study = pattern_shots_sweep()
    length = CaseParameter("tool.shift1", "mm", "identified", "tool", 4.0)
    cases = tuple(replace(case, parameters=(length,) if case.at[0] else ()) for case in study.cases)
    text = words(SWEEP.pictures(replace(study, cases=cases))["lines"].svg)
    assert {"1", "2", "5"} <= set(text.split())  # millimetres
    assert not {"0.1", "0.01"} & set(text.split())  # degrees
    assert "not estimated" in text


def test_a_tolerance_that_differs_from_case_to_case_is_not_drawn_as_one() -> None:
    study = patterns_sweep()
    one = study.cases[1].parameters[0]
    assert tolerance(study, one) == 0.1
    assert tolerance(study, replace(one, name="tool.shift1", group="tool", unit="mm")) == 1.0
    axis = replace(study.axes[0], changes=({"tolerance.offset_deg": 0.1},) * 4)
    assert tolerance(replace(study, axes=(axis,)), one) is None


def test_ticks_are_round_numbers_within_the_scale() -> None:
    assert log_ticks(0.009, 0.12) == pytest.approx([0.01, 0.02, 0.05, 0.1])
    assert log_ticks(0.004, 20) == pytest.approx([0.01, 0.1, 1, 10])


@pytest.mark.parametrize("name", ["patterns", "shots", "map"])
def test_what_is_not_determined_has_no_number(name: str) -> None:
    rows = [row for row in SWEEP.tables["offsets.csv"](CLEAN[name]()) if row["status"] == "unidentifiable"]
    assert rows
    for row in rows:
        assert not any(value for key, value in row.items() if key.startswith(("std", *FITS)))
