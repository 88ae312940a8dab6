"""Positions of programs in a language of lines, taught or recorded, as measurements."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...model.errors import BadInput, located
from ...model.files.plan import Plan
from ...model.kinematics.pendant import Pendant
from ...model.kinematics.robot import Robot
from ...model.parsing.reading import line_numbers
from .import_jobs import Imported, ImportJob, TaughtPoint, import_points
from .joint_text import require_same_plan, required_plan
from .line_language import FOLLOW, LineLanguage, capitals, is_a_pose, span, tokens

# Of a plan's program: planned, measured, via.
POSTURE = re.compile(r"[#j]?zb_([pmv])(\d+)(?:_\d+)?", re.IGNORECASE)


def taught_points(language: LineLanguage, text: str, robot: Robot, path: Path) -> list[TaughtPoint]:
    """All positions of a program, as `written_points`. Joints are degrees as the controller counts them."""
    per_degree = Pendant(robot).per_degree(language.unit)

    def in_degrees(point: TaughtPoint) -> TaughtPoint:
        if point.joints is None:
            return point
        numbers = np.array(point.joints)
        numbers[: robot.n] /= per_degree[: len(numbers)]
        return point._replace(joints=tuple(numbers.tolist()))

    return [in_degrees(point) for point in written_points(language, text, path)]


def written_points(language: LineLanguage, text: str, path: Path) -> list[TaughtPoint]:
    """All positions of a program, in its order: those that have a name, and those in motions ("line 12").

    Joints are in the unit of the language. BadInput for what looks like joints or a pose and is not
    understood.
    """
    points, spans, line_of = [], set(), line_numbers(text)
    joints_follow: bool | None = None
    for begin, _, tree in language.statements(text):
        if tree is None:
            continue
        line = line_of(begin)
        if tree.data in FOLLOW:
            joints_follow = FOLLOW[tree.data]
        kinds = ("position", "entry", "at", "tool", "frame", "definition")
        for part in (each for each in reversed([*tree.iter_subtrees()]) if each.data in kinds):
            values = tokens(part, "VALUE")
            if not values:
                continue
            spans.add((span(values[0])[0], span(values[-1])[1]))
            if part.data in ("tool", "frame", "definition"):
                continue
            names = tokens(part, "NAME")
            is_pose = is_a_pose(part, joints_follow)
            if is_pose is None and POSTURE.fullmatch(str(names[0])):
                is_pose = False
            joints = tuple(float(value) for value in values) if is_pose is False else None
            name = f"line {line}"
            if names:
                written = text[slice(*span(names[0]))]
                name = written if capitals(written) == capitals(names[0]) else str(names[0])
            points.append(TaughtPoint(name, joints, line))
    for begin, end in language.literals(text):
        if (begin, end) not in spans:
            raise BadInput(
                "a position of the program is not understood",
                found=" ".join(text[begin:end].split())[:60],
                remedy="save the program as text again, or import the positions as csv",
                file=path,
                line=line_of(begin),
            )
    return points


def named_by_remarks(
    points: Sequence[TaughtPoint], labels: Sequence[tuple[str, str]], order: Sequence[str], kind: str
) -> list[TaughtPoint]:
    """The positions of a plan's program, a program in `kind`, in a language whose positions have no names.

    `labels` are the names that remarks give, each with the position's, in the text's order; `order` are those
    of the positions. BadInput where the remarks do not name all of them one after the other.
    """
    names = {position: name for name, position in labels}
    places = [
        (int(number), name.startswith("zb_p"), int(between or 0))
        for name in names.values()
        for number, between in re.findall(r"^zb_[pv](\d+)(?:_(\d+))?$", name)
    ]
    if list(names) != list(order) or len(places) < len(labels) or places != sorted({*places}):
        raise BadInput(
            "the remarks of the plan's program do not name its positions one after the other",
            found=f"{len(points)} positions, {len(labels)} remarks above motions",
            allowed="the program as it was written, with its positions modified",
            remedy=f"write the program again (zerobeam export plan {kind}), and modify its positions only",
        )
    return [point._replace(name=names[point.name]) for point in points]


def import_taught(
    language: LineLanguage,
    job: ImportJob,
    *,
    points: Sequence[str] | None,
    vendor: str,
    note: str,
    named: Callable[[str, list[TaughtPoint]], list[TaughtPoint]] = lambda text, taught: taught,
) -> Imported:
    """Measurements at the positions of programs that were taught, or of a plan's program: what it recorded
    (zb_m0, zb_m1, …), or its postures (zb_p0, …) where they were taught again with the beam on the target.

    `named` gives the positions of a text these names, in a language whose positions have numbers. Postures
    that are still as the plan has them are left out; BadInput for the program of another plan.
    """

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        with located(path):
            for number, content in enumerate(text.split("\n"), start=1):
                with located(path, number):
                    require_same_plan(content, job)
        taught = named(text, taught_points(language, text, job.robot, path))
        ours = [(point, match) for point in taught if (match := POSTURE.fullmatch(point.name))]
        if points is not None or not ours:
            return taught
        plan = required_plan(job, path)
        recorded = "m" if any(match[1] in "mM" for _, match in ours) else "p"
        numbers = {int(match[2]) for _, match in ours if match[1].lower() == recorded}
        missing = set(range(len(plan.postures))) - numbers
        if missing:  # a plan's program has all of them, whether they were recorded or not
            raise BadInput(
                "a posture of the plan is not in the file",
                found=f"no zb_{recorded}{min(missing)}",
                remedy="save or copy the whole file again; or name the positions to use (--points)",
            )
        measured = [
            point._replace(number=int(match[2]))
            for point, match in ours
            if match[1].lower() == recorded and not _as_planned(language, plan, point, int(match[2]))
        ]
        if not measured:
            raise BadInput(
                "no measurements found: every position is still as the plan has it",
                file=path,
                remedy="record the positions at the controller with the beam on the centre, save the program"
                " there, and import the saved file",
            )
        return measured

    return import_points(job, parse, names=points, vendor=vendor, note=note)


def _as_planned(language: LineLanguage, plan: Plan, point: TaughtPoint, number: int) -> bool:
    """Whether a posture of the plan's program is still as the plan has it, to the program's digits."""
    if point.joints is None or not number < len(plan.postures):
        return False
    if len(point.joints) < plan.robot.n:
        return False
    pendant = Pendant(plan.robot)
    planned = pendant.counted(plan.postures[number] * plan.robot.display)
    decimals = language.joint_decimals if language.saved_decimals is None else language.saved_decimals
    digits = 10.0**-decimals / np.abs(pendant.per_degree(language.unit))
    return bool((np.abs(np.array(point.joints[: plan.robot.n]) - planned) <= digits).all())
