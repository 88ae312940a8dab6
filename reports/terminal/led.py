"""What a person who is led through a run reads: postures, doubts, and what each measurement gave."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.text import Text

from ...experiments.procedure.events import (
    Doubted,
    GivenUp,
    Listener,
    MeasurementRecorded,
    PostureRequested,
    RunEvent,
    RunOpened,
    Suspected,
    Withdrawn,
)
from ...words import numbers
from ...words.wording import counted, ended, label, sentence, shown

_DIGITS = {"rad": 4, "pulse": 0}  # decimals; of degrees and millimetres 2
_ANSWERS = {"yes": "'yes' records it all the same", "rad": "'rad' takes them as radians"}


def led_view(console: Console) -> Listener:
    """Takes the events of a run by hand and prints them, line by line."""
    before: Mapping[str, float | None] = {}

    def hear(event: RunEvent) -> None:
        nonlocal before
        match event:
            case RunOpened():
                _say(console, _begun(event))
            case PostureRequested():
                console.print()
                _say(console, _asked(event), "bold")
                _say(console, _joints(event.pendant))
            case Doubted(kind="help"):
                _say(console, sentence(event.found))
            case Doubted():
                _say(console, f"! Not recorded: {ended(shown(event.found))}{_choices(event)}", "yellow")
            case MeasurementRecorded():
                _say(
                    console,
                    f"Measurement {event.shot} is recorded, {counted(event.recorded, 'measurement')}.",
                )
                _say(console, _falls(before, event.std))
                before = event.std
                if not event.consistent:
                    _say(console, "! The measurements contradict the model or each other.", "yellow")
            case Suspected():
                _say(console, _suspected(event), "yellow")
            case Withdrawn():
                _say(console, f"Measurement {event.shot} is removed, to be repeated.")
            case GivenUp():
                _say(console, f"Posture {event.shot} is skipped ({shown(event.found)}).")
            case _:
                pass

    return hear


def _say(console: Console, text: str, style: str = "") -> None:
    console.print(Text(text, style=style), soft_wrap=True)


def _begun(event: RunOpened) -> str:
    done = len(event.recorded)
    so_far = f" {counted(done, 'measurement')} recorded already." if done else ""
    return (
        f"{counted(event.postures, 'posture')}.{so_far} 'help' says what may be typed, 'pause' ends for now."
    )


def _asked(event: PostureRequested) -> str:
    again = ", closing" if event.shot >= event.postures else ""
    of = f"{event.done + 1} of {event.postures}" if not again else f"{event.done + 1}"
    return (
        f"Posture {of} (measurement {event.shot}{again}), target {shown(event.target)}:"
        " go there, bring the beam or probe onto the target, and type the joint values."
    )


def _joints(readings: Sequence[Mapping[str, str | float]]) -> str:
    """Names and values as the pendant has them."""
    return "  " + ", ".join(
        f"{shown(str(own['name']))} {numbers.fixed(float(own['value']), _DIGITS.get(str(own['unit']), 2))}"
        for own in readings
    )


def _choices(event: Doubted) -> str:
    words = [_ANSWERS.get(answer, f"'{answer}' takes it for that posture") for answer in event.answers]
    return f" {'; '.join(words)}; or type again." if words else ""


def _falls(before: Mapping[str, float | None], after: Mapping[str, float | None]) -> str:
    """u of each offset, and what it was."""
    parts = []
    for name, value in after.items():
        now = "?" if value is None else numbers.spread(value)
        was = before.get(name)
        parts.append(f"{label(name)} {f'{numbers.spread(was)} → ' if was is not None else ''}{now}")
    known = "" if all(value is not None for value in after.values()) else " (?: not identifiable yet)"
    return f"  u, ° or mm: {', '.join(parts)}{known}"


def _suspected(event: Suspected) -> str:
    return (
        f"! Measurement {event.shot} contradicts the others: its residual at their fit is"
        f" {numbers.significant(event.residual_mm, 2, 'mm')} (p-value {numbers.p_value(event.p_value)})."
        f" 'redo {event.shot}' repeats it."
    )
