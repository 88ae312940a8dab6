"""The settings of one case of a study: header, position of the target, how the plan is made."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BeforeValidator, Field, model_validator

from ....analysis.design.continuous_design import Criterion
from ....model.files.header import (
    Header,
    RobotRef,
    StatedGeometry,
    StatedNoise,
    StatedPrior,
    StatedTarget,
    StatedTolerance,
    StatedTool,
)
from ....model.files.reading import shown
from ....model.files.validation import (
    FileModel,
    Name,
    NotNegative,
    Positive,
    Vector,
    refusal,
    without_length,
)

TARGET = "psd"
_MOST_RUNS = 100_000

Cost = Literal["likelihood", "midpoint"]


def as_tuple(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


def _costs(value: object) -> object:
    if isinstance(value, list | tuple) and "likelihood" not in value:
        raise refusal(
            "the likelihood fit is missing",
            found=shown(list(value)),
            allowed="[likelihood] or [likelihood, midpoint]",
            remedy="add likelihood: the predictions are of its scatter",
        )
    return as_tuple(value)


def _pair(value: object) -> object:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise refusal("a list of 2 numbers is wanted", found=shown(value), allowed="[shortest, longest]")
    return tuple(value)


class PlacedTarget(FileModel):
    """The target of all measurements."""

    xyz_mm: Vector = Field(description="nominal position, base frame, millimetres")
    sigma_mm: Positive = Field(
        default=30.0,
        description="prior standard deviation in each direction, millimetres; true positions are random",
    )


class PlanMaking(FileModel):
    """How the plan of a case is made."""

    kind: Literal["x", "y", "optimal"] = Field(
        default="optimal", description="the paper's X- or Y-Pattern, or the best of many candidates"
    )
    shots: Annotated[int, Field(ge=1, le=10_000)] = Field(default=7, description="number of measurements")
    span: Positive | None = Field(
        default=None,
        description="length of a pattern's line as a share of the arm's reach; default: the pattern's own",
    )
    candidates: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=1000, description="postures that an optimal plan is chosen from"
    )
    criterion: Criterion = Field(default="A", description="what an optimal plan minimises")
    facing: Vector | None = Field(
        default=(0.0, 0.0, 1.0),
        description="outward normal of the target's face, base frame, any length; null: any side",
    )
    acceptance_deg: Annotated[float, Field(gt=0, le=90)] = Field(
        default=60.0, description="largest angle between beam and that normal, degrees"
    )
    beam_mm: Annotated[tuple[float, float], BeforeValidator(_pair)] = Field(
        default=(200.0, 2000.0), description="shortest and longest beam, millimetres"
    )
    margin_deg: NotNegative = Field(default=5.0, description="kept to every joint limit, degrees")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if not 0 <= self.beam_mm[0] < self.beam_mm[1]:
            raise refusal(
                "no beam is within the stated lengths",
                key=("beam_mm",),
                found=shown(list(self.beam_mm)),
                allowed="a shortest beam of 0 or more and below the longest",
            )
        if self.facing is not None and without_length(self.facing):
            raise refusal(
                "the target's face has no direction",
                key=("facing",),
                found=shown(list(self.facing)),
                allowed="any vector but zero, or null",
            )
        return self


class Settings(FileModel):
    """Everything that a case depends on, except the seed."""

    robot: RobotRef = Field(
        description="a built-in name, the path of a robot file (.yaml), or a chain of a URDF file"
    )
    tool: StatedTool = Field(description="what the flange carries, as in a header")
    noise: StatedNoise = Field(description="standard deviations of the readings, as in a header")
    prior: StatedPrior = Field(
        default=StatedPrior(),
        description="of the offsets, as in a header; true offsets are random draws from it",
    )
    held: Annotated[tuple[Name, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None, description="names of the parameters that are not estimated, as in a header"
    )
    tolerance: StatedTolerance = Field(
        default=StatedTolerance(),
        description="largest standard uncertainty that counts as identified, as in a header",
    )
    geometry: StatedGeometry | None = Field(
        default=None,
        description="how far arms deviate from nominal geometry, as in a header; true links are random draws"
        " from it. Absent: the arm has its nominal geometry",
    )
    target: PlacedTarget = Field(description="position of the target")
    plan: PlanMaking = Field(default=PlanMaking(), description="how the plan is made")
    runs: Annotated[int, Field(ge=0, le=_MOST_RUNS)] = Field(
        default=200, description="simulated runs of each case; 0: prediction only"
    )
    costs: Annotated[tuple[Cost, ...], BeforeValidator(_costs)] = Field(
        default=("likelihood",), description="fits of each run; midpoint is the paper's (eq. 8)"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.noise.scale != "known":
            raise refusal(
                "the noise of a study is known: the runs are simulated with it",
                key=("noise", "scale"),
                found=f"scale: {self.noise.scale}",
                remedy="remove scale",
            )
        if self.geometry is not None and self.geometry.scale != "known":
            raise refusal(
                "the tolerances of a study are known: its arms are random draws from them",
                key=("geometry", "scale"),
                found=f"scale: {self.geometry.scale}",
                remedy="remove scale",
            )
        return self

    def stated(self, **which: Any) -> dict[str, Any]:
        """The settings as in a file, without a geometry that is not stated; `which` as of `model_dump`."""
        values = self.model_dump(mode="json", by_alias=True, **which)
        return {key: value for key, value in values.items() if key != "geometry" or value is not None}

    def header(self) -> Header:
        """The header that a plan of these settings would have."""
        target = StatedTarget(guess_mm=self.target.xyz_mm, sigma_mm=self.target.sigma_mm)
        return Header(
            robot=self.robot,
            tool=self.tool,
            noise=self.noise,
            prior=self.prior,
            held=self.held,
            tolerance=self.tolerance,
            geometry=self.geometry,
            targets={TARGET: target},
        )


@cache
def setting_names() -> tuple[str, ...]:
    """Dotted names of all settings."""
    return tuple(_names(Settings, ""))


def _names(model: type[FileModel], prefix: str) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"{prefix}{name}"
        for inner in (field.annotation, *get_args(field.annotation)):  # what may be left out as well
            if isinstance(inner, type) and issubclass(inner, FileModel):
                yield from _names(inner, f"{prefix}{name}.")


def overlap(one: str, other: str) -> bool:
    """Whether two dotted names are the same setting, or one is a part of the other."""
    return one == other or one.startswith(f"{other}.") or other.startswith(f"{one}.")
