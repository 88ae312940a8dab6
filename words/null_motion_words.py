"""The null-space motion in words: what its picture shows, and that no place in it is known."""

from __future__ import annotations

from typing import NamedTuple

from ..analysis.diagnostics.null_motion import NewPosture, NullSpaceMotion
from ..analysis.observability.causes import NullDirection
from . import numbers
from .observability import direction_remedy
from .wording import clipped, counted, label, listed, person, sentence

_EXACT_MM = 1e-6
_MOST_NAMED = 3  # of what moves along


class MotionWords(NamedTuple):
    """The `lead` before the picture; the titles of its panels, of `one_end`, the `other_end`, the
    `new_posture` and the `motion`; the `caption` and the `alt` text; the `end`: what ends the motion."""

    lead: str
    one_end: str
    other_end: str
    new_posture: str
    motion: str
    caption: str
    alt: str
    end: str


def motion_words(motion: NullSpaceMotion, direction: NullDirection, measured: int) -> MotionWords:
    """Of a motion along a `direction`, of so many `measured` postures."""
    name, joint = label(motion.offset), f"J{motion.offset.removeprefix('delta')}"
    unit = numbers.unit_of(motion.unit)
    amount = numbers.exact(float(f"{motion.amount:.2g}"), unit)
    less, more = f"{numbers.MINUS}{amount}", f"+{amount}"
    along = _along(motion)
    verb = "move" if set(motion.moved) <= set(motion.targets) else "change"
    moves = f"{listed(along)} {verb}{'s' if len(along) == 1 else ''} with it" if along else ""
    larger = ""
    if motion.drawn > 1:
        larger = f" The motion is drawn {numbers.significant(motion.drawn, 2)} times larger."
    return MotionWords(
        lead=(
            f"Both ends fit the readings equally: at the same joints {name} may be {amount} less or"
            f" {amount} more, and {moves or 'nothing else changes'}. {_meets(motion)}"
        ),
        one_end=f"{joint} {less}",
        other_end=f"{joint} {more}",
        new_posture="A posture that ends it",
        motion=f"{joint} from {less} to {more}",
        caption=(
            "Null-space motion: both ends fit the readings equally; no position here is an estimate."
            f" {len(motion.shots)} of {counted(measured, motion.like)} are drawn. {_drawn(motion)}{larger}"
        ),
        alt=(
            f"The arm at both ends of the null-space motion, {joint} {less} and {joint} {more}"
            f"{f'; {moves}' if moves else ''}. {_meets(motion)}"
        ),
        end=" ".join(_ends(motion, new) for new in motion.new)
        or f"To end it: {sentence(direction_remedy(direction, person))}.",
    )


def _drawn(motion: NullSpaceMotion) -> str:
    """What is grey, and what is dashed."""
    first, last = motion.frames[0], motion.frames[-1]
    moved = [
        clipped(name)
        for name, one, other in zip(motion.targets, first.targets, last.targets, strict=True)
        if one != other
    ]
    if first.postures[0].links == last.postures[0].links:
        joint = int(motion.offset.removeprefix("delta")) + 1
        what = "the flange" if motion.marked == "flange" else f"the axis of joint {joint}"
        return f"Dashed: the path of a mark on {what}, the only part that moves."
    way = f"; dashed: the path of {listed(moved[:_MOST_NAMED])}" if moved else ""
    return f"In grey: the first of them at the ends{way}."


def _along(motion: NullSpaceMotion) -> list[str]:
    names = ["the tool" if each == "tool" else label(each) for each in motion.moved]
    if len(names) > _MOST_NAMED:
        names = [*names[: _MOST_NAMED - 1], f"{len(names) - _MOST_NAMED + 1} more unknowns"]
    return names


def _beams(motion: NullSpaceMotion) -> bool:
    return motion.frames[0].postures[0].beam_to is not None


def _meets(motion: NullSpaceMotion) -> str:
    what = "Every beam still meets its target" if _beams(motion) else "Every reading stays the same"
    if motion.off_mm <= _EXACT_MM:
        return f"{what}."
    return f"{what} to within {numbers.significant(motion.off_mm, 2, 'mm')}, less than the noise."


def _ends(motion: NullSpaceMotion, new: NewPosture) -> str:
    joints = [
        f"J{k} {numbers.with_unit(numbers.fixed(value, 1), unit)}"
        for k, (value, unit) in enumerate(zip(new.joints, new.units, strict=True), start=1)
    ]
    off = numbers.significant(new.off_mm, 2, "mm")
    misses = (
        f"the beam would miss by up to {off} (dotted)"
        if _beams(motion)
        else f"the reading would differ by up to {off}"
    )
    return (
        f"A posture that ends it: {', '.join(joints)} (like {motion.like} {new.like}). There {misses} at the"
        " ends of the motion, so that this reading decides."
    )
