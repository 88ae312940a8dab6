"""The constraints of a plan: what each of its measurements must keep, as the plan file states it."""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from ..reading import shown
from ..validation import FileModel, NotNegative, Pair, Point, refusal, without_length
from .obstacles import Obstacles

DEFAULT_ACCEPTANCE_DEG = 60.0
BEAM_ONLY = ("facing", "acceptance_deg", "beam_mm")  # of a laser; a probe has no beam


class StatedConstraints(FileModel):
    """The key `constraints` of a plan file; what is not stated is not judged."""

    facing: Point | None = Field(
        default=None, description="outward normal of the face of every target, base frame, any length"
    )
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] | None = Field(
        default=None, description="largest angle between a beam and that normal, degrees (default 60)"
    )
    beam_mm: Pair | None = Field(default=None, description="shortest and longest beam, millimetres")
    margin_deg: NotNegative | None = Field(
        default=None,
        description="distance kept from every joint limit, degrees (17.5 mm for each for a prismatic joint)",
    )
    obstacles: Obstacles | None = Field(
        default=None, description="what the arm and the beam must not hit, as in an obstacles file"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.facing is not None and without_length(self.facing):
            raise refusal(
                "constraints.facing has no length",
                key=("facing",),
                found=shown(self.facing),
                allowed="any vector but zero",
            )
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
