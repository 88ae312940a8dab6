"""Which entry of an arm's file is wrong, by poses that its pendant shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile, StatedTransform
from ...model.kinematics.robot import Robot
from ...model.options import J3
from ...model.records import internal, it, key, record, worded
from .poses import (
    FORMS,
    Counting,
    FileEntry,
    PendantPose,
    Tolerance,
    agree,
    angle_between,
    count_of,
    entries,
    flange_at,
    poses_along,
    revolute,
    with_row,
)

Kind = Literal[
    "value", "swap", "convention", "metres", "radians", "order", "joint3", "sign", "exchange", "pendant"
]
_METRES = 1000.0
_GRID = np.linspace(-math.pi, math.pi, 721)
_DECIMALS = range(4)


@record(eq=False)
class EntryChange:
    """One entry that is otherwise than stated, and the arm and reading that follow.

    `bound` is by how much a fitted value may be off, in its `unit`.
    """

    kind: Annotated[Kind, it("of mistake")]
    entry: Annotated[str, it("what a person looks for")]
    old: Annotated[float | str, it("a value (mm, degrees) or a word", name="is")]
    new: Annotated[float | str, it("by which all poses agree", name="would_be")]
    arm: Annotated[Robot, internal]
    reading: Annotated[Counting, internal]
    bound: Annotated[float, internal] = 0.0
    unit: Annotated[str, internal] = ""


def listed_changes(source: RobotFile | Robot, arm: Robot, reading: Counting) -> Iterator[EntryChange]:
    """All changes without a number of their own; `arm` is that of the source."""
    if isinstance(source, RobotFile):
        for kind, entry, old, new, other in _file_changes(source):
            yield EntryChange(kind, entry, old, new, other.robot(), reading)
    else:
        for factor in (_METRES, 1 / _METRES):
            scaled = _scaled(arm, factor)
            yield EntryChange("metres", "all lengths of the URDF", "metres", "millimetres", scaled, reading)
    turns = revolute(arm)
    if arm.n > 2 and turns[1:3].all():
        other3: J3 = "link" if reading.joint3 == "ground" else "ground"
        changed = replace(reading, joint3=other3)
        yield EntryChange("joint3", "pendant.joint3", reading.joint3, other3, arm, changed)
    for i in range(arm.n):
        changed = replace(reading, reversed_joint=i)
        yield EntryChange("sign", f"direction of joint {i + 1}", "", "", arm, changed)
    for i, j in combinations(range(arm.n), 2):
        if turns[i] == turns[j]:
            entry = f"order of joints {i + 1} and {j + 1}"
            yield EntryChange("exchange", entry, "", "", arm, replace(reading, exchanged=(i, j)))
    for factor, unit in ((math.degrees(1), "radians"), (math.radians(1), "degrees")):
        other_unit = "degrees" if unit == "radians" else "radians"
        changed = replace(reading, joint_factor=factor)
        yield EntryChange("radians", "joint values of the pendant", other_unit, unit, arm, changed)
    yield from _pose_changes(arm, reading)


def _pose_changes(arm: Robot, reading: Counting) -> Iterator[EntryChange]:
    for form in FORMS:
        if form != reading.form and count_of(form) == count_of(reading.form):
            other = replace(reading, form=form)
            yield EntryChange("pendant", "order of the pose's angles", reading.form, form, arm, other)
    if reading.form not in ("quaternion", "rotation-vector"):
        changed = replace(reading, angle_factor=math.degrees(1))
        yield EntryChange("pendant", "unit of the pose's angles", "degrees", "radians", arm, changed)
    for factor, unit in ((_METRES, "metres"), (25.4, "inches")):
        changed = replace(reading, place_factor=factor)
        yield EntryChange("pendant", "unit of the pose's X, Y, Z", "millimetres", unit, arm, changed)


FileChange = tuple[Kind, str, float | str, float | str, RobotFile]


def _file_changes(file: RobotFile) -> Iterator[FileChange]:
    other = "modified" if file.convention == "standard" else "standard"
    yield "convention", "convention", file.convention, other, file.model_copy(update={"convention": other})
    for i, row in enumerate(file.joints):
        for one, two in (("a_mm", "d_mm"), ("alpha_deg", "theta_deg")):
            first, second = getattr(row, one), getattr(row, two)
            if first != second:
                swapped = with_row(file, i, {one: second, two: first})
                yield "swap", f"{one} and {two} of joint {i + 1}", first, second, swapped
    lengths, angles = ("a_mm", "d_mm"), ("alpha_deg", "theta_deg", "beta_deg")
    rows_in_metres = _rows_times(file, lengths, _METRES)
    yield "metres", "a_mm and d_mm of all joints", "millimetres", "metres", rows_in_metres
    if any((*file.base.xyz_mm, *file.flange.xyz_mm)):
        whole = rows_in_metres.model_copy(
            update={"base": _in_metres(file.base), "flange": _in_metres(file.flange)}
        )
        yield "metres", "all lengths", "millimetres", "metres", whole
    for keys, entry in (
        (angles, "all angles of the rows"),
        (angles[:1], "alpha_deg of all joints"),
        (angles[1:2], "theta_deg of all joints"),
    ):
        yield "radians", entry, "degrees", "radians", _rows_times(file, keys, math.degrees(1))
    for part in ("base", "flange"):
        frame: StatedTransform = getattr(file, part)
        if frame.rpy_deg[0] != frame.rpy_deg[2]:
            turned = frame.model_copy(update={"rpy_deg": frame.rpy_deg[::-1]})
            entry = f"order of the angles in {part}.rpy_deg"
            yield (
                "order",
                entry,
                "roll, pitch, yaw",
                "yaw, pitch, roll",
                file.model_copy(update={part: turned}),
            )


def _rows_times(file: RobotFile, keys: Sequence[str], factor: float) -> RobotFile:
    rows = (row.model_copy(update={key: factor * getattr(row, key) for key in keys}) for row in file.joints)
    return file.model_copy(update={"joints": tuple(rows)})


def _in_metres(frame: StatedTransform) -> StatedTransform:
    return frame.model_copy(update={"xyz_mm": tuple(_METRES * value for value in frame.xyz_mm)})


def _scaled(arm: Robot, factor: float) -> Robot:
    """The arm with all lengths times a factor."""

    def longer(pose: Matrix) -> Matrix:
        return np.hstack([pose[:, :3], pose[:, 3:] * [[factor], [factor], [factor], [1.0]]])

    joints = tuple(replace(joint, fixed=longer(joint.fixed)) for joint in arm.joints)
    return replace(arm, joints=joints, flange=longer(arm.flange))


def fitted_changes(
    source: RobotFile | Robot, arm: Robot, reading: Counting, poses: Sequence[PendantPose]
) -> Iterator[EntryChange]:
    """Each entry with the value that brings the arm closest to the poses."""
    joints = [reading.joints(pose, arm) for pose in poses]
    weights = np.empty((len(poses), 3, 4))
    for pose, weight in zip(poses, weights, strict=True):
        _, allowed = flange_at(arm, reading, pose)
        weight[:, :3], weight[:, 3] = 1 / allowed.angle, 1 / allowed.position
    aim = weights * [reading.pose(pose)[:3] for pose in poses]

    def weighted(changed: Robot) -> Matrix:
        return np.asarray(weights * [poses_along(changed, values)[-1][:3] for values in joints])

    for entry in entries(source):
        parts = [part.ravel() for part in entry.parts(weighted)]
        value, bound = _solved(np.stack(parts, axis=1), aim.ravel(), entry.turns)
        rounded = _roundest(entry, value, reading, poses)
        unit = "deg" if entry.turns else "mm"
        changed = entry.arm(rounded)
        yield EntryChange("value", entry.name, entry.value, rounded, changed, reading, bound, unit)


def _solved(terms: Matrix, aim: Matrix, turns: bool) -> tuple[float, float]:
    """The value (mm, or degrees) of least squares, and by how much one unit of the deviation moves it."""
    rest = aim - terms[:, 0]
    if not turns:
        slope = terms[:, 1]
        size = float(slope @ slope)
        return float(slope @ rest) / size, 1 / math.sqrt(size)
    waves = np.stack([np.cos(_GRID), np.sin(_GRID)])
    angle = float(_GRID[int(((terms[:, 1:] @ waves - rest[:, None]) ** 2).sum(axis=0).argmin())])
    for _ in range(20):
        cosine, sine = math.cos(angle), math.sin(angle)
        slope = terms[:, 1:] @ np.array([-sine, cosine])
        step = float(slope @ (rest - terms[:, 1:] @ np.array([cosine, sine]))) / float(slope @ slope)
        angle += step
        if abs(step) < 1e-12:
            break
    return math.degrees(math.remainder(angle, 2 * math.pi)), math.degrees(1 / math.sqrt(float(slope @ slope)))


def _roundest(entry: FileEntry, value: float, reading: Counting, poses: Sequence[PendantPose]) -> float:
    """The value with the fewest decimals that agrees with the poses; as it is, if none does."""
    if not agree(entry.arm(value), reading, poses, 2.0):
        return value
    for decimals in _DECIMALS:
        rounded = round(value, decimals) + 0.0
        if agree(entry.arm(rounded), reading, poses):
            return rounded
    return value


_OTHER_POSTURES = 6  # at which two changed arms are compared
_LOOSE = 2.0  # share of the tolerance up to which two arms with fitted values are the same


@record(eq=False)
class Deviation:
    """The pose of the file against that of the pendant, what the digits allow, and the larger of the two
    over what they allow."""

    place_mm: Annotated[float, it("of the position", name="mm")]
    angle_deg: Annotated[float, it("of the orientation", name="deg")]
    allowed_mm: Annotated[float, it("what the digits allow")]
    allowed_deg: float
    share: Annotated[float, internal]


@record(eq=False)
class PendantCheck:
    """What poses of the pendant say of an arm's file.

    Attributes
    ----------
    tool, frame
        (4, 4) a tool behind the flange, or a frame of the pendant before the base, by which all poses agree
        where no single change does it; None where there is none.
    unchecked
        Changes that the poses would not show: where the file agrees they are still possible.
    """

    deviations: Annotated[tuple[Deviation, ...], it("of each pose, from that of the file")]
    suspects: Annotated[
        tuple[EntryChange, ...],
        it("single changes by which all poses agree; none where the file agrees as it is"),
    ]
    same_arm: Annotated[bool, it("whether all of them make the same arm, so that any corrects the file")]
    tool: Annotated[Matrix | None, internal]
    frame: Annotated[Matrix | None, internal]
    unchecked: Annotated[tuple[EntryChange, ...], internal]
    sentences: Annotated[tuple[str, ...] | None, worded("the same in words")] = None

    @property
    @key("entries that the postures leave unchecked", name="unchecked")
    def unchecked_entries(self) -> list[str]:
        return list(dict.fromkeys(change.entry for change in self.unchecked))

    @property
    @key("whether the file agrees")
    def agrees(self) -> bool:
        return all(each.share <= 1 for each in self.deviations)


def check_poses(source: RobotFile | Robot, reading: Counting, poses: Sequence[PendantPose]) -> PendantCheck:
    """Compare a robot file, or a robot without rows, with poses of its pendant, and look for one change of it
    that explains what deviates."""
    arm = source.robot() if isinstance(source, RobotFile) else source
    deviations = tuple(_deviation(arm, reading, pose) for pose in poses)
    changes = listed_changes(source, arm, reading)
    explained = [change for change in changes if agree(change.arm, change.reading, poses)]
    if all(each.share <= 1 for each in deviations):
        unchecked = tuple(
            change
            for change in explained
            if change.kind != "pendant" and not _same(arm, reading, change, poses)
        )
        return PendantCheck(deviations, (), True, None, None, unchecked)
    fitted = fitted_changes(source, arm, reading, poses)
    explained += [change for change in fitted if agree(change.arm, reading, poses)]
    same = all(_same(explained[0].arm, explained[0].reading, other, poses) for other in explained[1:])
    tool = frame = None
    if not explained and len(poses) > 1:
        tool, frame = (_constant(arm, reading, poses, behind=behind) for behind in (True, False))
    return PendantCheck(deviations, tuple(explained), same, tool, frame, ())


def _deviation(arm: Robot, reading: Counting, pose: PendantPose) -> Deviation:
    computed, allowed = flange_at(arm, reading, pose)
    shown = reading.pose(pose)
    return Deviation(
        float(np.linalg.norm(computed[:3, 3] - shown[:3, 3])),
        math.degrees(angle_between(computed, shown)),
        allowed.position,
        math.degrees(allowed.angle),
        allowed.share(computed, shown),
    )


def _same(arm: Robot, reading: Counting, change: EntryChange, poses: Sequence[PendantPose]) -> bool:
    """Whether a change makes the same arm, with its reading, in every posture, for these digits."""
    rng = np.random.default_rng(0)
    limit = np.where(revolute(arm), 150.0, 300.0)
    for values in rng.uniform(-limit, limit, (_OTHER_POSTURES, arm.n)):
        counted = replace(poses[0], counted=tuple(values.tolist()))
        computed, allowed = flange_at(arm, reading, counted)
        other = poses_along(change.arm, change.reading.joints(counted, change.arm))[-1]
        if allowed.share(computed, other) > _LOOSE:
            return False
    return True


def _constant(arm: Robot, reading: Counting, poses: Sequence[PendantPose], *, behind: bool) -> Matrix | None:
    """The transform behind the flange, or before the base, that the first pose asks for, if the others agree
    with it."""
    first: Matrix | None = None
    for pose in poses:
        computed, allowed = flange_at(arm, reading, pose)
        shown = reading.pose(pose)
        if first is None:
            inverse = np.linalg.inv(computed)
            first = np.asarray(inverse @ shown if behind else shown @ inverse)
            continue
        expected = computed @ first if behind else first @ computed
        if Tolerance(2 * allowed.position, 2 * allowed.angle).share(expected, shown) > 1:
            return None
    return first
