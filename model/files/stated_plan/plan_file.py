"""The content of a plan file: the header's keys, the constraints and the postures."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from ..header import Header
from ..shot import JointValues
from ..validation import FileModel, TargetName, as_tuple, refusal
from .constraints import BEAM_ONLY, UNCONSTRAINED, StatedConstraints


class StatedPosture(FileModel):
    """One posture with the target that it is meant for."""

    joints_deg: JointValues = Field(
        description="joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    target: TargetName = Field(description="name of the target to hit")
    via_deg: Annotated[tuple[JointValues, ...], BeforeValidator(as_tuple)] = Field(
        default=(),
        description="safe intermediate postures on the way from the posture before, in order, degrees",
    )


def _posture_tag(value: object) -> str:
    return "<row>" if isinstance(value, dict | StatedPosture) else "<list>"


Posture = Annotated[
    Annotated[JointValues, Tag("<list>")] | Annotated[StatedPosture, Tag("<row>")],
    Discriminator(_posture_tag),
]


class PlanFile(Header):
    """The content of a plan file: the header's keys, the constraints and the postures."""

    schema_: Literal["zerobeam/plan/1"] = Field(alias="schema", description="kind and version of the file")
    constraints: StatedConstraints = Field(
        default=UNCONSTRAINED, description="what every measurement must keep: `check` judges it"
    )
    postures_deg: Annotated[tuple[Posture, ...], BeforeValidator(as_tuple), Field(min_length=1)] = Field(
        description="one row a measurement: its joints, degrees (millimetres for a prismatic joint), "
        "or {joints_deg, target, via_deg}"
    )

    @model_validator(mode="after")
    def _suit_the_tool(self) -> Self:
        stated = [key for key in BEAM_ONLY if getattr(self.constraints, key) is not None]
        if self.tool.kind == "probe" and stated:
            raise refusal(
                f"constraints.{stated[0]} is stated for a probe, which has no beam",
                key=("constraints", stated[0]),
                allowed="margin_deg, obstacles",
                remedy="remove it, or state tool.kind: laser",
            )
        return self
