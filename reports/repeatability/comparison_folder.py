"""The folder of a comparison: compare.html, .pdf, .json (docs/compare.md), offsets.csv, the figure."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ...analysis.repeatability.compare import COMPARE_SCHEMA, Comparison
from ...words.sentences import to_json
from ..output.whole_folder import FolderContents, Kind, Written, write_answer
from .comparison_page import comparison_page, runs_picture

_TABLE = "offsets.csv"
COMPARISON = Kind.of_answer("comparison", "compare.json", COMPARE_SCHEMA, _TABLE)


def write_comparison(folder: Path | str, comparison: Comparison) -> Written:
    """Write a comparison (`zerobeam/compare/1`) to `folder`. Raises as `write_answer`."""
    tables = {_TABLE: offset_rows(comparison)}
    page, picture = comparison_page(comparison), runs_picture(comparison)
    return write_answer(folder, COMPARISON, FolderContents(to_json(comparison), page, [picture], tables))


def offset_rows(comparison: Comparison) -> Iterator[dict[str, object]]:
    """`offsets.csv`: one row for each offset and run, with what holds for the offset over all runs."""
    for i, row in enumerate(comparison.offsets):
        low, high = row.mean.interval95 if row.mean else (None, None)
        for run in comparison.runs:
            offset = run.offsets[i]
            yield {
                "offset": row.name,
                "unit": row.unit,
                "run": run.name,
                "at": run.at,
                "status": offset.status,
                "estimate": offset.estimate,
                "std": offset.std,
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
