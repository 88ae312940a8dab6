"""What a page, a PDF and a terminal say, as text that tests compare."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ElementTree
from typing import Any

import pypdf
from command_line import WIDTH
from rich.console import Console

from zerobeam.reports.studies.study_terminal import print_study

Json = dict[str, Any]


def text_of(reader: pypdf.PdfReader) -> str:
    text = " ".join(page.extract_text() for page in reader.pages)
    return re.sub(r"\s+", " ", text.replace("\u200b", ""))


def cells(value: Any) -> list[str]:
    """All texts of the tables in a view."""
    if isinstance(value, dict):
        if "cells" in value:
            return [cell["text"] for cell in value["cells"]]
        return [text for item in value.values() for text in cells(item)]
    return [text for item in value for text in cells(item)] if isinstance(value, list) else []


def tables_of(view: Json, start: str) -> list[Json]:
    """Tables of a view whose caption begins so, in the page's order."""
    blocks = [block for section in view["sections"] for block in (*section["lead"], *section["blocks"])]
    tables = [block["it"] for block in blocks if block["kind"] == "table"]
    return [table for table in tables if table["caption"].startswith(start)]


def words(svg: str) -> str:
    return " ".join("".join(element.itertext()) for element in ElementTree.fromstring(svg))


def printed(answer: Json, colours: bool = False) -> str:
    text = io.StringIO()
    kind: Any = "truecolor" if colours else None
    print_study(
        Console(file=text, width=WIDTH, highlight=False, color_system=kind, force_terminal=colours), answer
    )
    return text.getvalue()
