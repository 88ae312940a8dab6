"""What the views of all studies are made of, so that one template shows them all.

A view is {title, subtitle, verdict {key, word, sentence}, notes [text], sections}, all display strings.
A section is {title, level, new_page, lead, blocks}: level 1, or 2 below one of level 1; `lead` stays on
one page with the heading, `blocks` follow it. A block is {kind, it}, and `it` by its kind:

    text    a paragraph
    facts   rows of a name and a text, as `view.facts_of` makes them
    legend  {legend [{status, word, text}], reasons [{status, names, text}]}
    table   as `view.table_of` makes them
    figure  the name of a picture; nothing is shown where there is no such picture
"""

from __future__ import annotations

from typing import Any

from . import numbers
from .view import counted, facts_of
from .wording import clipped, sentence, shown

Json = dict[str, Any]

NOT_DETERMINED = "not determined"
NOT_GIVEN = "not given"
LONGEST_NAME = 40


def view_of(answer: Json, subtitle: str, sections: list[Json]) -> Json:
    """The whole view: verdict, notes and title are the answer's, the rest is told."""
    agrees = answer["agrees"]
    return {
        "title": sentence(answer["title"]),
        "subtitle": subtitle,
        "verdict": {
            "key": "pass" if agrees else "weak",
            "word": "Agrees" if agrees else "Does not agree",
            "sentence": sentence(answer["headline"]),
        },
        "notes": [sentence(note) for note in answer["notes"]],
        "sections": sections,
    }


def section_of(title: str, *blocks: Json | None, level: int = 1, new_page: bool = False) -> Json:
    """A section; None is left out. What leads up to its first figure stays with it, unless a table does."""
    found = [block for block in blocks if block is not None]
    kinds = [block["kind"] for block in found]
    end = kinds.index("figure") + 1 if "figure" in kinds else 0
    if "table" in kinds[:end]:
        end = 0
    return {
        "title": title,
        "level": level,
        "new_page": new_page,
        "lead": found[:end],
        "blocks": found[end:],
    }


def text_block(text: str) -> Json:
    return {"kind": "text", "it": text}


def facts_block(rows: list[tuple[str, str]]) -> Json:
    return {"kind": "facts", "it": facts_of(rows)}


def legend_block(legend: list[Json], reasons: list[Json]) -> Json:
    return {"kind": "legend", "it": {"legend": legend, "reasons": reasons}}


def table_block(table: Json) -> Json:
    return {"kind": "table", "it": table}


def figure_block(name: str) -> Json:
    return {"kind": "figure", "it": name}


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


def about_study(answer: Json, settings: list[tuple[str, str]]) -> Json:
    """The facts of how a study was done: its name, its own settings, time and versions."""
    return facts_block(
        [
            ("Study", shown(answer["study"])),
            *settings,
            ("Time", f"{numbers.significant(answer['seconds'], 2)}{numbers.NO_BREAK}s"),
            ("Versions", ", ".join(f"{shown(name)} {shown(at)}" for name, at in answer["versions"].items())),
        ]
    )


def files_block(tables: str) -> Json:
    """Where every number is; `tables` names the CSV files and what they hold."""
    return text_block(f"study.json beside this page holds every number unrounded; {tables} as plain tables.")


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
