"""Arguments of the public functions, checked: one BadInput that names the argument."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from numbers import Integral, Real

import numpy as np

from ..model.errors import BadInput


def require_kind(value: object, kind: type, argument: str, remedy: str) -> None:
    """BadInput where `value` is not of `kind`."""
    if not isinstance(value, kind):
        allowed = f"zerobeam.{kind.__name__}"
        raise BadInput(
            "this cannot be used",
            found=type(value).__name__,
            allowed=allowed,
            remedy=remedy,
            argument=argument,
        )


def require_number(value: object, least: float, argument: str, *, whole: bool = False) -> None:
    """BadInput where `value` is no number from `least` up."""
    kind = Integral if whole else Real
    if (
        isinstance(value, bool)
        or not isinstance(value, kind)
        or not math.isfinite(float(value))
        or float(value) < least
    ):
        allowed = f"a {'whole' if whole else 'finite'} number"
        allowed += "" if math.isinf(least) else f", {least:g} or more"
        raise BadInput("this cannot be used", found=repr(value), allowed=allowed, argument=argument)


def require_choice(value: object, allowed: Collection[str | None], argument: str) -> None:
    """BadInput where `value` is none of those `allowed`."""
    if value not in allowed:
        listed = ", ".join(map(repr, allowed))
        raise BadInput("there is no such choice", found=repr(value), allowed=listed, argument=argument)


def vector(value: Sequence[float], size: int, argument: str) -> tuple[float, ...]:
    """`value` as `size` finite numbers; BadInput names the argument."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (size,) or not np.isfinite(numbers).all():
        raise BadInput(
            "this cannot be used", found=repr(value), allowed=f"{size} finite numbers", argument=argument
        )
    return tuple(numbers.tolist())
