"""The page of all commands and options, made from the command line itself."""

from __future__ import annotations

import typing
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import typer.main

from zerobeam.commands.program import app

_KINDS = {bool: "", int: "whole number", float: "number", str: "text", Path: "path"}
_INTRO = """\
# Commands

Made from the command line: `zerobeam COMMAND --help` prints the same. The exit status is 0 for the verdict
pass (or where the command succeeded), 1 for weakly observable or degenerate, or a study or comparison that
does not agree, or a signature that is not valid, 2 for bad input or usage, 3 for a fault of the rig, a fit
that did not converge or output that cannot be written, 130 after Ctrl-C or SIGTERM, 141 where nobody reads
the output any more.
"""


def commands(group: Any, name: str = "zerobeam") -> Iterator[tuple[str, Any]]:
    """Every command that does something, by its whole name, groups gone into."""
    for word, command in group.commands.items():
        whole = f"{name} {word}"
        if hasattr(command, "commands"):
            yield from commands(command, whole)
        else:
            yield whole, command


def choices(annotation: Any) -> list[str]:
    """The values of an option that has a choice of them; none for any other."""
    if typing.get_origin(annotation) is typing.Literal:
        return list(typing.get_args(annotation))
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return [value.value for value in annotation]
    return []


def page() -> str:
    """The page in Markdown."""
    return "\n".join(
        [_INTRO, *(_told(name, command) for name, command in commands(typer.main.get_command(app)))]
    )


def _told(name: str, command: Any) -> str:
    asked = [one for one in command.params if one.param_type_name == "argument"]
    options = [one for one in command.params if one.param_type_name == "option" and one.name != "help"]
    usage = " ".join(
        [name, *(one.name.upper() + ("…" if one.nargs == -1 else "") for one in asked), "[options]"]
    )
    lines = [f"## {name}", "", " ".join((command.help or "").split()), "", f"    {usage}", ""]
    lines += ["| | takes | default | |", "|---|---|---|---|"]
    for one in asked:
        lines.append(_row(one.name.upper(), one))
    for one in options:
        lines.append(_row("`, `".join([*one.opts, *one.secondary_opts]), one))
    return "\n".join([*lines, ""])


def _row(name: str, one: Any) -> str:
    told = [f"`{name}`", _kind(one), _default(one), one.help or ""]
    return f"| {' | '.join(text.replace('|', chr(92) + '|') for text in told)} |"


def _kind(one: Any) -> str:
    annotation = one.type_descriptor.annotation
    if values := choices(annotation):
        return ", ".join(f"`{value}`" for value in values)
    annotation = next(iter(typing.get_args(annotation)), annotation)  # list[str]
    kind = _KINDS[annotation]
    return kind + (", repeatable" if one.multiple else "")


def _default(one: Any) -> str:
    if one.required:
        return "required"
    if _is_flag(one):
        return "on" if one.default else ""
    if one.default is None:
        return ""
    value = one.default.value if isinstance(one.default, Enum) else one.default
    return f"`{value}`"


def _is_flag(one: Any) -> bool:
    return bool(getattr(one, "is_flag", False))
