"""The offsets as data: JSON (`zerobeam/offsets/1`) for programs, CSV for spreadsheets."""

from __future__ import annotations

import json
from collections.abc import Sequence

from ....words import spreadsheet
from ....words.observability import reason
from ..calibration import MEANING, ONCE, SEED, JointOffset, RobotCalibration
from ..maker import one_line

SCHEMA = "zerobeam/offsets/1"

_KEYS = (
    "name",
    "joint",
    "kind",
    "unit",
    "status",
    "left_out",
    "estimate",
    "std",
    "interval95",
    "reason",
    "exported",
    "applied",
    "applied_u",
)

_OF_ROW = {"unit", "estimate", "std", "interval95"}
_PARAMETER_KEYS = ("name", "unit", "group", "status", "estimate", "std", "interval95", "tolerance_share")


def csv_text(calibration: RobotCalibration) -> str:
    """One row a joint, every row with its provenance. A field is empty where the data cannot determine it."""
    return spreadsheet.csv_text(_row(offset, calibration) for offset in calibration.offsets)


def _row(offset: JointOffset, calibration: RobotCalibration) -> dict[str, object]:
    low, high = offset.row.interval95 or (None, None)
    return {
        "offset": offset.name,
        "joint": one_line(offset.joint),
        "kind": offset.kind,
        "unit": offset.row.unit,
        "status": offset.status,
        "exported": "yes" if offset.exported else "no",
        "applied": offset.applied,
        "applied_u": offset.applied_u,
        "estimate": offset.row.estimate,
        "std": offset.row.std,
        "low95": low,
        "high95": high,
        "reason": one_line(offset.reason or ""),
        "run": one_line(calibration.run),
        "run_sha256": calibration.sha256,
        "robot": one_line(calibration.robot),
        "zerobeam": calibration.versions["zerobeam"],
        "notes": one_line("; ".join([ONCE, *calibration.warnings])),
    }


def document(calibration: RobotCalibration, notes: Sequence[str] = ()) -> dict[str, object]:
    """The offsets as plain values. What the data cannot determine is null; `applied` is to be added.

    `notes` are of a file, beside the warnings of the calibration itself.
    `covariance` is of all parameters that the data determine, in the products of their units.
    """
    covariance = calibration.covariance
    exported = {row_exported.name for row_exported in calibration.offsets if row_exported.exported}
    exported |= {row_exported.name for row_exported in calibration.geometry if row_exported.exported}
    return {
        "schema": SCHEMA,
        "meaning": MEANING,
        "offsets": [
            {key: getattr(offset.row if key in _OF_ROW else offset, key) for key in _KEYS}
            for offset in calibration.offsets
        ],
        "parameters": [
            {
                **{key: getattr(row, key) for key in _PARAMETER_KEYS},
                "reason": None if row.cause is None else reason(row.cause),
                "exported": row.name in exported,
            }
            for row in calibration.parameters
        ],
        "covariance": {
            "names": list(covariance.names),
            "units": list(covariance.units),
            "status": list(covariance.status),
            "matrix": covariance.matrix.tolist(),
        },
        "notes": [ONCE, *calibration.warnings, *notes],
        "inputs": {
            "run": calibration.run,
            "sha256": calibration.sha256,
            "robot": calibration.robot,
            "shots": calibration.shots,
            "seed": SEED,
            "versions": calibration.versions,
        },
    }


def json_text(calibration: RobotCalibration) -> str:
    """Text of the JSON file: ASCII, so that a name cannot break it."""
    return json.dumps(document(calibration), indent=1, allow_nan=False) + "\n"
