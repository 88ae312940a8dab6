"""Foreign text made visible."""

from __future__ import annotations

from example_results import HOSTILE_NAMES

from zerobeam.reports.style.typeface import in_font
from zerobeam.words.wording import clipped, ended, label, person, sentence, shown


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


def test_offsets_are_written_as_people_write_them() -> None:
    assert label("delta12") == "J12 (δ12)"
    assert label("delta1x") == "delta1x"
    assert person("delta3") == "J3 (δ3)"
    assert person("target") == "target"
    # A target may be called that, and a sentence is not read back.
    assert label("delta2.x") == person("delta2.x") == "delta2.x"
    assert sentence("delta2.x and delta2") == "delta2.x and delta2"


def test_a_sentence_ends_with_one_mark() -> None:
    assert ended("no end") == "no end."
    for text in ("an end.", "an end?", "an end!"):
        assert ended(text) == text


def test_letters_that_the_typeface_lacks_become_escapes() -> None:
    assert in_font("Größe δ² − ±0.1°, χ² σ √ →") == "Größe δ² − ±0.1°, χ² σ √ →"
    assert in_font("🎯 靶") == "\\U0001f3af \\u9776"
