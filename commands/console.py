"""What every command prints to and ends with: consoles, exit statuses, progress, JSON."""

from __future__ import annotations

import json
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from ..reports.style.terminal import Terminal

EXIT_STATUS = {"pass": 0, "weak": 1, "degenerate": 1, "misfit": 1}
FAULT = 3
INTERRUPTED = 130

out = Terminal(highlight=False, soft_wrap=False)
err = Terminal(stderr=True, highlight=False)


def print_json(answer: dict[str, Any]) -> None:
    sys.stdout.write(json_text(answer, indent=1) + "\n")


def json_text(answer: dict[str, Any], indent: int | None = None) -> str:
    """JSON in which what a person would not see is escaped: it may end up in a terminal."""
    from ..reports.words.wording import visible

    text = json.dumps(answer, ensure_ascii=False, allow_nan=False, indent=indent)
    return visible(text, lambda letter: json.dumps(letter)[1:-1])


def plain(message: object) -> str:
    """A message of several lines with nothing in it that a terminal would obey or a person not see."""
    from ..reports.words.wording import shown

    return "\n".join(shown(line) for line in str(message).split("\n"))


@contextmanager
def progress(title: str) -> Iterator[Callable[[str, float], None]]:
    """A bar on standard error with the stage under way; silent when that is no terminal."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(title, total=1.0)

        def tell(stage: str, share: float) -> None:
            bar.update(task, description=f"{title}: {stage}", completed=share)

        yield tell


@contextmanager
def stoppable() -> Iterator[None]:
    """Ctrl-C (SIGINT) and a request to end (SIGTERM) raise KeyboardInterrupt, whatever the parent set.

    A shell lets what it starts in the background ignore SIGINT, many CI runners too, and Python leaves it so.
    `timeout` sends its signal twice, to the process and to its group: what comes within a second of the
    first is taken for the same request, so that it does not break off the way out.
    """
    last = -math.inf

    def stop(*_: Any) -> None:
        nonlocal last
        if (now := time.monotonic()) - last > 1.0:
            last = now
            raise KeyboardInterrupt

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
