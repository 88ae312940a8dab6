"""Options of a format, as the page makes fields of them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from ....model.options import REQUIRED, options_of
from ....model.records import it, record


@record(kw_only=True)
class FormField:
    """An option of a format."""

    flag: str
    help: str
    choices: Annotated[list[str], it("empty: any text")]
    file: Annotated[bool, it("its value is a file of the folder")]
    box: Annotated[bool, it("it takes no value")]
    number: Annotated[bool, it("its value is a number")]
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
