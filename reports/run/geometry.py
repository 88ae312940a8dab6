"""The section on the arm's geometry: what the tolerances do to the offsets, the links, the model ladder."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...analysis.observability.check import Check
from ...words import numbers
from ...words.geometry import (
    RUNGS,
    SET_BY_TOLERANCES,
    confounded_sentence,
    correlation,
    factors_sentence,
    percent,
    rung_reason,
    worth_sentence,
)
from ...words.wording import counted, label, listed, person
from ..style.blocks import FigureBlock, Legend, Paragraph, Section, Table, row_of, section_of, table_of
from .parameters import NO_NUMBER, reasons, unit_of

if TYPE_CHECKING:
    from ...analysis.answer.result import Result
    from ...analysis.solution import ParameterResult

LADDER = "ladder"
_MOST_SAID = 2  # sentences on what an offset is confounded with; the table has all


def geometry_section(result: Result) -> Section | None:
    """None where the header states no geometry, or where there is no answer."""
    if not result.geometry.stated or not result.likelihood.converged:
        return None
    rows = [row for row in result.parameters if row.group == "geometry"]
    held = [row for row in rows if row.held]
    said = [
        *confounded_lines(result)[:_MOST_SAID],
        factors_sentence(result.geometry),
    ]
    unknown = prior_only(rows)
    return section_of(
        "Geometry",
        *(Paragraph(text) for text in said if text),
        _offsets(result),
        _links(rows),
        None if unknown is None else Paragraph(unknown),
        Legend([], reasons(held)) if held else None,
        ladder_table(result),
        FigureBlock(LADDER),
    )


def confounded_lines(result: Result) -> list[str]:
    """Of each offset of which the tolerances set most of the variance, why; of a misfit nothing."""
    if result.misfit is not None:
        return []
    offsets = [row for row in result.parameters if row.group == "offset" and row.std is not None]
    said = (
        confounded_sentence(result.geometry, row.name, row.tolerance_share, person)
        for row in sorted(offsets, key=lambda row: -(row.std or 0.0))
    )
    return [text for text in said if text]


def _offsets(result: Result) -> Table | None:
    """What the tolerances do to each offset."""
    own = result.geometry
    if result.misfit is not None or not any(value is not None for value in own.at_half.values()):
        return None
    columns = [
        ("name", "left"),
        ("u", "right"),
        (SET_BY_TOLERANCES, "right"),
        ("at half", "right"),
        ("at twice", "right"),
        ("nominal", "right"),
        ("most correlated with", "left"),
    ]
    rows = []
    for row in result.parameters:
        if row.group != "offset" or row.std is None or row.tolerance_share is None:
            continue
        rivals = [rival for rival in own.confounded if rival.offset == row.name]
        most = max(rivals, key=lambda rival: abs(rival.correlation), default=None)
        others = (own.at_half, own.at_twice, own.consider)
        rows.append(
            row_of(
                label(row.name),
                numbers.spread(row.std, row.unit),
                percent(row.tolerance_share),
                *(_spread(values.get(row.name), row.unit) for values in others),
                "" if most is None else f"{label(most.parameter)} ({correlation(most)})",
            )
        )
    caption = (
        "u of the offsets, at half and at twice the tolerances, and with nominal geometry if the arm deviates"
    )
    return table_of(caption, columns, rows)


def _spread(value: float | None, unit: str) -> str:
    return NO_NUMBER if value is None else numbers.spread(value, unit)


def _links(rows: Sequence[ParameterResult]) -> Table | None:
    """The parameters that the measurements determine, as deviations from nominal."""
    columns = [
        ("name", "left"),
        ("estimate", "right"),
        ("u", "right"),
        ("tolerance", "right"),
        ("reduced by", "right"),
    ]
    shown = [
        row_of(
            label(row.name),
            numbers.estimate(row.estimate, row.std, unit_of(row.unit)),
            numbers.spread(row.std, unit_of(row.unit)),
            numbers.significant(row.prior_std, 2, unit_of(row.unit)),
            percent(max(1 - row.std / row.prior_std, 0.0)),
            tone=row.status if row.status == "unvalidated" else "",
        )
        for row in rows
        if row.estimate is not None and row.std is not None
    ]
    unvalidated = any(row.status == "unvalidated" for row in rows)
    caption = "Deviations from nominal geometry that the measurements determine" + (
        ", unvalidated: the model does not describe the measurements" if unvalidated else ""
    )
    return table_of(caption, columns, shown) if shown else None


def prior_only(rows: Sequence[ParameterResult]) -> str | None:
    """The parameters of which the measurements say nothing: by link or joint, without a number."""
    by_body: dict[str, list[str]] = {}
    for row in rows:
        if row.estimate is None:
            body, _, axis = label(row.name).partition(", ")
            by_body.setdefault(axis if body.startswith("J") else body, []).append(
                body if body.startswith("J") else axis
            )
    if not by_body:
        return None
    said = listed([f"{body} ({', '.join(axes)})" for body, axes in by_body.items()], 99)
    count = sum(map(len, by_body.values()))
    return (
        f"Prior only, without an estimate: {counted(count, 'geometry parameter')} of which these measurements"
        f" say no more than the tolerances: {said}."
    )


def ladder_table(result: Result) -> Table | None:
    """The models that were tried, from nominal geometry on."""
    ladder = result.geometry.ladder
    if not ladder:
        return None
    columns = [
        ("model", "left"),
        ("parameters", "right"),
        ("held-out, rms", "right"),
        ("log evidence", "right"),
        ("kept", "left"),
    ]
    rows = [
        row_of(
            RUNGS[rung.rung],
            str(rung.parameters),
            numbers.or_words(rung.held_out_rms_mm, NO_NUMBER, "mm"),
            numbers.fixed(rung.log_evidence, 1),
            f"{'yes' if rung.kept else 'no'}: {rung_reason(ladder, i)}",
        )
        for i, rung in enumerate(ladder)
    ]
    return table_of("Model ladder: residuals at held-out placements, and evidence", columns, rows)


def geometry_lines(result: Result) -> list[str]:
    """What the terminal says of the geometry, a line each."""
    own = result.geometry
    if not own.stated or result.misfit is not None or not result.likelihood.converged:
        return []
    lines = confounded_lines(result)[:1]
    if own.factors is not None:
        lines.append(factors_sentence(own) or "")
    determined = sum(row.group == "geometry" and row.std is not None for row in result.parameters)
    free = sum(row.group == "geometry" and not row.held for row in result.parameters)
    kept = [RUNGS[rung.rung].removeprefix("+ ") for rung in own.ladder if rung.kept]
    left = [
        f"{RUNGS[rung.rung].removeprefix('+ ')} ({rung_reason(own.ladder, i)})"
        for i, rung in enumerate(own.ladder)
        if not rung.kept and rung.rung != "offsets"
    ]
    said = f"Geometry: {determined} of {free} parameters determined, the others prior only"
    said += f"; kept: {listed(kept)}" if kept else ""
    said += f"; not kept: {listed(left)}" if left else ""
    return [*lines, f"{said}."]


def check_lines(check: Check) -> list[str]:
    """What a check says of the geometry, a line each."""
    offsets = [row for row in check.parameters if row.group == "offset"]
    said = worth_sentence(check.geometry, offsets)
    lines = [] if said is None else [said]
    known = [row for row in offsets if row.std is not None]
    worst = max(known, key=lambda row: row.std or 0.0, default=None)
    if worst is not None:
        why = confounded_sentence(check.geometry, worst.name, worst.tolerance_share, person)
        lines += [] if why is None else [why]
    rows = [row for row in check.parameters if row.group == "geometry" and not row.held]
    if rows:
        determined = sum(row.std is not None for row in rows)
        lines.append(
            f"Geometry: {determined} of {len(rows)} parameters will be determined, the others prior only."
        )
    return lines
