"""Lines of a PSD amplifier: what was sent is read, and nothing else."""

from __future__ import annotations

import pytest

from zerobeam.experiments.sensors.amplifier import (
    LONGEST,
    PsdSample,
    parse_request,
    parse_sample,
    request_line,
    sample_line,
    verified_body,
    with_checksum,
)

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
