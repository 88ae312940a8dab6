"""What the views of all studies say in the same words (what they are made of: `blocks`)."""

from __future__ import annotations

from typing import Any

from ..style.blocks import Facts, Page, Paragraph, Section, Verdict
from ..words import numbers
from ..words.wording import clipped, counted, sentence, shown

Json = dict[str, Any]

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40


def verdict_word(answer: Json) -> str:
    """Whether the runs agree; without runs nothing was held against anything."""
    if answer["settings"].get("runs") == 0:
        return "Predicted"
    return "Agrees" if answer["agrees"] else "Does not agree"


def view_of(answer: Json, subtitle: str, sections: list[Section]) -> Page:
    """The whole view: verdict, notes and title are the answer's, the rest is told."""
    return Page(
        sentence(answer["title"]),
        subtitle,
        Verdict("pass" if answer["agrees"] else "weak", verdict_word(answer), sentence(answer["headline"])),
        [sentence(note) for note in answer["notes"]],
        sections,
    )


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


def about_study(answer: Json, settings: list[tuple[str, str]]) -> Facts:
    """The facts of how a study was done: its name, its own settings, time and versions."""
    return Facts(
        [
            ("Study", shown(answer["study"])),
            *settings,
            ("Time", f"{numbers.significant(answer['seconds'], 2)}{numbers.NO_BREAK}s"),
            ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer["versions"].items())),
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
