"""What tells that a text is in a language whose statements are lines: one mark for all of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from .maker import FormatMark

if TYPE_CHECKING:
    from .line_language import LineLanguage
    from .recordings import TaughtPoint


def line_mark(pattern: str, why: str, language: Callable[[], LineLanguage]) -> FormatMark:
    """The mark of a text whose positions are those of the `language`, which is loaded once they are read."""

    def points(text: str, path: Path) -> Sequence[TaughtPoint]:
        from .taught_positions import written_points

        return written_points(language(), text, path)

    return FormatMark(pattern, why, points)
