"""Why a measurement is refused: what the procedure found, in one word and in a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Reason(StrEnum):
    """What can keep a measurement from being recorded."""

    OUT_OF_VIEW = "marker out of view"
    CAMERA = "camera"
    OFF_FACE = "beam off the face"
    NO_SIGNAL = "no signal"
    SATURATED = "saturated"
    TOO_WEAK = "too weak"
    TOO_BRIGHT = "too bright"
    NOT_FOLLOWING = "light does not follow the arm"
    LIMIT = "joint limit"
    NOT_CONVERGING = "not converging"
    UNSTEADY = "unsteady"
    READING = "joint reading"
    SKIPPED = "skipped"


class MeasurementRefused(Exception):
    """A measurement cannot be made from here; the next attempt, or the next posture, may do better."""

    def __init__(self, reason: Reason, found: str) -> None:
        self.reason = reason
        self.found = found
        super().__init__(f"{reason}: {found}")


@dataclass(frozen=True)
class RefusedPosture:
    """A posture from which no measurement was recorded, and why."""

    shot: int
    reason: Reason
    found: str
