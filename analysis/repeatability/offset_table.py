"""A table of published offsets (CSV) for `compare`: values without uncertainties."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...model.errors import BadInput
from ...model.files.reading import read_text, shown
from ...model.files.validation import LARGEST
from .repeat import Repeat


def read_table(path: Path) -> Iterator[Repeat]:
    """A run for each row: `run`, then columns such as `delta2_deg`; an empty cell is an offset not given."""
    text, sha256 = read_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    try:
        rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(row)]
    except csv.Error as error:
        raise BadInput(f"the file is not valid CSV: {error}", file=path, line=reader.line_num) from None
    if not rows:
        raise BadInput("the table has no rows", file=path)
    line, head = rows[0]
    offsets = [_column(name, path, line) for name in head[1:]]
    names = tuple(name for name, _ in offsets)
    if head[0] != "run" or not offsets or len(set(names)) != len(names):
        raise BadInput(
            "the header row of a table of offsets is wrong",
            found=shown(",".join(head)),
            allowed="run, then each offset once with its unit: run,delta2_deg,delta3_deg",
            file=path,
            line=line,
        )
    if len(rows) < 3:
        raise BadInput("one run cannot be compared", found=f"{len(rows) - 1} rows", file=path)
    seen: set[str] = set()
    for line, row in rows[1:]:
        if len(row) != len(head) or not row[0] or row[0] in seen:
            raise BadInput(
                "this row of the table cannot be used",
                found=shown(",".join(row)),
                allowed=f"{len(head)} cells, the first a name that no other run has",
                file=path,
                line=line,
            )
        seen.add(row[0])
        units = [unit for _, unit in offsets]
        cells = zip(row[1:], units, strict=True)
        value = np.array([_number(cell, LARGEST[unit], path, line) for cell, unit in cells])
        yield Repeat(
            name=row[0],
            sha256=sha256,
            robot=None,
            shots=None,
            when=None,
            names=names,
            units=tuple(units),
            held=(),
            status=tuple("not stated" if math.isnan(own) else "stated" for own in value),
            value=value,
            covariance=None,
            by_geometry=np.zeros((len(names), 0)),
            geometry=(),
            joint=False,
            noise_scale=1.0,
            noise_dof=None,
            findings=(),
            failure=None,
        )


def _column(stated: str, path: Path, line: int) -> tuple[str, str]:
    """delta2_deg: name and unit."""
    name, _, unit = stated.rpartition("_")
    if not name or unit not in LARGEST:
        raise BadInput(
            "a column of a table of offsets has no unit in its name",
            found=shown(stated),
            allowed=f"a name and one of {', '.join('_' + unit for unit in LARGEST)}, such as delta2_deg",
            file=path,
            line=line,
        )
    return name, unit


def _number(cell: str, most: float, path: Path, line: int) -> float:
    if not cell:
        return math.nan
    try:
        value = float(cell) if "_" not in cell else math.nan
    except ValueError:
        value = math.nan
    if not -most <= value <= most:
        raise BadInput(
            "this is not an offset",
            found=shown(cell),
            allowed=f"a number up to {most:g} with a decimal point; an empty cell where none is given",
            file=path,
            line=line,
        )
    return value
