"""A request to end is obeyed, whoever loses the exception, and not in the middle of what has to be whole."""

import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import casadi as ca
import pytest
from asked_to_end import ask, lost, without_reminders

from zerobeam import interruption
from zerobeam.interruption import answered, interruptible, obey, requested, stoppable, uninterrupted

REQUESTS = [signal.SIGINT, signal.SIGTERM]


class InCasadi:
    """Converted by CasADi's wrapper, which throws away what comes up meanwhile."""

    def __DM__(self) -> ca.DM:
        ask()
        return ca.DM(1)


class InDestructor:
    def __del__(self) -> None:
        ask()


def in_casadi() -> None:
    ca.DM(InCasadi())


def in_destructor() -> None:
    InDestructor()


@pytest.mark.parametrize("number", REQUESTS)
@pytest.mark.parametrize("inherited", [signal.SIG_DFL, signal.SIG_IGN])
def test_within_it_is_heard_and_afterwards_all_is_as_before(
    number: signal.Signals, inherited: signal.Handlers
) -> None:
    before = [signal.signal(own, inherited) for own in REQUESTS]
    try:
        with pytest.raises(KeyboardInterrupt), stoppable():
            ask(number)
        assert [signal.getsignal(own) for own in REQUESTS] == [inherited] * 2
        assert not requested()
    finally:
        for own, handler in zip(REQUESTS, before, strict=True):
            signal.signal(own, handler)


@pytest.mark.parametrize("lose", [lost, in_casadi, in_destructor])
def test_a_request_that_is_lost_is_raised_again(
    lose: Callable[[], None], capfd: pytest.CaptureFixture[str]
) -> None:
    def losing() -> None:
        with suppress(NotImplementedError):  # CasADi's: of a wrong argument
            lose()
        time.sleep(60)

    with stoppable(), pytest.raises(KeyboardInterrupt):
        losing()
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("lose", [lost, in_casadi, in_destructor])
def test_a_stage_that_polls_does_not_begin(lose: Callable[[], None]) -> None:
    with without_reminders(), stoppable():
        obey()
        with suppress(NotImplementedError):
            lose()
        assert requested()
        with pytest.raises(KeyboardInterrupt):
            obey()


class HalfMade:
    """Interrupted while it is made: its destructor misses what was not yet set."""

    closed: bool

    def __init__(self, asked: bool) -> None:
        if asked:
            ask()
        self.closed = True

    def __del__(self) -> None:
        assert self.closed


def test_destructors_of_what_is_half_made_say_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    reported: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda raised: reported.append(raised.exc_type))
    with stoppable():
        HalfMade.__new__(HalfMade)  # nobody asked this process to end: that is an error
        assert reported == [AttributeError]
        with suppress(KeyboardInterrupt):
            HalfMade(asked=True)
    assert reported == [AttributeError]


def test_an_error_that_a_library_makes_of_it_is_an_interruption() -> None:
    with without_reminders(), stoppable():
        with pytest.raises(KeyboardInterrupt), interruptible():
            in_casadi()
        answered()
        with pytest.raises(ZeroDivisionError), interruptible():  # any other error stays what it is
            raise ZeroDivisionError


def test_a_request_that_comes_twice_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """`timeout` sends it to the process and to its group; a second Ctrl-C of a person comes later."""
    now, done = [100.0], []
    monkeypatch.setattr(interruption, "monotonic", lambda: now[0])

    def asked_again() -> None:
        try:
            ask(signal.SIGTERM)
        finally:
            now[0] += 0.5
            ask(signal.SIGTERM)
            done.append("the way out is not broken off")
            now[0] += 0.6
            ask()
            done.append("unless a person insists")

    with stoppable(), pytest.raises(KeyboardInterrupt):
        asked_again()
    assert done == ["the way out is not broken off"]


def test_the_way_out_is_not_broken_off_by_reminders(monkeypatch: pytest.MonkeyPatch) -> None:
    reminders = counted_reminders(monkeypatch)
    done = []

    def tidied_up() -> None:
        try:
            ask()
        finally:
            with generated():
                while len(reminders) < 3:
                    time.sleep(0.01)
            done.append("tidied up")

    with stoppable(), pytest.raises(KeyboardInterrupt):
        tidied_up()
    assert done == ["tidied up"]


def test_what_must_be_whole_is_done_first() -> None:
    done = []

    def whole() -> None:
        with uninterrupted():
            ask()
            done.append("whole")
        done.append("after it")

    def whole_at_its_end() -> None:
        with uninterrupted():
            try:
                with interruptible():
                    ask()
                    done.append("what may be interrupted")
            finally:
                time.sleep(0.2)
                done.append("its end")

    for part in (whole, whole_at_its_end):
        with stoppable(), pytest.raises(KeyboardInterrupt):
            part()
    assert done == ["whole", "its end"]


def test_what_has_been_answered_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    reminders = counted_reminders(monkeypatch)
    with stoppable():
        with suppress(KeyboardInterrupt):
            try:
                ask()
            finally:
                while not reminders:
                    time.sleep(0.01)
                answered()
        time.sleep(0.2)
        obey()
        with pytest.raises(KeyboardInterrupt):
            ask()
        answered()


def counted_reminders(patch: pytest.MonkeyPatch) -> list[int]:
    """One entry for each reminder."""
    said: list[int] = []
    posix = sys.platform != "win32"
    where, name = (signal, "pthread_kill") if posix else (interruption._thread, "interrupt_main")
    remind = getattr(where, name)

    def count(*arguments: int) -> None:
        said.append(len(said))
        remind(*arguments)

    patch.setattr(where, name, count)
    return said


@contextmanager
def generated() -> Iterator[None]:
    """A context that is a generator, as most are: it has exceptions of its own."""
    yield
