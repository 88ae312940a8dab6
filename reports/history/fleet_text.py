"""The drift of all arms together as tables and JSON."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...analysis.drift.instruments import Bias
from ...experiments.history.fleet_drift import FEW, ArmWalk, ArmWalks, FleetDrift, ModelWalk, Rate, Suspect
from ...words import numbers
from ...words.wording import clipped, counted, label, listed
from ..style.blocks import Block, Cell, Paragraph, Row, row_of, table_of
from .lists import utc

_MOST = 20  # rows of a table; the JSON has all
_FASTEST = 10


def fleet_blocks(found: FleetDrift) -> Iterator[Block]:
    """How fast each model walks, the fastest arms, the instruments, and what is not determined."""
    if found.models:
        yield _models(found)
        yield _fastest(found)
    yield from _about_arms(found)
    yield from _instruments(found)


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
                *_walk(own),
                Cell(_said(own), mark="weak" if own.drifts else ""),
                tone="weak" if own.drifts else "",
            )
            for own in found.models
        ],
    )


def _said(own: ModelWalk) -> str:
    return ", ".join(part for part in ("drifts" if own.drifts else "", _cause(own)) if part)


def _walk(own: ModelWalk) -> tuple[str, ...]:
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


def _instruments(found: FleetDrift) -> Iterator[Block]:
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
