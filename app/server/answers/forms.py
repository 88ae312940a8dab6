"""Options of a format, as the page makes fields of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pydantic import Field

from ....model.files.json_document import JsonDocument
from ....model.options import REQUIRED, options_of


class FormField(JsonDocument):
    """An option of a format."""

    flag: str
    help: str
    choices: list[str] = Field(description="empty: any text")
    file: bool = Field(description="its value is a file of the folder")
    box: bool = Field(description="it takes no value")
    number: bool = Field(description="its value is a number")
    required: bool
    default: str | None


def form_of(source: Callable[..., object]) -> list[FormField]:
    """The options of a record or a function, in their order."""
    return [
        FormField(
            flag=one.flag,
            help=one.option.help,
            choices=list(map(str, one.words)),
            file=Path in one.kinds,
            box=one.box,
            number=not {int, float}.isdisjoint(kind for kind in one.kinds if isinstance(kind, type)),
            required=one.default is REQUIRED,
            default=None if one.typed_default in (None, False, REQUIRED) else str(one.typed_default),
        )
        for one in options_of(source)
    ]
