"""Joint positions with a name in a controller's program or data file: each that is used is a shot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.reading import did_you_mean, read_text
from .imported import Found, Imported, Job, one_target_each
from .joint3 import J3_TOLD, from_ground


class Point(NamedTuple):
    """A position of the file: degrees (mm if prismatic), or None where it is Cartesian or not taught."""

    name: str
    joints: tuple[float, ...] | None
    line: int


def import_points(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    parse: Callable[[str, Path], list[Point]],
    header_path: Path | str,
    out: Path | str,
    *,
    names: Sequence[str] | None,
    ground: bool = False,
    told: str,
) -> Imported:
    """Shots from the points of files, as `parse` (text, path) reads them; `names` are those to use, or all.

    `ground`: joint 3 is counted from the ground. BadInput for a point that is not stated by its joints.
    """
    job = Job.begin(files, header_path)
    one_target_each(job.paths, target_names)
    found = []
    for path, target in zip(job.paths, target_names, strict=True):
        points = _chosen(parse(read_text(path)[0], path), names, path)
        rows = [_joints(point, job.robot.n, job.robot.name, path) for point in points]
        joints = from_ground(np.array(rows), job.robot) if ground else np.array(rows)
        listed = f"  points in their order: {', '.join(point.name for point in points)}"
        lines = [point.line for point in points]
        found.append(Found(path, "point", joints, [target] * len(points), lines=lines, told=[listed]))
    return job.finish(found, out, [told, *([J3_TOLD] if ground else [])])


def _chosen(points: Sequence[Point], names: Sequence[str] | None, path: Path) -> list[Point]:
    known = [point.name for point in points]
    if not points:
        raise BadInput("no shots found: the file has no positions", file=path)
    if names is None:
        return list(points)
    for name in names:
        if name not in known:
            raise BadInput(
                "there is no point of this name",
                found=name,
                allowed=", ".join(known),
                remedy=did_you_mean(name, known),
                file=path,
            )
    return [points[known.index(name)] for name in dict.fromkeys(names)]


def _joints(point: Point, count: int, robot: str, path: Path) -> tuple[float, ...]:
    if point.joints is None:
        raise BadInput(
            f"point {point.name} does not state its joints",
            found="a Cartesian position, or one that was never taught",
            allowed="joint values: the arm's configuration must not be guessed",
            remedy="show it as joints on the controller and save again, or name the points to use (--points)",
            file=path,
            line=point.line,
        )
    if len(point.joints) != count:
        raise BadInput(
            f"point {point.name} has the wrong number of joints",
            found=f"{len(point.joints)} values",
            allowed=f"{count} ({robot} has {count} joints)",
            file=path,
            line=point.line,
        )
    return point.joints
