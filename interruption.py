"""Ctrl-C and requests to end: obeyed for certain, and never in the middle of what has to be whole.

Python raises KeyboardInterrupt between any two instructions of the main thread, and the code that runs there
may lose it. CasADi's wrapper does: it clears any exception while it converts an argument, and goes on, or
reports a wrong argument. So do destructors and bare `except:` clauses. A request is therefore remembered, and
raised again until it is on its way out. This module is loaded before all others and imports next to nothing.
"""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

INTERRUPTED = 130  # exit status
ATTENDED = "ZEROBEAM_ATTENDED"  # in the environment: end as by Ctrl-C once standard input ends
_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_SAME_S = 1.0  # `timeout` sends its signal twice, to the process and to its group: that is one request
_AGAIN_S = 0.05
_PATIENCE_S = 10.0  # from the end of an attendance until the process ends, whatever it does


class _Request:
    """What is asked of this process: `since` when (None: nothing). Only the main thread is interrupted."""

    def __init__(self) -> None:
        self.since: float | None = None
        self.put_off = False
        self.reminded = False
        self.main = _thread.get_ident()
        self.lock = _thread.allocate_lock()  # between a reminder and an answer

    def hear(self, number: int, frame: FrameType | None) -> None:
        """The handler of the signals: of those from outside, and of reminders."""
        reminder, self.reminded = self.reminded, False
        now, before = time.monotonic(), self.since
        if reminder:
            insisted = False
        elif insisted := before is None or now - before > _SAME_S:
            self.since = now
            if before is None:
                with suppress(RuntimeError):  # no more threads: then nobody reminds
                    _thread.start_new_thread(self.remind, ())
        if requested() and not self.put_off and (insisted or not _on_its_way_out()):
            raise KeyboardInterrupt

    def remind(self) -> None:
        """A thread of its own: until the request is answered, the handler is called again and again."""
        while True:
            time.sleep(_AGAIN_S)
            with self.lock:
                if self.since is None:
                    return
                self.reminded = True
                self.wake()

    def wake(self) -> None:
        """Let the main thread hear, from another one."""
        if sys.platform == "win32":
            _thread.interrupt_main()
        else:
            signal.pthread_kill(self.main, signal.SIGINT)  # wakes what waits, too

    def answer(self) -> None:
        before, self.put_off = self.put_off, True  # the lock must not be left locked
        with self.lock:
            self.since = None
        self.put_off = before


_request = _Request()


def requested() -> bool:
    """Whether this process was asked to end, and has not yet answered."""
    return _request.since is not None


def obey() -> None:
    """Raise KeyboardInterrupt if this process was asked to end: a stage, a motion must not begin any more."""
    if requested() and not _request.put_off and _thread.get_ident() == _request.main:
        raise KeyboardInterrupt


def answered() -> None:
    """The request was obeyed, and what comes now belongs to the end."""
    _request.answer()


@contextmanager
def stoppable() -> Iterator[None]:
    """SIGINT (Ctrl-C) and SIGTERM raise KeyboardInterrupt within, whatever the parent process set.

    A shell lets what it starts in the background ignore SIGINT, many CI runners too, and Python leaves it so.
    """
    _request.main, hear, lost = _thread.get_ident(), _request.hear, sys.unraisablehook
    before = {number: signal.signal(number, hear) for number in _SIGNALS}
    sys.unraisablehook = lambda raised: None if raised.exc_type is KeyboardInterrupt else lost(raised)
    try:
        yield
    finally:
        answered()
        sys.unraisablehook = lost
        for number, handler in before.items():
            if signal.getsignal(number) == hear:  # not so after `leave`
                signal.signal(number, handler)


@contextmanager
def interruptible() -> Iterator[None]:
    """A request that comes within ends as a KeyboardInterrupt, whatever the libraries make of it.

    The counterpart of `uninterrupted`: what is around it is not interrupted, what is within is.
    """
    with _putting_off(False):
        obey()
        try:
            yield
        except Exception as error:
            if requested():
                raise KeyboardInterrupt from error
            raise
        obey()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Requests are obeyed at the end: for what is short and must not be left half done."""
    with _putting_off(True):
        yield
    obey()


@contextmanager
def _putting_off(asked: bool) -> Iterator[None]:
    if _thread.get_ident() != _request.main:  # no other thread is ever interrupted
        yield
        return
    before, _request.put_off = _request.put_off, asked
    try:
        yield
    finally:
        _request.put_off = before


def attend() -> None:
    """Ask this process to end once standard input ends: who started it, and held the other end, is no more.

    What comes before is passed on: standard input reads the same lines as without.
    """
    inner, passed = os.pipe()
    outer = os.dup(0)
    os.dup2(inner, 0)
    os.close(inner)

    def read() -> None:
        try:
            while part := os.read(outer, 2**16):
                while part:
                    part = part[os.write(passed, part) :]
        except OSError:
            pass  # as good as an end
        _request.wake()
        time.sleep(_PATIENCE_S)
        os._exit(INTERRUPTED)

    _thread.start_new_thread(read, ())


def leave(status: int) -> None:
    """The command has ended: whoever asks from now on need not wait until the interpreter has tidied up."""

    def at_once(number: int, frame: FrameType | None) -> None:
        os._exit(status)

    for number in _SIGNALS:
        signal.signal(number, at_once)


def _on_its_way_out() -> bool:
    """Whether an interruption is being raised: a `finally`, a handler or the end of a `with` is at work."""
    error = sys.exception()
    while error is not None:
        if isinstance(error, (KeyboardInterrupt, GeneratorExit)):
            return True
        error = error.__context__
    return False
