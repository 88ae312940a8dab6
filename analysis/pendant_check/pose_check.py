"""Which entry of an arm's file is wrong, by poses that its pendant shows."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Annotated, Literal

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile, StatedJoint, StatedTransform
from ...model.kinematics.robot import Robot
from ...model.records import internal, it, key, record, worded
from .poses import (
    FORMS,
    Chain,
    Counting,
    Element,
    PendantPose,
    Tolerance,
    agree,
    chain_of_robot,
    chain_of_rows,
    count_of,
    tolerance,
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

    `bound` is by how much a fitted value may be off.
    """

    kind: Annotated[Kind, it("of mistake")]
    entry: Annotated[str, it("what a person looks for")]
    old: Annotated[float | str, it("a value (mm, degrees) or a word", name="is")]
    new: Annotated[float | str, it("by which all poses agree", name="would_be")]
    chain: Annotated[Chain, internal]
    reading: Annotated[Counting, internal]
    bound: Annotated[float | None, internal] = None


def listed_changes(source: RobotFile | Robot, chain: Chain, reading: Counting) -> Iterator[EntryChange]:
    """All changes without a number of their own."""
    if isinstance(source, RobotFile):
        for kind, entry, old, new, other in _file_changes(source):
            yield EntryChange(kind, entry, old, new, chain_of_rows(other), reading)
    else:
        for entry, factor in (("all lengths of the URDF", _METRES), ("all lengths of the URDF", 1 / _METRES)):
            yield EntryChange("metres", entry, "metres", "millimetres", _scaled(chain, factor), reading)
    revolute = chain.revolute()
    if chain.n > 2 and all(revolute[1:3]):
        other3: Literal["link", "ground"] = "link" if reading.joint3 == "ground" else "ground"
        changed = replace(reading, joint3=other3)
        yield EntryChange("joint3", "pendant.joint3", reading.joint3, other3, chain, changed)
    for i in range(chain.n):
        changed = replace(reading, reversed_joint=i)
        yield EntryChange("sign", f"direction of joint {i + 1}", "", "", chain, changed)
    for i, j in combinations(range(chain.n), 2):
        if revolute[i] == revolute[j]:
            entry = f"order of joints {i + 1} and {j + 1}"
            yield EntryChange("exchange", entry, "", "", chain, replace(reading, exchanged=(i, j)))
    for factor, unit in ((math.degrees(1), "radians"), (math.radians(1), "degrees")):
        other_unit = "degrees" if unit == "radians" else "radians"
        changed = replace(reading, joint_factor=factor)
        yield EntryChange("radians", "joint values of the pendant", other_unit, unit, chain, changed)
    yield from _pose_changes(chain, reading)


def _pose_changes(chain: Chain, reading: Counting) -> Iterator[EntryChange]:
    for form in FORMS:
        if form != reading.form and count_of(form) == count_of(reading.form):
            other = replace(reading, form=form)
            yield EntryChange("pendant", "order of the pose's angles", reading.form, form, chain, other)
    if reading.form not in ("quaternion", "rotation-vector"):
        changed = replace(reading, angle_factor=math.degrees(1))
        yield EntryChange("pendant", "unit of the pose's angles", "degrees", "radians", chain, changed)
    for factor, unit in ((_METRES, "metres"), (25.4, "inches")):
        changed = replace(reading, place_factor=factor)
        yield EntryChange("pendant", "unit of the pose's X, Y, Z", "millimetres", unit, chain, changed)


FileChange = tuple[Kind, str, float | str, float | str, RobotFile]


def _file_changes(file: RobotFile) -> Iterator[FileChange]:
    other = "modified" if file.convention == "standard" else "standard"
    yield "convention", "convention", file.convention, other, file.model_copy(update={"convention": other})
    for i, row in enumerate(file.joints):
        for one, two in (("a_mm", "d_mm"), ("alpha_deg", "theta_deg")):
            first, second = getattr(row, one), getattr(row, two)
            if first != second:
                swapped = _with_row(file, i, {one: second, two: first})
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


def _with_row(file: RobotFile, i: int, values: Mapping[str, float]) -> RobotFile:
    rows: list[StatedJoint] = list(file.joints)
    rows[i] = rows[i].model_copy(update=dict(values))
    return file.model_copy(update={"joints": tuple(rows)})


def _rows_times(file: RobotFile, keys: Sequence[str], factor: float) -> RobotFile:
    rows = (row.model_copy(update={key: factor * getattr(row, key) for key in keys}) for row in file.joints)
    return file.model_copy(update={"joints": tuple(rows)})


def _in_metres(frame: StatedTransform) -> StatedTransform:
    return frame.model_copy(update={"xyz_mm": tuple(_METRES * value for value in frame.xyz_mm)})


def _scaled(chain: Chain, factor: float) -> Chain:
    parts = (
        replace(part, value=factor * part.value) if isinstance(part, Element) and not part.turns else part
        for part in chain.parts
    )
    return replace(chain, parts=tuple(parts))


def chain_of(source: RobotFile | Robot) -> Chain:
    """The chain of a robot file's rows, or of a robot that has none."""
    return chain_of_rows(source) if isinstance(source, RobotFile) else chain_of_robot(source)


def fitted_changes(chain: Chain, reading: Counting, poses: Sequence[PendantPose]) -> Iterator[EntryChange]:
    """Each element with the value that brings the chain closest to the poses."""
    sights = []
    for pose in poses:
        before = chain.before(reading.joints(pose, chain.revolute()))
        shown, allowed = reading.pose(pose), tolerance(chain, before, reading, pose)
        weights = np.full((3, 4), 1 / allowed.angle)
        weights[:, 3] = 1 / allowed.position
        sights.append((before, shown, weights))
    for k, part in enumerate(chain.parts):
        if not isinstance(part, Element):
            continue
        columns, aims = [], []
        for before, shown, weights in sights:
            behind = np.linalg.solve(before[k + 1], before[-1])
            terms = [before[k] @ each @ behind for each in part.basis()]
            columns.append(np.stack([(weights * term[:3]).ravel() for term in terms], axis=1))
            aims.append((weights * shown[:3]).ravel())
        value, bound = _solved(np.concatenate(columns), np.concatenate(aims), part.turns)
        rounded = _roundest(chain, k, value, reading, poses)
        yield EntryChange(
            "value", part.entry, part.value, rounded, chain.with_value(k, rounded), reading, bound
        )


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


def _roundest(chain: Chain, k: int, value: float, reading: Counting, poses: Sequence[PendantPose]) -> float:
    """The value with the fewest decimals that agrees with the poses; as it is, if none does."""
    if not agree(chain.with_value(k, value), reading, poses, 2.0):
        return value
    for decimals in _DECIMALS:
        rounded = round(value, decimals) + 0.0
        if agree(chain.with_value(k, rounded), reading, poses):
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
    chain = chain_of(source)
    deviations = tuple(_deviation(chain, reading, pose) for pose in poses)
    changes = list(listed_changes(source, chain, reading))
    explained = [change for change in changes if agree(change.chain, change.reading, poses)]
    if all(each.share <= 1 for each in deviations):
        unchecked = tuple(
            change
            for change in explained
            if change.kind != "pendant" and not _same(chain, reading, change, poses)
        )
        return PendantCheck(deviations, (), True, None, None, unchecked)
    explained += [
        change
        for change in fitted_changes(chain, reading, poses)
        if agree(change.chain, change.reading, poses)
    ]
    same = all(_same(explained[0].chain, explained[0].reading, other, poses) for other in explained[1:])
    tool = frame = None
    if not explained and len(poses) > 1:
        tool, frame = (
            _constant(chain, reading, poses, behind=True),
            _constant(chain, reading, poses, behind=False),
        )
    return PendantCheck(deviations, tuple(explained), same, tool, frame, ())


def _deviation(chain: Chain, reading: Counting, pose: PendantPose) -> Deviation:
    before = chain.before(reading.joints(pose, chain.revolute()))
    shown = reading.pose(pose)
    position = float(np.linalg.norm(before[-1][:3, 3] - shown[:3, 3]))
    angle = Tolerance(np.inf, 1.0).share(before[-1], shown)
    allowed = tolerance(chain, before, reading, pose)
    allowed_deg = float(np.degrees(allowed.angle))
    share = allowed.share(before[-1], shown)
    return Deviation(position, float(np.degrees(angle)), allowed.position, allowed_deg, share)


def _same(chain: Chain, reading: Counting, change: EntryChange, poses: Sequence[PendantPose]) -> bool:
    """Whether a change makes the arm of `chain` and `reading` in every posture, for these digits."""
    rng = np.random.default_rng(0)
    revolute = chain.revolute()
    limit = np.where(revolute, 150.0, 300.0)
    digits = poses[0]
    for values in rng.uniform(-limit, limit, (_OTHER_POSTURES, chain.n)):
        numbers = PendantPose(
            tuple(values.tolist()), (), digits.joint_digit, digits.place_digit, digits.angle_digit
        )
        before = chain.before(reading.joints(numbers, revolute))
        other = change.chain.pose(change.reading.joints(numbers, revolute))
        if tolerance(chain, before, reading, numbers).share(before[-1], other) > _LOOSE:
            return False
    return True


def _constant(
    chain: Chain, reading: Counting, poses: Sequence[PendantPose], *, behind: bool
) -> Matrix | None:
    """The transform behind the flange, or before the base, that the first pose asks for, if the others agree
    with it."""
    first: Matrix | None = None
    for pose in poses:
        before = chain.before(reading.joints(pose, chain.revolute()))
        computed, shown = before[-1], reading.pose(pose)
        if first is None:
            inverse = np.linalg.inv(computed)
            first = np.asarray(inverse @ shown if behind else shown @ inverse)
            continue
        expected = computed @ first if behind else first @ computed
        allowed = tolerance(chain, before, reading, pose)
        if Tolerance(2 * allowed.position, 2 * allowed.angle).share(expected, shown) > 1:
            return None
    return first
