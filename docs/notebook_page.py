"""A notebook in jupytext's percent format as a page of the site: text, code, and what each cell shows."""

from __future__ import annotations

import ast
import contextlib
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_CELL = re.compile(r"^# %%([^\n]*)\n", flags=re.MULTILINE)


def cells(text: str) -> Iterator[tuple[bool, str]]:
    """Of each cell whether it is text, and what is in it."""
    _, *parts = _CELL.split(text)
    for kind, body in zip(parts[::2], parts[1::2], strict=True):
        if kind.strip() == "[markdown]":
            yield (
                True,
                "\n".join(line.removeprefix("#").removeprefix(" ") for line in body.strip().split("\n")),
            )
        else:
            yield False, body.strip()


def page(path: Path) -> str:
    """The notebook as Markdown, carried out in the present folder."""
    names: dict[str, Any] = {"__name__": "__main__"}
    parts = []
    for is_text, body in cells(path.read_text(encoding="utf-8")):
        parts.append(body if is_text else f"```python\n{body}\n```")
        if not is_text:
            parts.extend(shown(body, names))
    return "\n\n".join(parts) + "\n"


def shown(code: str, names: dict[str, Any]) -> Iterator[str]:
    """What a cell prints, then its last expression's value, as a notebook shows them."""
    tree = ast.parse(code)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    value, printed = None, io.StringIO()
    with contextlib.redirect_stdout(printed):
        # The cells have their own imports from __future__, not those of this file.
        exec(compile(tree, "notebook", "exec", dont_inherit=True), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), "notebook", "eval", dont_inherit=True), names)
    if printed.getvalue():
        yield f"```text\n{printed.getvalue().rstrip()}\n```"
    if hasattr(value, "_repr_html_"):
        # A blank line would end the HTML for Markdown.
        yield re.sub(r"\n\s*\n", "\n", value._repr_html_().strip())
    elif value is not None:
        yield f"```text\n{value!r}\n```"
