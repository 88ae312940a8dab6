"""What goes wrong on purpose in the simulated cell, and when."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Sequence
from typing import Annotated, Literal, TypeVar, get_args

import numpy as np
from pydantic import BeforeValidator, Field

from ....model.arrays import Matrix
from ....model.files.reading import did_you_mean, shown
from ....model.files.validation import Count, FileModel, NotNegative, NumberPair, Vector, refusal


class _AtShot(FileModel):
    """What happens on purpose, and in which measurement."""

    shot: int = Field(ge=0, description="number of the measurement")


class _ForCalls(_AtShot):
    lasts: Count | None = Field(
        default=None,
        description="for how many readings or images from the measurement's first on; default: the whole"
        " measurement, "
        "every attempt at it",
    )


class PsdDropout(_ForCalls):
    """The wireless link is down."""

    kind: Literal["psd-dropout"] = Field(description="no sample of the PSD arrives")


class CameraBlack(_ForCalls):
    """The camera gives black images."""

    kind: Literal["camera-black"] = Field(description="images are black")


class LedOccluded(_ForCalls):
    """One LED is hidden."""

    kind: Literal["led-occluded"] = Field(description="a LED cannot be seen")
    led: Literal[1, 2] = Field(default=1, description="which")


class Reflection(_ForCalls):
    """A reflection of the beam that looks like the spot."""

    kind: Literal["reflection"] = Field(
        description="the beam, reflected, lights the PSD where it does not point, and shows in the images"
    )
    at_mm: NumberPair = Field(default=(4.0, -3.0), description="where on the face, millimetres")
    light: NotNegative = Field(default=0.8, description="its light, share of the laser's")


class EncoderGlitch(_ForCalls):
    """A joint is read wrong."""

    kind: Literal["encoder-glitch"] = Field(description="a joint reading is off")
    joint: Count = Field(description="which, from 1")
    deg: float = Field(description="by how much, degrees (mm)")


class RobotStop(_AtShot):
    """The robot stops by itself."""

    kind: Literal["robot-stop"] = Field(description="the controller stops the arm on its way")


class PsdBump(_AtShot):
    """Someone bumps the PSDs before this measurement: in it, and in all of higher numbers, they are
    elsewhere."""

    kind: Literal["psd-bump"] = Field(description="the PSDs are moved between two measurements")
    shift_mm: Vector = Field(description="by how much, base frame, millimetres")


class ProcessKilled(_AtShot):
    """The program is killed (SIGKILL)."""

    kind: Literal["process-killed"] = Field(description="the program is killed")
    call: Count = Field(description="at which use of the rig since the measurement began")


AnyFault = (
    PsdDropout | CameraBlack | LedOccluded | Reflection | EncoderGlitch | RobotStop | PsdBump | ProcessKilled
)
_FAULTS: dict[str, type[FileModel]] = {
    get_args(fault.model_fields["kind"].annotation)[0]: fault for fault in get_args(AnyFault)
}
FAULT_KINDS = tuple(_FAULTS)


def _of_a_kind(value: object) -> object:
    """Say which kinds there are, and which keys this one has: the others' keys are no help."""
    if not isinstance(value, dict):
        return value
    kind = value.get("kind")
    if kind not in FAULT_KINDS:
        raise refusal(
            "unknown kind of fault",
            key=("kind",),
            found=shown(kind),
            allowed=", ".join(FAULT_KINDS),
            remedy=did_you_mean(str(kind), FAULT_KINDS),
        )
    for key in value:
        if key not in (own := _FAULTS[kind].model_fields):
            raise refusal(
                f"unknown key {key!r} of a {kind}",
                key=(key,),
                found=f"{key}: {shown(value[key])}",
                allowed=", ".join(own),
                remedy=did_you_mean(key, own) or "remove it",
            )
    return value


Fault = Annotated[AnyFault, Field(discriminator="kind"), BeforeValidator(_of_a_kind)]

Kind = TypeVar("Kind", bound=AnyFault)

# On Windows any signal ends a process at once, and this one has no name there.
_KILL = signal.SIGTERM if sys.platform == "win32" else signal.SIGKILL


class Faults:
    """The schedule of one run.

    One that is `resumed` does not meet again what stopped it, a stop of the robot or the end of the process:
    until a measurement has been recorded there are none. (The measurement that was stopped need not be the
    first: those that were refused before it are tried again.)
    """

    def __init__(self, schedule: Sequence[AnyFault], *, resumed: bool = False) -> None:
        self._schedule = tuple(schedule)
        self._resumed = resumed
        self._first: tuple[int | None] | None = None
        self._shot = -1
        self._on: tuple[AnyFault, ...] = ()
        self._calls = 0
        self._met: list[int] = []

    def begin(self, shot: int, last: int | None) -> None:
        """Faults of this measurement begin; `last` is the number of the measurement that was recorded last
        (None: none)."""
        self._first = self._first or (last,)
        stopped_before = self._resumed and self._first == (last,)
        self._shot, self._calls = shot, 0
        self._on = tuple(
            fault
            for fault in self._schedule
            if fault.shot == shot and not (stopped_before and isinstance(fault, RobotStop | ProcessKilled))
        )
        self._met = [0] * len(self._on)

    def called(self) -> None:
        """Count one use of the rig; the process may end here."""
        self._calls += 1
        if any(isinstance(fault, ProcessKilled) and fault.call == self._calls for fault in self._on):
            os.kill(os.getpid(), _KILL)

    def met(self, kind: type[Kind]) -> Kind | None:
        """The fault of that kind that is on now, once more met; None if there is none, or no longer."""
        for i, fault in enumerate(self._on):
            if isinstance(fault, kind):
                self._met[i] += 1
                lasts = getattr(fault, "lasts", None)
                if lasts is None or self._met[i] <= lasts:
                    return fault
        return None

    def bumped(self) -> Matrix:
        """(3,) mm by which the PSDs have been moved up to this measurement."""
        shifts = [f.shift_mm for f in self._schedule if isinstance(f, PsdBump) and f.shot <= self._shot]
        return np.asarray(np.reshape(shifts, (-1, 3)).sum(axis=0))
