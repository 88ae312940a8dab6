"""The keys of a robot file, and of a reference to a URDF, that say how an arm is mounted and counted."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Self

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from ..kinematics.robot import Conventions, JointKind
from ..options import J3, PendantUnit
from ..parsing.reading import KeyPath, shown
from ..parsing.validation import FileModel, Name, NumberPair, Positive, as_tuple, refusal

_Integers = Annotated[tuple[int, ...], BeforeValidator(as_tuple)]
_Numbers = Annotated[tuple[float, ...], BeforeValidator(as_tuple)]
_Names = Annotated[tuple[Name, ...], BeforeValidator(as_tuple)]


def _ordered(values: tuple[float, float]) -> tuple[float, float]:
    if not values[0] < values[1]:
        raise refusal("the range is empty", found=shown(list(values)), allowed="[lower, upper], lower first")
    return values


_Range = Annotated[NumberPair, AfterValidator(_ordered)]


class StatedMounting(FileModel):
    """Where the arm's mounting face is."""

    below_base_mm: float = Field(
        description="how far the mounting face is below the origin of the base frame, millimetres"
    )


class StatedBodies(FileModel):
    """How thick the arm is."""

    radius_mm: Positive = Field(
        description="radius of the arm's links about their axes, millimetres: what they touch and which beams"
        " they block; default 5 % of the stretched arm's length"
    )


class StatedPendant(FileModel):
    """How the pendant counts, names and orders the joints."""

    joint3: J3 | None = Field(
        default=None,
        description="what joint 3 is counted from: link (link 2), or ground: the pendant shows the angle"
        " between links 2 and 3 less joint 2 (FANUC)",
    )
    order: _Integers | None = Field(
        default=None,
        description="numbers of the joints, from 1, in the order in which the pendant shows them",
    )
    names: _Names | None = Field(
        default=None, description="what the pendant calls the joints, joint 1 of this file first"
    )
    unit: PendantUnit = Field(default="deg", description="unit of the pendant's values")
    pulses_per_deg: _Numbers | None = Field(
        default=None,
        description="for unit: pulse: by how many pulses the values rise where the joint moves by one"
        " degree (degrees of rotation; millimetres of a prismatic joint), joint 1 first; negative where they"
        " fall",
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if (self.unit == "pulse") != (self.pulses_per_deg is not None):
            raise refusal(
                "pulses_per_deg and unit: pulse belong together",
                key=("unit",),
                found=f"unit: {self.unit}",
                remedy="state both or neither",
            )
        if self.pulses_per_deg is not None and not all(self.pulses_per_deg):
            raise refusal("a joint cannot have 0 pulses for a degree", key=("pulses_per_deg",))
        names = self.names or ()
        for i, name in enumerate(names):
            if name in names[:i]:
                raise refusal("two joints have the same name", key=("names", i), found=shown(name))
        return self


class StatedEncoder(FileModel):
    """What the encoders measure."""

    joint3: J3 = Field(
        description="link: the angle between links 2 and 3 (a motor at the elbow); ground: the direction of"
        " link 3, whatever joint 2 does (a parallelogram)"
    )


class FileLimits(FileModel):
    """Further limits of a robot file's joints, besides those of its rows."""

    joint3_to_link2_deg: _Range | None = Field(
        default=None,
        description="range of the angle between links 2 and 3, degrees, of an arm whose pendant counts joint"
        " 3 from the ground (its rows have the pendant's range)",
    )


class UrdfLimits(FileModel):
    """Further limits of a URDF's joints, besides those in it."""

    joint3_pendant_deg: _Range | None = Field(
        default=None,
        description="range of joint 3 as the pendant counts it, degrees, where that is from the ground (the"
        " URDF has the range of the angle between links 2 and 3)",
    )


def require_fitting(
    pendant: StatedPendant, encoder: StatedEncoder | None, kinds: Sequence[JointKind]
) -> None:
    """A refusal of conventions that an arm with joints of these kinds cannot have."""
    n = len(kinds)
    key: KeyPath
    for key, values in (
        (("pendant", "names"), pendant.names),
        (("pendant", "order"), pendant.order),
        (("pendant", "pulses_per_deg"), pendant.pulses_per_deg),
    ):
        if values is not None and len(values) != n:
            raise refusal(
                f"{key[-1]} has not one value for each joint", key=key, found=len(values), allowed=n
            )
    if pendant.order is not None and sorted(pendant.order) != list(range(1, n + 1)):
        raise refusal(
            "order does not name each joint once",
            key=("pendant", "order"),
            found=shown(list(pendant.order)),
            allowed=f"the numbers 1 to {n}, each once",
        )
    for part, joint3 in (("pendant", pendant.joint3), ("encoder", encoder and encoder.joint3)):
        if joint3 == "ground" and (n < 3 or {"revolute"} != {*kinds[1:3]}):
            raise refusal(
                "joint 3 of this robot is not counted from the ground: joints 2 and 3 are not both revolute",
                key=(part, "joint3"),
                found="ground",
                allowed="link",
            )


def conventions(
    mounting: StatedMounting | None,
    pendant: StatedPendant,
    encoder: StatedEncoder | None,
    range3_deg: tuple[float, float] | None,
    bodies: StatedBodies | None = None,
) -> Conventions:
    """The stated facts in internal units; `range3_deg` is joint 3's range as the pendant counts it."""
    lower, upper = np.radians(range3_deg or (0.0, 0.0)).tolist()
    return Conventions(
        below_base=None if mounting is None else mounting.below_base_mm,
        joint3=pendant.joint3,
        range3=None if range3_deg is None else (lower, upper),
        order=None if pendant.order is None else tuple(number - 1 for number in pendant.order),
        names=pendant.names,
        unit=pendant.unit,
        pulses_per_deg=pendant.pulses_per_deg,
        encoder3=None if encoder is None else encoder.joint3,
        body_radius=None if bodies is None else bodies.radius_mm,
    )
