"""The parameters of an answer: a table of them, what their status means, and why."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from ...analysis.observability.causes import Cause
from ...analysis.solution import ParameterResult
from ...analysis.status import Status
from ...model.parameters import Group
from ..style.blocks import (
    Cell,
    FigureBlock,
    Legend,
    LegendEntry,
    Reason,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..words import numbers
from ..words.causes import reason
from ..words.wording import NOT_DETERMINED, label, listed, person, sentence

OFFSETS = "Joint offsets, to be added to the recorded joint positions"
UNVALIDATED_OFFSETS = (
    "Joint offsets, unvalidated: the model does not describe the measurements; not to be applied"
)


class Judged(Protocol):
    """A parameter of a result or of a check."""

    @property
    def name(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def group(self) -> Group: ...
    @property
    def status(self) -> Status: ...
    @property
    def held(self) -> bool: ...
    @property
    def cause(self) -> Cause | None: ...


def offsets_caption(statuses: Iterable[Status]) -> str:
    """What stands above a table of offsets with these statuses."""
    return UNVALIDATED_OFFSETS if "unvalidated" in statuses else OFFSETS


def unit_of(unit: str) -> str:
    """What follows a number in this unit; a noise factor is so many times the stated noise."""
    return "times" if unit == "1" else unit


def noise_factors(parameters: Sequence[Judged]) -> bool:
    """Whether joints and spot have factors of their own, that are estimated."""
    return any(row.group == "noise" and not row.held for row in parameters)


def offsets_section(parameters: Sequence[ParameterResult], header: Mapping[str, object]) -> Section:
    """The offsets: the first thing that a reader sees."""
    offsets = [row for row in parameters if row.group == "offset"]
    return section_of(
        "Offsets",
        parameter_table(offsets_caption(row.status for row in offsets), offsets),
        Legend(legend(parameters, header), reasons(parameters)),
        FigureBlock("offsets"),
    )


def other_tables(parameters: Sequence[ParameterResult]) -> list[Table]:
    """Of what was estimated besides the offsets."""
    captions: tuple[tuple[str, Group], ...] = (
        ("Targets in the base frame", "target"),
        ("Tool in the flange frame", "tool"),
        ("Noise, as a multiple of the stated", "noise"),
    )
    groups = [(caption, [row for row in parameters if row.group == group]) for caption, group in captions]
    return [parameter_table(caption, rows) for caption, rows in groups if rows]


def parameter_table(caption: str, rows: Sequence[ParameterResult]) -> Table:
    columns = [("name", "left"), ("estimate", "right"), ("95 % interval", "right"), ("status", "left")]
    return table_of(caption, columns, [_parameter_row(row) for row in rows])


def _parameter_row(row: ParameterResult) -> Row:
    """One parameter. Without an estimate there is no number in its row that could be taken for one."""
    status, unit = row.status, unit_of(row.unit)
    name, word = label(row.name), Cell(status, mark=status)
    if row.held and row.estimate is not None:
        return row_of(name, Cell(f"held at {numbers.exact(row.estimate, unit)}", span=2), word, tone=status)
    if row.estimate is None or row.std is None or row.interval95 is None:
        return row_of(name, Cell(NOT_DETERMINED, span=2), word, tone=status)
    estimate = numbers.estimate(row.estimate, row.std, unit)
    return row_of(name, estimate, numbers.interval(row.interval95, row.std, unit), word, tone=status)


def legend(parameters: Sequence[Judged], header: Mapping[str, object]) -> list[LegendEntry]:
    """What each status that occurs means, in words."""
    tolerance = header.get("tolerance")
    stated = []
    if isinstance(tolerance, dict):
        for key, unit in (("offset_deg", "deg"), ("length_mm", "mm")):
            if isinstance(tolerance.get(key), int | float):
                stated.append(numbers.exact(float(tolerance[key]), unit))
    within = f"the tolerance ({', '.join(stated)})" if stated else "the tolerance"
    meaning: dict[Status, str] = {
        "identified": f"determined by the data without prior, standard uncertainty within {within}",
        "weak": f"weakly observable: determined by the data, standard uncertainty beyond {within}",
        "unvalidated": (
            "the data determine a number, but the model does not describe the measurements: neither estimate"
            " nor uncertainty can be relied on"
        ),
        "unidentifiable": "the data say less about it than its prior; it has no estimate",
        "held": "not estimated; the reason is stated below",
    }
    present = {row.status for row in parameters}
    return [LegendEntry(key, key, text) for key, text in meaning.items() if key in present]


def reasons(parameters: Sequence[Judged]) -> list[Reason]:
    """Why parameters are held, weak or without an answer; one reason once."""
    grouped: dict[tuple[Status, Cause], list[str]] = {}
    for row in parameters:
        if row.cause is not None:
            grouped.setdefault((row.status, row.cause), []).append(label(row.name))
    return [
        Reason(f"{listed(names)}:", status, sentence(reason(cause, person)))
        for (status, cause), names in grouped.items()
    ]
