"""The typeface that ships with the program: IBM Plex Sans (SIL Open Font License, `fonts/OFL.txt`).

TrueType for matplotlib and typst, WOFF2 for the HTML file; no report depends on the fonts of the
machine that makes it or of the one that shows it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

Cut = Literal["Regular", "Bold", "Italic"]

FAMILY = "IBM Plex Sans"
FOLDER = Path(__file__).parent / "fonts"


def font_file(cut: Cut, kind: Literal["ttf", "woff2"] = "ttf") -> Path:
    return FOLDER / f"IBMPlexSans-{cut}.{kind}"
