"""One recorded measurement, and what a header and a robot allow of measurements."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BeforeValidator, Field

from ..errors import BadInput
from ..instruments.registry import names_of
from ..kinematics.robot import Robot
from ..parsing.reading import did_you_mean, shown
from ..parsing.validation import MOST, FileModel, Name, TargetName, refusal
from .header import Header
from .limits import check_limits, require_joint_count

_NUMBERS = frozenset({float, int})


def _joint_values(value: object) -> object:
    if not isinstance(value, list | tuple) or not value:
        raise refusal(
            "the joints are not a list of numbers", found=shown(value), allowed="[joint 1, joint 2, …]"
        )
    if _NUMBERS.issuperset(map(type, value)):
        return tuple(value)
    for i, item in enumerate(value):
        if isinstance(item, bool) or not isinstance(item, int | float):
            raise refusal(
                f"joint {i + 1} is not a number",
                key=(i,),
                found=shown(item),
                allowed="a number (degrees; mm for a prismatic joint)",
                remedy="leave out a measurement that was not fully recorded",
            )
    return tuple(value)


def _spot_values(value: object) -> object:
    if value is None:
        return None
    if not isinstance(value, list | tuple) or len(value) != 2:
        actual = f"{len(value)} values" if isinstance(value, list | tuple) else shown(value)
        raise refusal("spot_mm is not a pair", found=actual, allowed="[dx, dy], millimetres across the beam")
    return tuple(value)


JointValues = Annotated[tuple[float, ...], BeforeValidator(_joint_values)]


class Shot(FileModel):
    """One recorded measurement: the joints when the beam was on the target (or the probe in its socket)."""

    shot: int = Field(ge=0, le=MOST, description="number of the measurement, unique in its run")
    target: TargetName = Field(description="name of the target that was hit")
    joints_deg: JointValues = Field(
        description="recorded joint positions, joint 1 first, degrees (millimetres for a prismatic joint)"
    )
    spot_mm: Annotated[tuple[float, float] | None, BeforeValidator(_spot_values)] = Field(
        default=None,
        description="position of the target's centre as seen from the beam, along b1 and b2, millimetres; "
        "without it: on the beam",
    )
    time_s: float | None = Field(default=None, description="when, seconds since the start of the run")
    comment: Name | None = Field(default=None, description="what the operator noted; kept, not used")


def check_distances(header: Header, targets: Sequence[str], *, file: Path | None, line: int | None) -> None:
    """BadInput for a distance to a target that no measurement has."""
    for distance in header.distances:
        for name in distance.between:
            if name not in targets:
                raise BadInput(
                    "a distance names a target that no measurement has",
                    found=name,
                    allowed=", ".join(targets),
                    remedy=did_you_mean(name, targets) or "correct the name, or take the distance out",
                    file=file,
                    line=line,
                )


def unknown_targets(header: Header, targets: Sequence[str]) -> tuple[str, ...]:
    """A sentence for each name that is only in the header, or only in the measurements."""
    if not header.targets:
        return ()
    names = tuple(header.targets)
    sentences = [
        f"the header states target {name!r}, but no measurement has it"
        for name in names
        if name not in targets
    ]
    for name in targets:
        if name not in names:
            near = did_you_mean(name, names)
            sentences.append(
                f"target {name!r} is not among the header's targets ({', '.join(names)})"
                + (f"; {near}" if near else "")
            )
    return tuple(sentences)


def check_shots(
    header: Header, robot: Robot, shots: Sequence[Shot], lines: Sequence[int | None], *, file: Path | None
) -> tuple[str, ...]:
    """Judge measurements against header and robot: BadInput, or the sentences that a reader must see."""
    if not shots:
        raise BadInput("the run has no measurements", file=file, remedy="record some")
    first_line: dict[int, int | None] = {}
    for shot, line in zip(shots, lines, strict=True):
        check_shot(header, robot, shot, file=file, line=line)
        if shot.shot in first_line:
            raise BadInput(
                f"duplicate measurement number {shot.shot}",
                found=f"first on line {first_line[shot.shot]}",
                allowed="each number once",
                remedy="remove the wrong measurement, or give it the next number",
                file=file,
                line=line,
            )
        first_line[shot.shot] = line
    limits = check_limits(
        robot,
        np.array([shot.joints_deg for shot in shots]),
        "measurement",
        [shot.shot for shot in shots],
        lines,
        limits=header.limits,
        file=file,
    )
    return limits + unknown_targets(header, tuple(dict.fromkeys(shot.target for shot in shots)))


def check_shot(header: Header, robot: Robot, shot: Shot, *, file: Path | None, line: int | None) -> None:
    """BadInput for a measurement with too few or too many joints, or a spot that its tool cannot have."""
    require_joint_count(shot.joints_deg, robot, f"measurement {shot.shot}", file, line)
    if shot.spot_mm is not None and not header.instrument.columns:
        raise BadInput(
            f"measurement {shot.shot} has a spot, but a {header.tool.kind} makes none",
            found=f"spot_mm: {shown(shot.spot_mm)}",
            remedy=f"remove spot_mm, or state tool.kind: {' or '.join(names_of(beam=True))}",
            file=file,
            line=line,
        )
