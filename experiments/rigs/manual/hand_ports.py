"""The ports of a run by hand: a posture is asked for, and what is answered is judged before it is confirmed.

The joints are typed, or read from a controller where an empty line (or the PSD) confirms them; what an
instrument reads is typed, or sent.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ....model.arrays import Index, Matrix
from ....model.errors import BadInput
from ....model.files.plan import Plan
from ....model.files.shot import Shot
from ....model.instruments.kind import Instrument, Measurement
from ....model.kinematics.pendant import Pendant
from ....model.likelihood.problem import Problem
from ....model.options import PendantUnit
from ....model.parsing.reading import shown
from ...makers.joint_text import joints_so_far, labelled, typed_joints
from ...procedure.beam_ports import arm_sent
from ...procedure.events import (
    Doubted,
    EnteredReading,
    Listener,
    PendantReading,
    PostureRequested,
    ReadingRequested,
)
from ...procedure.session import Paused, Ports, Reading, Skipped, TakenBack
from ...procedure.steering import Belief
from ...sensors.attached import InstrumentLines, ReadingRefused
from ..at_rest import JointsAtRest
from ..joint_clients import JointsRefused
from .doubts import Doubt, Judge
from .line_sources import Lines

Entered = Mapping[str, float | tuple[float, ...]]  # as a measurement records it, by column

_DELIMITERS = re.compile(r"[\s,;|]+")
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?")
_LENGTHS, _TURNS = "_mm", "_quat"  # how the keys of columns end
_LEAST_MM = 30.0  # a length that is predicted shorter may be a thousandth of another as well
_NEAR = 3.0  # times the predicted length: a reading in metres is nearer than that
_OFF_UNIT = 0.01  # of the length of a quaternion: what rounding does to it


def entered_readings(kind: type[Instrument]) -> tuple[EnteredReading, ...]:
    """What a person enters besides the joints, in its order."""
    return tuple(
        EnteredReading(key, kind.entered.get(key, key), size) for key, size in kind.read_off().items()
    )


class InstrumentReadings:
    """The readings of a plan's measurements, by their number: `reads` is empty where there is none to
    enter."""

    def __init__(self, plan: Plan, problem: Problem) -> None:
        self._plan, self._problem = plan, problem
        self._reads = {label: entered_readings(kind) for label, kind in plan.header.kinds.items()}
        postures = list(dict.fromkeys(item.posture for item in plan.measurements))
        self.rows = [postures.index(item.posture) for item in plan.measurements]

    def reads(self, number: int) -> tuple[EnteredReading, ...]:
        return self._reads[self._measurement(number).instrument]

    def _measurement(self, number: int) -> Measurement:
        return self._plan.measurements[number % len(self._plan.postures)]

    def row(self, number: int) -> Index:
        """(1,) the shot of the plan's problem that a measurement belongs to."""
        return np.array([self.rows[number % len(self.rows)]])

    def typed(self, number: int, text: str) -> Entered:
        """All numbers of a measurement, in the order of `reads`; BadInput for anything else."""
        reads = self.reads(number)
        count = sum(read.numbers for read in reads)
        parts = [part for part in re.split(r"[\s;]+", text.strip()) if part]
        if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
            parts = [part for part in _DELIMITERS.split(text.strip()) if part]
        if len(parts) != count or not all(map(_NUMBER.fullmatch, parts)):
            raise BadInput(
                "this is not what the instrument reads",
                found=f"{shown(text.strip()) or 'nothing'} ({count} numbers are asked for)",
            )
        numbers = [float(part.replace(",", ".")) for part in parts]
        values: dict[str, float | tuple[float, ...]] = {}
        for read in reads:
            row, numbers = tuple(numbers[: read.numbers]), numbers[read.numbers :]
            if read.key.endswith(_TURNS) and abs(math.hypot(*row) - 1) > _OFF_UNIT:
                raise BadInput("this is no quaternion: its length is not 1", found=f"{math.hypot(*row):.4g}")
            values[read.key] = row if read.numbers > 1 else row[0]
        return values

    def of_metres(self, reading: Entered) -> Entered:
        """The reading whose lengths were typed in metres."""
        scaled: dict[str, float | tuple[float, ...]] = {}
        for key, value in reading.items():
            by = 1000.0 if key.endswith(_LENGTHS) else 1.0
            scaled[key] = tuple(v * by for v in value) if isinstance(value, tuple) else value * by
        return scaled

    def doubt(self, number: int, joints: Matrix, reading: Entered) -> str | None:
        """Whether the lengths look like metres where the arm is at `joints` (n,) deg or mm, as a sentence.

        By the size of a reading alone: where the instrument stands may not be known.
        """
        predicted = self._predicted(number, joints)
        for key, value in reading.items():
            if not key.endswith(_LENGTHS):
                continue
            size, expected = float(np.linalg.norm(value)), float(np.linalg.norm(predicted[key]))
            if expected < _LEAST_MM or not 0 < size < expected / _NEAR:
                continue
            if expected / _NEAR < 1000 * size < expected * _NEAR:
                return f"{size:.4g} mm where about {expected:.0f} mm is expected: this looks like metres"
        return None

    def _predicted(self, number: int, joints: Matrix) -> Entered:
        """By the nominal arm, and the instrument about where it is stated."""
        row = self._problem.select(self.row(number)).moved(joints[None] / self._problem.robot.display)
        read = row.at_predicted(row.nominal())
        measurement = self._measurement(number)
        part = next(
            part
            for part in read.tool.read_at(read.readings[0])
            if (part.instrument.label, part.variant) == (measurement.instrument, measurement.variant)
        )
        return part.instrument.recorded(part.reading, np.zeros(part.instrument.residual_size))


HELP = (
    "joint values as the pendant shows them, then what the instrument reads, in the next line or behind |"
    " (of each that reads there, in turn); or: skip [why], redo [measurement], comment TEXT, show, pause. "
    "To a question: yes, rad (they are radians), metres (they are in metres), as N (they are posture N)"
)
_MOST = 200  # characters of a comment
_ANSWERS = ("yes", "rad", "as")
_METRES = "metres"
_READ_NOT_TYPED = (
    "the joints are read from the controller: press Enter when the arm is at rest; 'help' has the words"
)
_WORDS = ("skip", "redo", "comment", "show", "pause", "quit", "help", "?")


@dataclass(frozen=True, eq=False)
class _Held:
    """Values (n,) deg or mm that wait for an answer to a doubt."""

    joints: Matrix
    doubt: Doubt


@dataclass(eq=False)
class HandPorts(Ports):
    """`lines` says what the person or robot writes, `pendant` and `units` what its numbers are. With `arm`
    the joints are read from its controller where an empty line confirms them; with `instrument` its readings
    are not typed."""

    plan: Plan
    listener: Listener
    lines: Lines
    pendant: Pendant
    units: PendantUnit
    scene: bool = False  # whether to tell where the arm is to be
    arm: JointsAtRest | None = None
    instrument: InstrumentLines | None = None
    _comment: str | None = field(default=None, init=False)
    _since: float | None = field(default=None, init=False)

    attempts, repeats = 0, True  # a person says when it is enough

    def __post_init__(self) -> None:
        self.problem = Problem.from_plan(self.plan)
        self._judge = Judge(self.plan, self.pendant)
        self._readings = InstrumentReadings(self.plan, self.problem)
        kinds, measurements = self.plan.header.kinds, self.plan.measurements
        # What is led to its target comes first: it moves the arm.
        turn = sorted(range(len(measurements)), key=lambda i: not kinds[measurements[i].instrument].met)
        self._at_posture = [
            tuple(i for i in turn if measurements[i].posture == one.posture) for one in measurements
        ]

    def together(self, number: int) -> tuple[int, ...]:
        """A closing measurement is alone."""
        return self._at_posture[number] if number < len(self._at_posture) else (number,)

    def begin(self, number: int, recorded: Sequence[Shot], refused: Collection[int]) -> None:
        if self._since is None:
            self._since = time.monotonic() - (recorded[-1].time_s or 0.0 if recorded else 0.0)
        self._recorded, self._refused = recorded, refused

    def move_to(self, number: int, attempt: int) -> None:
        self._ask(number)

    def confirm(self, number: int) -> int:
        """Until joint values come of which nobody has a doubt, or which are confirmed all the same."""
        held: _Held | None = None
        parts = ""
        self._texts: list[str] = []
        while True:
            text = self._line()
            if self._reads_any(number) and "|" in text:
                text, *self._texts = (part.strip() for part in text.split("|"))
            word, _, rest = text.partition(" ")
            word, rest = word.lower(), rest.strip()
            joints: Matrix | None = None
            if word in _ANSWERS and held is not None:
                if word == "yes":
                    if self._may_overrule(held.doubt):
                        self._joints = held.joints
                        return number
                    self._say(number, "refused", held.doubt.sentence)
                    continue
                number = self._named(rest, number) if word == "as" else number
                joints = self._degrees(held.joints) if word == "rad" else held.joints
            elif word in (*_ANSWERS, *_WORDS):
                parts = ""
                self._command(word, rest, self.together(number)[0])
            elif self.arm is not None:
                joints = self._taken(number, self.arm, text)
            elif text:
                if parts and not self._goes_on(parts, text):  # what is missing is said
                    self._read(number, parts)
                    parts = ""
                alone = not parts
                parts = f"{parts} {text}" if parts else text
                if not self._unfinished(parts, alone=alone):
                    logged = self._read(number, parts)
                    number, joints = (number, None) if logged is None else logged
                    parts = ""
            if joints is None:
                continue
            number, doubt = self._judged(number, joints)
            if doubt is None:
                self._joints = joints
                return number
            held = _Held(joints, doubt) if self.lines.confirms else None

    def joints(self) -> Matrix:
        return self._joints

    def reading(self, number: int) -> Reading:
        """With the comment, if there is one."""
        entered = self._entered(number) if self._readings.reads(number) else {}
        comment, self._comment = self._comment, None
        return {**entered, "comment": comment}

    def moved(self, number: int) -> bool:
        """Of joints that were typed nobody knows it."""
        if self.arm is None or not self._reads_any(number):
            return False
        try:
            if not self.arm.moved_from(self._joints):
                return False
            raise JointsRefused("moving", "the arm has moved since its joints were read")
        except JointsRefused as refused:
            self._say(number, refused.kind, refused.why)
            return True

    def now(self) -> float:
        assert self._since is not None
        return round(time.monotonic() - self._since, 3)

    def stop(self) -> None:
        """Who moves the arm stops it."""

    def _line(self) -> str:
        line = self.lines.following()
        if line is None:
            raise Paused
        return line.strip()

    def _reads_any(self, number: int) -> bool:
        return any(self._readings.reads(each) for each in self.together(number))

    def _sent(self, number: int) -> str:
        """What the instrument sends; empty where it sends nothing that can be used, which is said."""
        if self.instrument is None:
            return ""
        try:
            return self.instrument.read()
        except ReadingRefused as refused:
            self._say(number, "instrument", str(refused))
            return ""

    def _entered(self, number: int) -> Entered:
        """The readings of an instrument: the first that were typed with the joints; a person may type what it
        does not send."""
        held: Entered | None = None
        text = self._texts.pop(0) if self._texts else ""
        while True:
            text = text or self._sent(number)
            if not text:
                reads = self._readings.reads(number)
                self.listener(ReadingRequested(number, reads, *self._names(number)))
                text = self._line()
            word, _, rest = text.partition(" ")
            word, reading, text = word.lower(), text, ""
            if held is not None and word in ("yes", _METRES):
                return held if word == "yes" else self._readings.of_metres(held)
            if word in (*_ANSWERS, _METRES, *_WORDS):
                self._command(word, rest.strip(), number)
                continue
            if self.instrument is not None and not reading:
                continue  # it is read again
            try:
                typed = self._readings.typed(number, reading)
            except BadInput as error:
                self._say(number, "unreadable", f"{error.what}: {error.found}")
                continue
            sentence = self._readings.doubt(number, self._joints, typed)
            if sentence is None:
                return typed
            held = typed if self.lines.confirms else None
            self._say(number, _METRES, sentence, ("yes", _METRES) if self.lines.confirms else ())

    def _taken(self, number: int, arm: JointsAtRest, text: str) -> Matrix | None:
        """(n,) the joints where the arm is at rest, None where they are not taken, which is said."""
        if text:
            self._say(number, "unreadable", _READ_NOT_TYPED)
            return None
        try:
            return arm.take()
        except JointsRefused as refused:
            self._say(number, refused.kind, refused.why)
            return None

    def _goes_on(self, parts: str, text: str) -> bool:
        """Whether a line has more joints of those that were begun: with names, or a number alone."""
        names = self.pendant.names
        if labelled(parts, names) and labelled(text, names):
            return True
        return joints_so_far(f"{parts} {text}", names) == joints_so_far(parts, names) + 1

    def _unfinished(self, text: str, *, alone: bool) -> bool:
        """Whether a person pasted some joints, and the next line has others. Of numbers without names a first
        line (`alone`) has one."""
        count = joints_so_far(text, self.pendant.names)
        several = alone and count > 1 and re.match(r"\s*[-+\d.,−–]", text) is not None
        return self.lines.confirms and 0 < count < self.plan.robot.n and not several

    def _read(self, number: int, text: str) -> tuple[int, Matrix] | None:
        """The measurement and (n,) its values in degrees (mm), joint 3 from link 2; None where a text cannot
        be read. The line of a plan's program says which posture it is of."""
        try:
            typed = typed_joints(text, self.plan.robot.n, self.pendant)
        except BadInput as error:
            self._say(number, "unreadable", f"{error.what}: {error.found}")
            return None
        if typed.number is not None and (first := self._first(typed.number)) is not None:
            number = first
        values = np.array(typed.values) / self.pendant.per_degree(typed.unit or self.units)
        return number, self.pendant.between_links(values)

    def _judged(self, number: int, joints: Matrix) -> tuple[int, Doubt | None]:
        """The measurement that these values are, and what speaks against them, which is said.

        Who reads no questions, as a program does, is followed where it goes: to the posture that it is in.
        """
        doubt = self._judge.doubt(number, joints, self._recorded)
        near = None if doubt is None else self._judge.near(joints, self._left())
        if doubt is not None and doubt.kind == "far" and near is not None and self.lines.follows:
            number, doubt = near, self._judge.doubt(near, joints, self._recorded)
        if doubt is not None:
            answers = ["yes"] if self._may_overrule(doubt) else []
            answers += ["rad"] if doubt.kind == "radians" else []
            answers += [f"as {near}"] if doubt.kind == "far" and near is not None else []
            self._say(number, doubt.kind, doubt.sentence, answers if self.lines.confirms else ())
        return number, doubt

    def _say(self, number: int, kind: str, sentence: str, answers: Sequence[str] = ()) -> None:
        self.listener(Doubted(number, kind, sentence, tuple(answers)))

    def _may_overrule(self, doubt: Doubt) -> bool:
        """Values beyond a limit are recorded only where the header allows it."""
        return doubt.kind != "limit" or self.plan.header.limits == "warn"

    def _left(self) -> set[int]:
        """The postures of which nothing is recorded, by the measurement that comes first there."""
        recorded = {shot.shot for shot in self._recorded}
        return {some[0] for some in self._at_posture if recorded.isdisjoint(some)}

    def _first(self, number: int) -> int | None:
        """The measurement that comes first at the posture of `number`, if that posture is left."""
        first = self.together(number)[0]
        return first if first in self._left() else None

    def _named(self, text: str, number: int) -> int:
        first = self._first(int(text)) if text.isdecimal() else None
        if first is not None:
            return first
        self._say(number, "unreadable", f"no posture {text or '(its number is missing)'} is left")
        return number

    def _command(self, word: str, rest: str, number: int) -> None:
        """Carry out a word about the measurement that is asked for."""
        if word in ("pause", "quit"):
            raise Paused
        if word == "skip":
            raise Skipped(number, rest or "by the operator")
        if word == "redo":
            self._redo(rest, number)
        elif word == "comment":
            self._comment = "".join(filter(str.isprintable, rest))[:_MOST].strip() or None
        elif word == "show":
            self._ask(number)
        elif word in _ANSWERS:
            self._say(number, "unreadable", f"there is no question that '{word}' answers")
        else:
            self._say(number, "help", HELP)

    def _redo(self, text: str, number: int) -> None:
        shots = [shot.shot for shot in self._recorded]
        last = shots[-1] if shots and not text else None
        repeated = int(text) if text.isdecimal() else last
        if repeated is None or repeated not in shots:
            answers = [f"redo {shots[-1]}"] if shots and self.lines.confirms else []
            sentence = f"there is no measurement {f'{text} ' if text else ''}to repeat"
            self._say(number, "unreadable", sentence, answers)
            return
        raise TakenBack(repeated)

    def _names(self, number: int) -> tuple[str | None, str | None]:
        """Instrument and reflector of a measurement, where the plan has several."""
        posture = number % len(self.plan.postures)
        several = len(self.plan.header.labels) > 1
        instrument = self.plan.measurements[posture].instrument if several else None
        return instrument, self.plan.shots[posture].reflector

    def _ask(self, number: int) -> None:
        posture = number % len(self.plan.postures)
        instrument, reflector = self._names(number)
        kind = self.plan.header.kinds[self.plan.measurements[posture].instrument]
        joints = self.plan.postures[posture] * self.plan.robot.display
        self.listener(
            PostureRequested(
                shot=number,
                target=self.plan.called[posture],
                done=len(self._recorded) + len(self._refused),
                postures=len(self.plan.postures),
                joints_deg=tuple(round(float(value), 6) for value in self.pendant.counted(joints)),
                pendant=tuple(PendantReading(*one) for one in self.pendant.readings(joints)),
                reads=self._readings.reads(number),
                reflector=reflector,
                instrument=instrument,
                act=kind.words.act,
                also=self.together(number)[1:],
                again=self.plan.repeated_by(number),
            )
        )
        if self.scene:
            belief = Belief(self.problem.select(self._readings.row(number)), self.problem.nominal())
            self.listener(arm_sent(belief, number, self.plan.postures[posture], lit=False))

    def _degrees(self, joints: Matrix) -> Matrix:
        """Values that were taken for degrees and are radians."""
        return self.pendant.between_links(self.pendant.counted(joints) * self.plan.robot.display)
