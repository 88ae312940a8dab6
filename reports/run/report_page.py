"""The report of a run as a page: the parts of `view` as sections of blocks (`blocks.py`), in their order."""

from __future__ import annotations

from typing import Any

from ..style.blocks import FigureBlock, Legend, Page, Paragraph, Section, section_of
from .run_scene import scene_section
from .view import view
from .view_accuracy import accuracy_section
from .view_budget import budget_section
from .view_traceability import traceability_section

Json = dict[str, Any]


def report_page(result: Json) -> Page:
    """All that a report shows, from the dict of a `result.json`."""
    told = view(result)
    sections = [
        _offsets(told),
        _unknown(told["unknown"]),
        scene_section(result),
        accuracy_section(result),
        budget_section(result),
        _fit(told),
        _robust(told["robust"]),
        _hold_out(told["hold_out"]),
        _posterior(told["posterior"]),
        _intervals(told["intervals"]),
        _shots(told["shots"]),
        *_inputs(told["inputs"]),
        traceability_section(result),
    ]
    return Page(
        told["title"],
        told["subtitle"],
        told["verdict"],
        told["notes"],
        [section for section in sections if section is not None],
    )


def _offsets(told: Json) -> Section:
    return section_of(
        "Offsets",
        told["offsets"],
        Legend(told["legend"], told["reasons"]),
        FigureBlock("offsets"),
    )


def _unknown(part: Json) -> Section:
    return section_of(
        "What cannot be known",
        Paragraph(part["sentence"]),
        part["directions"],
        part["facts"],
    )


def _fit(told: Json) -> Section:
    part = told["fit"]
    tables = [part["table"], part["estimates"], told["distances"], *told["others"]]
    return section_of("Fit quality", *map(Paragraph, part["sentences"]), *tables)


def _robust(part: Json | None) -> Section | None:
    if part is None:
        return None
    return section_of(
        "Robust fit",
        *map(Paragraph, part["sentences"]),
        part["table"],
    )


def _hold_out(part: Json | None) -> Section | None:
    if part is None:
        return None
    return section_of("Held-out targets", *map(Paragraph, part["sentences"]), part["facts"])


def _posterior(part: Json) -> Section:
    return section_of(
        "Posterior",
        Paragraph(part["sentence"]),
        FigureBlock("posterior"),
        part["table"],
        part["facts"],
    )


def _intervals(part: Json | None) -> Section | None:
    if part is None:
        return None
    return section_of("Intervals by three ways", Paragraph(part["sentence"]), part["table"])


def _shots(part: Json) -> Section:
    return section_of("Misses", Paragraph(part["sentence"]), FigureBlock("misses"), part["table"])


def _inputs(part: Json) -> list[Section]:
    sections = [section_of("Inputs", part["facts"])]
    if part["provenance"].rows:
        sections.append(section_of("Provenance", part["provenance"], level=2))
    return [*sections, section_of("Settings of the run", part["header"], level=2)]
