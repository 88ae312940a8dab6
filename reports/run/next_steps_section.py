"""After the first thing to do: values to enter, commands to type."""

from __future__ import annotations

from ...analysis.answer.result import Result
from ...words.message import message, next_steps
from ...words.wording import label
from ..style.blocks import Block, Cell, Commands, Paragraph, Section, row_of, section_of, table_of


def next_steps_section(result: Result) -> Section | None:
    """The section of the report; None where the message says it all."""
    advice = next_steps(result, message(result))
    blocks: list[Block] = []
    if advice.enter:
        columns = ["joint", "to enter", "U", "status", "offset of the arm"]
        rows = [
            row_of(
                label(row.name).partition(" ")[0],
                row.value,
                row.expanded_u,
                "" if row.status is None else Cell(row.status, mark=row.status),
                row.estimate or "",
                tone=row.status or "",
            )
            for row in advice.enter
        ]
        caption = "Values to enter: corrected reading = recorded position + value"
        blocks.append(table_of(caption, columns, rows, "lrrlr"))
    for step in advice.steps[1:]:
        blocks.append(Paragraph(step.text))
        if step.commands:
            blocks.append(Commands(step.commands))
    return section_of("What to do next", *blocks) if blocks else None
