"""A simulated run beside the truth: what a rehearsal is for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from ...analysis.result import Result
from ..style.blocks import Paragraph, Row, Section, Table, row_of, section_of, table_of
from ..words import numbers
from ..words.rehearsal import true_values
from ..words.wording import label
from .parameters import NO_NUMBER, unit_of


class Estimated(Protocol):
    """A parameter with what is known of it."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def estimate(self) -> float | None: ...
    @property
    def std(self) -> float | None: ...


def rehearsal_section(result: Result) -> Section | None:
    """Of a simulated run; None of any other."""
    table = truth_table(true_values(result.inputs.provenance), result.parameters)
    if table is None:
        return None
    about = Paragraph(
        "The run is simulated, so the true values are known. About two of three errors should be below 1 u,"
        " and 19 of 20 below 2 u."
    )
    return section_of("Rehearsal: estimates and true values", about, table)


def truth_table(true: Mapping[str, float], rows: Iterable[Estimated]) -> Table | None:
    """The parameters with a true value beside their estimates; None where there is none."""
    known = [row for row in rows if row.name in true]
    if not known:
        return None
    columns = [(head, "right") for head in ("true value", "estimate", "error", "error in u")]
    return table_of(
        "True values of the simulated arm", [("name", "left"), *columns], [_row(own, true) for own in known]
    )


def _row(row: Estimated, true: Mapping[str, float]) -> Row:
    unit, value = unit_of(row.unit), true[row.name]
    if row.estimate is None or row.std is None:
        written = numbers.with_unit(numbers.fixed(value, 4), unit)
        return row_of(label(row.name), written, NO_NUMBER, NO_NUMBER, NO_NUMBER)
    digits = numbers.decimals(row.std)
    error = row.estimate - value
    return row_of(
        label(row.name),
        numbers.with_unit(numbers.fixed(value, digits), unit),
        numbers.estimate(row.estimate, row.std, unit),
        numbers.with_unit(numbers.fixed(error, digits), unit),
        numbers.fixed(error / row.std, 1),
    )
