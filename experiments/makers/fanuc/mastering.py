"""FANUC: a sheet of new master counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ....model.errors import BadInput
from ....model.kinematics.pendant import encoder3_of, pendant_of
from ....model.kinematics.robot import Robot
from ....model.options import J3
from ..calibration import RobotCalibration
from ..maker import numbers_of, require_vendor
from ..plan_programs import sheet_text
from .backup import FEWEST_PULSES, MOST_PULSES, FanucBackup, read_fanuc_backup


@dataclass(frozen=True)
class FanucCounts:
    """Present master count of each joint, and pulses for one degree, negative where they fall; `backup` is
    where they are from."""

    master: tuple[int, ...]
    per_degree: tuple[float, ...]
    backup: FanucBackup | None = None

    @classmethod
    def of_options(
        cls,
        master: str | None,
        per_degree: str | None,
        joints: int,
        mosign: str | None = None,
        backup: Path | None = None,
    ) -> FanucCounts | None:
        """As the options state them; None where none is stated."""
        by_hand = {"--master-counts": master, "--pulses-per-degree": per_degree, "--mosign": mosign}
        given_by_hand = [option for option, value in by_hand.items() if value is not None]
        if backup is not None:
            if given_by_hand:
                raise BadInput(
                    "the counts are stated twice",
                    found=f"--backup and {', '.join(given_by_hand)}",
                    allowed="one of them",
                )
            read = read_fanuc_backup(backup, joints)
            return cls(read.master, read.per_degree, read)
        if not given_by_hand:
            return None
        if master is None or per_degree is None:
            raise BadInput(
                "master counts need the pulses for a degree, and these the counts",
                allowed="both --master-counts and --pulses-per-degree, or --backup FOLDER, or none",
            )
        allowed = f"{joints} numbers, separated by commas"
        counts = numbers_of(master, "--master-counts", allowed, [joints])
        if any(value != int(value) for value in counts):
            raise BadInput("--master-counts are whole numbers", found=master)
        pulses = numbers_of(per_degree, "--pulses-per-degree", allowed, [joints])
        if any(not FEWEST_PULSES <= abs(value) <= MOST_PULSES for value in pulses):
            raise BadInput(
                "these are not the pulses for a degree of a FANUC joint",
                found=per_degree,
                allowed=f"{FEWEST_PULSES:g} to {MOST_PULSES:g} in size, 180000 to 460000 as a rule",
                remedy="read $PARAM_GROUP[1].$ENCSCALES[i]; those of $MRR_GRP are for a radian",
            )
        return cls(tuple(int(value) for value in counts), tuple(_signed(pulses, per_degree, mosign)))


def fanuc_text(
    robot: Robot, calibration: RobotCalibration, counts: FanucCounts | None, j3: J3 | None = None
) -> str:
    """FANUC: master counts. What changes the count of joint 3 is decided by what its encoder measures; `j3`
    says what the pendant counts it from, if not as the robot file states. BadInput where neither is
    stated, and where a backup says otherwise than the robot file."""
    require_vendor(robot, "fanuc", "this sheet")
    pendant = pendant_of(robot, j3, "fanuc")
    backup = None if counts is None else counts.backup
    encoder = encoder3_of(robot, "fanuc") if backup is None else _encoder_of(backup, robot)
    offsets = _as_fanuc(calibration, encoder)
    return sheet_text(
        robot,
        calibration,
        "fanuc",
        pendant,
        wrist_driven=backup is None,
        counts=counts,
        backup=backup,
        encoder=encoder,
        rows=list(zip(offsets, _changes(offsets, backup), strict=True)),
    )


def _signed(pulses: list[float], text: str, mosign: str | None) -> list[float]:
    """Pulses for a degree with the sign of $MOSIGN, or that which they have; BadInput where neither says the
    sign: the controller's own numbers have none."""
    if mosign is None:
        if all(value > 0 for value in pulses):
            raise BadInput(
                "the sign of the pulses is not stated: $ENCSCALES has none",
                found=text,
                allowed="--mosign TRUE,FALSE,… as $PARAM_GROUP[1].$MOSIGN[i] has it",
                remedy="read $PARAM_GROUP[1].$MOSIGN[i], or let a backup say all: --backup FOLDER",
            )
        return pulses
    words = [word.strip().upper() for word in mosign.split(",")]
    if len(words) != len(pulses) or set(words) - {"TRUE", "FALSE"}:
        raise BadInput(
            "--mosign is not understood",
            found=mosign,
            allowed=f"TRUE or FALSE {len(pulses)} times, separated by commas",
        )
    if any(value < 0 for value in pulses):
        raise BadInput(
            "the sign of the pulses is stated twice",
            found=f"--mosign, and negative values: {text}",
            allowed="--mosign with $ENCSCALES as the controller has them, all positive",
        )
    return [value if word == "TRUE" else -value for word, value in zip(words, pulses, strict=True)]


def _encoder_of(backup: FanucBackup, robot: Robot) -> J3:
    """What the encoder of joint 3 measures by a backup; BadInput where the robot file says otherwise."""
    if robot.conventions.encoder3 not in (None, backup.encoder3):
        raise BadInput(
            "the backup and the robot file disagree on what the encoder of joint 3 measures",
            found=f"backup of {backup.model}: {backup.encoder3}; {robot.name}: {robot.conventions.encoder3}",
            remedy="is it the backup of this arm? If so, state in its robot file encoder:"
            f" {{joint3: {backup.encoder3}}}",
        )
    return backup.encoder3


def _changes(offsets: Sequence[float | None], backup: FanucBackup | None) -> list[float]:
    """By how much the encoder of each joint is to read more, deg: where the coupling is known, so that each
    joint reads more by its own offset alone."""
    values = np.array([offset or 0.0 for offset in offsets])
    changes: list[float] = (values if backup is None else np.linalg.solve(backup.coupling, values)).tolist()
    return changes


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
