"""Programs and data files damaged at random, and what must hold of their readers whatever the damage."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from zerobeam.experiments.makers.line_language import LineLanguage
from zerobeam.experiments.makers.line_programs import for_correction
from zerobeam.experiments.makers.maker import makers
from zerobeam.experiments.makers.program_parts import JointTarget, ProgramFacts, Source
from zerobeam.experiments.makers.recordings import ImportJob
from zerobeam.model.errors import BadInput
from zerobeam.model.files.plan import Plan
from zerobeam.model.kinematics.robot import Robot

_SIGNS = "0123456789.-+ ,;:()[]{}<>\"'=#/&abEJPxyz\t\n"


def damaged(text: str, count: int, seed: int) -> Iterator[tuple[str, str]]:
    """Texts, each with one damage, and the line that a changed byte is in ("" of other damage)."""
    rng = random.Random(seed)
    for i in range(count):
        lines = text.splitlines(keepends=True)
        if i % 4 == 0:
            yield text[: rng.randrange(len(text))], ""
        elif i % 4 == 1:
            at = rng.randrange(len(text))
            start, end = text.rfind("\n", 0, at) + 1, text.find("\n", at)
            yield text[:at] + rng.choice(_SIGNS) + text[at + 1 :], text[start : end if end >= 0 else None]
        elif i % 4 == 2:
            one, two = rng.randrange(len(lines)), rng.randrange(len(lines))
            lines[one], lines[two] = lines[two], lines[one]
            yield "".join(lines), ""
        else:
            numbers = list(re.finditer(r"-?\d+\.\d+", text))
            lost = rng.choice(numbers)
            yield text[: lost.start()] + text[lost.end() :], ""


def refused_or_same(
    text: str, count: int, seed: int, read: Callable[[str], Mapping[Any, Any]], name: Callable[[Any], str]
) -> int:
    """How many of the damaged texts are refused. Of the others every position is that of the whole text; one
    whose `name`, a pattern, is in a line with a changed byte may be another."""
    whole, refused = read(text), 0
    for spoilt, line in damaged(text, count, seed):
        try:
            positions = read(spoilt)
        except BadInput:
            refused += 1
            continue
        for key, value in positions.items():
            if not (line and re.search(name(key), line)):
                assert whole.get(key) == value, (key, line)
    return refused


def imported(reader_name: str, plan: Plan, file: Path) -> Callable[[str], dict[int, Any]]:
    """A reader of recordings of a plan: joints by the number of the posture, degrees."""
    reader = next(each for maker in makers() for each in maker.read if each.name == reader_name)

    def read(text: str) -> dict[int, Any]:
        file.write_text(text)
        run = reader.read(ImportJob.begin([file], plan, file.with_name("run.jsonl")))
        return {shot.shot: shot.joints_deg for shot in run.shots}

    return read


def recorded(text: str, position: str) -> str:
    """A plan's program with other values, by 0.05, where the pattern `position` ends: before a recorded
    number."""
    return re.sub(rf"({position})(-?\d+\.\d+)", lambda match: f"{match[1]}{float(match[2]) + 0.05:.4f}", text)


def positions_of(language: LineLanguage, robot: Robot) -> Callable[[str], dict[str, Any]]:
    """A reader of programs, as far as the arm need not be solved: joints and poses of targets by name."""
    whole = for_correction(language)

    def read(text: str) -> dict[str, Any]:
        parsed = whole.targets(Source(text, robot, ProgramFacts()))
        spans = {(span.start, span.end) for span in parsed.literals}
        if parsed.problems or spans != set(whole.literals(text)):
            raise BadInput("this is refused")
        return {
            name: (
                target.joints.tolist()
                if isinstance(target, JointTarget)
                else np.round(target.frame @ target.pose @ np.linalg.inv(target.tool), 6).tolist()
            )
            for name, target in parsed.targets.items()
        }

    return read
