"""The geometry in the report of a run: its section, its figure, and what stands beside u on page one."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace
from typing import Any

import pytest
from example_results import drawn, geometry, good, misfit, x_pattern
from pages import paragraphs, strings, table
from study_text import texts_of

from zerobeam.analysis.answer.result import Result
from zerobeam.reports.run.geometry_section import (
    geometry_lines,
    geometry_section,
    ladder_picture,
    ladder_table,
)
from zerobeam.reports.run.parameter_section import offsets_section, offsets_table, offsets_worth, other_tables
from zerobeam.reports.run.report import pictures, report_page
from zerobeam.reports.style.blocks import Section
from zerobeam.words.message import message
from zerobeam.words.wording import label


def section(result: Result) -> Section:
    found = geometry_section(result)
    assert found is not None
    return found


def test_beside_u_stands_what_it_is_if_the_arm_deviates() -> None:
    heads = [column.text for column in offsets_table(good()).columns]
    assert heads == ["name", "estimate", "U (k\u00a0=\u00a02)", "status", "U, incl. tolerances"]
    for row in texts_of(offsets_table(good()))[2:]:  # without the head and δ1
        u, considered = (float(row[k].rstrip("°")) for k in (2, 4))
        assert considered > u > 0
    assert any("Leave out geometry: exact to estimate the links" in text for text in message(good()).cautions)


def test_an_unidentifiable_offset_has_no_worth_either() -> None:
    (row,) = [row for row in texts_of(offsets_table(x_pattern())) if row[0] == label("delta2")]
    assert row[-1] == "—"


def test_a_misfit_says_nothing_of_what_u_is_worth() -> None:
    """The model is refuted: a number for an arm within tolerances would be a sign of success."""
    assert offsets_worth(misfit()) is None
    assert [column.text for column in offsets_table(misfit()).columns][-1] == "status"
    assert "incl. tolerances" not in " ".join(strings(report_page(misfit())))


def test_with_geometry_stated_the_share_of_the_tolerances_stands_there() -> None:
    own = offsets_table(geometry())
    assert own.columns[-1].text == "set by tolerances"
    for row, shown in zip(
        [row for row in geometry().parameters if row.group == "offset"], own.rows, strict=True
    ):
        share = row.tolerance_share
        expected = "—" if share is None else f"{100 * share:.0f}\u00a0%"
        assert shown.cells[-1].text == expected
        assert share is None or 0 <= share <= 1
    text = paragraphs(offsets_section(geometry()))
    assert "With nominal geometry, if the arm deviates" in text
    assert "half the tolerances" not in text  # they are multiplied by what the data say
    assert "Leave out geometry" not in text


def test_the_first_page_lists_no_link() -> None:
    page = report_page(geometry())
    (first,) = [own for own in page.sections if own.title == "Offsets"]
    assert not re.search(r"link \d", " ".join(strings(first)))


def test_nominal_geometry_has_no_section() -> None:
    assert geometry_section(good()) is None
    assert ladder_picture(good()) is None
    assert geometry_lines(good()) == []


def test_the_table_has_the_parameters_that_are_determined_and_no_other() -> None:
    rows = [row for row in geometry().parameters if row.group in ("geometry", "tool")]
    determined = [label(row.name) for row in rows if row.estimate is not None and row.std is not None]
    lost = [row for row in rows if row.status == "unidentifiable"]
    assert determined
    assert lost
    shown = table(section(geometry()), "Deviations from nominal")
    assert [row.cells[0].text for row in shown.rows] == determined
    free = sum(not row.held for row in rows)
    said = geometry_lines(geometry())[-1]
    assert f"Geometry and tool: {len(determined)} of {free} parameters are determined" in said


def test_what_only_the_prior_says_is_listed_by_its_tolerance() -> None:
    lost = [row for row in geometry().parameters if row.tolerated and row.status == "unidentifiable"]
    listed = [
        tuple(cell.text for cell in row.cells)
        for row in table(section(geometry()), "Prior only, without an estimate").rows
    ]
    tilts = [label(row.name).removeprefix("tool.") for row in lost if row.name.startswith("tool.tilt")]
    assert tilts
    assert ("tool, angle", "0.05°", " and ".join(tilts)) in listed
    assert ("tool, position", "0.1\u00a0mm", "shift1 and shift2") in listed
    kinds = {kind for kind, _, _ in listed}
    assert {"length of a link", "angle of a link", "first harmonic"} <= kinds
    links = " ".join(names for kind, _, names in listed if kind.endswith("of a link"))
    of_links = [row for row in lost if row.name.startswith("link")]
    assert len(re.findall(r"[(,] ?[a-dαβθ]\b", links)) == len(of_links)


def test_a_calibrated_tool_within_its_sigma_is_in_no_other_table() -> None:
    assert any(row.group == "tool" for row in geometry().parameters)
    captions = [table.caption for table in other_tables(geometry().parameters, 2.0)]
    assert captions == ["Targets in the base frame"]
    assert not re.search(
        r"tool\.", " ".join(text for block in report_page(geometry()).front for text in strings(block))
    )


def test_the_ladder_is_a_table_and_a_figure_that_say_the_same() -> None:
    shown = ladder_table(geometry())
    assert shown is not None
    ladder = geometry().geometry.ladder
    assert [row.cells[0].text for row in shown.rows] == [
        "nominal geometry",
        "+ link geometry",
        "+ gravity",
        "+ first harmonics",
    ]
    assert [row.cells[1].text for row in shown.rows] == [str(rung.parameters) for rung in ladder]
    assert [row.cells[-1].text.split(":")[0] for row in shown.rows] == [
        "yes" if rung.kept else "no" for rung in ladder
    ]
    picture = ladder_picture(geometry())
    assert picture is not None
    for row in shown.rows:
        number = row.cells[2].text.split("\u00a0")[0]
        assert number in picture.alt
        assert number in picture.svg
        assert row.cells[3].text in picture.alt
    ElementTree.fromstring(picture.svg)


def test_a_misfit_shows_no_ladder() -> None:
    refuted = replace(misfit(), geometry=geometry().geometry)
    assert "ladder" not in pictures(refuted, None)
    assert "ladder" in drawn(geometry())
    assert geometry_lines(refuted) == []


@pytest.mark.parametrize("made", [good, geometry])
def test_the_budget_calls_the_geometry_exact_only_where_it_is(made: Any) -> None:
    (own,) = [own for own in report_page(made()).sections if own.title == "Uncertainty budget"]
    assert ("the robot’s geometry" in paragraphs(own)) == (made is good)


def test_what_only_the_tolerances_tell_is_not_called_determined() -> None:
    (own,) = [own for own in report_page(geometry()).sections if own.title == "What cannot be determined"]
    said = r"\d+ of \d+ parameters of geometry and tool are known by their tolerances only"
    assert re.search(said, paragraphs(own))
    assert "every parameter that was not held is determined" not in paragraphs(own)
