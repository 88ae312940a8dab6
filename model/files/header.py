"""The header that run and plan files share: which robot and tool, how noisy, the priors.

Units are in the names of the keys (degrees and millimetres: this is what people write). The keys
are those of `docs/files.md`; what is not among them is an error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Self, Union

import numpy as np
from pydantic import (
    AliasChoices,
    BeforeValidator,
    Discriminator,
    Field,
    PlainValidator,
    SerializeAsAny,
    Tag,
    model_validator,
)

from ..arrays import Matrix
from ..errors import BadInput
from ..instruments.flange_tool import FlangeTool, flange_tool_kind
from ..instruments.kind import POINT, TARGET_KEYS, Instrument, StatedInstrument, Station, TargetKind
from ..instruments.registry import STATIONS, TOOLS, kind_names, kind_of, names_of
from ..kinematics.robot import Robot
from ..parsing.reading import KeyPath, did_you_mean, shown
from ..parsing.validation import (
    FileModel,
    Name,
    NotNegative,
    Positive,
    PositiveOrList,
    TargetName,
    Vector,
    as_tuple,
    positive_or_list,
    refusal,
    tuple_of,
    validate,
    with_length,
)
from .conventions import StatedBodies, StatedEncoder, StatedMounting, StatedPendant, UrdfLimits
from .stated_workspace import CENTRAL_RANGES, StatedWorkspace
from .whole_file import schema_line, short_in_one_line, write_whole, yaml_text


def _up(value: object) -> object:
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


GeometryKind = Literal["length", "angle", "gravity", "harmonics"]
# Of each kind of geometry parameters the key, below `geometry`, that states their tolerance.
TOLERANCE_KEYS: dict[GeometryKind, str] = {
    "length": "tolerance.length_mm",
    "angle": "tolerance.angle_deg",
    "gravity": "gravity_deg",
    "harmonics": "harmonics_deg",
}


class StatedLinkTolerance(FileModel):
    """Standard deviations of the link parameters about their nominal values."""

    length_mm: Annotated[PositiveOrList, positive_or_list("a tolerance of the geometry")] = Field(
        default=0.3, description="of each length a, b, d, millimetres: one number, or one for each link"
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
    """How far the arm may deviate from its nominal geometry; the default is a typical arm."""

    tolerance: StatedLinkTolerance = Field(
        default=StatedLinkTolerance(), description="prior standard deviations of the link parameters"
    )
    scale: Literal["known", "estimated"] = Field(
        default="known",
        description="estimated: the tolerances are right up to factors of lengths, angles, gravity and"
        " harmonics, which the data give",
    )
    gravity: Switch = Field(
        default="auto",
        description="deflection of joints under the weight of the links; true: refuse too few measurements",
    )
    harmonics: Switch = Field(
        default="auto",
        description="first harmonic of each joint's reading; true: refuse too few measurements",
    )
    gravity_deg: Positive = Field(
        default=0.05,
        description="prior standard deviation of a joint's deflection where the torque is largest, degrees",
    )
    harmonics_deg: Positive = Field(
        default=0.02, description="prior standard deviation of each harmonic, cosine and sine, degrees"
    )
    masses_kg: Annotated[tuple[NotNegative, ...], BeforeValidator(as_tuple)] | None = Field(
        default=None,
        description="mass of each link, at its far end; only ratios count (default: equal masses)",
    )
    up: Annotated[Vector, BeforeValidator(_up)] = Field(
        default=(0.0, 0.0, 1.0),
        description="direction of up in the base frame, any length: [0, 0, -1] for an arm that hangs",
    )
    tolerances: Name | None = Field(
        default=None,
        description="path of a file of tolerances (ZEROBEAM_TOLERANCES), for what is not stated here",
    )

    @property
    def declared_kinds(self) -> frozenset[GeometryKind]:
        """The kinds of parameters whose tolerance is stated, and not assumed to be that of a typical arm."""
        keys = self.model_fields_set | {f"tolerance.{key}" for key in self.tolerance.model_fields_set}
        return frozenset(kind for kind, key in TOLERANCE_KEYS.items() if key in keys)

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

    def checks(self, robot: Robot) -> Iterator[tuple[KeyPath, Callable[[], object]]]:
        """What must suit the robot: the place below `geometry`, and what raises BadInput if it does not."""
        yield ("tolerance", "length_mm"), lambda: self.tolerance.each("length_mm", robot)
        yield ("tolerance", "angle_deg"), lambda: self.tolerance.each("angle_deg", robot)
        yield ("masses_kg",), lambda: self.masses(robot)
        yield ("harmonics",), lambda: self.require_revolute(robot)


EXACT: Literal["exact"] = "exact"  # nominal geometry is the arm's: the paper's assumption


def _geometry(value: object) -> object:
    if value is not None and value != EXACT and not isinstance(value, dict | StatedGeometry):
        raise refusal(
            "this says nothing of the arm's geometry",
            found=shown(value),
            allowed="exact, or keys such as tolerance, gravity, harmonics",
        )
    return value


def _geometry_tag(value: object) -> str:
    return "<exact>" if value == EXACT else "<stated>"


GeometryOfArm = Annotated[
    Annotated[
        Annotated[Literal["exact"], Tag("<exact>")] | Annotated[StatedGeometry, Tag("<stated>")],
        Discriminator(_geometry_tag),
    ]
    | None,
    BeforeValidator(_geometry),
]

RUN_SCHEMA: Literal["zerobeam/run/1"] = "zerobeam/run/1"
PLAN_SCHEMA: Literal["zerobeam/plan/1"] = "zerobeam/plan/1"


def _free_text(value: object) -> object:
    if isinstance(value, dict):
        for key, item in value.items():
            if not isinstance(item, str | int | float):
                raise refusal(
                    f"provenance.{key} is neither text, a number nor true or false",
                    key=(key,),
                    found=shown(item),
                    allowed="one value for each key",
                    remedy="write it as one text",
                )
    return value


def _unique(value: object) -> object:
    if isinstance(value, list | tuple):
        for i, item in enumerate(value):
            if item in value[:i]:
                raise refusal("duplicate name", key=(i,), found=shown(item), allowed="each name once")
    return as_tuple(value)


class UrdfRef(FileModel):
    """A chain of a URDF file."""

    urdf: Name = Field(description="path of the URDF file, relative to the file that names it")
    base: Name = Field(description="name of the link that is the base frame")
    tip: Name = Field(description="name of the link that is the flange frame")
    mounting: StatedMounting | None = Field(default=None, description="where the arm's mounting face is")
    bodies: StatedBodies | None = Field(default=None, description="how thick the arm's links are")
    pendant: StatedPendant = Field(default=StatedPendant(), description="how the pendant counts the joints")
    encoder: StatedEncoder | None = Field(default=None, description="what the encoders measure")
    limits: UrdfLimits = Field(default=UrdfLimits(), description="limits that the URDF does not hold")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.limits.joint3_pendant_deg is not None and self.pendant.joint3 != "ground":
            raise refusal(
                "joint3_pendant_deg is for a pendant that counts joint 3 from the ground",
                key=("limits", "joint3_pendant_deg"),
                remedy="state pendant: {joint3: ground}, or leave it out",
            )
        return self


def _robot_tag(value: object) -> str | None:
    # The tags must not look like keys of the file: they turn up in pydantic's error locations.
    if isinstance(value, str):
        return "<name>"
    return "<urdf>" if isinstance(value, dict | UrdfRef) else None


RobotRef = Annotated[
    Annotated[Name, Tag("<name>")] | Annotated[UrdfRef, Tag("<urdf>")],
    Discriminator(
        _robot_tag,
        custom_error_type="robot_kind",
        custom_error_message="neither a name or path nor {urdf, base, tip}",
    ),
]


class StatedSigma(FileModel):
    """How far the tool may be from what is stated: prior standard deviations."""

    tilt_deg: Positive = Field(
        default=0.05,
        description="of each tilt of the beam, degrees (default 0.05; 3 if it is not calibrated)",
    )
    shift_mm: Positive = Field(
        default=0.1,
        validation_alias=AliasChoices("shift_mm", "mm"),
        description="of each shift, millimetres (default 0.1; not calibrated: 10 of a laser, 50 of a probe)",
    )


if TYPE_CHECKING:
    ToolKind = str
else:
    ToolKind = Literal[tuple(TOOLS)]


class StatedTool(FileModel):
    """What the flange carries."""

    kind: ToolKind = Field(description="; ".join(f"{name}: {kind.words.is_}" for name, kind in TOOLS.items()))
    calibrated: bool = Field(default=True, description="false: the tool is estimated along with the offsets")
    point_mm: Vector = Field(
        description="a point on the beam, or the tip of the probe, in the flange frame, millimetres"
    )
    direction: Annotated[Vector, with_length("tool.direction")] | None = Field(
        default=None,
        description="direction of the beam in the flange frame, any length; required for a laser",
    )
    sigma: StatedSigma = Field(
        default=StatedSigma(),
        description="how far the tool may be from what is stated of it",
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        stated_sigma, beam = "sigma" in self.model_fields_set, TOOLS[self.kind].beam
        if beam and self.direction is None:
            raise refusal(
                "tool.direction is missing",
                found=f"a {self.kind} without the direction of its beam",
                remedy="add the beam's direction in the flange frame, such as [1, 0, 0]",
            )
        if not beam and self.direction is not None:
            raise refusal(
                f"tool.direction is stated for a {self.kind}, which has none",
                key=("direction",),
                found=f"direction: {shown(self.direction)}",
                remedy=f"remove it, or state kind: {' or '.join(names_of(beam=True))}",
            )
        if not beam and stated_sigma and "tilt_deg" in self.sigma.model_fields_set:
            raise refusal(
                f"tool.sigma.tilt_deg is stated for a {self.kind}, which has no direction",
                key=("sigma", "tilt_deg"),
                allowed="shift_mm",
                remedy="remove it",
            )
        if not self.calibrated:
            # The default depends on the kind. It does not count as stated, so that it is not written out with
            # the header.
            fields = self.sigma.model_fields_set if stated_sigma else set()
            tilt_deg, shift_mm = TOOLS[self.kind].free_sigma
            sigma = StatedSigma.model_construct(
                _fields_set=fields,
                tilt_deg=self.sigma.tilt_deg if "tilt_deg" in fields else tilt_deg,
                shift_mm=self.sigma.shift_mm if "shift_mm" in fields else shift_mm,
            )
            object.__setattr__(self, "sigma", sigma)
        return self


def _model_of(name: str) -> type[FileModel]:
    """The model of an entry of `instruments` by its kind."""
    kind = kind_of(name)
    return kind.Stated if issubclass(kind, Station) else StatedTool


def _instrument(value: object) -> FileModel:
    """An entry of `instruments`, by the model of its kind."""
    if isinstance(value, FileModel):
        return value
    if not isinstance(value, Mapping):
        raise refusal("an instrument has keys of its own", found=shown(value), allowed="{kind: …, …}")
    names = kind_names()
    name = value.get("kind")
    if name is None:
        raise refusal(
            "the kind of an instrument is missing",
            found=", ".join(value) if value else "no keys at all",
            allowed=f"kind: {', '.join(names)}",
            remedy="add 'kind'",
        )
    if name not in names:
        raise refusal(
            "there is no such kind of instrument",
            key=("kind",),
            found=shown(name),
            allowed=", ".join(names),
            remedy=did_you_mean(name, names) if isinstance(name, str) else None,
        )
    culprit: KeyPath = ("kind",)

    def no_line(key: KeyPath) -> None:
        nonlocal culprit
        culprit = key

    try:
        return validate(_model_of(name), value, file=None, line=no_line)
    except BadInput as error:
        raise refusal(
            error.what, key=culprit, found=error.found, allowed=error.allowed, remedy=error.remedy
        ) from None


if TYPE_CHECKING:
    InstrumentEntry = StatedInstrument
else:
    InstrumentEntry = Annotated[
        SerializeAsAny[FileModel],
        PlainValidator(
            _instrument,
            json_schema_input_type=Union[(StatedTool, *(kind.Stated for kind in STATIONS.values()))],
        ),
    ]

# Names of factors of noise and of what `tool` states: parameters begin with the names of instruments.
_TAKEN = ("tool", "joint", "spot")


def _instruments(value: object) -> object:
    for name in value if isinstance(value, dict) else ():
        if name in _TAKEN:
            raise refusal(
                f"an instrument cannot be called {name!r}", key=(name,), remedy="give it another name"
            )
    if value == {}:
        raise refusal(
            "no instrument is stated",
            found="{}",
            allowed="{NAME: {kind: …, …}}",
            remedy="state one, or leave out the key",
        )
    return value


class StatedNoise(FileModel):
    """Standard deviations of the readings."""

    joint_deg: Annotated[PositiveOrList, positive_or_list("the standard deviation of a joint reading")] = (
        Field(
            description="of a joint reading: one number for all revolute joints, degrees, or one for each "
            "joint, degrees (millimetres for a prismatic one)"
        )
    )
    joint_mm: Positive | None = Field(
        default=None,
        description="of a prismatic joint's reading, millimetres; required if there is one and joint_deg is"
        " one number",
    )
    spot_mm: NotNegative = Field(
        default=0.0,
        description="of a spot reading, or of the ball in its socket, in each direction, millimetres;"
        " may be 0; required for a laser or a probe",
    )
    scale: Literal["known", "estimated", "separate"] = Field(
        default="known",
        description="estimated: the figures are right up to one common factor, and one for the rotations of "
        "a pose camera; separate: up to one factor for the joints and one for the spot, of a pose camera one "
        "for positions and one for rotations",
    )
    plausible_factor: Annotated[float, Field(gt=1)] = Field(
        default=3.0,
        description="an estimated factor on the stated noise that is above this, or below 1 over it, is a"
        " misfit and not noise",
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if isinstance(self.joint_deg, tuple) and self.joint_mm is not None:
            raise refusal(
                "noise.joint_mm is stated together with a list for every joint",
                key=("joint_mm",),
                found=f"joint_mm: {self.joint_mm:g}",
                remedy="remove it: the list holds the prismatic joints too, in mm",
            )
        if self.scale == "separate" and self.spot_mm == 0 and "spot_mm" in self.model_fields_set:
            raise refusal(
                "there is no spot noise of which a factor could be estimated",
                key=("spot_mm",),
                found="spot_mm: 0 with scale: separate",
                allowed="a spot noise above 0",
                remedy="state spot_mm as well as you know it, or scale: estimated",
            )
        return self

    def of_joints(self, robot: Robot) -> Matrix:
        """(n,) of the joint readings, rad or mm; BadInput if what is stated does not suit the robot."""
        if isinstance(self.joint_deg, tuple):
            joint = np.array(self.joint_deg, dtype=float)
            if joint.shape != (robot.n,):
                raise BadInput(
                    "noise.joint_deg has the wrong number of values",
                    found=f"{joint.size} values",
                    allowed=f"one number, or {robot.n} numbers ({robot.name} has {robot.n} joints)",
                )
        else:
            if self.joint_mm is None and any(j.kind == "prismatic" for j in robot.joints):
                raise BadInput(
                    "noise.joint_mm is missing",
                    found=f"{robot.name} has prismatic joints, whose noise is in mm",
                    remedy="add noise.joint_mm, the standard deviation of one reading in mm",
                )
            joint = np.array(
                [self.joint_deg if j.kind == "revolute" else self.joint_mm for j in robot.joints],
                dtype=float,
            )
        return np.asarray(joint / robot.display)


class StatedPrior(FileModel):
    """What is known of an offset before the shots: normal about zero."""

    offset_deg: Positive = Field(default=5.0, description="standard deviation for a revolute joint, degrees")
    offset_mm: Positive = Field(
        default=5.0, description="standard deviation for a prismatic joint, millimetres"
    )


class StatedTarget(FileModel):
    """What is known of a target before the shots."""

    kind: TargetKind = Field(
        default=POINT, description="what is measured of it: a point, a flat face, or a ball that is touched"
    )
    guess_mm: Vector | None = Field(default=None, description="approximate position, base frame, millimetres")
    sigma_mm: Positive = Field(
        default=10_000.0, description="standard deviation of that, each direction, millimetres"
    )
    normal: Annotated[Vector, with_length("the normal of the plane")] | None = Field(
        default=None,
        description="approximate outward normal of a plane, base frame, any length; required for one",
    )
    sigma_deg: Positive = Field(
        default=30.0, description="standard deviation of a plane's tilt, each direction, degrees"
    )
    radius_mm: Positive = Field(
        default=50.0,
        description="of a plane: how far from guess_mm a plan touches it, millimetres: the size of the face",
    )
    diameter_mm: Positive | None = Field(
        default=None, description="diameter of a sphere, millimetres; required for one"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        needs = TARGET_KEYS[self.kind]
        for key in sorted({key for keys in TARGET_KEYS.values() for key in keys}):
            with_key = [kind for kind, keys in TARGET_KEYS.items() if key in keys]
            if key in self.model_fields_set and key not in needs:
                raise refusal(
                    f"{key} is stated for a target that is a {self.kind}",
                    key=(key,),
                    found=f"{key}: {shown(getattr(self, key))}",
                    remedy=f"remove it, or state kind: {' or '.join(with_key)}",
                )
            if key in needs and needs[key] and getattr(self, key) is None:
                raise refusal(
                    f"the target is a {self.kind} without its {needs[key]}",
                    found=f"kind: {self.kind}",
                    remedy=f"add {key}",
                )
        return self


class StatedDistance(FileModel):
    """A measured distance between two targets."""

    between: Annotated[tuple[TargetName, TargetName], tuple_of(2, "[one target, another target]")] = Field(
        description="names of the two targets"
    )
    mm: Positive = Field(description="the distance, millimetres")
    sigma_mm: Positive = Field(description="its standard deviation, millimetres")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.between[0] == self.between[1]:
            raise refusal(
                "a distance is between a target and itself",
                key=("between",),
                found=shown(self.between),
                allowed="two targets",
            )
        return self


class StatedAngle(FileModel):
    """A known angle between two planes: of a datum cube."""

    between: Annotated[tuple[TargetName, TargetName], tuple_of(2, "[one plane, another plane]")] = Field(
        description="names of the two planes"
    )
    deg: Annotated[float, Field(gt=0, lt=180)] = Field(
        description="the angle between their outward normals, degrees"
    )
    sigma_deg: Positive = Field(description="its standard deviation, degrees")

    @model_validator(mode="after")
    def _agree(self) -> Self:
        if self.between[0] == self.between[1]:
            raise refusal(
                "an angle is between a plane and itself",
                key=("between",),
                found=shown(self.between),
                allowed="two planes",
            )
        return self


class StatedTolerance(FileModel):
    """Up to which standard deviation without prior a parameter counts as identified."""

    offset_deg: Positive = Field(default=0.1, description="offset of a revolute joint, degrees")
    length_mm: Positive = Field(default=1.0, description="any length, millimetres")
    tilt_deg: Positive = Field(default=0.1, description="tilt of the tool, degrees")


class StatedRequirement(FileModel):
    """What the robot must meet."""

    tcp_mm: Positive = Field(
        description="error of the TCP that 95 % of the region (`workspace`) must stay below, millimetres"
    )


class Header(FileModel):
    """What the measurements of one file have in common. Paths in it are relative to the file's folder."""

    schema_: Literal["zerobeam/run/1", "zerobeam/plan/1"] | None = Field(
        default=None,
        alias="schema",
        description="kind and version of the file; optional in a header file",
    )
    robot: RobotRef = Field(
        description="a built-in name, the path of a robot file (.yaml), or a chain of a URDF file"
    )
    tool: StatedTool | None = Field(
        default=None, description="a laser or probe that the flange carries; required without `instruments`"
    )
    instruments: Annotated[dict[Name, InstrumentEntry], BeforeValidator(_instruments)] = Field(
        default={}, description="what is measured with, by name, besides `tool`"
    )
    noise: StatedNoise = Field(description="standard deviations of the readings")
    prior: StatedPrior = Field(default=StatedPrior(), description="what is known of the offsets beforehand")
    targets: dict[TargetName, StatedTarget] = Field(
        default={}, description="what is known of the targets, by name"
    )
    distances: Annotated[tuple[StatedDistance, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="measured distances between targets"
    )
    angles: Annotated[tuple[StatedAngle, ...], BeforeValidator(as_tuple)] = Field(
        default=(), description="known angles between targets that are planes"
    )
    held: Annotated[tuple[Name, ...], BeforeValidator(_unique)] | None = Field(
        default=None,
        description="names of the parameters that are not estimated, instead of what the method holds",
    )
    limits: Literal["error", "warn"] = Field(
        default="error", description="warn: joints outside the robot's limits are reported, not refused"
    )
    tolerance: StatedTolerance = Field(default=StatedTolerance(), description="what counts as identified")
    geometry: GeometryOfArm = Field(
        default=None,
        description="how far the arm may deviate from nominal geometry; absent: as typical arms do;"
        " exact: not at all",
    )
    required: StatedRequirement | None = Field(
        default=None, description="what the robot must meet once its values are entered"
    )
    workspace: StatedWorkspace = Field(
        default=CENTRAL_RANGES, description="the region over which the error of the TCP is judged"
    )
    provenance: Annotated[dict[Name, str | bool | int | float], BeforeValidator(_free_text)] = Field(
        default={}, description="free text by key: serial number, controller software, who, when"
    )

    @property
    def arm(self) -> StatedGeometry | None:
        """How far the arm may deviate from nominal geometry, a typical arm's deviations if nothing is stated;
        None where it is taken as exact."""
        if self.geometry is None:
            return StatedGeometry()
        return self.geometry if isinstance(self.geometry, StatedGeometry) else None

    @property
    def exact_tool(self) -> bool:
        """Whether the tool is as stated: a calibrated one without `tool.sigma` on an exact arm."""
        tool = self.stated_tool
        return tool.calibrated and self.arm is None and "sigma" not in tool.model_fields_set

    def instruments_stated(self) -> dict[str, StatedInstrument]:
        """What is stated of each instrument, by its label; that of the key `tool` is called so."""
        return {**({} if self.tool is None else {"tool": self.tool}), **self.instruments}

    @property
    def kinds(self) -> dict[str, type[Instrument]]:
        """The kind of each instrument, by its label."""
        return {label: kind_of(entry.kind) for label, entry in self.instruments_stated().items()}

    @property
    def only_tools(self) -> bool:
        """Whether all that is measured with is a laser or a probe."""
        return all(issubclass(kind, FlangeTool) for kind in self.kinds.values())

    @property
    def only_beam(self) -> bool:
        """Whether a beam is the only instrument: what a servo leads onto a detector."""
        return len(self.labels) == 1 and all(kind.beam for kind in self.kinds.values())

    @property
    def instrument(self) -> type[Instrument]:
        """The kind of the only instrument; BadInput where there are several."""
        (kind, *others) = self.kinds.values()
        if others:
            raise BadInput(
                "this needs a single instrument",
                found=", ".join(f"{label}: {kind.name}" for label, kind in self.kinds.items()),
                allowed="one instrument",
            )
        return kind

    @property
    def tool_kind(self) -> type[FlangeTool]:
        """The kind of the only instrument, a laser or a probe; BadInput where it is none."""
        return flange_tool_kind(self.instrument)

    def require_tool(self) -> None:
        """BadInput unless a laser or a probe is the only instrument."""
        _ = self.tool_kind

    @property
    def stated_tool(self) -> StatedTool:
        """What is stated of the only instrument, a laser or a probe; BadInput where it is none."""
        kind, entry = self.tool_kind, next(iter(self.instruments_stated().values()))
        assert isinstance(entry, StatedTool), kind
        return entry

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the instruments."""
        return tuple(self.instruments_stated())

    def made(self, label: str, joints: int) -> Instrument:
        """The instrument of that label, on an arm of so many joints.

        The sigma of a tool that is not calibrated is knowledge, as that of a calibrated one is, where it is
        stated and the last joint's offset, which the tool would take up, is to be estimated by it.
        """
        kind, entry, exact = self.kinds[label], self.instruments_stated()[label], self.arm is None
        if issubclass(kind, FlangeTool):
            estimated = self.held is not None and f"delta{joints}" not in self.held
            known = estimated and "sigma" in entry.model_fields_set
            return kind.of(label, entry, exact=exact, sigma_known=known)
        return kind.of(label, entry, exact=exact)

    @property
    def only_target(self) -> str:
        """The name of a run's target where none is stated for a measurement: the header's first, or the
        default of the instrument."""
        return next(iter(self.targets), self.instrument.target)

    @model_validator(mode="after")
    def _agree_with_instruments(self) -> Self:
        if self.tool is None and not self.instruments:
            raise refusal(
                "the key 'tool' is missing",
                found=", ".join(key for key in sorted(self.model_fields_set)),
                remedy="add 'tool' for a laser or a probe on the flange, or 'instruments' for any others",
            )
        tools = [label for label, kind in self.kinds.items() if issubclass(kind, FlangeTool)]
        if tools and "spot_mm" not in self.noise.model_fields_set:
            raise refusal(
                "the key 'spot_mm' is missing in noise",
                key=("noise",),
                found=", ".join(self.noise.model_dump(exclude_unset=True)),
                remedy=f"add 'spot_mm': {', '.join(tools)} has no other noise",
            )
        self._check_targets()
        return self

    def _check_targets(self) -> None:
        """A refusal for a target that is called as an instrument, or that no instrument can measure."""
        measurable = {target for kind in self.kinds.values() for target in kind.target_kinds()}
        for name, target in self.targets.items():
            if name in self.instruments:
                raise refusal(
                    f"a target and an instrument are both called {name!r}",
                    key=("targets", name),
                    remedy="give one of them another name",
                )
            if target.kind not in measurable:
                raise refusal(
                    f"no instrument measures a target that is a {target.kind}",
                    key=("targets", name, *(("kind",) if "kind" in target.model_fields_set else ())),
                    found=f"kind: {target.kind}",
                    allowed=" or ".join(sorted(measurable)) or "no target",
                    remedy="state the target's kind, or an instrument that measures it",
                )
        for i, distance in enumerate(self.distances):
            self._check_pair(("distances", i, "between"), distance.between, flat=False)
        for i, angle in enumerate(self.angles):
            self._check_pair(("angles", i, "between"), angle.between, flat=True)

    def _check_pair(self, key: KeyPath, names: tuple[str, str], *, flat: bool) -> None:
        """A refusal where an angle is not between planes, or a distance not between points."""
        for i, name in enumerate(names):
            target = self.targets.get(name)
            if flat and target is None:
                raise refusal(
                    "an angle names a plane that the header does not state",
                    key=(*key, i),
                    found=name,
                    allowed=", ".join(self.targets) or "a name under `targets`",
                    remedy=did_you_mean(name, self.targets) or f"state targets.{name}",
                )
            if target is not None and (target.normal is not None) != flat:
                raise refusal(
                    f"{'an angle' if flat else 'a distance'} is to a target that is a {target.kind}",
                    key=(*key, i),
                    found=name,
                    allowed="planes" if flat else "points and spheres",
                )


# Of a provenance, as `by_plain_key` has them: the serial number of the arm, and when it was measured.
SERIAL_KEYS = ("serial", "serial number", "robot serial", "robot serial number")
WHEN_KEYS = ("when", "date", "calibrated on")


def by_plain_key(provenance: Mapping[str, object]) -> dict[str, object]:
    """The provenance with its keys in small letters, their words apart by spaces."""
    return {re.sub(r"[\s_-]+", " ", key).strip().casefold(): value for key, value in provenance.items()}


def stated_by(provenance: Mapping[str, object], keys: tuple[str, ...]) -> str | None:
    """What a provenance states by the first of the plain `keys` that is there."""
    plain = by_plain_key(provenance)
    return next((str(plain[key]) for key in keys if key in plain), None)


def require_one_arm(runs: Iterable[tuple[str, Mapping[str, object]]]) -> None:
    """BadInput where the provenances of runs, each behind its name, state different serial numbers."""
    by_serial: dict[str, str] = {}
    for name, provenance in runs:
        if (serial := stated_by(provenance, SERIAL_KEYS)) is not None:
            by_serial.setdefault(serial, name)
    if len(by_serial) > 1:
        raise BadInput(
            "the runs are of different arms: their serial numbers differ",
            found=", ".join(f"{serial} in {name}" for serial, name in by_serial.items()),
            allowed="runs of one arm",
            remedy="name the runs of one arm, or correct provenance.serial in the header of its run",
        )


def header_content(header: Header, schema: Literal["zerobeam/run/1", "zerobeam/plan/1"]) -> dict[str, object]:
    """The header's stated keys as plain values, `schema` first: what a file begins with."""
    content = header.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    return {"schema": schema, **{key: value for key, value in content.items() if key != "schema"}}


def write_header(path: Path, header: Header, *, force: bool = False) -> None:
    """Write a header as a YAML file of its own, whole; over another one with `force` only."""
    content = header.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)
    write_whole(path, schema_line(path, "header") + yaml_text(short_in_one_line(content)), force=force)


def check_header(
    header: Header, robot: Robot, *, file: Path | None, line: Callable[[KeyPath], int | None]
) -> None:
    """BadInput where the header's noise or geometry does not suit the robot."""
    noise = header.noise
    if noise.joint_mm is not None and all(joint.kind == "revolute" for joint in robot.joints):
        raise BadInput(
            f"noise.joint_mm is stated, but {robot.name} has no prismatic joint",
            found=f"joint_mm: {noise.joint_mm:g}",
            remedy="remove it",
            file=file,
            line=line(("noise", "joint_mm")),
        )
    checks: list[tuple[KeyPath, Callable[[], object]]] = [
        (("noise", "joint_deg"), lambda: noise.of_joints(robot))
    ]
    header.workspace.check_postures(robot, file=file, line=line(("workspace",)))
    if isinstance(header.geometry, StatedGeometry):
        checks += [(("geometry", *key), check) for key, check in header.geometry.checks(robot)]
    for key, check in checks:
        try:
            check()
        except BadInput as error:
            raise error.restated(file=file, line=line(key), argument=None) from None
