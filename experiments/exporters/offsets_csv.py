"""The offsets as CSV, one row a joint: for spreadsheets."""

from __future__ import annotations

import csv
import io

from .calibration import Calibration, one_line

COLUMNS = (
    "offset",
    "joint",
    "kind",
    "unit",
    "status",
    "exported",
    "applied",
    "estimate",
    "std",
    "low95",
    "high95",
    "reason",
    "run",
    "run_sha256",
    "robot",
    "zerobeam",
    "notes",
)


def csv_text(calibration: Calibration) -> str:
    """One row a joint, every row with its provenance. A field is empty where the data cannot tell."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(COLUMNS)
    for offset in calibration.offsets:
        low, high = offset.interval95 or (None, None)
        table.writerow(
            [
                offset.name,
                _text(offset.joint),
                offset.kind,
                offset.unit,
                offset.status,
                "yes" if offset.exported else "no",
                offset.applied,
                offset.estimate,
                offset.std,
                low,
                high,
                _text(offset.reason or ""),
                _text(calibration.run),
                calibration.sha256,
                _text(calibration.robot),
                calibration.versions["zerobeam"],
                _text("; ".join(calibration.warnings)),
            ]
        )
    return file.getvalue()


def _text(name: str) -> str:
    """A name on one line; a leading apostrophe keeps a spreadsheet from taking it for a formula."""
    name = one_line(name)
    return f"'{name}" if name.startswith(("=", "+", "-", "@")) else name
