"""The lines between computer and PSD amplifier: ASCII, LF at the end, those of the amplifier with a checksum.

    I                → I NAME*CRC4                      who is there
    R request n      → n lines, each once its sample is taken:
                       D request i x+ x- y+ y-*CRC4     i from 0; four whole numbers, counts of the ADC

A request ends the one before it; what it does not understand the amplifier does not answer. CRC4 is the
CRC-16/IBM-3740 of all before the asterisk, in four hexadecimal digits. The computer's own lines have none:
an answer states what it belongs to.
"""

from __future__ import annotations

import binascii
import re
from dataclasses import dataclass

LONGEST = 80  # bytes of a line with its end; what is longer is noise
REQUESTS = 65536  # numbers of requests: from 0, and from 0 again
MOST_SAMPLES = 10_000  # in one request

IDENTITY = b"I\n"
_DATA = re.compile(r"D (\d{1,5}) (\d{1,5})" + r" (-?\d{1,8})" * 4)
_ASKED = re.compile(rb"R (\d{1,5}) (\d{1,5})")


@dataclass(frozen=True)
class Sample:
    """Sample `index` of a request: counts in the order x+, x-, y+, y-."""

    request: int
    index: int
    counts: tuple[int, ...]


def sealed(body: str) -> bytes:
    """A line of the amplifier."""
    checksum = binascii.crc_hqx(body.encode("ascii"), 0xFFFF)
    return f"{body}*{checksum:04X}\n".encode("ascii")


def heard(line: bytes) -> str | None:
    """What a line of the amplifier says, its end (LF, or CR LF) left out; None if it is torn or changed."""
    body, asterisk, digits = line.rstrip(b"\r\n").rpartition(b"*")
    if not asterisk or re.fullmatch(rb"[0-9A-Fa-f]{4}", digits) is None:
        return None
    if binascii.crc_hqx(body, 0xFFFF) != int(digits, 16):
        return None
    return body.decode("ascii") if body.isascii() else None


def sample_of(body: str) -> Sample | None:
    """The sample of a line; None for another line, and for one with a number too many or too few."""
    data = _DATA.fullmatch(body)
    if data is None:
        return None
    request, index, *counts = (int(number) for number in data.groups())
    return Sample(request, index, tuple(counts))


def read_sample(sample: Sample) -> str:
    """The line of a sample, without its checksum."""
    return f"D {sample.request} {sample.index} {' '.join(str(count) for count in sample.counts)}"


def asking(request: int, samples: int) -> bytes:
    """The computer's request for so many samples."""
    return f"R {request} {samples}\n".encode("ascii")


def asked(line: bytes) -> tuple[int, int] | None:
    """Request and number of samples that a line of the computer asks for; None for another line."""
    found = _ASKED.fullmatch(line.rstrip(b"\r\n"))
    return None if found is None else (int(found[1]), int(found[2]))
