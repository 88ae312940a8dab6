"""Arguments of the public functions, checked: one BadInput that names the argument."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from numbers import Integral
from typing import Any

import numpy as np

from ..model.errors import BadInput
from ..model.files.plan import Plan


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


def require_plan(plan: object) -> None:
    """BadInput where `plan` is none; of an `OptimalPlan` it is an attribute."""
    has_one = isinstance(getattr(plan, "plan", None), Plan)
    remedy = "its attribute `plan` is one" if has_one else "read a file with zerobeam.read_plan(path)"
    require_kind(plan, Plan, "plan", remedy)


def require_progress(value: object) -> None:
    """BadInput where `value` cannot take progress."""
    if not (value is None or isinstance(value, bool) or callable(value)):
        allowed = "True, False, None or a function of a stage and its share"
        raise BadInput("this cannot be used", found=repr(value), allowed=allowed, argument="progress")


def require_mapping(value: object, argument: str, example: str) -> None:
    """BadInput where `value` is no mapping from names."""
    if not isinstance(value, Mapping):
        raise BadInput(
            "this is not a mapping from names", found=repr(value), allowed=example, argument=argument
        )


def require_axes(ax: object) -> None:
    """BadInput where `ax` is no axes of matplotlib."""
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise BadInput(
            "these are not axes of matplotlib",
            found=type(ax).__name__,
            allowed="matplotlib.axes.Axes, such as pyplot.subplots() gives",
            remedy="leave ax out to get a figure",
            argument="ax",
        )


def whole_numbers(value: object, argument: str) -> tuple[int, ...]:
    """`value` as whole numbers: of a list, an array or an index of pandas, and no mask; BadInput names the
    argument."""
    items: list[Any] = [None]
    if isinstance(value, Iterable) and not isinstance(value, str):
        items = list(value)
    if not all(isinstance(item, Integral) and not isinstance(item, bool) for item in items):
        mask = bool(items) and all(isinstance(item, bool | np.bool_) for item in items)
        raise BadInput(
            "these are not numbers of measurements",
            found=repr(value),
            allowed="a list of whole numbers, such as [3, 5]",
            remedy="with a mask: solution.data.index[mask]" if mask else None,
            argument=argument,
        )
    return tuple(map(int, items))


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
