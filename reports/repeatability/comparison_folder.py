"""The folder of a comparison: compare.html, .pdf, .json (docs/compare.md), offsets.csv, the figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ...analysis.repeatability.compare import CHANCE, ComparedOffset, ComparedRun, Comparison
from ...analysis.repeatability.consistency import LEVEL
from ...words.comparison import failure, headline, notes
from ...words.result_json import dumps
from ..output import whole_folder
from ..output.page_files import write_page
from ..output.whole_folder import Kind, write_folder
from .comparison_page import comparison_page, runs_picture

SCHEMA = "zerobeam/compare/1"
_JSON, _TABLE = "compare.json", "offsets.csv"
_KIND = Kind(
    "comparison", frozenset({"compare.html", "compare.pdf", _JSON, _TABLE, "figures"}), _JSON, SCHEMA
)


@dataclass(frozen=True)
class ComparisonPaths:
    """The files of a comparison."""

    folder: Path
    html: Path
    pdf: Path
    compare: Path
    table: Path
    figures: tuple[Path, ...]


def write_comparison(folder: Path | str, found: Comparison) -> ComparisonPaths:
    """Write a comparison (`zerobeam/compare/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    folder = Path(folder)
    names = write_folder(folder, _KIND, lambda aside: _write_files(aside, found))
    return ComparisonPaths(
        folder=folder,
        html=folder / "compare.html",
        pdf=folder / "compare.pdf",
        compare=folder / _JSON,
        table=folder / _TABLE,
        figures=tuple(folder / "figures" / name for name in names),
    )


def check_target(folder: Path | str) -> None:
    """Raise BadInput unless a comparison may be written to `folder`."""
    whole_folder.check_target(folder, _KIND)


def offset_rows(found: Comparison) -> Iterator[dict[str, object]]:
    """`offsets.csv`: one row for each offset and run, with what holds for the offset over all runs."""
    for i, row in enumerate(found.offsets):
        low, high = row.mean.interval95 if row.mean else (None, None)
        for run in found.runs:
            own = run.offsets[i]
            yield {
                "offset": row.name,
                "unit": row.unit,
                "run": run.name,
                "at": run.at,
                "status": own.status,
                "estimate": own.estimate,
                "std": own.std,
                "mean": row.mean and row.mean.value,
                "mean_low": low,
                "mean_high": high,
                "observed_std": row.scatter and row.scatter.std,
                "predicted_std": row.predicted_std,
                "ratio": row.test and row.test.ratio,
                "p_holm": row.test and row.test.p_holm,
                "slope": row.drift and row.drift.slope,
                "slope_p_holm": row.drift and row.drift.p_holm,
            }


def _write_files(folder: Path, found: Comparison) -> list[str]:
    picture = runs_picture(found)
    return write_page(
        folder,
        "compare",
        comparison_page(found),
        {} if picture is None else {picture.name: picture},
        "study",
        answer=(_JSON, dumps(comparison_json(found))),
        tables={_TABLE: offset_rows(found)},
    )


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
