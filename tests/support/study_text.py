"""What a page, a PDF and a terminal say, as text that tests compare."""

import dataclasses
import io
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Sequence
from typing import Any

import pypdf
from command_line import WIDTH
from example_studies import typed
from rich.console import Console

from zerobeam.experiments.studies.answer import StudyAnswer
from zerobeam.reports.output.terminal import print_page
from zerobeam.reports.studies.study_blocks import NOT_DETERMINED
from zerobeam.reports.studies.study_pages import study_page
from zerobeam.reports.style.blocks import Page, Row, Table

Json = dict[str, Any]


def text_of(reader: pypdf.PdfReader) -> str:
    text = " ".join(page.extract_text() for page in reader.pages)
    return re.sub(r"\s+", " ", text.replace("\u200b", ""))


def cells(value: Any) -> list[str]:
    """All texts of the tables in a view."""
    if isinstance(value, Row):
        return [cell.text for cell in value.cells]
    if dataclasses.is_dataclass(value):
        return cells(vars(value))
    if isinstance(value, dict):
        return cells(list(value.values()))
    return [text for item in value for text in cells(item)] if isinstance(value, list | tuple) else []


def texts_of(table: Table) -> list[list[str]]:
    """The texts of a table's rows."""
    return [[cell.text for cell in row.cells] for row in table.rows]


def tables_of(view: Page, start: str) -> list[Table]:
    """Tables of a view whose caption begins so, in the page's order."""
    blocks = [block for section in view.sections for block in section.all]
    return [block for block in blocks if isinstance(block, Table) and block.caption.startswith(start)]


def numbers_in(text: str) -> list[str]:
    return re.findall(r"\u2212?\d+(?:\.\d+)?", text)


def is_rounded(text: str, value: float) -> bool:
    """Whether `text` is `value` rounded to the place where it ends."""
    unit = 10.0 ** -len(text.partition(".")[2])
    return abs(float(text.replace("\u2212", "-")) - value) <= 0.5000001 * unit


def untrue(rows: Iterable[Sequence[str]], expected: Iterable[Sequence[float | None]]) -> list[str]:
    """Numbers in the rows of a table, behind their names, that are not the expected ones, rounded; None: the
    rest is not determined."""
    wrong = []
    for (name, *texts), values in zip(rows, expected, strict=True):
        printed = numbers_in(" ".join(texts))
        if None in values:
            assert texts[-1] == NOT_DETERMINED
            values = values[: values.index(None)]
        assert len(printed) == len(values), (texts, values)
        wrong += [
            f"{name}: {text}"
            for text, value in zip(printed, values, strict=True)
            if not is_rounded(text, value or 0.0)
        ]
    return wrong


def words(svg: str) -> str:
    return " ".join("".join(element.itertext()) for element in ElementTree.fromstring(svg))


def printed(answer: StudyAnswer | Json, colours: bool = False) -> str:
    text = io.StringIO()
    kind: Any = "truecolor" if colours else None
    print_page(
        Console(file=text, width=WIDTH, highlight=False, color_system=kind, force_terminal=colours),
        study_page(typed(answer)).brief,
    )
    return text.getvalue()
