"""Page one: few words and lines, one table, and nothing that could be taken for an answer where none is."""

import io
import re
from dataclasses import replace

import pytest
from command_line import WIDTH
from demo_reports import demo_reports
from example_results import EXAMPLES, geometry, good, x_pattern
from pypdf import PageObject, PdfReader
from rich.console import Console

from zerobeam.analysis.answer.answer_message import May
from zerobeam.analysis.answer.result import Result
from zerobeam.analysis.posterior.posterior import Draws
from zerobeam.experiments.demos import DemoRun, demo_runs
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.output.terminal import print_page
from zerobeam.reports.run.brief_page import front_page
from zerobeam.reports.run.front import MAP, front
from zerobeam.reports.run.report import pictures, report_page
from zerobeam.reports.run.run_scene import run_turnable
from zerobeam.reports.scene import STILL, still_picture
from zerobeam.reports.style.blocks import Bars, Block, FigureBlock, Paragraph, Table
from zerobeam.words import numbers
from zerobeam.words.controllers import TCP_OF_NOMINAL_ARM
from zerobeam.words.entries import MOST_CAUTIONS
from zerobeam.words.message import message

LINES, WORDS, ON_PAPER, VERDICT, PAGES = 25, 200, 250, 15, 6
MOST_LINES = 27  # of runs that are not the demo's


def words(text: str) -> int:
    """Those with a letter: numbers, signs and bars are none."""
    return sum(re.search(r"[^\W\d_]", word) is not None for word in text.split())


def printed(result: Result) -> str:
    text = io.StringIO()
    page = replace(front_page(result), sections=[])
    print_page(Console(file=text, width=WIDTH, highlight=False, color_system=None), page)
    return text.getvalue()


def on_paper(result: Result, draws: Draws | None) -> list[PageObject]:
    """The pages of the PDF as it is written."""
    turnable = run_turnable(result)
    assert turnable is not None
    drawn = pictures(result, draws) | {STILL: still_picture(turnable)}
    return list(PdfReader(io.BytesIO(pdf(report_page(result), drawn))).pages)


def table(result: Result) -> Table:
    return next(block for block in front(result, message(result)) if isinstance(block, Table))


@pytest.mark.parametrize("name", ["good", "x_pattern", "geometry"])
def test_what_is_assumed_has_no_number(name: str) -> None:
    """Whether values or offsets are shown."""
    result = EXAMPLES[name]
    assumed = [row.name for row in result.offsets if row.status == "assumed"]
    assert assumed
    rows = {row.cells[0].text: [cell.text for cell in row.cells[1:-1]] for row in table(result).rows}
    assert all(not any(rows[f"J{name.removeprefix('delta')}"]) for name in assumed)


def test_values_for_an_exact_arm_have_the_u_of_a_typical_one_beside_theirs() -> None:
    result = good()
    shown = table(result)
    assert [column.text for column in shown.columns][2:4] == ["± U (k\u00a0=\u00a02)", "typical arm"]
    by_name = {row.cells[0].text: row.cells[3].text for row in shown.rows}
    for name, u in result.geometry.consider.items():
        if result.parameters.named(name).status == "identified":
            assert by_name[f"J{name[-1]}"] == numbers.spread(2 * u, "deg")
    assert "typical arm" not in [column.text for column in table(geometry()).columns]


def test_where_the_tcp_is_now_has_a_band_where_nothing_is_entered() -> None:
    """A median alone is no more than that of the mean arm."""
    result = geometry()
    content = replace(message(result), may=May())
    (bars,) = (block for block in front(result, content) if isinstance(block, Bars))
    assert result.entered_geometry is not None or result.entered is not None
    assert "median of this arm (95 %)" in bars.caption
    assert re.fullmatch(r"[\d.]+\smm to [\d.]+\smm", bars.rows[0].text)


@pytest.mark.parametrize("case", demo_runs(), ids=lambda case: case.name)
def test_page_one_of_the_demo_is_read_in_ten_seconds(case: DemoRun) -> None:
    result = demo_reports().made_of[case.name].result
    text = printed(result)
    assert words(text) <= WORDS, text
    assert len(text.splitlines()) <= LINES, text
    assert words(message(result).verdict) <= VERDICT
    first = PdfReader(demo_reports().folder / case.name / "report.pdf").pages[0].extract_text()
    assert words(first) <= ON_PAPER, first
    assert "page 1 of" in first


@pytest.mark.parametrize("case", demo_runs(), ids=lambda case: case.name)
@pytest.mark.one_in(4)
def test_of_a_robot_that_was_measured_there_is_a_form_to_sign_too(case: DemoRun) -> None:
    result, draws = demo_reports().made_of[case.name]
    header = result.inputs.header | {"provenance": {"robot serial": "16-1", "date": "2026-11-02"}}
    measured = replace(result, inputs=replace(result.inputs, header=header))
    pages = on_paper(measured, draws)
    assert "Signature" in pages[-1].extract_text()
    assert len(pages) <= PAGES


@pytest.mark.parametrize("name", sorted(EXAMPLES))
def test_it_is_read_in_ten_seconds(name: str) -> None:
    result = EXAMPLES[name]
    text = printed(result)
    assert words(text) <= WORDS, text
    assert len(text.splitlines()) <= MOST_LINES, text
    assert words(message(result).verdict) <= VERDICT
    assert len((front_page(result).message or message(result)).cautions) <= MOST_CAUTIONS


def front_of(result: Result) -> list[Block]:
    return front(result, message(result))


def test_there_is_one_table_of_offsets() -> None:
    tables = [block for block in front_of(good()) if isinstance(block, Table)]
    assert tables[0].columns[-1].text == "trusted"
    assert sum(table.columns[0].text == "joint" for table in tables) == 1
    (bars,) = (block for block in front_of(good()) if isinstance(block, Bars))
    assert max(bars.shares) == 1.0
    assert bars.shares[1] == pytest.approx(bars.rows[1].value / bars.rows[0].value)
    # The map is of values that are entered.
    assert FigureBlock(MAP) in front_of(good())
    kept = front(good(), replace(message(good()), may=May()))
    assert FigureBlock(MAP) not in kept
    (bars,) = (block for block in kept if isinstance(block, Bars))
    assert [row.text for row in bars.rows][1:] == ["not claimed"]


def test_where_the_controller_takes_a_model_the_bar_is_that_of_the_model() -> None:
    result = geometry()
    assert result.entered is not None
    assert result.entered_geometry is not None
    for vendor, taken in (("abb", result.entered), ("doosan", result.entered_geometry)):
        (bars,) = (
            block
            for block in front_of(replace(result, inputs=replace(result.inputs, vendor=vendor)))
            if isinstance(block, Bars)
        )
        assert taken.tcp_after is not None
        assert bars.rows[-1].value == taken.tcp_after.median_mm


def test_no_error_is_claimed_of_a_controller_with_another_arm() -> None:
    """A UR computes with its factory calibration: a run with the nominal arm does not say its error."""
    result = good()
    for provenance, claimed in (({}, False), ({"origin": "simulated"}, True)):
        own = {**result.inputs.header, "robot": "ur5e", "provenance": provenance}
        inputs = replace(result.inputs, vendor="universal-robots", header=own)
        blocks = front_of(replace(result, inputs=inputs))
        assert any(isinstance(block, Bars) for block in blocks) == claimed
        assert (Paragraph(TCP_OF_NOMINAL_ARM) in blocks) != claimed


def test_a_wrong_model_has_no_table_and_no_bars() -> None:
    (block,) = front_of(EXAMPLES["misfit"])
    assert isinstance(block, Paragraph)
    assert "not claimed" in block.text


def test_what_is_not_determined_has_no_number_in_the_table() -> None:
    table = next(block for block in front_of(x_pattern()) if isinstance(block, Table))
    row = next(row for row in table.rows if row.cells[0].text == "J2")
    assert not re.search(r"\d", " ".join(cell.text for cell in row.cells[1:]))
    assert not [block for block in front_of(x_pattern()) if isinstance(block, Bars)]


def test_a_simulated_run_is_marked_by_a_band_and_keeps_its_colour() -> None:
    page = front_page(good())
    assert page.band == "Simulated: no robot was measured"
    assert page.verdict.key == "pass"
    header = {key: value for key, value in good().inputs.header.items() if key != "provenance"}
    measured = replace(good(), inputs=replace(good().inputs, header=header))
    assert front_page(measured).band == ""
