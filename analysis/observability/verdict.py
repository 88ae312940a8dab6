"""Why a parameter is not identified: the direction and the cause that its status is owed to."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ...model.likelihood.parameters import Parameter
from ..status import Status
from .causes import Cause, Held, NotResolvable, NotTheModel, NullDirection, ToleranceOnly


def worst_direction(null_space: Sequence[NullDirection], name: str) -> NullDirection:
    """The direction that a weak or unidentifiable parameter owes its status to.

    A parameter is part of the way to another optimum only if it would be determined without that optimum.
    """
    taking_part = [direction for direction in null_space if name in direction.combination]
    taking_part = [direction for direction in taking_part if direction.kind == "optima"] or taking_part
    if not taking_part:
        return NullDirection({name: 1.0}, "noise", NotResolvable())
    return max(taking_part, key=lambda direction: _share(direction, name))


def _share(direction: NullDirection, name: str) -> float:
    """Std that the direction gives to one of its parameters, in prior stds (infinite for a gauge)."""
    if direction.data_std is None:
        return math.inf
    weights = direction.combination
    return abs(weights[name]) * direction.data_std / math.hypot(*weights.values())


def cause_for(null_space: Sequence[NullDirection], item: Parameter, status: Status) -> Cause | None:
    """Why a parameter has no number, or a poor one; None for an identified one."""
    if item.held_by is not None:
        return Held(item.held_by)
    if item.group == "geometry" and status == "unidentifiable":
        return ToleranceOnly()
    if status == "unvalidated":
        return NotTheModel()
    return None if status == "identified" else worst_direction(null_space, item.name).cause
