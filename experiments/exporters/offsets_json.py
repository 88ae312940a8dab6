"""The offsets as JSON, schema `zerobeam/offsets/1`: for programs."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from .calibration import MEANING, SEED, Calibration

SCHEMA = "zerobeam/offsets/1"


def document(calibration: Calibration) -> dict[str, Any]:
    """The offsets as plain values. What the data cannot tell is null; `applied` is what is to be added."""
    return {
        "schema": SCHEMA,
        "meaning": MEANING,
        "offsets": [
            {**asdict(offset), "exported": offset.exported, "applied": offset.applied}
            for offset in calibration.offsets
        ],
        "notes": list(calibration.warnings),
        "inputs": {
            "run": calibration.run,
            "sha256": calibration.sha256,
            "robot": calibration.robot,
            "shots": calibration.shots,
            "seed": SEED,
            "versions": calibration.versions,
        },
    }


def json_text(calibration: Calibration) -> str:
    """Text of the JSON file: ASCII, so that no name can be anything but a text in it."""
    return json.dumps(document(calibration), indent=1, allow_nan=False) + "\n"
