"""What would make an answer better, in words: remedies with what they are predicted to give, and the region
of the TCP's error."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ..analysis.observability.outlook import Outlook, OutlookRow
from ..analysis.tcp_region import CENTRAL, TcpRegion
from . import numbers
from .wording import capital, counted, listed, person, shown

_EARLIER = "in the workspace"  # of results that do not say which


def region_words(region: TcpRegion | None) -> str:
    """Its name, with the preposition: it follows a sentence, or begins one (`region_first`)."""
    if region is None:
        return _EARLIER
    if region.name is not None:
        return region.name
    at = f", on axis {region.on_axis} (J{region.on_axis} not determined)" if region.on_axis else ""
    return f"{_postures_of(region)}{at}"


def _postures_of(region: TcpRegion) -> str:
    if region.positions is not None:
        return f"over the {counted(region.postures or 0, 'posture')} of {shown(region.positions)}"
    ranges = {
        "central": f"in the central {100 * CENTRAL:.0f} % of the joints\u2019 ranges",
        "full": "over the full joint ranges",
    }[region.joints or "central"]
    if region.box_mm is None:
        return ranges
    sides = (
        f"{axis} {numbers.exact(low)} to {numbers.exact(high)}"
        for axis, low, high in zip("xyz", *region.box_mm, strict=True)
    )
    return f"in the box {', '.join(sides)} mm, {ranges}"


def region_short(region: TcpRegion | None) -> str:
    """The same in the head of a column."""
    if region is None:
        return "workspace"
    at = f", axis {region.on_axis}" if region.on_axis else ""
    if region.positions is not None:
        return f"own positions{at}"
    if region.box_mm is not None:
        return f"stated box{at}"
    return f"central {100 * CENTRAL:.0f} %{at}" if region.joints != "full" else f"full ranges{at}"


def region_first(region: TcpRegion | None) -> str:
    """The same at the beginning of a sentence."""
    return capital(region_words(region))


MOST_SHOWN = 3
TITLE = "What would make it better"
HEADS = ("TCP", "95 %", "time")
_OPEN = "not determined"


class RemedyWords(NamedTuple):
    """A remedy as a table says it: `largest` is the largest U of an offset."""

    remedy: str
    U: tuple[str, ...]
    largest: str
    tcp_median: str
    tcp_95: str
    minutes: str


def best_remedies(outlook: Outlook) -> list[OutlookRow]:
    """Those that are shown first."""
    return list(outlook.worth[:MOST_SHOWN])


def remedy_words(row: OutlookRow, now: OutlookRow, units: Mapping[str, str]) -> RemedyWords:
    """A remedy of the answer as it is `now`; `units` of the offsets that have columns, by name."""
    return RemedyWords(
        _remedy(row),
        tuple(_expanded(row.U[name], unit) if name in row.U else "—" for name, unit in units.items()),
        _largest(row, now, units),
        numbers.or_words(row.tcp_median_mm, _OPEN, "mm", 2),
        numbers.or_words(row.tcp_95_mm, _OPEN, "mm", 2),
        _minutes(row.minutes) if row.minutes else "—",
    )


def _minutes(minutes: float) -> str:
    """Of a rig in memory they are seconds."""
    return "< 1 min" if minutes < 1 else f"{minutes:.0f} min"


def _remedy(row: OutlookRow) -> str:
    match row.remedy:
        case "none":
            return "as it is"
        case "postures":
            return f"{row.shots} better postures, 2 again"
        case "more":
            return f"{row.shots} best postures, 2 again"
        case "repeat":
            return "first two postures again"
        case "points":
            return f"4 tracker points, postures {listed([str(each) for each in row.postures])}"
        case "mounting":
            sizes = listed([_size(key, std) for key, std in row.state.items()])
            return f"mounting measured to {sizes}"
        case "links":
            return "links entered too"


def _size(key: str, std: float) -> str:
    return numbers.exact(std, "deg" if key.endswith("_deg") else "mm")


def _expanded(value: float | None, unit: str) -> str:
    return numbers.or_words(value, _OPEN, unit, 2)


def _largest(row: OutlookRow, now: OutlookRow, units: Mapping[str, str]) -> str:
    """The largest U of the offsets, of each unit; of a mounting the U of those that rest on it."""
    resting = [name for name in row.U if name not in now.U]
    if resting:
        return "; ".join(f"{person(name)} {_expanded(row.U[name], units[name])}" for name in resting)
    return _of_all(row, units)


def _of_all(row: OutlookRow, units: Mapping[str, str]) -> str:
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


class BetterPostures(NamedTuple):
    """What to do, as an imperative without a full stop; the remedy; the U that it gives."""

    text: str
    row: OutlookRow
    U: str


def better_postures(outlook: Outlook | None, offset: Any) -> BetterPostures | None:
    """What to do where other postures bring an `offset` within its tolerance, as an imperative without a full
    stop, and the remedy with the fewest measurements that does; None where none of them does."""
    if outlook is None or offset.name not in outlook.now.U:
        return None
    name = offset.name
    rows = [(row, u) for row in outlook.by_postures if (u := row.U.get(name)) is not None]
    first = next((row for row, u in rows if u <= outlook.enough.get(name, 0.0)), None)
    if first is None:
        return None
    now, to = (_of_all(row, dict.fromkeys(row.U, offset.unit)) for row in (outlook.now, first))
    return BetterPostures(f"plan {first.shots} better postures: largest U {now} → {to}", first, to)


def outlook_notes(outlook: Outlook) -> list[str]:
    """What the figures are, and whether what is required can be reached."""
    minutes = (
        f"A measurement took {numbers.significant(outlook.minutes_each, 2)} min in this run."
        if outlook.measured
        else f"A measurement by hand is assumed to take {numbers.exact(outlook.minutes_each, 'min')}."
    )
    return [_region(outlook), *_floor(outlook), *_required(outlook), minutes]


def _region(outlook: Outlook) -> str:
    return f"TCP: its error, median and 95 %, {region_words(outlook.region)}, with the values entered."


def _floor(outlook: Outlook) -> list[str]:
    """What offsets alone leave, and what the links leave, with the most measurements."""
    rows = [outlook.now, *(row for row in outlook.remedies if row.remedy in ("postures", "more"))]
    most = max(rows, key=lambda row: row.shots)
    if most.tcp_median_mm is None or most.links_median_mm is None:
        return []
    alone, links = (numbers.significant(each, 2, "mm") for each in (most.tcp_median_mm, most.links_median_mm))
    return [
        f"With {most.shots} measurements the TCP is off by {alone} (median) with offsets alone, by {links}"
        " where the links are entered as well."
    ]


def _required(outlook: Outlook) -> list[str]:
    if outlook.required_mm is None or outlook.reachable is None:
        return []
    required = numbers.exact(outlook.required_mm, "mm")
    reaching = within_reach(outlook)
    if reaching is None:
        return [f"None of these remedies reaches the required {required} (95 %)."]
    if not outlook.falls_short and outlook.now.tcp_95_mm is not None:
        return []  # whether the answer as it is meets it is judged of this arm
    return [f"The required {required} (95 %) is within reach: {reaching.text}."]


class Reaching(NamedTuple):
    """What meets the requirement, without a full stop, and the remedy."""

    text: str
    row: OutlookRow


def within_reach(outlook: Outlook) -> Reaching | None:
    """What reaches what is required with the fewest measurements, by offsets alone before with the links
    entered too; None where nothing does."""
    if outlook.region.on_axis is not None:
        return None
    most = outlook.required_mm or 0.0
    every = (outlook.now, *outlook.remedies)  # of another instrument last
    rows = sorted(every, key=lambda row: (row.remedy == "points", row.shots, row.minutes))
    for row in rows:
        if row.tcp_95_mm is not None and row.tcp_95_mm <= most:
            return Reaching(_remedy(row), row)
    for row in rows:
        if row.links_95_mm is not None and row.links_95_mm <= most:
            first = "" if row.remedy in ("none", "links") else f"{_remedy(row)}, and "
            return Reaching(f"{first}the links entered as well", row)
    return None


def short_words(outlook: Outlook) -> str:
    """That it falls short, in a few words."""
    required = f"the required {numbers.exact(outlook.required_mm or 0.0, 'mm')}"
    if outlook.region.on_axis is not None:
        return f"whether it meets {required} cannot be said"
    return f"predicted not to meet {required}"


def short_sentence(outlook: Outlook) -> str:
    """By how much the answer as it is falls short of what is required."""
    now, required = outlook.now.tcp_95_mm or 0.0, outlook.required_mm or 0.0
    axis = outlook.region.on_axis
    if axis is not None:
        return f"the TCP rotates with J{axis}, which this plan does not determine"
    return (
        f"as predicted the TCP is off by up to {numbers.significant(now, 2, 'mm')} in 95 % of the postures"
        f" {region_words(outlook.region)}, with the values entered: more than the required"
        f" {numbers.exact(required, 'mm')}"
    )


def required_remedy(outlook: Outlook) -> str:
    """What to do where it falls short, as an imperative without a full stop."""
    required = numbers.exact(outlook.required_mm or 0.0, "mm")
    if (axis := outlook.region.on_axis) is not None:
        return f"Do not measure by this plan for {required}: determine J{axis} as well"
    if (reaching := within_reach(outlook)) is not None:
        if reaching.row.remedy in ("none", "links"):
            return f"Have the links entered as well as the offsets: {required} is then within reach"
        return f"Do not measure by this plan: the required {required} is within reach by {reaching.text}"
    rows = (outlook.now, *outlook.remedies)
    errors = [error for row in rows for error in (row.tcp_95_mm, row.links_95_mm) if error is not None]
    best = numbers.significant(min(errors), 2, "mm")
    return (
        f"Do not measure by this plan for {required}: no remedy reaches it, the best leaves {best} (95 %)."
        " Lower the noise, or state in `required` what is enough"
    )
