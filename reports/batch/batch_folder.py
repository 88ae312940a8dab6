"""The files of a batch beside the runs' own folders: the page, the answer as JSON, the tables."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

from ...experiments.batch import Batch
from ...model.errors import missing_extra
from ...model.files.whole_file import write_whole
from ...model.records import dumps, to_json
from ...words.spreadsheet import csv_text
from ..output.html import html
from .batch_page import batch_page, uncertainty_picture

PAGE, ANSWER, RUNS, OFFSETS = "batch.html", "batch.json", "runs.csv", "offsets.csv"
_PARQUET = {RUNS: "runs.parquet", OFFSETS: "offsets.parquet"}
FILES = frozenset({PAGE, ANSWER, RUNS, OFFSETS, *_PARQUET.values()})


def write_batch(folder: Path, done: Batch, *, parquet: bool) -> None:
    """Write batch.html, batch.json, runs.csv and offsets.csv, each whole; with `parquet` these as well."""
    picture = uncertainty_picture(done.rows)
    pictures = {} if picture is None else {picture.name: picture}
    write_whole(folder / ANSWER, dumps(to_json(done)), force=True)
    for name, rows in ((RUNS, run_rows), (OFFSETS, offset_rows)):
        write_whole(folder / name, csv_text(rows(done)), force=True)
        if parquet:
            write_whole(folder / _PARQUET[name], _parquet(list(rows(done))), force=True)
        else:
            (folder / _PARQUET[name]).unlink(missing_ok=True)  # of other runs than these
    write_whole(folder / PAGE, html(batch_page(done), pictures, "study"), force=True)


def require_parquet() -> None:
    """BadInput where the library for Parquet is missing."""
    try:
        import pyarrow.parquet  # noqa: F401
    except ImportError:
        raise missing_extra("a table in Parquet", "parquet", needed="pyarrow") from None


def run_rows(done: Batch) -> Iterator[dict[str, object]]:
    """`runs.csv`: one row for each run."""
    outlier_of = {outlier.run: outlier.offset for outlier in reversed(done.outliers)}
    for row in done.rows:
        worst = row.worst
        yield {
            "run": row.name,
            "file": row.file,
            "outcome": row.outcome,
            "robot": row.robot,
            "serial": row.serial,
            "when": row.when,
            "measurements": row.measurements,
            "worst_offset": worst and worst.name,
            "worst_u": worst and worst.u,
            "unit": worst and worst.unit,
            "residuals_over_noise": row.factor,
            "p_value": row.p_value,
            "misfit": " ".join(row.misfit),
            "odd_offset": outlier_of.get(row.name),
            "posterior": row.posterior,
            "message": row.message,
            "sha256": row.sha256,
        }


def offset_rows(done: Batch) -> Iterator[dict[str, object]]:
    """`offsets.csv`: one row for each offset of each run."""
    for row in done.rows:
        for offset in row.offsets:
            low, high = offset.interval95 or (None, None)
            yield {
                "run": row.name,
                "robot": row.robot,
                "serial": row.serial,
                "when": row.when,
                "outcome": row.outcome,
                "offset": offset.name,
                "unit": offset.unit,
                "status": offset.status,
                "estimate": offset.estimate,
                "u": offset.u,
                "low95": low,
                "high95": high,
            }


def _parquet(rows: list[dict[str, object]]) -> bytes:
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    numbers = {
        "worst_u": pyarrow.float64(),
        "residuals_over_noise": pyarrow.float64(),
        "p_value": pyarrow.float64(),
        "measurements": pyarrow.int64(),
        "estimate": pyarrow.float64(),
        "u": pyarrow.float64(),
        "low95": pyarrow.float64(),
        "high95": pyarrow.float64(),
    }
    names = list(rows[0]) if rows else []
    kinds = pyarrow.schema([(name, numbers.get(name, pyarrow.string())) for name in names])
    out = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows, schema=kinds), out)
    return out.getvalue()
