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
# Of the angle of a wrist's joint, by how much its motor moves each joint behind it, at most: KUKA $COUP_COMP
# A4 to A5 1/85, FANUC $INTERACTION 0.0091 to 0.0112 (public backups). A controller takes that into account,
# so a new zero of J4 alone makes J5 read otherwise.
_DRIVEN = 1 / 85
_WRIST = 3  # joints before it


_ROUNDED = 0.001  # deg, of a display
_WHY_WITHIN = (
    "Why within: the motor of each joint of the wrist moves the joints behind it too, by up to 1/85 of its",
    "angle, and the controller reckons with that from the new zeros.",
)


def sheet_text(
    calibration: RobotCalibration,
    about: Sequence[str],
    table: Sequence[str],
    pendant: Pendant,
    *,
    wrist_driven: bool = True,
) -> str:
    """The sheet, with what the `pendant` must read once the values are in; BadInput for a prismatic joint,
    and for an offset that no calibrated arm has. `wrist_driven`: motors of the wrist move the joints behind
    them, and the values leave that out."""
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
    tolerances = [_driven(changes, i) if wrist_driven else 0.0 for i in range(len(changes))]
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
        *(
            f"  {name} {change:+.3f} deg" + (f", within {within:.3f} deg" if within else "")
            for (name, change), within in zip(_named(pendant, changes), tolerances, strict=True)
            if change or within
        ),
        f"(- is less; {_ROUNDED:g} deg more or less is rounding), and all other joints as before. Else put",
        "the old values back: a sign is wrong, or a value stands at another joint.",
        *(_WHY_WITHIN if any(tolerances) else ()),
        "",
        "done by, on: ______________________",
    ]
    return "\n".join(map(one_line, lines)) + "\n"


def _driven(changes: Matrix, i: int) -> float:
    """By how much the new zeros of the joints of the wrist before joint `i` (from 0) may change its reading,
    with what the display rounds."""
    before = float(np.abs(changes[_WRIST:i]).sum())
    return _DRIVEN * before + _ROUNDED if before else 0.0


def _named(pendant: Pendant, changes: Matrix) -> list[tuple[str, float]]:
    return list(zip(pendant.names, changes.tolist(), strict=True))
