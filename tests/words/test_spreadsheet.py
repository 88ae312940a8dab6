"""CSV for spreadsheets: text stays text."""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import pytest

from zerobeam.words.spreadsheet import csv_text

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("text", ["=1+1", "+1", "-1", "@a", "\t=1", "\r@a", " =1", "\n\n-1"])
def test_no_text_is_a_formula(text):
    (head, row) = csv.reader(io.StringIO(csv_text([{text: text}])))
    for (cell,) in (head, row):
        assert cell.startswith("'")
        assert cell.endswith(text.strip())


def test_numbers_other_text_and_empty_cells_stay():
    row = {"a": -1.5, "b": None, "c": "J2, left = right", "d": -3, "e": ""}
    assert csv_text([row, row]).splitlines() == ["a,b,c,d,e", *['-1.5,,"J2, left = right",-3,'] * 2]
    assert csv_text([]) == ""
    assert csv_text([{"a": "\u202ex\x00"}]) == "a\n\\u202ex\\x00\n"


def test_there_is_one_writer_of_csv():
    writers = [
        str(path.relative_to(ROOT))
        for room in ("app", "model", "analysis", "words", "experiments", "reports", "face", "commands")
        for path in (ROOT / room).rglob("*.py")
        if re.search(r"csv\.(writer|DictWriter)", path.read_text(encoding="utf-8"))
    ]
    assert writers == ["words/spreadsheet.py"]
