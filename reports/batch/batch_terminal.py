"""What a person reads of a batch in the terminal."""

from __future__ import annotations

from rich.console import Console
from rich.text import Text

from ...words.wording import clipped
from ..style.console import VERDICT_STYLE, note, print_block
from .batch_page import Batch, batch_page

_MOST_NAMED = 20


def print_batch(out: Console, done: Batch) -> None:
    """How many have which outcome, and the failures with the first line of their message."""
    page = batch_page(done)
    out.print(
        Text(f"{page.verdict.word}. ", style=VERDICT_STYLE[page.verdict.key]) + Text(page.verdict.sentence)
    )
    for text in page.notes:
        out.print(note(text))
    for block in page.sections[0].all:
        print_block(out, block)
    failed = [row for row in done.rows if row.outcome == "failed"]
    for row in failed[:_MOST_NAMED]:
        first = row.message.splitlines()[0]
        out.print(Text(f"{clipped(row.file, 60)}: ", style="bold") + Text(clipped(first, 200)))
    if len(failed) > _MOST_NAMED:
        out.print(Text(f"… and {len(failed) - _MOST_NAMED} more failures, in runs.csv"))
