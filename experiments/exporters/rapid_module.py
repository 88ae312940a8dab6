"""The offsets as a RAPID module for ABB controllers: functions that correct a jointtarget."""

from __future__ import annotations

from ...model.errors import BadInput
from .calibration import Calibration
from .vendors import require_vendor

AXES = 6  # rax_1 to rax_6 of a robjoint
MODULE = "zb_offsets"


def rapid_text(calibration: Calibration) -> str:
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
    lines = [
        f"MODULE {MODULE}",
        *(f"  ! {line}" for line in calibration.head),
        "  !",
        "  ! Do not use this module once the offsets are in the controller (calibration offsets):",
        "  ! they would be applied twice. Targets that were taught on this very arm hold them already.",
        "",
        "  ! Offsets of axes 1 to 6, degrees.",
        f"  CONST num zb_offset_deg{{{AXES}}}:=[{','.join(numbers)}];",
        "",
        "  ! The joints to command so that the true joints are wanted (degrees).",
        "  FUNC jointtarget zb_command(jointtarget wanted)",
        "    VAR jointtarget result;",
        "    result:=wanted;",
        *_axes("wanted", "-"),
        "    RETURN result;",
        "  ENDFUNC",
        "",
        "  ! The true joints when the controller reads recorded (degrees).",
        "  FUNC jointtarget zb_true(jointtarget recorded)",
        "    VAR jointtarget result;",
        "    result:=recorded;",
        *_axes("recorded", "+"),
        "    RETURN result;",
        "  ENDFUNC",
        "ENDMODULE",
    ]
    return "\n".join(lines) + "\n"


def _axes(given: str, sign: str) -> list[str]:
    return [
        f"    result.robax.rax_{i}:={given}.robax.rax_{i}{sign}zb_offset_deg{{{i}}};"
        for i in range(1, AXES + 1)
    ]
