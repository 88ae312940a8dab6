"""The offsets as data: JSON (`zerobeam/offsets/1`) for programs, CSV for spreadsheets."""

from __future__ import annotations

import json

from ....model.records import to_json
from ....words import spreadsheet
from ..calibration import ONCE, JointOffset, RobotCalibration
from ..maker import one_line


def csv_text(calibration: RobotCalibration) -> str:
    """One row a joint, every row with its provenance. A field is empty where the data cannot determine it."""
    return spreadsheet.csv_text(_row(offset, calibration) for offset in calibration.offsets)


def _row(offset: JointOffset, calibration: RobotCalibration) -> dict[str, object]:
    low, high = offset.row.interval95 or (None, None)
    made = calibration.inputs
    return {
        "offset": offset.name,
        "joint": one_line(offset.joint),
        "kind": offset.kind,
        "unit": offset.row.unit,
        "status": offset.status,
        "exported": "yes" if offset.exported else "no",
        "applied": offset.applied,
        "applied_u": offset.applied_u,
        "applied_status": offset.applied_status,
        "estimate": offset.row.estimate,
        "std": offset.row.std,
        "low95": low,
        "high95": high,
        "reason": one_line(offset.reason or ""),
        "run": one_line(made.run),
        "run_sha256": made.sha256,
        "robot": one_line(made.robot),
        "zerobeam": made.versions["zerobeam"],
        "notes": one_line("; ".join([ONCE, *calibration.warnings])),
    }


def json_text(calibration: RobotCalibration) -> str:
    """Text of the JSON file: ASCII, so that a name cannot break it."""
    return json.dumps(to_json(calibration), indent=1, allow_nan=False) + "\n"
