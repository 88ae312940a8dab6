"""Which entry of an arm's file is wrong, by poses that its pendant shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np

from ...model.arrays import Matrix
from ...model.files.robot_file import RobotFile
from ...model.kinematics.robot import Robot
from ...model.records import internal, it, key, record, worded
from .elements import Chain
from .entry_changes import EntryChange, chain_of, fitted_changes, listed_changes
from .poses import Counting, PendantPose, Tolerance, agree, tolerance

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
