"""Sheets by which a person changes the zero of each joint in a controller.

All of them set the reading at the true zero. True = reading + offset, so the joint is truly at zero where
the controller reads -offset. Once that reading is set to zero, a new reading is the old one plus the
offset.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.files.robot_file import Vendor
from ...model.kinematics.pendant import Pendant, require_link_encoder
from ...model.kinematics.robot import Robot
from .calibration import NO_ROBOT, RobotCalibration
from .maker import folder_of, require_vendor
from .plan_programs import filled

_MOST = 10.0  # deg: no offset of a calibrated arm is as large
# Of the angle of a wrist's joint, by how much its motor moves each joint behind it, at most: KUKA $COUP_COMP
# A4 to A5 1/85, FANUC $INTERACTION 0.0091 to 0.0112 (public backups). A controller takes that into account,
# so a new zero of J4 alone makes J5 read otherwise.
_DRIVEN = 1 / 85
_WRIST = 3  # joints before it
_ROUNDED = 0.001  # deg, of a display


def sheet_text(
    robot: Robot,
    calibration: RobotCalibration,
    vendor: Vendor,
    pendant: Pendant | None = None,
    *,
    wrist_driven: bool = True,
    **values: object,
) -> str:
    """The sheet of a maker, whose folder has its two blocks, with what the `pendant` must read once the
    values are in; without one, the encoders must measure between links. `values` are what the blocks take
    besides. BadInput for a robot of another vendor, a prismatic joint, and for an offset that no calibrated
    arm has. `wrist_driven`: motors of the wrist move the joints behind them, and the values leave that out.
    """
    require_vendor(robot, vendor, "this sheet")
    if pendant is None:
        require_link_encoder(robot, "this sheet")
        pendant = Pendant(robot)
    sliding = [offset.name for offset in calibration.offsets if offset.kind == "prismatic"]
    if sliding:
        raise BadInput("the sheet is for revolute joints", found=f"prismatic: {', '.join(sliding)}")
    changes = pendant.counted(np.array([offset.applied for offset in calibration.offsets]))
    named = list(zip(pendant.names, changes.tolist(), strict=True))
    too_large = [f"{name} {change:+.3f} deg" for name, change in named if abs(change) > _MOST]
    if too_large:
        raise BadInput(
            "the zero of a joint would move by more than an offset of a calibrated arm",
            found=", ".join(too_large),
            allowed=f"at most {_MOST:g} deg",
            remedy="compare joint columns, signs and zeros of the run with the pendant",
        )
    values |= {"offsets": calibration.offsets, "pendant": pendant, "robot": robot}
    blocks = filled(folder_of(vendor) / "sheet.j2", values)
    about, table = (block.splitlines() for block in blocks)
    (text,) = filled(
        Path(__file__).with_name("sheet.j2"),
        {
            "head": calibration.head,
            "about": about,
            "simulated": NO_ROBOT if NO_ROBOT in calibration.warnings else None,
            "table": table,
            "changes": [
                (name, change, _driven(changes, i) if wrist_driven else 0.0)
                for i, (name, change) in enumerate(named)
            ],
            "rounding": _ROUNDED,
        },
    )
    return text


def _driven(changes: Matrix, i: int) -> float:
    """By how much the new zeros of the joints of the wrist before joint `i` (from 0) may change its reading,
    with what the display rounds."""
    before = float(np.abs(changes[_WRIST:i]).sum())
    return _DRIVEN * before + _ROUNDED if before else 0.0
