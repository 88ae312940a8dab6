"""Positions of programs, taught or recorded, as measurements: of the readers in `experiments/positions`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput, located
from ...model.files.plan import Plan
from ...model.kinematics.pendant import Pendant
from ..positions.position import BackupReading, JointLanguage, SourceFile, TaughtPosition
from .import_jobs import Imported, ImportJob, TaughtPoint, import_points
from .joint_text import require_same_plan, required_plan

# Of a plan's program: planned, measured, via.
POSTURE = re.compile(r"[#j]?zb_([pmv])(\d+)(?:_\d+)?", re.IGNORECASE)
Named = Callable[[str, list[TaughtPoint]], list[TaughtPoint]]


def written_points(
    language: JointLanguage,
    text: str,
    path: Path,
    posed: Callable[[TaughtPosition], tuple[float, ...] | None] = lambda one: None,
) -> list[TaughtPoint]:
    """All positions of a program, in its order: those that have a name, and those in motions ("line 12").

    Joints are in the unit of the language; a pose has those that `posed` gives. BadInput where the text is
    not whole.
    """
    name = path.name if path.suffix.lower() in language.endings else f"{path.name}{language.endings[0]}"
    reading = BackupReading([SourceFile(name, text, language.remark)])
    language.read(reading)
    points = []
    for one in reading.positions:
        joints = one.values if one.kind == "joints" else posed(one)
        points.append(TaughtPoint(one.label, joints, one.line, external=one.external))
        if one.axes != tuple(range(len(one.axes))):
            points[-1] = points[-1]._replace(unread=f"{one.label} does not state all joints")
    for line in reading.refused:
        if line.unread == "":
            raise BadInput(line.sentence, remedy="save it as text again", file=path, line=line.line)
        if line.unread is not None:
            points.append(TaughtPoint(line.unread, None, line.line, unread=line.sentence))
    return sorted(points, key=lambda point: point.line)


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
    language: JointLanguage,
    job: ImportJob,
    *,
    points: Sequence[str] | None,
    digits: int,
    named: Named,
) -> Imported:
    """Measurements at the positions of programs that were taught, or of a plan's program: what it recorded
    (zb_m0, zb_m1, …), or its postures (zb_p0, …) where they were taught again with the beam on the target.

    `digits` are the decimals of joints that the controller saves, `named` gives the positions of a text these
    names, in a language whose positions have numbers. Postures that are still as the plan has them are left
    out; BadInput for the program of another plan.
    """

    def in_degrees(point: TaughtPoint, per_degree: Matrix) -> TaughtPoint:
        if point.joints is None:
            return point
        numbers = np.array(point.joints)
        numbers[: job.robot.n] /= per_degree[: len(numbers)]
        return point._replace(joints=tuple(numbers.tolist()))

    def parse(text: str, path: Path) -> list[TaughtPoint]:
        with located(path):
            for number, content in enumerate(text.split("\n"), start=1):
                with located(path, number):
                    require_same_plan(content, job)
        per_degree = Pendant(job.robot).per_degree(language.unit)
        digit = 10.0**-digits / np.abs(per_degree)
        read = named(text, written_points(language, text, path))
        taught = [in_degrees(point, per_degree) for point in read]
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
            if match[1].lower() == recorded and not _as_planned(digit, plan, point, int(match[2]))
        ]
        if not measured:
            raise BadInput(
                "no measurements found: every position is still as the plan has it",
                file=path,
                remedy="record the positions at the controller with the beam on the centre, save the program"
                " there, and import the saved file",
            )
        return measured

    note = f"{language.name}: positions in joints, {_UNITS[language.unit]}, joint 1 first"
    return import_points(job, parse, names=points, vendor=language.vendor, note=note)


_UNITS = {"deg": "degrees", "rad": "radians", "pulse": "pulses by pulses_per_deg of the robot file"}


def _as_planned(digit: Matrix, plan: Plan, point: TaughtPoint, number: int) -> bool:
    """Whether a posture of the plan's program is still as the plan has it, to the last `digit` (n,) of the
    program, degrees."""
    if point.joints is None or not number < len(plan.postures):
        return False
    if len(point.joints) < plan.robot.n:
        return False
    pendant = Pendant(plan.robot)
    planned = pendant.counted(plan.postures[number] * plan.robot.display)
    return bool((np.abs(np.array(point.joints[: plan.robot.n]) - planned) <= digit).all())
