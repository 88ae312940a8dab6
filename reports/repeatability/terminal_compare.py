"""What a person reads of a comparison in the terminal: the same words and roundings as HTML and PDF."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.text import Text

from ..studies.study_terminal import print_block as print_block
from ..style.blocks import Table
from .compare_view import compare_view

Json = dict[str, Any]

_STYLE = {"pass": "bold blue", "weak": "bold yellow"}
_LONGEST_NAME = 26


def print_comparison(out: Console, answer: Json) -> None:
    """Verdict and notes, the means and scatter, then drift and each run against the others."""
    told = compare_view(answer)
    verdict = told.verdict
    out.print(Text(f"{verdict.word}. ", style=_STYLE[verdict.key]) + Text(verdict.sentence))
    for note in told.notes:
        out.print(Text("! ", style="bold yellow") + Text(note))
    for section in told.sections[:3]:
        for block in section.all:
            if isinstance(block, Table):
                out.print()
            print_block(out, block)
