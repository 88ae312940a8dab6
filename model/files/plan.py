"""Plans: the postures in which measurements are to be taken, in a YAML file that people read and edit."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from ..arrays import Matrix
from ..errors import BadInput
from ..kinematics.robot import Robot
from ..parsing.reading import Document, read_yaml, require_schema
from ..parsing.validation import validate
from .arguments import (
    Laser,
    Noise,
    Probe,
    RobotArgument,
    checked,
    joint_positions,
    plain,
    stated_header,
    target_of_each,
)
from .header import PLAN_SCHEMA, Header, check_header, header_content
from .header_file import completed
from .limits import check_limits, require_joint_count
from .plan_file import UNCONSTRAINED, PlanFile, StatedConstraints, StatedPosture
from .robot_file import load_robot
from .shot import check_distances, unknown_targets
from .whole_file import flow, refuse_existing, schema_line, short_in_one_line, write_whole, yaml_text


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """Planned postures of a robot of n joints: from a file (`read_plan`) or from arrays.

    Attributes
    ----------
    header : Header
        What all measurements have in common.
    robot : Robot
        The arm.
    postures : ndarray
        (N, n) joint positions, rad (mm for prismatic joints).
    targets : tuple of str
        (N,) the target of each posture.
    lines : tuple
        (N,) where each is in its file; None for a plan that is in no file.
    path : Path
        The file; the name of a plan that is in none.
    sha256 : str
        Of the file, or of the text that a file would have.
    warnings : tuple of str
        Sentences that a reader must see, such as joints outside their limits.
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
    ...     noise=zb.Noise(joint_deg=0.01, spot_mm=0.05),
    ... )
    >>> plan
    <Plan arrays: 2 postures at psd, irb1600>
    """

    header: Header
    robot: Robot
    postures: Matrix
    targets: tuple[str, ...]
    lines: tuple[int | None, ...]
    path: Path
    sha256: str
    warnings: tuple[str, ...]
    via: tuple[Matrix, ...] = ()
    constraints: StatedConstraints = UNCONSTRAINED

    @classmethod
    def from_arrays(
        cls,
        *,
        robot: RobotArgument,
        tool: Laser | Probe,
        postures: ArrayLike,
        noise: Noise,
        unit: Literal["deg", "rad"] = "deg",
        targets: str | Sequence[str] | None = None,
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
            What the flange carries.
        postures
            (N, n) joint positions, joint 1 first; those of prismatic joints in mm.
        noise
            Standard deviations of the readings.
        unit
            Of the revolute joints in `postures`: "deg" or "rad".
        targets
            N names, the target of each posture, or one name for all. By default all are of one target: the
            only one in `target_priors`, or "psd" (of a probe "socket").
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
        parsed, arm = stated_header(robot, tool, noise, target_priors, {"schema": PLAN_SCHEMA, **header})
        positions = joint_positions(postures, "postures", arm, unit)
        names = target_of_each(targets, parsed, len(positions), "postures")
        try:
            for target in names:
                validate(
                    StatedPosture, {"joints_deg": [0.0], "target": target}, file=None, line=lambda _: None
                )
        except BadInput as error:
            raise error.of_argument("targets") from None
        try:
            return cls.of_postures(
                parsed,
                arm,
                positions,
                names,
                name,
                checked(StatedConstraints, plain(constraints or {})),
            )
        except BadInput as error:
            raise error.of_argument("postures") from None

    @classmethod
    def of_postures(
        cls,
        header: Header,
        robot: Robot,
        postures_deg: Matrix,
        targets: Sequence[str],
        name: str,
        constraints: StatedConstraints = UNCONSTRAINED,
    ) -> Self:
        """A plan that is in no file, `postures_deg` (N, n) degrees or mm; BadInput where it is unsound."""
        if not len(postures_deg):
            raise BadInput("the plan has no postures", remedy="state one at least")
        nowhere = (None,) * len(postures_deg)
        warnings = _check_postures(header, robot, postures_deg.tolist(), targets, nowhere, None)
        check_distances(header, tuple(dict.fromkeys(targets)), file=None, line=None)
        text = _plan_text(header, postures_deg.tolist(), targets, constraints=constraints)
        sha256 = hashlib.sha256(text.encode("utf-8")).hexdigest()
        postures = postures_deg / robot.display
        return cls(
            header,
            robot,
            postures,
            tuple(targets),
            nowhere,
            Path(name),
            sha256,
            warnings,
            constraints=constraints,
        )

    def __repr__(self) -> str:
        targets = ", ".join(self.target_names)
        return f"<Plan {self.path.name}: {len(self.postures)} postures at {targets}, {self.robot.name}>"

    def via_of(self, posture: int) -> Matrix:
        """(k, n) the intermediate postures on the way to a posture (from 0), rad or mm; k may be 0."""
        return self.via[posture] if self.via else np.zeros((0, self.robot.n))

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """The targets in the order in which they first appear."""
        return tuple(dict.fromkeys(self.targets))

    @cached_property
    def target_index(self) -> NDArray[np.int64]:
        """(N,) index into `target_names` of each posture."""
        return np.array([self.target_names.index(name) for name in self.targets], dtype=np.int64)


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
    rows: list[tuple[float, ...]] = []
    targets: list[str] = []
    via: list[Matrix] = []
    for i, posture in enumerate(content.postures_deg):
        if isinstance(posture, StatedPosture):
            rows.append(posture.joints_deg)
            targets.append(posture.target)
            via.append(_checked_via(posture.via_deg, i, header, robot, file, lines[i]))
        else:
            rows.append(posture)
            targets.append(_only_target(header, i, file, lines[i]))
            via.append(np.zeros((0, robot.n)))
    warnings = _check_postures(header, robot, rows, targets, lines, file)
    check_distances(header, tuple(dict.fromkeys(targets)), file=file, line=document.line(("distances",)))
    postures = np.array(rows) / robot.display
    passing = tuple(via) if any(len(between) for between in via) else ()
    return Plan(
        header,
        robot,
        postures,
        tuple(targets),
        lines,
        file,
        document.sha256,
        warnings,
        passing,
        content.constraints,
    )


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


def _only_target(header: Header, posture: int, file: Path | None, line: int | None) -> str:
    """The target of a row that names none: the header's only one, or that of its tool."""
    names = tuple(header.targets)
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


def _check_postures(
    header: Header,
    robot: Robot,
    rows: Sequence[Sequence[float]],
    targets: Sequence[str],
    lines: Sequence[int | None],
    file: Path | None,
) -> tuple[str, ...]:
    for i, row in enumerate(rows):
        require_joint_count(row, robot, f"posture {i}", file, lines[i])
    numbers = list(range(len(rows)))
    values = np.array(rows, dtype=float)
    limits = check_limits(robot, values, "posture", numbers, lines, limits=header.limits, file=file)
    return limits + unknown_targets(header, tuple(dict.fromkeys(targets)))


def write_plan(
    path: Path | str,
    header: Header,
    postures_deg: Sequence[Sequence[float]] | Matrix,
    targets: Sequence[str],
    *,
    via_deg: Sequence[Matrix] = (),
    constraints: StatedConstraints = UNCONSTRAINED,
    force: bool = False,
) -> None:
    """Write a plan: `postures_deg` (N, n) degrees or mm, `targets` the target of each, `via_deg` the (k, n)
    intermediate postures on the way to each, if there are any, `constraints` what each must keep.

    Written to another name, then renamed; BadInput if the path exists (unless `force`) or if the plan could
    not be read again. Paths in the header are taken relative to `path`.
    """
    path = Path(path)
    refuse_existing(path, force=force)
    rows = [[float(value) for value in row] for row in postures_deg]
    if not rows:
        raise BadInput("the plan has no postures", file=path)
    if not np.all(np.isfinite(np.concatenate(rows))):
        raise BadInput("a posture holds a number that is not finite", file=path)
    robot = load_robot(header.robot, path.parent)
    check_header(header, robot, file=None, line=lambda _: None)
    _check_postures(header, robot, rows, targets, [0] * len(rows), None)
    check_distances(header, tuple(dict.fromkeys(targets)), file=None, line=None)
    text = _plan_text(header, rows, targets, via_deg, constraints)
    write_whole(path, schema_line(path, "plan") + text, force=force)


def _plan_text(
    header: Header,
    rows: Sequence[Sequence[float]],
    targets: Sequence[str],
    via: Sequence[Matrix] = (),
    constraints: StatedConstraints = UNCONSTRAINED,
) -> str:
    """The text of a plan file: `rows` (N, n) degrees or mm."""
    keys = header_content(header, PLAN_SCHEMA)
    if constraints.model_fields_set:
        keys["constraints"] = constraints.model_dump(mode="json", exclude_unset=True)
    content = CommentedMap(short_in_one_line(keys))
    plain = len(header.targets) < 2 and set(targets) == {header.only_target} and not via
    content["postures_deg"] = CommentedSeq(
        flow(row) if plain else flow({"joints_deg": flow(row), "target": target})
        for row, target in zip(rows, targets, strict=True)
    )
    for posture, between in zip(content["postures_deg"], via, strict=False):
        if len(between):
            posture["via_deg"] = flow([flow(row) for row in between.tolist()])
    return yaml_text(content)
