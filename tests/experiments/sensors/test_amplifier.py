"""The amplifier of a PSD: its lines, and on a real pseudo-terminal what arrives, and a port that is gone."""

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from amplifier_stand_in import AmplifierStandIn, LineFaults, parse_request

from zerobeam.experiments.sensors import amplifier as module
from zerobeam.experiments.sensors.amplifier import (
    LONGEST,
    Amplifier,
    PsdSample,
    parse_sample,
    request_line,
    sample_line,
    verified_body,
    with_checksum,
)
from zerobeam.model.arrays import Matrix
from zerobeam.model.errors import BadInput, RigFault

SAMPLE = PsdSample(65535, 9999, (-8388608, 8388607, 0, -12))


def test_the_checksum_is_the_documented_one() -> None:
    """Its check value (Williams, A painless guide to CRC error detection algorithms)."""
    assert with_checksum("123456789") == b"123456789*29B1\n"
    assert with_checksum("D 7 0 1200 1189 1203 1190") == b"D 7 0 1200 1189 1203 1190*6F48\n"


def test_a_sample_comes_back_as_it_was() -> None:
    line = with_checksum(sample_line(SAMPLE))
    assert len(line) <= LONGEST
    for end in (b"\n", b"\r\n", b""):
        body = verified_body(line.rstrip(b"\n") + end)
        assert body is not None
        assert parse_sample(body) == SAMPLE
    assert parse_request(request_line(17, 100)) == (17, 100)


def test_no_changed_character_and_no_missing_one_goes_unnoticed() -> None:
    line = with_checksum(sample_line(SAMPLE)).rstrip()
    for at in range(len(line)):
        assert verified_body(line[:at]) is None
        assert verified_body(line[:at] + line[at + 1 :]) is None
        for bit in range(8):
            changed = line[:at] + bytes([line[at] ^ 1 << bit]) + line[at + 1 :]
            body = verified_body(changed)
            # A checksum in small letters is the same one.
            assert body is None or changed.upper() == line


@pytest.mark.parametrize(
    "body",
    [
        "D 1 0 5 6 7",
        "D 1 0 5 6 7 8 9",
        "D 1 0 5 6 7 8.5",
        "D 1 0 5 6 7 x",
        "D 1 -1 5 6 7 8",
        "I D 1 0 5 6 7 8",
        "",
    ],
)
def test_a_line_whose_checksum_is_right_is_not_yet_a_sample(body: str) -> None:
    assert verified_body(with_checksum(body)) == body
    assert parse_sample(body) is None
    assert parse_sample("D 1 0 5 6 7 8") == PsdSample(1, 0, (5, 6, 7, 8))


pytest.importorskip("serial")
pytest.importorskip("pty")

RATE = 20_000.0
SOUND = LineFaults()
Opened = Callable[..., tuple[AmplifierStandIn, Amplifier]]
Grace = Callable[[float], None]


def numbered(samples: int) -> Matrix:
    return np.arange(4.0 * samples).reshape(samples, 4) - 50


@pytest.fixture(autouse=True)
def grace(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Sets for how long samples are waited for; at first, so long that a busy computer is no fault."""

    def call(seconds: float) -> None:
        monkeypatch.setattr(module, "_GRACE_S", seconds)

    call(10.0)
    return call


@pytest.fixture
def opened() -> Iterator[Opened]:
    """A stand-in, and the amplifier at its port."""
    to_close: list[AmplifierStandIn | Amplifier] = []

    def call(
        counts: Callable[[int], Matrix] = numbered, faults: LineFaults = SOUND
    ) -> tuple[AmplifierStandIn, Amplifier]:
        there = AmplifierStandIn("PSD-A 0017", counts)
        to_close.append(there)
        here = Amplifier(there.device, 115200, "the PSD amplifier of psd")
        to_close.append(here)
        there.faults = faults
        return there, here

    yield call
    for one in reversed(to_close):
        one.close()


def test_counts_arrive_in_their_order(opened: Opened) -> None:
    _, here = opened()
    assert here.name == "PSD-A 0017"
    np.testing.assert_array_equal(here.counts(100, RATE), numbered(100))
    np.testing.assert_array_equal(here.counts(1, RATE), numbered(1))


@pytest.mark.parametrize("kind", ["lost", "torn", "wrong", "garbage"])
def test_what_is_spoilt_on_the_line_is_missing_and_never_wrong(
    opened: Opened, grace: Grace, kind: str
) -> None:
    grace(0.5)
    _, here = opened(faults=LineFaults(**{kind: 0.2}))
    rows = here.counts(200, RATE)
    came = np.isfinite(rows)
    assert (came.any(axis=1) == came.all(axis=1)).all()
    whole = came.all(axis=1)
    # A torn line takes the next one with it. Binomial: 200 lines, five stds of 0.03.
    assert 0.4 < whole.mean() < 0.95
    np.testing.assert_array_equal(rows[whole], numbered(200)[whole])
    # Control: the line itself is sound again.
    _, sound = opened()
    assert np.isfinite(sound.counts(200, RATE)).all()


def test_silence_is_no_sample(opened: Opened, grace: Grace) -> None:
    grace(0.1)
    there, here = opened(faults=LineFaults(silent=True))
    assert np.isnan(here.counts(5, RATE)).all()
    grace(10.0)
    there.faults = SOUND
    np.testing.assert_array_equal(here.counts(5, RATE), numbered(5))


def test_late_answers_are_not_taken_for_new_ones(opened: Opened, grace: Grace) -> None:
    """Asked again before the first answer came: it is older than the motion in between."""
    wait, values = threading.Event(), iter((1.0, 2.0))

    def slow(samples: int) -> Matrix:
        value = next(values)
        wait.wait(5.0)
        return np.full((samples, 4), value)

    _, here = opened(slow)
    grace(0.1)
    assert np.isnan(here.counts(3, RATE)).all()
    grace(10.0)
    wait.set()
    np.testing.assert_array_equal(here.counts(3, RATE), np.full((3, 4), 2.0))


@pytest.mark.parametrize("while_it_answers", [False, True])
def test_a_cable_that_is_pulled_is_a_fault(opened: Opened, while_it_answers: bool) -> None:
    there, here = opened(faults=LineFaults(lost=1.0) if while_it_answers else SOUND)
    pulled = threading.Timer(0.05 if while_it_answers else 0.0, there.close)
    pulled.start()
    if not while_it_answers:
        pulled.join()
    with pytest.raises(RigFault, match=r"amplifier of psd at .* is gone"):
        here.counts(100, 10.0)
    pulled.join()


def test_a_port_that_is_not_there_is_a_fault() -> None:
    with pytest.raises(RigFault, match="cannot be opened: No such file"):
        Amplifier("/dev/ttyNONE", 115200, "the PSD amplifier of psd")


def test_a_port_is_one_programs(opened: Opened) -> None:
    there, here = opened()
    with pytest.raises(RigFault, match="another program's"):
        Amplifier(there.device, 115200, "the PSD amplifier of psd")
    here.close()
    Amplifier(there.device, 115200, "the PSD amplifier of psd").close()


def test_what_does_not_say_who_it_is_is_not_asked_for_light(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_BOOT_S", 0.2)
    monkeypatch.setattr(module, "_ASK_S", 0.1)
    with AmplifierStandIn("x", numbered, LineFaults(silent=True)) as there:
        kept = []
        for _ in range(2):  # the port is free again, whatever holds the fault and its frames
            with pytest.raises(RigFault, match=r"does not identify itself: .* 9600 baud") as fault:
                Amplifier(there.device, 9600, "the PSD amplifier of psd")
            kept.append(fault.value)


def test_a_board_that_is_still_starting_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ASK_S", 0.05)
    with AmplifierStandIn("x", numbered, LineFaults(silent=True)) as there:
        awake = threading.Timer(0.15, lambda: setattr(there, "faults", SOUND))
        awake.start()
        began = time.monotonic()
        here = Amplifier(there.device, 9600, "the PSD amplifier of psd")
        assert time.monotonic() - began > 0.1
        np.testing.assert_array_equal(here.counts(4, RATE), numbered(4))
        here.close()
        awake.join()


def test_the_stand_in_gives_everything_back() -> None:
    before, threads = len(os.listdir("/dev/fd")), threading.active_count()
    for _ in range(3):
        with AmplifierStandIn("x", numbered) as there:
            Amplifier(there.device, 115200, "psd").close()
    assert (len(os.listdir("/dev/fd")), threading.active_count()) == (before, threads)


def test_without_the_extra_there_is_one_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)
    with pytest.raises(BadInput, match=r'pip install "zerobeam\[psd\]"'):
        Amplifier("/dev/ttyNONE", 115200, "psd")
