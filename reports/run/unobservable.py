"""What the data do not determine, why, as a picture too, and what would help."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from ...analysis.answer.result import Result
from ...analysis.diagnostics.null_motion import MotionFrame, MovedPosture, NullSpaceMotion
from ...analysis.observability.causes import NullDirection
from ...analysis.observability.identifiability import Identifiability
from ...analysis.status import known
from ...model.arrays import Matrix
from ...words.geometry_words import MotionWords, geometry_title, motion_words
from ...words.observability import combination_words, direction_kind, direction_remedy, rank_facts, reason
from ...words.wording import (
    NOT_DETERMINED,
    WEAK,
    be,
    capital,
    clipped,
    counted,
    label,
    listed,
    person,
    sentence,
)
from ..style.blocks import Direction, Directions, Facts, FigureBlock, Paragraph, Section, section_of
from ..style.canvas import MovingPicture
from ..style.theme import FAMILY, in_font, light

if TYPE_CHECKING:
    from .parameter_section import JudgedParameter

# The null-space motion drawn: arm and target at both ends of it, and the posture that ends it.
#
# A page shows it moving, or as stills where motion is not wanted; paper has the stills.

NAME = "null_motion"
_WIDTH, _HEIGHT, _HEAD, _FOOT, _EDGE = 300, 276, 24, 20, 14  # px of a panel, its title, its last line, around
_LABEL = 7  # px of a letter
_APART = 14  # px between panels on paper
_ABOVE = (90.0, "from above")
_AZIMUTHS = range(0, 180, 10)
_SPREAD = 0.15  # how much the size of what is drawn counts next to its motion, where a side is chosen
_SECONDS = 7
_ORDER = (2, 3, 4, 3, 2, 1, 0, 1, 2)  # of the frames, once there and back
_TIMES = (0.0, 1 / 12, 0.25, 5 / 12, 0.5, 7 / 12, 0.75, 11 / 12, 1.0)  # of a pendulum
_NAME = 12  # letters of a target's name
_WRIST = 0.02  # of what is drawn: where the links move by less, all that moves is the flange
_FLANGE_PX = 30  # at least, of the mark beside the flange then
_NEAR_MM = 1.0  # a beam that is farther off than this is drawn as one that misses


def null_motion_picture(motion: NullSpaceMotion, words: MotionWords) -> MovingPicture:
    """The picture with its titles and its caption."""
    of_run = _Panel(motion, "postures")
    stills = [of_run.still(0, words.one_end), of_run.still(len(motion.frames) - 1, words.other_end)]
    moving = [of_run.moving(words.motion)]
    if motion.new:
        of_new = _Panel(motion, "new")
        stills.append(of_new.still(len(motion.frames) // 2, words.new_posture))
        moving.append(of_new.moving(words.new_posture))
    width = len(stills) * _WIDTH + (len(stills) - 1) * _APART
    row = Markup("").join(
        Markup('<g transform="translate({} 0)">{}</g>').format(k * (_WIDTH + _APART), still)
        for k, still in enumerate(stills)
    )
    return MovingPicture(
        NAME,
        words.caption,
        words.alt,
        in_font(str(_svg(width, row))),
        stills=tuple(str(_svg(_WIDTH, still)) for still in stills),
        moving=tuple(str(_svg(_WIDTH, panel)) for panel in moving),
    )


def _svg(width: int, content: Markup) -> Markup:
    return Markup(
        '<svg xmlns="http://www.w3.org/2000/svg" width="{0}" height="{1}" viewBox="0 0 {0} {1}"'
        ' font-family="{2}" font-size="14" fill="none" stroke-linecap="round"'
        ' stroke-linejoin="round">{3}</svg>'
    ).format(width, _HEIGHT, FAMILY, content)


@dataclass(frozen=True)
class _Stroke:
    """How a line is drawn: the `role` of its colour, its width, px, and dashes."""

    role: str
    width: float
    dashes: str = ""

    @property
    def attributes(self) -> Markup:
        dashes = Markup(' stroke-dasharray="{}"').format(self.dashes) if self.dashes else ""
        return Markup('stroke="{}" stroke-width="{:g}"{}').format(light(self.role), self.width, dashes)


_FIRST, _OTHER, _GHOST = _Stroke("ink", 4.5), _Stroke("muted", 2.2), _Stroke("line", 2.2)
_BEAM, _FAINT, _MISSING = _Stroke("identified", 1.3), _Stroke("held", 0.8), _Stroke("weak", 1.5, "2 4")
_PATH = _Stroke("unidentifiable", 1.2, "3 3")


class _Panel:
    """One drawing of the frames: of the measurements ("postures") or of the postures that end the motion
    ("new"); the joint of the offset is marked."""

    def __init__(self, motion: NullSpaceMotion, which: str) -> None:
        self._frames, self._which, self._names = motion.frames, which, motion.targets
        self._joint = int(motion.offset.removeprefix("delta"))
        self._marked = -2 if motion.marked == "flange" else self._joint + 1  # of the links
        first, last = (
            np.array([posture.links for posture in self._postures(motion.frames[k])]) for k in (0, -1)
        )
        size = float(np.linalg.norm(np.ptp(first.reshape(-1, 3), axis=0)))
        self._wrist = float(np.linalg.norm(last - first, axis=2).max()) < _WRIST * size
        self._mark = 1.0  # times as long as the mark is
        self._turn, self.view = self._side()
        self._fit()
        if self._wrist:
            posture = self._postures(motion.frames[0])[0]
            length = float(np.linalg.norm(np.array(posture.mark) - np.array(posture.links[self._marked])))
            self._mark = max(1.0, _FLANGE_PX / self._scale / max(length, 1e-9))
            self._fit()

    def _fit(self) -> None:
        """Scale and place what is drawn, with room for the names of the targets."""
        points = np.concatenate([self._points(frame) for frame in self._frames]) @ self._turn.T
        low, high = points.min(axis=0), points.max(axis=0)
        name = 10 + _LABEL * max((len(clipped(each, _NAME)) for each in self._names), default=0)
        room = np.array([_WIDTH - 2 * _EDGE - name, _HEIGHT - _HEAD - _FOOT - 2 * _EDGE])
        self._scale = float((room / np.maximum(high - low, 1e-6)).min())
        middle = np.array([_WIDTH - name, _HEIGHT + _HEAD - _FOOT]) / 2
        self._shift = middle - self._scale * (low + high) / 2

    def _flange(self, posture: MovedPosture) -> Matrix:
        """(3,) the end of its mark."""
        at = np.array(posture.links[self._marked])
        return np.asarray(at + self._mark * (np.array(posture.mark) - at))

    def _postures(self, frame: MotionFrame) -> Sequence[MovedPosture]:
        return frame.postures if self._which == "postures" else frame.new

    def _points(self, frame: MotionFrame) -> Matrix:
        """(m, 3) all that is drawn of a frame."""
        points = [np.zeros(3), *map(np.array, frame.targets)]
        for posture in self._postures(frame):
            points += [*map(np.array, posture.links), self._flange(posture)]
            if posture.beam_to is not None:
                points.append(np.array(posture.beam_to))
            points += [np.array(end) for sight in posture.sights for end in sight]
        return np.array(points)

    def _side(self) -> tuple[Matrix, str]:
        """(2, 3) base frame to right and down, from where most of the motion is seen; and that in words."""
        first, last = (self._points(self._frames[k]) for k in (0, -1))
        moved = last - first
        if self._wrist:
            marks = [self._flange(self._postures(self._frames[k])[0]) for k in (0, -1)]
            moved = np.array([marks[1] - marks[0]])
        if self._which == "new":  # by how much the beams miss
            gaps = [self._gaps(self._frames[k]) for k in (0, -1)]
            if any(len(gap) for gap in gaps):
                moved = np.concatenate(gaps)
        views = [(_view(azimuth, 0.0), "from the side") for azimuth in _AZIMUTHS]
        views.append((_view(-90.0, _ABOVE[0]), _ABOVE[1]))
        every = np.concatenate([first, last])

        def score(turn: Matrix) -> float:
            size = np.prod(np.ptp(every @ turn.T, axis=0)) ** 0.5 / float(
                np.linalg.norm(np.ptp(every, axis=0))
            )
            visible = np.linalg.norm(moved @ turn.T) / max(float(np.linalg.norm(moved)), 1e-9)
            return float(visible + _SPREAD * size)

        turn, words = max(views, key=lambda view: score(view[0]))
        reach = np.array([*self._frames[0].targets, *self._frames[-1].targets, *every[-1:]]).reshape(-1, 3)
        if words != _ABOVE[1] and (reach @ turn[0]).sum() < 0:
            turn = turn * np.array([[-1.0], [1.0]])  # from the other side: targets to the right of the base
        return turn, words

    def _gaps(self, frame: MotionFrame) -> Matrix:
        ends = [posture.beam_to for posture in frame.new if posture.beam_to is not None]
        return np.array([np.array(end) - self._nearest(frame, end) for end in ends]).reshape(-1, 3)

    @staticmethod
    def _nearest(frame: MotionFrame, point: Sequence[float]) -> Matrix:
        """(3,) the target that a beam is meant for: the nearest."""
        places = np.array(frame.targets).reshape(-1, 3)
        if not len(places):
            return np.array(point)
        return np.asarray(places[np.linalg.norm(places - np.array(point), axis=1).argmin()])

    def still(self, at: int, title: str) -> Markup:
        """The drawing at one frame, in front of the ends that are not shown."""
        return self._panel(title, [*self._behind(at), *self._content([self._frames[at]])])

    def moving(self, title: str) -> Markup:
        """The same through all frames, there and back."""
        frames = [self._frames[k] for k in _ORDER]
        return self._panel(title, [*self._behind(None), *self._content(frames)])

    def _behind(self, at: int | None) -> list[Markup]:
        """The ground, and the first posture at the ends, but not where it is shown."""
        parts = [self._ground()]
        for frame in (self._frames[k] for k in (0, len(self._frames) - 1) if k != at):
            parts.append(self._line([self._postures(frame)[0].links], _GHOST))
            parts += self._targets([frame], "line", named=False)
            if self._which == "new":
                parts += self._beams([self._postures(frame)], [frame], _FAINT)
        return parts

    def _panel(self, title: str, parts: Iterable[Markup]) -> Markup:
        ink, muted = light("ink"), light("muted")
        ground = Markup('<rect width="{}" height="{}" rx="6" fill="{}"/>').format(
            _WIDTH, _HEIGHT, light("panel")
        )
        head = Markup('<text x="{}" y="18" fill="{}" stroke="none">{}</text>').format(_EDGE / 2, ink, title)
        view = Markup(
            '<text x="{}" y="{}" fill="{}" stroke="none" font-size="12" text-anchor="end">{}</text>'
        ).format(_WIDTH - _EDGE / 2, _HEIGHT - 6, muted, f"seen {self.view}")
        return ground + head + Markup("").join(parts) + view

    def _content(self, frames: Sequence[MotionFrame]) -> list[Markup]:
        """What moves through the frames, or stands where there is one: the first posture last, on top."""
        path = [frame.targets for frame in self._frames]
        parts = [self._line([list(places)], _PATH) for places in zip(*path, strict=True)]
        every = [self._postures(frame) for frame in frames]
        parts += self._beams(every, frames, _BEAM)
        for k in reversed(range(len(every[0]))):
            stroke = _OTHER if k else _FIRST
            of_it = [postures[k] for postures in every]
            parts.append(self._line([posture.links for posture in of_it], stroke))
            marks = [(posture.links[self._marked], self._flange(posture)) for posture in of_it]
            parts.append(self._line(marks, _Stroke(stroke.role, 1.6)))
            if self._wrist and k == 0:
                way = [self._flange(self._postures(frame)[0]) for frame in self._frames]
                parts.append(self._line([way], _PATH))
                parts.append(self._dot([mark for _, mark in marks], 2.5, "unidentifiable", filled=True))
        lead = [postures[0].links[self._joint] for postures in every]
        parts.append(self._dot(lead, 5.5, "unidentifiable", filled=True))
        parts.append(self._text(lead, f"J{self._joint}", 9, -7, "unidentifiable"))
        return [*parts, *self._targets(frames, "identified", named=True)]

    def _beams(
        self, every: Sequence[Sequence[MovedPosture]], frames: Sequence[MotionFrame], stroke: _Stroke
    ) -> list[Markup]:
        parts = []
        for k in range(len(every[0])):
            of_it = [postures[k] for postures in every]
            ends = [posture.beam_to for posture in of_it]
            known = [end for end in ends if end is not None]
            if len(known) == len(ends):
                lines = [(posture.links[-1], end) for posture, end in zip(of_it, known, strict=True)]
                parts.append(self._line(lines, stroke))
                if max(posture.off_mm for posture in of_it) > _NEAR_MM:
                    gaps = [
                        (end, self._nearest(frame, end)) for frame, end in zip(frames, known, strict=True)
                    ]
                    parts.append(self._line(gaps, _MISSING))
            for sight in zip(*(posture.sights for posture in of_it), strict=True):
                parts.append(self._line(sight, stroke))
        return parts

    def _targets(self, frames: Sequence[MotionFrame], role: str, *, named: bool) -> list[Markup]:
        parts = []
        for k in range(len(frames[0].targets)):
            at = [frame.targets[k] for frame in frames]
            parts.append(self._dot(at, 6, role))
            if named:
                parts.append(self._dot(at, 1.6, role, filled=True))
                parts.append(self._text(at, clipped(self._names[k], _NAME), 10, 14, role))
        return parts

    def _ground(self) -> Markup:
        """The base: its axis from the mounting face up, and the floor seen from the side."""
        x, y = self._flat(np.zeros(3))
        if self.view == _ABOVE[1]:
            return Markup('<path d="M{0:g} {1:g}h16M{2:g} {3:g}v16" {4}/>').format(
                x - 8, y, x, y - 8, _Stroke("held", 1.4).attributes
            )
        hatches = "".join(f"M{x + k:g} {y:g}l-5 6" for k in range(-24, 26, 8))
        return Markup('<path d="M{:g} {:g}h56{}" {}/>').format(
            x - 28, y, hatches, _Stroke("held", 1.2).attributes
        )

    def _flat(self, point: Sequence[float] | Matrix) -> tuple[float, float]:
        x, y = self._scale * (self._turn @ np.array(point)) + self._shift
        return round(float(x), 1), round(float(y), 1)

    def _line(self, lines: Sequence[Sequence[Sequence[float] | Matrix]], stroke: _Stroke) -> Markup:
        """A line by its points, at each frame."""
        drawn = [" ".join(f"{x:g},{y:g}" for x, y in map(self._flat, line)) for line in lines]
        return Markup('<polyline points="{}" {}>{}</polyline>').format(
            drawn[0], stroke.attributes, _animated("points", drawn)
        )

    def _dot(
        self, points: Sequence[Sequence[float] | Matrix], size: float, role: str, *, filled: bool = False
    ) -> Markup:
        at = [self._flat(point) for point in points]
        fill = light(role) if filled else "none"
        moves = _animated("cx", [f"{x:g}" for x, _ in at]) + _animated("cy", [f"{y:g}" for _, y in at])
        return Markup(
            '<circle cx="{:g}" cy="{:g}" r="{:g}" fill="{}" stroke="{}" stroke-width="1.8">{}</circle>'
        ).format(*at[0], size, fill, light(role), moves)

    def _text(
        self, points: Sequence[Sequence[float] | Matrix], text: str, right: float, down: float, role: str
    ) -> Markup:
        at = [(x + right, y + down) for x, y in map(self._flat, points)]
        moves = _animated("x", [f"{x:g}" for x, _ in at]) + _animated("y", [f"{y:g}" for _, y in at])
        return Markup(
            '<text x="{:g}" y="{:g}" fill="{}" stroke="{}" stroke-width="3" paint-order="stroke">{}{}</text>'
        ).format(*at[0], light(role), light("panel"), text, moves)


def _view(azimuth: float, elevation: float) -> Matrix:
    """(2, 3) base frame to right and down, seen from there, degrees."""
    across, up = math.radians(azimuth), math.radians(elevation)
    right = [-math.sin(across), math.cos(across), 0.0]
    down = [math.sin(up) * math.cos(across), math.sin(up) * math.sin(across), -math.cos(up)]
    return np.array([right, down])


def _animated(name: str, values: Sequence[str]) -> Markup:
    """How an attribute moves; nothing where it is the same at all frames, or there is one."""
    if len(set(values)) == 1:
        return Markup("")
    return Markup(
        '<animate attributeName="{}" dur="{}s" repeatCount="indefinite" keyTimes="{}" values="{}"/>'
    ).format(name, _SECONDS, ";".join(f"{time:.4g}" for time in _TIMES), ";".join(values))


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
