"""After the first thing to do: values to enter, commands to type."""

from __future__ import annotations

from ...analysis.answer.result import Result
from ...words.message import message, next_steps
from ..style.blocks import Block, Commands, Paragraph, Section, section_of


def next_steps_section(result: Result) -> Section | None:
    """The section of the report; None where the message says it all."""
    content = message(result)
    advice = next_steps(result, content)
    blocks: list[Block] = []
    if advice.enter and content.may.enter:
        blocks.append(
            Paragraph("Enter the values of page one: corrected reading = recorded position + value.")
        )
    for step in advice.steps[1:]:
        blocks.append(Paragraph(step.text))
        if step.commands:
            blocks.append(Commands(step.commands))
    return section_of("What to do next", *blocks) if blocks else None
