"""The robot file of a calibrated UR arm."""

from __future__ import annotations

from pathlib import Path

from ..importers.ur_calibration import CalibratedArm
from .ascii_line import one_line
from .dh_rows import corrected_table
from .robot_rows import rows_text


def calibrated_text(arm: CalibratedArm, source: Path) -> str:
    """Its text: rows near the nominal ones, exact for the calibrated chain."""
    rms, most = arm.apart_mm
    head = [
        f"{arm.stated.model} with the factory calibration of {source.name}.",
        f"Its flange is {rms:.2f} mm (rms, up to {most:.2f} mm) from that of the nominal arm.",
    ]
    return rows_text([one_line(line) for line in head], arm.stated, corrected_table(arm.stated, arm.robot))
