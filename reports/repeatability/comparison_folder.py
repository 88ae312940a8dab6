"""The folder of a comparison: compare.html, .pdf, .json (docs/compare.md), offsets.csv, the figure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from ...analysis.repeatability.compare import (
    COMPARE_SCHEMA,
    Comparison,
)
from ...model.records import dumps
from ...words.sentences import to_json
from ..output import whole_folder
from ..output.whole_folder import Kind, write_folder, write_page
from .comparison_page import comparison_page, runs_picture

_JSON, _TABLE = "compare.json", "offsets.csv"
_KIND = Kind(
    "comparison", frozenset({"compare.html", "compare.pdf", _JSON, _TABLE, "figures"}), _JSON, COMPARE_SCHEMA
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


def write_comparison(folder: Path | str, comparison: Comparison) -> ComparisonPaths:
    """Write a comparison (`zerobeam/compare/1`) to `folder`, replacing one that zerobeam wrote there before.

    Whole or not at all. Raises BadInput where `folder` is a file, is not ours, or cannot be written.
    """
    folder = Path(folder)
    names = write_folder(folder, _KIND, lambda new_folder: _write_files(new_folder, comparison))
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


def _write_files(folder: Path, comparison: Comparison) -> list[str]:
    picture = runs_picture(comparison)
    return write_page(
        folder,
        "compare",
        comparison_page(comparison),
        {} if picture is None else {picture.name: picture},
        "study",
        answer=(_JSON, dumps(to_json(comparison))),
        tables={_TABLE: offset_rows(comparison)},
    )
