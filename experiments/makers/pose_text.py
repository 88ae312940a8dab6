"""Poses as people type them from a pendant, and the digits that they have."""

from __future__ import annotations

import re
from collections.abc import Sequence

from ...analysis.pendant_check.poses import AngleForm, PendantPose, count_of
from ...model.errors import BadInput
from ...model.kinematics.pendant import Pendant
from ...model.kinematics.robot import PendantUnit
from ...model.parsing.reading import shown
from .joint_text import number_words, typed_joints

_LABEL = re.compile(r"(?<![\d.,])[A-Za-z_]+\d?\s*[:=]?|[\[\](){}°]")
_COARSEST_JOINT = 0.01  # deg, mm: a pendant shows two decimals; who types 20 has read 20.00
_HINT = {6: "X, Y, Z and three angles", 7: "X, Y, Z and q1, q2, q3, q4"}


def typed_poses(
    joints: Sequence[str], poses: Sequence[str], pendant: Pendant, units: PendantUnit, form: AngleForm
) -> list[PendantPose]:
    """The poses of texts, each with the text of the joint values at which the pendant shows it.

    BadInput where there are not as many of both, where one cannot be read, or where two postures are the
    same.
    """
    if len(joints) != len(poses):
        raise BadInput(
            "each pose is of a posture",
            found=f"{len(joints)} times --joints, {len(poses)} times --pose",
            remedy="state --joints and --pose in pairs, in the same order",
        )
    counted = [_counted(pendant, text, units) for text in joints]
    if len(set(counted)) < len(counted):
        raise BadInput("two postures are the same", remedy="read the pose at another posture")
    numbers = [_words(text, count_of(form)) for text in poses]
    places, angles = [words[:3] for words in numbers], [words[3:] for words in numbers]
    joint_digit = _digit([number_words(_plain(text), pendant.robot.n) or [] for text in joints])
    if units == "deg":
        joint_digit = min(joint_digit, _COARSEST_JOINT) if joint_digit == 1 else joint_digit
    joint_digit /= min(abs(pendant.per_degree(units)).tolist())
    digits = joint_digit, _digit(places), _digit(angles)
    return [
        PendantPose(values, tuple(map(float, words)), *digits)
        for values, words in zip(counted, numbers, strict=True)
    ]


def _counted(pendant: Pendant, text: str, units: PendantUnit) -> tuple[float, ...]:
    values = typed_joints(text, pendant.robot.n, pendant).values
    return tuple((values / pendant.per_degree(units)).tolist())


def _words(text: str, count: int) -> list[str]:
    words = number_words(_plain(text), count)
    if words is None or len(words) != count or (count == 7 and not any(map(float, words[3:]))):
        raise BadInput(
            "this is not a pose as the pendant shows it",
            found=f"{shown(text.strip()) or 'nothing'} ({len(_plain(text).split())} numbers)",
            allowed=f"{count} numbers: {_HINT[count]}",
            remedy="state by --angles how the pendant shows orientations, if not as the maker's do",
        )
    return words


def _plain(text: str) -> str:
    """The text without labels and brackets."""
    return _LABEL.sub(" ", text.replace("\u2212", "-").replace("\u2013", "-"))


def _digit(texts: Sequence[Sequence[str]]) -> float:
    """One unit of the last decimal that any of the numbers has."""
    decimals = [len(word.partition(".")[2]) for words in texts for word in words if "e" not in word.lower()]
    return float(10.0 ** -max(decimals, default=0))
