"""RAPID (ABB): the offsets as a module of functions."""

from __future__ import annotations

from pathlib import Path

from ....model.errors import BadInput
from ..calibration import RobotCalibration
from ..maker import require_vendor
from ..plan_programs import filled

AXES = 6  # rax_1 to rax_6 of a robjoint


def rapid_text(calibration: RobotCalibration) -> str:
    """Text of the module: ASCII, degrees. RAPID's num holds some seven digits, so six decimals are written.

    BadInput for a robot that is not ABB's, or that a RAPID robjoint (six axes in degrees) cannot hold.
    """
    require_vendor(calibration.corrected, "abb", "a RAPID module")
    offsets = calibration.offsets
    sliding = [offset.name for offset in offsets if offset.kind == "prismatic"]
    if len(offsets) > AXES or sliding:
        raise BadInput(
            "a RAPID jointtarget has no place for this robot's joints",
            found=f"{len(offsets)} joints" + (f", prismatic: {', '.join(sliding)}" if sliding else ""),
            allowed=f"at most {AXES} revolute joints",
            remedy="export json or csv, and apply the offsets by hand",
        )
    numbers = [f"{offset.applied:.6f}" for offset in offsets] + ["0"] * (AXES - len(offsets))
    values = {"head": calibration.head, "numbers": numbers}
    (text,) = filled(Path(__file__).with_name("offsets.j2"), values)
    return text
