"""Positions of programs, taught or recorded, as measurements: of the readers in `experiments/positions`."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput, located
from ...model.files.joint_values import require_joint_count
from ...model.files.plan import Plan
from ...model.kinematics.orientation import from_quaternion, stated_numbers
from ...model.kinematics.pendant import Pendant, pendant_of
from ...model.kinematics.robot import Robot
from ...model.options import J3
from ...model.parsing.reading import read_other_text, unknown_name
from ..positions.arm_change import ArmChange, PositionFrames, kept, up_to_flange
from ..positions.position import BackupReading, JointLanguage, NotConvertible, SourceFile, TaughtPosition
from ..positions.position_languages import JOINT_LIST, LANGUAGES, RAPID, SLIM, TMSCRIPT
from ..positions.program_backup import together
from .import_jobs import FileMeasurements, Imported, ImportJob, without_unused
from .joint_text import PLAN_LINE, require_same_plan, required_plan
from .maker import TaughtFormat, TaughtPoint

# Of a plan's program: planned, measured, via.
POSTURE = re.compile(r"[#j]?zb_([pmv])(\d+)(?:_\d+)?", re.IGNORECASE)
_LANGUAGES: dict[str, JointLanguage] = {one.name: one for one in (*LANGUAGES, SLIM, TMSCRIPT, JOINT_LIST)}
_UNITS = {"deg": "degrees", "rad": "radians", "pulse": "pulses by pulses_per_deg of the robot file"}
_COMPUTED, _NAMELESS = "computed when the program runs", "in motions, without names"
_MOST_NAMED = 10


# From a pose to its joints, degrees as the controller counts them; None: it is not used.
Posed = Callable[[TaughtPosition], tuple[float, ...] | None]


def written_points(
    taught: TaughtFormat, text: str, path: Path, posed: Posed = lambda one: None
) -> list[TaughtPoint]:
    """All positions of a program, in its order: those that have a name, and those in motions ("line 12"), as
    people call them; then those that the program computes, which are left out.

    Joints are in the unit of the language; a pose has those that `posed` gives. BadInput where the text is
    not whole.
    """
    language = _LANGUAGES[taught.language]
    name = path.name if path.suffix.lower() in language.endings else f"{path.name}{language.endings[0]}"
    texts = {each: content.decode("latin-1") for each, content in together(path, language).items()}
    texts[name] = text
    reading = BackupReading([SourceFile(each, of, language.remark) for each, of in texts.items()])
    language.read(reading)
    reading, points = reading.of([name]), []
    for one in reading.positions:
        joints = one.values if one.kind == "joints" else posed(one)
        places = reading.changes(one.name)
        changed = f"overwritten when the program runs ({places[0]})" if places else ""
        points.append(TaughtPoint(one.label, joints, one.line, external=one.external, changed=changed))
        if one.axes != tuple(range(len(one.axes))):
            points[-1] = points[-1]._replace(unread=f"{one.label} does not state all joints")
    for line in reading.refused:
        if line.unread == "":
            raise BadInput(line.sentence, remedy="save it as text again", file=path, line=line.line)
        if line.unread is not None:
            points.append(TaughtPoint(line.unread, None, line.line, unread=line.sentence))
    points = taught.named(text, sorted(points, key=lambda point: point.line))
    if taught.declared:
        points = [
            point._replace(left_out=_NAMELESS) if point.name.startswith("line ") else point
            for point in points
        ]
    computed = sorted(dict(reading.computed()).items())
    return [*points, *(TaughtPoint(label, None, line, left_out=_COMPUTED) for line, label in computed)]


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
    taught: TaughtFormat,
    job: ImportJob,
    *,
    points: Sequence[str] | None,
    j3: J3 | None = None,
    posed: Posed = lambda one: None,
    note: str = "",
) -> Imported:
    """Measurements at the positions of programs that were taught, or of a plan's program: what it recorded
    (zb_m0, zb_m1, …), or its postures (zb_p0, …) where they were taught again with the beam on the target.

    `points` are the names of those to use, `j3` says what joint 3 is counted from, `posed` gives the joints
    of poses, as `note` says. Postures that are still as the plan has them are left out; BadInput for the
    program of another plan.
    """
    language = _LANGUAGES[taught.language]

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
        written = [in_degrees(point, per_degree) for point in written_points(taught, text, path, posed)]
        if points is not None:
            return written
        written = taught.recorded(text, written)
        ours = [(point, match) for point in written if (match := POSTURE.fullmatch(point.name))]
        numbered = any(point.number is not None for point in written)
        if numbered:
            return written
        if not (ours or (written and PLAN_LINE.search(text))):
            return [point._replace(left_out=point.left_out or point.changed) for point in written]
        plan = required_plan(job, path)
        if not ours:
            return written
        recorded = "m" if any(match[1] in "mM" for _, match in ours) else "p"
        numbers = {int(match[2]) for _, match in ours if match[1].lower() == recorded}
        missing = set(range(len(plan.postures))) - numbers
        if missing:  # a plan's program has all of them, whether they were recorded or not
            raise BadInput(
                "a posture of the plan is not in the file",
                found=f"no zb_{recorded}{min(missing)}",
                remedy="save or copy the whole file again; or name the positions to use (--points)",
            )
        digit = 10.0**-taught.digits / np.abs(per_degree)
        measured = [
            point._replace(number=int(match[2]), changed="")
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

    usual = f"{language.name}: positions in joints, {_UNITS[language.unit]}, joint 1 first"
    how = (taught.note or usual) + note
    return import_points(job, parse, names=points, j3=j3, vendor=language.vendor, note=how)


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


# Points of files


def import_points(
    job: ImportJob,
    parse: Callable[[str, Path], Sequence[TaughtPoint]],
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
    pendant = pendant_of(job.robot, j3, vendor)

    def read(path: Path, target: str | None) -> FileMeasurements:
        written = parse(read_other_text(path), path)
        points = _chosen(written, names)
        joints = pendant.between_links(np.array([_joints(point, job.robot) for point in points]))
        notes = [f"  points in their order: {', '.join(point.name for point in points)}"]
        if job.plan is None and names is None:
            notes += _left_out(written)
        if external := [point.name for point in points if point.external]:
            notes.append(
                f"  note: external axes are not at 0 in {', '.join(external)}, and are ignored: they must"
                " carry neither the arm nor the target"
            )
        notes += [f"  note: {point.name} is as stored: {point.changed}" for point in points if point.changed]
        numbers = [point.number for point in points]
        keys = {"target": [target] * len(points), "shot": None if None in numbers else numbers}
        return FileMeasurements(path, "point", joints, keys, [point.line for point in points], notes)

    return job.measured(read, [note, pendant.counting])


def _left_out(points: Sequence[TaughtPoint]) -> list[str]:
    """A sentence for each reason why points are no measurements: nothing is left out in silence."""
    sentences = []
    for why, some in groupby(sorted(points, key=lambda point: point.left_out), lambda point: point.left_out):
        called = [
            f"line {point.line}" + ("" if point.name.startswith("line ") else f" ({point.name})")
            for point in some
            if why
        ]
        more = f" and {len(called) - _MOST_NAMED} more" if len(called) > _MOST_NAMED else ""
        if called:
            sentences.append(f"  note: left out, {why}: {', '.join(called[:_MOST_NAMED])}{more}")
    return sentences


def _chosen(points: Sequence[TaughtPoint], names: Sequence[str] | None) -> list[TaughtPoint]:
    taught = [point for point in points if not point.left_out]
    if names is None:
        if not taught:
            notes = "; ".join(text.removeprefix("  note: ") for text in _left_out(points)) or None
            raise BadInput(
                "no measurements found: the file has no points with joints of its own",
                found=notes,
                remedy="name the files that declare the points, such as data lists, and no others",
            )
        return taught
    by_name = {point.name: point for point in (*reversed(points), *reversed(taught))}
    for name in names:
        if name not in by_name:
            named = [point.name for point in points if not point.name.startswith("line ")]
            raise unknown_name("there is no point of this name", name, named)
    return [by_name[name] for name in dict.fromkeys(names)]


def _joints(point: TaughtPoint, robot: Robot) -> tuple[float, ...]:
    if point.unread:
        raise BadInput(
            f"point {point.name} cannot be read",
            found=point.unread,
            remedy="save the file as text again, or name the points to use (--points)",
            line=point.line,
        )
    if point.joints is None:
        raise BadInput(
            f"point {point.name} has no joint values",
            found=point.left_out or "a Cartesian position, or one that was not taught",
            allowed="joint values: the configuration of the arm is not guessed",
            remedy="show it as joints on the controller and save again, or name the points to use (--points)",
            line=point.line,
        )
    joints = without_unused(point.joints, robot)
    require_joint_count(joints, robot, f"point {point.name}", None, point.line)
    return joints


def joints_of(robot: Robot, tool: str, frame: str | None, names: Sequence[str] | None) -> Posed:
    """Of robtargets of these names (None: any), of a stated `tool` and in a work object `frame` or wobj0, the
    joints with their configuration; BadInput unless exactly one set of joints has it."""
    in_frame = np.eye(4) if frame is None else _pose(frame, "--frame")
    frames = PositionFrames(np.eye(4), in_frame, _pose(tool, "--tool"))
    pendant = pendant_of(robot)
    arm = ArmChange(up_to_flange(robot, robot), RAPID, pendant, *kept(np.zeros(robot.n)))
    if arm.branches is None:
        raise BadInput(
            "robtargets are read for six-axis arms with a spherical wrist",
            found=robot.name,
            remedy="use jointtargets",
        )

    def posed(one: TaughtPosition) -> tuple[float, ...] | None:
        if names is not None and one.label not in names:
            return None
        if one.external:
            raise BadInput(
                f"{one.label} has positions of external axes, which may carry the robot or the work"
            )
        try:
            joints = arm.joints_at(frames.flange(RAPID.pose(one.values)), one.configuration)
        except NotConvertible as error:
            raise BadInput(
                f"{one.label} does not say what the joints are",
                found=str(error),
                remedy="state the right --tool and --frame, or save the point as a jointtarget",
                line=one.line,
            ) from None
        return tuple(pendant.counted(joints).tolist())

    return posed


def _pose(text: str, option: str) -> Matrix:
    return from_quaternion(stated_numbers(text, 7, option, "X,Y,Z,Q1,Q2,Q3,Q4"))
