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
    geometry = {row.name for row in parameters if row.group == "geometry"}
    others = [row for row in parameters if row.group != "geometry"]
    shown, links = parted(facts.null_space, geometry)
    said = [_sentence(others, shown)]
    if links:
        said.append(tolerance_only(len(links)))
    items = [direction_words(direction) for direction in shown]
    return section_of(
        "What cannot be determined", *map(Paragraph, said), Directions(items), Facts(rank_facts(facts))
    )


def parted(
    directions: Sequence[NullDirection], geometry: set[str]
) -> tuple[list[NullDirection], list[NullDirection]]:
    """Null-space directions, and apart from them those of geometry parameters alone: their tolerances are
    knowledge."""
    links = [own for own in directions if geometry.issuperset(own.combination)]
    return [own for own in directions if own not in links], links


def tolerance_only(count: int) -> str:
    """What is said of directions that need no cause and no remedy."""
    what = "1 combination" if count == 1 else f"{count} combinations"
    verb, its = ("is", "its") if count == 1 else ("are", "their")
    return f"{what} of geometry parameters {verb} known by {its} tolerances only."


def _sentence(parameters: Sequence[Judged], directions: Sequence[NullDirection]) -> str:
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
    elif directions:
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
