"""The parameters of an answer: a table of them, what their status means, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Protocol

from ...analysis.observability.causes import Cause
from ...analysis.observability.geometry import GeometryResult
from ...analysis.status import Status
from ...model.likelihood.parameters import Group
from ...words import numbers
from ...words.causes import reason
from ...words.geometry import (
    IF_IT_DEVIATES,
    SET_BY_TOLERANCES,
    Offset,
    by_tolerances,
    percent,
    worth_sentence,
)
from ...words.wording import NOT_DETERMINED, label, listed, person, sentence
from ..style.blocks import (
    Cell,
    Column,
    FigureBlock,
    Legend,
    LegendEntry,
    Paragraph,
    Reason,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)

if TYPE_CHECKING:
    from ...analysis.answer.result import Result
    from ...analysis.solution import ParameterResult

OFFSETS = "Joint offsets, to be added to the recorded joint positions"
NO_NUMBER = "—"
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
    @property
    def tolerance_share(self) -> float | None: ...


def offsets_caption(statuses: Iterable[Status]) -> str:
    """What stands above a table of offsets with these statuses."""
    return UNVALIDATED_OFFSETS if "unvalidated" in statuses else OFFSETS


def unit_of(unit: str) -> str:
    """What follows a number in this unit; a noise factor is so many times the stated noise."""
    return "times" if unit == "1" else unit


def noise_factors(parameters: Sequence[Judged]) -> bool:
    """Whether joints and spot have factors of their own, that are estimated."""
    return any(row.group == "noise" and not row.held for row in parameters)


def offsets_section(result: Result) -> Section:
    """The offsets: the first thing that a reader sees. The geometry has a section of its own."""
    others = [row for row in result.parameters if row.group != "geometry"]
    worth = offsets_worth(result)
    return section_of(
        "Offsets",
        offsets_table(result),
        None if worth is None else Paragraph(worth),
        Legend(legend((row.status for row in others), result.inputs.header), reasons(others)),
        FigureBlock("offsets"),
    )


def offsets_worth(result: Result) -> str | None:
    """What u is worth if the geometry is not as it was taken. A misfit has found it wrong already: None."""
    if result.misfit is not None:
        return None
    return worth_sentence(result.geometry, [row for row in result.parameters if row.group == "offset"])


def offsets_table(result: Result) -> Table:
    """The offsets with their uncertainties; of a misfit without what those would be worth."""
    offsets = [row for row in result.parameters if row.group == "offset"]
    table = parameter_table(offsets_caption(row.status for row in offsets), offsets)
    if offsets_worth(result) is None:
        return table
    worth, of = worth_column(result.geometry)
    columns = (*table.columns, Column("u", "right"), Column(worth, "right"))
    rows = []
    for row, shown in zip(offsets, table.rows, strict=True):
        u = NO_NUMBER if row.std is None else numbers.spread(row.std, unit_of(row.unit))
        rows.append(Row((*shown.cells, Cell(u), Cell(of(row))), shown.tone))
    return Table(table.caption, columns, rows)


def worth_column(geometry: GeometryResult) -> tuple[str, Callable[[Offset], str]]:
    """The head of the column beside u, and what it says of an offset."""
    if geometry.stated:
        return SET_BY_TOLERANCES, _share

    def considered(row: Offset) -> str:
        value = None if row.std is None else geometry.consider.get(row.name)
        return NO_NUMBER if value is None else numbers.spread(value, unit_of(row.unit))

    return IF_IT_DEVIATES, considered


def _share(row: Offset) -> str:
    return NO_NUMBER if row.tolerance_share is None else percent(row.tolerance_share)


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


def legend(statuses: Iterable[Status], header: Mapping[str, object]) -> list[LegendEntry]:
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
    present = set(statuses)
    return [LegendEntry(key, key, text) for key, text in meaning.items() if key in present]


def reasons(parameters: Sequence[Judged]) -> list[Reason]:
    """Why parameters are held, weak or without an answer; one reason once."""
    grouped: dict[tuple[Status, str], list[str]] = {}
    for row in parameters:
        if row.cause is not None:
            own = by_tolerances(row.cause, row.tolerance_share) or reason(row.cause, person)
            grouped.setdefault((row.status, own), []).append(label(row.name))
    return [Reason(f"{listed(names)}:", status, sentence(text)) for (status, text), names in grouped.items()]
