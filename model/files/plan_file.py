"""The content of a plan file: the header's keys, the constraints and the postures."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..instruments.registry import names_of
from ..parsing.reading import shown
from ..parsing.validation import (
    MOST,
    FileModel,
    Name,
    NotNegative,
    NumberPair,
    Positive,
    TargetName,
    Vector,
    as_tuple,
    refusal,
    with_length,
)
from .header import Header
from .limits import JointValues


class Box(FileModel):
    """A box along the axes of the base frame."""

    name: Name = Field(description="name of the obstacle")
    min_mm: Vector = Field(description="its lowest corner, base frame, millimetres")
    max_mm: Vector = Field(description="its highest corner, base frame, millimetres")

    @model_validator(mode="after")
    def _ordered(self) -> Box:
        if any(low >= high for low, high in zip(self.min_mm, self.max_mm, strict=True)):
            raise refusal(
                f"the box {self.name!r} is empty",
                key=("max_mm",),
                found=f"min_mm {list(self.min_mm)}, max_mm {list(self.max_mm)}",
                allowed="each of max_mm above that of min_mm",
            )
        return self


class Obstacles(FileModel):
    """The content of an obstacles file: boxes and floor in the cell, and the thickness of the arm."""

    floor_mm: float | Literal["mounting"] | None = Field(
        default="mounting",
        description="height of the floor, base frame, millimetres; mounting: the robot's mounting face, as"
        " its robot file states it; null: none",
    )
    boxes: list[Box] = Field(default=[], description="boxes in the cell")
    thickness_mm: Positive | None = Field(
        default=None,
        description="radius of the arm's links, millimetres; default that of the robot file, else 5 % of the"
        " stretched arm's length",
    )


DEFAULT_ACCEPTANCE_DEG = 60.0
BEAM_ONLY = ("facing", "acceptance_deg", "beam_mm")  # of a laser; a probe has no beam


class StatedConstraints(FileModel):
    """The key `constraints` of a plan file; what is not stated is not judged."""

    facing: Annotated[Vector, with_length("constraints.facing")] | None = Field(
        default=None,
        description="outward normal of the face of every target, base frame, any length; not for a probe",
    )
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] | None = Field(
        default=None, description="largest angle between a beam and that normal, degrees (default 60)"
    )
    beam_mm: NumberPair | None = Field(default=None, description="shortest and longest beam, millimetres")
    margin_deg: NotNegative | None = Field(
        default=None,
        description="distance kept from every joint limit, degrees (17.5 mm for each for a prismatic joint)",
    )
    obstacles: Obstacles | None = Field(
        default=None, description="what the arm and the beam must not hit, as in an obstacles file"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.facing is None and self.acceptance_deg is not None:
            raise refusal(
                "constraints.acceptance_deg is stated without the direction that it is measured from",
                key=("acceptance_deg",),
                found=f"acceptance_deg: {self.acceptance_deg:g}",
                remedy="add facing, the outward normal of the target's face, or remove acceptance_deg",
            )
        if self.beam_mm is not None and not 0 <= self.beam_mm[0] < self.beam_mm[1]:
            raise refusal(
                "constraints.beam_mm: the lengths are out of order",
                key=("beam_mm",),
                found=shown(self.beam_mm),
                allowed="[shortest, longest], 0 <= shortest < longest",
            )
        return self

    @property
    def acceptance(self) -> float:
        """The largest angle between a beam and the normal, degrees, where a normal is stated."""
        return DEFAULT_ACCEPTANCE_DEG if self.acceptance_deg is None else self.acceptance_deg


UNCONSTRAINED = StatedConstraints()
# Of an optimal plan where nothing else is stated: a detector that faces up, beams that can be seen.
USUAL = StatedConstraints(
    facing=(0.0, 0.0, 1.0),
    acceptance_deg=DEFAULT_ACCEPTANCE_DEG,
    beam_mm=(200.0, 2000.0),
    margin_deg=5.0,
)


class StatedPosture(FileModel):
    """One posture with the target that it is meant for."""

    joints_deg: JointValues = Field(
        description="joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    target: TargetName | None = Field(
        default=None, description="name of the target; required unless the instrument has none"
    )
    instrument: Name | None = Field(
        default=None, description="name of the instrument; required where the header states several"
    )
    reflector: Name | None = Field(
        default=None, description="name of the reflector; required where the header states several"
    )
    posture: Annotated[int, Field(ge=0, le=MOST)] | None = Field(
        default=None,
        description="number of the posture, of rows that are measured in the same one, one after another",
    )
    again: Annotated[int, Field(ge=0, le=MOST)] | None = Field(
        default=None,
        description="the row, counted from 0, whose posture is measured here once more, with the same joints,"
        " target and instrument",
    )
    via_deg: Annotated[tuple[JointValues, ...], BeforeValidator(as_tuple)] = Field(
        default=(),
        description="safe intermediate postures on the way from the posture before, in order, degrees",
    )


def _posture_tag(value: object) -> str:
    return "<row>" if isinstance(value, dict | StatedPosture) else "<list>"


PostureRow = Annotated[
    Annotated[JointValues, Tag("<list>")] | Annotated[StatedPosture, Tag("<row>")],
    Discriminator(_posture_tag),
]


class PlanFile(Header):
    """The content of a plan file: the header's keys, the constraints and the postures."""

    schema_: Literal["zerobeam/plan/1"] = Field(alias="schema", description="kind and version of the file")
    constraints: StatedConstraints = Field(
        default=UNCONSTRAINED, description="what every measurement must keep: `check` judges it"
    )
    postures_deg: Annotated[tuple[PostureRow, ...], BeforeValidator(as_tuple), Field(min_length=1)] = Field(
        description="one row a measurement: its joints, degrees (millimetres for a prismatic joint), "
        "or {joints_deg, target, via_deg, …}"
    )

    @model_validator(mode="after")
    def _suit_the_tool(self) -> Self:
        beam_keys = [key for key in BEAM_ONLY if getattr(self.constraints, key) is not None]
        kinds = self.kinds.values()
        if beam_keys and not any(kind.beam for kind in kinds):
            names = " and a ".join(kind.name for kind in kinds)
            raise refusal(
                f"constraints.{beam_keys[0]} is stated for a {names}, which has no beam",
                key=("constraints", beam_keys[0]),
                allowed="margin_deg, obstacles",
                remedy=f"remove it, or state tool.kind: {' or '.join(names_of(beam=True))}",
            )
        return self
