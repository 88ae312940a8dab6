"""A run by hand: each posture is asked for, what is answered is judged, recorded, and its effect shown.

As with other rigs a run follows from the journal alone: a run that is resumed asks for what is not recorded.
"""

from __future__ import annotations

import re
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ....analysis.diagnostics.outliers import single_outlier
from ....analysis.solution import Solution
from ....interruption import obey
from ....model.arrays import Matrix
from ....model.errors import BadInput
from ....model.files.journal import RunJournal
from ....model.files.plan import Means, Plan
from ....model.files.shot import Shot, shot_model
from ....model.kinematics.pendant import Pendant
from ....model.kinematics.robot import PendantUnit
from ....model.likelihood.problem import Problem
from ...makers.joint_text import joints_so_far, labelled, typed_joints
from ...procedure.events import (
    Doubted,
    GivenUp,
    Listener,
    PostureRequested,
    ReadingRequested,
    Suspected,
    Withdrawn,
)
from ...procedure.order import Order
from ...procedure.rig import RefusalReason, RefusedPosture
from ...procedure.session import ProcedureResult, arm_sent, recorded_event, state_of
from ...procedure.steering import Belief
from ...sensors.text_lines import InstrumentLines, ReadingRefused
from ..live.at_rest import JointsAtRest
from ..live.joint_client import JointsRefused
from .doubts import Doubt, Judge
from .instrument_readings import InstrumentReadings, Reading
from .line_sources import Lines

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


class _Paused(Exception):
    """No more lines come, or the person wants to go on later."""


class _Decided(Exception):
    """The posture under way is over without a measurement."""


class _Skipped(_Decided):
    """A measurement of the posture under way is given up."""


@dataclass(eq=False)
class Manual:
    """One session. `lines` says what the person or robot writes, `pendant` and `units` what its numbers
    are. With `arm` the joints are read from its controller where an empty line confirms them; with
    `instrument` its readings are not typed."""

    plan: Plan
    journal: RunJournal
    order: Order
    listener: Listener
    lines: Lines
    pendant: Pendant
    units: PendantUnit
    scene: bool = False  # whether to tell where the arm is to be
    arm: JointsAtRest | None = None
    instrument: InstrumentLines | None = None
    _refused: dict[int, RefusedPosture] = field(default_factory=dict, init=False)
    _again: int | None = field(default=None, init=False)
    _comment: str | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        self._problem = Problem.from_plan(self.plan)
        self._judge = Judge(self.plan, self.pendant)
        self._readings = InstrumentReadings(self.plan, self._problem)
        kinds, measurements = self.plan.header.kinds, self.plan.measurements
        # What is led to its target comes first: it moves the arm.
        turn = sorted(range(len(measurements)), key=lambda i: not kinds[measurements[i].instrument].met)
        self._at_posture = [
            tuple(i for i in turn if measurements[i].posture == one.posture) for one in measurements
        ]
        shots = self.journal.shots
        self._since = time.monotonic() - (shots[-1].time_s or 0.0 if shots else 0.0)

    def carry_out(self) -> ProcedureResult:
        """Ask for postures until the order is through or no more lines come."""
        state = state_of(self.plan.header, self._problem, self.journal.shots)
        while (number := self._following(state)) is not None:
            try:
                shots = self._measured(number)
            except _Decided:
                state = state_of(self.plan.header, self._problem, self.journal.shots)
                continue
            except _Paused:
                missing = self._pending(state)
                return ProcedureResult(self.journal.shots, tuple(self._refused.values()), state, {}, missing)
            obey()
            for shot in shots:
                self.journal.append(shot)
            self._again = None
            state = state_of(self.plan.header, self._problem, self.journal.shots)
            assert state is not None
            for shot in shots:
                called = self.plan.called[shot.shot % len(self.plan.postures)]
                self.listener(recorded_event(shot, called, len(self.journal.shots), state))
            outlier = single_outlier(state.fit, state.dof) if state.converged else None
            if outlier is not None:
                self.listener(Suspected(outlier.shot, outlier.p_value, outlier.residual_mm))
        return ProcedureResult(self.journal.shots, tuple(self._refused.values()), state, {})

    def _following(self, state: Solution | None) -> int | None:
        if self._again is not None:
            return self._again
        return self.order.following(self.journal.shots, self._refused, state)

    def _pending(self, state: Solution | None) -> tuple[int, ...]:
        """The measurements that would still be asked for, none of them recorded."""
        pending: list[int] = []
        shots, refused = self.journal.shots, self._refused
        while (number := self.order.following(shots, {*refused, *pending}, state)) is not None:
            pending.append(number)
        return tuple(sorted(pending))

    def _together(self, number: int) -> tuple[int, ...]:
        """The measurements of the posture of `number`, in the order in which they are taken; a closing one is
        alone."""
        return self._at_posture[number] if number < len(self._at_posture) else (number,)

    def _measured(self, number: int) -> list[Shot]:
        """What is typed for the posture of measurement `number`, or for another that is named: all that is
        measured there."""
        recorded = {shot.shot for shot in self.journal.shots}
        together = self._together(number)
        others = [other for other in together if other in recorded]
        if others:
            self._give_up([number], f"its posture is recorded without it: redo {others[0]} repeats both")
            raise _Decided
        number = together[0]
        while True:
            number, joints, texts = self._posture(number)
            shots = []
            for each in self._together(number):
                try:
                    shots.append(self._completed(each, joints, texts))
                except _Skipped:
                    continue
            if not shots:
                raise _Decided
            if not self._moved(number, joints):
                return shots

    def _posture(self, number: int) -> tuple[int, Matrix, list[str]]:
        """The measurement whose joints (n,) are typed, `number` or another that is named, and the readings
        that are typed with them."""
        self._ask(number)
        held: _Held | None = None
        parts = ""
        read: list[str] = []
        while True:
            line = self.lines.following()
            if line is None:
                raise _Paused
            text = line.strip()
            if self._reads_any(number) and "|" in text:
                text, *read = (part.strip() for part in text.split("|"))
            word, _, rest = text.partition(" ")
            word, rest = word.lower(), rest.strip()
            joints: Matrix | None = None
            if word in _ANSWERS and held is not None:
                if word == "yes":
                    if self._may_overrule(held.doubt):
                        return number, held.joints, read
                    self._say(number, "refused", held.doubt.sentence)
                    continue
                number = self._named(rest, number) if word == "as" else number
                joints = self._degrees(held.joints) if word == "rad" else held.joints
            elif word in (*_ANSWERS, *_WORDS):
                parts = ""
                self._command(word, rest, self._together(number))
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
                return number, joints, read
            held = _Held(joints, doubt) if self.lines.confirms else None

    def _reads_any(self, number: int) -> bool:
        return any(self._readings.reads(each) for each in self._together(number))

    def _moved(self, number: int, joints: Matrix) -> bool:
        """Whether the arm has moved since its joints (n,) were read, which is said. Of joints that were typed
        nobody knows it."""
        if self.arm is None or not self._reads_any(number):
            return False
        try:
            if not self.arm.moved_from(joints):
                return False
            raise JointsRefused("moving", "the arm has moved since its joints were read")
        except JointsRefused as refused:
            self._say(number, refused.kind, refused.why)
            return True

    def _completed(self, number: int, joints: Matrix, texts: list[str]) -> Shot:
        """The measurement with what the instrument reads at `joints` (n,): the first of `texts`, which is
        taken off, or what it sends, or what is typed then."""
        if not self._readings.reads(number):
            return self._shot(number, joints, {})
        return self._shot(number, joints, self._reading(number, joints, texts))

    def _sent(self, number: int) -> str:
        """What the instrument sends; empty where it sends nothing that can be used, which is said."""
        if self.instrument is None:
            return ""
        try:
            return self.instrument.read()
        except ReadingRefused as refused:
            self._say(number, "instrument", str(refused))
            return ""

    def _reading(self, number: int, joints: Matrix, texts: list[str]) -> Reading:
        """The readings of an instrument: the first of `texts`; a person may type what it does not send."""
        reads = self._readings.reads(number)
        held: Reading | None = None
        text = texts.pop(0) if texts else ""
        while True:
            text = text or self._sent(number)
            if not text:
                self.listener(ReadingRequested(number, reads, *self._names(number)))
                line = self.lines.following()
                if line is None:
                    raise _Paused
                text = line.strip()
            word, _, rest = text.partition(" ")
            word, reading, text = word.lower(), text, ""
            if held is not None and word in ("yes", _METRES):
                return held if word == "yes" else self._readings.of_metres(held)
            if word in (*_ANSWERS, _METRES, *_WORDS):
                self._command(word, rest.strip(), (number,))
                continue
            if self.instrument is not None and not reading:
                continue  # it is read again
            try:
                typed = self._readings.typed(number, reading)
            except BadInput as error:
                self._say(number, "unreadable", f"{error.what}: {error.found}")
                continue
            sentence = self._readings.doubt(number, joints, typed)
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
        doubt = self._judge.doubt(number, joints, self.journal.shots)
        near = None if doubt is None else self._judge.near(joints, self._left())
        if doubt is not None and doubt.kind == "far" and near is not None and self.lines.follows:
            number, doubt = near, self._judge.doubt(near, joints, self.journal.shots)
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
        recorded = {shot.shot for shot in self.journal.shots}
        return {some[0] for some in self._at_posture if recorded.isdisjoint(some)}

    def _first(self, number: int) -> int | None:
        """The measurement that comes first at the posture of `number`, if that posture is left."""
        first = self._together(number)[0]
        return first if first in self._left() else None

    def _named(self, text: str, number: int) -> int:
        first = self._first(int(text)) if text.isdecimal() else None
        if first is not None:
            return first
        self._say(number, "unreadable", f"no posture {text or '(its number is missing)'} is left")
        return number

    def _command(self, word: str, rest: str, numbers: Sequence[int]) -> None:
        """Carry out a word about the measurements that are asked for."""
        number = numbers[0]
        if word in ("pause", "quit"):
            raise _Paused
        if word == "skip":
            self._give_up(numbers, rest or "by the operator")
            raise _Skipped
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

    def _give_up(self, numbers: Sequence[int], why: str) -> None:
        self._again = None
        for number in numbers:
            refused = RefusedPosture(number, RefusalReason.SKIPPED, why)
            self._refused[number] = refused
            self.listener(GivenUp(number, refused.reason, refused.found))

    def _redo(self, text: str, number: int) -> None:
        shots = {shot.shot for shot in self.journal.shots}
        last = self.journal.shots[-1].shot if shots else None
        repeated = int(text) if text.isdecimal() else last if not text else None
        if repeated is None or repeated not in shots:
            self._say(number, "unreadable", f"there is no measurement {f'{text} ' if text else ''}to repeat")
            return
        for each in self._together(repeated):
            self._refused.pop(each, None)
            if each in shots:
                self.journal.withdraw(each)
                self.listener(Withdrawn(each))
        self._again = repeated
        raise _Decided

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
                done=len(self.journal.shots) + len(self._refused),
                postures=len(self.plan.postures),
                joints_deg=tuple(round(float(value), 6) for value in self.pendant.counted(joints)),
                pendant=tuple(self.pendant.readings(joints)),
                reads=self._readings.reads(number),
                reflector=reflector,
                instrument=instrument,
                act=kind.words.act,
                also=self._together(number)[1:],
                again=self.plan.repeated_by(number),
            )
        )
        if self.scene:
            belief = Belief(self._problem.select(self._readings.row(number)), self._problem.nominal())
            self.listener(arm_sent(belief, number, self.plan.postures[posture], lit=False))

    def _degrees(self, joints: Matrix) -> Matrix:
        """Values that were taken for degrees and are radians."""
        return self.pendant.between_links(self.pendant.counted(joints) * self.plan.robot.display)

    def _shot(self, number: int, joints: Matrix, readings: Reading) -> Shot:
        comment, self._comment = self._comment, None
        posture = number % len(self.plan.postures)
        content = {
            "shot": number,
            "target": self.plan.targets[posture],
            "joints_deg": tuple(round(float(value), 9) for value in joints),
            "time_s": round(time.monotonic() - self._since, 3),
            "comment": comment,
            **Means.of(self.plan.shots[posture])._asdict(),
            "again": self.plan.repeated_by(number),
            **readings,
        }
        return shot_model(self.plan.header).model_validate(content)
