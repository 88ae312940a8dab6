"""Plans: the postures in which measurements are to be taken, in a YAML file that people read and edit,
with the header's keys and the constraints.
"""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from ..arrays import Matrix
from ..errors import BadInput
from ..instruments.registry import names_of
from ..kinematics.robot import Robot
from ..parsing.reading import Document, read_yaml, require_schema, shown
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
    validate,
    with_length,
)
from .from_arrays import (
    Laser,
    Noise,
    Probe,
    RobotArgument,
    checked,
    joint_positions,
    plain,
    require_arguments,
    require_count,
    stated_header,
    target_of_each,
)
from .header import PLAN_SCHEMA, Header, check_header, header_content
from .joint_values import JointValues, check_limits, require_joint_count
from .measurements import Measurements, always, completed
from .robot_file import load_robot
from .shot import Shot, check_shots, check_ties, target_names
from .whole_file import flow, refuse_existing, schema_line, short_in_one_line, write_whole, yaml_text


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


_DECIMALS = 9  # of degrees in a file: what they lose on the way to radians and back is far below


class Means(NamedTuple):
    """What a planned measurement is made with, as stated: None where the header leaves no choice. Those of
    one `posture` are made in the same one; `again` is the measurement that this one repeats."""

    instrument: str | None = None
    reflector: str | None = None
    posture: int | None = None
    again: int | None = None

    @property
    def usual(self) -> bool:
        """Whether the header leaves no choice: nothing is stated but perhaps what is repeated."""
        return self == Means(again=self.again)

    @classmethod
    def of(cls, row: StatedPosture | Shot) -> Self:
        return cls(row.instrument, row.reflector, row.posture, row.again)


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Measurements):
    """Planned postures of a robot of n joints: from a file (`read_plan`) or from arrays.

    Attributes
    ----------
    header, robot, shots, lines, path, sha256, warnings
        As of all `Measurements`.
    via : tuple of ndarray
        (N,) the intermediate postures on the way to each, (k, n) rad or mm; empty without any.
    constraints : StatedConstraints
        What every measurement must keep, in degrees and mm: `check` judges it.

    Examples
    --------
    >>> import zerobeam as zb
    >>> plan = zb.Plan.from_arrays(
    ...     robot="irb1600",
    ...     tool=zb.Laser(point_mm=(0, 0, 65), direction=(1, 0, 0)),
    ...     postures=[[10, -20, 30, 5, 40, 0], [-15, -25, 35, 0, 35, 20]],
    ...     unit="deg",
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ... )
    >>> plan
    <Plan arrays: 2 postures at psd, irb1600>
    """

    via: tuple[Matrix, ...] = ()
    constraints: StatedConstraints = UNCONSTRAINED

    @property
    def postures(self) -> Matrix:
        """(N, n) joint positions, rad (mm for prismatic joints)."""
        return self.joints

    @cached_property
    def means(self) -> tuple[Means, ...]:
        """(N,) the instrument and reflector of each posture, as stated; empty where none is stated."""
        means = tuple(map(Means.of, self.shots))
        return means if any(each != Means() for each in means) else ()

    @classmethod
    def from_arrays(
        cls,
        *,
        robot: RobotArgument,
        tool: Laser | Probe | None = None,
        instruments: Mapping[str, Mapping[str, Any]] | None = None,
        postures: ArrayLike,
        noise: Noise,
        unit: Literal["deg", "rad"] | None = None,
        targets: str | Sequence[str | None] | None = None,
        means: Sequence[Mapping[str, Any]] = (),
        target_priors: Mapping[str, Mapping[str, Any]] | None = None,
        constraints: Mapping[str, Any] | None = None,
        name: str = "arrays",
        **header: Any,
    ) -> Self:
        """A plan of N postures with a robot of n joints.

        Parameters
        ----------
        robot
            A built-in name, the path of a robot file, {"urdf", "base", "tip"} or a `Robot`.
        tool
            The laser or probe that the flange carries, if there is one.
        instruments
            Other instruments by name, {name: {"kind": …, …}}: the key `instruments` of a file.
        postures
            (N, n) joint positions, joint 1 first; those of prismatic joints in mm.
        noise
            Standard deviations of the readings.
        unit
            Of the revolute joints in `postures`: "deg" or "rad". It is required: no unit is assumed.
        targets
            N names, the target of each posture, or one name for all. By default all are of one target: the
            only one in `target_priors`, or "psd" (of a probe "socket").
        means
            N mappings, {"instrument", "reflector", "posture"} of each posture as in a file.
        target_priors
            What is known of targets beforehand, {name: {"guess_mm": [x, y, z], "sigma_mm": std}}: the key
            `targets` of a file.
        constraints
            What every measurement must keep, with the keys of `constraints` in a plan file.
        name
            What reports call the plan.
        **header
            The other keys of a plan file's header, as they are there: prior, distances, held, limits,
            tolerance, geometry, provenance.

        Returns
        -------
        Plan

        Raises
        ------
        BadInput
            Names the argument, what was found, what is allowed and what to do.
        """
        require_arguments(cls.from_arrays, header)
        parsed, arm = stated_header(
            robot, tool, instruments, noise, target_priors, {"schema": PLAN_SCHEMA, **header}
        )
        positions = joint_positions(postures, "postures", arm, unit, noun="posture", limits=parsed.limits)
        names = target_of_each(targets, parsed, len(positions), "postures")
        if means:
            require_count("means", len(means), len(positions), "postures")
        rows = []
        for target, more in zip(names, means or [{}] * len(names), strict=True):
            try:
                content = {**plain(more), "joints_deg": [0.0], "target": target}
                rows.append(validate(StatedPosture, content, file=None, line=lambda _: None))
            except BadInput as error:
                raise error.of_argument("means" if more else "targets") from None
        try:
            return cls.of_postures(
                parsed,
                arm,
                positions,
                names,
                name,
                checked(StatedConstraints, plain(constraints or {})),
                [Means.of(row) for row in rows] if means else (),
            )
        except BadInput as error:
            raise error.of_argument("postures") from None

    @classmethod
    def of_postures(
        cls,
        header: Header,
        robot: Robot,
        postures_deg: Matrix,
        targets: Sequence[str | None],
        name: str,
        constraints: StatedConstraints = UNCONSTRAINED,
        means: Sequence[Means] = (),
    ) -> Self:
        """A plan that is in no file, `postures_deg` (N, n) degrees or mm; BadInput where it is unsound."""
        if not len(postures_deg):
            raise BadInput("the plan has no postures", remedy="state one at least")
        shots, nowhere = planned(postures_deg, targets, means), (None,) * len(postures_deg)
        warnings = check_shots(header, robot, shots, nowhere, file=None, planned=True)
        check_ties(header, target_names(targets), file=None, line=None)
        text = _plan_text(header, shots, constraints=constraints)
        sha256 = hashlib.sha256(text.encode("utf-8")).hexdigest()
        return cls(header, robot, shots, nowhere, Path(name), sha256, warnings, constraints=constraints)

    @property
    def _content(self) -> str:
        count = len(self.shots)
        return f"{count} posture{'' if count == 1 else 's'} at {', '.join(self.target_names)}"

    def _write(self, path: Path, *, force: bool) -> None:
        write_plan(
            path,
            self.header,
            (self.postures * self.robot.display).round(_DECIMALS),
            self.targets,
            means=self.means,
            via_deg=[(between * self.robot.display).round(_DECIMALS) for between in self.via],
            constraints=self.constraints,
            force=force,
        )

    def repeated_by(self, number: int) -> int | None:
        """The measurement that the one of this number makes again; beyond the plan's, number and plan's count
        apart, each repeats one."""
        count = len(self.shots)
        return self.shots[number].again if number < count else number % count

    def via_of(self, posture: int) -> Matrix:
        """(k, n) the intermediate postures on the way to a posture (from 0), rad or mm; k may be 0."""
        return self.via[posture] if self.via else np.zeros((0, self.robot.n))

    @cached_property
    def called(self) -> tuple[str, ...]:
        """(N,) the name of what is measured in each posture: its target, else its reflector or instrument."""
        return tuple(
            measurement.target or measurement.variant or measurement.instrument
            for measurement in self.measurements
        )


def is_plan(path: Path) -> bool:
    """Whether a YAML file says of itself that it is a plan, and no header alone."""
    data = read_yaml(path).data
    return isinstance(data, Mapping) and data.get("schema") == PLAN_SCHEMA


def read_plan(path: Path | str) -> Plan:
    """Read a plan file (YAML, `zerobeam/plan/1`) and check every posture of it.

    Parameters
    ----------
    path
        The file; what it names is relative to its folder.

    Returns
    -------
    Plan
        Its postures in radians (mm for prismatic joints).

    Raises
    ------
    BadInput
        Names the file, the line, what was found, what is allowed and what to do.

    Examples
    --------
    >>> import zerobeam as zb
    >>> zb.read_plan("nowhere.yaml")
    Traceback (most recent call last):
    zerobeam.model.errors.BadInput: nowhere.yaml: there is no such file
    """
    return plan_of(read_yaml(Path(path)))


def plan_of(document: Document) -> Plan:
    """The plan that a document states, paths in it relative to its file's folder; BadInput as `read_plan`."""
    file = document.file
    require_schema(document.data, PLAN_SCHEMA, file=file, line=document.line(("schema",)))
    content = validate(PlanFile, document.data, file=file, line=document.line)
    header = Header.model_construct(
        _fields_set=content.model_fields_set & set(Header.model_fields),
        **{name: getattr(content, name) for name in Header.model_fields},
    )
    header = completed(header, file.parent, file=file, line=document.line)
    robot = load_robot(header.robot, file.parent, file=file, line=document.line(("robot",)))
    check_header(header, robot, file=file, line=document.line)
    lines = tuple(document.line(("postures_deg", i)) for i in range(len(content.postures_deg)))
    rows = [
        row
        if isinstance(row, StatedPosture)
        else StatedPosture.model_construct(joints_deg=row, target=_only_target(header, i, file, lines[i]))
        for i, row in enumerate(content.postures_deg)
    ]
    joints, targets = [row.joints_deg for row in rows], [row.target for row in rows]
    shots = planned(joints, targets, [Means.of(row) for row in rows])
    via = tuple(
        _checked_via(row.via_deg, i, header, robot, file, line)
        for i, (row, line) in enumerate(zip(rows, lines, strict=True))
    )
    warnings = check_shots(header, robot, shots, lines, file=file, planned=True)
    line = document.line(("distances",) if header.distances else ("angles",))
    check_ties(header, target_names(targets), file=file, line=line)
    passing = via if any(len(between) for between in via) else ()
    return Plan(header, robot, shots, lines, file, document.sha256, warnings, passing, content.constraints)


def _without_none(**values: object) -> dict[str, object]:
    return {key: value for key, value in values.items() if value is not None}


def _checked_via(
    rows: Sequence[Sequence[float]],
    posture: int,
    header: Header,
    robot: Robot,
    file: Path | None,
    line: int | None,
) -> Matrix:
    """(k, n) rad or mm; BadInput for an intermediate posture of another arm, or beyond the limits."""
    name = f"intermediate posture {{}} before posture {posture}"
    for i, row in enumerate(rows):
        require_joint_count(row, robot, name.format(i), file, line)
    values = np.array(rows, dtype=float).reshape(len(rows), robot.n)
    numbers = list(range(len(rows)))
    check_limits(
        robot,
        values,
        f"before posture {posture}, intermediate posture",
        numbers,
        [line or 0] * len(rows),
        limits=header.limits,
        file=file,
    )
    return values / robot.display


def _only_target(header: Header, posture: int, file: Path | None, line: int | None) -> str | None:
    """The target of a row that names none: the header's only one, or that of its only instrument."""
    names = tuple(header.targets)
    kinds = list(header.kinds.values())
    if len(kinds) > 1 or not kinds[0].target_kinds():
        return None
    if len(names) > 1:
        raise BadInput(
            f"posture {posture} does not say which target it is for",
            found=f"{len(names)} targets under `targets`",
            allowed=", ".join(names),
            remedy=f"write it as {{joints_deg: […], target: {names[0]}}}",
            file=file,
            line=line,
        )
    return header.only_target


def planned(
    rows: Sequence[Sequence[float]] | Matrix, targets: Sequence[str | None], means: Sequence[Means] = ()
) -> tuple[Shot, ...]:
    """The measurements of a plan at joints (N, n), degrees or mm, without what is measured."""
    return tuple(
        Shot.model_construct(shot=i, target=target, joints_deg=tuple(map(float, row)), **more._asdict())
        for i, (row, target, more) in enumerate(
            zip(rows, targets, means or [Means()] * len(rows), strict=True)
        )
    )


def first_in_turn(measured: Sequence[Hashable], count: int) -> list[int]:
    """The places, in their order, of so many measurements to make again at the end: the first of each thing
    that is `measured` (N,), then the second of each, …"""
    before: Counter[Hashable] = Counter()
    turns = []
    for row, what in enumerate(measured):
        turns.append((before[what], row))
        before[what] += 1
    return sorted(row for _, row in sorted(turns)[:count])


def write_plan(
    path: Path | str,
    header: Header,
    postures_deg: Sequence[Sequence[float]] | Matrix,
    targets: Sequence[str | None],
    *,
    means: Sequence[Means] = (),
    via_deg: Sequence[Matrix] = (),
    constraints: StatedConstraints = UNCONSTRAINED,
    force: bool = False,
) -> None:
    """Write a plan: `postures_deg` (N, n) degrees or mm, `targets` the target of each, `means` what each is
    measured with, `via_deg` the (k, n) intermediate postures on the way to each, if there are any,
    `constraints` what each must keep.

    Written to another name, then renamed; BadInput if the path exists (unless `force`) or if the plan could
    not be read again. Paths in the header are taken relative to `path`.
    """
    path = Path(path)
    refuse_existing(path, force=force)
    if not len(postures_deg):
        raise BadInput("the plan has no postures", file=path)
    shots = planned(postures_deg, targets, means)
    if not np.all(np.isfinite(np.concatenate([shot.joints_deg for shot in shots]))):
        raise BadInput("a posture holds a number that is not finite", file=path)
    robot = load_robot(header.robot, path.parent)
    check_header(header, robot, file=None, line=always(None))
    check_shots(header, robot, shots, [0] * len(shots), file=None, planned=True)
    check_ties(header, target_names(targets), file=None, line=None)
    text = _plan_text(header, shots, via_deg, constraints)
    write_whole(path, schema_line(path, "plan") + text, force=force)


def _plan_text(
    header: Header,
    shots: Sequence[Shot],
    via: Sequence[Matrix] = (),
    constraints: StatedConstraints = UNCONSTRAINED,
) -> str:
    """The text of a plan file: `via` (k, n) degrees or mm."""
    keys = header_content(header, PLAN_SCHEMA)
    if constraints.model_fields_set:
        keys["constraints"] = constraints.model_dump(mode="json", exclude_unset=True)
    content = CommentedMap(short_in_one_line(keys))
    rows = [{"joints_deg": flow(shot.joints_deg), "target": shot.target} for shot in shots]
    means = [Means.of(shot)._asdict() for shot in shots]
    bare = len(header.targets) < 2 and not via
    if bare and any(shot.target for shot in shots):
        bare = len(header.kinds) == 1 and {shot.target for shot in shots} == {header.only_target}
    whole = [_without_none(**row, **more) for row, more in zip(rows, means, strict=True)]
    content["postures_deg"] = CommentedSeq(
        row["joints_deg"] if bare and not any(v is not None for v in more.values()) else flow(full)
        for row, more, full in zip(rows, means, whole, strict=True)
    )
    for posture, between in zip(content["postures_deg"], via, strict=False):
        if len(between):
            posture["via_deg"] = flow([flow(row) for row in between.tolist()])
    return yaml_text(content)
