"""Studies that sweep settings: predicted and observed errors of the offsets in every case of a grid.

One view serves them all, people's own included: what is shown follows from the axes, not from the name.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from ..style.blocks import (
    Cell,
    Facts,
    FigureBlock,
    Legend,
    LegendEntry,
    Page,
    Paragraph,
    Reason,
    Row,
    Section,
    Table,
    row_of,
    section_of,
    table_of,
)
from ..words import numbers
from ..words.wording import clipped, counted, label, listed, sentence, shown
from .study_shares import BY_CHANCE, percent, share_cell
from .study_view import LONGEST_NAME, NOT_DETERMINED, NOT_GIVEN, about_study, files_block, view_of
from .sweep_cases import (
    STANDING,
    case_name,
    figure_names,
    has_observed,
    in_degrees,
    is_numeric,
    is_told,
    is_varied,
    observed,
    predicted,
    standing,
    tolerance,
    unit_of,
    untold,
    value_text,
    worst,
)

Json = dict[str, Any]

MOST_ROWS = 60
_LONGEST_TEXT = 400
_MOST_REASONS = 8
_FITS = {
    "likelihood": ("runs", "rmse", "bias", "bias_std", "held", "held_low", "held_high", "agrees"),
    "midpoint": ("runs", "rmse", "bias", "bias_std"),
}


def sweep_view(answer: Json) -> Page:
    """The display strings of a sweep."""
    over = listed([clipped(axis["label"]) for axis in answer["axes"]]) if answer["axes"] else "nothing"
    settings = answer["settings"]
    sections = [
        section_of(
            f"Cases by {over}",
            *map(FigureBlock, figure_names(answer)),
            _summary(answer),
            Legend(_meanings(answer), _without_plan(answer)),
        ),
        section_of("Each offset", Paragraph(_how_to_read(answer)), *_offsets(answer)),
        section_of(
            "How it was done",
            about_study(
                answer, [row for key, value in settings.items() for row in _setting(answer, value, str(key))]
            ),
            files_block("cases.csv and offsets.csv hold every case and every offset of it"),
        ),
        *_words(answer),
    ]
    seed = f", seed {shown(str(settings['seed']))}" if "seed" in settings else ""
    return view_of(answer, f"{counted(len(answer['cases']), 'case')} by {over}{seed}", sections)


# ── tables ────────────────────────────────────────────────────────────────────────────────────


def _summary(answer: Json) -> Table:
    axes = list(enumerate(answer["axes"]))
    simulated = has_observed(answer, "likelihood")
    failed = any(case["failed"] for case in answer["cases"])
    shots = {case["shots"] for case in answer["cases"]} - {None}
    counts = len(shots) > 1 and not any(axis["key"] == "plan.shots" for _, axis in axes)
    columns = [
        *((clipped(axis["label"]), "right" if i and is_numeric(axis) else "left") for i, axis in axes),
        ("verdict", "left"),
        *([("shots", "right")] if counts else []),
        ("worst offset, std", "right"),
        *([("runs agree", "left")] if simulated else []),
        *([("runs failed", "right")] if failed else []),
    ]
    rows = []
    for case in answer["cases"][:MOST_ROWS]:
        mark, words = standing(case)
        rows.append(
            row_of(
                *(value_text(axis, case["at"][i]) for i, axis in axes),
                Cell(words, mark=mark),
                *([str(case["shots"]) if case["shots"] is not None else ""] if counts else []),
                _worst(case),
                *([_agreement(case)] if simulated else []),
                *([str(case["failed"])] if failed else []),
            )
        )
    plans = f"plan of {counted(shots.pop(), 'shot')}" if len(shots) == 1 else "plan"
    caption = f"Verdict of each {plans}, and the predicted std of its least certain offset"
    caption += "; whether simulated runs agree with what is predicted" if simulated else ""
    return table_of(_cut(caption, len(rows), len(answer["cases"])), columns, rows)


def _worst(case: Json) -> str:
    if case["reason"] is not None:
        return ""
    row = worst(case)
    if row is None and (names := untold(case)):
        # Short enough for a column of the terminal.
        return f"{listed(names) if len(names) < 3 else counted(len(names), 'offset')}: {NOT_DETERMINED}"
    return f"{label(row['name'], 12)}: {_std(row)}" if row is not None else NOT_DETERMINED


def _agreement(case: Json) -> Cell:
    """Whether the simulated runs agree with the prediction of every offset."""
    told = [entry["agrees"] for row in case["parameters"] if (entry := observed(row, "likelihood"))]
    if not told:
        return Cell("" if case["reason"] is not None else "none")
    return Cell("yes", mark="identified") if all(told) else Cell("no", mark="weak")


def _offsets(answer: Json) -> list[Table]:
    """The table of predicted and observed errors by case; empty where no case has a plan."""
    columns: list[tuple[str, str]] = [("offset", "left"), ("status", "left"), ("predicted std", "right")]
    likelihood, midpoint = (has_observed(answer, fit) for fit in _FITS)
    if likelihood:
        columns += [("rmse", "right"), ("bias", "right"), (f"within {percent(_level(answer))}", "left")]
    if midpoint:
        columns.append(("midpoint rmse", "right"))
    cases = [(i, case) for i, case in enumerate(answer["cases"], start=1) if case["reason"] is None]
    rows: list[Row] = []
    count = 0
    for number, case in cases:
        told = [_group(answer, case, number, len(columns) - 1)]
        told += [_offset(row, columns) for row in case["parameters"]]
        if count and len(rows) + len(told) > MOST_ROWS:
            break
        rows += told
        count += 1
    caption = "Predicted std of each offset"
    caption += ", next to the errors of simulated runs" if likelihood else ""
    table = table_of(_cut(caption, count, len(cases), "offsets.csv"), columns, rows)
    return [table] if rows else []


def _group(answer: Json, case: Json, number: int, span: int) -> Row:
    mark, words = standing(case)
    shots = f", {counted(case['shots'], 'shot')}" if case["shots"] is not None else ""
    about = Cell(f"{case_name(answer, case)}: {words}{shots}", span=span)
    return row_of(f"case {number}", about, tone=mark)


def _offset(row: Json, columns: list[tuple[str, str]]) -> Row:
    name = label(row["name"])
    if not is_told(row):
        words = NOT_DETERMINED if row["status"] == "unidentifiable" else "held"
        return row_of(name, Cell(words, span=len(columns) - 1), tone=row["status"])
    heads = {text for text, _ in columns}
    unit, likelihood, midpoint = unit_of(row), observed(row, "likelihood"), observed(row, "midpoint")
    cells: list[str | Cell] = [Cell(row["status"], mark=row["status"]), _std(row, likelihood)]
    if "rmse" in heads:
        if likelihood is None:
            cells += [NOT_GIVEN] * 3
        else:
            bias_std = likelihood["bias_std"]
            cells += [
                _rmse(likelihood, unit),
                numbers.estimate(likelihood["bias"], bias_std, unit) if bias_std else NOT_GIVEN,
                _held(likelihood),
            ]
    if "midpoint rmse" in heads:
        cells.append(NOT_GIVEN if midpoint is None else _rmse(midpoint, unit))
    return row_of(name, *cells)


def _std(row: Json, beside: Json | None = None) -> str:
    """A predicted std: two digits, or as many as the rmse of the runs beside it."""
    std, unit = predicted(row), unit_of(row)
    if not std:
        return NOT_GIVEN
    return numbers.spread(std, unit) if beside is None else numbers.estimate(std, _about(beside), unit)


def _rmse(entry: Json, unit: str) -> str:
    return numbers.estimate(entry["rmse"], _about(entry), unit)


def _about(entry: Json) -> float:
    """The standard error of an rmse of n runs: the relative one is 1/√(2n)."""
    return float(entry["rmse"]) / math.sqrt(2 * entry["runs"])


def _held(entry: Json) -> Cell:
    told = {"share": entry["held"], "low": entry["held_low"], "high": entry["held_high"]}
    cell = share_cell(told | {"of": entry["runs"], "agrees": True}, control=False)
    return replace(cell, mark="identified" if entry["agrees"] else "weak")


def _level(answer: Json) -> float:
    return float(answer["settings"]["level"])


def _cut(caption: str, count: int, total: int, file: str = "cases.csv") -> str:
    """A caption that says how many of the cases are shown."""
    return caption if count == total else f"{caption} ({count} of {total} cases shown, all in {file})"


# ── words ─────────────────────────────────────────────────────────────────────────────────────


def _how_to_read(answer: Json) -> str:
    told = "The predicted std is what the fit of one run would state."
    if not has_observed(answer, "likelihood"):
        return f"{told} No runs were simulated."
    return (
        f"{told} rmse and bias are those of fits to simulated runs, the share that of their"
        f" {percent(_level(answer))} intervals that hold the truth, with its 95 % binomial interval;"
        " a diamond beside it says that share or scatter contradict the prediction."
        f" {BY_CHANCE}{_unmet(answer)}"
    )


def _unmet(answer: Json) -> str:
    count = sum(case["unmet"] for case in answer["cases"])
    return f" {counted(count, 'more arm')} that cannot hit the target had been drawn." if count else ""


def _meanings(answer: Json) -> list[LegendEntry]:
    told = {
        tolerance(answer, row) for case in answer["cases"] for row in case["parameters"] if in_degrees(row)
    }
    at = told.pop() if len(told) == 1 else None
    within = f"the tolerance of {numbers.exact(at, 'deg')}" if at is not None else "its tolerance"
    texts = {
        "pass": f"every offset has a predicted std within {within}",
        "weak": f"every offset is determined, but one or more not to within {within}",
        "degenerate": "one or more offsets are not determined: such shots say less of them than was known",
        None: "there is no such plan, for the reason below",
    }
    present = {standing(case) for case in answer["cases"]}
    return [LegendEntry(*STANDING[key], text) for key, text in texts.items() if STANDING[key] in present]


def _without_plan(answer: Json) -> list[Reason]:
    """Each reason why there is no plan, with the cases that it holds for."""
    by_reason: dict[str, list[str]] = {}
    for case in answer["cases"]:
        if case["reason"] is not None:
            by_reason.setdefault(sentence(case["reason"]).rstrip("."), []).append(case_name(answer, case))
    told = [
        Reason(f"No plan for {'; '.join(names[:4])}{_more(len(names) - 4)}:", "held", reason + ".")
        for reason, names in list(by_reason.items())[:_MOST_REASONS]
    ]
    if len(by_reason) > len(told):
        text = f"{len(told)} of {len(by_reason)} shown, all in cases.csv."
        told.append(Reason("Reasons:", "held", text))
    return told


def _more(count: int) -> str:
    return f"; and {count} more" if count > 0 else ""


def _setting(answer: Json, value: object, path: str) -> list[tuple[str, str]]:
    """A setting as rows, `tolerance.offset_deg` → 0.1: nested ones one by one."""
    if isinstance(value, dict):
        return [row for key, item in value.items() for row in _setting(answer, item, f"{path}.{key}")]
    if is_varied(answer, path):
        text = "changes from case to case"
    elif isinstance(value, list) and not any(isinstance(item, dict | list) for item in value):
        text = ", ".join(map(_plain, value))
    else:
        text = _plain(value)
    return [(clipped(path, LONGEST_NAME), clipped(text, _LONGEST_TEXT))]


def _plain(value: object) -> str:
    if isinstance(value, bool) or value is None:
        return {True: "yes", False: "no", None: "none"}[value]
    if isinstance(value, int | float):
        return numbers.exact(value)
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _words(answer: Json) -> list[Section]:
    """What each case is, in words, where they say more than the axes do: on no grid of numbers."""
    cases = answer["cases"]
    if len(cases) > MOST_ROWS or all(map(is_numeric, answer["axes"])):
        return []
    rows = [(case_name(answer, case), sentence(case["words"])) for case in cases]
    return [section_of("Cases", Facts(rows), level=2)]


# ── plain tables ──────────────────────────────────────────────────────────────────────────────


def case_rows(answer: Json) -> Iterator[Json]:
    """One row for each case; no std where it cannot tell some offset."""
    for number, case in enumerate(answer["cases"], start=1):
        least = worst(case)
        yield {
            **_place(answer, number, case),
            **{key: case[key] for key in ("words", "verdict", "reason", "shots", "failed", "unmet")},
            "worst_offset": least["name"] if least is not None else None,
            "worst_std": case["worst_std"] if least is not None else None,
            "not_determined": " ".join(
                row["name"] for row in case["parameters"] if row["status"] == "unidentifiable"
            ),
        }


def offset_rows(answer: Json) -> Iterator[Json]:
    """One row for each case and parameter; nothing but names where the case cannot tell it."""
    for number, case in enumerate(answer["cases"], start=1):
        for row in case["parameters"]:
            yield {
                **_place(answer, number, case),
                "parameter": row["name"],
                **{key: row[key] for key in ("unit", "status")},
                "std": predicted(row),
                **{
                    f"{fit}_{key}": (observed(row, fit) or {}).get(key)
                    for fit, keys in _FITS.items()
                    for key in keys
                },
            }


def _place(answer: Json, number: int, case: Json) -> Json:
    """Columns that say which case it is; axes are numbered, so that no key hides another column."""
    at = zip(answer["axes"], case["at"], strict=True)
    named = enumerate(at, start=1)
    return {
        "case": number,
        **{f"axis{k}_{shown(axis['key'])}": axis["values"][i] for k, (axis, i) in named},
    }


TABLES: dict[str, Callable[[Json], Iterator[Json]]] = {"cases.csv": case_rows, "offsets.csv": offset_rows}
