"""The wrong models of the study: what is wrong with an arm, a cell, a recording or a robot file, and by which
cause a diagnosis may name it."""

from __future__ import annotations

from collections.abc import Callable
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
    nothing = Scenario("control: nothing is wrong")
    return (nothing, *_of_joints(), *_of_robot_file(), *_of_cell(), *_of_the_run(), *_of_size(), *_of_spots())


def _of_joints() -> list[Scenario]:
    """What is wrong with the columns of joints."""

    def columns(
        name: str, change: Callable[[Matrix], Matrix], *named: Named, condition: str = ""
    ) -> Scenario:
        def readings(joints: Matrix, spots: Matrix) -> Readings:
            return change(joints), spots

        return Scenario(name, named, readings=readings, condition=condition)

    def swapped(i: int, j: int) -> Scenario:
        order = [{i: j, j: i}.get(k, k) - 1 for k in range(1, 7)]
        name = f"columns of J{i} and J{j} exchanged"
        return columns(name, lambda q: q[:, order], ("swapped_joints", (i, j)))

    def reversed_sign(i: int, *more: Named) -> Scenario:
        signs = np.where(np.arange(6) == i - 1, -1.0, 1.0)
        return columns(f"sign of J{i} reversed", lambda q: q * signs, ("sign", (i,)), *more)

    def shifted(i: int, degrees: float, *more: Named) -> Scenario:
        name = f"zero of J{i} {degrees:g}° off"
        return columns(name, lambda q: q + _joint(i, degrees), ("zero", (i,)), *more)

    return [
        *(swapped(i, j) for i, j in ((1, 2), (2, 3), (4, 6), (5, 6))),
        *(reversed_sign(1), reversed_sign(3), reversed_sign(5, ("zero", (4,)))),
        *(shifted(2, 90.0), shifted(4, 180.0, ("sign", (5,))), shifted(3, -30.0)),
        columns("radians in place of degrees", np.radians, ("units", ())),
        columns("angles converted to degrees twice", np.degrees, ("units", ())),
        columns(
            "J3 recorded against the horizontal",
            lambda q: q + np.eye(6)[2] * q[:, 1:2],
            ("coupling", (2, 3)),
        ),
        columns(
            "joints of the measurement before",
            lambda q: np.roll(q, 1, axis=0),
            ("rows", ()),
            condition="reading",
        ),
    ]


def _of_robot_file() -> list[Scenario]:
    def other_row(row: int, column: int, times: float = 1.0, more: float = 0.0) -> Callable[[Robot], Robot]:
        """With one number of a row multiplied, and so much larger."""

        def change(rows: Matrix) -> Matrix:
            result = rows.copy()
            result[row - 1, column] = times * result[row - 1, column] + more
            return result

        return lambda robot: rows_of(robot, change)

    def modified(robot: Robot) -> Robot:
        return rows_of(robot, lambda rows: rows, "modified")

    file = "robot file: "
    answer = [
        Scenario(f"{file}sign of alpha in row {row}", (("twist", joints),), robot=other_row(row, 1, -1.0))
        for row, joints in ((1, (1, 2)), (4, (4, 5)))
    ]
    answer.append(
        Scenario(f"{file}rows of standard DH read as modified", (("convention", ()),), robot=modified)
    )
    for row in (2, 6):
        robot = other_row(row, 3, 0.0)
        answer.append(Scenario(f"{file}theta missing in row {row}", (("zero", (row,)),), robot=robot))
    for measured, analysed in (
        ("irb1600", "irb2600"),
        ("irb1600", "irb1200_7_70"),
        ("kr6_r900_2", "kr6_r900"),
        ("irb120", "irb1200"),
    ):
        name, other = f"{measured} analysed as {analysed}", partial(_another_arm, name=analysed)
        answer.append(Scenario(name, (("arm", ()),), robot=other, measured=measured))
    for row, letter, mm in ((2, "a", 1.0), (2, "a", 3.0), (2, "a", -3.0), (4, "d", 3.0), (1, "a", 3.0)):
        robot, name = (
            other_row(row, 2 * "ad".index(letter), 1.0, mm),
            f"{file}{letter} of row {row} {mm:+g} mm",
        )
        answer.append(Scenario(name, (("length", (row,)),), robot=robot, condition="arm"))
    return answer


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


def _of_cell() -> list[Scenario]:
    """What is wrong with tool and target."""

    def tilted(about: float, across: float) -> Callable[[Course], Course]:
        tilt = np.array([0.0, np.radians(about), np.radians(across)])

        def course(course: Course) -> Course:
            beams = course.direction + tilt
            return replace(course, direction=beams / np.linalg.norm(beams, axis=1)[:, None])

        return course

    tool = (("tool", ()),)
    answer = []
    for mm in (1.0, 2.0, 5.0):
        off = _more("point", np.array([0.0, mm, 0.0]))
        answer.append(Scenario(f"TCP {mm:g} mm off", tool, off, condition="tool"))
    for degrees in (0.1, 0.3, 1.0):
        name = f"beam tilted by {degrees:g}° across the axis of J6"
        answer.append(Scenario(name, tool, tilted(0.0, degrees), condition="beam"))
        # The same as an offset of J6: only what is stated of the tool speaks against it.
        name = f"beam rotated by {degrees:g}° about the axis of J6"
        answer.append(Scenario(name, (), tilted(degrees, 0.0), condition="beam", noticeable=False))
    for mm in (1.0, 3.0):
        moved = _more("target", np.array([0.48, 0.64, -0.6]) * mm, _late)
        name = f"PSD moved by {mm:g} mm in mid-run"
        answer.append(Scenario(name, (("moved_target", ()),), moved, condition="moved"))
    return answer


def _of_the_run() -> list[Scenario]:
    """What changes during a run."""

    def off(mm: float) -> Callable[[Matrix, Matrix], Readings]:
        """A spot of one measurement."""
        return lambda q, spots: (q, spots + _only(spots, len(spots) // 3) * np.array([0.8, 0.6]) * mm)

    def early(q: Matrix, spots: Matrix) -> Readings:
        return q - 0.001 * np.diff(q, axis=0, prepend=q[:1]), spots

    answer = []
    for i in (2, 3, 5):
        for degrees in (0.1, 0.2, 0.5):
            jump = _more("offsets", _joint(i, degrees), _late)
            name = f"zero of J{i} jumps by {degrees:g}°"
            answer.append(Scenario(name, (("jump", (i,)),), jump, condition="jump"))
    drifting = _more("offsets", _joint(2, 0.1), _passed)
    drift = _more("target", np.array([0.96, 1.28, -1.2]), _passed)
    growing = _more("links", lambda course: _link(course, "link2", "a", 0.5), _passed)
    one = (("measurements", ()),)
    return [
        *answer,
        Scenario("zero of J2 drifts by 0.1°", (("drift", (2,)),), drifting, condition="drift"),
        Scenario("PSD drifts by 2 mm", (("drift", ()),), drift, condition="moved"),
        Scenario("link 2 grows by 0.5 mm", (), growing, condition="arm"),
        Scenario("joints read 0.1 % of the way early", (("lag", ()),), readings=early, condition="reading"),
        *(
            Scenario(f"one spot {mm:g} mm off", one, readings=off(mm), condition="reading")
            for mm in (1.0, 5.0)
        ),
        Scenario(
            "one joint reading 0.5° off",
            one,
            readings=lambda q, s: (q + _only(q, 2) * _joint(2, 0.5), s),
            condition="reading",
        ),
    ]


def _of_size() -> list[Scenario]:
    """What is larger than stated."""

    def loose(degrees: float) -> Callable[[Course], Course]:
        return lambda course: replace(course, backlash=np.full(course.robot.n, np.radians(degrees)))

    def noisy(times: float) -> Callable[[Course], Course]:
        return lambda course: replace(course, noise=times)

    def three(name: str) -> Callable[[Course], Course]:
        return lambda course: replace(course, **{name: 3 * getattr(course, name)})

    def tilted(course: Course) -> Course:
        return replace(course, up=np.array([np.sin(np.radians(5)), 0.0, np.cos(np.radians(5))]))

    gain = _more("gain", _joint(2, np.degrees(1e-3)))
    second = _more("second", _joint(2, 0.02))
    geometry: Named = ("geometry", ())
    sizes: list[tuple[str, tuple[Named, ...]]] = [
        ("gravity", (("gravity", ()), geometry)),
        ("harmonics", (("harmonics", ()), geometry)),
        ("links", (geometry,)),
    ]
    return [
        *(
            Scenario(f"backlash {by:g}°", (("backlash", ()),), loose(by), condition="backlash")
            for by in (0.03, 0.05, 0.1)
        ),
        *(
            Scenario(f"noise {by:g} times the stated", (("noise", ()),), noisy(by), condition="noise")
            for by in (2.0, 3.0, 5.0)
        ),
        *(Scenario(f"{name} 3 times typical", named, three(name), condition="arm") for name, named in sizes),
        Scenario("gain of J2 0.1 % off", (("gain", (2,)),), gain, condition="arm"),
        Scenario("second harmonic of J2 0.02°", (), second, condition="arm"),
        Scenario("arm tilted by 5° against gravity", (), tilted, condition="arm"),
    ]


def _of_spots() -> list[Scenario]:
    """What is wrong with the axes of the spots."""

    def axes(name: str, matrix: list[list[float]], *named: Named) -> Scenario:
        turned = np.array(matrix).T
        return Scenario(name, named, readings=lambda q, spots: (q, spots @ turned), condition="reading")

    spot: Named = ("spot", ())
    return [
        axes("spot axes exchanged", [[0, 1], [1, 0]], spot),
        axes("spot axes rotated by 90°", [[0, -1], [1, 0]], spot),
        axes("spot in place of the target", [[-1, 0], [0, -1]], spot),
        axes("first spot axis reversed", [[-1, 0], [0, 1]], spot),
        axes("spots 10 % too large", [[1.1, 0], [0, 1.1]]),
    ]


def _more(
    name: str,
    by: Matrix | Callable[[Course], Matrix],
    when: Callable[[Course], Matrix | float] = lambda _: 1.0,
) -> Callable[[Course], Course]:
    """A course of which something is so much larger, at each measurement by that share."""

    def course(course: Course) -> Course:
        more = when(course) * (by(course) if callable(by) else by)
        return replace(course, **{name: getattr(course, name) + more})

    return course


def _late(course: Course) -> Matrix:
    """(N, 1) 1 in the second half."""
    return np.asarray((np.arange(course.measurements) >= course.measurements // 2) * 1.0)[:, None]


def _passed(course: Course) -> Matrix:
    """(N, 1) 0 at the first measurement, 1 at the last."""
    return np.linspace(0.0, 1.0, course.measurements)[:, None]


def _only(values: Matrix, row: int) -> Matrix:
    """(N, 1) 1 in one row."""
    return np.asarray(np.arange(len(values)) == row)[:, None]


def _joint(joint: int, degrees: float) -> Matrix:
    """(6,) rad of one joint."""
    return np.asarray((np.arange(6) == joint - 1) * np.radians(degrees))


def _link(course: Course, of: str, axis: str, value: float) -> Matrix:
    names = [item for item in course.geometry.names if item[0].startswith("link")]
    return np.array([value if item == (of, axis) else 0.0 for item in names])
