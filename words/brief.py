"""The state of a calibration in one line: what a list of many says of each."""

from __future__ import annotations

from ..analysis.answer.answer_message import Grade
from ..analysis.answer.result import Result
from . import numbers
from .judgement import read_judgement
from .provenance import is_simulated
from .verdict import VERDICT_WORDS
from .wording import clipped, counted


def planned_words(measurements: int) -> str:
    """Of a plan without a run."""
    return f"planned: {counted(measurements, 'measurement')}"


def recorded_words(recorded: int, of: int | None, *, under_way: bool) -> str:
    """Of a run without a result; `of` is the number that its plan has, None where that is not known."""
    if under_way and of is not None:
        return f"measured {recorded} of {of}"
    return f"measured: {counted(recorded, 'measurement')}"


def due_words(date: str, reason: str, *, overdue: bool) -> str:
    """Of the next calibration of an arm; `reason` where it is due already."""
    text = f"Calibration due since {date}" if overdue else f"Next calibration due on {date}"
    return f"{text}: {reason}" if reason else text


def result_words(result: Result) -> str:
    """The verdict's word, and how well the least well determined offset is known."""
    word = VERDICT_WORDS[result.verdict]
    if simulated(result):
        word = f"Simulated: {word.lower()}"
    if result.verdict == "pass" and read_judgement(result).against:
        return f"{word} of this run alone: enter nothing"
    if result.verdict == "misfit":
        return f"{word}: the model does not describe the measurements"
    worst = None if result.message is None else result.message.worst
    if worst is None:
        return word
    name = _short(worst.name)
    if worst.value is None:
        return f"{word}: {name} is not determined"
    return f"{word}: U ≤ {numbers.spread(worst.value, numbers.unit_of(worst.unit))} ({name})"


def result_tone(result: Result) -> Grade:
    """How it is coloured."""
    return read_judgement(result).grade


def simulated(result: Result) -> bool:
    """Whether no robot was measured."""
    return is_simulated(result.inputs.provenance)


def _short(offset: str) -> str:
    return f"J{number}" if (number := offset.removeprefix("delta")).isdecimal() else clipped(offset)
