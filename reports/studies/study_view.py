"""What the views of all studies say in the same words (what they are made of: `blocks`)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import SimpleNamespace
from typing import Any, Protocol, cast

from ..style.blocks import Facts, Page, Paragraph, Section, Verdict
from ..words import numbers
from ..words.wording import clipped, counted, sentence, shown

Json = dict[str, Any]

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40


class StudyAnswer(Protocol):
    """What the answers of all studies have."""

    @property
    def study(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def headline(self) -> str: ...
    @property
    def agrees(self) -> bool: ...
    @property
    def seconds(self) -> float: ...
    @property
    def versions(self) -> Mapping[str, str]: ...
    @property
    def notes(self) -> Sequence[str]: ...


def view_of(
    answer: StudyAnswer | Json, subtitle: str, sections: list[Section], *, simulated: bool = True
) -> Page:
    """The whole view: verdict, notes and title are the answer's; without runs nothing was compared."""
    told = _attributes(answer)
    word = "Predicted" if not simulated else "Agrees" if told.agrees else "Does not agree"
    return Page(
        sentence(told.title),
        subtitle,
        Verdict("pass" if told.agrees else "weak", word, sentence(told.headline)),
        [sentence(note) for note in told.notes],
        sections,
    )


def _attributes(answer: StudyAnswer | Json) -> StudyAnswer:
    return cast(StudyAnswer, SimpleNamespace(**answer)) if isinstance(answer, dict) else answer


# ── what every study says in the same words ───────────────────────────────────────────────────


def plan_title(plan: Json) -> str:
    return f"Plan {clipped(plan['name'], LONGEST_NAME)}"


def plan_in_words(plan: Json, noise: Json) -> str:
    """What a plan is, its shots and its robot (where stated), and the noise by name and unit (`spot_mm`)."""
    robot = f" of {clipped(plan['robot'])}" if "robot" in plan else ""
    shots = counted(plan["shots"], "shot")
    return f"{sentence(plan['words'])} ({shots}{robot}; noise: {noise_in_words(noise)})"


def noise_in_words(noise: Json) -> str:
    return ", ".join(_noise(key, value) for key, value in noise.items())


def _noise(key: str, value: float) -> str:
    name, _, unit = key.rpartition("_")
    return f"{shown(name)} {numbers.exact(value, unit)}"


def about_study(answer: StudyAnswer | Json, settings: list[tuple[str, str]]) -> Facts:
    """The facts of how a study was done: its name, its own settings, time and versions."""
    told = _attributes(answer)
    return Facts(
        [
            ("Study", shown(told.study)),
            *settings,
            ("Time", f"{numbers.significant(told.seconds, 2)}{numbers.NO_BREAK}s"),
            ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in told.versions.items())),
        ]
    )


def files_block(tables: str) -> Paragraph:
    """Where every number is; `tables` names the CSV files and what they hold."""
    return Paragraph(f"study.json beside this page holds every number unrounded; {tables} as plain tables.")


def plans_counted(answer: Json) -> str:
    return counted(len(answer["plans"]), "plan")


def seconds(value: float | None) -> str:
    """A time to three significant digits."""
    return NOT_GIVEN if value is None else numbers.significant(value, 3, "s")


def spread(value: float | None, unit: str = "") -> str:
    """A standard deviation to two significant digits; it may be nothing at all."""
    return (
        NOT_GIVEN if value is None else numbers.spread(value, unit) if value > 0 else numbers.exact(0, unit)
    )


def spread_range(low: float | None, high: float | None, unit: str = "") -> str:
    """`low to high` of an interval whose ends lie factors apart: two significant digits each."""
    return NOT_GIVEN if low is None or high is None else f"{spread(low)} to {spread(high, unit)}"
