"""Sheets by which a person changes the zero of each joint in a controller.

All of them set the reading at the true zero. True = reading + offset, so the joint is truly at zero where
the controller reads -offset. Once that reading is set to zero, a new reading is the old one plus the
offset.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...model.arrays import Matrix
from ...model.errors import BadInput
from ...model.kinematics.pendant import Pendant
from .calibration import NO_ROBOT, RobotCalibration
from .maker import one_line

_CAUTION = (
    "CAUTION. The controller keeps no history: WRITE THE PRESENT VALUES DOWN FIRST, and make a backup. The",
    "change moves every taught position, and cannot be undone there without the old values. Do it once: a",
    "second time the offsets would be applied twice. Drive slowly afterwards, and verify:",
    "zerobeam plan verify RUN -o PLAN.",
)


_MOST = 10.0  # deg: no offset of a calibrated arm is as large


def sheet_text(
    calibration: RobotCalibration, about: Sequence[str], table: Sequence[str], pendant: Pendant
) -> str:
    """The sheet, with what the `pendant` must read once the values are in; BadInput for a prismatic joint,
    and for an offset that no calibrated arm has."""
    sliding = [offset.name for offset in calibration.offsets if offset.kind == "prismatic"]
    if sliding:
        raise BadInput("the sheet is for revolute joints", found=f"prismatic: {', '.join(sliding)}")
    changes = pendant.counted(np.array([offset.applied for offset in calibration.offsets]))
    too_large = [
        f"{name} {change:+.3f} deg" for name, change in _named(pendant, changes) if abs(change) > _MOST
    ]
    if too_large:
        raise BadInput(
            "the zero of a joint would move by more than an offset of a calibrated arm",
            found=", ".join(too_large),
            allowed=f"at most {_MOST:g} deg",
            remedy="compare joint columns, signs and zeros of the run with the pendant",
        )
    lines = [
        *calibration.head,
        "",
        *_CAUTION,
        "",
        *about,
        "",
        *([NO_ROBOT] if NO_ROBOT in calibration.warnings else []),
        *table,
        "",
        "Check, before any motion: right after the change, at the same place, the pendant must read more by",
        *(f"  {name} {change:+.3f} deg" for name, change in _named(pendant, changes) if change),
        "(- is less), and all other joints as before. Else put the old values back: a sign is wrong, or a",
        "value stands at another joint.",
        "",
        "done by, on: ______________________",
    ]
    return "\n".join(map(one_line, lines)) + "\n"


def _named(pendant: Pendant, changes: Matrix) -> list[tuple[str, float]]:
    return list(zip(pendant.names, changes.tolist(), strict=True))
