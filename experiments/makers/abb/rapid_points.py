"""ABB: jointtargets and robtargets that are declared in a RAPID module.

The joints of a robtarget are those by which the nominal arm, as its controller has it, reaches the pose."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ....model.arrays import Matrix
from ....model.errors import BadInput, located
from ....model.kinematics.branches import Branches, is_abb_configuration
from ....model.kinematics.inverse import Solver
from ....model.kinematics.orientation import from_quaternion, stated_numbers
from ....model.kinematics.pendant import pendant_of
from ....model.kinematics.robot import Robot
from ....model.parsing.reading import line_numbers, shown
from ...positions.arm_change import up_to_flange
from ..import_jobs import Imported, ImportJob, TaughtPoint, import_points
from ..joint_text import PLAN_LINE, required_plan
from ..maker import blanked

_UNUSED = 9e9


@dataclass(frozen=True, eq=False)
class Robtargets:
    """Joints of robtargets of a `tool` (as seen from the flange) in a `frame` (as seen from the base)."""

    robot: Robot
    tool: Matrix
    frame: Matrix

    @cached_property
    def _solver(self) -> Solver:
        return Solver(up_to_flange(self.robot, self.robot))

    @cached_property
    def _branches(self) -> Branches:
        branches = Branches(self.robot, 1)
        if not branches.exist:
            raise BadInput(
                "robtargets are read for six-axis arms with a spherical wrist",
                found=self.robot.name,
                remedy="use jointtargets",
            )
        return branches

    def joints(self, values: Sequence[float], name: str) -> tuple[float, ...]:
        """Degrees; BadInput unless exactly one set of joints has the stated configuration."""
        if any(value not in (0.0, _UNUSED) for value in values[11:]):
            raise BadInput(f"{name} has positions of external axes, which may carry the robot or the work")
        flange = self.frame @ from_quaternion(values[:7]) @ np.linalg.inv(self.tool)
        configuration = tuple(values[7:11])
        rows = [
            row * self.robot.display
            for thorough in (False, True)
            for solution in self._solver.solutions(flange, thorough=thorough)
            for row in self._solver.with_turns(solution)
        ]
        rows = [row for row in rows if is_abb_configuration(configuration, self._branches.of(row), row)]
        if not rows or any(np.abs(row - rows[0]).max() > 1e-2 for row in rows):
            count = "several" if rows else "no"
            raise BadInput(
                f"{name} does not say what the joints are",
                found=f"{count} sets of joints within the limits have its pose and the configuration"
                f" [{','.join(f'{value:g}' for value in configuration)}]",
                remedy="state the right --tool and --frame, or save the point as a jointtarget",
            )
        return tuple(rows[0].tolist())


# CONST jointtarget p1:=[[rax_1,…,rax_6],[eax_a,…,eax_f]]; an array has its size in braces.
DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(?P<kind>jointtarget|robtarget|tooldata|wobjdata)\s+(?P<name>[A-Za-z]\w*)\s*"
    r"(?P<sizes>\{[\d\s,]*\})?\s*:=(?P<value>[^;]*);",
    re.IGNORECASE,
)
REMARK = r"![^\n]*"
_NUMBERS = re.compile(r"[\[\]\s,0-9eE+.\-]*")
_AXES = 6
_LARGEST = 1e10  # mm, deg: 9E9 stands for an axis that there is not

# From the numbers of a robtarget and its name to its joints, degrees.
Posed = Callable[[Sequence[float], str], tuple[float, ...]]


def import_rapid(
    job: ImportJob,
    *,
    points: Sequence[str] | None = None,
    tool: str | None = None,
    frame: str | None = None,
) -> Imported:
    """Measurements at the jointtargets of RAPID modules; `points` are the names of those to use.

    An element of an array has the name `name{2}`. External axes are ignored. Where the `tool` is stated, as
    seen from the flange (X,Y,Z,Q1,Q2,Q3,Q4), robtargets have the joints by which the nominal arm reaches them
    with their configuration, in the work object `frame` or wobj0.
    """
    note = "RAPID jointtargets, angles in degrees, rax_1 first, external axes ignored"
    posed: Posed | None = None
    if tool is not None:
        frames = _pose(tool, "--tool"), np.eye(4) if frame is None else _pose(frame, "--frame")
        solver, pendant = Robtargets(job.robot, *frames), pendant_of(job.robot)
        note += (
            f"; robtargets by inverse kinematics of the nominal arm, tool {tool}, frame {frame or 'wobj0'}"
        )

        def posed(numbers: Sequence[float], name: str) -> tuple[float, ...]:
            return tuple(pendant.counted(np.array(solver.joints(numbers, name))).tolist())

    elif frame is not None:
        raise BadInput("--frame is of robtargets, and these need their tool", remedy="state --tool too")

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        if points is None and PLAN_LINE.search(text):
            required_plan(job, path)
        return rapid_positions(text, path, posed, points)

    return import_points(
        job,
        parse,
        names=points,
        note=note,
    )


def _pose(text: str, option: str) -> Matrix:
    return from_quaternion(stated_numbers(text, 7, option, "X,Y,Z,Q1,Q2,Q3,Q4"))


def rapid_positions(
    text: str, path: Path, posed: Posed | None = None, names: Sequence[str] | None = None
) -> list[TaughtPoint]:
    """All declared jointtargets and robtargets of a module, in its order.

    A robtarget has the joints that `posed` gives, if its name is among `names` (None: any), else none.
    """

    def joints(value: object, name: str) -> tuple[float, ...] | None:
        if not cartesian:
            return _axes(value, name)
        if posed is None or (names is not None and name not in names):
            return None
        return posed(_robtarget(value, name), name)

    bare = blanked(text, REMARK)
    line_of = line_numbers(bare)
    points: list[TaughtPoint] = []
    for match in DECLARED.finditer(bare):
        if match["kind"].lower() not in ("jointtarget", "robtarget"):
            continue
        line = line_of(match.start("name"))
        name, cartesian = match["name"], match["kind"].lower() == "robtarget"
        with located(path, line):
            values = _values(match["value"], name)
            if match["sizes"] is None:
                points.append(TaughtPoint(name, joints(values, name), line))
                continue
            if "," in match["sizes"] or not isinstance(values, list):
                raise _unreadable(name, match["value"])
            for i, element in enumerate(values, start=1):
                element_name = f"{name}{{{i}}}"
                points.append(TaughtPoint(element_name, joints(element, element_name), line))
    return points


def _values(text: str, name: str) -> object:
    if _NUMBERS.fullmatch(text):
        try:
            value: object = ast.literal_eval(text.strip())
        except (ValueError, SyntaxError, RecursionError, MemoryError):
            pass
        else:
            return value
    raise _unreadable(name, text)


def _axes(value: object, name: str) -> tuple[float, ...]:
    if isinstance(value, list) and len(value) == 2 and isinstance(value[0], list):
        axes = value[0]
        if len(axes) == _AXES and _usable(axes):
            return tuple(float(axis) for axis in axes)
    raise _unreadable(name, str(value))


def _robtarget(value: object, name: str) -> list[float]:
    """The numbers of [[x,y,z],[q1,…,q4],[cf1,cf4,cf6,cfx],[eax_a,…,eax_f]]."""
    if isinstance(value, list) and [len(part) for part in value if isinstance(part, list)] == [3, 4, 4, 6]:
        numbers = [number for part in value for number in part]
        if _usable(numbers) and any(numbers[3:7]):
            return [float(number) for number in numbers]
    form = "[[x,y,z],[q1,…,q4],[cf1,cf4,cf6,cfx],[eax_a,…,eax_f]], in numbers"
    raise _unreadable(name, str(value), form)


def _usable(values: Sequence[object]) -> bool:
    return all(isinstance(value, int | float) and abs(value) <= _LARGEST for value in values)


def _unreadable(
    name: str, text: str, form: str = "[[rax_1,…,rax_6],[eax_a,…,eax_f]], in numbers"
) -> BadInput:
    axes = shown(" ".join(text.split())[:80])
    return BadInput(f"the axes of {name} cannot be read", found=axes, allowed=form)
