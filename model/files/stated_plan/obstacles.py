"""Obstacles: boxes and floor in a robot's cell, as an obstacles file or a plan file states them."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from ..validation import FileModel, Name, Point, Positive, refusal


class Box(FileModel):
    """A box along the axes of the base frame."""

    name: Name = Field(description="name of the obstacle")
    min_mm: Point = Field(description="its lowest corner, base frame, millimetres")
    max_mm: Point = Field(description="its highest corner, base frame, millimetres")

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
        description="radius of the arm's links, millimetres; default 5 % of the stretched arm's length",
    )
