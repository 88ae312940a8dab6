"""Plans: the postures from which shots are to be taken, in a YAML file that people read and edit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Discriminator, Field, Tag
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from ..errors import BadInput
from ..robot import Matrix, Robot
from .header import DEFAULT_TARGET, PLAN_SCHEMA, Header, TargetName, check_header, header_content
from .limits import check_limits
from .reading import read_yaml
from .robot_file import load_robot
from .shot import JointValues, check_distances, unknown_targets
from .validation import FileModel, as_tuple, require_schema, validate
from .whole_file import refuse_existing, write_whole


class StatedPosture(FileModel):
    """One posture with the target that it is meant for."""

    joints_deg: JointValues = Field(
        description="joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    target: TargetName = Field(description="name of the target to hit")


def _posture_tag(value: object) -> str:
    return "<row>" if isinstance(value, dict | StatedPosture) else "<list>"


Posture = Annotated[
    Annotated[JointValues, Tag("<list>")] | Annotated[StatedPosture, Tag("<row>")],
    Discriminator(_posture_tag),
]


class PlanFile(Header):
    """The content of a plan file: the header's keys and the postures."""

    schema_: Literal["zerobeam/plan/1"] = Field(alias="schema", description="kind and version of the file")
    postures_deg: Annotated[tuple[Posture, ...], BeforeValidator(as_tuple), Field(min_length=1)] = Field(
        description="one row a shot: its joints, degrees (millimetres for a prismatic joint), "
        "or {joints_deg, target}"
    )


@dataclass(frozen=True, eq=False)
class Plan:
    """N postures: `postures` (N, n) rad or mm, `targets` the target of each, `lines` where each stands."""

    header: Header
    robot: Robot
    postures: Matrix
    targets: tuple[str, ...]
    lines: tuple[int, ...]
    path: Path
    sha256: str
    warnings: tuple[str, ...]

    @cached_property
    def target_names(self) -> tuple[str, ...]:
        """The targets in the order in which they first appear."""
        return tuple(dict.fromkeys(self.targets))

    @cached_property
    def target_index(self) -> NDArray[np.int64]:
        """(N,) index into `target_names` of each posture."""
        return np.array([self.target_names.index(name) for name in self.targets], dtype=np.int64)


def read_plan(path: Path | str) -> Plan:
    """A plan file, every posture of it checked."""
    document = read_yaml(Path(path))
    file = document.file
    require_schema(document.data, PLAN_SCHEMA, file=file, line=document.line(("schema",)))
    content = validate(PlanFile, document.data, file=file, line=document.line)
    header = Header.model_construct(
        _fields_set=content.model_fields_set - {"postures_deg"},
        **{name: getattr(content, name) for name in Header.model_fields},
    )
    robot = load_robot(header.robot, file.parent, file=file, line=document.line(("robot",)))
    check_header(header, robot, file=file, line=document.line)
    lines = tuple(document.line(("postures_deg", i)) or 1 for i in range(len(content.postures_deg)))
    rows: list[tuple[float, ...]] = []
    targets: list[str] = []
    for i, posture in enumerate(content.postures_deg):
        if isinstance(posture, StatedPosture):
            rows.append(posture.joints_deg)
            targets.append(posture.target)
        else:
            rows.append(posture)
            targets.append(_only_target(header, i, file, lines[i]))
    warnings = _check_postures(header, robot, rows, targets, lines, file)
    check_distances(header, tuple(dict.fromkeys(targets)), file=file, line=document.line(("distances",)))
    postures = np.array(rows) / robot.display
    return Plan(header, robot, postures, tuple(targets), lines, file, document.sha256, warnings)


def _only_target(header: Header, posture: int, file: Path | None, line: int | None) -> str:
    """The target of a row that names none: the header's only one, or 'psd'."""
    stated = tuple(header.targets)
    if len(stated) > 1:
        raise BadInput(
            f"posture {posture} does not say which target it is for",
            found=f"{len(stated)} targets under `targets`",
            allowed=", ".join(stated),
            remedy=f"write it as {{joints_deg: […], target: {stated[0]}}}",
            file=file,
            line=line,
        )
    return stated[0] if stated else DEFAULT_TARGET


def _check_postures(
    header: Header,
    robot: Robot,
    rows: Sequence[Sequence[float]],
    targets: Sequence[str],
    lines: Sequence[int],
    file: Path | None,
) -> tuple[str, ...]:
    for i, row in enumerate(rows):
        if len(row) != robot.n:
            raise BadInput(
                f"posture {i} has the wrong number of joints",
                found=f"{len(row)} values",
                allowed=f"{robot.n} ({robot.name} has {robot.n} joints)",
                file=file,
                line=lines[i],
            )
    numbers = list(range(len(rows)))
    values = np.array(rows, dtype=float)
    limits = check_limits(robot, values, "posture", numbers, lines, limits=header.limits, file=file)
    return limits + unknown_targets(header, tuple(dict.fromkeys(targets)))


def write_plan(
    path: Path | str,
    header: Header,
    postures_deg: Sequence[Sequence[float]] | Matrix,
    targets: Sequence[str],
) -> None:
    """Write a plan: `postures_deg` (N, n) degrees or mm, `targets` the target of each.

    Written aside, then renamed; BadInput if the path exists or if the plan could not be read again.
    Paths in the header are taken relative to `path`.
    """
    path = Path(path)
    refuse_existing(path)
    rows = [[float(value) for value in row] for row in postures_deg]
    if not rows:
        raise BadInput("the plan has no postures", file=path)
    if not np.all(np.isfinite(np.concatenate(rows))):
        raise BadInput("a posture holds a number that is not finite", file=path)
    robot = load_robot(header.robot, path.parent)
    check_header(header, robot, file=None, line=lambda _: None)
    _check_postures(header, robot, rows, targets, [0] * len(rows), None)
    check_distances(header, tuple(dict.fromkeys(targets)), file=None, line=None)
    content = CommentedMap(_short_in_one_line(header_content(header, PLAN_SCHEMA)))
    plain = len(header.targets) < 2 and set(targets) == {next(iter(header.targets), DEFAULT_TARGET)}
    content["postures_deg"] = CommentedSeq(
        _flow(row) if plain else _flow({"joints_deg": _flow(row), "target": target})
        for row, target in zip(rows, targets, strict=True)
    )
    yaml = YAML()
    yaml.width = 4096
    yaml.indent(mapping=2, sequence=4, offset=2)
    text = StringIO()
    yaml.dump(content, text)
    write_whole(path, text.getvalue())


def _flow(value: Any) -> Any:
    """The same list or mapping, to be written on one line."""
    commented: Any = CommentedMap(value) if isinstance(value, dict) else CommentedSeq(value)
    commented.fa.set_flow_style()
    return commented


def _short_in_one_line(content: dict[str, Any]) -> dict[str, Any]:
    """Mappings of the header stay open for the eye; lists and what is deeper go on one line."""
    result: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, dict):
            result[key] = CommentedMap(
                {name: _flow(item) if isinstance(item, dict | list) else item for name, item in value.items()}
            )
        elif isinstance(value, list):
            result[key] = CommentedSeq(_flow(item) if isinstance(item, dict) else item for item in value)
        else:
            result[key] = value
    return result
