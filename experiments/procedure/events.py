"""Events of a run: shown by the live view, printed as JSON lines (docs/files-cell.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import field
from typing import Annotated, ClassVar

from ...analysis.answer.answer_message import Message
from ...analysis.observability.geometry_result import GeometryResult
from ...analysis.solution import ParameterResult
from ...analysis.status import Verdict
from ...model.kinematics.orientation import Three
from ...model.records import if_any, internal, key, record
from ...words.numbers import fixed, significant, with_unit
from ...words.sentences import to_json
from ...words.wording import again_words, shown
from .rig import RefusalReason, RefusedPosture


@record
class RunEvent:
    """`event` is the kind of it in JSON; times are seconds since the start of the run."""

    event: ClassVar[str]


@record
class RunOpened(RunEvent):
    """The run file is open. `recorded` are the measurements in it, `tolerance` is of an adaptive run."""

    event: ClassVar[str] = "begin"
    rig: str
    file: str
    postures: int
    recorded: tuple[int, ...]
    tolerance: float | None


@record
class ConfirmationAsked(RunEvent):
    """A real arm is about to move: a person reads `text`, and answers yes or no."""

    event: ClassVar[str] = "confirm"
    text: str


@record
class Attempted(RunEvent):
    """An attempt (from 1) at a measurement begins."""

    event: ClassVar[str] = "shot"
    shot: int
    attempt: int
    time_s: float


@record
class PhaseBegun(RunEvent):
    """Move, search, servo or settle begins."""

    event: ClassVar[str] = "phase"
    phase: str
    time_s: float


@record
class SpotSeen(RunEvent):
    """The distance of the spot from the PSD's centre after a step of the servo.

    `at_mm` is where it is on the face, in the PSD's axes; `size_mm` the side of that face.
    """

    event: ClassVar[str] = "spot"
    shot: int
    off_mm: float
    time_s: float
    at_mm: tuple[float, float] | None = None
    size_mm: float | None = None


@record
class ArmSent(RunEvent):
    """The arm is sent to joint positions, or (by hand) asked for there; told where the scene is asked for.

    Points are mm in the base frame, as believed of arm, tool and target: `arm` from the base over the joints
    to the flange, `beam` from the laser to the point nearest to the target (of a probe its tip alone).
    `lit`: the laser shines.
    """

    event: ClassVar[str] = "arm"
    shot: int
    joints_deg: tuple[float, ...]
    arm: tuple[Three, ...]
    beam: tuple[Three, ...]
    target: Three
    lit: bool


@record
class PictureTaken(RunEvent):
    """A picture of the camera; sent where the scene is requested, a few times a second at most.

    `grey` is base64 of a byte a pixel, row by row: the brightest of `reduced` by `reduced` pixels.
    """

    event: ClassVar[str] = "picture"
    shot: int
    width: int
    height: int
    reduced: int
    grey: str


@record
class Retried(RunEvent):
    """An attempt was refused, and another one follows."""

    event: ClassVar[str] = "retry"
    attempt: int
    shot: int
    reason: RefusalReason
    found: str

    @property
    @key("what happened, in words")
    def line(self) -> str:
        return f"attempt {self.attempt} refused ({self.reason}): {shown(self.found)}"


@record
class GivenUp(RunEvent):
    """The last attempt was refused."""

    event: ClassVar[str] = "refused"
    shot: int
    reason: RefusalReason
    found: str

    @property
    @key("what happened, in words")
    def line(self) -> str:
        return f"given up ({self.reason}): {shown(self.found)}"


CONTRADICTION = (
    "The measurements contradict the model or each other: no estimate or uncertainty can be relied on"
)


@record
class MeasurementRecorded(RunEvent):
    """A measurement is on the disk, `recorded` with it; `std` by offset (deg; mm), None where unidentifiable.

    `expanded` is k times that, `tolerance` up to which std an offset counts as identified. `residuals` are
    the normalised ones of the interim fit by number of the measurement, empty where it has not converged.
    `seconds` is what it took; None for a probe, which is led by hand.
    """

    event: ClassVar[str] = "recorded"
    shot: int
    target: str
    spot_mm: tuple[float, ...] | None
    time_s: float | None
    recorded: int
    std: Mapping[str, float | None]
    worst_std: float | None
    p_value: float | None
    consistent: bool
    seconds: Annotated[float | None, if_any] = None

    expanded: Mapping[str, float | None] = field(default_factory=dict)
    tolerance: Mapping[str, float] = field(default_factory=dict)
    residuals: Mapping[int, float] = field(default_factory=dict)

    @property
    @key("what happened, in words")
    def line(self) -> str:
        took = "" if self.seconds is None else f" in {with_unit(f'{self.seconds:.1f}', 's')}"
        if self.spot_mm is None:
            return f"recorded{took}"
        return f"recorded{took}, spot {significant(math.hypot(*self.spot_mm), 2, 'mm')} from the centre"

    @property
    @key("what a person is warned of, in words; null where nothing contradicts the model")
    def warning(self) -> str | None:
        return None if self.consistent else f"{CONTRADICTION}."


@record
class EnteredReading:
    """What a person reads off an instrument: so many `numbers`, recorded as `key`, called `words`."""

    key: str
    words: str
    numbers: int


_DIGITS = {"rad": 4, "pulse": 0}  # decimals; of degrees and millimetres 2


@record
class PendantReading:
    """A joint as the pendant shows it."""

    name: str
    value: float
    unit: str

    @property
    @key("the value as it is read off, without its unit")
    def text(self) -> str:
        return fixed(self.value, _DIGITS.get(self.unit, 2))


@record
class PostureRequested(RunEvent):
    """A person is asked for measurement `shot`: `done` of `postures` are measured or skipped; `joints_deg` as
    planned, joint 3 as the pendant counts it; `pendant`: name, value and unit of each joint as it shows
    them; `reads`: what is entered besides the joints, `instrument` and `reflector` what is read, if there are
    several; `act` what is done there, a clause. The measurements `also` are taken without moving the arm;
    the measurement `again` was made in the same posture.
    """

    event: ClassVar[str] = "posture"
    shot: int
    target: str
    done: int
    postures: int
    joints_deg: tuple[float, ...]
    pendant: tuple[PendantReading, ...]
    reads: tuple[EnteredReading, ...] = ()
    reflector: str | None = None
    instrument: str | None = None
    act: str = ""
    also: tuple[int, ...] = ()
    again: int | None = None

    @property
    @key("what is measured, in words")
    def title(self) -> str:
        of = max(self.postures, self.done + 1)
        target = f", target {shown(self.target)}" if self.target not in ("", self.reflector) else ""
        return (
            f"Measurement {self.shot} ({self.done} of {of} done){again_words(self.again)}{target}"
            f"{_which(self.instrument, self.reflector)}"
        )


def _which(instrument: str | None, reflector: str | None) -> str:
    names = (("instrument", instrument), ("reflector", reflector))
    return "".join(f", {what} {shown(name)}" for what, name in names if name)


@record
class ReadingRequested(RunEvent):
    """The joints of measurement `shot` are taken, and what the instrument reads there is asked for:
    `instrument` and `reflector` say of what, if there are several."""

    event: ClassVar[str] = "reading"
    shot: int
    reads: tuple[EnteredReading, ...]
    instrument: str | None = None
    reflector: str | None = None

    @property
    @key("what is measured, in words")
    def title(self) -> str:
        return f"Measurement {self.shot}{_which(self.instrument, self.reflector)}"


_CHOICES = {
    "yes": "record it all the same",
    "rad": "they are radians",
    "metres": "they are metres",
    "as": "it is measurement",
    "redo": "repeat measurement",
}


def _choices(answers: Sequence[str]) -> dict[str, str]:
    """What answers do: those of two words name a measurement."""
    rows = ((answer, *answer.partition(" ")) for answer in answers)
    return {answer: f"{_CHOICES[word]}{blank}{number}" for answer, word, blank, number in rows}


@record
class Doubted(RunEvent):
    """Typed values are not recorded: `kind` is limit, radians, metres, repeated, far, unreadable, refused or
    help;
    `answers` are the words that record it all the same."""

    event: ClassVar[str] = "doubt"
    shot: int
    kind: str
    found: str
    answers: tuple[str, ...]

    @property
    @key("what each of the answers does, in words")
    def choices(self) -> dict[str, str]:
        return _choices(self.answers)


@record
class Withdrawn(RunEvent):
    """A measurement is removed from the run file, to be repeated."""

    event: ClassVar[str] = "withdrawn"
    shot: int

    @property
    @key("what happened, in words")
    def line(self) -> str:
        return "withdrawn, to be measured again"


@record
class Suspected(RunEvent):
    """A measurement contradicts the others: its residual at their fit, and the corrected p-value."""

    event: ClassVar[str] = "suspect"
    shot: int
    p_value: float
    residual_mm: float

    @property
    @key("what happened, in words")
    def line(self) -> str:
        residual = significant(self.residual_mm, 2, "mm")
        return f"contradicts the others: its residual at their fit is {residual}"

    @property
    @key("what may be answered, and what that does, in words")
    def choices(self) -> dict[str, str]:
        return _choices([f"redo {self.shot}"])


@record
class Stopped(RunEvent):
    """A fault of the rig, or an interruption, ended the run."""

    event: ClassVar[str] = "stopped"
    why: str


@record
class Ended(RunEvent):
    """The answer of `zerobeam run`, `zerobeam/carried/1`.

    `message` is what is shown first, as in result.json; `headline` calls offsets as files do.
    `saved` postures were not needed, and `why` an adaptive run ended; None in any other. `missing` are the
    measurements that were still to come where a run by hand ended before the plan was through. `seconds` by
    phase. `coverage_factor` is k of every expanded uncertainty. `geometry` says what the offsets are worth if
    the arm deviates from what was taken. `true` has the true offsets (deg; mm) of a simulated run by name.
    `verifies` names the calibration run that the plan tests; None of any other plan. `tolerance` is up to
    which std an offset counts as identified. `conforms`: the robot meets what is required of it.
    """

    event: ClassVar[str] = "end"
    file: str
    verdict: Verdict
    message: Message
    headline: str
    parameters: tuple[ParameterResult, ...]
    p_value: float | None
    consistent: bool
    shots: tuple[int, ...]
    refused: tuple[RefusedPosture, ...]
    saved: int | None
    why: str | None
    seconds: Mapping[str, float]
    notes: tuple[str, ...]
    geometry: GeometryResult | None = None
    true: Mapping[str, float] = field(default_factory=dict)
    missing: tuple[int, ...] = ()
    coverage_factor: float = 2.0
    verifies: str | None = None
    tolerance: Mapping[str, float] = field(default_factory=dict)
    conforms: Annotated[bool, internal] = True


Listener = Callable[[RunEvent], None]


def event_json(event: RunEvent) -> dict[str, object]:
    """Plain JSON types, keys in the order of the fields."""
    schema = {"schema": "zerobeam/carried/1"} if isinstance(event, Ended) else {}
    return {"event": event.event, **schema, **to_json(event)}
