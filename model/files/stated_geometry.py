"""The key `geometry` of a header: how far an arm may deviate from its nominal geometry."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.robot import Robot
from .reading import Place, shown
from .validation import (
    FileModel,
    NotNegative,
    Point,
    PositiveOrList,
    as_tuple,
    positive_or_list,
    refusal,
)


def _direction(value: object) -> object:
    if isinstance(value, list | tuple) and len(value) == 3 and not any(value):
        raise refusal(
            "geometry.up has no length",
            found=shown(value),
            allowed="the direction of up in the base frame, such as [0, 0, 1]",
        )
    return value


def _switch(value: object) -> object:
    if value != "auto" and not isinstance(value, bool):
        raise refusal(
            "this rung of the geometry is neither asked for nor left out",
            found=shown(value),
            allowed="auto, true or false",
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
        return self.each("length_mm", robot), np.radians(self.each("angle_deg", robot))

    def each(self, key: Literal["length_mm", "angle_deg"], robot: Robot) -> Matrix:
        """(n,) of the lengths, mm, or of the angles, degrees; BadInput for a list of another length."""
        values = np.atleast_1d(np.array(getattr(self, key), dtype=float))
        if len(values) not in (1, robot.n) or (len(values) == 1 and isinstance(getattr(self, key), tuple)):
            raise BadInput(
                f"geometry.tolerance.{key} has the wrong number of values",
                found=f"{len(values)} values",
                allowed=f"one number, or {robot.n} numbers ({robot.name} has {robot.n} joints)",
                remedy="state one number for all links, or one for each",
            )
        return np.broadcast_to(values, robot.n).copy()


Switch = Annotated[Literal["auto"] | bool, BeforeValidator(_switch)]


class StatedGeometry(FileModel):
    """How far the arm may deviate from its nominal geometry; without this key the geometry is nominal."""

    tolerance: StatedLinkTolerance = Field(
        default=StatedLinkTolerance(), description="prior standard deviations of the link parameters"
    )
    scale: Literal["known", "estimated"] = Field(
        default="known",
        description="estimated: the tolerances are right up to one factor for lengths and one for angles",
    )
    gravity: Switch = Field(
        default="auto",
        description="deflection of the joints under the weight of the links; auto: if it predicts better",
    )
    harmonics: Switch = Field(
        default="auto",
        description="first harmonic of each joint's reading; auto: if it predicts better",
    )
    masses_kg: Annotated[tuple[NotNegative, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="mass of each link, at its far end (default: equal masses)"
    )
    up: Annotated[Point, BeforeValidator(_direction)] = Field(
        default=(0.0, 0.0, 1.0), description="direction of up in the base frame, any length"
    )

    def masses(self, robot: Robot) -> Matrix:
        """(n,) kg, 1 of each link where none are stated; BadInput for another number of masses."""
        if self.masses_kg is None:
            return np.ones(robot.n)
        if len(self.masses_kg) != robot.n:
            raise BadInput(
                "geometry.masses_kg has the wrong number of values",
                found=f"{len(self.masses_kg)} values",
                allowed=f"{robot.n} numbers: {robot.name} has {robot.n} joints",
                remedy="state one mass for each link, the last with the tool, or none",
            )
        return np.array(self.masses_kg, dtype=float)

    def require_revolute(self, robot: Robot) -> None:
        """BadInput where harmonics are asked for and a joint is prismatic."""
        if self.harmonics is True and any(joint.kind == "prismatic" for joint in robot.joints):
            raise BadInput(
                "geometry.harmonics is asked for, but harmonics are of revolute joints",
                found=f"harmonics: true, and {robot.name} has a prismatic joint",
                allowed="false; or auto, which takes the revolute joints alone",
                remedy="state harmonics: auto",
            )

    def checks(self, robot: Robot) -> Iterator[tuple[Place, Callable[[], object]]]:
        """What must suit the robot: the place below `geometry`, and what raises BadInput if it does not."""
        yield ("tolerance", "length_mm"), lambda: self.tolerance.each("length_mm", robot)
        yield ("tolerance", "angle_deg"), lambda: self.tolerance.each("angle_deg", robot)
        yield ("masses_kg",), lambda: self.masses(robot)
        yield ("harmonics",), lambda: self.require_revolute(robot)
