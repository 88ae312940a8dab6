"""What `plan` is asked for, as the command line, the app and Python ask."""

from pathlib import Path
from typing import Any

from cells import LASER, header

from zerobeam.experiments.plans.make import PlanRequest


def plan_request(**changes: Any) -> PlanRequest:
    stated: dict[str, Any] = {
        "header": header(LASER, target=None),
        "header_folder": Path("."),
        "target": (900.0, 0.0, 0.0),
        "shots": 7,
        "repeat": 0,
        "candidates": 300,
        "max_shots": 12,
    }
    return PlanRequest(**{**stated, **changes})
