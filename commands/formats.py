"""Options as Typer takes them: a command is a function of them, or of records that have them as fields."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from functools import cache
from typing import Annotated, Any, TypeVar

import typer

from ..model.options import REQUIRED, OptionField, arguments, options_of, parameters_of

Command = Callable[..., None]
Returned = TypeVar("Returned")
Function = TypeVar("Function", bound=Callable[..., Any])


def typer_parameters(function: Callable[..., Any]) -> list[inspect.Parameter]:
    """The parameters of a function, and the options of the records that it takes, as Typer takes them."""
    parameters = [_parameter(one) for one in options_of(function)]
    contexts = [one for one, hint in parameters_of(function) if hint is typer.Context]
    return [one.replace(annotation=typer.Context, kind=one.KEYWORD_ONLY) for one in contexts] + parameters


@cache
def _parameter(one: OptionField) -> inspect.Parameter:
    option, default = one.option, one.typed_default
    how: Any = {
        "help": option.help,
        "min": option.least,
        "max": option.most,
        "metavar": option.metavar,
        "envvar": option.variable,
        "show_default": default not in (None, "", (), REQUIRED),
    }
    kind = typer.Argument(**how) if option.argument else typer.Option(*one.flags, **how)
    return inspect.Parameter(
        one.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[one.typed, kind]
    )


def with_options(command: Callable[..., Returned], *others: Callable[..., Any]) -> Callable[..., Returned]:
    """The command with its options, for Typer to read: its records are made of what is typed. The options of
    the functions `others` reach it as they were typed."""
    parameters = [each for one in (command, *others) for each in typer_parameters(one)]
    return with_parameters(of_typed(command), parameters)


def of_typed(command: Callable[..., Returned]) -> Callable[..., Returned]:
    """The command, called with what was typed."""

    def typed_command(**typed: Any) -> Returned:
        return command(**arguments(command, typed))

    typed_command.__doc__ = command.__doc__
    return typed_command


def with_parameters(
    command: Callable[..., Returned], parameters: Iterable[inspect.Parameter]
) -> Callable[..., Returned]:
    """The command with these parameters, in this order, for Typer to read."""
    signature = inspect.Signature(list(parameters))
    command.__signature__ = signature  # type: ignore[attr-defined]
    command.__annotations__ = {name: each.annotation for name, each in signature.parameters.items()}
    return command


class Group(typer.Typer):
    """A group of commands that are functions of options."""

    def of_options(self, name: str) -> Callable[[Function], Function]:
        """Make the function below a command of this name."""

        def added(function: Function) -> Function:
            self.command(name)(with_options(function))
            return function

        return added
