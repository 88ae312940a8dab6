"""What all pages are made of: tables, facts, and sections of blocks, so that one template shows them all.

A table is {caption, columns [{text, align}], rows [{tone, cells [{text, span, mark}]}]}: `tone` is the status
that colours a row, `mark` the status whose shape stands in a cell.

A page is {title, subtitle, verdict {key, word, sentence}, notes [text], sections}, all display strings.
A section is {title, level, new_page, lead, blocks}: level 1, or 2 below one of level 1; `lead` stays on
one page with the heading, `blocks` follow it. A block is {kind, it}, and `it` by its kind:

    text        a paragraph
    facts       rows of a name and a text, as `facts_of` makes them
    legend      {legend [{status, word, text}], reasons [{status, names, text}]}
    table       as `table_of` makes them
    figure      the name of a picture; nothing is shown where there is no such picture
    scene       the turnable picture stands here (`run_scene.py`), if the page has one
    directions  [{combination, kind, reason, remedy}] that the data do not tell
"""

from __future__ import annotations

from typing import Any

from ..words.numbers import NO_BREAK

Json = dict[str, Any]


def cell_of(text: str, span: int = 1, mark: str = "") -> Json:
    return {"text": text, "span": span, "mark": mark}


def table_of(caption: str, columns: list[tuple[str, str]], rows: list[Json]) -> Json:
    heads = [{"text": text, "align": align} for text, align in columns]
    return {"caption": caption, "columns": heads, "rows": rows}


def row_of(*cells: str | Json, tone: str = "") -> Json:
    return {"tone": tone, "cells": [cell if isinstance(cell, dict) else cell_of(cell) for cell in cells]}


def facts_of(rows: list[tuple[str, str]]) -> list[Json]:
    return [{"name": name, "text": text} for name, text in rows]


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
    """A paragraph; a percent sign does not part from its number."""
    return {"kind": "text", "it": text.replace(" %", f"{NO_BREAK}%")}


def facts_block(rows: list[tuple[str, str]]) -> Json:
    return {"kind": "facts", "it": facts_of(rows)}


def legend_block(legend: list[Json], reasons: list[Json]) -> Json:
    return {"kind": "legend", "it": {"legend": legend, "reasons": reasons}}


def table_block(table: Json) -> Json:
    return {"kind": "table", "it": table}


def figure_block(name: str) -> Json:
    return {"kind": "figure", "it": name}


def directions_block(items: list[Json]) -> Json:
    return {"kind": "directions", "it": items}
