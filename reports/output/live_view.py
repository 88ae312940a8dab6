"""A run under way in the terminal: its progress redrawn in place; the dialogue of a run by hand."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ...experiments.procedure.events import (
    CONTRADICTION,
    Attempted,
    Doubted,
    EnteredReading,
    GivenUp,
    Listener,
    MeasurementRecorded,
    PhaseBegun,
    PostureRequested,
    ReadingRequested,
    Retried,
    RunEvent,
    RunOpened,
    SpotSeen,
    Stopped,
    Suspected,
    Withdrawn,
)
from ...words import numbers
from ...words.wording import clipped, counted, ended, label, listed, sentence, shown
from .terminal import STYLE

_REDRAWN = 8  # times a second
_STEPS = 4
_NONE = "—"
_UNKNOWN = "not known yet"
_CELL = 9  # letters of an offset's std, so that the columns do not move
_CLOCK = {"simulated": "simulated", "replay": "as recorded"}


@contextmanager
def live_view(console: Console) -> Iterator[Listener]:
    """Takes the events of a run (docs/files-cell.md) and shows its progress; nothing remains on the screen.

    Nothing is written where `console` is no terminal on which a line can be drawn anew.
    """
    if not console.is_terminal or console.is_dumb_terminal:
        yield lambda event: None
        return
    now = UnderWay()

    def hear(event: RunEvent) -> None:
        nonlocal now
        now = now.after(event)

    with Live(
        # Drawn by a thread of its own from a value that is never changed, only replaced: no event waits.
        get_renderable=lambda: drawn(now),
        console=console,
        transient=True,
        refresh_per_second=_REDRAWN,
        # What is piped elsewhere must not come to this terminal instead.
        redirect_stdout=sys.stdout.isatty(),
    ):
        yield hear


@dataclass(frozen=True)
class UnderWay:
    """The state of a run. `off_mm`: the last servo steps; `seconds`: of each measurement of this session;
    `std` by offset (deg; mm), None where it is unidentifiable, and empty before the first measurement."""

    file: str = ""
    rig: str = ""
    postures: int = 0
    tolerance: float | None = None
    recorded: int = 0
    refused: int = 0
    seconds: tuple[float, ...] = ()
    shot: int | None = None
    attempt: int = 1
    phase: str = ""
    off_mm: tuple[float, ...] = ()
    time_s: float | None = None
    std: Mapping[str, float | None] = field(default_factory=dict)
    worst: float | None = None
    p_value: float | None = None
    consistent: bool = True
    trouble: str = ""

    def after(self, event: RunEvent) -> UnderWay:
        """The same run after one more event; the last one changes nothing."""
        now = self
        match event:
            case Attempted() | PhaseBegun() | SpotSeen() | MeasurementRecorded():
                now = self if event.time_s is None else replace(self, time_s=event.time_s)
        match event:
            case RunOpened():
                return replace(
                    now,
                    file=event.file,
                    rig=event.rig,
                    postures=event.postures,
                    recorded=len(event.recorded),
                    tolerance=event.tolerance,
                )
            case Attempted():
                return replace(now, shot=event.shot, attempt=event.attempt, phase="", off_mm=())
            case PhaseBegun():
                return replace(now, phase=event.phase)
            case SpotSeen():
                return replace(now, off_mm=(*now.off_mm, event.off_mm)[-_STEPS:])
            case Retried():
                return replace(now, trouble=f"measurement {event.shot}, {event.line}")
            case GivenUp():
                trouble = f"measurement {event.shot} {event.line}"
                return replace(now, shot=None, refused=now.refused + 1, trouble=trouble)
            case MeasurementRecorded():
                return replace(
                    now,
                    shot=None,
                    recorded=event.recorded,
                    seconds=now.seconds if event.seconds is None else (*now.seconds, event.seconds),
                    std=event.std,
                    worst=event.worst_std,
                    p_value=event.p_value,
                    consistent=event.consistent,
                )
            case Stopped(why):
                return replace(now, shot=None, trouble=f"stopped: {why}")
            case _:
                return self

    @property
    def left(self) -> int:
        """Postures of which a measurement is still to come, the one under way included."""
        return max(self.postures - self.recorded - self.refused, 0)

    @property
    def seconds_left(self) -> float | None:
        """By the mean of the measurements of this session; None before the first."""
        return self.left * sum(self.seconds) / len(self.seconds) if self.seconds else None


def drawn(now: UnderWay) -> RenderableType:
    """The view: words and numbers, so that nothing is lost without colours."""
    if not now.postures:
        return Text("")
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="dim", no_wrap=True)
    grid.add_column(overflow="fold")
    grid.add_row("run", Text(clipped(now.file)))
    grid.add_row("now", _now(now))
    grid.add_row("spot off", Text(_steps(now.off_mm)))
    grid.add_row("measurements", Text(f"{now.recorded} recorded, {now.refused} refused, {now.left} to come"))
    grid.add_row("time", Text(_time(now)))
    grid.add_row("u, ° or mm", _stds(now.std))
    worst = _UNKNOWN if now.worst is None else numbers.spread(now.worst)
    tolerance = "" if now.tolerance is None else f" (tolerance {numbers.exact(now.tolerance)})"
    grid.add_row("largest u", Text(worst + tolerance))
    lines: list[RenderableType] = [grid]
    if not now.consistent:
        measure = "" if now.p_value is None else f" (p-value {numbers.p_value(now.p_value)})"
        lines.append(Text("! ", style="bold yellow") + Text(f"{CONTRADICTION}{measure}."))
    if now.trouble:
        lines.append(Text("! ", style="bold yellow") + Text(sentence(now.trouble)))
    return Group(*lines)


def _now(now: UnderWay) -> Text:
    if now.shot is None:
        return Text(_NONE)
    # A measurement has its posture's number, from 0, in whatever order they come.
    text = Text(f"measurement {now.shot} ({now.recorded + now.refused + 1} of {now.postures})")
    if now.attempt > 1:
        text.append(f", attempt {now.attempt}", style="yellow")
    return text.append(f": {shown(now.phase)}") if now.phase else text


def _steps(off_mm: tuple[float, ...]) -> str:
    if not off_mm:
        return _NONE
    return numbers.with_unit(" → ".join(numbers.significant(off, 2) for off in off_mm), "mm")


def _time(now: UnderWay) -> str:
    clock = _CLOCK.get(now.rig, "")
    passed = _NONE if now.time_s is None else f"{_duration(now.time_s)} {clock}".rstrip()
    left = "?" if now.seconds_left is None else _duration(now.seconds_left)
    # An adaptive run may need less.
    return f"{passed}, {'left' if now.tolerance is None else 'left at most'} {left}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    unit = f"{rest}{numbers.NO_BREAK}s"
    return f"{minutes}{numbers.NO_BREAK}min {unit}" if minutes else unit


def _stds(std: Mapping[str, float | None]) -> RenderableType:
    if not std:
        return Text(_UNKNOWN)
    cells = []
    for name, value in std.items():
        text = _NONE if value is None else numbers.spread(value)
        style = STYLE["unidentifiable"] if value is None else ""
        cells.append(Text(f"{label(name, 8)} {text}".ljust(_CELL), style=style))
    return Columns(cells, padding=(0, 2), equal=True)


def led_view(console: Console) -> Listener:
    """Takes the events of a run by hand and prints them, line by line."""
    before: Mapping[str, float | None] = {}
    joints = "type the joint values"
    agreed, since = True, -1  # whether all measurements before the next agree, else since which they do not

    def hear(event: RunEvent) -> None:
        nonlocal before, joints, agreed, since
        match event:
            case RunOpened():
                agreed = not event.recorded  # of those of another session nobody knows it here
                if event.rig == "live":
                    joints = "press Enter when the arm is at rest"
                _say(console, _beginning(event))
            case PostureRequested():
                console.print()
                _say(console, _request(event, joints), "bold")
                _say(console, f"  {', '.join(f'{shown(one.name)} {one.text}' for one in event.pendant)}")
            case ReadingRequested():
                _say(console, _reading(event), "bold")
            case Doubted(kind="help"):
                _say(console, sentence(event.found))
            case Doubted():
                text = f"! Not recorded: {ended(shown(event.found))}{_choices(event.choices)}"
                _say(console, text, "yellow")
            case MeasurementRecorded():
                _say(
                    console,
                    f"Measurement {event.shot} is recorded, {counted(event.recorded, 'measurement')}.",
                )
                _say(console, _falls(before, event.std))
                before = event.std
                if not event.consistent:
                    _say(console, _contradiction(event.shot if agreed else None), "yellow")
                if agreed and not event.consistent:
                    since = event.shot
                agreed = event.consistent
            case Suspected():
                _say(console, _suspected(event), "yellow")
            case Withdrawn():
                agreed = agreed or event.shot == since
                _say(console, f"Measurement {event.shot} is removed, to be repeated.")
            case GivenUp():
                _say(console, f"Measurement {event.shot} is skipped ({shown(event.found)}).")
            case _:
                pass

    return hear


def _say(console: Console, text: str, style: str = "") -> None:
    console.print(Text(text, style=style), soft_wrap=True)


def _beginning(event: RunOpened) -> str:
    done = len(event.recorded)
    so_far = f" {counted(done, 'measurement')} recorded already." if done else ""
    return (
        f"{counted(event.postures, 'posture')}.{so_far} 'help' says what may be typed, 'pause' ends for now."
    )


def _request(event: PostureRequested, joints: str) -> str:
    """`joints` says what a person does for them."""
    also = f"; then measurement {listed([str(number) for number in event.also])}" if event.also else ""
    reads = f"; then {_reads(event.reads)}" if event.reads else ""
    return f"{event.title}: go there, {event.act}, and {joints}{reads}{also}."


def _reading(event: ReadingRequested) -> str:
    return f"{event.title}: type {_reads(event.reads)}."


def _reads(reads: Sequence[EnteredReading]) -> str:
    return listed([f"the {read.words}" for read in reads])


def _choices(choices: Mapping[str, str]) -> str:
    words = [f"'{answer}': {does}" for answer, does in choices.items()]
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


def _contradiction(last: int | None) -> str:
    """`last` is the measurement before which all agreed, None where they did not."""
    text = "! The measurements contradict the model or each other."
    return (
        text if last is None else f"{text} They agreed before measurement {last}: 'redo {last}' repeats it."
    )


def _suspected(event: Suspected) -> str:
    return (
        f"! Measurement {event.shot} {event.line} (p-value {numbers.p_value(event.p_value)})."
        f" 'redo {event.shot}' repeats it."
    )
