"""ABB: jointtargets and robtargets that are declared in a RAPID module."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.reading import shown
from ...model.kinematics.orientation import from_quaternion, stated_numbers
from .imported import Imported, Job, Stated
from .robtargets import Robtargets
from .taught import Point, import_points

# CONST jointtarget p1:=[[rax_1,…,rax_6],[eax_a,…,eax_f]]; an array has its size in braces.
DECLARED = re.compile(
    r"\b(?:CONST|PERS|VAR)\s+(?P<kind>jointtarget|robtarget|tooldata|wobjdata)\s+(?P<name>[A-Za-z]\w*)\s*"
    r"(?P<sizes>\{[\d\s,]*\})?\s*:=(?P<value>[^;]*);",
    re.IGNORECASE,
)
_TEXT = re.compile(r'"[^"\n]*"|![^\n]*')  # strings and comments
_NUMBERS = re.compile(r"[\[\]\s,0-9eE+.\-]*")
_AXES = 6
_LARGEST = 1e10  # mm, deg: 9E9 stands for an axis that there is not

# From the numbers of a robtarget, its name, file and line to its joints, degrees.
Posed = Callable[[Sequence[float], str, Path, int], tuple[float, ...]]


def import_rapid(
    files: Sequence[Path | str],
    target_names: Sequence[str],
    stated: Stated,
    out: Path | str,
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
        job = Job.begin(files, stated)
        frames = _pose(tool, "--tool"), np.eye(4) if frame is None else _pose(frame, "--frame")
        solver, pendant = Robtargets(job.robot, *frames), job.pendant()
        note += (
            f"; robtargets by inverse kinematics of the nominal arm, tool {tool}, frame {frame or 'wobj0'}"
        )

        def posed(numbers: Sequence[float], name: str, path: Path, line: int) -> tuple[float, ...]:
            return tuple(pendant.counted(np.array(solver.joints(numbers, name, path, line))).tolist())

    elif frame is not None:
        raise BadInput("--frame is of robtargets, and these need their tool", remedy="state --tool too")
    return import_points(
        files,
        target_names,
        lambda text, path: rapid_positions(text, path, posed, points),
        stated,
        out,
        names=points,
        note=note,
    )


def _pose(text: str, option: str) -> Matrix:
    return from_quaternion(stated_numbers(text, 7, option, "X,Y,Z,Q1,Q2,Q3,Q4"))


def rapid_positions(
    text: str, path: Path, posed: Posed | None = None, names: Sequence[str] | None = None
) -> list[Point]:
    """All declared jointtargets and robtargets of a module, in its order.

    A robtarget has the joints that `posed` gives, if its name is among `names` (None: any), else none.
    """

    def joints(value: object, name: str, line: int) -> tuple[float, ...] | None:
        if not cartesian:
            return _axes(value, name, path, line)
        if posed is None or (names is not None and name not in names):
            return None
        return posed(_robtarget(value, name, path, line), name, path, line)

    bare = without_text(text)
    found: list[Point] = []
    for match in DECLARED.finditer(bare):
        if match["kind"].lower() not in ("jointtarget", "robtarget"):
            continue
        line = bare.count("\n", 0, match.start("name")) + 1
        name, cartesian = match["name"], match["kind"].lower() == "robtarget"
        values = _values(match["value"], name, path, line)
        if match["sizes"] is None:
            found.append(Point(name, joints(values, name, line), line))
            continue
        if "," in match["sizes"] or not isinstance(values, list):
            raise _unreadable(name, match["value"], path, line)
        for i, element in enumerate(values, start=1):
            own = f"{name}{{{i}}}"
            found.append(Point(own, joints(element, own, line), line))
    return found


def without_text(text: str) -> str:
    """The program with blanks for its strings and comments."""
    return _TEXT.sub(lambda found: " " * len(found[0]), text)


def _values(text: str, name: str, path: Path, line: int) -> object:
    if _NUMBERS.fullmatch(text):
        try:
            value: object = ast.literal_eval(text.strip())
        except (ValueError, SyntaxError, RecursionError, MemoryError):
            pass
        else:
            return value
    raise _unreadable(name, text, path, line)


def _axes(value: object, name: str, path: Path, line: int) -> tuple[float, ...]:
    if isinstance(value, list) and len(value) == 2 and isinstance(value[0], list):
        axes = value[0]
        if len(axes) == _AXES and _usable(axes):
            return tuple(float(axis) for axis in axes)
    raise _unreadable(name, str(value), path, line)


def _robtarget(value: object, name: str, path: Path, line: int) -> list[float]:
    """The numbers of [[x,y,z],[q1,…,q4],[cf1,cf4,cf6,cfx],[eax_a,…,eax_f]]."""
    if isinstance(value, list) and [len(part) for part in value if isinstance(part, list)] == [3, 4, 4, 6]:
        numbers = [number for part in value for number in part]
        if _usable(numbers) and any(numbers[3:7]):
            return [float(number) for number in numbers]
    raise _unreadable(
        name, str(value), path, line, "[[x,y,z],[q1,…,q4],[cf1,cf4,cf6,cfx],[eax_a,…,eax_f]], in numbers"
    )


def _usable(values: Sequence[object]) -> bool:
    return all(isinstance(value, int | float) and abs(value) <= _LARGEST for value in values)


def _unreadable(
    name: str, text: str, path: Path, line: int, form: str = "[[rax_1,…,rax_6],[eax_a,…,eax_f]], in numbers"
) -> BadInput:
    return BadInput(
        f"the axes of {name} cannot be read",
        found=shown(" ".join(text.split())[:80]),
        allowed=form,
        file=path,
        line=line,
    )
