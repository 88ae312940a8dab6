"""The key `geometry` of a header: how far an arm may deviate from its nominal geometry."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from ..errors import BadInput
from ..robot import Matrix, Robot
from .fields import Point, PositiveOrList, positive_or_list
from .reading import shown
from .validation import FileModel, as_tuple, refusal


def _direction(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) == 3 and not any(value):
        raise refusal(
            "geometry.up has no length",
            found=shown(value),
            allowed="the direction of up in the base frame, such as [0, 0, 1]",
        )
    return value


class StatedLinkTolerance(FileModel):
    """Standard deviations of the link parameters about their nominal values."""

    length_mm: Annotated[PositiveOrList, positive_or_list("a tolerance of the geometry")] = Field(
        default=0.3, description="of each length a, d, millimetres: one number, or one for each link"
    )
    angle_deg: Annotated[PositiveOrList, positive_or_list("a tolerance of the geometry")] = Field(
        default=0.1, description="of each angle alpha, beta, degrees: one number, or one for each link"
    )

    def of_links(self, robot: Robot) -> tuple[Matrix, Matrix]:
        """(n,) of lengths, mm, and (n,) of angles, rad; BadInput for lists of another length."""
        return self._each("length_mm", robot), np.radians(self._each("angle_deg", robot))

    def _each(self, key: str, robot: Robot) -> Matrix:
        values = np.atleast_1d(np.array(getattr(self, key), dtype=float))
        if len(values) not in (1, robot.n) or (len(values) == 1 and isinstance(getattr(self, key), tuple)):
            raise BadInput(
                f"geometry.tolerance.{key} has the wrong number of values",
                found=f"{len(values)} values",
                allowed=f"one number, or {robot.n} numbers ({robot.name} has {robot.n} joints)",
            )
        return np.broadcast_to(values, robot.n).copy()


class StatedGeometry(FileModel):
    """How far the arm may deviate from its nominal geometry; without this key the geometry is nominal."""

    tolerance: StatedLinkTolerance = Field(
        default=StatedLinkTolerance(), description="prior standard deviations of the link parameters"
    )
    scale: Literal["known", "estimated"] = Field(
        default="known",
        description="estimated: the tolerances are right up to one factor for lengths and one for angles",
    )
    gravity: Literal["auto"] | bool = Field(
        default="auto",
        description="deflection of the joints under the weight of the links; auto: if it predicts better",
    )
    harmonics: Literal["auto"] | bool = Field(
        default="auto",
        description="first harmonic of each joint's reading; auto: if it predicts better",
    )
    masses_kg: Annotated[tuple[Annotated[float, Field(ge=0)], ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="mass of each link, at its far end (default: equal masses)"
    )
    up: Annotated[Point, BeforeValidator(_direction)] = Field(
        default=(0.0, 0.0, 1.0), description="direction of up in the base frame, any length"
    )
