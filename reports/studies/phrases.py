"""What the views of all studies say in the same words (what they are made of: `blocks`)."""

from __future__ import annotations

from ...experiments.studies.answer import NoiseLevel, StudyAnswer
from ...words import numbers
from ...words.wording import clipped, counted, sentence, shown
from ..style.blocks import Facts, Page, Paragraph, Section, Verdict

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40


def view_of(answer: StudyAnswer, subtitle: str, sections: list[Section], *, simulated: bool = True) -> Page:
    """The whole page: verdict, notes and title are the answer's; without runs nothing was compared."""
    word = "Predicted" if not simulated else "Agrees" if answer.agrees else "Does not agree"
    return Page(
        sentence(answer.title),
        subtitle,
        Verdict("pass" if answer.agrees else "weak", word, sentence(answer.headline)),
        [sentence(note) for note in answer.notes],
        sections,
    )


# ── what every study says in the same words ───────────────────────────────────────────────────


def plan_title(name: str) -> str:
    return f"Plan {clipped(name, LONGEST_NAME)}"


def plan_in_words(words: str, shots: int, noise: str, robot: str | None = None) -> str:
    """What a plan is, its measurements, its robot (where stated) and its noise in words."""
    of = f" of {clipped(robot)}" if robot is not None else ""
    return f"{sentence(words)} ({counted(shots, 'measurement')}{of}; noise: {noise})"


def noise_in_words(noise: NoiseLevel) -> str:
    return f"joint {numbers.exact(noise.joint_deg, 'deg')}, spot {numbers.exact(noise.spot_mm, 'mm')}"


def about_study(answer: StudyAnswer, settings: list[tuple[str, str]]) -> Facts:
    """The facts of how a study was done: its name, its own settings, time and versions."""
    return Facts(
        [
            ("Study", shown(answer.study)),
            *settings,
            ("Time", f"{numbers.significant(answer.seconds, 2)}{numbers.NO_BREAK}s"),
            ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer.versions.items())),
        ]
    )


def files_block(tables: str) -> Paragraph:
    """Where every number is; `tables` names the CSV files and what they hold."""
    return Paragraph(f"study.json beside this page holds every number unrounded; {tables} as plain tables.")


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
