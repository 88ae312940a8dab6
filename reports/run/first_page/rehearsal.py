"""A simulated run beside the truth: what a rehearsal is for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

from ....analysis.answer.result import Result
from ....words import numbers
from ....words.rehearsal import true_values
from ....words.wording import label
from ...style.blocks import Paragraph, Row, Section, Table, row_of, section_of, table_of
from ..parameters import unit_of


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
    """The estimates beside their true values; None where there is none. What has no estimate has no row."""
    known = [
        _row(row.name, row.unit, true[row.name], row.estimate, row.std)
        for row in rows
        if row.name in true and row.estimate is not None and row.std is not None
    ]
    if not known:
        return None
    columns = [(head, "right") for head in ("true value", "estimate", "error", "error in u")]
    return table_of("True values of the simulated arm", [("name", "left"), *columns], known)


def _row(name: str, unit: str, true: float, estimate: float, std: float) -> Row:
    shown, digits = unit_of(unit), numbers.decimals(std)
    return row_of(
        label(name),
        numbers.with_unit(numbers.fixed(true, digits), shown),
        numbers.estimate(estimate, std, shown),
        numbers.with_unit(numbers.fixed(estimate - true, digits), shown),
        numbers.fixed((estimate - true) / std, 1),
    )
