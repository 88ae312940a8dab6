"""Which statements of a program are understood: those of the grammar of its language (`<language>.lark`).

A grammar is a list of what may stand in a program that is corrected. A statement that it does not derive,
as a whole, refuses the program.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from lark import Lark, TextSlice, Token, Tree
from lark.exceptions import UnexpectedInput


@cache
def _parser(language: str, rule: str) -> Lark:
    text = (Path(__file__).parent / f"{language}.lark").read_text("utf-8")
    return Lark(text, parser="lalr", start=rule, propagate_positions=True, maybe_placeholders=False)


def understood(language: str, rule: str, text: str, start: int, end: int) -> Tree[Token] | None:
    """The derivation by `rule` of the text from `start` to `end`, with places in the whole text; None where
    the grammar has none."""
    try:
        return _parser(language, rule).parse(TextSlice(text, start, end))
    except UnexpectedInput:
        return None
