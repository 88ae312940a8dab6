"""Kinds of fields that files have in many places: points, positive numbers, names, one number or a list."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field

from .reading import shown
from .validation import as_tuple, refusal, tuple_of


def _name(value: object) -> object:
    """A name that can stand in a table, in JSON and in front of '.x'."""
    if isinstance(value, str) and (not value or value != value.strip() or not value.isprintable()):
        raise refusal(
            "this cannot be a name",
            found=shown(value),
            allowed="printable text that neither begins nor ends with a blank",
        )
    return value


def _target_name(value: object) -> object:
    if value == "tool":
        # Parameters of targets and of the tool are both called <name>.x.
        raise refusal("a target cannot be called 'tool'", remedy="give it another name")
    return _name(value)


def positive_or_list(what: str) -> BeforeValidator:
    """One positive number, or one for each joint; `what` it is begins the message of a wrong one."""

    def check(value: object) -> object:
        values = value if isinstance(value, list | tuple) else [value]
        for i, item in enumerate(values):
            if isinstance(item, bool) or not isinstance(item, int | float) or not item > 0:
                raise refusal(
                    f"{what} cannot be used",
                    key=(i,) if isinstance(value, list | tuple) else (),
                    found=shown(item),
                    allowed="one number above 0, or a list of them, one for each joint",
                )
        return as_tuple(value)

    return BeforeValidator(check)


Point = Annotated[tuple[float, float, float], tuple_of(3, "[x, y, z]")]
Positive = Annotated[float, Field(gt=0)]
Name = Annotated[str, BeforeValidator(_name)]
TargetName = Annotated[str, BeforeValidator(_target_name)]
PositiveOrList = Positive | tuple[Positive, ...]
