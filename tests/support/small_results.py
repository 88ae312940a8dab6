"""As much of a result.json as is read back, made by hand."""

from collections.abc import Sequence
from typing import Any


def small_result(
    offsets: Sequence[dict[str, Any]], fit: dict[str, Any] | None = None, **inputs: Any
) -> dict[str, Any]:
    """A passed result of these rows of offsets; `fit` and `inputs` are changes of those parts."""
    absent = dict.fromkeys(("estimate", "std", "interval95", "reason"))
    rows = [{"unit": "deg", "group": "offset", "held": False, **absent, **row} for row in offsets]
    for row in rows:
        if row["std"] is not None:
            row["interval95"] = [-1.0, 1.0]
        if row["held"]:
            row["reason"] = "the base frame"
    numbers = {"noise_scale": None, "chi2": 5.0, "dof": 5, "p_value": 0.5}
    return {
        "schema": "zerobeam/result/1",
        "verdict": "pass",
        "headline": "All offsets are identified.",
        "parameters": rows,
        "fits": {"likelihood": {"converged": True, "reason": "", **numbers, **(fit or {})}},
        "posterior": {"converged": True, "message": None},
        "shots": [],
        "notes": [],
        "inputs": {"run": "run.jsonl", "sha256": "0", "robot": "arm", "shots": 7, "targets": [], "seed": 0}
        | {"versions": {"zerobeam": "0.1.0"}, "header": {}, **inputs},
    }
