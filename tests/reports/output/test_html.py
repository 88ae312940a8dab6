"""report.html: one file, no script, no network, hostile names as text."""

import base64
import dataclasses
import functools
import json
import re
from itertools import pairwise

import pytest
from example_results import EXAMPLES, FORBIDDEN, drawn, good, misfit
from pages import Page, assert_fetches_nothing

from zerobeam.analysis.answer.result import Result
from zerobeam.model.records import dumps
from zerobeam.reports.output.html import html
from zerobeam.reports.run.report import report_page
from zerobeam.reports.style.blocks import Page as PageOfBlocks
from zerobeam.reports.style.blocks import Verdict, row_of, section_of, table_of
from zerobeam.words.sentences import to_json


def made(result: Result) -> str:
    return html(report_page(result), drawn(result), "report", dumps(to_json(result)))


@functools.cache
def page_of(name: str) -> str:
    return made(EXAMPLES[name])


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name == "geometry" else name for name in EXAMPLES]
)
@pytest.mark.at_length(r"^(?!hostile$)")
def test_it_is_one_well_formed_file_that_fetches_nothing(name: str) -> None:
    text = page_of(name)
    page = Page(text)
    text.encode()
    assert_fetches_nothing(page)
    style = text[text.index("<style>") : text.index("</style>")]
    assert set(re.findall(r"url\(\"?([a-z]+):", style)) == {"data"}
    assert len(text.encode()) < 3_000_000
    for stated in ("@media (prefers-color-scheme: dark)", "@media print", 'name="viewport"'):
        assert stated in text
    assert not re.search(r"/\* (LIGHT|DARK) \*/", text)


def test_no_unidentifiable_parameter_has_a_number_and_no_name_does_harm() -> None:
    """The decisive test: whatever its prior draws were, no row of it has a digit beside its name."""
    for name in ("x_pattern", "hostile"):
        result, page = EXAMPLES[name], Page(page_of(name))
        rows = [row for row in page.rows if "not determined by these data" in row]
        untold = [row for row in result.parameters if row.status == "unidentifiable"]
        assert len(rows) >= len(untold)
        for row in page.rows:
            if row[0] == "J2 (δ2)":
                assert not re.search(r"\d", " ".join(row[1:]))
        text = " ".join(page.text)
        assert "<script" not in page_of(name)
        assert ("alert('x')" in text) == ("{{ 7*7 }}" in text) == (name == "hostile")
        assert not {"\x00", "\u202e"} & set(text)
        assert f"{abs(FORBIDDEN):.2f}" not in text
        assert "4.98" not in text


def test_figures_tables_and_headings_are_told_to_a_screen_reader() -> None:
    page = Page(page_of("good"))
    roles = [attributes for _, attributes in page.tags if attributes.get("role") == "img"]
    assert len(roles) == 5
    assert all(attributes["aria-label"] for attributes in roles)
    assert dict(page.tags[[tag for tag, _ in page.tags].index("html")][1]) == {"lang": "en"}
    headers = [attributes for tag, attributes in page.tags if tag == "th"]
    assert all(attributes.get("scope") in ("row", "col") for attributes in headers)
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h\d", tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in pairwise(levels))


@pytest.mark.long
def test_result_json_is_attached_where_it_is_small() -> None:
    found = re.search(r'download="result.json" href="data:application/json;base64,([^"]+)"', page_of("good"))
    assert found
    assert json.loads(base64.b64decode(found.group(1))) == to_json(good())
    many = dataclasses.replace(misfit(), shots=misfit().shots * 15)
    assert len(dumps(to_json(many))) > 200_000
    assert "download=" not in made(many)


@pytest.mark.long
def test_the_head_has_date_and_serial_number_of_a_robot_that_was_measured() -> None:
    def page(origin: str) -> str:
        inputs = good().inputs
        stated = {"When": "2026-05-01", "robot_serial": "1600-42", "origin": origin}
        header = {**inputs.header, "provenance": stated}
        result = dataclasses.replace(good(), inputs=dataclasses.replace(inputs, header=header))
        return " ".join(" ".join(Page(made(result)).text).split())

    said = "Date of the measurements 2026-05-01 Robot, serial number 1600-42"
    text = page("by hand")
    assert said in text
    assert text.index(said) < text.index("J2 to J5 are identified")
    assert "Calibrated by" not in text[: text.index("J2 to J5 are identified")]  # nobody is stated
    assert said not in page("simulated")


def test_details_are_folded_below_what_matters() -> None:
    text = page_of("good")
    assert "Leave out geometry: exact to estimate the links" in text
    assert "`" not in Page(text).words  # keys stand in them in the sentences
    first = text.index('<details class="fold">')
    assert text.index(">trusted</th>") < text.index("Accuracy of the TCP</bdi></h2>") < first
    assert first < text.index("Fit quality</bdi></h2>") < text.index("Uncertainty budget</bdi></h2>")
    parts = re.findall(r'href="#(part-\d+)"', text)
    assert parts == [f"part-{i + 1}" for i in range(len(parts))]
    assert len(parts) == text.count("<h2>")
    assert all(text.count(f'id="{part}"') == 1 for part in parts)


@pytest.mark.parametrize(
    ("cells", "narrow"),
    [
        (("J2 (δ2)", "−1.222°", "0.020°", "33 %"), True),
        (("J2 (δ2)", "a text of more than twenty letters", "0.020°", "33 %"), False),
        (("J2 (δ2)", "−1.22246°", "−1.24 to −1.20°", "−1.241 to −1.201°"), False),
    ],
    ids=str,
)
def test_a_phone_has_a_table_where_its_rows_fit_a_line(cells: tuple[str, ...], narrow: bool) -> None:
    """Else a list of its rows: numbers of one column below each other are read faster."""
    table = table_of("Offsets", ["name", "estimate", "U", "set by tolerances"], [row_of(*cells)])
    page = PageOfBlocks("title", "subtitle", Verdict("pass", "Pass", "All."), [], [section_of("one", table)])
    assert table.narrow == narrow
    assert ('<table class="narrow">' in html(page, {}, "report")) == narrow
    assert ('<table class="wide">' in html(page, {}, "report")) != narrow
