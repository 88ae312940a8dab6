"""Taught points in the files of a controller: each that is used is a measurement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...model.errors import BadInput
from ...model.files.limits import require_joint_count
from ...model.files.reading import did_you_mean, read_text
from ...model.kinematics.robot import J3, Robot
from .imported import Found, Imported, Job, Stated


class Point(NamedTuple):
    """A point of the file: degrees (mm if prismatic), or None where it is Cartesian or was not taught.

    `number` is that of the posture of a plan, where a program of zerobeam recorded the point.
    """

    name: str
    joints: tuple[float, ...] | None
    line: int
    number: int | None = None


def import_points(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    parse: Callable[[str, Path], list[Point]],
    stated: Stated,
    out: Path | str,
    *,
    names: Sequence[str] | None,
    j3: J3 | None = None,
    vendor: str | None = None,
    note: str,
) -> Imported:
    """Measurements at the points of files, as `parse` (text, path) reads them; `names` selects some.

    `j3` says what joint 3 is counted from, by default the robot file, which must for arms of some makers
    (`vendor`, if the robot file names none). BadInput for a point without joint values.
    """
    job = Job.begin(files, stated)
    pendant = job.pendant(j3, vendor)
    found = []
    for path, target in zip(job.paths, job.targets(target_names), strict=True):
        points = _chosen(parse(read_text(path)[0], path), names, path)
        rows = [_joints(point, job.robot, path) for point in points]
        joints = pendant.between_links(np.array(rows))
        listed = f"  points in their order: {', '.join(point.name for point in points)}"
        lines = [point.line for point in points]
        numbers = [point.number for point in points if point.number is not None]
        found.append(
            Found(
                path,
                "point",
                joints,
                [target] * len(points),
                lines=lines,
                numbers=numbers if len(numbers) == len(points) else None,
                notes=[listed],
            )
        )
    return job.finish(found, out, [note, *([] if pendant.counting is None else [pendant.counting])])


def _chosen(points: Sequence[Point], names: Sequence[str] | None, path: Path) -> list[Point]:
    known = [point.name for point in points]
    if not points:
        raise BadInput("no measurements found: the file has no points", file=path)
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


def _joints(point: Point, robot: Robot, path: Path) -> tuple[float, ...]:
    if point.joints is None:
        raise BadInput(
            f"point {point.name} has no joint values",
            found="a Cartesian position, or one that was not taught",
            allowed="joint values: the configuration of the arm is not guessed",
            remedy="show it as joints on the controller and save again, or name the points to use (--points)",
            file=path,
            line=point.line,
        )
    joints = without_unused(point.joints, robot)
    require_joint_count(joints, robot, f"point {point.name}", path, point.line)
    return joints


def without_unused(joints: tuple[float, ...], robot: Robot) -> tuple[float, ...]:
    """Without the zeros at the end, of axes that the robot does not have."""
    return joints if any(joints[robot.n :]) else joints[: robot.n]
