"""What would make an answer better: a table of remedies with what each is predicted to give."""

from __future__ import annotations

from collections.abc import Iterable

from ...analysis.answer.result import Result
from ...analysis.observability.outlook import Outlook
from ...words.case import RunCase
from ...words.geometry_words import OffsetRow
from ...words.outlook_words import (
    HEADS,
    TITLE,
    best_remedies,
    outlook_notes,
    plan_command,
    remedy_words,
)
from ...words.region_words import region_short
from ...words.wording import joints
from ..style.blocks import Block, Commands, Paragraph, Section, row_of, section_of, table_of


def outlook_blocks(
    outlook: Outlook | None, rows: Iterable[OffsetRow], planned: str | None, *, brief: bool
) -> list[Block]:
    """At most three remedies if `brief`, else all beside the answer as it is, with the commands; `rows` are
    those of the offsets, `planned` as of `plan_command`. Nothing where none gains anything."""
    if outlook is None or not outlook.worth:
        return []
    shown = (
        best_remedies(outlook)
        if brief
        else [outlook.now, *(row for row in outlook.remedies if row.gain >= 0)]
    )
    units = {row.name: row.unit for row in rows if any(row.name in one.U for one in shown)}
    words = [remedy_words(one, outlook.now, units) for one in shown]
    if brief:
        head = f"{TITLE} (TCP: {region_short(outlook.region)})"
        cells = [row_of(one.remedy, one.largest, one.tcp_median, one.minutes) for one in words]
        return [table_of("", [head, "largest U", "TCP", "time"], cells, "lr")]
    cells = [row_of(one.remedy, *one.U, one.tcp_median, one.tcp_95, one.minutes) for one in words]
    heads = ["", *(joints([name])[0] for name in units), *HEADS]
    table = table_of(f"{TITLE}: predicted U (k = 2) of each offset, and error of the TCP", heads, cells, "lr")
    commands = [command for row in shown if (command := plan_command(planned, row)) is not None]
    return [table, *map(Paragraph, outlook_notes(outlook)), *([Commands(commands)] if commands else [])]


def outlook_section(result: Result) -> Section | None:
    """Of a run; None where nothing gains anything, or by a model that does not describe it."""
    planned = RunCase.of_result(result).planned
    blocks = outlook_blocks(result.outlook, result.offsets, planned, brief=False)
    return section_of(TITLE, *blocks) if blocks else None
