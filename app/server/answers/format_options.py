"""Options of a maker's format, as the page makes fields of them."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Literal, get_args, get_origin

from pydantic import Field

from ....experiments.makers.maker import options_of_format
from ....model.files.json_document import JsonDocument


class FormatOptionAnswer(JsonDocument):
    """An option of a format."""

    flag: str
    help: str
    choices: list[str] = Field(description="empty: any text")
    file: bool = Field(description="its value is a file of the folder")
    box: bool = Field(description="it takes no value")
    number: bool = Field(description="its value is a number")
    required: bool
    default: str | None


def described_options(function: Callable[..., object]) -> list[FormatOptionAnswer]:
    """The options of the function of a format, in their order."""
    return [
        FormatOptionAnswer(
            flag=option.flag,
            help=option.help,
            choices=[
                str(word) for kind in option.kinds if get_origin(kind) is Literal for word in get_args(kind)
            ],
            file=Path in option.kinds,
            box=bool in option.kinds,
            number=bool({int, float} & {kind for kind in option.kinds if isinstance(kind, type)}),
            required=option.default is inspect.Parameter.empty,
            default=None if option.default in (None, False, inspect.Parameter.empty) else str(option.default),
        )
        for option in options_of_format(function)
    ]
