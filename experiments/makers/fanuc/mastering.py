"""FANUC: a sheet of new master counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ....model.errors import BadInput
from ....model.kinematics.pendant import encoder3_of, pendant_of
from ....model.kinematics.robot import J3, Robot
from ..calibration import RobotCalibration
from ..maker import numbers_of, require_vendor
from ..sheets import sheet_text

_RELIED_ON: Mapping[J3, list[str]] = {
    "link": [
        "Relied on (the robot file: encoder): the encoder of J3 measures the angle between links 2 and 3. So",
        "the count of J3 changes by the offset of joint 3 alone, whatever the pendant counts J3 from. This",
        "follows from the place of the motor, at the elbow; it is not from a document of FANUC. Check it:",
        "jog J2 alone (JOINT) by 10 deg. The pulses of J3 change by 10 deg where it is so; where they stay",
        "as they are, the encoder measures from the ground: stop, and state encoder: {joint3: ground}.",
    ],
    "ground": [
        "Relied on (the robot file: encoder): the encoder of J3 measures the direction of link 3, whatever",
        "J2 does (a parallelogram). Its count changes by the offset of joint 3 less that of joint 2.",
    ],
}
_ON_THE_PENDANT = [
    "The pendant counts J3 from the ground: at the same place it will read more by the offset of joint 3",
    "less that of joint 2, since the new zero of J2 is in it.",
]
_WITHOUT_COUNTS = [
    "This sheet states no counts: zerobeam export fanuc computes the new ones where --master-counts and",
    "--pulses-per-degree state the present ones and the pulses.",
]
_SAFETY = [
    "DCS (Dual Check Safety) holds a copy of the mastering: after the change it reports a difference and",
    "stops the robot until the new data are applied (MENU, SYSTEM, DCS, APPLY, code number; then off and",
    "on). Afterwards verify its position and speed checks and the safety report, as your safety plan and the",
    "manual of DCS on your controller say: zones are checked with the new zeros.",
]


_FEWEST_PULSES = 100.0
_BEFORE = [
    "Before you enter anything, check the sign of the pulses: jog each joint alone (JOINT) by +10 deg and",
    "read its pulses before and after (MENU, STATUS, Axis, PULSE). They must change by 10 times its pulses",
    "per degree, sign included. Where the sign is the other one, stop: the new count would be wrong by twice",
    "the offset.",
]
_AS_MASTERED = [
    "confirm: $MASTER_ENB is 1, so that MENU, SYSTEM shows Master/Cal.",
    "confirm: $DMR_GRP[1].$MASTER_DONE is TRUE after the counts are written, and before CALIBRATE.",
]


@dataclass(frozen=True)
class FanucCounts:
    """Present master count of each joint, and pulses for one degree, negative where they fall."""

    master: tuple[int, ...]
    per_degree: tuple[float, ...]

    @classmethod
    def of_options(cls, master: str | None, per_degree: str | None, joints: int) -> FanucCounts | None:
        """As two options state them; None where neither is stated."""
        if master is None and per_degree is None:
            return None
        if master is None or per_degree is None:
            raise BadInput(
                "master counts need the pulses for a degree, and these the counts",
                allowed="both --master-counts and --pulses-per-degree, or neither",
            )
        counts = _numbers(master, joints, "--master-counts")
        if any(value != int(value) for value in counts):
            raise BadInput("--master-counts are whole numbers", found=master)
        pulses = _numbers(per_degree, joints, "--pulses-per-degree")
        if any(abs(value) < _FEWEST_PULSES for value in pulses):
            raise BadInput(
                "these are not the pulses for a degree of a FANUC joint",
                found=per_degree,
                allowed=f"at least {_FEWEST_PULSES:g} in size, thousands as a rule, negative where they fall",
                remedy="read $PARAM_GROUP[1].$ENCSCALES[i]",
            )
        return cls(tuple(int(value) for value in counts), tuple(pulses))


def fanuc_text(
    robot: Robot, calibration: RobotCalibration, counts: FanucCounts | None, j3: J3 | None = None
) -> str:
    """FANUC: master counts. What changes the count of joint 3 is decided by what its encoder measures; `j3`
    says what the pendant counts it from, if not as the robot file states. BadInput where neither is
    stated."""
    require_vendor(robot, "fanuc", "this sheet")
    pendant = pendant_of(robot, j3, "fanuc")
    encoder = encoder3_of(robot, "fanuc")
    offsets = _as_fanuc(calibration, encoder)
    lines = ["joint  offset deg   new master count"]
    jogged = (
        [] if counts is None else [f"J{i} {10 * p:+.0f}" for i, p in enumerate(counts.per_degree, start=1)]
    )
    for i, offset in enumerate(offsets):
        if offset is None:
            lines.append(f"J{i + 1}   {'-':>11}   as it is")
        elif counts is None:
            lines.append(f"J{i + 1}   {offset:+11.6f}   old count - ({offset:+.6f} * pulses per degree)")
        else:
            new = counts.master[i] - round(offset * counts.per_degree[i])
            lines.append(f"J{i + 1}   {offset:+11.6f}   {new}   (now {counts.master[i]})")
    return sheet_text(
        calibration,
        [
            "Master count sheet for FANUC. The count of a joint is what its encoder has at the true zero:",
            "$DMR_GRP[1].$MASTER_COUN[i]; the pulses for a degree are $PARAM_GROUP[1].$ENCSCALES[i],",
            "negative where they fall. Reading = (pulses - count) / pulses per degree, so a count that is",
            "smaller by offset * pulses per degree makes the joint read more by the offset. Check names and",
            "signs against the manual of your controller.",
            *_RELIED_ON[encoder],
            *(_ON_THE_PENDANT if pendant.ground else ["The pendant counts J3 from link 2."]),
            *(_WITHOUT_COUNTS if counts is None else ()),
            *_BEFORE,
            *([f"By these pulses: {', '.join(jogged)}."] if jogged else []),
            *_AS_MASTERED,
            "Write the new counts, calibrate (MENU, SYSTEM, Master/Cal), turn the controller off and on.",
            *_SAFETY,
        ],
        lines,
        pendant,
    )


def _as_fanuc(calibration: RobotCalibration, encoder: J3) -> list[float | None]:
    """The offsets of the controller's encoders: None where nothing is to be changed."""
    values: list[float | None] = [
        offset.applied if offset.exported else None for offset in calibration.offsets
    ]
    if encoder == "link" or len(values) < 3:
        return values
    second, third = calibration.offsets[1], calibration.offsets[2]
    if second.exported != third.exported and second.status != "held" and third.status != "held":
        raise BadInput(
            "the encoder of J3 measures from the ground: its offset is that of joint 3 less that of joint 2",
            found=f"only one of {second.name} and {third.name} is determined and exported",
            allowed="both, or neither",
            remedy=f"exclude both: --without {second.name} --without {third.name}",
        )
    if third.exported or second.exported:
        values[2] = third.applied - second.applied
    return values


def _numbers(text: str, joints: int, option: str) -> list[float]:
    allowed = f"{joints} numbers, separated by commas"
    values = numbers_of(text, option, allowed)
    if len(values) != joints:
        raise BadInput(f"{option} is not understood", found=text, allowed=allowed)
    return values
