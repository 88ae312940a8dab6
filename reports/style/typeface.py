"""The typeface that ships with the program: IBM Plex Sans (SIL Open Font License, `fonts/OFL.txt`).

TrueType for matplotlib and typst, WOFF2 for the HTML file; no report depends on the fonts of the
machine that makes it or of the one that shows it.
"""

from __future__ import annotations

import functools
from pathlib import Path
from typing import Literal

from ...words.wording import escaped

Cut = Literal["Regular", "Bold", "Italic"]

FAMILY = "IBM Plex Sans"
FOLDER = Path(__file__).parent / "fonts"


def font_file(cut: Cut, kind: Literal["ttf", "woff2"] = "ttf") -> Path:
    return FOLDER / f"IBMPlexSans-{cut}.{kind}"


def in_font(text: str) -> str:
    """`text` with each letter that the report's font lacks written as an escape (`\\u4e2d`)."""
    if text.isascii():
        return text
    known = _letters()
    return "".join(letter if ord(letter) in known else escaped(letter) for letter in text)


@functools.cache
def _letters() -> frozenset[int]:
    from matplotlib.ft2font import FT2Font

    return frozenset(FT2Font(str(font_file("Regular"))).get_charmap())
