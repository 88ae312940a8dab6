"""The wrong models of the study: what is wrong with an arm, a cell, a recording or a robot file, and by which
cause a diagnosis may name it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import load_robot
from ...model.kinematics.dh import DHRow, as_row, dh_chain, with_fixed
from ...model.kinematics.robot import Robot
from .wrong_arms import Course

Readings = tuple[Matrix, Matrix]  # joints (N, n) rad and spots (N, 2) mm
Named = tuple[str, tuple[int, ...]]  # cause, joints; of any joints where there are none


@dataclass(frozen=True, eq=False)
class Scenario:
    """One thing that is wrong. `named` are the causes that name it; none where none can.

    It is not `noticeable` where the residuals of every arm stay as they were. `course` changes the arm or its
    cell, `readings` what is recorded, `robot` the arm that the analysis has. `condition` is the wrong model
    without which a pass is stated, where it says so.
    """

    name: str
    named: tuple[Named, ...] = ()
    course: Callable[[Course], Course] = lambda course: course
    readings: Callable[[Matrix, Matrix], Readings] = lambda joints, spots: (joints, spots)
    robot: Callable[[Robot], Robot] = lambda robot: robot
    measured: str = "irb1600"
    condition: str = ""
    noticeable: bool = True

    def is_named_by(self, cause: str, joints: tuple[int, ...]) -> bool:
        return any(cause == named and of in ((), joints) for named, of in self.named)


def scenarios() -> tuple[Scenario, ...]:
    """All of them; the first is the control, an arm as the model takes it."""
    return (
        Scenario("control: nothing is wrong"),
        *_of_joints(),
        *_of_robot_file(),
        *_of_tool_and_target(),
        *_of_the_run(),
        *_of_size(),
        *_of_spots(),
    )


# Joint columns


def _of_joints() -> Iterator[Scenario]:
    for i, j in ((1, 2), (2, 3), (4, 6), (5, 6)):
        yield Scenario(
            f"columns of J{i} and J{j} exchanged",
            (("swapped_joints", (i, j)),),
            readings=partial(_swapped, i=i - 1, j=j - 1),
        )
    for i in (1, 3, 5):
        yield Scenario(
            f"sign of J{i} reversed",
            (("sign", (i,)), *((("zero", (4,)),) if i == 5 else ())),
            readings=partial(_reversed, joint=i - 1),
        )
    for i, degrees in ((2, 90.0), (4, 180.0), (3, -30.0)):
        yield Scenario(
            f"zero of J{i} {degrees:g}° off",
            (("zero", (i,)), *((("sign", (5,)),) if degrees == 180 else ())),
            readings=partial(_shifted, joint=i - 1, degrees=degrees),
        )
    yield Scenario(
        "radians in place of degrees", (("units", ()),), readings=_columns(lambda q: np.radians(q))
    )
    yield Scenario(
        "angles converted to degrees twice", (("units", ()),), readings=_columns(lambda q: np.degrees(q))
    )
    yield Scenario(
        "J3 recorded against the horizontal",
        (("coupling", (2, 3)),),
        readings=_coupled,
    )
    yield Scenario(
        "joints of the measurement before",
        (("rows", ()),),
        readings=lambda q, s: (np.roll(q, 1, axis=0), s),
        condition="reading",
    )


def _columns(change: Callable[[Matrix], Matrix]) -> Callable[[Matrix, Matrix], Readings]:
    return lambda joints, spots: (change(joints), spots)


def _swapped(q: Matrix, spots: Matrix, *, i: int, j: int) -> Readings:
    result = q.copy()
    result[:, [i, j]] = q[:, [j, i]]
    return result, spots


def _reversed(q: Matrix, spots: Matrix, *, joint: int) -> Readings:
    return q * np.where(np.arange(q.shape[1]) == joint, -1.0, 1.0), spots


def _shifted(q: Matrix, spots: Matrix, *, joint: int, degrees: float) -> Readings:
    result = q.copy()
    result[:, joint] += np.radians(degrees)
    return result, spots


def _coupled(q: Matrix, spots: Matrix) -> Readings:
    result = q.copy()
    result[:, 2] += q[:, 1]
    return result, spots


# The robot file


def _of_robot_file() -> Iterator[Scenario]:
    for row, joints in ((1, (1, 2)), (4, (4, 5))):
        yield Scenario(
            f"robot file: sign of alpha in row {row}",
            (("twist", joints),),
            robot=partial(_other_row, row=row - 1, column=1, times=-1.0),
        )
    yield Scenario(
        "robot file: rows of standard DH read as modified",
        (("convention", ()),),
        robot=lambda robot: rows_of(robot, lambda rows: rows, "modified"),
    )
    for row in (2, 6):
        yield Scenario(
            f"robot file: theta missing in row {row}",
            (("zero", (row,)),),
            robot=partial(_other_row, row=row - 1, column=3, times=0.0),
        )
    for measured, analysed in (
        ("irb1600", "irb2600"),
        ("irb1600", "irb1200_7_70"),
        ("kr6_r900_2", "kr6_r900"),
        ("irb120", "irb1200"),
    ):
        yield Scenario(
            f"{measured} analysed as {analysed}",
            (("arm", ()),),
            robot=partial(_another_arm, name=analysed),
            measured=measured,
        )
    for row, column, mm in ((2, 0, 1.0), (2, 0, 3.0), (2, 0, -3.0), (4, 2, 3.0), (1, 0, 3.0)):
        letter = "ad"[column // 2]
        yield Scenario(
            f"robot file: {letter} of row {row} {mm:+g} mm",
            (("length", (row,)),),
            robot=partial(_other_row, row=row - 1, column=column, more=mm),
            condition="arm",
        )


def _other_row(robot: Robot, *, row: int, column: int, times: float = 1.0, more: float = 0.0) -> Robot:
    """With one number of a row multiplied, and so much larger."""

    def change(rows: Matrix) -> Matrix:
        result = rows.copy()
        result[row, column] = times * result[row, column] + more
        return result

    return rows_of(robot, change)


def _another_arm(_: Robot, *, name: str) -> Robot:
    return load_robot(name, Path())


def rows_of(
    robot: Robot,
    change: Callable[[Matrix], Matrix],
    convention: Literal["standard", "modified"] = "standard",
) -> Robot:
    """A robot of standard rows a, alpha, d, theta (n, 4), mm and rad, with other rows, or with its rows read
    by another convention."""
    ends = [*(joint.fixed for joint in robot.joints[1:]), robot.flange]
    rows = change(np.array([astuple(row)[:4] for end in ends if (row := as_row(end)) is not None]))
    fixed, flange = dh_chain([DHRow(*row.tolist()) for row in rows], convention)
    return with_fixed(robot, [robot.joints[0].fixed @ fixed[0], *fixed[1:], flange])


# Tool and target


def _of_tool_and_target() -> Iterator[Scenario]:
    for mm in (1.0, 2.0, 5.0):
        yield Scenario(
            f"tool point {mm:g} mm off",
            (("tool", ()),),
            partial(_other_point, mm=mm),
            condition="tool",
        )
    for degrees in (0.1, 0.3, 1.0):
        yield Scenario(
            f"beam tilted by {degrees:g}° across the axis of J6",
            (("tool", ()),),
            _tilted(0.0, degrees),
            condition="beam",
        )
        # The same as an offset of J6: only what is stated of the tool speaks against it.
        yield Scenario(
            f"beam rotated by {degrees:g}° about the axis of J6",
            (),
            _tilted(degrees, 0.0),
            condition="beam",
            noticeable=False,
        )
    for mm in (1.0, 3.0):
        yield Scenario(
            f"PSD moved by {mm:g} mm in mid-run",
            (("moved_target", ()),),
            partial(_moved, mm=mm),
            condition="moved",
        )


def _other_point(course: Course, *, mm: float) -> Course:
    return replace(course, point=course.point + np.array([0.0, mm, 0.0]))


def _moved(course: Course, *, mm: float) -> Course:
    shift = np.array([0.48, 0.64, -0.6]) * mm
    return replace(course, target=course.target + _late(course)[:, None] * shift)


def _tilted(about: float, across: float) -> Callable[[Course], Course]:
    tilt = np.array([0.0, np.radians(about), np.radians(across)])
    return lambda course: replace(course, direction=_normal(course.direction + tilt))


def _normal(vectors: Matrix) -> Matrix:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _late(course: Course) -> Matrix:
    """(N,) 1 in the second half."""
    return np.asarray((np.arange(course.measurements) >= course.measurements // 2) * 1.0)


def _passed(course: Course) -> Matrix:
    """(N,) 0 at the first measurement, 1 at the last."""
    return np.linspace(0.0, 1.0, course.measurements)


# What changes during a run


def _of_the_run() -> Iterator[Scenario]:
    for i in (2, 3, 5):
        for degrees in (0.1, 0.2, 0.5):
            yield Scenario(
                f"zero of J{i} jumps by {degrees:g}°",
                (("jump", (i,)),),
                partial(_jumping, joint=i, degrees=degrees),
                condition="jump",
            )
    yield Scenario(
        "zero of J2 drifts by 0.1°",
        (("drift", (2,)),),
        lambda course: replace(
            course, offsets=course.offsets + _passed(course)[:, None] * _joint(course, 2, 0.1)
        ),
        condition="drift",
    )
    yield Scenario(
        "PSD drifts by 2 mm",
        (("drift", ()),),
        lambda course: replace(
            course, target=course.target + _passed(course)[:, None] * np.array([0.96, 1.28, -1.2])
        ),
        condition="moved",
    )
    yield Scenario(
        "link 2 grows by 0.5 mm",
        (),
        lambda course: replace(
            course, links=course.links + _passed(course)[:, None] * _link(course, "link2", "a", 0.5)
        ),
        condition="arm",
    )
    yield Scenario(
        "joints read 0.1 % of the way early", (("lag", ()),), readings=_early(0.001), condition="reading"
    )
    for mm in (1.0, 5.0):
        yield Scenario(
            f"one spot {mm:g} mm off",
            (("measurements", ()),),
            readings=partial(_off, mm=mm),
            condition="reading",
        )
    yield Scenario(
        "one joint reading 0.5° off",
        (("measurements", ()),),
        readings=lambda q, s: (q + (np.arange(len(q)) == 2)[:, None] * _unit(q, 2, 0.5), s),
        condition="reading",
    )


def _jumping(course: Course, *, joint: int, degrees: float) -> Course:
    return replace(course, offsets=course.offsets + _late(course)[:, None] * _joint(course, joint, degrees))


def _off(q: Matrix, spots: Matrix, *, mm: float) -> Readings:
    """A spot of one measurement."""
    off = np.arange(len(spots)) == len(spots) // 3
    return q, spots + off[:, None] * np.array([0.8, 0.6]) * mm


def _early(share: float) -> Callable[[Matrix, Matrix], Readings]:
    def readings(joints: Matrix, spots: Matrix) -> Readings:
        return joints - share * np.diff(joints, axis=0, prepend=joints[:1]), spots

    return readings


def _unit(q: Matrix, joint: int, degrees: float) -> Matrix:
    return np.asarray((np.arange(q.shape[1]) == joint - 1) * np.radians(degrees))


def _joint(course: Course, joint: int, degrees: float) -> Matrix:
    return _unit(course.offsets, joint, degrees)


def _link(course: Course, of: str, axis: str, value: float) -> Matrix:
    names = [item for item in course.geometry.names if item[0].startswith("link")]
    return np.array([value if item == (of, axis) else 0.0 for item in names])


# What is larger than stated


def _of_size() -> Iterator[Scenario]:
    for degrees in (0.03, 0.05, 0.1):
        yield Scenario(
            f"backlash {degrees:g}°",
            (("backlash", ()),),
            partial(_loose, degrees=degrees),
            condition="backlash",
        )
    for times in (2.0, 3.0, 5.0):
        yield Scenario(
            f"noise {times:g} times the stated",
            (("noise", ()),),
            partial(_noisy, times=times),
            condition="noise",
        )
    yield Scenario(
        "gravity 3 times typical",
        (("gravity", ()), ("geometry", ())),
        lambda course: replace(course, gravity=3 * course.gravity),
        condition="arm",
    )
    yield Scenario(
        "harmonics 3 times typical",
        (("harmonics", ()), ("geometry", ())),
        lambda course: replace(course, harmonics=3 * course.harmonics),
        condition="arm",
    )
    yield Scenario(
        "links 3 times typical",
        (("geometry", ()),),
        lambda course: replace(course, links=3 * course.links),
        condition="arm",
    )
    yield Scenario(
        "gain of J2 0.1 % off",
        (("gain", (2,)),),
        lambda course: replace(course, gain=course.gain + _unit(course.gain, 2, np.degrees(1e-3))),
        condition="arm",
    )
    yield Scenario(
        "second harmonic of J2 0.02°",
        (),
        lambda course: replace(course, second=course.second + _joint(course, 2, 0.02)),
        condition="arm",
    )
    yield Scenario(
        "arm tilted by 5° against gravity",
        (),
        lambda course: replace(course, up=np.array([np.sin(np.radians(5)), 0.0, np.cos(np.radians(5))])),
        condition="arm",
    )


def _loose(course: Course, *, degrees: float) -> Course:
    return replace(course, backlash=np.full(course.robot.n, np.radians(degrees)))


def _noisy(course: Course, *, times: float) -> Course:
    return replace(course, noise=times)


# The axes of the spots


def _of_spots() -> Iterator[Scenario]:
    for name, matrix in (
        ("spot axes exchanged", [[0, 1], [1, 0]]),
        ("spot axes turned by 90°", [[0, -1], [1, 0]]),
        ("spot in place of the target", [[-1, 0], [0, -1]]),
        ("first spot axis reversed", [[-1, 0], [0, 1]]),
    ):
        yield Scenario(
            name, (("spot", ()),), readings=partial(_other_axes, axes=np.array(matrix)), condition="reading"
        )
    yield Scenario("spots 10 % too large", (), readings=lambda q, s: (q, 1.1 * s), condition="reading")


def _other_axes(q: Matrix, spots: Matrix, *, axes: Matrix) -> Readings:
    return q, spots @ axes.T
