"""What every command prints to and ends with: streams, consoles, exit statuses, progress, JSON."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO, cast

from ..interruption import obey
from ..reports.output.terminal import Terminal
from ..words.wording import shown, visible

if TYPE_CHECKING:
    from ..reports.style.blocks import Page

EXIT_STATUS = {"pass": 0, "weak": 1, "degenerate": 1, "misfit": 1, "violated": 1}
FAULT = 3

UNREAD = 141  # 128 + SIGPIPE, as a shell has it

# A file may be called a:bug:b: that is no picture of one.
out = Terminal(highlight=False, emoji=False, soft_wrap=False)
err = Terminal(stderr=True, highlight=False, emoji=False)


class OutputLost(Exception):
    """What was printed reaches nobody: its reader has gone, or the disk is full. Raised once."""


class _Stream:
    """A standard stream that says what becomes of it: once it fails, it takes everything and writes nothing.

    The libraries would take a reader that has gone for a reason to exit with status 1, a verdict.
    """

    def __init__(self, stream: TextIO, *, loud: bool) -> None:
        self._stream, self._loud = stream, loud
        self.lost: OSError | None = None

    def write(self, text: str) -> int:
        self._do(lambda: self._stream.write(text))
        return len(text)

    def flush(self) -> None:
        self._do(self._stream.flush)

    def drop(self) -> None:
        """Forget what is not written yet: who should read it may never do so."""
        with suppress(OSError):  # of a stream without a descriptor, too
            descriptor, nowhere = self._stream.fileno(), os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, descriptor)
            os.close(nowhere)

    def _do(self, what: Callable[[], object]) -> None:
        if self.lost is not None:
            return
        try:
            what()
        except OSError as error:
            self.lost = error
            self.drop()
            if self._loud:
                raise OutputLost from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def guarded_streams() -> Iterator[Callable[[], OSError | None]]:
    """Within, standard output raises OutputLost where it fails, and standard error is silent then.

    The value is why output was lost, None where it was not; to be called at the end.
    """
    before = sys.stdout, sys.stderr
    output, errors = (
        _Stream(stream or open(os.devnull, "w"), loud=loud)  # noqa: SIM115 - None: was closed by the caller
        for stream, loud in ((sys.stdout, True), (sys.stderr, False))
    )

    def lost() -> OSError | None:
        with suppress(OutputLost):
            output.flush()
        return output.lost

    sys.stdout, sys.stderr = cast(TextIO, output), cast(TextIO, errors)
    try:
        yield lost
    except KeyboardInterrupt:
        output.drop()
        raise
    finally:
        sys.stdout, sys.stderr = before


def say(text: object, to: Terminal = out) -> None:
    """Print a text for a person, whose lines are not broken."""
    to.print(plain(text), markup=False, soft_wrap=True)


def print_json(answer: dict[str, Any]) -> None:
    sys.stdout.write(json_text(answer, indent=1) + "\n")


def show_answer(as_json: bool, answer: object, page: Callable[[], Page], /, **files: Path | None) -> None:
    """Print an answer: with --json itself (a record, or its JSON), else its page, and below it the `files`
    that there are, each behind what it is."""
    if as_json:
        from ..words.sentences import to_json

        print_json(answer if isinstance(answer, dict) else to_json(answer))
        return
    from ..reports.output.terminal import print_page

    print_page(out, page())
    for what, path in files.items():
        if path is not None:
            say(f"{what.capitalize()}: {path}")


def print_json_pieces(pieces: Iterable[str]) -> None:
    """The same of text that comes in pieces."""
    for piece in pieces:
        sys.stdout.write(_visible_json(piece))


def json_text(answer: dict[str, Any], indent: int | None = None) -> str:
    """JSON in which what a person would not see is escaped: it may end up in a terminal."""
    return _visible_json(json.dumps(answer, ensure_ascii=False, allow_nan=False, indent=indent))


def _visible_json(text: str) -> str:
    return visible(text, lambda letter: json.dumps(letter)[1:-1])


def plain(message: object) -> str:
    """A message of several lines with nothing in it that a terminal would obey or a person not see."""
    return "\n".join(shown(line) for line in str(message).split("\n"))


@contextmanager
def progress(title: str, stages: Mapping[str, float] | None = None) -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error: the stage under way, the share of the whole, the time left; silent when that
    is no terminal.

    The share that is told is that of the whole, or with `stages` (their parts of the time, in order) that of
    the stage. The bar never goes back. A program that sets `ZEROBEAM_PROGRESS=lines` is told in
    lines of JSON.
    """
    lines = os.environ.get("ZEROBEAM_PROGRESS") == "lines"
    if not err.is_terminal and not lines:
        yield lambda stage, share: obey()
        return
    parts = stages or {}
    total, far = sum(parts.values()), 0.0

    def whole(stage: str, share: float) -> float:
        nonlocal far
        obey()
        if stage in parts:
            before = list(parts)[: list(parts).index(stage)]
            share = (sum(parts[name] for name in before) + parts[stage] * share) / total
        far = max(far, share)
        return far

    if lines:
        printed = -1.0

        def print_progress(stage: str, share: float) -> None:
            nonlocal printed
            if (now := whole(stage, share)) >= printed + 0.01 or now >= 1.0 > printed:
                printed = now
                line = {"progress": round(now, 4), "stage": stage}
                say(json.dumps(line), to=err)

        yield print_progress
        return
    from rich.progress import (
        BarColumn,
        Progress,
        ProgressColumn,
        Task,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.text import Text

    from ..words.numbers import TimeLeft, left_words

    estimate = TimeLeft(time.monotonic())

    class LeftColumn(ProgressColumn):
        """The time left, anew each time that the bar is drawn."""

        def render(self, task: Task) -> Text:
            return Text(left_words(estimate.left(time.monotonic())), style="progress.remaining")

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        LeftColumn(),
    )

    def advance(stage: str, share: float) -> None:
        done = whole(stage, share)
        estimate.advanced(time.monotonic(), done)
        bar.update(task, completed=done, description=f"{title}: {stage}")

    with Progress(*columns, console=err, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield advance
