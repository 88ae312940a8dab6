"""The console that everything is printed to."""

from __future__ import annotations

from collections.abc import Iterable

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from ...words.wording import visible


class Terminal(Console):
    """A console to which no text gets that a terminal would obey or a person not see: it is escaped.

    Its own colours and movements of the cursor are not text, and pass.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else visible(text), style, control)
