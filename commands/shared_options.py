"""Options as Typer takes them, and those that several commands share."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from ..model.errors import BadInput
from ..model.options import REQUIRED, Option, OptionField, argument, arguments, options_of, parameters_of

if TYPE_CHECKING:
    from ..experiments.cluster import Traffic

Json = Annotated[bool, Option("Print JSON for programs, and nothing else.", "--json")]
Full = Annotated[bool, Option("Print the whole answer, not page one alone.", "--full")]
RunFile = Annotated[Path, argument("Run file (.jsonl).")]
PlanFile = Annotated[Path, argument("Plan file (.yaml).")]
NewRunFile = Annotated[Path, Option("Run file to write (.jsonl).", "-o --out")]
Force = Annotated[bool, Option("Replace the file if there is one of that name.", "--force --overwrite")]
Picture = Annotated[Path | None, Option("Write a page with the plan in 3D (.html).")]


@dataclass(frozen=True)
class Cluster:
    """Where the work is done, if not in this process."""

    workers: Annotated[
        int | None,
        Option("Use so many Dask workers on this machine.", least=1, most=256, metavar="N"),
    ] = None
    scheduler: Annotated[
        str | None,
        Option("Use the workers of the Dask scheduler at this address.", metavar="ADDRESS"),
    ] = None

    def opened(self) -> AbstractContextManager[Traffic | None]:
        """The cluster; nothing where none is stated."""
        if self.workers is not None and self.scheduler is not None:
            raise BadInput(
                "--workers and --scheduler exclude each other",
                allowed="--workers for a cluster on this machine, --scheduler for one that is there",
            )
        if self.workers is None and self.scheduler is None:
            return nullcontext()
        from ..experiments.cluster import cluster

        return cluster(self.workers, self.scheduler)


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
        "help": one.typed_help,
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
