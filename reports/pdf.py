"""`report.pdf`."""

from __future__ import annotations

from typing import Any

from .canvas import Picture
from .typeset import typeset


def pdf(view: dict[str, Any], pictures: dict[str, Picture]) -> bytes:
    """The report as a tagged PDF/UA document; the same view gives the same bytes."""
    return typeset("report.typ", view, pictures)
