"""Robots by name, from a robot file (YAML, `zerobeam/robot/1`) or from a chain of a URDF file."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.dh import Convention, DHRow, RowTable, dh_chain, table_of
from ..kinematics.orientation import angles_of
from ..kinematics.plausible import beside_right_angle, doubtful_rows, is_rounded, too_long, warn_of
from ..kinematics.robot import Joint, Robot, pose_of
from ..parsing.confinement import BUILT_IN, require_within
from ..parsing.reading import did_you_mean, read_yaml, real_path, require_schema, shown
from ..parsing.validation import FileModel, Name, Positive, Vector, bad_input, refusal, validate
from .conventions import (
    FileLimits,
    StatedBodies,
    StatedEncoder,
    StatedMounting,
    StatedPendant,
    conventions,
    require_fitting,
)
from .header import UrdfRef
from .urdf import read_urdf
from .whole_file import flow, yaml_text

MOST_JOINTS = 100  # more are a mistake, and would be computed for hours


Vendor = Literal[
    "abb",
    "comau",
    "denso",
    "doosan",
    "epson",
    "fanuc",
    "franka",
    "kawasaki",
    "kinova",
    "kuka",
    "mitsubishi",
    "nachi",
    "staubli",
    "techman",
    "ufactory",
    "universal-robots",
    "yaskawa",
    "other",
]


class StatedTransform(FileModel):
    """A fixed transform: a shift, then turns about the fixed axes x, y, z (roll, pitch, yaw)."""

    xyz_mm: Vector = Field(default=(0.0, 0.0, 0.0), description="shift, millimetres")
    rpy_deg: Vector = Field(
        default=(0.0, 0.0, 0.0), description="rotations about fixed x, then y, then z, degrees"
    )

    def matrix(self) -> Matrix:
        return pose_of(self.xyz_mm, self.rpy_deg)

    def of(self, pose: Matrix, digits: int) -> StatedTransform:
        """That of a pose (4, 4), to so many decimals; this one where it is the same."""
        if np.allclose(pose, self.matrix(), rtol=0, atol=10.0**-digits):
            return self
        numbers = [*pose[:3, 3], *np.degrees(angles_of(pose[:3, :3]))]
        x, y, z, roll, pitch, yaw = (_decimal(value, digits) for value in numbers)
        return self.model_copy(update={"xyz_mm": (x, y, z), "rpy_deg": (roll, pitch, yaw)})


class StatedJoint(FileModel):
    """One Denavit-Hartenberg row, with the joint's range."""

    name: Name | None = Field(default=None, description="default: joint1, joint2 and so on")
    kind: Literal["revolute", "prismatic"] = Field(
        default="revolute", description="rotates about, or translates along, its z axis"
    )
    a_mm: float = Field(description="link length, millimetres")
    alpha_deg: float = Field(description="link twist, degrees")
    d_mm: float = Field(description="link offset, millimetres (of a prismatic joint: at its zero position)")
    theta_deg: float = Field(description="angle, degrees (of a revolute joint: at its zero position)")
    beta_deg: float = Field(
        default=0.0,
        description="rotation about y behind the twist, degrees, of axes that are nearly parallel (Hayati)",
    )
    lower_deg: float | None = Field(
        default=None, description="lower limit, degrees, as the pendant counts; for a revolute joint"
    )
    upper_deg: float | None = Field(
        default=None, description="upper limit, degrees, as the pendant counts; for a revolute joint"
    )
    lower_mm: float | None = Field(
        default=None, description="lower limit, millimetres; for a prismatic joint"
    )
    upper_mm: float | None = Field(
        default=None, description="upper limit, millimetres; for a prismatic joint"
    )
    speed_deg_s: Positive | None = Field(
        default=None, description="top speed, degrees a second; for a revolute joint"
    )
    speed_mm_s: Positive | None = Field(
        default=None, description="top speed, millimetres a second; for a prismatic one"
    )

    @model_validator(mode="after")
    def _agree(self) -> Self:
        unit, other = ("deg", "mm") if self.kind == "revolute" else ("mm", "deg")
        for key in (f"lower_{other}", f"upper_{other}", f"speed_{other}_s"):
            if getattr(self, key) is not None:
                raise refusal(
                    f"{key} is stated for a {self.kind} joint",
                    key=(key,),
                    found=f"{key}: {shown(getattr(self, key))}",
                    allowed=f"lower_{unit}, upper_{unit}, speed_{unit}_s",
                    remedy=f"state it in {unit}",
                )
        lower, upper = getattr(self, f"lower_{unit}"), getattr(self, f"upper_{unit}")
        for key, value in ((f"lower_{unit}", lower), (f"upper_{unit}", upper)):
            if value is None:
                raise refusal(
                    f"the {self.kind} joint has no {key}", remedy=f"add {key}, the limit of the joint"
                )
        if not lower < upper:
            raise refusal(
                f"lower_{unit} is not below upper_{unit}",
                key=(f"lower_{unit}",),
                found=f"{lower:g} and {upper:g}",
            )
        return self

    @property
    def row(self) -> DHRow:
        alpha, theta, beta = np.radians([self.alpha_deg, self.theta_deg, self.beta_deg]).tolist()
        return DHRow(self.a_mm, alpha, self.d_mm, theta, beta)

    def with_row(self, row: DHRow, digits: int) -> StatedJoint:
        """The joint with the numbers of a row, to so many decimals; as stated where it is the same row."""
        if row == self.row:
            return self
        alpha, theta, beta = np.degrees([row.alpha, row.theta, row.beta]).tolist()
        numbers = {"a_mm": row.a, "alpha_deg": alpha, "d_mm": row.d, "theta_deg": theta, "beta_deg": beta}
        update = {key: _decimal(value, digits) for key, value in numbers.items()}
        if not update["beta_deg"] and not self.beta_deg:
            del update["beta_deg"]
        return self.model_copy(update=update)

    def joint(self, number: int, fixed: Matrix) -> Joint:
        """The joint in internal units, behind its fixed transform."""
        axis, name = np.array([0.0, 0.0, 1.0]), self.name or f"joint{number}"
        if self.kind == "prismatic":
            assert self.lower_mm is not None
            assert self.upper_mm is not None
            return Joint(name, self.kind, fixed, axis, self.lower_mm, self.upper_mm, self.speed_mm_s)
        assert self.lower_deg is not None
        assert self.upper_deg is not None
        lower, upper = np.radians([self.lower_deg, self.upper_deg])
        speed = None if self.speed_deg_s is None else float(np.radians(self.speed_deg_s))
        return Joint(name, self.kind, fixed, axis, float(lower), float(upper), speed)


def _decimal(value: float, digits: int) -> float:
    return round(float(value), digits) + 0.0  # no -0.0


def _in_line(value: Any) -> Any:
    """A value of a file on one line, whole numbers without a point."""
    if isinstance(value, dict):
        return flow({key: _in_line(part) for key, part in value.items()})
    if isinstance(value, list):
        return flow([_in_line(part) for part in value])
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _joint_rows(value: object) -> object:
    return tuple(value) if isinstance(value, list) else value


class RobotFile(FileModel):
    """A robot by Denavit-Hartenberg rows, from base to flange."""

    schema_: Literal["zerobeam/robot/1"] = Field(alias="schema", description="kind and version of the file")
    name: Name = Field(description="what reports call the robot")
    vendor: Vendor | None = Field(
        default=None, description="who makes it; files for controllers of another vendor are refused"
    )
    model: Name | None = Field(default=None, description="what its maker calls it")
    payload_kg: Positive | None = Field(default=None, description="payload class, kilograms")
    convention: Convention = Field(
        description="standard: Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta); "
        "modified (Craig): Rx(alpha) Tx(a) Ry(beta) Rz(theta) Tz(d)"
    )
    joints: Annotated[
        tuple[StatedJoint, ...], BeforeValidator(_joint_rows), Field(min_length=1, max_length=MOST_JOINTS)
    ] = Field(description="one row a joint, joint 1 first")
    base: StatedTransform = Field(
        default=StatedTransform(), description="from the base frame to the frame of the first row"
    )
    flange: StatedTransform = Field(
        default=StatedTransform(), description="from the frame of the last row to the flange frame"
    )
    mounting: StatedMounting | None = Field(default=None, description="where the arm's mounting face is")
    bodies: StatedBodies | None = Field(default=None, description="how thick the arm's links are")
    pendant: StatedPendant = Field(default=StatedPendant(), description="how the pendant counts the joints")
    encoder: StatedEncoder | None = Field(default=None, description="what the encoders measure")
    limits: FileLimits = Field(default=FileLimits(), description="limits besides those of the rows")

    @model_validator(mode="after")
    def _conventions_agree(self) -> Self:
        require_fitting(self.pendant, self.encoder, [joint.kind for joint in self.joints])
        between = self.limits.joint3_to_link2_deg
        if between is not None and self.pendant.joint3 != "ground":
            raise refusal(
                "joint3_to_link2_deg is for a pendant that counts joint 3 from the ground",
                key=("limits", "joint3_to_link2_deg"),
                remedy="state pendant: {joint3: ground}; otherwise lower_deg and upper_deg of joint 3 say it",
            )
        if self.pendant.joint3 == "ground" and not self._range3[0] < self._range3[1]:
            raise refusal(
                "the limits of joints 2 and 3 leave nothing between links 2 and 3",
                key=("limits", "joint3_to_link2_deg"),
                found=shown(between),
            )
        return self

    @property
    def _range3(self) -> tuple[float, float]:
        """The range of the angle between links 2 and 3, degrees: what the pendant's ranges of joints 2 and 3
        allow, and what is stated of it."""
        second, third = self.joints[1:3]
        lower = (second.lower_deg or 0.0) + (third.lower_deg or 0.0)
        upper = (second.upper_deg or 0.0) + (third.upper_deg or 0.0)
        limits = self.limits.joint3_to_link2_deg
        return (lower, upper) if limits is None else (max(lower, limits[0]), min(upper, limits[1]))

    @model_validator(mode="after")
    def _agree(self) -> Self:
        names = [joint.name or f"joint{i}" for i, joint in enumerate(self.joints, start=1)]
        for i, name in enumerate(names):
            if name in names[:i]:
                raise refusal("two joints have the same name", key=("joints", i), found=shown(name))
        return self

    def table_of(self, robot: Robot) -> RowTable:
        """The rows of `robot`, which is this one with other links and zeros: those next to the stated."""
        near = [joint.row for joint in self.joints]
        first, flange = self.robot().joints[0].fixed, self.flange.matrix()
        return table_of(robot, near, self.convention, first, flange)

    def of_robot(self, robot: Robot, digits: int = 13) -> RobotFile:
        """The file of `robot`, which is this one with other links and zeros, to so many decimals."""
        table = self.table_of(robot)
        joints = tuple(
            joint.with_row(row, digits) for joint, row in zip(self.joints, table.rows, strict=True)
        )
        flange = self.flange.of(table.flange, digits)
        moved = {} if flange is self.flange else {"flange": flange}
        return self.model_copy(update={"joints": joints, **moved})

    @property
    def content(self) -> dict[str, object]:
        """What is stated, by the keys of the file."""
        return self.model_dump(mode="json", by_alias=True, exclude_unset=True, exclude_none=True)

    def text(self, head: Sequence[str] = ()) -> str:
        """The file, a joint a line, below the `head`'s lines of comment."""
        content = {key: _in_line(value) for key, value in self.content.items()}
        content["joints"] = list(content["joints"])  # each on a line of its own
        return "".join(f"# {line}\n" for line in head) + yaml_text(content)

    def robot(self) -> Robot:
        fixed, last = dh_chain([joint.row for joint in self.joints], self.convention)
        fixed[0] = self.base.matrix() @ fixed[0]
        joints = [
            row.joint(number, transform)
            for number, (row, transform) in enumerate(zip(self.joints, fixed, strict=True), start=1)
        ]
        range3 = None
        if self.pendant.joint3 == "ground":
            third = self.joints[2]
            assert third.lower_deg is not None
            assert third.upper_deg is not None
            range3 = third.lower_deg, third.upper_deg
            lower, upper = np.radians(self._range3).tolist()
            joints[2] = replace(joints[2], lower=lower, upper=upper)
        facts = conventions(self.mounting, self.pendant, self.encoder, range3, self.bodies)
        return Robot(self.name, tuple(joints), last @ self.flange.matrix(), self.vendor, facts)


def built_in_robots() -> tuple[str, ...]:
    """Names of the robots that come with the program."""
    return tuple(sorted(entry.stem for entry in BUILT_IN.glob("*.yaml")))


def load_robot(
    ref: str | Path | UrdfRef,
    folder: Path | str = ".",
    *,
    file: Path | None = None,
    line: int | None = None,
) -> Robot:
    """A robot by its name, or from a file.

    Parameters
    ----------
    ref
        A built-in name, the path of a robot file (it ends in .yaml or .yml), or a chain of a URDF file.
    folder
        What a relative path is relative to.
    file, line
        Where the robot is named, for the error of one that is not there.

    Returns
    -------
    Robot
        With forward kinematics `fk` and `jacobian`.

    Raises
    ------
    BadInput
        There is no such robot or file, or the file cannot be used.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.load_robot("irb1600")
    <Robot irb1600: 6 joints>
    """
    folder = Path(folder)
    ref = str(ref) if isinstance(ref, Path) else ref
    if isinstance(ref, UrdfRef):
        return _urdf_robot(ref, _named_file(folder / ref.urdf, file, line))
    if ref in built_in_robots():
        return _built_in_robot(ref)
    if ref.lower().endswith((".yaml", ".yml")):
        return read_robot(_named_file(folder / ref, file, line))
    if ref.lower().endswith((".urdf", ".xacro", ".xml")):
        remedy: str | None = "name its chain: robot: {urdf: " + ref + ", base: <link>, tip: <link>}"
    else:
        remedy = did_you_mean(ref.lower(), built_in_robots())
    raise BadInput(
        "there is no robot of this name",
        found=shown(ref),
        allowed=f"{', '.join(built_in_robots())}; the path of a robot file (.yaml); or {{urdf, base, tip}}",
        remedy=remedy,
        file=file,
        line=line,
    )


def require_loadable(robot: Robot, ref: str | UrdfRef, path: Path) -> None:
    """BadInput where `ref`, in a file `path` that is to be written, does not stand for the robot."""
    if load_robot(ref, path.parent) != robot:
        raise BadInput(
            f"the robot that {path.name} would name is another one",
            found=f"{robot!r} of the call, {ref!r} of the file",
            remedy="write the robot into a robot file, and name that file: robot='NAME.yaml'",
            file=path,
        )


def _urdf_robot(ref: UrdfRef, path: Path) -> Robot:
    robot = read_urdf(path, ref.base, ref.tip)
    try:
        require_fitting(ref.pendant, ref.encoder, [joint.kind for joint in robot.joints])
    except PydanticCustomError as error:
        raise bad_input(error, path) from None
    limits = ref.limits.joint3_pendant_deg
    facts = conventions(ref.mounting, ref.pendant, ref.encoder, limits, ref.bodies)
    return replace(robot, conventions=facts)


@cache
def _built_in_robot(name: str) -> Robot:
    return read_robot(BUILT_IN / f"{name}.yaml")


def _named_file(path: Path, file: Path | None, line: int | None) -> Path:
    require_within(path, file=file, line=line)
    if not path.exists():
        raise BadInput(
            "the file of the robot is not there",
            found=path,
            allowed="a path relative to the file that names it, or a built-in robot: "
            + ", ".join(built_in_robots()),
            file=file,
            line=line,
        )
    return path


def read_robot(path: Path) -> Robot:
    """Robot of a robot file (`zerobeam/robot/1`); a DoubtfulRobot warning of each number that looks wrong."""
    rows = read_rows(path)
    doubtful = doubts(rows)
    warn_of(rows.name, doubtful)
    sentences = tuple(f"robot {rows.name}: {doubt}" for doubt in doubtful)
    return replace(rows.robot(), doubts=sentences, rounded=tuple(_rounded(rows)))


def _rounded(rows: RobotFile) -> Iterator[str]:
    """A sentence on each angle that is a right angle rounded in radians, as of a URDF."""
    for i, joint in enumerate(rows.joints, start=1):
        for key in ("alpha_deg", "theta_deg", "beta_deg"):
            if is_rounded(math.radians(value := getattr(joint, key))):
                yield f"robot {rows.name}: {beside_right_angle(f'{key} of joint {i}', value)}"


def doubts(rows: RobotFile) -> tuple[str, ...]:
    """What looks wrong in a robot file, in sentences: metres, radians, twists, reach."""
    joints = rows.joints
    turning = [joint for joint in joints if joint.kind == "revolute"]

    def called(key: str) -> dict[str, float]:
        return {f"{key} of joint {i}": getattr(joint, key) for i, joint in enumerate(joints, start=1)}

    return (
        *doubtful_rows(
            called("a_mm") | called("d_mm"),
            called("alpha_deg"),
            called("theta_deg") | called("beta_deg"),
            [value for joint in turning for value in (joint.lower_deg, joint.upper_deg) if value is not None],
            [joint.speed_deg_s for joint in turning if joint.speed_deg_s is not None],
        ),
        *too_long([float(np.hypot(joint.a_mm, joint.d_mm)) for joint in joints], "millimetres"),
    )


def read_rows(path: Path) -> RobotFile:
    """The content of a robot file, checked."""
    document = read_yaml(path)
    require_schema(document.data, "zerobeam/robot/1", file=path, line=document.line(("schema",)))
    return validate(RobotFile, document.data, file=path, line=document.line)


def stated_rows(ref: str, folder: Path) -> RobotFile:
    """What the robot file states that `load_robot` reads for the same name."""
    return read_rows(BUILT_IN / f"{ref}.yaml" if ref in built_in_robots() else folder / ref)


def robot_path(ref: str | UrdfRef, folder: Path) -> Path | None:
    """The file of a robot that is named from `folder`; None for a built-in one."""
    if isinstance(ref, UrdfRef):
        return folder / ref.urdf
    return None if ref in built_in_robots() else folder / ref


def rebased(ref: str | UrdfRef, old: Path, new: Path) -> str | UrdfRef:
    """The same robot as named from another folder: relative paths follow, built-in names stay."""
    if isinstance(ref, UrdfRef):
        return ref.model_copy(update={"urdf": _rebased_path(ref.urdf, old, new)})
    return ref if ref in built_in_robots() else _rebased_path(ref, old, new)


def _rebased_path(path: str, old: Path, new: Path) -> str:
    if Path(path).is_absolute():
        return path
    there = real_path(old / path)
    try:
        return str(PurePosixPath(*Path(os.path.relpath(there, real_path(new))).parts))
    except ValueError:  # on Windows there is no relative path between two drives
        return str(there)
