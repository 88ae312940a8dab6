"""A run under way, seen in the terminal: what its events say, redrawn in place until it ends."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

from rich.columns import Columns
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ..words import numbers
from ..words.wording import clipped, label, sentence, shown
from .terminal import STYLE, contradicted

Json = dict[str, Any]

_REDRAWN = 8  # times a second
_STEPS = 4
_NOT_TOLD = "—"
_CELL = 9  # letters of an offset's std, so that the columns stand still
_CLOCK = {"simulated": "simulated", "replay": "as recorded"}


@contextmanager
def live_view(console: Console) -> Iterator[Callable[[Json], None]]:
    """Hears the events of a run (docs/files.md) and shows where it stands; nothing remains on the screen.

    Nothing is written where `console` is no terminal on which a line can be drawn anew.
    """
    if not console.is_terminal or console.is_dumb_terminal:
        yield lambda event: None
        return
    now = UnderWay()

    def hear(event: Json) -> None:
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
    """Where a run stands. `off_mm`: the last servo steps; `seconds`: of each shot of this session; `std`
    by offset (deg; mm), None where the data cannot tell it, and empty before the first shot."""

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
    std: dict[str, float | None] = field(default_factory=dict)
    worst: float | None = None
    p_value: float | None = None
    consistent: bool = True
    trouble: str = ""

    def after(self, event: Json) -> UnderWay:
        """The same run after one more event; those of an unknown kind change nothing."""
        time_s = event.get("time_s")
        now = self if time_s is None else replace(self, time_s=time_s)
        match event:
            case {"event": "begin", "file": file, "rig": rig, "postures": postures, "recorded": recorded}:
                return replace(
                    now,
                    file=file,
                    rig=rig,
                    postures=postures,
                    recorded=len(recorded),
                    tolerance=event.get("tolerance"),
                )
            case {"event": "shot", "shot": shot, "attempt": attempt}:
                return replace(now, shot=shot, attempt=attempt, phase="", off_mm=())
            case {"event": "phase", "phase": phase}:
                return replace(now, phase=phase)
            case {"event": "spot", "off_mm": off}:
                return replace(now, off_mm=(*now.off_mm, off)[-_STEPS:])
            case {"event": "retry", "shot": shot, "attempt": attempt, "reason": reason, "found": found}:
                return replace(now, trouble=f"shot {shot}, attempt {attempt} refused ({reason}): {found}")
            case {"event": "refused", "shot": shot, "reason": reason, "found": found}:
                trouble = f"shot {shot} given up ({reason}): {found}"
                return replace(now, shot=None, refused=now.refused + 1, trouble=trouble)
            case {"event": "recorded", "recorded": recorded, "std": std}:
                seconds = event.get("seconds")
                return replace(
                    now,
                    shot=None,
                    recorded=recorded,
                    seconds=now.seconds if seconds is None else (*now.seconds, seconds),
                    std=std,
                    worst=event.get("worst_std"),
                    p_value=event.get("p_value"),
                    consistent=event.get("consistent", True),
                )
            case {"event": "stopped", "why": why}:
                return replace(now, shot=None, trouble=f"stopped: {why}")
            case _:
                return self

    @property
    def left(self) -> int:
        """Postures from which a shot is still to come, the one under way included."""
        return max(self.postures - self.recorded - self.refused, 0)

    @property
    def seconds_left(self) -> float | None:
        """By the mean of the shots of this session; None before the first."""
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
    grid.add_row("shots", Text(f"{now.recorded} recorded, {now.refused} refused, {now.left} to come"))
    grid.add_row("time", Text(_time(now)))
    grid.add_row("std, ° or mm", _stds(now.std))
    grid.add_row("worst std", Text(_worst(now)))
    lines: list[RenderableType] = [grid]
    if not now.consistent:
        lines.append(contradicted(now.p_value))
    if now.trouble:
        lines.append(Text("! ", style="bold yellow") + Text(sentence(now.trouble)))
    return Group(*lines)


def _now(now: UnderWay) -> Text:
    if now.shot is None:
        return Text(_NOT_TOLD)
    # A shot has its posture's number, from 0, in whatever order they come.
    text = Text(f"shot {now.shot} ({now.recorded + now.refused + 1} of {now.postures})")
    if now.attempt > 1:
        text.append(f", attempt {now.attempt}", style="yellow")
    return text.append(f": {shown(now.phase)}") if now.phase else text


def _steps(off_mm: tuple[float, ...]) -> str:
    if not off_mm:
        return _NOT_TOLD
    return numbers.with_unit(" → ".join(numbers.significant(off, 2) for off in off_mm), "mm")


def _time(now: UnderWay) -> str:
    clock = _CLOCK.get(now.rig, "")
    passed = _NOT_TOLD if now.time_s is None else f"{_duration(now.time_s)} {clock}".rstrip()
    left = "?" if now.seconds_left is None else _duration(now.seconds_left)
    # An adaptive run may need less.
    return f"{passed}, {'left' if now.tolerance is None else 'left at most'} {left}"


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    unit = f"{rest}{numbers.NO_BREAK}s"
    return f"{minutes}{numbers.NO_BREAK}min {unit}" if minutes else unit


def _stds(std: dict[str, float | None]) -> RenderableType:
    if not std:
        return Text("not told yet")
    return Columns([_std(name, value) for name, value in std.items()], padding=(0, 2), equal=True)


def _std(name: str, value: float | None) -> Text:
    if value is None:
        return Text(f"{label(name, 8)} {_NOT_TOLD}".ljust(_CELL), style=STYLE["unidentifiable"])
    return Text(f"{label(name, 8)} {numbers.spread(value)}".ljust(_CELL))


def _worst(now: UnderWay) -> str:
    worst = "not told yet" if now.worst is None else numbers.spread(now.worst)
    return worst if now.tolerance is None else f"{worst} (wanted {numbers.exact(now.tolerance)})"
