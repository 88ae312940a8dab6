"""What `plan` is asked for, as the command line, the app and Python ask."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cells import LASER, header

from zerobeam.experiments.plans.make import PlanRequest
from zerobeam.model.files.plan_file import Obstacles


def plan_request(**changes: Any) -> PlanRequest:
    stated: dict[str, Any] = {
        "kind": "optimal",
        "header": header(LASER, target=None),
        "header_folder": Path("."),
        "target": (900.0, 0.0, 0.0),
        "shots": 7,
        "measure": {},
        "candidates": 300,
        "criterion": "A",
        "tolerance": None,
        "max_shots": 12,
        "facing": (0.0, 0.0, 1.0),
        "acceptance_deg": 60.0,
        "beam_mm": (200.0, 2000.0),
        "margin_deg": 5.0,
        "obstacles": Obstacles(),
        "seed": 0,
    }
    return PlanRequest(**{**stated, **changes})
