"""Commands made of the formats that makers have: a format's options become parameters of its command."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Annotated, TypeVar, get_args

import typer
from typer.models import ParameterInfo

from ..experiments.makers.maker import Option

Command = Callable[..., None]
Returned = TypeVar("Returned")


def options_of(function: Callable[..., object]) -> list[inspect.Parameter]:
    """The parameters of a function that are annotated as options (or for Typer), as Typer takes them."""
    parameters = []
    for parameter in inspect.signature(function).parameters.values():
        for part in get_args(parameter.annotation)[1:]:
            if isinstance(part, Option):
                kind = get_args(parameter.annotation)[0]
                parameter = parameter.replace(annotation=Annotated[kind, _typer(part, parameter, kind)])
            if isinstance(part, Option | ParameterInfo):
                parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    return parameters


def _typer(option: Option, parameter: inspect.Parameter, kind: object) -> object:
    flag = option.flag or (f"--{parameter.name.replace('_', '-')}" if kind is bool else None)
    return typer.Option(
        *([] if flag is None else [flag]),
        help=option.help,
        min=option.least,
        show_default=parameter.default not in (None, inspect.Parameter.empty),
    )


def with_parameters(
    command: Callable[..., Returned], parameters: Iterable[inspect.Parameter]
) -> Callable[..., Returned]:
    """The command with these parameters, in this order, for Typer to read."""
    signature = inspect.Signature(list(parameters))
    command.__signature__ = signature  # type: ignore[attr-defined]
    command.__annotations__ = {name: each.annotation for name, each in signature.parameters.items()}
    return command
