"""The files of a batch beside the runs' own folders: the page, the answer as JSON, the tables."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ...experiments.batch import Batch
from ...model.errors import missing_extra
from ...model.files.whole_file import write_whole
from ...model.records import dumps, to_json
from ...words.spreadsheet import csv_text
from ..output.html import html
from ..studies.study_blocks import flat
from .batch_page import batch_page, uncertainty_picture

PAGE, ANSWER, RUNS, OFFSETS = "batch.html", "batch.json", "runs.csv", "offsets.csv"
_PARQUET = {RUNS: "runs.parquet", OFFSETS: "offsets.parquet"}
_NUMBERS = {
    **dict.fromkeys(("worst_u", "residuals_over_noise", "p_value", "estimate", "u"), "float64"),
    **{"low95": "float64", "high95": "float64", "measurements": "int64"},
}  # columns of Parquet; the others are text
FILES = frozenset({PAGE, ANSWER, RUNS, OFFSETS, *_PARQUET.values()})


def write_batch(folder: Path, done: Batch, *, parquet: bool) -> None:
    """Write batch.html, batch.json, runs.csv and offsets.csv, each whole; with `parquet` these as well."""
    picture = uncertainty_picture(done.rows)
    pictures = {} if picture is None else {picture.name: picture}
    write_whole(folder / ANSWER, dumps(to_json(done)), force=True)
    for name, rows in ((RUNS, run_rows), (OFFSETS, _OFFSET_ROWS)):
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


# `runs.csv` has a row for each run, `offsets.csv` one for each offset of each run.
_RUN_ROWS: Any = flat(
    "rows",
    "run=1.name file outcome robot serial when measurements worst_offset=1.worst.name worst_u=1.worst.u"
    " unit=1.worst.unit residuals_over_noise=1.factor p_value misfit odd_offset posterior message sha256",
)
_OFFSET_ROWS: Any = flat(
    "rows offsets",
    "run=1.name robot=1.robot serial=1.serial when=1.when outcome=1.outcome offset=2.name unit status"
    " estimate u low95=2.interval95.0 high95=2.interval95.1",
)


def run_rows(done: Batch) -> Iterator[dict[str, object]]:
    """`runs.csv`."""
    outlier_of = {outlier.run: outlier.offset for outlier in reversed(done.outliers)}
    return ({**row, "odd_offset": outlier_of.get(str(row["run"]))} for row in _RUN_ROWS(done))


def _parquet(rows: list[dict[str, object]]) -> bytes:
    require_parquet()
    import pyarrow
    import pyarrow.parquet

    names = list(rows[0]) if rows else []
    kinds = pyarrow.schema([(name, getattr(pyarrow, _NUMBERS.get(name, "string"))()) for name in names])
    out = io.BytesIO()
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows, schema=kinds), out)
    return out.getvalue()
