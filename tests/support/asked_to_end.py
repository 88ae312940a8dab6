"""Requests to end, as they come from outside, and as a library loses them."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from zerobeam import interruption


def ask(number: signal.Signals = signal.SIGINT) -> None:
    signal.raise_signal(number)


def lost(number: signal.Signals = signal.SIGINT) -> None:
    """A request whose exception someone throws away."""
    with suppress(KeyboardInterrupt):
        ask(number)


@contextmanager
def without_reminders() -> Iterator[None]:
    """A request that was lost is not raised again by itself: only who polls hears of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interruption, "_remind", lambda: None)
        yield
