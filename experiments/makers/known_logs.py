"""Logs over time of which a maker states the layout: `zerobeam import log NAME`."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Annotated, Any

from ...model.options import Option
from .maker import (
    Decimal,
    J3Counting,
    KnownLog,
    MarkerColumn,
    StillDeg,
    StillMm,
    StillSeconds,
    in_order,
    makers,
)

if TYPE_CHECKING:
    from .import_jobs import Imported, ImportJob


def known_logs() -> list[KnownLog]:
    """Those of all makers, as help lists them."""
    return in_order([log for maker in makers() for log in maker.logs], ("ur", "egm", "robodk"))


def read_log(
    job: "ImportJob",
    layout: Callable[[int], Any],
    still_deg: StillDeg = None,
    still_s: StillSeconds = None,
    still_mm: StillMm = None,
    delimiter: Annotated[str | None, Option("Delimiter between two values, if not the usual one.")] = None,
    decimal: Decimal = ".",
    marker_column: MarkerColumn = None,
    j3: J3Counting = None,
) -> "Imported":
    """Logs over time of a known layout: a measurement is where the arm dwells. Other logs: import csv."""
    from .generic.csv_file import import_log
    from .generic.dwells import Stillness

    still = Stillness.required(still_deg, still_s, still_mm)
    return import_log(
        layout,
        job,
        still=still,
        delimiter=delimiter,
        decimal=decimal,
        marker_column=marker_column,
        j3=j3,
    )
