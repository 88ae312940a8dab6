"""`zerobeam/compare/1`: a comparison as plain JSON types, null where there is no answer (docs/compare.md)."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from ...analysis.repeatability.compare import CHANCE, ComparedOffset, ComparedRun, Comparison
from ...analysis.repeatability.consistency import LEVEL
from ...words.comparison import failure, headline, notes

SCHEMA = "zerobeam/compare/1"


def comparison_json(found: Comparison) -> dict[str, Any]:
    """The answer of `compare --json` and `compare.json`."""
    return {
        "schema": SCHEMA,
        "kind": found.kind,
        "verdict": found.verdict,
        "headline": headline(found),
        "odd_run": found.odd_run,
        "differing": list(found.differing),
        "drifting": list(found.drifting),
        "misfit": found.misfits,
        "consistency": _plain(found.consistency),
        "offsets": [_offset(row) for row in found.offsets],
        "runs": [_run(run) for run in found.runs],
        "held": list(found.held),
        "failed": found.failed,
        "settings": {
            "seed": found.seed,
            "level": LEVEL,
            "chance": CHANCE,
            "asked": list(found.asked),
            "order": "time" if found.by_time else "given",
            "at_unit": "h" if found.by_time else "run",
        },
        "versions": found.versions,
        "notes": list(notes(found)),
    }


def _offset(row: ComparedOffset) -> dict[str, Any]:
    mean, scatter, test = row.mean, row.scatter, row.test
    return {
        "name": row.name,
        "unit": row.unit,
        "runs": row.runs,
        "unvalidated": row.unvalidated,
        "std": scatter and scatter.std,
        "std_interval95": scatter and list(scatter.interval95),
        "predicted_std": row.predicted_std,
        "ratio": test and test.ratio,
        "ratio_interval95": test and list(test.ratio_interval95),
        "chi2": test and test.chi2,
        "dof": test and test.dof,
        "p_value": test and test.p_value,
        "p_holm": test and test.p_holm,
        "drift": _plain(row.drift),
        "mean": mean and mean.value,
        "mean_interval95": mean and list(mean.interval95),
        "mean_by": mean and mean.by,
    }


def _run(run: ComparedRun) -> dict[str, Any]:
    return {
        "name": run.name,
        "sha256": run.sha256,
        "robot": run.robot,
        "shots": run.shots,
        "when": run.when,
        "at": run.at,
        "failure": None if run.failure is None else failure(run.failure),
        "misfit": run.misfit,
        "odd": _plain(run.odd),
        "offsets": [asdict(own) for own in run.offsets],
    }


def _plain(row: Any) -> dict[str, Any] | None:
    """A dataclass of numbers with the names of its fields; tuples are lists."""
    if row is None:
        return None
    return {key: list(value) if isinstance(value, tuple) else value for key, value in asdict(row).items()}
