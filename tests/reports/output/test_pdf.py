"""report.pdf: its text, its outline, its fonts; hostile names as text."""

import dataclasses
import functools
import io
import re

import pypdf
import pytest
from example_results import EXAMPLES, FORBIDDEN, drawn, good
from study_text import cells, text_of

from zerobeam.analysis.answer.result import Result
from zerobeam.reports.output.pdf import pdf
from zerobeam.reports.run.report import report_page
from zerobeam.reports.style.blocks import on_paper


def made(result: Result) -> pypdf.PdfReader:
    return pypdf.PdfReader(io.BytesIO(pdf(report_page(result), drawn(result))))


@functools.cache
def of_example(name: str) -> pypdf.PdfReader:
    return made(EXAMPLES[name])


@functools.cache
def text_of_example(name: str) -> str:
    return text_of(of_example(name))


@pytest.mark.long
@pytest.mark.parametrize("name", [name for name in EXAMPLES if name != "hostile"])
@pytest.mark.at_length(r"^(?!geometry$)")
def test_every_cell_of_the_page_is_in_the_pdf(name: str) -> None:
    result = EXAMPLES[name]
    text = text_of_example(name).replace(" ", "")
    page = report_page(result)
    of_paper = [on_paper(section.all) for section in page.sections]
    for cell in cells([page.front, of_paper]):
        assert re.sub(r"\s", "", cell) in text, cell


def test_it_has_a_title_an_outline_page_numbers_tags_and_only_its_own_fonts() -> None:
    reader = of_example("good")
    assert reader.metadata is not None
    assert reader.metadata.title == "Joint offsets of irb1600"
    titles = [entry["/Title"] for entry in reader.outline if not isinstance(entry, list)]
    assert titles == [
        "What cannot be determined",
        "What to do next",
        "What would make it better",
        "Rehearsal: estimates and true values",
        "Positions of the targets",
        "Accuracy of the TCP",
        "What else to know",
        "Fit quality",
        "Residuals",
        "Placements and recordings",
        "Offsets",
        "Uncertainty budget",
        "Posterior",
        "Inputs",
    ]
    assert f"page 1 of {len(reader.pages)}" in text_of_example("good")
    assert reader.trailer["/Root"]["/MarkInfo"]["/Marked"]
    fonts = {
        str(font.get_object()["/BaseFont"]).split("+")[-1]
        for page in reader.pages
        for font in page["/Resources"]["/Font"].values()
    }
    assert fonts
    # Commands are in the typeface of fixed width that typst brings.
    assert {font for font in fonts if not font.startswith("IBMPlexSans")} <= {"DejaVuSansMono"}


def test_the_same_result_gives_the_same_bytes() -> None:
    shown, figures = report_page(good()), drawn(good())
    assert pdf(shown, figures) == pdf(shown, figures)


@pytest.mark.long
def test_typst_markup_in_names_is_text_and_what_is_not_determined_has_no_number() -> None:
    text = text_of_example("hostile")
    assert "J2 (δ2) not determined by these data unidentifiable" in text
    assert not {f"{abs(FORBIDDEN):.2f}", "4.98", "9.77"} & set(re.findall(r"\d+\.\d\d", text))
    assert '#import "/etc/passwd": *; $x^2$ *bold* `raw` @cite <label>' in text
    assert "root:" not in text
    assert "<script>alert('x')</script>" in text
    assert "nul\\x00inside" in text
    assert "\\U0001f3af target" in text


@pytest.mark.long
def test_a_run_without_notes_or_provenance_is_set_too() -> None:
    header = {key: value for key, value in good().inputs.header.items() if key != "provenance"}
    inputs = dataclasses.replace(good().inputs, header=header)
    assert "Provenance" not in text_of(made(dataclasses.replace(good(), inputs=inputs)))
