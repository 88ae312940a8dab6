"""Logs over time of which a maker states the layout: `zerobeam import log NAME`."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

from ...model.options import J3Origin, Option
from .generic.layouts import CsvLayout, Stillness
from .maker import Decimal, KnownLog, MarkerColumn, in_order, makers

if TYPE_CHECKING:
    from .import_jobs import Imported, ImportJob


def known_logs() -> list[KnownLog]:
    """Those of all makers, as help lists them."""
    return in_order([log for maker in makers() for log in maker.logs], ("ur", "egm", "robodk"))


def read_log(
    job: "ImportJob",
    layout: Callable[[int], CsvLayout],
    still: Stillness,
    delimiter: Annotated[str | None, Option("Delimiter between two values, if not the usual one.")] = None,
    decimal: Decimal = ".",
    marker_column: MarkerColumn = None,
    j3: J3Origin = None,
) -> "Imported":
    """Logs over time of a known layout: a measurement is where the arm dwells. Other logs: import csv."""
    from .generic.joint_logs import import_csv

    usual = layout(job.robot.n)
    columns = replace(
        usual, delimiter=delimiter or usual.delimiter, decimal=decimal, marker_column=marker_column, j3=j3
    )
    return import_csv(job, columns, still.required())
