"""The report of a run as a page: the parts of `view` as sections of blocks (`blocks.py`), in their order."""

from __future__ import annotations

from typing import Any

from ..scenes.run_scene import scene_section
from ..style.blocks import directions_block, figure_block, legend_block, section_of, table_block, text_block
from .view import view
from .view_accuracy import accuracy_section
from .view_budget import budget_section
from .view_traceability import traceability_section

Json = dict[str, Any]


def report_page(result: Json) -> Json:
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
    return {
        "title": told["title"],
        "subtitle": told["subtitle"],
        "verdict": told["verdict"],
        "notes": told["notes"],
        "sections": [section for section in sections if section is not None],
    }


def _offsets(told: Json) -> Json:
    return section_of(
        "Offsets",
        table_block(told["offsets"]),
        legend_block(told["legend"], told["reasons"]),
        figure_block("offsets"),
    )


def _unknown(part: Json) -> Json:
    return section_of(
        "What cannot be known",
        text_block(part["sentence"]),
        directions_block(part["items"]),
        _facts(part["facts"]),
    )


def _fit(told: Json) -> Json:
    part = told["fit"]
    tables = [part["table"], part["estimates"], told["distances"], *told["others"]]
    return section_of(
        "Fit quality", *map(text_block, part["sentences"]), *(table_block(table) for table in tables if table)
    )


def _robust(part: Json | None) -> Json | None:
    if part is None:
        return None
    return section_of(
        "Robust fit",
        *map(text_block, part["sentences"]),
        table_block(part["table"]) if part["table"] else None,
    )


def _hold_out(part: Json | None) -> Json | None:
    if part is None:
        return None
    return section_of("Held-out targets", *map(text_block, part["sentences"]), _facts(part["facts"]))


def _posterior(part: Json) -> Json:
    return section_of(
        "Posterior",
        text_block(part["sentence"]),
        figure_block("posterior"),
        table_block(part["table"]) if part["table"] else None,
        _facts(part["facts"]),
    )


def _intervals(part: Json | None) -> Json | None:
    if part is None:
        return None
    return section_of("Intervals by three ways", text_block(part["sentence"]), table_block(part["table"]))


def _shots(part: Json) -> Json:
    return section_of(
        "Misses", text_block(part["sentence"]), figure_block("misses"), table_block(part["table"])
    )


def _inputs(part: Json) -> list[Json]:
    sections = [section_of("Inputs", _facts(part["facts"]))]
    if part["provenance"]:
        sections.append(section_of("Provenance", _facts(part["provenance"]), level=2))
    return [*sections, section_of("Settings of the run", _facts(part["header"]), level=2)]


def _facts(rows: list[Json]) -> Json:
    return {"kind": "facts", "it": rows}
