"""Sheets by which a person changes the zero of each joint in a controller.

All of them set the reading at the true zero. True = reading + offset, so the joint is truly at zero where
the controller reads -offset. Once that reading is set to zero, a new reading is the old one plus the
offset.
"""

from __future__ import annotations

from collections.abc import Sequence

from ...model.errors import BadInput
from .calibration import RobotCalibration
from .maker import one_line

_CAUTION = (
    "CAUTION. The controller keeps no history: WRITE THE PRESENT VALUES DOWN FIRST, and make a backup. The",
    "change moves every taught position, and cannot be undone there without the old values. Do it once: a",
    "second time the offsets would be applied twice. Drive slowly afterwards, and verify:",
    "zerobeam plan verify RUN -o PLAN.",
)


def sheet_text(calibration: RobotCalibration, about: Sequence[str], table: Sequence[str]) -> str:
    sliding = [offset.name for offset in calibration.offsets if offset.kind == "prismatic"]
    if sliding:
        raise BadInput("the sheet is for revolute joints", found=f"prismatic: {', '.join(sliding)}")
    lines = [
        *calibration.head,
        "",
        *_CAUTION,
        "",
        *about,
        "",
        *table,
        "",
        "done by, on: ______________________",
    ]
    return "\n".join(map(one_line, lines)) + "\n"
