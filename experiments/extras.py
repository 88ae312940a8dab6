"""What is installed on request only: its absence in one message."""

from __future__ import annotations

from ..model.errors import BadInput


def missing_extra(what: str, extra: str, *, needed: str | None = None) -> BadInput:
    """`what` cannot be done without `extra` of zerobeam; `needed` calls it by another name."""
    return BadInput(
        f"{what} needs {needed or f'the extra `{extra}`'}, which is not installed",
        remedy=f'pip install "zerobeam[{extra}]"',
    )
