"""What the data do not determine, why, as a picture too, and what would help."""

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

from ...analysis.answer.result import Result
from ...analysis.diagnostics.null_motion import NullSpaceMotion
from ...words.null_motion_words import MotionWords, motion_words
from ..scenes.null_motion_picture import NAME, null_motion_picture
from ..style.blocks import FigureBlock
from ..style.canvas import MovingPicture


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


def null_motion_section(result: Result) -> Section | None:
    """What a degenerate run's picture, which is on page one, shows; None of any other."""
    section = motion_section(result.null_motion, result.identifiability.null_space, len(result.shots))
    if section is None:
        return None
    return section_of(section.title, *(block for block in section.all if not isinstance(block, FigureBlock)))


def null_motion_picture_of(result: Result) -> MovingPicture | None:
    """Its picture."""
    return motion_picture(result.null_motion, result.identifiability.null_space, len(result.shots))


def motion_section(
    motion: NullSpaceMotion | None, null_space: Sequence[NullDirection], measured: int
) -> Section | None:
    """The section on a motion of `measured` postures; None where there is no motion."""
    if motion is None:
        return None
    words = _words(motion, null_space, measured)
    title = f"Why {label(motion.offset)} is not determined"
    return section_of(title, Paragraph(words.lead), FigureBlock(NAME), Paragraph(words.end))


def motion_picture(
    motion: NullSpaceMotion | None, null_space: Sequence[NullDirection], measured: int
) -> MovingPicture | None:
    """Its picture."""
    return None if motion is None else null_motion_picture(motion, _words(motion, null_space, measured))


def _words(motion: NullSpaceMotion, null_space: Sequence[NullDirection], measured: int) -> MotionWords:
    return motion_words(motion, null_space[motion.direction], measured)
