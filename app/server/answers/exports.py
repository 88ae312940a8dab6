"""The forms in which offsets are exported, as the makers have them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Annotated, Literal, get_args, get_origin, get_type_hints

from pydantic import Field

from ....experiments.makers.maker import Option, makers
from ....model.files.json_document import JsonDocument
from ..folder import Folder
from ..requests import EndPoint


class ExportOption(JsonDocument):
    """An option of a form."""

    flag: str
    help: str
    choices: list[str] = Field(description="empty: any text")
    file: bool = Field(description="its value is a file of the folder")
    default: str | None


class ExportForm(JsonDocument):
    """A form: `export NAME` writes it."""

    name: str
    maker: str
    vendor: str | None = Field(description="of the robots that it is for, as robot files name it; null: any")
    about: str
    ending: str
    options: list[ExportOption]


@cache
def exports(_: Folder) -> list[ExportForm]:
    """The forms of all makers, those for robots of any maker first."""
    listed_first = sorted(makers(), key=lambda maker: maker.vendor is not None)
    return [
        ExportForm(
            name=form.name,
            maker=maker.name,
            vendor=maker.vendor,
            about=inspect.getdoc(form.text) or form.name,
            ending=form.ending,
            options=list(_options(form.text)),
        )
        for maker in listed_first
        for form in maker.offsets
    ]


def _options(text: Callable[..., str]) -> Iterator[ExportOption]:
    names = {"Run": object, "RobotCalibration": object}  # which are only imported for type checking
    hints = get_type_hints(text, localns=names, include_extras=True)
    for parameter in inspect.signature(text).parameters.values():
        hint = hints[parameter.name]
        option = next((part for part in get_args(hint)[1:] if isinstance(part, Option)), None)
        if get_origin(hint) is not Annotated or option is None:
            continue
        kinds = _alternatives(get_args(hint)[0])
        default = parameter.default
        yield ExportOption(
            flag=option.flag or f"--{parameter.name.replace('_', '-')}",
            help=option.help,
            choices=[str(word) for kind in kinds if get_origin(kind) is Literal for word in get_args(kind)],
            file=Path in kinds,
            default=None if default in (None, inspect.Parameter.empty) else str(default),
        )


def _alternatives(kind: object) -> tuple[object, ...]:
    args = get_args(kind)
    return args if args and get_origin(kind) is not Literal else (kind,)


END_POINTS = [EndPoint("/api/exports", "GET", "The forms in which offsets are exported.", exports)]
