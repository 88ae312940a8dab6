"""The parameters of an answer: a table of them, what their status means, and why."""

from __future__ import annotations

from typing import Any

from ..style.blocks import Cell, LegendEntry, Reason, Row, Table, row_of, table_of
from ..words import numbers
from ..words.wording import label, listed, sentence

Json = dict[str, Any]

NOT_DETERMINED = "not determined by these data"
STATUS_WORDS = {
    "identified": "identified",
    "weak": "weak",
    "unidentifiable": "unidentifiable",
    "held": "held",
}


def unit_of(row: Json) -> str:
    """What follows a number of this parameter; a noise factor is so many times the stated noise."""
    return "times" if row["unit"] == "1" else str(row["unit"])


def parameter_table(caption: str, rows: list[Json]) -> Table:
    columns = [
        ("name", "left"),
        ("estimate", "right"),
        ("95 % interval", "right"),
        ("status", "left"),
    ]
    return table_of(caption, columns, [_parameter_row(row) for row in rows])


def _parameter_row(row: Json) -> Row:
    """One parameter. Without an estimate there is no number in its row that could be taken for one."""
    status, unit = row["status"], unit_of(row)
    name, word = label(row["name"]), Cell(STATUS_WORDS[status], mark=status)
    if status == "unidentifiable":
        return row_of(name, Cell(NOT_DETERMINED, span=2), word, tone=status)
    if status == "held":
        return row_of(
            name, Cell(f"held at {numbers.exact(row['estimate'], unit)}", span=2), word, tone=status
        )
    estimate = numbers.estimate(row["estimate"], row["std"], unit)
    interval = numbers.interval(tuple(row["interval95"]), row["std"], unit)
    return row_of(name, estimate, interval, word, tone=status)


def legend(parameters: list[Json], header: Json) -> list[LegendEntry]:
    """What each status that occurs means, in words."""
    tolerance = header.get("tolerance")
    stated = []
    if isinstance(tolerance, dict):
        for key, unit in (("offset_deg", "deg"), ("length_mm", "mm")):
            if isinstance(tolerance.get(key), int | float):
                stated.append(numbers.exact(float(tolerance[key]), unit))
    within = f"the tolerance ({', '.join(stated)})" if stated else "the tolerance"
    meaning = {
        "identified": f"the data alone tell it to a standard deviation within {within}",
        "weak": f"the data tell it, but to a standard deviation beyond {within}",
        "unidentifiable": "the data say less about it than was known before; it has no estimate",
        "held": "not estimated; the reason is stated below",
    }
    present = {row["status"] for row in parameters}
    return [LegendEntry(key, STATUS_WORDS[key], text) for key, text in meaning.items() if key in present]


def reasons(parameters: list[Json]) -> list[Reason]:
    """Why parameters are held, weak or without an answer, where the analysis says so; one reason once."""
    grouped: dict[tuple[str, str], list[str]] = {}
    for row in parameters:
        if row["reason"]:
            grouped.setdefault((row["status"], sentence(row["reason"])), []).append(label(row["name"]))
    rows = []
    for (status, text), names in grouped.items():
        lead = listed(names)
        # Most reasons begin with the name that they are about; it is not said twice.
        repeated = text.startswith(f"{lead} ")
        text = text.removeprefix(f"{lead} ")
        rows.append(Reason(lead if repeated else f"{lead}:", status, text))
    return rows
