"""The grid of a sweep: its axes, its cases, and what each says of a parameter, for tables and figures alike.

An axis is a setting {key, label, unit, values, set}, its values numbers or words; a case is one point of the
grid, `at` the index of its value on each axis. A case has a plan and `parameters`, or a `reason` why there is
none. A parameter has the predicted `std`, and what simulated runs of the case gave: `likelihood` and
`midpoint`, the errors of either fit.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

from ..words import numbers
from ..words.wording import clipped, label

Json = dict[str, Any]

NO_PLAN = "no plan"
# Words and mark (a role of the palette) of a case's verdict.
STANDING: dict[str | None, tuple[str, str]] = {
    "pass": ("identified", "pass"),
    "weak": ("weak", "weak"),
    "degenerate": ("unidentifiable", "degenerate"),
    None: ("held", NO_PLAN),
}
_LONGEST_VALUE = 24
_MOST_DOTS, _MOST_PAGES = 46, 4  # rows of a figure of dots, and how many of those there are


def form_of(answer: Json) -> str:
    """The form of the figure: no axis of numbers, dots; one, lines; more, a map."""
    return ("dots", "lines", "map")[min(2, sum(map(is_numeric, answer["axes"])))]


def figure_names(answer: Json) -> list[str]:
    """Names of the figures in their order; what was observed has one of its own where there is a map."""
    form = form_of(answer)
    if form == "dots":
        return [f"dots_{number}" for number, _ in enumerate(dot_pages(answer), start=1)]
    return [form, "ratio"] if form == "map" and has_observed(answer, "likelihood") else [form]


def dot_pages(answer: Json) -> list[list[Json]]:
    """The cases of each figure of dots: as many as fit, one value of the first axis kept together."""
    pages: list[list[Json]] = []
    for _, group in itertools.groupby(answer["cases"], key=lambda case: case["at"][:1]):
        cases = list(group)
        parts = (
            [cases] if len(answer["axes"]) > 1 and _rows_of(cases) <= _MOST_DOTS else [[one] for one in cases]
        )
        for part in parts:
            if not pages or _rows_of(pages[-1]) + _rows_of(part) > _MOST_DOTS:
                pages.append([])
            pages[-1] += part
    return pages[:_MOST_PAGES]


def _rows_of(cases: list[Json]) -> int:
    return sum(1 + len(case["parameters"]) for case in cases)


def is_numeric(axis: Json) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in axis["values"])


def unit_of(thing: Json) -> str:
    """The unit of an axis or a parameter, fit to be shown."""
    return clipped(thing["unit"] or "", 12)


def value_text(axis: Json, index: int) -> str:
    """A value of an axis with its unit, a word as it is."""
    value = axis["values"][index]
    if isinstance(value, int | float) and not isinstance(value, bool):
        return numbers.exact(value, unit_of(axis))
    return clipped(str(value), _LONGEST_VALUE)


def axis_title(axis: Json) -> str:
    """Label and unit of an axis, as beside its scale."""
    unit = {"deg": "°"}.get(unit_of(axis), unit_of(axis))
    return f"{clipped(axis['label'])}, {unit}" if unit else clipped(axis["label"])


def case_name(answer: Json, case: Json) -> str:
    """Where a case stands, `shots 7, y-pattern`: words stand alone, numbers with their label."""
    return place_name(list(zip(answer["axes"], case["at"], strict=True)))


def place_name(place: list[tuple[Json, int]]) -> str:
    """The same for some of the axes, each with the index of its value."""
    return ", ".join(
        f"{clipped(axis['label'], _LONGEST_VALUE)} {value_text(axis, i)}"
        if is_numeric(axis)
        else value_text(axis, i)
        for axis, i in place
    )


def standing(case: Json) -> tuple[str, str]:
    """Mark and words of a case."""
    return STANDING[None if case["reason"] is not None else case["verdict"]]


def is_told(row: Json) -> bool:
    """Whether a case says anything of this parameter."""
    return row["status"] not in ("unidentifiable", "held")


def predicted(row: Json) -> float | None:
    """The predicted std; never one of what the case cannot tell, whatever the answer holds."""
    return row["std"] if is_told(row) else None


def observed(row: Json, fit: str) -> Json | None:
    """The errors of a fit (`likelihood`, `midpoint`) where there are any; the same holds for them."""
    entry: Json | None = row[fit] if is_told(row) else None
    return entry if entry is not None and entry["runs"] and entry["rmse"] else None


def has_observed(answer: Json, fit: str) -> bool:
    return any(observed(row, fit) for case in answer["cases"] for row in case["parameters"])


def untold(case: Json) -> list[str]:
    """Labels of the parameters that a case cannot tell."""
    return [label(row["name"], 12) for row in case["parameters"] if row["status"] == "unidentifiable"]


def worst(case: Json) -> Json | None:
    """The offset that `worst_std` is of, degrees; None where one is not determined, or there is no plan."""
    std = case["worst_std"]
    if std is None or case["verdict"] == "degenerate" or case["reason"] is not None:
        return None
    found = [row for row in case["parameters"] if in_degrees(row) and predicted(row) is not None]
    return min(found, key=lambda row: abs(row["std"] - std)) if found else None


def is_varied(answer: Json, setting: str) -> bool:
    """Whether an axis changes a setting, or a part of it, or what it is a part of; by its dotted name."""
    changed = {key for axis in answer["axes"] for put in axis["set"] for key in put}
    return any(
        key == setting or key.startswith(f"{setting}.") or setting.startswith(f"{key}.") for key in changed
    )


def in_degrees(row: Json) -> bool:
    """Whether a parameter is an offset in degrees: those that `worst_std` is of."""
    return bool(row["unit"] == "deg") and not row["name"].startswith("tool.")


def rmse_interval(entry: Json) -> tuple[float, float]:
    """The 95 % interval of an rmse, by the χ² of as many runs with errors that are normal."""
    from scipy.special import chdtri

    runs, rmse = entry["runs"], entry["rmse"]
    low, high = (rmse * math.sqrt(runs / float(chdtri(runs, tail))) for tail in (0.025, 0.975))
    return low, high


def tolerance(answer: Json, row: Json) -> float | None:
    """What counts as identified for a parameter; None where the cases differ in it."""
    tilt = row["unit"] == "deg" and row["name"].startswith("tool.")
    key = "tilt_deg" if tilt else {"deg": "offset_deg", "mm": "length_mm"}.get(row["unit"])
    if key is None or is_varied(answer, "tolerance"):
        return None
    return float(answer["settings"]["tolerance"][key])
