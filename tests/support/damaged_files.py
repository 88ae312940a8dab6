"""Damaged text files. Their readers must refuse them plainly, or read the positions that are there."""

import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.experiments.makers.import_jobs import ImportJob
from zerobeam.experiments.makers.maker import makers
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan


def damaged(text: str, count: int, seed: int = 0) -> Iterator[str]:
    """So many damaged copies of a text, each damaged in one way: cut off, bytes changed, lines swapped, a
    number lost. Those that are as before are left out."""
    rng = np.random.default_rng(seed)
    numbers = [match.span() for match in re.finditer(r"[-+]?\d+(?:\.\d+)?", text)]
    lines = text.split("\n")
    made = 0
    while made < count:
        kind = made % 4
        if kind == 0:
            other = text[: rng.integers(1, len(text))]
        elif kind == 1:
            letters = list(text)
            for at in rng.integers(0, len(text), rng.integers(1, 4)):
                letters[at] = chr(rng.integers(32, 127))
            other = "".join(letters)
        elif kind == 2:
            first, second = rng.integers(0, len(lines), 2)
            swapped = list(lines)
            swapped[first], swapped[second] = swapped[second], swapped[first]
            other = "\n".join(swapped)
        else:
            start, end = numbers[rng.integers(len(numbers))]
            other = text[:start] + text[end:]
        if other != text:
            made += 1
            yield other


def refused(
    read: Callable[[str], Mapping[Any, Any]], text: str, lines: Mapping[Any, str], count: int, seed: int = 0
) -> int:
    """How many of so many damaged copies are refused.

    `lines` are those of the positions, by what `read` calls them: in a copy that is read, a position whose
    line is as it was has the value that it had, and there is no other posture. A posture without a value is
    one that the whole file does not measure.
    """
    whole, refusals = read(text), 0
    assert whole.keys() <= lines.keys()
    assert all(text.count(lines[key]) == 1 for key in whole)
    for copy in damaged(text, count, seed):
        try:
            positions = read(copy)
        except BadInput:
            refusals += 1
            continue
        for key, value in positions.items():
            same = value == whole[key] if key in whole else isinstance(key, str)
            assert same or lines.get(key, "") not in copy, (key, copy)
    return refusals


def lines_of(text: str, position: str) -> dict[str, str]:
    """The lines of a program that begin with a name, the group of the pattern `position`, by the name."""
    matches = re.finditer(rf"^[ \t]*{position}[^\n]*", text, re.MULTILINE)
    return {match[1]: match[0] for match in matches}


def joints_read(reader_name: str, plan: Plan, path: Path) -> Callable[[str], dict[int, tuple[float, ...]]]:
    """A maker's reader of recordings of a plan: joints, degrees, by the number of the posture."""
    reader = next(each for maker in makers() for each in maker.read if each.name == reader_name)

    def read(text: str) -> dict[int, tuple[float, ...]]:
        path.write_bytes(text.encode())
        run = reader.read(ImportJob.begin([path], plan, path.with_name("run.jsonl")))
        return {shot.shot: tuple(shot.joints_deg) for shot in run.shots}

    return read


def recorded(text: str, position: str) -> str:
    """A plan's program with other values, by 0.05, where the pattern `position` ends: before a recorded
    number."""
    return re.sub(rf"({position})(-?\d+\.\d+)", lambda match: f"{match[1]}{float(match[2]) + 0.05:.4f}", text)
