"""What would make an answer better, in words: remedies with what they are predicted to give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..analysis.observability.outlook import BY_HAND_MIN, Outlook, OutlookRow
from . import numbers
from .region_words import region_words
from .wording import counted, listed

MOST_SHOWN = 3
TITLE = "What would make it better"
HEADS = ("TCP off", "95 %", "time")
_OPEN = "not determined"


class RemedyWords(NamedTuple):
    """A remedy as a table says it: `largest` is the largest U of an offset."""

    remedy: str
    U: tuple[str, ...]
    largest: str
    tcp_median: str
    tcp_95: str
    minutes: str


def shown_remedies(outlook: Outlook, units: Mapping[str, str]) -> list[RemedyWords]:
    """The answer as it is, then what is shown first; nothing where nothing gains anything. `units` of all
    offsets, by name."""
    best = best_remedies(outlook)
    return [remedy_words(row, units) for row in (outlook.now, *best)] if best else []


def best_remedies(outlook: Outlook) -> list[OutlookRow]:
    """Those that are shown first: the best, and what makes another offset known."""
    return list(outlook.worth[:MOST_SHOWN])


def remedy_words(row: OutlookRow, units: Mapping[str, str]) -> RemedyWords:
    """`units` of the offsets that have columns, by name."""
    return RemedyWords(
        _remedy(row),
        tuple(_expanded(row.U[name], unit) if name in row.U else "—" for name, unit in units.items()),
        _largest(row, units),
        numbers.or_words(row.tcp_median_mm, _OPEN, "mm", 2),
        numbers.or_words(row.tcp_95_mm, _OPEN, "mm", 2),
        f"{row.minutes:.0f} min" if row.minutes else "—",
    )


def _remedy(row: OutlookRow) -> str:
    match row.remedy:
        case "none":
            return "as it is"
        case "postures":
            return f"better postures, again {row.shots}"
        case "more":
            return f"{row.shots} measurements, in the best postures"
        case "repeat":
            return "the first two postures again"
        case "mounting":
            to = listed([f"{_size(key, std)} ({key})" for key, std in row.state.items()])
            return f"the mounting measured to {to} and stated"
        case "links":
            return "links entered too, where the controller takes them"


def _size(key: str, std: float) -> str:
    return numbers.exact(std, "deg" if key.endswith("_deg") else "mm")


def _expanded(value: float | None, unit: str) -> str:
    return numbers.or_words(value, _OPEN, unit, 2)


def _largest(row: OutlookRow, units: Mapping[str, str]) -> str:
    """The largest U of the offsets, of each unit."""
    if None in row.U.values():
        return _OPEN
    of_unit: dict[str, float] = {}
    for name, value in row.U.items():
        of_unit[units[name]] = max(of_unit.get(units[name], 0.0), value or 0.0)
    return "; ".join(numbers.significant(value, 2, unit) for unit, value in of_unit.items()) or "—"


def plan_command(planned: str | None, row: OutlookRow) -> str | None:
    """The command that makes the plan; `planned` is `zerobeam plan optimal` with the header, None where no
    such command makes one."""
    if planned is None or not row.options:
        return None
    return f"{planned} {' '.join(row.options)} -o new-plan.yaml"


def outlook_notes(outlook: Outlook) -> list[str]:
    """What the figures are, and whether what is required can be reached."""
    minutes = (
        f"A measurement took {numbers.significant(outlook.minutes_each, 2)} min in this run."
        if outlook.measured
        else f"A measurement by hand is assumed to take {counted(round(BY_HAND_MIN), 'minute')}."
    )
    return [*_floor(outlook), *_required(outlook), minutes]


def _floor(outlook: Outlook) -> list[str]:
    """What offsets alone leave, and what the links leave, with the most measurements."""
    rows = [outlook.now, *(row for row in outlook.remedies if row.remedy in ("postures", "more"))]
    most = max(rows, key=lambda row: row.shots)
    if most.tcp_median_mm is None or most.links_median_mm is None:
        return []
    alone, links = (numbers.significant(each, 2, "mm") for each in (most.tcp_median_mm, most.links_median_mm))
    return [
        f"With {most.shots} measurements the TCP is off by {alone} (median, {region_words(outlook.region)})"
        f" with offsets alone, by {links} where the links are entered as well."
    ]


def _required(outlook: Outlook) -> list[str]:
    if outlook.required_mm is None or outlook.reachable is None:
        return []
    required = numbers.exact(outlook.required_mm, "mm")
    if not outlook.reachable:
        return [f"The required {required} (95 %) are out of reach of these remedies."]
    rows = sorted((outlook.now, *outlook.remedies), key=lambda row: (row.shots, row.minutes))
    for row in rows:
        if row.tcp_95_mm is not None and row.tcp_95_mm <= outlook.required_mm:
            return [f"The required {required} (95 %) are within reach: {_remedy(row)}."]
    row = next(r for r in rows if r.links_95_mm is not None and r.links_95_mm <= outlook.required_mm)
    first = "" if row.remedy in ("none", "links") else f"{_remedy(row)}, and "
    return [f"The required {required} (95 %) are within reach: {first}the links entered as well."]
