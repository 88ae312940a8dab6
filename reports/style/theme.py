"""One palette for figures, HTML and PDF, in a light and a dark form, and one typeface.

The hues are the blue, vermillion and purple of Okabe & Ito's set, which people of every kind of
colour vision distinguish, moved in lightness until they can be read as text on their ground
(WCAG AA, 4.5 : 1). A status is never shown by colour alone: it has a word and a shape as well.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...words.wording import escaped


@dataclass(frozen=True)
class Colour:
    """One role's colour on a light and on a dark ground, both `#rrggbb`."""

    light: str
    dark: str


PALETTE: dict[str, Colour] = {
    "ground": Colour("#fdfdfc", "#14171a"),
    "panel": Colour("#f3f4f5", "#1e2328"),
    "line": Colour("#d3d7db", "#3a424a"),
    "muted": Colour("#5a646e", "#a3adb7"),
    "ink": Colour("#1b2126", "#e6e9ec"),
    "identified": Colour("#0067a5", "#5cb3ea"),
    "weak": Colour("#a84a00", "#f0a35c"),
    "unidentifiable": Colour("#963072", "#e08fc0"),
    "held": Colour("#5b636d", "#a6aeb8"),
    "assumed": Colour("#666c72", "#9aa2aa"),
    "unvalidated": Colour("#6b6157", "#b3a99e"),
    "misfit": Colour("#b3261e", "#f2908a"),
}

# What a shape says, the same in every table and figure (matplotlib's marker, and the mark's name).
SHAPES: dict[str, str] = {
    "identified": "o",
    "weak": "D",
    "unidentifiable": "x",
    "assumed": "h",
    "held": "s",
    "unvalidated": "^",
}

# The shape and colour of a verdict in lists.
VERDICT_MARKS: dict[str, str] = {
    "misfit": "unvalidated",
    "degenerate": "unidentifiable",
    "weak": "weak",
    "pass": "identified",
}


def css_variables(theme: str) -> str:
    """The palette as CSS custom properties, `theme` light or dark: `--ink: #1b2126; …`."""
    return " ".join(f"--{role}: {getattr(colour, theme)};" for role, colour in PALETTE.items())


def light(role: str) -> str:
    return PALETTE[role].light


# The typeface that ships with the program: IBM Plex Sans (SIL Open Font License, `fonts/OFL.txt`).
#
# TrueType for matplotlib and typst, WOFF2 for the HTML file; no report depends on the fonts of the machine
# that makes it or of the one that shows it.

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
