"""What the data do not determine, and what would help."""

from __future__ import annotations

from collections.abc import Sequence

from ...analysis.observability.causes import NullDirection
from ...analysis.observability.identifiability import Identifiability
from ..style.blocks import Direction, Directions, Facts, Paragraph, Section, section_of
from ..words.causes import reason, remedy
from ..words.observability import combination_words, direction_kind, rank_facts
from ..words.wording import NOT_DETERMINED, label, listed, person, sentence
from .parameters import Judged


def unobservable_section(parameters: Sequence[Judged], facts: Identifiability) -> Section:
    """The section of a report."""
    said = _sentence(parameters, facts)
    items = [direction_words(direction) for direction in facts.null_space]
    return section_of(
        "What cannot be determined", Paragraph(said), Directions(items), Facts(rank_facts(facts))
    )


def _sentence(parameters: Sequence[Judged], facts: Identifiability) -> str:
    lost = [label(row.name) for row in parameters if row.status == "unidentifiable"]
    weak = [label(row.name) for row in parameters if row.status == "weak"]
    if lost:
        verb = "is" if len(lost) == 1 else "are"
        said = f"{listed(lost)} {verb} {NOT_DETERMINED}. No value is given, since any would be made up."
    elif any(row.status == "unvalidated" for row in parameters):
        said = (
            "The measurements would determine every parameter that was not held, but the model does not"
            " describe them: nothing here is validated."
        )
    elif facts.null_space:
        said = (
            "Every parameter that was not held has an estimate, but some combinations are only weakly"
            " observable."
        )
    else:
        said = "Nothing that was asked for: every parameter that was not held is determined by the data."
    return said + (f" Weakly observable, beyond the tolerance: {listed(weak)}." if weak else "")


def direction_words(direction: NullDirection) -> Direction:
    """A null-space direction as a combination, with why and what to do."""
    return Direction(
        combination=combination_words(direction.combination),
        kind=direction_kind(direction),
        reason=sentence(reason(direction.cause, person)),
        remedy=sentence(remedy(direction.cause, person)),
    )
