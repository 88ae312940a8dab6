"""The command line: signals first, then all that it consists of (`commands/program.py`).

Exit status: 0 verdict pass; 1 weakly observable or degenerate; 2 bad input or usage; 3 a fault of the rig or
of the program, a failed fit, or output that could not be written; 130 stopped, by Ctrl-C or a request to end;
141 nobody reads the output any more.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

from .interruption import ATTENDED, INTERRUPTED, answered, attend, interruptible, leave, stoppable


def main() -> NoReturn:
    """Entry point of the console script."""
    left: list[int] = []

    @atexit.register  # before all others, so that it is called last
    def end() -> None:
        """Without taking the modules apart: that takes a while, in which a request would kill the process."""
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with suppress(OSError, ValueError):
                stream.flush()
        for status in left:
            os._exit(status)

    def leaving(status: int) -> None:
        left.append(status)
        leave(status)

    sys.exit(run(leaving))


def run(ended: Callable[[int], None] = lambda status: None) -> int:
    """The exit status of what `sys.argv` asks for; `ended` is told it while signals are still heard."""
    # Few cycles, many objects: an analysis or a report makes fewer, and ends before any are collected.
    gc.set_threshold(1_000_000, 20, 20)
    # Matrices are small: other threads of BLAS would only wait, and that busily.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Else pydantic looks through all that is installed for what might want to watch it.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    with stoppable():
        if os.environ.pop(ATTENDED, ""):  # not for what this process starts
            attend()
        try:
            with interruptible():
                from .commands.program import carried_out  # imports, heard already

                status = carried_out()
        except KeyboardInterrupt:
            answered()
            with suppress(OSError, AttributeError):  # nobody reads it, or there is no standard error
                sys.stderr.write("stopped\n")
                sys.stderr.flush()
            status = INTERRUPTED
        ended(status)
    return status
