"""What may explain a misfit: tried one by one, never applied."""

from __future__ import annotations

from ....analysis.answer.result import Result
from ....words.diagnosis import CAUSES, changed, diagnosis_said, explanation_sentence
from ....words.numbers import times
from ....words.wording import sentence
from ...style.blocks import Paragraph, Section, row_of, section_of, table_of


def diagnosis_section(result: Result) -> Section | None:
    """The explanations, the best first; None where there is none."""
    if not result.diagnosis:
        return None
    columns = [
        ("cause", "left"),
        ("tried", "left"),
        ("residuals", "right"),
        ("estimates", "right"),
        ("freed", "right"),
    ]
    rows = [
        row_of(
            CAUSES[found.cause],
            sentence(changed(found)),
            times(found.factor),
            times(found.farthest),
            f"{round(found.freed, 1):g}",
        )
        for found in result.diagnosis
    ]
    before = times(result.diagnosis[0].before)
    caption = (
        f"Tried, best first: residuals in multiples of the noise (as recorded: {before}), largest estimate in"
        " prior standard deviations, parameters freed"
    )
    first = sentence(explanation_sentence(result.diagnosis[0]))
    said = f"{first[0].upper()}{first[1:]}. {diagnosis_said(result.diagnosis)}"
    return section_of("What could be wrong", Paragraph(said), table_of(caption, columns, rows))
