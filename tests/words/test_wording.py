"""Foreign text made visible."""

import csv
import io
import re
from pathlib import Path

import pytest
from example_results import HOSTILE_NAMES

from zerobeam.reports.style.theme import in_font
from zerobeam.words.wording import clipped, csv_text, ended, label, person, sentence, shown


def test_what_cannot_be_seen_is_written_out() -> None:
    assert shown("nul\x00in") == "nul\\x00in"
    assert shown("\u202eabc") == "\\u202eabc"
    assert shown("lone\ud800") == "lone\\ud800"
    assert shown("two\r\nlines") == "two lines"
    assert shown("Größe δ²") == "Größe δ²"


def test_hostile_names_are_fit_for_utf8_and_xml() -> None:
    for name in HOSTILE_NAMES:
        text = shown(name)
        text.encode()
        assert not any(ord(letter) < 32 for letter in text)


def test_a_long_name_keeps_its_two_ends() -> None:
    assert clipped("a" * 300 + ".x", 20) == "a" * 12 + "…" + "aaaaa.x"
    assert len(clipped("b" * 300, 20)) == 20
    assert clipped("short.x", 20) == "short.x"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("delta2", "J2 (δ2)"),
        ("delta12", "J12 (δ12)"),
        ("delta1x", "delta1x"),
        ("delta2.x", "delta2.x"),  # a target may be called that
        ("target", "target"),
        ("link2.a", "link 2, a"),
        ("link6.b", "link 6, b"),
        ("link12.alpha", "link 12, α"),
        ("link3.beta", "link 3, β"),
        ("joint3.gravity", "J3, gravity"),
        ("joint3.cos", "J3, cos q"),
        ("link2.x", "link2.x"),  # a coordinate of a target of that name
        ("tool.z", "tool.z"),
    ],
)
def test_parameters_by_the_names_that_people_use(name: str, words: str) -> None:
    assert label(name) == person(name) == words
    assert sentence(name) == name  # a sentence is not read back


def test_a_sentence_ends_with_one_mark() -> None:
    assert ended("no end") == "no end."
    for text in ("an end.", "an end?", "an end!"):
        assert ended(text) == text


def test_letters_that_the_typeface_lacks_become_escapes() -> None:
    assert in_font("Größe δ² − ±0.1°, χ² σ √ →") == "Größe δ² − ±0.1°, χ² σ √ →"
    assert in_font("🎯 靶") == "\\U0001f3af \\u9776"


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
    assert writers == ["words/wording.py"]
