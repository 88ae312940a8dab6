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
from time import monotonic
from types import FrameType

INTERRUPTED = 130  # exit status
ATTENDED = "ZEROBEAM_ATTENDED"  # in the environment: end as by Ctrl-C once standard input ends
_REQUESTS = (signal.SIGINT, signal.SIGTERM)
_REMINDER = getattr(signal, "SIGURG", signal.SIGABRT)  # one that comes late, to no handler, is ignored
SIGNALS = (*_REQUESTS, _REMINDER)
_SAME_S = 1.0  # `timeout` sends its signal twice, to the process and to its group: that is one request
_AGAIN_S = 0.05
_PATIENCE_S = 10.0  # from the end of an attendance until the process ends, whatever it does


class _Request:
    """`since` when this process is to end (None: it is not), `ever` once it was asked to. Only the `main`
    thread is interrupted."""

    since: float | None = None
    ever = False
    put_off = False
    main = _thread.get_ident()


def _handle(number: int, frame: FrameType | None) -> None:
    now, before = monotonic(), _Request.since
    insisted = number != _REMINDER and (before is None or now - before > _SAME_S)
    if insisted:
        _Request.since, _Request.ever = now, True
    if insisted and before is None:
        with suppress(RuntimeError):  # no more threads: then nobody reminds
            _thread.start_new_thread(_remind, ())
    if requested() and not _Request.put_off and (insisted or not _on_its_way_out()):
        raise KeyboardInterrupt


def _remind() -> None:
    """A thread of its own: until the request is answered, the handler is called again and again."""
    while requested():
        time.sleep(_AGAIN_S)
        if requested():
            _send(_REMINDER)


def _send(number: int) -> None:
    """A signal to the main thread, from another one."""
    if sys.platform == "win32":
        _thread.interrupt_main(number)
    else:
        signal.pthread_kill(_Request.main, number)  # wakes what waits, too


def _on_its_way_out() -> bool:
    """Whether an interruption is being raised: a `finally`, a handler or the end of a `with` is at work."""
    error = sys.exception()
    while error is not None and not isinstance(error, (KeyboardInterrupt, GeneratorExit)):
        error = error.__context__
    return error is not None


def requested() -> bool:
    """Whether this process was asked to end, and has not yet answered."""
    return _Request.since is not None


def obey() -> None:
    """Raise KeyboardInterrupt if this process was asked to end: a stage, a motion must not begin any more."""
    if requested() and not _Request.put_off and _thread.get_ident() == _Request.main:
        raise KeyboardInterrupt


def answered() -> None:
    """The request was obeyed, and what comes now belongs to the end."""
    _Request.since = None


@contextmanager
def stoppable() -> Iterator[None]:
    """SIGINT (Ctrl-C) and SIGTERM raise KeyboardInterrupt within, whatever the parent process set.

    A shell lets what it starts in the background ignore SIGINT, many CI runners too, and Python leaves it so.
    Once it is raised, the destructors of objects that are half made may fail: that is no news.
    """
    _Request.main, _Request.ever, report = _thread.get_ident(), False, sys.unraisablehook
    before = {number: signal.signal(number, _handle) for number in SIGNALS}
    sys.unraisablehook = lambda raised: None if _Request.ever else report(raised)
    try:
        yield
    finally:
        answered()
        sys.unraisablehook = report
        for number, handler in before.items():
            if signal.getsignal(number) == _handle:  # not so after `leave`
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
def _putting_off(put_off: bool) -> Iterator[None]:
    if _thread.get_ident() != _Request.main:  # no other thread is ever interrupted
        yield
        return
    before, _Request.put_off = _Request.put_off, put_off
    try:
        yield
    finally:
        _Request.put_off = before


def attend() -> None:
    """Ask this process to end once standard input ends: who started it, and held the other end, is no more.

    What comes before is passed on: standard input reads the same lines as without.
    """
    inner, passed = os.pipe()
    outer = os.dup(0)
    os.dup2(inner, 0)
    os.close(inner)

    def read() -> None:
        with suppress(OSError):  # as good as an end
            while part := os.read(outer, 2**16):
                while part:
                    part = part[os.write(passed, part) :]
        _send(signal.SIGINT)
        time.sleep(_PATIENCE_S)
        os._exit(INTERRUPTED)

    _thread.start_new_thread(read, ())


def leave(status: int) -> None:
    """The command has ended: whoever asks from now on need not wait until the interpreter has tidied up."""
    for number in _REQUESTS:
        signal.signal(number, lambda number, frame: os._exit(status))
