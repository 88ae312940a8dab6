"""What the data do not determine, and what would help."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...analysis.observability.causes import NullDirection
from ...analysis.observability.identifiability import Identifiability
from ...analysis.status import known
from ...words.geometry_words import geometry_title
from ...words.observability import combination_words, direction_kind, direction_remedy, rank_facts, reason
from ...words.wording import NOT_DETERMINED, WEAK, be, capital, counted, label, listed, person, sentence
from ..style.blocks import Direction, Directions, Facts, Paragraph, Section, section_of

if TYPE_CHECKING:
    from .parameter_section import JudgedParameter


def unobservable_section(parameters: Sequence[JudgedParameter], facts: Identifiability) -> Section:
    """The section of a report."""
    tolerated = [row for row in parameters if row.tolerated]
    others = [row for row in parameters if not row.tolerated]
    sentences = [_sentence(others, facts.null_space, "other parameter" if tolerated else "parameter")]
    if (only := tolerance_only(parameters)) is not None:
        sentences.append(f"{only} They are listed under {geometry_title(tolerated)}.")
    items = [direction_words(direction) for direction in facts.null_space]
    return section_of(
        "What cannot be determined", *map(Paragraph, sentences), Directions(items), Facts(rank_facts(facts))
    )


def tolerance_only(parameters: Sequence[JudgedParameter]) -> str | None:
    """How many tolerated parameters are known by their tolerances only; None where there is none."""
    free = [row for row in parameters if row.tolerated and not row.held]
    count = sum(not known(row.status) for row in free)
    if not count:
        return None
    of = geometry_title(free).lower()
    verb, its = ("is", "its") if count == 1 else ("are", "their")
    return f"{count} of {counted(len(free), 'parameter')} of {of} {verb} known by {its} tolerances only."


def _sentence(parameters: Sequence[JudgedParameter], directions: Sequence[NullDirection], what: str) -> str:
    lost = [label(row.name) for row in parameters if row.status == "unidentifiable"]
    assumed = [label(row.name) for row in parameters if row.status == "assumed"]
    weak = [label(row.name) for row in parameters if row.status == "weak"]
    if lost:
        text = f"{listed(lost)} {be(lost)} {NOT_DETERMINED}. No value is given, since the data contain none."
    elif assumed:
        text = f"{listed(assumed)} {be(assumed)} as good as what is assumed of tool and instruments."
    elif directions:
        text = (
            f"Every {what} that was not held has an estimate, but some combinations are only weakly"
            " observable."
        )
    else:
        text = f"Nothing: every {what} that was not held is determined by the data."
    return text + (f" {capital(WEAK)}, beyond the tolerance: {listed(weak)}." if weak else "")


def direction_words(direction: NullDirection) -> Direction:
    """A null-space direction as a combination, with why and what to do."""
    return Direction(
        combination=combination_words(direction.combination),
        kind=direction_kind(direction),
        reason=sentence(reason(direction.cause, person)),
        remedy=sentence(direction_remedy(direction, person)),
    )
