"""Why an offset is not determined, as a picture: the section of a report and of the page of a plan."""

from __future__ import annotations

from collections.abc import Sequence

from ...analysis.answer.result import Result
from ...analysis.diagnostics.null_motion import NullSpaceMotion
from ...analysis.observability.causes import NullDirection
from ...words.null_motion_words import MotionWords, motion_words
from ...words.wording import label
from ..scenes.null_motion_picture import NAME, null_motion_picture
from ..style.blocks import FigureBlock, Paragraph, Section, section_of
from ..style.canvas import MovingPicture


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
