"""What to do with the answer, as the section of a report."""

from __future__ import annotations

from collections.abc import Sequence

from ....analysis.answer.document import ValueToEnter
from ....analysis.answer.result import Result
from ....words.next_steps import next_steps
from ....words.wording import label
from ...style.blocks import Block, Commands, Paragraph, Section, Table, row_of, section_of, table_of


def next_steps_section(result: Result) -> Section:
    """The section of the report, of any answer."""
    found = next_steps(result)
    blocks: list[Block] = [] if not found.enter else [_values(found.enter)]
    for step in found.steps:
        blocks.append(Paragraph(step.text))
        if step.commands:
            blocks.append(Commands(step.commands))
    return section_of("What to do", *blocks)


def _values(entries: Sequence[ValueToEnter]) -> Table:
    columns = [("joint", "left"), ("add to the recorded position", "right"), ("expanded U (k = 2)", "right")]
    rows = [row_of(label(own.name).partition(" ")[0], own.value, own.expanded_u) for own in entries]
    return table_of("Values to enter: true position = recorded position + value", columns, rows)
