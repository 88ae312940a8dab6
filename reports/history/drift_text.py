"""The drift of an arm, and of all arms together, as tables and JSON."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from typing import Any, Protocol

import numpy as np

from ...analysis.drift.drift import Jump, Undecided
from ...analysis.drift.instruments import Bias
from ...experiments.history.arm_drift import ArmDrift, DatedChange, DatedJump
from ...experiments.history.fleet_drift import FEW, ArmWalk, ArmWalks, FleetDrift, ModelWalk, Rate, Suspect
from ...words import numbers
from ...words.wording import clipped, counted, label, listed, shown
from ..style.blocks import Block, Cell, Paragraph, Row, Table, row_of, table_of
from .lists import day, event_json, utc

SCHEMA = "zerobeam/drift/1"
FEW_RATES = 30  # rates: below, the numbers are coarse
UNDECIDED = "too few results to distinguish a jump from drift"


def drift_blocks(found: ArmDrift) -> Iterator[Block]:
    """Jumps, the offsets now and how fast they walk, the due date, what does not count."""
    if found.drift is not None:
        yield from jumps_blocks(found)
        yield offsets_block(found)
        if found.drift.effective < FEW_RATES:
            yield Paragraph("Few walk rates explain these results: intervals and p-values are approximate.")
    yield Paragraph(f"{due_sentence(found)} {counted(len(found.used), 'result')} counted.")
    for own in found.left_out:
        yield Paragraph(f"Not counted: the result of {day(own.result.measured_at)}. {own.reason}.")


def due_sentence(found: ArmDrift) -> str:
    """When the next calibration is due, or why there is no date."""
    limit = f"TCP error within {numbers.exact(found.tolerance_mm, 'mm')} (95 %, rms of the workspace)"
    reason = with_labels(found.due_reason)
    if found.due is not None and not found.due_reason:
        return f"Next calibration due: {found.due:%Y-%m-%d}, for a {limit}."
    word = "due now" if found.due is not None else "no due date"
    return f"Next calibration: {word} for a {limit}: {reason}."


def with_labels(text: str) -> str:
    """A sentence with the offsets in it as people write them."""
    return re.sub(r"delta\d+", lambda name: label(name.group()), text)


def arms_drift_table(arms: Sequence[ArmDrift]) -> Block:
    """A row for each arm: its clearest jump, and when it is due."""
    rows = [
        row_of(
            clipped(own.serial, 24),
            clipped(own.model, 20),
            str(len(own.used)),
            _clearest(own),
            "none" if own.due is None else f"{own.due:%Y-%m-%d}",
            tone="weak" if own.jumps or own.undecided else "",
        )
        for own in arms
    ]
    heads = ("arm", "model", "results", "clearest jump", "due")
    columns = [(head, "right" if head == "results" else "left") for head in heads]
    return table_of("Drift of all arms", columns, rows)


def drift_json(found: ArmDrift) -> dict[str, Any]:
    """The same for programs."""
    return {
        "serial": found.serial,
        "model": found.model,
        "used": [own.sha256 for own in found.used],
        "left_out": [{"sha256": own.result.sha256, "reason": own.reason} for own in found.left_out],
        "offsets": list(_offset_rows(found)),
        "jumps": [
            {
                "offset": own.jump.offset,
                "unit": own.jump.unit,
                "after": utc(own.after),
                "before": utc(own.before),
                "p_value": own.jump.p_value,
                "size": own.jump.size,
                "interval95": list(own.jump.interval95),
                "events": [event_json(event) for event in own.events],
                "instruments": _instruments(own),
            }
            for own in found.jumps
        ],
        "undecided": [
            {
                "offset": own.change.offset,
                "unit": own.change.unit,
                "after": utc(own.after),
                "before": utc(own.before),
                "size": own.change.size,
                "interval95": list(own.change.interval95),
                "least_jump": own.change.least_jump,
                "events": [event_json(event) for event in own.events],
                "instruments": _instruments(own),
            }
            for own in found.undecided
        ],
        "effective_rates": None if found.drift is None else found.drift.effective,
        "due": due_json(found),
    }


def _instruments(own: DatedJump | DatedChange) -> list[str | None] | None:
    return None if own.instruments is None else [name or None for name in own.instruments]


class Due(Protocol):
    """What is said of a due date."""

    @property
    def tolerance_mm(self) -> float: ...
    @property
    def due(self) -> datetime | None: ...
    @property
    def due_reason(self) -> str: ...


def due_json(found: Due) -> dict[str, Any]:
    """The due date for programs."""
    return {
        "tolerance_mm": found.tolerance_mm,
        "date": None if found.due is None else f"{found.due:%Y-%m-%d}",
        "reason": found.due_reason or None,
    }


def _offset_rows(found: ArmDrift) -> Iterator[dict[str, Any]]:
    """Of each offset at the last result: estimate, std, interval (None where no result determines it since
    the controller got new zeros), the rate of its walk (None where the results say nothing of it)."""
    if found.drift is None:
        return
    names = found.drift.series.names
    for i, name in enumerate(names):
        along, last = np.eye(len(names))[i], -1
        known = bool(found.drift.series.determined[last, i])
        value, std = found.drift.value(last, along) if known else (None, None)
        median, interval = found.drift.rate(name)
        yield {
            "name": name,
            "unit": found.drift.series.units[i],
            "estimate": value,
            "std": std,
            "interval95": list(found.drift.interval(last, along)) if known else None,
            "rate": {"median": median, "interval95": list(interval)} if found.drift.walks(name) else None,
        }


def offsets_block(found: ArmDrift) -> Block:
    """Every offset at the last result, and how fast it walks."""
    rows = [
        row_of(
            label(own["name"]),
            _now(own),
            *_walk(own),
        )
        for own in _offset_rows(found)
    ]
    heads = ("offset", "at the last result", "walk", "95 % interval")
    columns = [(head, "left" if head == "offset" else "right") for head in heads]
    return table_of("Offsets by all results, and their random walk per root year", columns, rows)


def _walk(own: dict[str, Any]) -> tuple[str | Cell, str]:
    if own["rate"] is None:
        return Cell("not determined", mark="unidentifiable"), ""
    ends = " to ".join(numbers.significant(end, 2) for end in own["rate"]["interval95"])
    return numbers.significant(own["rate"]["median"], 2, own["unit"]), ends


def _now(own: dict[str, Any]) -> str | Cell:
    if own["std"] is None:
        return Cell("not determined since the mastering", mark="unidentifiable")
    return f"{numbers.estimate(own['estimate'], own['std'])} ± {numbers.spread(own['std'], own['unit'])}"


def jumps_blocks(found: ArmDrift) -> Iterator[Block]:
    """The jumps, the changes that may be one, and what was logged in between."""
    if found.jumps:
        yield _jumps_table(found.jumps)
    if found.undecided:
        yield _undecided_table(found.undecided)
    elif not found.jumps:
        yield Paragraph(without_jump(found))


def without_jump(found: ArmDrift) -> str:
    """What is said of the changes where none of them is a jump or may be one."""
    if found.drift is not None and found.drift.changed:
        return "No jump was found: drift at a rate that other results show explains every change."
    return "No change from one result to the next exceeds their uncertainty."


def _jumps_table(jumps: Sequence[DatedJump]) -> Table:
    rows = [
        row_of(
            Cell(label(own.jump.offset), mark="weak"),
            f"{day(own.after)} to {day(own.before)}",
            _change(own.jump),
            numbers.p_value(own.jump.p_value),
            ", ".join(_happened(own)) or "none logged",
        )
        for own in jumps
    ]
    heads = ("offset", "between", "change", "p-value", "events")
    columns = [(head, "right" if head in ("change", "p-value") else "left") for head in heads]
    return table_of("Jumps; p-values adjusted for the number of tests (Bonferroni)", columns, rows)


def _undecided_table(changes: Sequence[DatedChange]) -> Table:
    rows = [
        row_of(
            Cell(label(own.change.offset), mark="weak"),
            f"{day(own.after)} to {day(own.before)}",
            _change(own.change),
            numbers.significant(own.change.least_jump, 2, own.change.unit),
            ", ".join(_happened(own)) or "none logged",
        )
        for own in changes
    ]
    heads = ("offset", "between", "change", "a jump from", "events")
    columns = [(head, "right" if head in ("change", "a jump from") else "left") for head in heads]
    return table_of(f"Jump or drift: {UNDECIDED}", columns, rows)


def _change(own: Jump | Undecided) -> str:
    low, high = own.interval95
    return numbers.interval(own.interval95, max((high - low) / 4, 1e-12), own.unit)


def change_sentence(own: DatedJump | DatedChange) -> str:
    """Offset, size and dates of a change."""
    change = own.jump if isinstance(own, DatedJump) else own.change
    between = f"between {day(own.after)} and {day(own.before)}"
    return f"{label(change.offset)} changed by {_change(change)} {between}"


def _happened(own: DatedJump | DatedChange) -> Iterator[str]:
    for event in own.events:
        yield f"{event.what} {day(event.at)} {shown(event.note)}".strip()
    if own.instruments is not None:
        before, after = (clipped(name) if name else "not stated" for name in own.instruments)
        changed = "changed" if all(own.instruments) else "may have changed"
        yield f"instrument {changed}, a possible cause: {before} to {after}"


def _clearest(own: ArmDrift) -> str:
    clearest = min(own.jumps, key=lambda jump: jump.jump.p_value, default=None)
    return clearest_jump(clearest, len(own.undecided)) or "none"


def clearest_jump(own: DatedJump | None, undecided: int) -> str:
    """In a list of arms: offset of a jump and the result that shows it, or how many changes may be one."""
    if own is not None:
        return f"{label(own.jump.offset)}, {own.before:%Y-%m-%d}"
    return f"{undecided} undecided" if undecided else ""


_MOST = 20  # rows of a table; the JSON has all
_FASTEST = 10


def fleet_blocks(found: FleetDrift) -> Iterator[Block]:
    """How fast each model walks, the fastest arms, the instruments, and what is not determined."""
    if found.models:
        yield _models(found)
        yield _fastest(found)
    yield from _about_arms(found)
    yield from _instrument_blocks(found)


def fleet_drift_json(found: FleetDrift) -> dict[str, Any]:
    """The same for programs."""
    return {
        "alarm": found.alarm,
        "models": [
            {
                "model": own.model,
                "offset": own.offset,
                "unit": own.unit,
                "arms": own.arms,
                "rate": _rate_json(own.median),
                "between": _rate_json(own.between),
                "noticed": own.noticed,
                "probability": own.probability,
                "drifts": own.drifts,
                "biased": list(own.biased),
            }
            for own in found.models
        ],
        "arms": [
            {
                "serial": own.serial,
                "model": own.model,
                "effective_rates": own.effective,
                "offsets": [
                    {
                        "name": walk.offset,
                        "unit": walk.unit,
                        "alone": _rate_json(walk.alone),
                        "rate": _rate_json(walk.shrunken),
                        "borrowed": walk.borrowed,
                    }
                    for walk in own.walks
                ],
            }
            for own in found.arms
        ],
        "biases": [
            {
                "offset": own.offset,
                "unit": own.unit,
                "instrument": own.instrument,
                "against": list(own.against),
                "estimate": own.estimate,
                "std": own.std,
                "interval95": list(own.interval95),
                "p_value": own.p_value,
                "alarm": own.alarm,
            }
            for own in found.biases
        ],
        "comparable": [
            {"offset": own.offset, "groups": [list(group) for group in own.groups]}
            for own in found.comparable
        ],
        "unstated": found.unstated,
        "suspects": [
            {
                "serial": own.serial,
                "model": own.model,
                "offset": own.jump.jump.offset,
                "after": utc(own.jump.after),
                "before": utc(own.jump.before),
                "instruments": list(own.biased),
            }
            for own in found.suspects
        ],
        "too_few": found.too_few,
    }


def _rate_json(own: Rate | None) -> dict[str, Any] | None:
    return None if own is None else {"median": own[0], "interval95": list(own[1])}


def _models(found: FleetDrift) -> Block:
    heads = ("model", "offset", "arms", "walk", "95 % interval", "u of a result", "walk > u in a year")
    columns = [(head, "left" if head in ("model", "offset") else "right") for head in heads]
    columns.append(("says", "left"))
    return table_of(
        "Walk of the median arm of each model, per root year. It drifts if it walks farther in a year than"
        f" the standard uncertainty of a result; false alarm of any: at most {found.alarm:.0%}",
        columns,
        [
            row_of(
                clipped(own.model, 20),
                label(own.offset),
                str(own.arms),
                *_model_walk(own),
                Cell(_said(own), mark="weak" if own.drifts else ""),
                tone="weak" if own.drifts else "",
            )
            for own in found.models
        ],
    )


def _said(own: ModelWalk) -> str:
    return ", ".join(part for part in ("drifts" if own.drifts else "", _cause(own)) if part)


def _model_walk(own: ModelWalk) -> tuple[str, ...]:
    u = numbers.significant(own.noticed, 2, own.unit)
    if own.median is None or own.probability is None:
        return "not known", "", u, ""
    median, interval = own.median
    return (
        numbers.significant(median, 2, own.unit),
        _interval(interval),
        u,
        numbers.p_value(own.probability),
    )


def _cause(own: ModelWalk) -> str:
    if not own.biased:
        return ""
    return f"perhaps a bias: {listed([clipped(name, 24) for name in own.biased], 3)}"


def _interval(ends: tuple[float, float]) -> str:
    return " to ".join(numbers.significant(end, 2) for end in ends)


def _fastest(found: FleetDrift) -> Block:
    models = {(own.model, own.offset): own for own in found.models}

    def ratio(pair: tuple[ArmWalks, ArmWalk]) -> float:
        arm, walk = pair
        return walk.shrunken[0] / models[arm.model, walk.offset].noticed if walk.shrunken else 0.0

    every = [(arm, walk) for arm in found.arms for walk in arm.walks if walk.shrunken]
    rows = [
        row_of(
            clipped(arm.serial, 16),
            clipped(arm.model, 16),
            label(walk.offset),
            numbers.significant(walk.shrunken[0], 2, walk.unit),
            _interval(walk.shrunken[1]),
            "its model" if walk.borrowed else "own results",
            _cause(models[arm.model, walk.offset]),
        )
        for arm, walk in sorted(every, key=ratio, reverse=True)[:_FASTEST]
        if walk.shrunken
    ]
    heads = ("arm", "model", "offset", "walk", "95 % interval", "mostly by", "possible cause")
    columns = [(head, "right" if head in ("walk", "95 % interval") else "left") for head in heads]
    return table_of(
        "Fastest walks of single arms over the u of a result, by the rates of their model too", columns, rows
    )


def _about_arms(found: FleetDrift) -> Iterator[Block]:
    borrowed = [
        f"{clipped(own.serial, 24)} ({', '.join(label(walk.offset) for walk in own.walks if walk.borrowed)})"
        for own in found.arms
        if any(walk.borrowed for walk in own.walks)
    ]
    if borrowed:
        yield Paragraph(
            "Rates that are known more by the other arms of the model than by own results:"
            f" {listed(borrowed)}."
        )
    coarse = [own.serial for own in found.arms if own.effective < FEW]
    if coarse:
        yield Paragraph(f"Few walk rates of {_arms(coarse)} agree with the model: intervals are approximate.")
    if found.too_few:
        yield Paragraph(f"{counted(found.too_few, 'arm')} with fewer than two results that count: not used.")


def _arms(serials: list[str]) -> str:
    return f"{counted(len(serials), 'arm')} ({listed([clipped(own, 24) for own in serials], 4)})"


def _instrument_blocks(found: FleetDrift) -> Iterator[Block]:
    if found.biases:
        ordered = sorted(
            found.biases, key=lambda own: (not own.alarm, own.p_value, -abs(own.estimate) / own.std)
        )
        odd = sum(own.alarm for own in ordered)
        shown = ordered[: max(odd, _MOST)]
        caption = (
            "Biases of instruments, less the mean of those they are comparable to; p-values adjusted for the"
            f" number of tests (Bonferroni); an alarm below {found.alarm:g}"
        )
        if len(shown) < len(ordered):
            caption += f". {len(shown)} of {len(ordered)}: --json has all"
        heads = ("instrument", "less", "offset", "difference", "95 % interval", "p-value", "says")
        right = ("difference", "95 % interval", "p-value")
        columns = [(head, "right" if head in right else "left") for head in heads]
        yield table_of(caption, columns, [_bias(own) for own in shown])
        if any(len(own.against) == 1 for own in shown):
            yield Paragraph("Of two instruments only the difference is known, not whose bias it is.")
    yield from map(Paragraph, _not_determined(found))
    for suspect in found.suspects[:_MOST]:
        yield Paragraph(_suspect(suspect))


def _bias(own: Bias) -> Row:
    said = "biased" if len(own.against) > 1 else "differs"
    return row_of(
        clipped(own.instrument, 24),
        listed([clipped(name, 24) for name in own.against], 3),
        label(own.offset),
        f"{numbers.estimate(own.estimate, own.std)} ± {numbers.spread(own.std, own.unit)}",
        numbers.interval(own.interval95, own.std),
        numbers.p_value(own.p_value),
        Cell(said if own.alarm else "", mark="weak" if own.alarm else ""),
        tone="weak" if own.alarm else "",
    )


def _not_determined(found: FleetDrift) -> Iterator[str]:
    """Sentences, one for all offsets that have the same groups of instruments."""
    alike: dict[tuple[tuple[str, ...], ...], list[str]] = {}
    for own in found.comparable:
        if len(own.groups) > 1 or any(len(group) == 1 for group in own.groups):
            alike.setdefault(own.groups, []).append(label(own.offset))
    for groups, offsets in alike.items():
        of = listed(offsets)
        if len(groups) == 1:
            yield f"Bias of {clipped(groups[0][0], 24)}: not determined ({of}). It is the only instrument."
            continue
        named = "; ".join(" and ".join(clipped(name, 24) for name in group) for group in groups[:_MOST])
        yield (
            f"Biases between these are not determined ({of}): {named}. Two changes from one to the other on"
            " arms, without new zeros in between, determine it; after one change a jump of the arm would look"
            " the same."
        )
    if found.comparable:
        yield "A bias that all instruments have in common is never determined."
    if found.unstated:
        yield (
            f"{counted(found.unstated, 'result')} without an instrument: not used for biases. State psd or"
            " probe in the provenance."
        )


def _suspect(own: Suspect) -> str:
    biased = " or ".join(clipped(name, 24) for name in own.biased)
    return (
        f"The jump of {label(own.jump.jump.offset)} of {clipped(own.serial, 24)} before"
        f" {own.jump.before:%Y-%m-%d} is at a change of instrument: the bias of {biased} is a possible cause."
    )
